//! Frames along camera paths while files stream in, beside the same frames with everything there; and frames while other
//! classes are shown, beside those before and after.
//!
//! A frame is what the window's is: residency ([`Live::tick`], which never waits), section table, passes of the
//! picture; the next one begins when its picture is seen done. First it is flown with nothing there, worker threads
//! reading beside; then, with what every camera of the path wants on the device and nothing being read, twice more.
//!
//! A device whose clock follows its load is kept busy: before each frame, in all flights, it draws the same picture as
//! it then is, untimed, for `KEEP_WARM_MS`, and for `WARM_MS` before the first. So it never rests, however little a
//! frame has to draw yet, and its clock is the same in all flights. Whether that was so the two flights with everything
//! there tell: a run in which they differ too much has no ratio.

use super::failure::Stopped;
use super::report::{LayersKind, LayersRow, Stat, StreamFrames, StreamKind, StreamRow};
use super::steady::{Repeats, WARM_MS};
use super::times::ms;
use crate::attribute::{ClassMask, ColorTable, Flags};
use crate::gpu::{DeviceKind, Gpu, Order, QueueKind, SyncPoint, Timestamps};
use crate::limits::LIMITS;
use crate::load::{self, LoadError, LoadOptions, Opening};
use crate::problems::Problems;
use crate::render::benchmark_path::{FAST_CELLS, PathKind, PathStage};
use crate::render::camera::{Camera, Projection};
use crate::render::frame::{Background, FrameError, PASSES, Renderer, Shade, Traversal, View};
use crate::render::path::{Aim, CameraPath, DEFAULT_FPS, Interpolation, Keyframe, PathFault};
use crate::render::sight::sight;
use crate::resident::cut::Sight;
use crate::resident::live::Live;
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::switch::Switched;
use crate::resident::table::Table;
use crate::resident::visibility::Visibility;
use crate::source::placement::Fit;
use anyhow::Context;
use glam::DVec2;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The paths that move, in the order of reports.
pub const PATHS: [PathKind; 6] =
    [PathKind::Slow, PathKind::Fast, PathKind::Descent, PathKind::Grazing, PathKind::Random, PathKind::Turn];
/// How much longer the slow frames (p95) may be while sections stream in.
pub const MOST_RATIO: f64 = 1.5;
/// Untimed work before each frame but the first, where the device's clock follows its load, ms by the host's clock: some
/// frames' worth, so that the timed one finds the device as busy as the last one did.
const KEEP_WARM_MS: f64 = 10.0;
/// Frames before and after a change of the classes that are shown.
const RESTING_FRAMES: usize = 10;
/// What is shown in turn with everything: bare earth.
const BARE_EARTH: [u8; 5] = [2, 9, 10, 11, 41];
/// Crossings of the data that lie side by side on the fast path.
const LANES: u32 = 5;

/// What is measured, and with what.
pub struct StreamOptions<'a> {
    /// Pixels.
    pub size: [u32; 2],
    /// Frames of a path.
    pub frames: u32,
    /// Times that each path is flown both ways, in turn.
    pub runs: u32,
    /// Light.
    pub shade: Shade,
    /// Device memory for sections, bytes.
    pub device_bytes: u64,
    /// Host memory for sections, bytes.
    pub host_bytes: u64,
    /// How files are opened.
    pub load: LoadOptions,
    /// No progress bar.
    pub quiet: bool,
    /// Set: ends before the next frame.
    pub stop: &'a AtomicBool,
}

/// Files, and what draws them. One scene for all runs, emptied before each: drivers compile on first use.
pub struct StreamCase<'a> {
    name: String,
    files: Vec<PathBuf>,
    options: &'a StreamOptions<'a>,
    about: load::About,
    floor: f64,
    points: u64,
    cell: f64,
    colors: ColorTable,
    scene: Scene,
    renderer: Renderer,
    clock: Option<Timestamps>,
    /// The device's clock follows its load.
    clock_wanders: bool,
    errors: BTreeSet<String>,
}

/// One frame.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    frame_ms: f64,
    tick_ms: f64,
    table_ms: f64,
    trace_ms: f64,
    update_ms: f64,
    upload_bytes: u64,
    wanted: usize,
    ready: usize,
    /// Places that show anything.
    shown: usize,
    coarser: f64,
}

impl Frame {
    /// Nothing was missing or had to be coarser.
    fn is_whole(&self) -> bool {
        self.ready == self.wanted && self.coarser <= 1.0
    }
}

