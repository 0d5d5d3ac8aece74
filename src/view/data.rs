//! Where the window's data comes from: everything that it knows of files and sections goes through here.

use crate::coords::{Grid, Height};
use crate::gpu::{Gpu, Order};
use crate::load::{self, LoadError, LoadOptions, Opening};
use crate::problems::Problems;
use crate::render::camera::{Bounds, Camera};
use crate::render::frame::Renderer;
use crate::render::sight::sight;
use crate::source::inputs;
use crate::source::placement::PlacementOptions;
use crate::stream::bins::Budget;
use crate::stream::builds::{OpenInput, cells_of};
use crate::stream::live::{self, Live};
use crate::stream::pool::Access;
use crate::stream::scene::{Scene, Visibility};
use crate::stream::table::Table;
use crossbeam_channel::Receiver;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Bytes that one frame may upload.
const UPLOAD_BYTES: u64 = 4 << 20;
/// How often progress is looked at, at least.
const COUNT_EVERY: Duration = Duration::from_millis(100);

/// What the user decides about reading.
#[derive(Clone, Debug)]
pub struct Options {
    /// Side of a finest cell, CRS units; `None`: chosen from the data.
    pub cell: Option<f64>,
    /// Coordinate systems and units.
    pub placement: PlacementOptions,
    /// 8 or 16: what RGB fields hold, whatever the sample says.
    pub rgb_bits: Option<u8>,
    /// Host memory for sections, bytes.
    pub host_bytes: u64,
    /// Device memory for sections, bytes.
    pub device_bytes: u64,
    /// What is shown at first.
    pub visibility: Visibility,
}

/// An input file.
#[derive(Clone, Debug)]
pub struct FileAbout {
    /// Where it lies.
    pub path: PathBuf,
    /// Point records in it.
    pub points: u64,
    /// Whether it is shown.
    pub shown: bool,
}

/// What headers and the opening sample tell.
#[derive(Clone)]
pub struct About {
    /// Of the whole.
    pub whole: load::About,
    /// In the order of the inputs.
    pub files: Vec<FileAbout>,
}

impl std::ops::Deref for About {
    type Target = load::About;

    fn deref(&self) -> &load::About {
        &self.whole
    }
}

/// What a frame finds changed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tick {
    /// The picture is not what it was.
    pub changed: bool,
    /// The scene, its grid or its anchor is another one: what was made for the old one is of no use.
    pub is_new_scene: bool,
    /// More is on its way to the device: tick again soon.
    pub is_busy: bool,
}

/// How far things are.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Points of all files that are shown.
    pub points: u64,
    /// Points that are decoded and binned.
    pub points_decoded: u64,
    /// Sections that are to be drawn; 0 while that is not known.
    pub sections_wanted: u64,
    /// Sections on the device.
    pub sections_resident: u64,
    /// Host memory for sections, bytes, and its budget.
    pub host_bytes: [u64; 2],
    /// Device memory for sections, bytes, and its budget.
    pub device_bytes: [u64; 2],
    /// Why the picture is coarser than was asked for.
    pub reduced_detail: Option<String>,
    /// What went wrong, each once, and what was decided that is not obvious.
    pub messages: Vec<String>,
    /// Bytes of chunks that were read.
    pub bytes_read: u64,
    /// Times that a frame waited for the device to take a section.
    pub frames_waited: u64,
    /// Whether everything that is to be read has been.
    pub is_complete: bool,
    /// Why there is nothing to see.
    pub failed: Option<String>,
}

/// Files that are being opened, and what is to become of them.
struct Coming {
    opening: Receiver<(Result<Opening, LoadError>, Vec<String>)>,
    /// They come to those that are there.
    more: bool,
}

/// Wakes the window when there is news.
type Wake = Arc<dyn Fn() + Send + Sync>;

/// The data of a window.
pub struct Data {
    options: Options,
    wake: Wake,
    inputs: Vec<OsString>,
    coming: Vec<Coming>,
    about: Option<About>,
    live: Option<Live>,
    scene: Option<Scene>,
    grid: Grid,
    anchor: Height,
    now: live::Status,
    /// When that was asked for.
    counted: Instant,
    is_complete: bool,
    messages: Vec<String>,
    failed: Option<String>,
    is_held: bool,
}

