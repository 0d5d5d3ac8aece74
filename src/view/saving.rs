//! Images on their way to files: drawn in bands beside the window's frames, written by a thread.

use super::canvas::Canvas;
use super::data::Data;
use super::settings::{Colors, SAMPLES, Settings, view_of};
use crate::gpu::{Buffer, Commands, SyncPoint};
use crate::output::{Output, Protected};
use crate::render::camera::{Camera, Projection};
use crate::render::frame::Renderer;
use crate::render::image::{Image, ImageError, notes};
use crate::render::screen::Screen;
use crate::render::side_files::{SideFiles, WorldFile};
use crate::resident::table::Table;
use crate::source::crs::Crs;
use crossbeam_channel::{Receiver, Sender, unbounded};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;

/// An image that is being drawn. Until it is, nothing comes to the device and nothing goes: it is of one moment.
pub struct Saving {
    renderer: Renderer,
    screen: Screen,
    camera: Camera,
    settings: Settings,
    colors: Colors,
    size: [u32; 2],
    table: Arc<Table>,
    path: PathBuf,
    /// What is copied for the host, and when.
    copied: Option<(Buffer, Option<SyncPoint>)>,
}

impl Saving {
    /// Begins to draw what is seen, for a file at `path`; `None` where there is nothing to draw yet.
    pub fn begin(
        data: &mut Data,
        canvas: &mut Canvas,
        (settings, camera): (&Settings, &Camera),
        path: PathBuf,
    ) -> anyhow::Result<Option<Saving>> {
        let (Some(colors), Some(renderer)) = (canvas.colors().cloned(), canvas.renderer()) else {
            return Ok(None);
        };
        let table = data.table(renderer);
        let (grid, anchor) = data.grid();
        let size = canvas.size();
        let mut screen = Screen::default();
        screen.start(size);
        Ok(Some(Saving {
            renderer: Renderer::new(data.scene(), grid, anchor)?,
            screen,
            camera: *camera,
            settings: settings.clone(),
            colors,
            size,
            table,
            path,
            copied: None,
        }))
    }

    /// Records the next band of at most `rows` rows, and the copy once all are there; whether a copy was recorded.
    pub fn record(
        &mut self,
        data: &mut Data,
        (commands, slot): (&mut Commands, usize),
        rows: u32,
    ) -> anyhow::Result<bool> {
        let Some(view) = view_of(data, &self.settings, &self.camera, Some(&self.colors), self.size) else {
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

    /// Where it goes, what is told in the file, and what lies beside it.
    pub fn file(&self, data: &Data) -> PictureFile {
        let notes = notes(&self.camera, &data.grid().0);
        let about = data.about();
        let world = about.filter(|_| matches!(self.camera.projection(), Projection::Orthographic { .. }));
        let world = world.and_then(|about| {
            // In the world's own coordinates, degrees among them, not in those that are drawn.
            let [east, north] = about.base.horizontal_scale()?;
            Some(WorldFile::of(&self.camera.basis(self.size).ok()?)?.scaled([1.0 / east, 1.0 / north]))
        });
        let wkt = about.and_then(|about| about.crs.as_ref()).and_then(Crs::prj);
        let side = SideFiles::new(&self.path, world.as_ref(), wkt.as_deref());
        PictureFile {
            path: self.path.clone(),
            notes,
            side,
            is_map: world.is_some(),
            has_system: wkt.is_some(),
        }
    }

    /// The image, once it is there.
    pub fn image(&mut self, data: &mut Data) -> anyhow::Result<Option<Image>> {
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

/// A picture that is to be written.
pub struct PictureFile {
    path: PathBuf,
    notes: [(&'static str, String); 3],
    side: SideFiles,
    is_map: bool,
    has_system: bool,
}

impl PictureFile {
    /// Writes it, and what says where it lies.
    fn write(&self, image: &Image) -> Result<Beside, ImageError> {
        let note = self.side.note();
        let mut notes: Vec<_> = self.notes.iter().map(|(key, value)| (*key, value.as_str())).collect();
        notes.extend((!note.is_empty()).then_some(("Beside", &*note)));
        image.write(Output::fresh(&self.path), false, &notes)?;
        let said = self.side.write(&Protected::default());
        let names = [("world file", self.is_map), (".prj", self.is_map && self.has_system)];
        let written = names.into_iter().filter(|(_, is_there)| *is_there && said.is_empty());
        Ok(Beside { written: written.map(|(name, _)| name).collect(), said })
    }
}

/// What lies beside a picture.
pub struct Beside {
    /// What was written.
    pub written: Vec<&'static str>,
    /// What is to be said of the rest.
    pub said: Vec<String>,
}

/// What became of a file.
pub type Written = (PathBuf, Result<Beside, ImageError>);

/// Writes images; those under way are finished before it is gone.
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
    /// Has a thread write an image; `wake` is called when it has.
    pub fn write(&mut self, image: Image, file: PictureFile, wake: impl Fn() + Send + 'static) {
        let send = self.send.clone();
        self.threads.push(std::thread::spawn(move || {
            let written = file.write(&image);
            // The window may be gone.
            let _ = send.send((file.path, written));
            wake();
        }));
    }

    /// Whether an image is being written.
    pub fn is_busy(&self) -> bool {
        !self.threads.is_empty()
    }

    /// What was written since.
    pub fn take(&mut self) -> Vec<Written> {
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