/// One flight.
#[derive(Default)]
struct StreamFlight {
    frames: Vec<Frame>,
    /// Times that an upload waited for the device.
    waits: u64,
    bytes_read: u64,
}

/// What frames come to; at least one.
fn frames_of(flights: &[StreamFlight], has_clock: bool) -> StreamFrames {
    let stat = |of: &dyn Fn(&Frame) -> f64| {
        let all = flights.iter().flat_map(|flight| &flight.frames).map(of);
        Stat::of(all.collect()).expect("a path has a frame")
    };
    StreamFrames {
        frame_ms: stat(&|f| f.frame_ms),
        tick_ms: stat(&|f| f.tick_ms),
        table_ms: stat(&|f| f.table_ms),
        trace_ms: has_clock.then(|| stat(&|f| f.trace_ms)),
        update_ms: has_clock.then(|| stat(&|f| f.update_ms)),
        upload_bytes: stat(&|f| f.upload_bytes as f64),
        wanted: stat(&|f| f.wanted as f64),
        ready: stat(&|f| f.ready as f64),
    }
}

/// Slow frames of one flight.
fn p95(flight: &StreamFlight) -> f64 {
    let all = flight.frames.iter().map(|frame| frame.frame_ms).collect();
    Stat::of(all).expect("a path has a frame").p95
}

/// Of the slow frames of one run, streaming over resident; `None` where those of the two resident flights differ by more
/// than [`MOST_SPREAD`](super::steady::MOST_SPREAD). And by how much they differ.
fn ratio(streaming: &StreamFlight, resident: &[StreamFlight; 2]) -> (Option<f64>, f64) {
    let resident = Repeats { ms: resident.iter().map(p95).collect(), is_cold: false };
    let ratio = resident.median().filter(|_| resident.is_steady()).map(|resident| p95(streaming) / resident);
    (ratio, resident.spread().unwrap_or(f64::INFINITY))
}

/// East and back over the data, [`FAST_CELLS`] finest cells in each of `frames` frames, a little farther north at
/// each turn.
fn back_and_forth(stage: &PathStage, size: DVec2, frames: u32) -> Result<CameraPath, PathFault> {
    let step = f64::from(FAST_CELLS) * stage.cell;
    let across = (size.x / step).ceil().max(1.0) as u32;
    let lane = size.y / f64::from(LANES);
    let key = |n: u32| {
        let (crossing, at) = (n / across, n % across);
        let east = f64::from(at) * step;
        let back = crossing % 2 == 1;
        let x = if back { size.x - east } else { east };
        let y = lane * (f64::from(crossing % LANES) + 0.5);
        let place = stage.center - 0.5 * size + DVec2::new(x, y);
        let aim = Aim::Angles([if back { 270.0 } else { 90.0 }, 28.0]);
        let eye = place.extend(stage.top + 0.1 * stage.side);
        Keyframe { time: f64::from(n) / DEFAULT_FPS, eye, aim }
    };
    // The last one is where the next frame would be.
    let keyframes = (0..=frames).map(key).collect();
    let path = CameraPath::new(keyframes, Projection::default(), DEFAULT_FPS, Interpolation::Step)?;
    Ok(path.named(PathKind::Fast.name()))
}

