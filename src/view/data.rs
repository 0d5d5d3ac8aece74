//! Where the window's data comes from: everything that it knows of files and sections goes through here.

use crate::attribute::{AttributeSummary, ColorMode};
use crate::coords::{Grid, Height, SectionKey, tidy};
use crate::gpu::{Gpu, Order};
use crate::load::{self, LoadError};
use crate::render::camera::{Bounds, Camera};
use crate::sample::{self, Opened, RgbDepth};
use crate::section::Packed;
use crate::source::crs::{Crs, Unit};
use crate::source::inputs;
use crate::source::placement::{Placement, PlacementNote, PlacementOptions};
use crate::stream::bins::{Bins, Budget};
use crate::stream::pool::{Access, slot_bytes};
use crate::stream::scene::{Scene, Visibility};
use crate::stream::workers::{Input, Progress, read_all};
use crossbeam_channel::{Receiver, Sender};
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Time that one frame may spend on uploads.
const SLICE: Duration = Duration::from_millis(4);
/// A tick that takes longer has waited for the device.
const WAITED: Duration = Duration::from_millis(30);
/// Ticks after which what was uploaded is sure to be built: a frame waits for the one before the last.
const SETTLED: u32 = 6;
/// Sections that are packed and wait for the device.
const PACKED_AHEAD: usize = 4;

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
#[derive(Clone, Debug)]
pub struct About {
    /// Without stray points: what is framed.
    pub bounds: Bounds,
    /// What colours are chosen by.
    pub summary: AttributeSummary,
    /// What `auto` comes to.
    pub color: ColorMode,
    /// The data's coordinate system.
    pub crs: Option<Crs>,
    /// Unit of E, N and U.
    pub unit: Option<Unit>,
    /// File coordinates to world coordinates, of the first file.
    pub placement: Placement,
    /// In the order of the inputs.
    pub files: Vec<FileAbout>,
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
    /// Points that are read.
    pub points_read: u64,
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
    /// Nanoseconds of all workers so far: read, decode, prepare.
    pub stages: [u64; 3],
    /// Frames that stood still while sections were handed to the device.
    pub frames_waited: u64,
    /// Whether everything that is to be read has been.
    pub is_complete: bool,
    /// Why there is nothing to see.
    pub failed: Option<String>,
}

/// From the loading thread.
enum News {
    About(Box<About>, Grid, u64),
    Message(String),
    Reduced(String),
    /// Grid, number of sections, bytes of their derived parts in the pool, and of the host's memory.
    Sections(Grid, u64, u64, u64),
    Section(SectionKey, Packed),
    Done,
    Failed(String),
}

/// One pass over the files.
struct Loading {
    news: Receiver<News>,
    progress: Arc<Progress>,
}

impl Drop for Loading {
    fn drop(&mut self) {
        self.progress.stop.store(true, Ordering::Relaxed);
    }
}

/// Wakes the window when there is news.
type Wake = Arc<dyn Fn() + Send + Sync>;

