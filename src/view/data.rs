//! Where the window's data comes from: everything that it knows of files and sections goes through here.

use super::fates::{self, Refused};
use super::watch::{self, News, Stamp, Watch};
use crate::attribute::{AttributeSummary, ColorMode, Flags, KindCounts};
use crate::coords::{Bounds, Grid, HEIGHT_STEP, Height, Hull, Outline};
use crate::gpu::{Gpu, Order};
use crate::ingest::bins::{Budget, Core};
use crate::ingest::builds::{Made, cells_of};
use crate::ingest::input::OpenInput;
use crate::load::{self, Fate, Fates, LoadError, LoadOptions, Opening};
use crate::problems::Problems;
use crate::render::camera::Camera;
use crate::render::frame::Renderer;
use crate::render::sight::sight;
use crate::resident::live::{self, Live};
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::table::Table;
use crate::resident::visibility::Visibility;
use crate::resident::visibility::why_hidden;
use crate::sample::{self, Asked};
use crate::section::Surface;
use crate::source::inputs;
use crate::source::learned::Cache;
use crate::source::length::Length;
use crate::source::placement::{PlacementOptions, Treatment};
use crate::source::{Reading, Selection};
use crate::text::harmless;
use crossbeam_channel::Receiver;
use std::collections::{HashMap, HashSet, VecDeque};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What there is before there is data.
const NO_GRID: Grid = Grid { base_cell: 1.0, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };
/// Files that have changed and are opened again at a time: each time everything that they touch is looked at.
const MOST_AGAIN: usize = 256;
/// Messages that are remembered, the newest.
const MOST_MESSAGES: usize = 100;
/// How often progress is looked at, at least.
const COUNT_EVERY: Duration = Duration::from_millis(100);

/// What the user decides about reading.
#[derive(Clone, Debug)]
pub struct ReadOptions {
    /// What the points of a column stand for.
    pub surface: Surface,
    /// Side of a finest cell; `None`: chosen from the data.
    pub cell: Option<Length>,
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
    /// Points that take part at first.
    pub selection: Selection,
    /// What colours show at first; `None`: chosen from the data.
    pub color: Option<ColorMode>,
    /// Where it is kept what was learned of files.
    pub cache: Option<Cache>,
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
    /// It is not where it was.
    pub is_gone: bool,
    /// The coordinate system that it names.
    pub system: Option<String>,
    /// It was taken from the list, and is never shown again.
    pub is_removed: bool,
    /// What was done with its coordinates.
    pub treatment: Treatment,
    /// What is wrong with it, of which the rest is shown.
    pub damage: Option<String>,
    /// Some of its points have colours.
    pub has_rgb: bool,
    /// Its point format.
    format: u8,
    /// It lies so far from those that it was opened with that these are framed without it.
    pub is_far: bool,
    /// Where its points lie, strays aside.
    bounds: Option<Bounds>,
    /// What is framed of it, and of what is shown when others are than at first.
    hulls: [Option<Hull>; 2],
    /// Its number in what is live.
    source: usize,
    /// What it looked like when it was opened.
    stamp: Stamp,
}

/// What headers and the opening sample tell.
#[derive(Clone)]
pub struct DataAbout {
    /// Of the whole.
    pub whole: load::About,
    /// In the order of the inputs.
    pub files: Vec<FileAbout>,
    /// How often [`load::About::summary`] has become that of another selection.
    pub summaries: u32,
}

impl FileAbout {
    /// Whether its points are to be seen.
    pub fn is_seen(&self) -> bool {
        self.shown && !self.is_gone && !self.is_removed
    }

    /// What is framed of it; `is_first`: the points are those that were asked for at first.
    pub fn hull(&self, is_first: bool) -> Option<&Hull> {
        self.hulls[usize::from(!is_first)].as_ref()
    }
}

impl DataAbout {
    /// Whether any file has colours of its own.
    pub fn has_rgb(&self) -> bool {
        self.files.iter().any(|file| file.has_rgb && !file.is_removed)
    }

    /// What is known of the whole for cameras and lit images; `is_first`: the points that are shown are those that were asked
    /// for at first.
    pub fn outline(&self, is_first: bool) -> &Outline {
        self.whole.outline_of_all.as_ref().filter(|_| !is_first).unwrap_or(&self.whole.outline)
    }

    /// What is framed of what is shown: of all files, or of those that are not hidden; `is_first`: the points are those that
    /// were asked for at first.
    pub fn shown_hull(&self, is_first: bool) -> Hull {
        let whole = || self.outline(is_first).hull.clone();
        if self.files.iter().all(FileAbout::is_seen) {
            return whole();
        }
        let union = |with_far: bool| {
            let seen = self.files.iter().filter(|file| file.is_seen() && (with_far || !file.is_far));
            Hull::union(seen.filter_map(|file| file.hull(is_first)))
        };
        union(false).or_else(|| union(true)).unwrap_or_else(whole)
    }

    /// Where the points of the files lie that are not hidden; far ones where there are no others.
    fn shown_bounds(&self) -> Option<Bounds> {
        let union = |with_far: bool| {
            let seen = self.files.iter().filter(|file| file.is_seen() && (with_far || !file.is_far));
            seen.filter_map(|file| file.bounds).reduce(Bounds::union)
        };
        union(false).or_else(|| union(true))
    }
}

/// An input as it was given, and the files that it came to.
#[derive(Clone, Debug)]
struct Given {
    word: OsString,
    files: Vec<PathBuf>,
}

impl std::ops::Deref for DataAbout {
    type Target = load::About;

    fn deref(&self) -> &load::About {
        &self.whole
    }
}