impl<'a> StreamCase<'a> {
    /// Looks at `files`, called `name` in reports.
    pub fn open(
        gpu: &Gpu,
        name: impl Into<String>,
        files: Vec<PathBuf>,
        options: &'a StreamOptions<'a>,
        problems: &mut Problems,
    ) -> anyhow::Result<StreamCase<'a>> {
        let Opening { inputs, grid, about, .. } = load::open(&files, &options.load, problems)?;
        let points = inputs.iter().map(|input| input.input.file.points()).sum();
        let bridge = if options.shade == Shade::Lit { 4 } else { 0 };
        let seen = Visibility {
            classes: ClassMask::default(),
            hidden_flags: Flags::WITHHELD,
            bridge,
            near_ties: bridge > 0,
        };
        // Derived parts are less than half of what sections take.
        let access = Access::best(gpu, options.device_bytes / 2);
        let cell = grid.cell();
        let mut scene = Scene::new(gpu, |order: Order| order, access, options.device_bytes, seen, grid)?;
        scene.measure();
        let middle = about.bounds.center().z;
        let anchor = grid.height(middle).context("heights are beyond what can be drawn")?;
        Ok(StreamCase {
            name: name.into(),
            files,
            options,
            floor: about.floor(cell),
            points,
            cell,
            colors: ColorTable::new(about.color, &about.summary, &grid, None, None)?,
            about,
            renderer: Renderer::new(&scene, grid, anchor)?,
            clock: Timestamps::new(gpu, "frame", QueueKind::Compute, PASSES)?,
            clock_wanders: gpu.info().kind != DeviceKind::Cpu,
            errors: BTreeSet::new(),
            scene,
        })
    }

    /// Points in all files.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Coordinates of the world's system to those that are drawn.
    pub fn base(&self) -> &Fit {
        &self.about.base
    }

    /// A path of the benchmark over the data.
    pub fn path(&self, kind: PathKind, seed: u64) -> Result<CameraPath, PathFault> {
        let bounds = self.about.bounds;
        let size = (bounds.max - bounds.min).truncate();
        let stage = PathStage {
            center: bounds.center().truncate(),
            ground: self.about.summary.height.percentile(2.0),
            top: bounds.max.z,
            cell: self.cell,
            side: size.min_element(),
        };
        match kind {
            // The one of the other parts leaves the data behind in its first second.
            PathKind::Fast => back_and_forth(&stage, size, self.options.frames),
            kind => kind.path(&stage, seed),
        }
    }

    fn sight(&self, camera: &Camera) -> Result<Sight, FrameError> {
        let pivot = self.about.bounds.min.z;
        Ok(sight(camera, self.options.size, [1.0, pivot], self.floor, 1.0)?)
    }

    /// Files as if they had never been looked at, and nothing on the device.
    fn start(&mut self) -> anyhow::Result<Live> {
        let all: Vec<_> = self.scene.resident().collect();
        self.scene.evict(&all)?;
        self.scene.settle()?;
        self.scene.take_times()?;
        // What is wrong with the files was said when they were opened first.
        let Opening { inputs, grid, core, .. } =
            load::open(&self.files, &self.options.load, &mut Problems::default())?;
        let (surface, host_bytes) = (self.options.load.surface, self.options.host_bytes);
        Ok(Live::new(inputs, surface, grid, core, host_bytes, load::threads(), || ()))
    }

    /// Draws what is there, untimed, for so long where the device's clock follows its load.
    fn keep_warm(&mut self, live: &Live, camera: &Camera, for_ms: f64) -> anyhow::Result<()> {
        let begin = Instant::now();
        while self.clock_wanders && ms(begin) < for_ms {
            let table = self.renderer.table_of_live(&self.scene, live);
            self.draw(camera, &table, false)?;
        }
        Ok(())
    }

    /// Draws `camera` and waits for the picture.
    fn draw(&mut self, camera: &Camera, table: &Arc<Table>, is_timed: bool) -> anyhow::Result<SyncPoint> {
        let view = View {
            camera,
            size: self.options.size,
            samples: 1,
            z_scale: 1.0,
            pivot: self.about.bounds.min.z,
            bounds: self.about.bounds,
            slab: Some(self.about.slab(self.cell)),
            colors: &self.colors,
            shade: self.options.shade,
            background: Background::Sky,
            traversal: Traversal::Fast,
            window: None,
        };
        let clock = self.clock.as_mut().filter(|_| is_timed);
        let point = self.renderer.submit_frame(&mut self.scene, &view, table, clock)?;
        self.scene.order.wait(point)?;
        Ok(point)
    }

    /// One frame, from the camera to its picture.
    fn frame(&mut self, live: &mut Live, camera: &Camera) -> anyhow::Result<Frame> {
        if self.options.stop.load(Ordering::Relaxed) {
            return Err(Stopped.into());
        }
        let before = self.scene.counters().section_bytes;
        let begin = Instant::now();
        let sight = self.sight(camera)?;
        live.tick(&mut self.scene, &sight, LIMITS.frame_bytes)?;
        self.scene.flush()?;
        let tick_ms = ms(begin);
        let table = self.renderer.table_of_live(&self.scene, live);
        let table_ms = ms(begin) - tick_ms;
        let point = self.draw(camera, &table, true)?;
        let frame_ms = ms(begin);
        // The rest is off the clock. Nothing becomes live before the next tick.
        let status = live.status(&self.scene);
        let stages = match &mut self.clock {
            Some(clock) => clock.resolve(&mut self.scene.order, point)?,
            None => Vec::new(),
        };
        let sum = |times: &mut dyn Iterator<Item = f64>| times.map(|ns| ns / 1e6).sum();
        Ok(Frame {
            frame_ms,
            tick_ms,
            table_ms,
            trace_ms: sum(&mut stages.into_iter().map(|(_, ns)| ns)),
            update_ms: sum(&mut self.scene.take_times()?.into_iter().map(|(_, ns)| ns)),
            upload_bytes: self.scene.counters().section_bytes - before,
            wanted: status.wanted,
            ready: status.ready,
            shown: live.shown().len(),
            coarser: status.coarser,
        })
    }

    /// A frame for each of `cameras`, one after the other.
    fn flight(&mut self, live: &mut Live, cameras: &[Camera]) -> anyhow::Result<StreamFlight> {
        let before = self.scene.counters().waits;
        let bar =
            load::bar(cameras.len() as u64, self.options.quiet, "{wide_bar} frame {pos} of {len} {eta}");
        let frames = cameras.iter().enumerate().map(|(at, camera)| {
            bar.inc(1);
            self.keep_warm(live, camera, if at == 0 { WARM_MS } else { KEEP_WARM_MS })?;
            self.frame(live, camera)
        });
        let frames = frames.collect::<anyhow::Result<Vec<_>>>();
        bar.finish_and_clear();
        let frames = frames?;
        self.errors.extend(live.take_errors());
        let waits = self.scene.counters().waits - before;
        Ok(StreamFlight { frames, waits, bytes_read: live.status(&self.scene).progress.bytes_read })
    }

    /// Fetches what `camera` wants.
    fn complete(&mut self, live: &mut Live, camera: &Camera) -> anyhow::Result<()> {
        let sight = self.sight(camera)?;
        loop {
            if self.options.stop.load(Ordering::Relaxed) {
                return Err(Stopped.into());
            }
            let tick = live.tick(&mut self.scene, &sight, LIMITS.fill_bytes)?;
            self.errors.extend(live.take_errors());
            if tick.complete {
                return Ok(());
            }
            if let Some(why) = live.failed() {
                anyhow::bail!(why);
            }
            if tick.stuck {
                let (host, device) = (self.options.host_bytes, self.options.device_bytes);
                return Err(LoadError::Budget { host, device }.into());
            }
            self.scene.flush()?;
            live.wait(Duration::from_millis(2));
        }
    }

    /// What could not be read in any of the flights, each once.
    pub fn take_errors(&mut self) -> BTreeSet<String> {
        std::mem::take(&mut self.errors)
    }

    /// Draws `camera` with all that it wants, so that every pass is compiled.
    pub fn warm_up(&mut self, camera: &Camera) -> anyhow::Result<()> {
        let mut live = self.start()?;
        self.frame(&mut live, camera)?;
        self.complete(&mut live, camera)?;
        self.frame(&mut live, camera)?;
        Ok(())
    }

    /// The cameras of the frames of `path` that are drawn.
    pub fn cameras(&self, path: &CameraPath) -> anyhow::Result<Vec<Camera>> {
        let camera = |frame| path.camera(frame).with_context(|| format!("frame {frame} of the path"));
        path.spread(self.options.frames).map(camera).collect()
    }

    /// What is drawn with nothing there, and twice with everything there.
    fn run(
        &mut self,
        cameras: &[Camera],
        at: &str,
        progress: &mut dyn FnMut(&str),
    ) -> anyhow::Result<(StreamFlight, [StreamFlight; 2])> {
        progress(&format!("{at}: streaming"));
        let mut live = self.start()?;
        let streaming = self.flight(&mut live, cameras)?;
        progress(&format!("{at}: fetching the rest"));
        live.restore_detail();
        for camera in cameras {
            self.complete(&mut live, camera)?;
        }
        live.pause(true);
        self.scene.settle()?;
        progress(&format!("{at}: everything there"));
        // What the threads had begun is over by then.
        self.frame(&mut live, &cameras[0])?;
        let resident = self.flight(&mut live, cameras)?;
        Ok((streaming, [resident, self.flight(&mut live, cameras)?]))
    }

    /// Flies `path` both ways, run after run; fewer runs, but one, once asked to stop. `progress` is told what comes next.
    pub fn fly(&mut self, path: &CameraPath, progress: &mut dyn FnMut(&str)) -> anyhow::Result<StreamRow> {
        let cameras = self.cameras(path)?;
        let options = self.options;
        let name = path.name().unwrap_or("path");
        let (mut streaming, mut resident, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        let mut spreads = Vec::new();
        for run in 1..=options.runs {
            let at = format!("{}: {name}, run {run} of {}", self.name, options.runs);
            match self.run(&cameras, &at, progress) {
                Ok((flight, twice)) => {
                    let (ratio, spread) = ratio(&flight, &twice);
                    ratios.push(ratio);
                    spreads.push(spread);
                    streaming.push(flight);
                    resident.extend(twice);
                }
                Err(error) if error.is::<Stopped>() && !streaming.is_empty() => break,
                Err(error) => return Err(error),
            }
        }
        let all = |flights: &[StreamFlight], of: &dyn Fn(&Frame) -> bool| {
            flights.iter().flat_map(|flight| &flight.frames).filter(|frame| of(frame)).count() as u64
        };
        let has_clock = self.clock.is_some();
        Ok(StreamRow {
            kind: StreamKind::Stream,
            data: self.name.clone(),
            points: self.points,
            cell: self.cell,
            path: name.to_owned(),
            frames: cameras.len() as u32,
            runs: streaming.len() as u32,
            size: options.size,
            threads: load::threads() as u32,
            device_bytes: options.device_bytes,
            host_bytes: options.host_bytes,
            ratio_p95: Stat::of(ratios.iter().flatten().copied().collect()).map(|ratios| ratios.median),
            ratios,
            spreads,
            waits: streaming.iter().chain(&resident).map(|flight| flight.waits).sum(),
            bytes_read: streaming.iter().map(|flight| flight.bytes_read).sum(),
            empty_frames: all(&streaming, &|frame| frame.shown == 0),
            coarser_frames: all(&streaming, &|frame| frame.coarser > 1.0),
            not_resident: all(&resident, &|frame| !frame.is_whole()),
            streaming: frames_of(&streaming, has_clock),
            resident: frames_of(&resident, has_clock),
        })
    }
}

