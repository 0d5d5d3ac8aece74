//! What keys do, beyond moving the camera.

use super::input::Action;
use super::{Options, Viewer, panel, save, shown_path};
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use glam::DVec3;
use std::path::Path;

impl Viewer {
    pub(super) fn act(&mut self, options: &Options, action: Action) -> anyhow::Result<()> {
        self.window.request_redraw();
        match action {
            Action::FrameAll => self.look_from(self.camera.angles()),
            Action::Standard(standard) => self.look_from(standard.angles()),
            Action::Back => {
                if let Some(camera) = self.views.pop() {
                    self.set(camera);
                }
            }
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
            Action::SavePicture => self.save_picture()?,
            Action::SaveView => {
                let path = save::next_free(Path::new("."), "lasray-view", "json");
                let saved = save::view(&self.camera, self.data.about())
                    .and_then(|view| view.write(&path).map_err(|e| e.to_string()));
                match saved {
                    Ok(()) => self.notify(format!("View saved as {}", shown_path(&path))),
                    Err(why) => self.notify(why),
                }
            }
            Action::CopyCommand => {
                if let Some(about) = self.data.about() {
                    let (camera, settings) = (&self.camera, &self.settings);
                    let (inputs, size) = (self.data.inputs(), self.place.size);
                    let line = save::command(inputs, camera, about, settings, size, &options.data);
                    self.log(format_args!("command {line}"));
                    self.toolkit.set_clipboard_text(line);
                    self.notify("The command that draws this view is on the clipboard");
                }
            }
            Action::TogglePanel => self.panel.is_open = !self.panel.is_open,
            Action::ToggleKeys => self.panel.has_keys = !self.panel.has_keys,
            Action::NextColor => {
                let at = panel::MODES.iter().position(|mode| *mode == self.settings.color).unwrap_or(0);
                self.settings.color = panel::MODES[(at + 1) % panel::MODES.len()];
            }
            Action::ToggleBridge => {
                let bridge = &mut self.settings.visibility.bridge;
                *bridge = if *bridge > 0 { 0 } else { panel::BRIDGE };
            }
            Action::ToggleLight => {
                let shade = &mut self.settings.shade;
                *shade = if *shade == Shade::Lit { Shade::None } else { Shade::Lit };
            }
            Action::Escape => self.panel.close(),
        }
        Ok(())
    }

    pub(super) fn open_view(&mut self, path: &Path) {
        let Some(about) = self.data.about() else { return };
        let place = |v: DVec3| about.base.place(v);
        let camera = CameraPath::read(path)
            .map_err(|e| e.to_string())
            .and_then(|view| view.placed(place).map_err(|e| e.to_string()))
            .and_then(|view| view.camera(0).map_err(|e| e.to_string()));
        match camera {
            Ok(camera) => {
                self.keep_view();
                self.set(camera);
            }
            Err(why) => self.notify(why),
        }
    }
}