/// The data of a window.
pub struct Data {
    options: Options,
    wake: Wake,
    inputs: Vec<OsString>,
    hidden: Vec<PathBuf>,
    loading: Loading,
    about: Option<About>,
    scene: Option<Scene>,
    grid: Grid,
    anchor: Height,
    entries: usize,
    /// Ticks since the device was last given something.
    quiet: u32,
    status: Status,
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
        let wake: Wake = Arc::new(wake);
        let scene = Scene::new(gpu, |order| order, Access::Address, budget, options.visibility, 1.0)?;
        let status =
            Status { host_bytes: [0, options.host_bytes], device_bytes: [0, budget], ..Status::default() };
        Ok(Data {
            loading: load(inputs.clone(), Vec::new(), options.clone(), wake.clone()),
            options,
            wake,
            inputs,
            hidden: Vec::new(),
            about: None,
            scene: Some(scene),
            grid: Grid { base_cell: 1.0, coarsen: 0, anchor: [0; 2] },
            anchor: Height(0),
            entries: 0,
            quiet: SETTLED,
            status,
        })
    }

    /// Takes what has arrived, once a frame; the camera and the picture's size say what is wanted.
    pub fn tick(&mut self, gpu: &Gpu, _camera: &Camera, _size: [u32; 2]) -> anyhow::Result<Tick> {
        let mut tick = Tick::default();
        let begun = Instant::now();
        let until = begun + SLICE;
        let loading = self.loading.news.clone();
        let mut uploaded = false;
        while Instant::now() < until {
            let Ok(news) = loading.try_recv() else { break };
            match news {
                News::About(about, grid, points) => {
                    self.status.points = points;
                    self.anchor = Height::from_units(about.bounds.center().z).unwrap_or(Height(0));
                    // Until its sections are there, the old picture stays.
                    if self.about.is_none() {
                        self.grid = grid;
                        tick.is_new_scene = true;
                    }
                    let files = self.files(about.files.clone());
                    self.about = Some(About { files, ..*about });
                }
                News::Message(line) => {
                    if !self.status.messages.contains(&line) {
                        self.status.messages.push(line);
                    }
                }
                News::Reduced(why) => self.status.reduced_detail = Some(why),
                News::Sections(grid, count, bytes, host_bytes) => {
                    self.grid = grid;
                    self.status.sections_wanted = count;
                    self.status.sections_resident = 0;
                    self.status.host_bytes[0] = host_bytes;
                    self.replace_scene(gpu, Access::best(gpu, bytes))?;
                    tick.is_new_scene = true;
                }
                News::Section(key, packed) => {
                    uploaded = true;
                    if self.scene_mut().upload(key, &packed)? {
                        self.status.sections_resident += 1;
                    } else {
                        let line = "the sections do not fit the device memory: give more with --device-memory, or a larger --cell";
                        self.status.failed = Some(line.to_owned());
                    }
                }
                News::Done => {
                    self.status.is_complete = true;
                    self.status.host_bytes[0] = 0;
                }
                News::Failed(why) => {
                    self.status.failed = Some(why);
                    self.status.is_complete = true;
                }
            }
            tick.changed = true;
        }
        let scene = self.scene.as_mut().expect("there is always one");
        if uploaded {
            scene.flush()?;
        }
        scene.advance()?;
        let entries = scene.entries().len();
        tick.changed |= entries != self.entries || tick.is_new_scene;
        // What has been uploaded is built a frame or two later.
        self.quiet = if uploaded || entries != self.entries { 0 } else { self.quiet.saturating_add(1) };
        tick.is_busy = self.quiet < SETTLED || !loading.is_empty();
        self.entries = entries;
        self.status.frames_waited += u64::from(begun.elapsed() > WAITED);
        self.status.device_bytes[0] = self.scene().pool().held_bytes();
        Ok(tick)
    }

    /// Another scene; what is under way on the device goes on under the same order.
    fn replace_scene(&mut self, gpu: &Gpu, access: Access) -> anyhow::Result<()> {
        let old = self.scene.take().expect("there is always one");
        let (visibility, order) = (old.visibility(), old.order);
        let keep = |fresh: Order| {
            drop(fresh);
            order
        };
        let (budget, cell) = (self.options.device_bytes, self.grid.cell());
        self.scene = Some(Scene::new(gpu, keep, access, budget, visibility, cell)?);
        self.entries = 0;
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

    /// Shows or hides a file, by its place in [`About::files`]. Until the data is read again, without it, the picture
    /// stays.
    pub fn set_visible(&mut self, file: usize, shown: bool) {
        let Some(file) = self.about.as_mut().and_then(|about| about.files.get_mut(file)) else { return };
        file.shown = shown;
        let path = file.path.clone();
        self.hidden.retain(|hidden| *hidden != path);
        if !shown {
            self.hidden.push(path);
        }
        self.read_again();
    }

    /// Adds inputs, such as files that were dropped.
    pub fn add(&mut self, inputs: Vec<OsString>) {
        self.inputs.extend(inputs);
        self.read_again();
    }

    fn read_again(&mut self) {
        self.status.is_complete = false;
        self.status.failed = None;
        self.status.reduced_detail = None;
        self.status.sections_wanted = 0;
        let (inputs, hidden) = (self.inputs.clone(), self.hidden.clone());
        self.loading = load(inputs, hidden, self.options.clone(), self.wake.clone());
    }

    /// Those that are read, and those that are hidden, in the order of the inputs.
    fn files(&self, read: Vec<FileAbout>) -> Vec<FileAbout> {
        let known = self.about.iter().flat_map(|about| &about.files);
        let hidden = known.filter(|file| self.hidden.contains(&file.path)).cloned();
        let mut files: Vec<_> = read.into_iter().chain(hidden).collect();
        files.sort_by(|a, b| a.path.cmp(&b.path));
        files
    }

    /// How far things are.
    pub fn status(&self) -> Status {
        let progress = &self.loading.progress;
        let clocks = &progress.clocks;
        let points = progress.points.load(Ordering::Relaxed);
        Status {
            // A chunk is decoded right after it is read.
            points_read: points,
            points_decoded: points,
            stages: [&clocks.read, &clocks.decode, &clocks.prepare].map(|c| c.load(Ordering::Relaxed)),
            ..self.status.clone()
        }
    }
}

/// Reads the files that `inputs` name on a thread of its own.
fn load(inputs: Vec<OsString>, hidden: Vec<PathBuf>, options: Options, wake: Wake) -> Loading {
    let (send, news) = crossbeam_channel::bounded(PACKED_AHEAD);
    let progress = Arc::new(Progress::default());
    let shared = progress.clone();
    std::thread::spawn(move || {
        let telling = Telling { send, wake };
        match read(&inputs, &hidden, &options, &shared, &telling) {
            Ok(()) => telling.tell(News::Done),
            Err(error) => telling.tell(News::Failed(error.to_string())),
        };
    });
    Loading { news, progress }
}

struct Telling {
    send: Sender<News>,
    wake: Wake,
}

