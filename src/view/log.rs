//! One line on standard output for each thing that happens, for tests.

use std::collections::BTreeMap;

/// See the module; off unless asked for.
#[derive(Default)]
pub struct EventLog {
    is_on: bool,
    /// Pixels of the window in the last frame.
    window_size: [u32; 2],
    /// Where the parts of the panel are that can be clicked, as told last.
    places: Vec<(String, egui::Pos2)>,
    /// The last line of each thing that is told only when it changes.
    states: BTreeMap<&'static str, String>,
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

    /// Where parts of the panel lie that can be clicked, points; told where they are others than before.
    pub fn places(&mut self, places: Vec<(String, egui::Pos2)>, pixels_per_point: f32) {
        if self.is_on && places != self.places {
            for (name, at) in &places {
                let at = *at * pixels_per_point;
                self.line(format_args!("{name} {:.0} {:.0}", at.x, at.y));
            }
            self.places = places;
        }
    }

    /// How a thing is now; told where it is not as it was.
    pub fn state(&mut self, name: &'static str, state: std::fmt::Arguments) {
        if self.is_on {
            let state = state.to_string();
            if self.states.get(name) != Some(&state) {
                self.line(format_args!("{name} {state}"));
                self.states.insert(name, state);
            }
        }
    }
}
