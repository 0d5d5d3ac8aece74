//! What keys do, beyond moving the camera: views, images and settings.

use super::boxes::{OpenBox, OpenRequest};
use super::file_list::FileRequest;
use super::input::Action;
use super::layers;
use super::options::{OpenedView, WindowOptions};
use super::pick;
use super::remarks;
use super::save;
use super::saving::Saving;
use super::settings::{BRIDGE, modes};
use super::viewer::Viewer;
use crate::render::frame::Shade;
use std::path::{Path, PathBuf};

impl Viewer {
    /// Does what a key stands for.
    pub(super) fn act(&mut self, action: Action) -> anyhow::Result<()> {
        self.window.request_redraw();
        match action {
            Action::FrameAll => self.look_from(self.navigation.camera.angles(), None),
            Action::Standard(standard) => self.look_from(standard.angles(), Some(standard.is_parallel())),
            Action::ToggleProjection => self.navigation.ask_for_toggle(),
            Action::NorthUp => self.navigation.north_up((&self.data, &self.settings, &self.canvas)),
            Action::Back => self.navigation.back(),
            Action::GoTo => {
                self.panel.boxes.close();
                (self.panel.boxes.go_to, self.panel.boxes.focus) = (Some(String::new()), true);
            }
            Action::Open => {
                self.panel.boxes.close();
                (self.panel.boxes.open, self.panel.boxes.focus) = (Some(OpenBox::default()), true);
            }
            Action::SaveImage => self.save_image()?,
            Action::SaveView => {
                let path = save::next_free(Path::new("."), "lasray-view", &["json"]);
                let saved = self.seen().ok_or_else(|| "There is no view to save yet".to_owned());
                let saved = saved
                    .and_then(|seen| save::view(&seen, Path::new(".")))
                    .and_then(|view| view.write(&path).map_err(|e| e.to_string()));
                match saved {
                    Ok(()) => self.notify(format!("View saved as {}", shown_path(&path))),
                    Err(why) => self.notify(why),
                }
            }
            Action::CopyCommand => {
                if let Some(line) = self.seen().map(|seen| save::command(&seen)) {
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
            Action::ToggleKeys => self.panel.boxes.has_keys = !self.panel.boxes.has_keys,
            Action::NextColor => {
                let modes: Vec<_> = modes(self.data.about()).collect();
                let at = modes.iter().position(|mode| *mode == self.settings.color).unwrap_or(0);
                self.settings.color = modes[(at + 1) % modes.len()];
            }
            Action::NextPreset => {
                let visibility = &mut self.settings.visibility;
                let preset = layers::next(visibility, &self.data.status().kinds);
                if let Some(preset) = preset {
                    visibility.classes = preset.mask();
                }
                self.notify(preset.map_or_else(
                    || "No preset shows other points than these".to_owned(),
                    |preset| format!("{}: {}", preset.label, preset.words()),
                ));
            }
            Action::ToggleBridge => {
                let bridge = &mut self.settings.visibility.bridge;
                *bridge = if *bridge > 0 { 0 } else { BRIDGE };
                if self.settings.shade == Shade::None {
                    self.notify("Holes are bridged in light only: L");
                }
            }
            Action::ToggleLight => {
                let shade = &mut self.settings.shade;
                *shade = if *shade == Shade::Lit { Shade::None } else { Shade::Lit };
            }
            Action::Escape => {
                self.panel.boxes.close();
                self.canvas.let_go();
            }
        }
        Ok(())
    }

    fn look_from(&mut self, angles: [f64; 2], is_parallel: Option<bool>) {
        self.navigation.look_from(angles, is_parallel, (&self.data, &self.settings, &self.canvas));
    }

    /// What is seen, once there is something.
    fn seen(&self) -> Option<save::Seen<'_>> {
        Some(save::Seen {
            data: &self.data,
            about: self.data.about().filter(|_| self.navigation.is_framed())?,
            camera: &self.navigation.camera,
            settings: &self.settings,
            colors: self.canvas.colors().map(|(_, table)| table),
            size: self.canvas.size(),
        })
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
            let path = save::next_free(Path::new("."), "lasray", &["png", "pgw", "prj"]);
            // All of it shows the same classes.
            self.data.scene_mut().finish_switch()?;
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
            self.writer.write(image, saving.file(&self.data), move || wake());
            self.saving = None;
        }
        for (path, written) in self.writer.take() {
            match written {
                Ok(beside) => {
                    let with = match &beside.written[..] {
                        [] => String::new(),
                        names => format!(", with {}", names.join(" and ")),
                    };
                    let but = beside.said.iter().map(|line| format!("; {line}")).collect::<String>();
                    self.notify(format!("Saved {}{with}{but}", shown_path(&path)));
                    self.log.line(format_args!("saved {}{with}", path.display()));
                }
                Err(error) => self.notify(error.to_string()),
            }
            self.window.request_redraw();
        }
        Ok(())
    }