impl Data {
    /// Opens `inputs`; returns at once. `wake` is called, from other threads, when there is something for
    /// [`Data::tick`].
    pub fn open(
        gpu: &Gpu,
        inputs: Vec<OsString>,
        options: Options,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> anyhow::Result<Data> {
        let budget = options.device_bytes.min(gpu.info().memory_bytes / 8 * 7);
        let options = Options { device_bytes: budget, ..options };
        let scene = Scene::new(gpu, |order| order, access(gpu, budget), budget, options.visibility, 1.0)?;
        let mut data = Data {
            options,
            wake: Arc::new(wake),
            inputs: Vec::new(),
            coming: Vec::new(),
            about: None,
            live: None,
            scene: Some(scene),
            grid: Grid { base_cell: 1.0, coarsen: 0, anchor: [0; 2] },
            anchor: Height(0),
            now: live::Status::default(),
            counted: Instant::now(),
            is_complete: false,
            messages: Vec::new(),
            failed: None,
            is_held: false,
        };
        data.add(inputs);
        Ok(data)
    }

    /// While held, files are read, but nothing comes to the device: see [`Scene::hold`].
    pub fn hold(&mut self, is_held: bool) {
        self.is_held = is_held;
        self.scene_mut().hold(is_held);
    }

    /// Takes what has arrived, once a frame; the camera, the picture's size and the vertical exaggeration say what is
    /// wanted.
    pub fn tick(
        &mut self,
        gpu: &Gpu,
        camera: &Camera,
        size: [u32; 2],
        z_scale: f64,
        lit: bool,
    ) -> anyhow::Result<Tick> {
        let mut tick = Tick::default();
        let mut opened = Vec::new();
        // In the order in which they were asked for.
        while let Some(coming) = self.coming.first() {
            match coming.opening.try_recv() {
                Ok((opening, lines)) => opened.push((opening, lines, coming.more)),
                Err(error) if error.is_empty() => break,
                Err(_) => {}
            }
            self.coming.remove(0);
        }
        for (opening, lines, more) in opened {
            tick.changed = true;
            self.say(lines);
            match opening {
                Ok(opening) if more && self.fits(&opening) => self.join(opening),
                Ok(opening) => {
                    self.replace(gpu, opening)?;
                    tick.is_new_scene = true;
                }
                Err(error) if self.about.is_some() => self.say(vec![error.to_string()]),
                Err(error) => self.failed = Some(error.to_string()),
            }
        }
        let (Some(live), Some(about)) = (&mut self.live, &self.about) else {
            self.is_complete = self.coming.is_empty();
            return Ok(tick);
        };
        let scene = self.scene.as_mut().expect("there is always one");
        if !size.contains(&0) {
            let pivot = about.bounds.min.z;
            // Solid columns without end are seen from below, too.
            let bounds = about.bounds;
            let floor = bounds.min.z - if lit { 0.1 * (bounds.max - bounds.min).max_element() } else { 1e6 };
            let sight = sight(camera, size, [z_scale, pivot], floor, 1.0)?;
            let now = live.tick(scene, &sight, UPLOAD_BYTES)?;
            scene.flush()?;
            tick.changed |= now.changed;
            tick.is_busy = scene.is_busy();
            self.is_complete = now.complete && self.coming.is_empty();
            let why = "the sections do not fit the device memory: give more with --device-memory";
            self.failed = now.stuck.then(|| why.to_owned());
        }
        if tick.changed || self.counted.elapsed() > COUNT_EVERY {
            self.now = live.status(scene);
            self.counted = Instant::now();
        }
        let errors = live.take_errors();
        self.say(errors);
        Ok(tick)
    }

    fn say(&mut self, lines: Vec<String>) {
        for line in lines {
            if !self.messages.contains(&line) {
                self.messages.push(line);
            }
        }
    }

    /// Whether files can be shown beside those that are.
    fn fits(&self, opening: &Opening) -> bool {
        let Some(about) = &self.about else { return false };
        let same = |a: &Option<crate::source::crs::Crs>, b: &Option<crate::source::crs::Crs>| {
            a.as_ref().map(|crs| &crs.name) == b.as_ref().map(|crs| &crs.name)
        };
        let bounds = opening.about.bounds;
        let countable = cells_of(&self.grid, bounds.min, bounds.max).is_some();
        countable && same(&about.crs, &opening.about.crs) && about.placement == opening.about.placement
    }

    /// More files, on the grid of those that are there.
    fn join(&mut self, opening: Opening) {
        let Opening { inputs, about, .. } = opening;
        let (Some(live), Some(known)) = (&mut self.live, &mut self.about) else { return };
        known.files.extend(inputs.iter().map(file_about));
        let (a, b) = (known.whole.bounds, about.bounds);
        known.whole.bounds = Bounds { min: a.min.min(b.min), max: a.max.max(b.max) };
        for (known, more) in known.whole.classes.iter_mut().zip(about.classes.iter()) {
            *known += more;
        }
        let core = load::core(self.grid.base_cell, &known.whole.bounds);
        live.add(inputs, core);
    }

    /// Other data: another scene.
    fn replace(&mut self, gpu: &Gpu, opening: Opening) -> anyhow::Result<()> {
        let Opening { inputs, grid, core, about } = opening;
        self.failed = None;
        self.grid = grid;
        self.anchor = Height::from_units(about.bounds.center().z).unwrap_or(Height(0));
        let files = inputs.iter().map(file_about).collect();
        self.about = Some(About { whole: about, files });
        let wake = Arc::clone(&self.wake);
        // Two threads are left to the frames, where there are more.
        let threads = load::threads();
        let host_bytes = self.options.host_bytes;
        self.live = Some(Live::new(inputs, grid, core, host_bytes, threads, move || wake()));
        // What is under way on the device goes on under the same order.
        let old = self.scene.take().expect("there is always one");
        let (visibility, order) = (old.visibility(), old.order);
        let keep = |fresh: Order| {
            drop(fresh);
            order
        };
        let budget = self.options.device_bytes;
        let mut scene = Scene::new(gpu, keep, access(gpu, budget), budget, visibility, grid.cell())?;
        scene.hold(self.is_held);
        self.scene = Some(scene);
        Ok(())
    }

    /// What was opened, at first and since.
    pub fn inputs(&self) -> &[OsString] {
        &self.inputs
    }

    /// What is known of the data; `None` until headers and the opening sample are read.
    pub fn about(&self) -> Option<&About> {
        self.about.as_ref()
    }

    /// The grid and the height that pictures count from.
    pub fn grid(&self) -> (Grid, Height) {
        (self.grid, self.anchor)
    }

    /// What is on the device.
    pub fn scene(&self) -> &Scene {
        self.scene.as_ref().expect("there is always one")
    }

    /// The same, to draw and to show other classes.
    pub fn scene_mut(&mut self) -> &mut Scene {
        self.scene.as_mut().expect("there is always one")
    }

    /// What a frame may see now.
    pub fn table(&self, renderer: &Renderer) -> Table {
        renderer.table_of(self.scene(), self.live.as_ref().map_or(&[], Live::shown))
    }

    /// Shows or hides a file, by its place in [`About::files`]. Until the sections that it touches are made anew, their
    /// old versions stay.
    pub fn set_visible(&mut self, file: usize, shown: bool) {
        let Some(about) = self.about.as_mut().and_then(|about| about.files.get_mut(file)) else { return };
        about.shown = shown;
        if let Some(live) = &mut self.live {
            live.show_file(file, shown);
        }
        self.is_complete = false;
    }

    /// Adds inputs, such as files that were dropped. Those that are there already are left alone.
    pub fn add(&mut self, inputs: Vec<OsString>) {
        let (send, opening) = crossbeam_channel::bounded(1);
        let (options, wake) = (self.options.clone(), Arc::clone(&self.wake));
        let known: Vec<_> =
            self.about.iter().flat_map(|about| &about.files).map(|file| file.path.clone()).collect();
        let more = !self.inputs.is_empty();
        self.inputs.extend(inputs.iter().cloned());
        self.is_complete = false;
        std::thread::spawn(move || {
            let mut problems = Problems::default();
            let mut found = inputs::expand(&inputs);
            found.failed.iter().for_each(|error| problems.error(error));
            found.files.retain(|path| !known.contains(path));
            let options = LoadOptions {
                cell: options.cell,
                placement: options.placement,
                rgb_bits: options.rgb_bits,
                budget: Budget { host_bytes: options.host_bytes, device_bytes: options.device_bytes },
                quiet: true,
            };
            let opened = load::open(&found.files, &options, &mut problems);
            // The window may be gone.
            let _ = send.send((opened, problems.take_lines()));
            wake();
        });
        self.coming.push(Coming { opening, more });
    }

    /// Whether everything that is to be seen is there.
    pub fn is_complete(&self) -> bool {
        self.is_complete || self.failed.is_some()
    }

    /// How far things are.
    pub fn status(&self) -> Status {
        let (now, progress) = (&self.now, &self.now.progress);
        let share = |done: u64, all: u64| if all == 0 { 0.0 } else { done as f64 / all as f64 };
        // Chunks that nothing lacks now count as read.
        let decoded = 1.0 - share(progress.lacking, progress.chunks);
        Status {
            points: progress.points,
            points_decoded: (progress.points as f64 * decoded) as u64,
            sections_wanted: now.wanted as u64,
            sections_resident: now.ready as u64,
            host_bytes: [now.host_bytes, self.options.host_bytes],
            device_bytes: [now.device_bytes, self.options.device_bytes],
            reduced_detail: (now.coarser > 1.0)
                .then(|| format!("cells cover up to {:.1} pixels, for lack of device memory", now.coarser)),
            messages: self.messages.clone(),
            bytes_read: progress.bytes_read,
            frames_waited: self.scene().counters().waits,
            is_complete: self.is_complete(),
            failed: self.failed.clone(),
        }
    }
}

/// Derived parts take less than half of what sections do.
fn access(gpu: &Gpu, budget: u64) -> Access {
    Access::best(gpu, budget / 2)
}

fn file_about(input: &OpenInput) -> FileAbout {
    let file = &input.input.file;
    FileAbout { path: file.path().to_owned(), points: file.points(), shown: true }
}