/// What a frame finds changed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tick {
    /// The image is not what it was.
    pub changed: bool,
    /// The scene, its grid or its anchor is another one: what was made for the old one is of no use.
    pub is_new_scene: bool,
    /// More is on its way to the device: tick again soon.
    pub is_busy: bool,
}

/// How far things are.
#[derive(Clone, Debug, Default)]
pub struct DataStatus {
    /// Points of all files that are shown.
    pub points: u64,
    /// Those of them that were read at least once.
    pub points_read: u64,
    /// Of what is needed now, how much is read, 0 to 1.
    pub share_read: f64,
    /// What those files hold, by class and flags: exact once all of it was read.
    pub kinds: KindCounts,
    /// Where their points lie, files that are far from the others aside.
    pub extent: Option<Bounds>,
    /// Files that are shown, and all.
    pub files: [u64; 2],
    /// More are being opened.
    pub is_opening: bool,
    /// Sections that are to be drawn; 0 while that is not known.
    pub sections_wanted: u64,
    /// Those of them that are on the device.
    pub sections_resident: u64,
    /// Host memory for sections, bytes, and its budget.
    pub host_bytes: [u64; 2],
    /// Device memory for sections, bytes, and its budget.
    pub device_bytes: [u64; 2],
    /// Why the image is coarser than was asked for.
    pub reduced_detail: Option<String>,
    /// What went wrong, each once, and what was decided that is not obvious.
    pub messages: Vec<String>,
    /// Bytes of chunks that were read.
    pub bytes_read: u64,
    /// Times that a frame waited for the device to take a section.
    pub frames_waited: u64,
    /// Whether everything that is to be read has been.
    pub is_complete: bool,
    /// Sections that are in sight, or others, still show the classes that were shown before.
    pub is_switching: bool,
    /// Why there is nothing to see.
    pub failed: Option<String>,
    /// Why nothing is seen of what there is: every point is hidden, and what shows them.
    pub hidden: Option<String>,
    /// Flags whose points are hidden.
    pub hidden_flags: Flags,
    /// Why nothing is seen of what there is: none of the points takes part.
    pub unselected: Option<String>,
    /// Not all points take part: [`DataStatus::kinds`] are those that do.
    pub is_selection: bool,
    /// What is read again, where other points take part than before or something else of them is stored.
    pub rereading: Option<String>,
}

/// What is to become of files that are being opened.
#[derive(Clone, Debug)]
enum Purpose {
    /// They are all that is shown.
    First,
    /// These inputs come to what is there.
    More(Vec<OsString>),
    /// Those that have these places in [`DataAbout::files`] have changed.
    Again(Vec<usize>),
    /// What colours are chosen by is to become that of the points that take part now.
    Ranges,
}

impl Purpose {
    /// What they are is known: it was said when they came.
    fn is_of_known(&self) -> bool {
        matches!(self, Purpose::Again(_) | Purpose::Ranges)
    }
}

/// What came of opening files, and what is to be said of it.
struct Opened {
    opening: Result<Opening, LoadError>,
    problems: Problems,
    /// What the inputs came to.
    given: Vec<Given>,
    fates: Fates,
    /// Inputs that are no files.
    refused: Vec<Refused>,
}

/// Files that are being opened.
struct OpeningFiles {
    opening: Receiver<Opened>,
    purpose: Purpose,
    /// As files of the world that is shown.
    is_of_world: bool,
}

/// Wakes the window when there is news.
type Wake = Arc<dyn Fn() + Send + Sync>;

/// The data of a window.
pub struct Data {
    options: ReadOptions,
    wake: Wake,
    given: Vec<Given>,
    /// Files that are to be hidden once they are there, by their canonical paths.
    hidden: HashSet<PathBuf>,
    /// Files that are not shown, and why.
    refused: Vec<Refused>,
    /// What the user is to be told.
    notices: Vec<String>,
    /// The scene is another one since the last tick.
    is_reset: bool,
    /// How many were opened first.
    first_files: usize,
    pending: Vec<OpeningFiles>,
    about: Option<DataAbout>,
    live: Option<Live>,
    watch: Option<Watch>,
    /// Files that have changed and are to be opened again.
    again: VecDeque<usize>,
    scene: Option<Scene>,
    grid: Grid,
    anchor: Height,
    now: live::Status,
    /// What points there are, and the number of that knowledge.
    kinds: KindCounts,
    kinds_version: Option<[u64; 2]>,
    /// When they came.
    kinds_asked: Option<Instant>,
    /// When that was asked for.
    counted: Instant,
    is_count_due: bool,
    is_complete: bool,
    /// Which points take part, and what their records hold.
    reading: Reading,
    /// What is read again since the reading is another one, in words.
    rereading: Option<String>,
    /// Some records that are shown may hold something else than others.
    is_mixed: bool,
    messages: VecDeque<String>,
    problems: Problems,
    failed: Option<String>,
    is_held: bool,
}