    /// Goes to the view of a file: all of it where it says what it is of, else its camera.
    pub(super) fn open_view(&mut self, options: &WindowOptions, path: &Path) -> anyhow::Result<()> {
        match (options.read_view)(path) {
            Ok(OpenedView::Whole(view)) => {
                self.reopen(*view)?;
                self.notify(format!("View of {}", path.display()));
            }
            Ok(OpenedView::Camera(_)) if self.data.about().is_none() => {
                self.notify(format!("{}: names no files: open those first", path.display()));
            }
            Ok(OpenedView::Camera(camera)) => {
                if let Err(why) = self.navigation.open(&camera, &self.data, &self.settings) {
                    self.notify(why);
                }
                self.window.request_redraw();
            }
            Err(why) => self.notify(why),
        }
        Ok(())
    }

    /// Opens what was asked for: files and folders beside what is open, or in its place; a view always in its place.
    pub(super) fn open(&mut self, options: &WindowOptions, request: OpenRequest) -> anyhow::Result<()> {
        let is_view = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        let (views, inputs): (Vec<_>, Vec<_>) =
            request.inputs.into_iter().partition(|input| is_view(Path::new(input)));
        if let Some(view) = views.last() {
            self.open_view(options, Path::new(view))?;
        }
        match inputs.is_empty() {
            true => {}
            false if request.instead => {
                self.reopen(options.view.of_others(inputs))?;
            }
            false => {
                if self.data.is_empty() {
                    self.name_window(&inputs);
                }
                self.data.add(inputs);
            }
        }
        self.window.request_redraw();
        Ok(())
    }

    /// Does what was asked for with a file of the list.
    pub(super) fn do_with_file(
        &mut self,
        options: &WindowOptions,
        request: FileRequest,
    ) -> anyhow::Result<()> {
        match request {
            FileRequest::Show(file, is_shown) => {
                self.log.line(format_args!("file {file} {}", if is_shown { "shown" } else { "hidden" }));
                self.data.set_visible(file, is_shown);
            }
            FileRequest::ZoomTo(file) => {
                let is_first = self.data.is_first();
                let about = self.data.about();
                let hull = about.and_then(|about| about.files.get(file)?.hull(is_first).cloned());
                if let Some(hull) = hull {
                    self.log.line(format_args!("file {file} zoomed to"));
                    self.navigation.look_at(&hull, (&self.data, &self.settings, &self.canvas));
                } else {
                    self.notify("It is not known where its points lie");
                }
            }
            FileRequest::Remove(file) => {
                self.log.line(format_args!("file {file} removed"));
                self.data.remove(file);
                if self.data.is_emptied() {
                    // What comes next has a world of its own.
                    self.reopen(options.view.of_others(Vec::new()))?;
                }
            }
            FileRequest::Dismiss(refused) => self.data.dismiss(refused),
            FileRequest::Copy => {
                let files = self.data.about().map_or(&[][..], |about| &about.files);
                let list = remarks::list(files.iter(), self.data.refused());
                list.lines().for_each(|line| self.log.line(format_args!("list {line}")));
                self.toolkit.set_clipboard_text(list);
                self.notify("The list of files is on the clipboard");
            }
        }
        self.window.request_redraw();
        Ok(())
    }

    /// Files that were dropped onto the window: views and data.
    pub(super) fn take_dropped(&mut self, options: &WindowOptions) -> anyhow::Result<()> {
        let inputs: Vec<_> =
            std::mem::take(&mut self.dropped).into_iter().map(PathBuf::into_os_string).collect();
        match inputs.is_empty() {
            true => Ok(()),
            false => self.open(options, OpenRequest { inputs, instead: false }),
        }
    }
}

/// A path as it is told: absolute where that can be found out.
fn shown_path(path: &Path) -> String {
    std::path::absolute(path).unwrap_or(path.to_owned()).display().to_string()
}
