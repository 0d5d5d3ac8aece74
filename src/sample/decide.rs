//! Takes the opening sample and decides.

use super::budget::SampleBudget;
use super::cell::{self, CellChoice};
use super::facts::{facts, in_nodes};
use super::frame::{self, FrameNote};
use super::ground;
use super::open::Opened;
use super::places::{self, Place};
use super::present::Present;
use super::read::{read_firsts, read_places, rgb_of};
use super::rgb::{self, RgbDepth};
use super::seen::{Asked, Seen, hidden_by_default, unpack};
use super::shapes::{Shape, Shapes};
use super::summary::{Shown, counts, summarise, times};
use super::weighted::{Part, Weighted};
use crate::attribute::{AttributeSummary, ColorMode, Kind, Kinds, Scales, Spread};
use crate::coords::{Bounds, Hull, LowSurface};
use crate::source::known::Told;
use crate::source::placement::{PlacementOptions, World};
use crate::source::{Selection, SourceError};
use std::collections::BTreeMap;

/// Points spread over the set that one place of neighbouring points is worth.
const PLACE_WORTH: f64 = 250.0;
/// Likewise the head of a chunk.
const HEAD_WORTH: f64 = 40.0;

/// The kinds of points that the sample has seen of a file.
#[derive(Clone, Debug, Default)]
pub struct SampledKinds {
    /// What they weigh among each other; points, where `is_whole`.
    pub weights: BTreeMap<Kind, f64>,
    /// What all that were seen weigh: more where only some of them are meant.
    pub all: f64,
    /// Every point of the file was seen.
    pub is_whole: bool,
}

impl SampledKinds {
    fn of(seen: &[(&Seen, f64)], is_whole: bool, is_meant: impl Fn(&Seen) -> bool) -> SampledKinds {
        let (mut weights, mut all) = (BTreeMap::new(), 0.0);
        for (seen, weight) in seen {
            let weight = if is_whole { 1.0 } else { *weight };
            all += weight;
            if is_meant(seen) {
                *weights.entry(seen.kind()).or_default() += weight;
            }
        }
        SampledKinds { weights, all, is_whole }
    }
}

/// What the sample says of one file.
#[derive(Clone, Debug)]
pub struct FileSample {
    /// How all its points' RGB is to be read.
    pub rgb: RgbDepth,
    /// The one colour that all of its points have, as stored, but for black.
    pub rgb_constant: Option<[u16; 3]>,
    /// World box without stray points; `None` for no points, or a file left out.
    pub bounds: Option<Bounds>,
    /// It does not lie so far from the others that these are framed without it.
    pub is_in_frame: bool,
    /// What is framed of it: the points that were asked for; `None` for no such points.
    pub hull: Option<Hull>,
    /// The same of those that are shown by default, where others were asked for.
    pub hull_of_all: Option<Hull>,
    /// World box that no point lies outside of, as far as the header and the sample say; `None` where they do not.
    pub reach: Option<Bounds>,
    /// Points lie in the nodes that a COPC hierarchy has them in, as far as the sample says.
    pub in_nodes: bool,
    /// Who is wrong about where its chunks lie, as far as the sample says.
    pub contradicted: Option<Told>,
    /// What its points are, as far as they were seen.
    pub kinds: SampledKinds,
    /// The same of those that take part, where not all do.
    pub selected: Option<SampledKinds>,
}

/// The opening sample's decisions.
#[derive(Debug)]
pub struct Sample {
    /// Coordinate system, and each file's way into it.
    pub world: World,
    /// One a file.
    pub files: Vec<FileSample>,
    /// Points in the files that are drawn, hidden ones included.
    pub points: u64,
    /// Points that were looked at.
    pub sampled: u64,
    /// Those of them that take part.
    pub selected: u64,
    /// Every point was.
    pub whole: bool,
    /// Cell size, density, coverage.
    pub cell: CellChoice,
    /// Of the points that were asked for (where there are none of them, of those shown by default, or of all); counts are
    /// estimates unless `whole`.
    pub attributes: AttributeSummary,
    /// What colours show where nothing is asked for: it follows from all points that are shown by default.
    pub color: ColorMode,
    /// Points of each class that take part, hidden ones included; estimates unless `counted`.
    pub classes: Box<[u64; 256]>,
    /// Kinds of points that take part and were seen, hidden ones included.
    pub kinds: Kinds,
    /// What there is of the values that selections go by.
    pub present: Present,
    /// Every point was looked at, and none could not be read.
    pub counted: bool,
    /// Where the points are that are shown by default, strays aside; `None` for no points.
    pub bounds: Option<Bounds>,
    /// What is framed of those that were asked for, and the ground below it, roughly; `None` for no points.
    pub shape: Option<Shape>,
    /// The same of those that are shown by default, where others were asked for.
    pub shape_of_all: Option<Shape>,
    /// What is not obvious about that.
    pub notes: Vec<FrameNote>,
    /// Chunks that could not be read (file, why); what they hold will be missing.
    pub problems: Vec<(usize, SourceError)>,
}