/// Frames around one change of the classes that are shown, ms.
struct Change {
    before: Vec<f64>,
    during: Vec<f64>,
    after: Vec<f64>,
}

impl Change {
    /// Each frame meanwhile, of the slower of the usual ones before and after: other classes may be dearer to draw.
    fn ratios(&self) -> Vec<f64> {
        let usual =
            [&self.before, &self.after].map(|frames| Stat::of(frames.clone()).map(|stat| stat.median));
        let usual = usual.into_iter().flatten().fold(0.0, f64::max);
        self.during.iter().map(|ms| ms / usual).collect()
    }
}

impl StreamCase<'_> {
    /// What it takes to show other classes with everything there, from the middle of `path`: bare earth and then all of them,
    /// run after run; fewer runs, but one, once asked to stop.
    pub fn switch(&mut self, path: &CameraPath, progress: &mut dyn FnMut(&str)) -> anyhow::Result<LayersRow> {
        let cameras = self.cameras(path)?;
        let camera = cameras[cameras.len() / 2];
        progress(&format!("{}: other classes", self.name));
        let mut live = self.start()?;
        self.complete(&mut live, &camera)?;
        live.pause(true);
        self.scene.settle()?;
        self.keep_warm(&live, &camera, WARM_MS)?;
        let usual = self.scene.visibility();
        let bare = Visibility { classes: ClassMask::only(&BARE_EARTH), ..usual };
        let (mut changes, mut switched) = (Vec::new(), Vec::new());
        let bytes = self.scene.counters().section_bytes;
        for run in 0..self.options.runs {
            for shown in [bare, usual] {
                match self.change(&mut live, &camera, shown) {
                    Ok((change, how)) => {
                        changes.push(change);
                        switched.push(how);
                    }
                    Err(error) if error.is::<Stopped>() && run > 0 => break,
                    Err(error) => return Err(error),
                }
            }
        }
        let stat = |samples: Vec<f64>| Stat::of(samples).context("a change takes a frame");
        let of = |frames: &dyn Fn(&Change) -> Vec<f64>| stat(changes.iter().flat_map(frames).collect());
        let each = |of: fn(&Switched) -> f64| stat(switched.iter().map(of).collect());
        Ok(LayersRow {
            kind: LayersKind::Layers,
            data: self.name.clone(),
            size: self.options.size,
            took_ms: each(|how| how.took.as_secs_f64() * 1e3)?,
            in_sight_ms: each(|how| how.in_sight.as_secs_f64() * 1e3)?,
            sections: each(|how| how.sections as f64)?,
            parts: each(|how| how.parts as f64)?,
            resting_ms: of(&|change| [&change.before[..], &change.after].concat())?,
            frame_ms: of(&|change| change.during.clone())?,
            ratios: of(&Change::ratios)?,
            section_bytes: self.scene.counters().section_bytes - bytes,
        })
    }

    /// Frames of `camera` while what is shown changes, and as many as are usual before and after.
    fn change(
        &mut self,
        live: &mut Live,
        camera: &Camera,
        shown: Visibility,
    ) -> anyhow::Result<(Change, Switched)> {
        let [mut before, mut during, mut after] = [const { Vec::new() }; 3];
        let frame = |case: &mut Self, live: &mut Live, frames: &mut Vec<f64>| {
            case.keep_warm(live, camera, KEEP_WARM_MS)?;
            frames.push(case.frame(live, camera)?.frame_ms);
            anyhow::Ok(())
        };
        for _ in 0..RESTING_FRAMES {
            frame(self, live, &mut before)?;
        }
        self.scene.set_frame_ms(Stat::of(before.clone()).context("there are some")?.median);
        self.scene.switch_visibility(shown)?;
        let switched = loop {
            frame(self, live, &mut during)?;
            if let Some(switched) = self.scene.take_switched() {
                break switched;
            }
        };
        for _ in 0..RESTING_FRAMES {
            frame(self, live, &mut after)?;
        }
        Ok((Change { before, during, after }, switched))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_meanwhile_are_compared_with_the_slower_ones_beside_them() {
        let change =
            Change { before: vec![9.0, 10.0, 12.0], during: vec![15.0, 10.0], after: vec![5.0, 8.0] };
        assert_eq!(change.ratios(), [1.5, 1.0]);
        assert_eq!(Change { after: vec![20.0], ..change }.ratios(), [0.75, 0.5]);
    }

    #[test]
    fn the_fast_path_stays_over_the_data() {
        let center = DVec2::new(512_000.0, 5_403_000.0);
        let stage = PathStage { center, ground: 200.0, top: 250.0, cell: 0.25, side: 1000.0 };
        let size = DVec2::new(1000.0, 1500.0);
        let path = back_and_forth(&stage, size, 120).unwrap();
        assert_eq!(path.frames(), 120);
        let eyes: Vec<_> = (0..120).map(|frame| path.camera(frame).unwrap().eye()).collect();
        let away = |eye: &glam::DVec3| (eye.truncate() - center).abs();
        assert!(eyes.iter().all(|eye| away(eye).cmple(0.5 * size).all()));
        let steps: Vec<_> = eyes.windows(2).map(|pair| pair[1].x - pair[0].x).collect();
        assert!(steps.contains(&64.0) && steps.contains(&-64.0));
        assert_eq!(eyes[0].y + 300.0, eyes[16].y, "a lane farther north");
    }

    #[test]
    fn flights_add_up() {
        let frame =
            |ms: f64, ready| Frame { frame_ms: ms, ready, wanted: 4, coarser: 1.0, ..Frame::default() };
        let a = StreamFlight {
            frames: (1..=21).map(|n| frame(f64::from(n), 4)).collect(),
            ..StreamFlight::default()
        };
        assert_eq!(p95(&a), 20.0);
        let flight = |ms| StreamFlight { frames: vec![frame(ms, 4)], ..StreamFlight::default() };
        assert_eq!(ratio(&a, &[flight(10.0), flight(10.0)]), (Some(2.0), 0.0));
        assert_eq!(ratio(&a, &[flight(10.0), flight(12.5)]), (None, 0.25));
        let b = StreamFlight { frames: vec![frame(50.0, 1)], ..StreamFlight::default() };
        let both = frames_of(&[a, b], false);
        assert_eq!((both.frame_ms.samples.len(), both.frame_ms.max), (22, 50.0));
        assert_eq!(both.trace_ms, None);
        let [mean, least] = both.ready_share();
        assert!((mean - (21.0 + 0.25) / 22.0).abs() < 1e-12);
        assert_eq!(least, 0.25);
        assert!(frame(1.0, 4).is_whole() && !frame(1.0, 3).is_whole());
        // What comes for later takes nothing away.
        assert!(Frame { upload_bytes: 1, ..frame(1.0, 4) }.is_whole());
        assert!(!Frame { coarser: 1.5, ..frame(1.0, 4) }.is_whole());
    }
}
