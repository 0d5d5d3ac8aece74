//! What keys do, beyond moving the camera: views, images and settings.

use super::input::Action;
use super::options::WindowOptions;
use super::pick;
use super::save;
use super::saving::Saving;
use super::settings::{BRIDGE, MODES};
use super::viewer::Viewer;
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use std::path::Path;

impl Viewer {
    /// Does what a key stands for.
    pub(super) fn act(&mut self, options: &WindowOptions, action: Action) -> anyhow::Result<()> {
        self.window.request_redraw();
        match action {
            Action::FrameAll => self.look_from(self.navigation.camera.angles()),
            Action::Standard(standard) => self.look_from(standard.angles()),
            Action::Back => self.navigation.back(),
            Action::GoTo => {
                self.panel.close();
                (self.panel.go_to, self.panel.focus) = (Some(String::new()), true);
            }
            Action::OpenView => {
                self.panel.close();
                let last = save::last_taken(Path::new("."), "lasray-view", "json");
                let name = last.map_or(String::new(), |path| path.display().to_string());
                (self.panel.open_view, self.panel.focus) = (Some(name), true);
            }
            Action::SaveImage => self.save_image()?,
            Action::SaveView => {
                let path = save::next_free(Path::new("."), "lasray-view", "json");
                let saved = save::view(&self.navigation.camera, self.data.about())
                    .and_then(|view| view.write(&path).map_err(|e| e.to_string()));
                match saved {
                    Ok(()) => self.notify(format!("View saved as {}", shown_path(&path))),
                    Err(why) => self.notify(why),
                }
            }
            Action::CopyCommand => {
                if let Some(about) = self.data.about() {
                    let (camera, settings) = (&self.navigation.camera, &self.settings);
                    let (inputs, size) = (self.data.inputs(), self.canvas.size());
                    let line = save::command(inputs, camera, about, settings, size, &options.data);
                    self.log.line(format_args!("command {line}"));
                    self.toolkit.set_clipboard_text(line);
                    self.notify("The command that draws this view is on the clipboard");
                }
            }
            Action::CopyPoint => {
                let point = self.canvas.kept().or(self.under_cursor());
                if let (Some(point), Some(about)) = (point, self.data.about()) {
                    let line = pick::copied(&point, about);
                    self.log.line(format_args!("copied {line}"));
                    self.notify(format!("{line} is on the clipboard"));
                    self.toolkit.set_clipboard_text(line);
                } else {
                    self.notify("Click on a point, or move the cursor over one, to copy its coordinates");
                }
            }
            Action::TogglePanel => self.panel.is_open = !self.panel.is_open,
            Action::ToggleKeys => self.panel.has_keys = !self.panel.has_keys,
            Action::NextColor => {
                let at = MODES.iter().position(|mode| *mode == self.settings.color).unwrap_or(0);
                self.settings.color = MODES[(at + 1) % MODES.len()];
            }
            Action::ToggleBridge => {
                let bridge = &mut self.settings.visibility.bridge;
                *bridge = if *bridge > 0 { 0 } else { BRIDGE };
            }
            Action::ToggleLight => {
                let shade = &mut self.settings.shade;
                *shade = if *shade == Shade::Lit { Shade::None } else { Shade::Lit };
            }
            Action::Escape => {
                self.panel.close();
                self.canvas.let_go();
            }
        }
        Ok(())
    }

    fn look_from(&mut self, angles: [f64; 2]) {
        self.navigation.look_from(angles, (&self.data, &self.settings, &self.canvas));
    }

    /// Begins to save what is seen.
    fn save_image(&mut self) -> anyhow::Result<()> {
        let is_free = self.saving.is_none() && !self.writer.is_busy();
        if self.saving.is_none() {
            // Keys may have changed them since the last frame.
            self.apply_settings()?;
        }
        if !self.canvas.is_drawn() {
            self.notify("There is nothing to save yet");
        } else if !is_free {
            self.notify("A picture is being saved");
        } else {
            let path = save::next_free(Path::new("."), "lasray", "png");
            let seen = (&self.settings, &self.navigation.camera);
            self.saving = Saving::begin(&mut self.data, &mut self.canvas, seen, path)?.map(Box::new);
        }
        Ok(())
    }

    /// Has the image written that was drawn for a file, and tells of those that were written.
    pub(super) fn take_saved(&mut self) -> anyhow::Result<()> {
        if let Some(saving) = &mut self.saving
            && let Some(image) = saving.image(&mut self.data)?
        {
            let wake = self.wake.clone();
            let (path, notes) = saving.file(&self.data);
            self.writer.write(image, path, notes, move || wake());
            self.saving = None;
        }
        for (path, written) in self.writer.take() {
            match written {
                Ok(()) => {
                    self.log.line(format_args!("saved {}", path.display()));
                    self.notify(format!("Saved {}", shown_path(&path)));
                }
                Err(error) => self.notify(error.to_string()),
            }
            self.window.request_redraw();
        }
        Ok(())
    }

    /// Goes to the view of a file.
    pub(super) fn open_view(&mut self, path: &Path) {
        if self.data.about().is_none() {
            return;
        }
        let view = CameraPath::read(path).map_err(|e| e.to_string());
        match view.and_then(|view| self.navigation.open(&view, &self.data)) {
            Ok(()) => self.window.request_redraw(),
            Err(why) => self.notify(why),
        }
    }
}

/// A path as it is told: absolute where that can be found out.
fn shown_path(path: &Path) -> String {
    std::path::absolute(path).unwrap_or(path.to_owned()).display().to_string()
}