/// The points of a sample that take part.
struct Tally {
    kinds: Kinds,
    /// Weights by class.
    classes: Vec<f64>,
    selected: u64,
}

impl Tally {
    fn of(sample: &Weighted) -> Tally {
        let mut tally = Tally { kinds: Kinds::new(), classes: vec![0.0; 256], selected: 0 };
        for (seen, weight) in sample.points.iter().flatten().filter(|(seen, _)| seen.is_selected) {
            tally.selected += 1;
            tally.kinds.insert(seen.kind());
            tally.classes[usize::from(seen.class)] += weight;
        }
        tally
    }
}

/// What is read beside the first points of chunks.
struct Runs {
    /// Everything.
    whole: bool,
    /// Runs of neighbouring points, and what was seen there.
    places: Vec<Place>,
    seen: Vec<Vec<Seen>>,
    /// Beginnings of chunks; none where everything is read.
    heads: Vec<Place>,
    heads_seen: Vec<Vec<Seen>>,
}

impl Runs {
    /// Reads all `points` of the files that are `drawn`, or some.
    fn read(
        (files, drawn, points): (&[Opened], &[usize], u64),
        whole: bool,
        selection: &Selection,
        budget: &SampleBudget,
        problems: &mut Vec<(usize, SourceError)>,
    ) -> Runs {
        let places = match whole {
            true => places::every_place(files, drawn),
            false => places::chosen_places(files, drawn, points, budget),
        };
        let seen = read_places(files, selection, &places, problems);
        let heads = if whole { Vec::new() } else { places::heads(files, drawn, points, budget) };
        // A chunk that is broken from its start is reported when it is drawn.
        let heads_seen = read_places(files, selection, &heads, &mut Vec::new());
        Runs { whole, places, seen, heads, heads_seen }
    }

    /// With what they are worth.
    fn parts(&self) -> [Part<'_>; 2] {
        [(&self.heads, &self.heads_seen, HEAD_WORTH), (&self.places, &self.seen, PLACE_WORTH)]
    }

    /// Points take part only where they lie as high as asked for: these, and first points of chunks, a file.
    fn mark_heights(
        &mut self,
        files: &[Opened],
        world: &World,
        selection: &Selection,
        firsts: &mut [Vec<Seen>],
    ) {
        if selection.heights.is_all() {
            return;
        }
        let firsts = firsts.iter_mut().enumerate();
        let of_places = [(&self.places, &mut self.seen), (&self.heads, &mut self.heads_seen)];
        let of_places =
            of_places.into_iter().flat_map(|(places, seen)| places.iter().map(|at| at.file).zip(seen));
        for (file, seen) in firsts.chain(of_places) {
            let Some(placement) = &world.placements[file] else { continue };
            for seen in seen {
                let point = unpack(&files[file].file, seen.raw);
                seen.is_selected &= selection.holds_height(placement.place(point.x, point.y, point.z).z);
            }
        }
    }
}

/// Which points of a sample count for the cell size and the frame, whatever is asked for: those that are shown by default.
/// Where everything is noise, noise is what is measured.
fn usual(sample: &Weighted) -> impl Fn(&Seen) -> bool + Sync + Copy + use<> {
    let everything =
        sample.points.iter().flatten().all(|(seen, _)| hidden_by_default(seen.class, seen.flags));
    move |seen: &Seen| everything || !hidden_by_default(seen.class, seen.flags)
}

/// The cell size that the points of `runs` speak for that are shown by default: pictures of the same files have the same
/// cells, whichever classes and points of them are asked for. `bounds`: a file.
fn cell_of(
    (files, drawn, budget): (&[Opened], &[usize], &SampleBudget),
    firsts: &[Vec<Seen>],
    runs: &Runs,
    sample: &Weighted,
    bounds: &[Option<Bounds>],
) -> CellChoice {
    let ground = ground::Ground {
        files,
        budget,
        drawn,
        firsts,
        whole: runs.whole,
        counts: &usual(sample),
        place: &|file, seen| sample.place(file, seen),
        bounds,
    };
    let patches = ground::patches(&runs.places, &runs.seen, &ground);
    let finest = drawn.iter().map(|&index| files[index].file.header.scale.truncate().min_element());
    cell::choose(&patches, finest.fold(f64::INFINITY, f64::min))
}