impl Data {
    /// Opens `inputs`; returns at once. `wake` is called, from other threads, when there is something for
    /// [`Data::tick`].
    pub fn open(
        gpu: &Gpu,
        inputs: Vec<OsString>,
        hidden: &[PathBuf],
        options: ReadOptions,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> anyhow::Result<Data> {
        let budget = gpu.bytes_for_sections(options.device_bytes);
        let options = ReadOptions { device_bytes: budget, ..options };
        let scene = Scene::new(
            gpu,
            |order| order,
            access(gpu, options.surface, budget),
            budget,
            options.visibility,
            NO_GRID,
        )?;
        let mut data = Data {
            options,
            wake: Arc::new(wake),
            given: Vec::new(),
            hidden: HashSet::new(),
            refused: Vec::new(),
            notices: Vec::new(),
            is_reset: false,
            first_files: 0,
            pending: Vec::new(),
            about: None,
            live: None,
            watch: None,
            again: VecDeque::new(),
            scene: Some(scene),
            grid: NO_GRID,
            anchor: Height(0),
            now: live::Status::default(),
            kinds: KindCounts::default(),
            kinds_version: None,
            kinds_asked: None,
            counted: Instant::now(),
            is_count_due: true,
            is_complete: false,
            reading: Reading::default(),
            rereading: None,
            is_mixed: false,
            messages: VecDeque::new(),
            problems: Problems::default(),
            failed: None,
            is_held: false,
        };
        data.open_first(inputs, hidden);
        Ok(data)
    }

    fn open_first(&mut self, inputs: Vec<OsString>, hidden: &[PathBuf]) {
        self.hidden = hidden.iter().filter_map(|path| path.canonicalize().ok()).collect();
        self.add(inputs);
    }

    /// Forgets everything that is open, and opens `inputs` in its place, those of `hidden` unseen.
    pub fn reopen(
        &mut self,
        gpu: &Gpu,
        inputs: Vec<OsString>,
        hidden: &[PathBuf],
        options: ReadOptions,
    ) -> anyhow::Result<()> {
        // What is being opened for the old world tells nobody.
        self.pending.clear();
        self.again.clear();
        self.messages.clear();
        self.given.clear();
        self.refused.clear();
        (self.about, self.live, self.watch, self.failed) = (None, None, None, None);
        self.now = live::Status::default();
        (self.kinds, self.kinds_version) = (KindCounts::default(), None);
        (self.reading, self.rereading, self.is_mixed) = (Reading::default(), None, false);
        self.options = ReadOptions { device_bytes: self.options.device_bytes, ..options };
        self.new_scene(gpu, NO_GRID, self.options.visibility)?;
        self.is_reset = true;
        self.open_first(inputs, hidden);
        Ok(())
    }

    /// Another scene, on `grid`.
    fn new_scene(&mut self, gpu: &Gpu, grid: Grid, visibility: Visibility) -> anyhow::Result<()> {
        self.grid = grid;
        // What is under way on the device goes on under the same order.
        let order = self.scene.take().expect("there is always one").order;
        let keep = |fresh: Order| {
            drop(fresh);
            order
        };
        let budget = self.options.device_bytes;
        let mut scene =
            Scene::new(gpu, keep, access(gpu, self.options.surface, budget), budget, visibility, grid)?;
        scene.defer_uploads(self.is_held);
        self.scene = Some(scene);
        Ok(())
    }

    /// While held, files are read, but nothing comes to the device: see [`Scene::defer_uploads`].
    pub fn hold_uploads(&mut self, is_held: bool) {
        self.is_held = is_held;
        self.scene_mut().defer_uploads(is_held);
    }

    /// Takes what has arrived, once a frame, and uploads about `upload_bytes` of it; the camera, the image's size and the
    /// vertical exaggeration say what is wanted.
    pub fn tick(
        &mut self,
        gpu: &Gpu,
        camera: &Camera,
        size: [u32; 2],
        z_scale: f64,
        lit: bool,
        upload_bytes: u64,
    ) -> anyhow::Result<Tick> {
        let is_reset = std::mem::take(&mut self.is_reset);
        let mut tick = Tick { changed: is_reset, is_new_scene: is_reset, is_busy: false };
        let news: Vec<_> = self.watch.iter().flat_map(Watch::news).collect();
        self.note_changes(news);
        self.open_again();
        let mut opened = Vec::new();
        // In the order in which they were asked for.
        while let Some(pending) = self.pending.first() {
            let come = match pending.opening.try_recv() {
                Err(error) if error.is_empty() => break,
                Err(_) => Opened::failed("reading ended early"),
                Ok(come) => come,
            };
            let pending = self.pending.remove(0);
            opened.push((come, pending.purpose, pending.is_of_world));
        }
        for (come, purpose, is_of_world) in opened {
            tick.changed = true;
            match purpose {
                // Only now it is known what they come to.
                Purpose::More(inputs) if self.about.is_some() && !is_of_world => self.open_more(inputs),
                Purpose::More(inputs) if self.about.is_some() => self.join(inputs, come),
                Purpose::Again(files) => self.renew(&files, come),
                Purpose::Ranges => self.summarise(come),
                Purpose::First | Purpose::More(_) => tick.is_new_scene |= self.show_first(gpu, come)?,
            }
        }
        let (Some(live), Some(about)) = (&mut self.live, &self.about) else {
            self.is_complete = self.pending.is_empty();
            return Ok(tick);
        };
        let scene = self.scene.as_mut().expect("there is always one");
        let mut ticked = Ok(None);
        if !size.contains(&0) {
            let pivot = about.bounds.min.z;
            // Solid columns without end are seen from below, too.
            let bounds = about.bounds;
            let floor = if lit { about.floor(self.grid.cell()) } else { bounds.solid_down_to() };
            ticked = sight(camera, size, [z_scale, pivot], floor, 1.0).map_err(anyhow::Error::from).and_then(
                |sight| {
                    let now = live.tick(scene, &sight, upload_bytes)?;
                    scene.flush()?;
                    Ok(Some(now))
                },
            );
        }
        if let Ok(Some(now)) = &ticked {
            tick.changed |= now.changed;
            tick.is_busy = scene.is_busy();
            self.is_complete = now.complete && self.pending.is_empty();
            let why = "the sections do not fit the device memory: give more with --device-memory";
            self.failed = now.stuck.then(|| why.to_owned()).or_else(|| live.failed());
        }
        if let Ok(Some(now)) = &ticked
            && now.complete
            && std::mem::take(&mut self.rereading).is_some()
        {
            // What is out of sight is not to come into it as it was.
            if std::mem::take(&mut self.is_mixed) {
                live.evict_stale(scene)?;
            }
            tick.changed = true;
        }
        if tick.changed || self.is_count_due || self.counted.elapsed() > COUNT_EVERY {
            let now = live.try_status(scene);
            // All files are gone through for them.
            let is_due = self.kinds_asked.is_none_or(|asked| asked.elapsed() > COUNT_EVERY);
            let kinds = if is_due || self.is_complete { live.try_kinds(self.kinds_version) } else { None };
            // A thread was in the way: what it has read last is to be told, too.
            self.is_count_due = now.is_none();
            tick.is_busy |= self.is_count_due;
            if let Some(now) = now {
                self.now = now;
                self.counted = Instant::now();
            }
            if let Some((version, kinds)) = kinds {
                (self.kinds_version, self.kinds) = (Some(version), kinds);
                self.kinds_asked = Some(Instant::now());
            }
        }
        let (errors, warnings) = (live.take_errors(), live.take_warnings());
        errors.iter().for_each(|line| self.problems.error(line));
        warnings.iter().for_each(|line| self.problems.warn(line));
        self.note_damage(&errors);
        self.print();
        let warnings = warnings.into_iter().map(|line| format!("warning: {line}"));
        self.say(errors.into_iter().chain(warnings).collect());
        // What was wrong with files is told even where this is the end.
        ticked.map(|_| tick)
    }

    /// What was found when files were opened.
    fn take_in(&mut self, problems: Problems) {
        self.say(problems.lines());
        self.problems.join(problems);
        self.print();
    }

    /// Notes are for the window alone.
    fn print(&mut self) {
        // A closed stderr is nothing to stop for.
        let _ = self.problems.print(false, &mut std::io::stderr().lock());
    }

    /// What was wrong with inputs, all of it printed.
    pub fn take_problems(&mut self) -> Problems {
        let _ = self.problems.finish(false, &mut std::io::stderr().lock());
        std::mem::take(&mut self.problems)
    }

    fn say(&mut self, lines: Vec<String>) {
        for line in lines.iter().map(|line| harmless(line)) {
            if !self.messages.contains(&line) {
                self.messages.push_back(line);
            }
        }
        let too_many = self.messages.len().saturating_sub(MOST_MESSAGES);
        self.messages.drain(..too_many);
    }

    /// Whether the grid of those that are there reaches files.
    fn reaches(&self, opening: &Opening) -> bool {
        let bounds = opening.about.bounds;
        let has_heights = [bounds.min.z, bounds.max.z].iter().all(|&u| self.grid.height(u).is_some());
        has_heights && cells_of(&self.grid, bounds.min, bounds.max).is_some()
    }

    /// More files, on the grid of those that are there.
    fn join(&mut self, asked: Vec<OsString>, come: Opened) {
        let Opened { opening, mut problems, given, fates, refused } = come;
        let opening = match opening {
            Ok(opening) if self.reaches(&opening) => Ok(opening),
            Ok(_) => Err("too far from what is shown, in height or aside".to_owned()),
            Err(error) => Err(error.to_string()),
        };
        let fates = match &opening {
            Ok(_) => fates,
            Err(why) => fates::none_shown(fates, why),
        };
        let is_shown = |(_, fate): &(PathBuf, Fate)| matches!(fate, Fate::Shown(_));
        if fates.iter().any(is_shown) {
            self.given.extend(given);
        }
        self.note_fates(&fates, refused, true);
        let opening = match opening {
            Ok(opening) => opening,
            Err(why) => {
                let names: Vec<_> = asked.iter().map(|input| input.display().to_string()).collect();
                problems.lose_all();
                self.take_in(problems);
                return self.say(vec![format!("{}: not added: {why}", names.join(", "))]);
            }
        };
        self.take_in(problems);
        let core = self.widen(&opening.about);
        let (Some(live), Some(about)) = (&mut self.live, &mut self.about) else { return };
        about.whole.kinds.extend(&opening.about.kinds);
        let first = about.files.len();
        about.files.extend(files_about(&opening, &fates));
        let sources = live.add_files(opening.inputs, core);
        for (file, source) in about.files[first..].iter_mut().zip(sources) {
            file.source = source;
        }
        self.watch_from(first);
    }

    /// What became of files: kept in the list, and told once.
    fn note_fates(&mut self, fates: &Fates, refused: Vec<Refused>, is_more: bool) {
        let refused: Vec<_> = refused.into_iter().chain(fates::refused(fates)).collect();
        let is_new = |known: &Refused| {
            refused.iter().all(|new| new.name != known.name)
                && fates.iter().all(|(path, _)| known.name != path.display().to_string())
        };
        self.refused.retain(is_new);
        let crs = self.about.as_ref().and_then(|about| about.crs.as_ref());
        let world = crs.map_or("", |crs| &crs.name);
        self.notices.extend(fates::told(fates, &refused, world, is_more));
        self.refused.extend(refused);
    }

    /// Errors of reading, by the files that they begin with.
    fn note_damage(&mut self, errors: &[String]) {
        let Some(about) = &mut self.about else { return };
        for error in errors {
            let told = about.files.iter_mut().find_map(|file| {
                let reason = error.strip_prefix(&*file.path.to_string_lossy())?.strip_prefix(": ")?;
                Some((file, reason))
            });
            if let Some((file, reason)) = told {
                file.damage.get_or_insert_with(|| harmless(reason));
            }
        }
    }

    /// Takes in what is known of more files; gives where all lie.
    fn widen(&mut self, more: &load::About) -> Core {
        let about = self.about.as_mut().expect("others are there");
        about.summaries += 1;
        let known = &mut about.whole;
        known.summary.scales.join(&more.summary.scales);
        let (a, b) = (known.bounds, more.bounds);
        known.bounds = a.union(b);
        let of_all = |about: &load::About| about.outline_of_all.as_ref().unwrap_or(&about.outline).clone();
        if known.outline_of_all.is_some() || more.outline_of_all.is_some() {
            known.outline_of_all = Some(of_all(known).joined(&of_all(more)));
        }
        known.outline = known.outline.joined(&more.outline);
        known.present.join(&more.present);
        if more.summary.colored > 0 {
            // Ranges stay those of the opening sample; that there are colours does not.
            known.summary.has_rgb = true;
            known.summary.colored += more.summary.colored;
            known.summary.rgb_constant = None;
        }
        load::core(self.grid.base_cell, &known.bounds)
    }

    /// Files have changed, are gone, or are there again.
    fn note_changes(&mut self, news: Vec<News>) {
        let (Some(about), Some(live)) = (&mut self.about, &mut self.live) else { return };
        let (mut lines, mut gone) = (Vec::new(), Vec::new());
        for News { file, is_there } in news {
            let known = &mut about.files[file];
            if known.is_removed {
                continue;
            }
            self.is_complete = false;
            self.again.retain(|again| *again != file);
            if is_there {
                self.again.push_back(file);
            } else {
                known.is_gone = true;
                gone.push(known.source);
                lines.push(format!("{}: is gone, and not shown any more", known.path.display()));
            }
        }
        if !gone.is_empty() {
            live.set_files_visible(&gone, false);
        }
        self.say(lines);
    }

    /// Opens files that have changed, many at a time: a drive with thousands of them may have come back.
    fn open_again(&mut self) {
        if self.pending.iter().any(|pending| matches!(pending.purpose, Purpose::Again(_))) {
            return;
        }
        let Some(about) = &self.about else { return };
        let files: Vec<_> = self.again.drain(..self.again.len().min(MOST_AGAIN)).collect();
        let paths: Vec<_> =
            files.iter().map(|&file| about.files[file].path.clone().into_os_string()).collect();
        if !files.is_empty() {
            self.open_aside(paths, Vec::new(), Purpose::Again(files));
        }
    }

    /// Files that have changed are opened: in the place of what they were.
    fn renew(&mut self, files: &[usize], come: Opened) {
        let Opened { opening, problems, fates, .. } = come;
        self.take_in(problems);
        let (opening, why) = match opening {
            Ok(opening) if self.reaches(&opening) => (Some(opening), String::new()),
            Ok(_) => (None, ": it is too far from the others, in height or aside".to_owned()),
            Err(error) => (None, format!(": {error}")),
        };
        let core = opening.as_ref().map(|opening| self.widen(&opening.about));
        let (Some(live), Some(about)) = (&mut self.live, &mut self.about) else { return };
        let mut inputs = HashMap::new();
        let has_rgb = opening.as_ref().is_some_and(|opening| opening.about.summary.colored > 0);
        if let Some(opening) = opening {
            // What the old ones had is not known.
            about.whole.kinds.extend(&opening.about.kinds);
            let path = |input: &OpenInput| input.input.file.path().to_owned();
            inputs.extend(opening.inputs.into_iter().map(|input| (path(&input), input)));
        }
        let [mut back, mut lost] = [const { Vec::new() }; 2];
        let (mut new, mut said) = (Vec::new(), Vec::new());
        for &number in files {
            let file = &mut about.files[number];
            if file.is_removed {
                continue;
            }
            let path = file.path.display();
            match inputs.remove(&file.path) {
                // It may be gone again since, which was told then.
                _ if watch::stamp(&file.path).is_none() => {}
                Some(input) => {
                    said.push(format!("{path}: has changed, and was read anew"));
                    if std::mem::take(&mut file.is_gone) && file.shown {
                        back.push(file.source);
                    }
                    let (shown, source) = (file.shown, file.source);
                    let treatment = fates.iter().find_map(|(path, fate)| match fate {
                        Fate::Shown(treatment) if *path == file.path => Some(treatment.clone()),
                        _ => None,
                    });
                    let treatment = treatment.unwrap_or(file.treatment.clone());
                    *file = FileAbout { shown, source, ..file_about(&input, has_rgb, treatment) };
                    new.push((file.source, input));
                }
                None => {
                    said.push(format!("{path}: has changed, and cannot be shown any more{why}"));
                    file.is_gone = true;
                    lost.push(file.source);
                }
            }
        }
        if let Some(core) = core.filter(|_| !new.is_empty()) {
            live.replace_files(new, core);
        }
        for (sources, shown) in [(back, true), (lost, false)] {
            if !sources.is_empty() {
                live.set_files_visible(&sources, shown);
            }
        }
        self.say(said);
    }

    /// Ranges of colours become those of other points. What codes mean stays: it does not depend on what takes part.
    fn summarise(&mut self, come: Opened) {
        let (Ok(opening), Some(about)) = (come.opening, &mut self.about) else { return };
        let before = &about.whole.summary;
        let (has_rgb, scales) = (before.has_rgb, before.scales.clone());
        about.whole.summary = AttributeSummary { has_rgb, scales, ..opening.about.summary };
        about.summaries += 1;
    }

    fn watch_from(&self, first: usize) {
        let (Some(watch), Some(about)) = (&self.watch, &self.about) else { return };
        for (number, file) in about.files.iter().enumerate().skip(first) {
            watch.add(number, file.path.clone(), file.stamp);
        }
    }

    /// The first data that there is; whether there is any.
    fn show_first(&mut self, gpu: &Gpu, come: Opened) -> anyhow::Result<bool> {
        let Opened { opening, problems, given, fates, refused } = come;
        self.take_in(problems);
        self.given = given;
        let opening = match opening {
            Ok(opening) => opening,
            Err(error) => {
                let why = error.to_string();
                self.note_fates(&fates::none_shown(fates, &why), refused, true);
                self.failed = Some(why);
                return Ok(false);
            }
        };
        self.show(gpu, opening, &fates)?;
        self.note_fates(&fates, refused, false);
        let far = self.about.iter().flat_map(|about| &about.files).filter(|file| file.is_far).count();
        match far {
            0 => {}
            1 => self.notices.push("1 file lies far from the others, which are framed without it".to_owned()),
            _ => self
                .notices
                .push(format!("{far} files lie far from the others, which are framed without them")),
        }
        Ok(true)
    }

    /// The first data that there is: its scene.
    fn show(&mut self, gpu: &Gpu, opening: Opening, fates: &Fates) -> anyhow::Result<()> {
        self.failed = None;
        let mut files: Vec<_> = files_about(&opening, fates).collect();
        files.iter_mut().enumerate().for_each(|(source, file)| file.source = source);
        self.first_files = files.len();
        let mode = self.options.color.unwrap_or(opening.about.color);
        let (summary, mut problems) = (opening.about.summary.clone(), Problems::default());
        let opening = opening.colored(mode, &summary, &mut problems);
        self.take_in(problems);
        let Opening { inputs, grid, core, about, reading } = opening;
        self.reading = reading.clone();
        self.anchor = grid.height(about.bounds.center().z).unwrap_or(Height(0));
        self.about = Some(DataAbout { whole: about, files, summaries: 0 });
        let wake = Arc::clone(&self.wake);
        self.watch = Some(Watch::new(move || wake()));
        self.watch_from(0);
        let wake = Arc::clone(&self.wake);
        // Two threads are left to the frames, where there are more.
        let threads = load::threads();
        let host_bytes = self.options.host_bytes;
        let surface = self.options.surface;
        let made = Made { surface, reading };
        let live = Live::new(inputs, made, grid, core, host_bytes, threads, move || wake());
        if let Some(cache) = &self.options.cache {
            live.save_learned_to(cache.clone());
        }
        self.live = Some(live);
        self.new_scene(gpu, grid, self.scene().visibility())?;
        let hidden = std::mem::take(&mut self.hidden);
        if hidden.is_empty() {
            return Ok(());
        }
        let is_hidden = |path: &Path| path.canonicalize().is_ok_and(|path| hidden.contains(&path));
        let files = self.about.iter().flat_map(|about| &about.files).enumerate();
        let unseen: Vec<_> = files.filter(|(_, file)| is_hidden(&file.path)).map(|(file, _)| file).collect();
        unseen.into_iter().for_each(|file| self.set_visible(file, false));
        Ok(())
    }

    /// Inputs that come to what is shown: as they were given where nothing of theirs is hidden or removed, else file by
    /// file. `is_path`: only files and folders, no lists and patterns.
    pub fn shown_inputs(&self, is_path: bool) -> Vec<OsString> {
        let files = self.about.as_ref().map_or(&[][..], |about| &about.files);
        if files.is_empty() {
            return self.given.iter().map(|given| given.word.clone()).collect();
        }
        let seen = |file: &&FileAbout| file.shown && !file.is_removed;
        let mut left: HashSet<&Path> = files.iter().filter(seen).map(|file| &*file.path).collect();
        let unseen: HashSet<&Path> =
            files.iter().map(|file| &*file.path).filter(|path| !left.contains(path)).collect();
        let mut words = Vec::new();
        for Given { word, files } in &self.given {
            let is_whole = !files.iter().any(|path| unseen.contains(&**path));
            let is_new = files.iter().any(|path| left.contains(&**path));
            if is_whole && is_new && (!is_path || Path::new(word).exists()) {
                words.push(word.clone());
                for path in files {
                    left.remove(&**path);
                }
            }
        }
        let rest = files.iter().filter(|file| left.contains(&*file.path));
        words.extend(rest.map(|file| file.path.clone().into_os_string()));
        words
    }

    /// Files in the list that are not shown.
    pub fn hidden_files(&self) -> impl Iterator<Item = &Path> {
        let files = self.about.iter().flat_map(|about| &about.files);
        files.filter(|file| !file.shown && !file.is_removed).map(|file| &*file.path)
    }

    /// Whether other files are shown than were opened first: what was chosen by those is not what these would choose.
    pub fn shows_others(&self) -> bool {
        let is_first = |file: &FileAbout| file.source < self.first_files && file.shown && !file.is_removed;
        self.about.as_ref().is_some_and(|about| !about.files.iter().all(is_first))
    }

    /// How files are read.
    pub fn options(&self) -> &ReadOptions {
        &self.options
    }

    /// Files that are not shown, and why.
    pub fn refused(&self) -> &[Refused] {
        &self.refused
    }

    /// Takes a file from the list of those that are not shown.
    pub fn dismiss(&mut self, refused: usize) {
        if refused < self.refused.len() {
            self.refused.remove(refused);
        }
    }

    /// What is to be told to the user since the last time.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// Whether nothing is open, nor is to be.
    pub fn is_empty(&self) -> bool {
        self.given.is_empty() && self.pending.is_empty()
    }

    /// What is known of the data; `None` until headers and the opening sample are read.
    pub fn about(&self) -> Option<&DataAbout> {
        self.about.as_ref()
    }

    /// The grid and the height that images count from.
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
    pub fn table(&self, renderer: &mut Renderer) -> Arc<Table> {
        self.live.as_ref().map(|live| renderer.table_of_live(self.scene(), live)).unwrap_or_default()
    }

    /// Shows or hides a file, by its place in [`DataAbout::files`]. Until the sections that it touches are rebuilt, their
    /// old versions stay.
    pub fn set_visible(&mut self, file: usize, shown: bool) {
        let Some(about) = self.about.as_mut().and_then(|about| about.files.get_mut(file)) else { return };
        about.shown = shown;
        if let Some(live) = &mut self.live
            && !about.is_gone
        {
            live.set_file_visible(about.source, shown);
        }
        self.is_complete = false;
    }

    /// Which points take part, and what their records hold.
    pub fn reading(&self) -> &Reading {
        &self.reading
    }

    /// Whether some records that are shown may hold something else than [`Data::reading`] says.
    pub fn is_mixed(&self) -> bool {
        self.is_mixed
    }

    /// Reads other points, or something else of them. Until the sections are made anew, their old versions stay.
    pub fn set_reading(&mut self, reading: Reading) {
        let Some(live) = &mut self.live else { return };
        if reading == self.reading {
            return;
        }
        self.rereading = Some(match reading.selection == self.reading.selection {
            true => format!("{} of {}", reading.channel.name(), reading.selection.words()),
            false => reading.selection.words(),
        });
        self.is_mixed |= reading.channel != self.reading.channel;
        let is_other_selection = reading.selection != self.reading.selection;
        self.reading = reading.clone();
        live.set_reading(reading);
        if is_other_selection {
            let files = self.about.iter().flat_map(|about| &about.files);
            let files = files.filter(|file| !file.is_removed && !file.is_gone);
            let paths: Vec<_> = files.map(|file| file.path.clone().into_os_string()).collect();
            self.pending.retain(|pending| !matches!(pending.purpose, Purpose::Ranges));
            self.open_aside(paths, Vec::new(), Purpose::Ranges);
        }
        self.is_complete = false;
        let doubts = self.about.iter().flat_map(|about| about.present.doubts(&self.reading.selection));
        self.notices.extend(doubts);
        let lines = self.about.iter().flat_map(|about| &about.files).filter(|file| !file.is_removed);
        let lines = lines.filter_map(|file| {
            let words = self.reading.lacks(file.format)?;
            Some(format!("{}: {words}", file.path.display()))
        });
        let lines: Vec<_> = lines.collect();
        if let Some(first) = lines.first() {
            let more = if lines.len() > 1 {
                format!(" (and {} more files)", lines.len() - 1)
            } else {
                String::new()
            };
            self.notices.push(format!("{first}{more}"));
        }
        self.say(lines);
    }

    /// Takes a file from the list; it is not shown any more.
    pub fn remove(&mut self, file: usize) {
        self.set_visible(file, false);
        if let Some(file) = self.about.as_mut().and_then(|about| about.files.get_mut(file)) {
            file.is_removed = true;
        }
    }

    /// Whether the points that are shown are those that were asked for at first.
    pub fn is_first(&self) -> bool {
        let [first, now] = [self.options.visibility, self.scene().visibility()];
        let is_first = self.options.selection == self.reading.selection;
        is_first && (first.classes, first.hidden_flags) == (now.classes, now.hidden_flags)
    }

    /// Whether every file was taken from the list.
    pub fn is_emptied(&self) -> bool {
        let is_removed = |about: &DataAbout| about.files.iter().all(|file| file.is_removed);
        self.pending.is_empty() && self.about.as_ref().is_some_and(is_removed)
    }

    /// Adds inputs, such as files that were dropped. Those that are there already are left alone.
    pub fn add(&mut self, inputs: Vec<OsString>) {
        if inputs.is_empty() {
            return;
        }
        self.is_complete = false;
        if self.about.is_none() && self.pending.is_empty() {
            self.failed = None;
            self.open_aside(inputs, Vec::new(), Purpose::First);
        } else {
            self.open_more(inputs);
        }
    }

    fn open_more(&mut self, inputs: Vec<OsString>) {
        let files = self.about.iter().flat_map(|about| &about.files);
        let known = files.filter(|file| !file.is_removed).map(|file| file.path.clone()).collect();
        self.open_aside(inputs.clone(), known, Purpose::More(inputs));
    }

    /// Opens inputs on another thread, but for files that are known.
    fn open_aside(&mut self, inputs: Vec<OsString>, known: Vec<PathBuf>, purpose: Purpose) {
        let world = self.about.as_ref().map(|about| about.world());
        let is_of_world = world.is_some();
        let is_of_known = purpose.is_of_known();
        let (send, opening) = crossbeam_channel::bounded(1);
        let (options, wake) = (self.options.clone(), Arc::clone(&self.wake));
        // What comes to what is shown is read as that is.
        let selection = if is_of_world { &self.reading.selection } else { &options.selection }.clone();
        let is_first = selection == options.selection;
        std::thread::spawn(move || {
            let (mut problems, mut fates) = (Problems::default(), Fates::new());
            let mut found = inputs::expand(&inputs);
            let given = match &inputs[..] {
                [only] => vec![Given { word: only.clone(), files: found.files.clone() }],
                many => many.iter().map(Given::of).collect(),
            };
            let refused = found.failed.iter().map(Refused::input).collect();
            let is_known = !found.files.is_empty() && found.files.iter().all(|path| known.contains(path));
            found.files.retain(|path| !known.contains(path));
            if is_of_known {
                // They were counted when they came.
                found.failed.iter().for_each(|error| problems.error(error));
            } else {
                problems.look_at(&found);
            }
            let options = LoadOptions {
                surface: options.surface,
                cell: options.cell,
                placement: PlacementOptions { known: world, ..options.placement },
                rgb_bits: options.rgb_bits,
                asked: Asked { selection, ..options.visibility.asked() },
                budget: Budget { host_bytes: options.host_bytes, device_bytes: options.device_bytes },
                cache: options.cache,
                quiet: true,
            };
            let opening = match is_known {
                true => Err(LoadError::Nothing("all of it is open already")),
                // Another selection may take some of what comes.
                false => load::open_and_tell(&found.files, &options, !is_of_world, &mut problems, &mut fates),
            };
            // Of what was asked for at first nothing is known then.
            let opening = opening.map(|opening| if is_first { opening } else { opening.of_all() });
            // The window may be gone.
            let _ = send.send(Opened { opening, problems, given, fates, refused });
            wake();
        });
        self.pending.push(OpeningFiles { opening, purpose, is_of_world });
    }

    /// Whether everything that is to be seen is there.
    pub fn is_complete(&self) -> bool {
        self.is_complete || self.failed.is_some()
    }

    /// What is known of the data, once all is there and nothing is seen of it.
    fn about_nothing(&self) -> Option<&DataAbout> {
        let is_nothing = self.is_complete && self.pending.is_empty() && self.scene().shows_nothing();
        self.about.as_ref().filter(|_| is_nothing)
    }

    /// Why nothing is seen, once all is there: none of the points takes part.
    fn why_unselected(&self) -> Option<String> {
        let about = self.about_nothing()?;
        let selection = &self.reading.selection;
        let is_none = !selection.is_all() && self.kinds_version.is_some() && self.kinds.of.is_empty();
        is_none.then(|| LoadError::none_selected(selection, &about.present).to_string())
    }

    /// Why nothing is seen, once all is there: every point is hidden.
    fn why_hidden(&self) -> Option<String> {
        let (about, scene) = (self.about_nothing()?, self.scene());
        // Of the files that are shown.
        let kinds = match self.kinds_version {
            None => about.kinds.clone(),
            Some(_) => self.kinds.kinds(),
        };
        why_hidden(&kinds, &scene.visibility()).map(|why| format!("nothing to draw: {why}"))
    }

    /// How far things are.
    pub fn status(&self) -> DataStatus {
        let (now, progress) = (&self.now, &self.now.progress);
        // Chunks that nothing lacks now are not needed.
        let lacking = progress.lacking as f64 / progress.chunks.max(1) as f64;
        let files = self.about.as_ref().map_or(&[][..], |about| &about.files);
        let shown = files.iter().filter(|file| file.is_seen()).count();
        let all = files.iter().filter(|file| !file.is_removed).count();
        let is_of_known = |pending: &OpeningFiles| pending.purpose.is_of_known();
        DataStatus {
            points: progress.points,
            points_read: progress.points_seen,
            share_read: 1.0 - lacking,
            kinds: self.kinds.clone(),
            extent: self.about.as_ref().and_then(DataAbout::shown_bounds),
            files: [shown, all].map(|n| n as u64),
            is_opening: self.pending.iter().any(|pending| !is_of_known(pending)),
            sections_wanted: now.wanted as u64,
            sections_resident: now.ready as u64,
            host_bytes: [now.host_bytes, self.options.host_bytes],
            device_bytes: [now.device_bytes, self.options.device_bytes],
            reduced_detail: (now.coarser > 1.0)
                .then(|| format!("cells cover up to {:.1} pixels, for lack of device memory", now.coarser)),
            messages: self.messages.iter().cloned().collect(),
            bytes_read: progress.bytes_read,
            frames_waited: self.scene().counters().waits,
            is_complete: self.is_complete(),
            is_switching: self.scene().is_switching(),
            failed: self.failed.clone(),
            hidden: self.why_hidden(),
            hidden_flags: self.scene().visibility().hidden_flags,
            unselected: self.why_unselected(),
            is_selection: !self.reading.selection.is_all(),
            rereading: self.rereading.clone(),
        }
    }
}

/// How a pool of so many bytes is reached.
fn access(gpu: &Gpu, surface: Surface, budget: u64) -> Access {
    Access::best(gpu, surface.derived_of(budget))
}

impl Given {
    fn of(word: &OsString) -> Given {
        Given { word: word.clone(), files: inputs::expand([word]).files }
    }
}

impl Opened {
    fn failed(why: &'static str) -> Opened {
        Opened {
            opening: Err(LoadError::Nothing(why)),
            problems: Problems::default(),
            given: Vec::new(),
            fates: Fates::new(),
            refused: Vec::new(),
        }
    }
}

/// What is known of files that are shown; `fates`: what became of all that were opened with them.
fn files_about(opening: &Opening, fates: &Fates) -> impl Iterator<Item = FileAbout> {
    let has_rgb = opening.about.summary.colored > 0;
    let treatments: HashMap<_, _> = fates
        .iter()
        .filter_map(|(path, fate)| match fate {
            Fate::Shown(treatment) => Some((path.as_path(), treatment)),
            Fate::LeftOut(_) | Fate::Failed(_) => None,
        })
        .collect();
    opening.inputs.iter().map(move |input| {
        let treatment = treatments.get(input.input.file.path()).copied().cloned().unwrap_or_default();
        file_about(input, has_rgb, treatment)
    })
}

/// `has_rgb`: those that it was opened with have colours.
fn file_about(input: &OpenInput, has_rgb: bool, treatment: Treatment) -> FileAbout {
    let file = &input.input.file;
    FileAbout {
        path: file.path().to_owned(),
        points: file.points(),
        shown: true,
        is_gone: false,
        system: input.system.clone(),
        is_removed: false,
        treatment,
        damage: None,
        has_rgb: has_rgb && sample::has_rgb(file),
        format: file.header.format,
        is_far: !input.is_in_frame,
        bounds: input.bounds,
        hulls: [input.hull.clone(), input.hull_of_all.clone().or(input.hull.clone())],
        source: 0,
        stamp: Some((file.bytes.len(), file.bytes.modified())),
    }
}
