//! One line on standard output for each thing that happens, for tests.

/// See the module; off unless asked for.
#[derive(Default)]
pub struct EventLog {
    is_on: bool,
    /// Pixels of the window in the last frame.
    window_size: [u32; 2],
    /// Where the checks of files are, as told last.
    checks: Vec<(usize, egui::Pos2)>,
}

impl EventLog {
    /// Lines are written where `is_on`.
    pub fn new(is_on: bool) -> EventLog {
        EventLog { is_on, ..EventLog::default() }
    }

    /// One line.
    pub fn line(&self, line: std::fmt::Arguments) {
        if self.is_on {
            println!("{line}");
        }
    }

    /// The window has so many pixels; told where they are others than before.
    pub fn window_size(&mut self, size: [u32; 2]) {
        if self.window_size != size {
            self.window_size = size;
            self.line(format_args!("size {}x{}", size[0], size[1]));
        }
    }

    /// Where the checks of files lie, points; told where they are others than before.
    pub fn checks(&mut self, checks: Vec<(usize, egui::Pos2)>, pixels_per_point: f32) {
        if self.is_on && checks != self.checks {
            for (file, at) in &checks {
                let at = *at * pixels_per_point;
                self.line(format_args!("check {file} {:.0} {:.0}", at.x, at.y));
            }
            self.checks = checks;
        }
    }
}