/// The points of a sample that are shown, but for such as lie far from the others of their file.
fn shown_points<'a>(
    sample: &Weighted<'a>,
    framed: &[frame::Framed],
    rgb: &[RgbDepth],
    is_shown: impl Fn(&Seen) -> bool,
) -> Vec<Shown<'a>> {
    let mut shown = Vec::new();
    for (file, points) in sample.points.iter().enumerate() {
        for &(seen, weight) in points.iter().filter(|(seen, _)| is_shown(seen)) {
            let at = sample.place(file, seen);
            if at.is_finite() && framed[file].keeps(at) {
                shown.push(Shown { seen, weight, u: at.z, rgb: rgb[file].to_8_bit(seen.rgb) });
            }
        }
    }
    shown
}

/// How far the points that are `shown` are above a low surface.
fn above(
    low: &LowSurface,
    sample: &Weighted,
    framed: &[frame::Framed],
    shown: impl Fn(&Seen) -> bool + Copy,
) -> Spread {
    let of_file = |file: usize| sample.placed(file, shown).filter(move |(at, _)| framed[file].keeps(*at));
    let placed = (0..framed.len()).flat_map(of_file);
    Spread::of(placed.map(|(at, weight)| (at.z - low.at(at.truncate()), weight)))
}

/// What codes mean, and what colours show where nothing is asked for: by all points that count. `density`: theirs; `whole`: every point was seen.
fn by_all(
    sample: &Weighted,
    (points, all): (&[Shown], &AttributeSummary),
    world: &World,
    (density, whole): (f64, bool),
) -> (Scales, ColorMode) {
    let metre = world.unit.as_ref().map_or(1.0, |unit| unit.si.recip());
    let all_times = sample.points.iter().flatten().map(|(seen, weight)| (seen.gps_time, *weight));
    let scales = Scales {
        metre,
        times: times(all_times, whole),
        reach: Scales::reach_of(points.iter().map(|point| point.u), &all.height, metre),
        lines: all.source_ids.iter().map(|(id, _)| *id).collect(),
        density,
    };
    (scales, ColorMode::auto(all))
}

