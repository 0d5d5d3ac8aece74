//! Pictures on their way to files: drawn in bands beside the window's frames, written by a thread.

use super::data::Data;
use super::panel::Settings;
use super::redraw::traced;
use super::{SAMPLES, Viewer, save, shown_path};
use crate::attribute::{ColorMode, ColorTable};
use crate::gpu::{Buffer, Commands, SyncPoint};
use crate::output::Output;
use crate::render::camera::Camera;
use crate::render::frame::Renderer;
use crate::render::image::{Image, ImageError, notes};
use crate::render::screen::Screen;
use crate::resident::table::Table;
use crossbeam_channel::{Receiver, Sender, unbounded};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// A picture that is being drawn. Until it is, nothing comes to the device and nothing goes: it is of one moment.
pub struct Saving {
    renderer: Renderer,
    screen: Screen,
    camera: Camera,
    settings: Settings,
    colors: (ColorMode, ColorTable),
    size: [u32; 2],
    table: Arc<Table>,
    path: PathBuf,
    /// What is copied for the host, and when.
    copied: Option<(Buffer, Option<SyncPoint>)>,
}

impl Saving {
    /// Records the next band of at most `rows` rows, and the copy once all are there; whether a copy was recorded.
    pub fn record(
        &mut self,
        data: &mut Data,
        (commands, slot): (&mut Commands, usize),
        rows: u32,
    ) -> anyhow::Result<bool> {
        let Some(view) = traced(data, &self.settings, &self.camera, Some(&self.colors), self.size) else {
            return Ok(false);
        };
        let scene = data.scene_mut();
        self.screen.record(&mut self.renderer, scene, (commands, slot), &view, &self.table, rows)?;
        if self.screen.samples() < SAMPLES || self.copied.is_some() {
            return Ok(false);
        }
        self.copied = self.screen.copy(&self.renderer, scene, commands)?.map(|back| (back, None));
        Ok(self.copied.is_some())
    }

    /// Samples that are whole.
    pub fn samples(&self) -> u32 {
        self.screen.samples()
    }

    /// Tells that frame `slot` was submitted.
    pub fn submitted(&mut self, slot: usize, point: SyncPoint) {
        self.screen.submitted(slot, point);
        if let Some((_, copied)) = &mut self.copied {
            copied.get_or_insert(point);
        }
    }

    /// The picture, once it is there.
    fn image(&mut self, data: &mut Data) -> anyhow::Result<Option<Image>> {
        let Some((back, Some(point))) = &self.copied else { return Ok(None) };
        let order = &mut data.scene_mut().order;
        if !order.reached(*point)? {
            return Ok(None);
        }
        let mut image = Image::new(self.size);
        order.read(*point, back, 0, bytemuck::cast_slice_mut(&mut image.color))?;
        Ok(Some(image))
    }
}

/// What became of a file.
type Written = (PathBuf, Result<(), ImageError>);

/// Writes pictures; those under way are finished before it is gone.
pub struct Writer {
    send: Sender<Written>,
    written: Receiver<Written>,
    threads: Vec<JoinHandle<()>>,
}

impl Default for Writer {
    fn default() -> Writer {
        let (send, written) = unbounded();
        Writer { send, written, threads: Vec::new() }
    }
}

impl Writer {
    fn write(
        &mut self,
        image: Image,
        path: PathBuf,
        notes: [(&'static str, String); 3],
        wake: impl Fn() + Send + 'static,
    ) {
        let send = self.send.clone();
        self.threads.push(std::thread::spawn(move || {
            let notes = notes.each_ref().map(|(key, value)| (*key, value.as_str()));
            let written = image.write(Output::fresh(&path), false, &notes);
            // The window may be gone.
            let _ = send.send((path, written));
            wake();
        }));
    }

    fn is_busy(&self) -> bool {
        !self.threads.is_empty()
    }

    fn take(&mut self) -> Vec<Written> {
        let written: Vec<_> = self.written.try_iter().collect();
        if !written.is_empty() {
            self.finish();
        }
        written
    }

    fn finish(&mut self) {
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Viewer {
    /// Begins to save what is seen.
    pub(super) fn save_picture(&mut self) -> anyhow::Result<()> {
        let size = self.place.size;
        if self.saving.is_none() {
            // Keys may have changed them since the last frame.
            self.has_news |= self.apply_settings()?;
        }
        let (Some(renderer), Some(colors)) = (&mut self.renderer, &self.colors) else {
            self.notify("There is nothing to save yet");
            return Ok(());
        };
        if self.saving.is_some() || self.writer.is_busy() {
            self.notify("A picture is being saved");
            return Ok(());
        }
        let path = save::next_free(Path::new("."), "lasray", "png");
        let table = self.data.table(renderer);
        let (grid, anchor) = self.data.grid();
        let mut screen = Screen::default();
        screen.start(size);
        self.saving = Some(Box::new(Saving {
            renderer: Renderer::new(self.data.scene(), grid, anchor)?,
            screen,
            camera: self.camera,
            settings: self.settings.clone(),
            colors: colors.clone(),
            size,
            table,
            path,
            copied: None,
        }));
        Ok(())
    }

    /// Has the picture written that is drawn, and tells of those that were written.
    pub(super) fn take_saved(&mut self) -> anyhow::Result<()> {
        if let Some(saving) = &mut self.saving
            && let Some(image) = saving.image(&mut self.data)?
        {
            let wake = self.wake.clone();
            let notes = notes(&saving.camera, &self.data.grid().0);
            self.writer.write(image, saving.path.clone(), notes, move || wake());
            self.saving = None;
        }
        for (path, written) in self.writer.take() {
            match written {
                Ok(()) => {
                    self.log(format_args!("saved {}", path.display()));
                    self.notify(format!("Saved {}", shown_path(&path)));
                }
                Err(error) => self.notify(error.to_string()),
            }
            self.window.request_redraw();
        }
        Ok(())
    }
}