impl Telling {
    /// `false`: nobody listens any more.
    fn tell(&self, news: News) -> bool {
        // Woken before, too: the queue may be full.
        (self.wake)();
        let heard = self.send.send(news).is_ok();
        (self.wake)();
        heard
    }

    fn message(&self, line: impl ToString) {
        self.tell(News::Message(line.to_string()));
    }
}

fn read(
    inputs: &[OsString],
    hidden: &[PathBuf],
    options: &Options,
    progress: &Progress,
    telling: &Telling,
) -> Result<(), LoadError> {
    let mut found = inputs::expand(inputs);
    found.failed.iter().for_each(|error| telling.message(error));
    found.files.retain(|path| !hidden.contains(path));
    let mut opened = Vec::new();
    for result in sample::open_all(&found.files) {
        match result {
            Ok(file) => opened.push(file),
            Err(error) => telling.message(error),
        }
    }
    for Opened { file, crs_errors, .. } in &opened {
        let path = file.path().display();
        file.warnings.iter().for_each(|warning| telling.message(format!("{path}: {warning}")));
        crs_errors.iter().for_each(|error| telling.message(format!("{path}: {error}")));
    }
    if opened.is_empty() {
        return Err(LoadError::Nothing(if hidden.is_empty() {
            "no input could be read"
        } else {
            "all files are hidden"
        }));
    }
    let sample = sample::take(&opened, &options.placement, &sample::Budget::default());
    for note in &sample.world.notes {
        match note.file() {
            Some(file) => telling.message(format!("{}: {note}", opened[file].file.path().display())),
            None => telling.message(note),
        }
    }
    sample.problems.iter().for_each(|(_, error)| telling.message(error));
    let Some(bounds) = sample.bounds else { return Err(LoadError::Nothing("no point is left")) };
    let bounds = Bounds { min: bounds.min, max: bounds.max }.snapped();
    let cell = match options.cell {
        Some(cell) => cell,
        None => load::auto_cell(sample.cell.cell, &bounds)?,
    };
    let grid = load::grid(cell, &bounds)?;
    let left_out = |file: usize| {
        sample
            .world
            .notes
            .iter()
            .any(|n| matches!(n, PlacementNote::LeftOut { .. }) && n.file() == Some(file))
    };
    let files: Vec<_> = (0..)
        .zip(&opened)
        .filter(|(index, _)| !left_out(*index))
        .map(|(_, o)| FileAbout { path: o.file.path().to_owned(), points: o.file.points(), shown: true })
        .collect();
    let mut inputs = Vec::new();
    for (index, opened) in opened.into_iter().enumerate() {
        if let Some(placement) = sample.world.placements[index] {
            let rgb = match (sample.files[index].rgb, options.rgb_bits) {
                (_, Some(8)) => RgbDepth::Eight,
                (_, Some(_)) => RgbDepth::Sixteen,
                (chosen, None) => chosen,
            };
            inputs.push(Input { file: opened.file, placement, rgb });
        }
    }
    let about = About {
        bounds,
        color: ColorMode::auto(&sample.attributes),
        summary: sample.attributes,
        crs: sample.world.crs,
        unit: sample.world.unit,
        placement: inputs.first().map_or(Placement::AsIs, |i| i.placement),
        files,
    };
    let points = inputs.iter().map(|i| i.file.points()).sum();
    if !telling.tell(News::About(Box::new(about), grid, points)) {
        return Ok(());
    }

    let budget = Budget {
        host_bytes: options.host_bytes,
        // Pages of the pool do not fill up to the last byte.
        device_bytes: options.device_bytes - options.device_bytes / 8,
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let bins = Bins::new(grid, load::core(cell, &bounds), budget);
    read_all(&inputs, &bins, threads, progress).iter().for_each(|error| telling.message(error));
    let Budget { host_bytes: host, device_bytes: device } = budget;
    let binned = bins.finish().ok_or(LoadError::Budget { host, device })?;
    if binned.outside > 0 {
        telling.message(format!(
            "{} points are not drawn: scattered far outside of the rest, or beyond what a height or cell can be",
            binned.outside
        ));
    }
    if binned.grid.coarsen > 0 {
        let [was, now] = [cell, binned.grid.cell()].map(tidy);
        let why = format!("cells of {now} instead of {was}, to fit the memory budgets");
        telling.tell(News::Reduced(why));
    }
    if binned.sections.is_empty() {
        return Err(LoadError::Nothing("no point is left"));
    }
    let derived = binned.sections.iter().map(|(_, c)| slot_bytes(c.layout().derived_bytes())).sum();
    let host = binned.sections.iter().map(|(_, c)| c.bytes() as u64).sum();
    telling.tell(News::Sections(binned.grid, binned.sections.len() as u64, derived, host));
    let sections = Mutex::new(binned.sections.into_iter());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let next = sections.lock().unwrap_or_else(|e| e.into_inner()).next();
                    let Some((key, columns)) = next else { return };
                    if !telling.tell(News::Section(key, columns.pack())) {
                        return;
                    }
                }
            });
        }
    });
    Ok(())
}