/// Takes the opening sample of `files` (sorted by path) and decides; `asked`: what is to be shown at first.
pub fn take(files: &[Opened], options: &PlacementOptions, asked: &Asked, budget: &SampleBudget) -> Sample {
    let mut problems = Vec::new();
    let selection = &asked.selection;
    let mut firsts = read_firsts(files, selection, budget, &mut problems);
    let world = World::of(&facts(files, &firsts), options);
    let drawn: Vec<usize> = (0..files.len()).filter(|&index| world.placements[index].is_some()).collect();
    let points: u64 = drawn.iter().map(|&index| files[index].file.points()).sum();

    let is_usual = *asked == Asked::default();
    let whole = points <= if is_usual { budget.whole } else { budget.whole_of_classes };
    let set = (files, &*drawn, points);
    let mut runs = Runs::read(set, whole, selection, budget, &mut problems);
    runs.mark_heights(files, &world, selection, &mut firsts);
    let in_nodes: Vec<bool> =
        (0..files.len()).map(|index| in_nodes(&files[index].file, &firsts[index])).collect();
    let contradicted: Vec<Option<Told>> = files
        .iter()
        .zip(&firsts)
        .map(|(opened, firsts)| opened.known.contradicted(&opened.file, firsts.iter().map(|seen| seen.raw)))
        .collect();
    // A set that is read whole has its first points among the others.
    let (firsts, firsts_of_some) =
        if whole { (vec![Vec::new(); files.len()], firsts) } else { (firsts, Vec::new()) };
    let stored = rgb_of(files, &drawn, &firsts, &runs.places, &runs.seen, whole);
    let rgb = rgb::decide(files, &stored);
    let has_rgb = drawn.iter().any(|&index| rgb::has_rgb(&files[index].file));
    // Of a set that is read whole only for what is asked for, cells, codes and colours are those that they are with nothing asked for.
    let by_some = (whole && points > budget.whole).then(|| {
        let some = Runs::read(set, false, selection, budget, &mut Vec::new());
        let sample = Weighted::new(files, &world, false, &firsts_of_some, some.parts());
        let usual = usual(&sample);
        let framed: Vec<frame::Framed> =
            (0..files.len()).map(|file| sample.framed(file, usual).unwrap_or_default()).collect();
        let bounds: Vec<_> = framed.iter().map(|framed| framed.bounds).collect();
        let cell = cell_of((files, &drawn, budget), &firsts_of_some, &some, &sample, &bounds);
        let points = shown_points(&sample, &framed, &rgb, usual);
        let all = summarise(&points, has_rgb);
        let (scales, color) = by_all(&sample, (&points, &all), &world, (cell.density, false));
        (cell, scales, color)
    });

    let sample = Weighted::new(files, &world, whole, &firsts, runs.parts());
    let usual = usual(&sample);
    let is_asked = |seen: &Seen| seen.is_selected && asked.shows(seen.class, seen.flags);
    let is_there = sample.points.iter().flatten().any(|(seen, _)| is_asked(seen));
    let shown = |seen: &Seen| if is_there { is_asked(seen) } else { usual(seen) };
    let framed: Vec<frame::Framed> =
        (0..files.len()).map(|file| sample.framed(file, usual).unwrap_or_default()).collect();
    let (frame, in_frame, notes) = frame::whole(&framed, |file| files[file].file.points(), whole);
    let mut is_in_frame = vec![false; files.len()];
    in_frame.iter().for_each(|&file| is_in_frame[file] = true);
    let (framed, in_frame, drawn_files) = (&*framed, &*in_frame, drawn.len());
    let shapes = Shapes { sample: &sample, framed, frame, in_frame, drawn: drawn_files, whole };
    let of_all = shapes.of_all(&usual);
    // Others than usual are framed by themselves.
    let ((shape, hulls), (shape_of_all, hulls_of_all)) = match is_usual || !is_there {
        true => (of_all, (None, vec![None; files.len()])),
        false => (shapes.of_shown(&usual, &shown), of_all),
    };
    let Tally { kinds, classes, selected } = Tally::of(&sample);
    let of_shown = shown_points(&sample, framed, &rgb, shown);
    let bounds: Vec<Option<Bounds>> = framed.iter().map(|framed| framed.bounds).collect();
    // Roofs alone are no ground: that is below all.
    let low = shape_of_all.as_ref().or(shape.as_ref()).map(|(_, low)| low);
    let above = low.map_or(Spread::default(), |low| above(low, &sample, framed, shown));
    let attributes = summarise(&of_shown, has_rgb);
    let others = (!is_usual).then(|| shown_points(&sample, framed, &rgb, usual));
    let of_others = others.as_ref().map(|others| summarise(others, has_rgb));
    let all = (others.as_ref().unwrap_or(&of_shown).as_slice(), of_others.as_ref().unwrap_or(&attributes));
    let (cell, scales, color) = by_some.unwrap_or_else(|| {
        let cell = cell_of((files, &drawn, budget), &firsts, &runs, &sample, &bounds);
        let (scales, color) = by_all(&sample, all, &world, (cell.density, whole));
        (cell, scales, color)
    });
    let sampled = sample.points.iter().map(Vec::len).sum::<usize>() as u64;
    Sample {
        points,
        sampled,
        selected,
        counted: whole && sampled == points,
        whole,
        cell,
        attributes: AttributeSummary { above, scales, is_of_shown: is_there, ..attributes },
        color,
        classes: counts(&classes),
        kinds,
        present: Present::of(&sample, usual, !whole),
        bounds: frame,
        shape,
        shape_of_all,
        files: (0..)
            .zip(rgb)
            .zip(&bounds)
            .zip(hulls.into_iter().zip(hulls_of_all))
            .map(|(((index, rgb), &bounds), (hull, hull_of_all))| {
                let (reach, in_nodes, contradicted) =
                    (sample.reach(index), in_nodes[index], contradicted[index]);
                let rgb_constant = rgb::constant(&stored[index]).filter(|_| rgb != RgbDepth::None);
                let (seen, all) = (&sample.points[index], files[index].file.points());
                let is_whole = whole && seen.len() as u64 == all;
                let kinds = SampledKinds::of(seen, is_whole, |_| true);
                let of_selected = || SampledKinds::of(seen, is_whole, |seen| seen.is_selected);
                FileSample {
                    rgb,
                    rgb_constant,
                    bounds,
                    is_in_frame: is_in_frame[index],
                    hull,
                    hull_of_all,
                    reach,
                    in_nodes,
                    contradicted,
                    kinds,
                    selected: (!selection.is_all()).then(of_selected),
                }
            })
            .collect(),
        notes,
        problems,
        world,
    }
}
