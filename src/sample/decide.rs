//! Takes the opening sample and decides.

use super::budget::SampleBudget;
use super::cell::{self, CellChoice};
use super::facts::{facts, header_bounds, in_nodes};
use super::frame::{self, FrameNote};
use super::ground;
use super::open::Opened;
use super::places;
use super::read::{read_firsts, read_places, rgb_of};
use super::rgb::{self, RgbDepth};
use super::seen::{Asked, Seen, hidden_by_default, unpack};
use super::shape::{self, shape};
use super::summary::{Shown, counts, summarise};
use crate::attribute::{AttributeSummary, Kinds};
use crate::coords::{Bounds, Hull, LowSurface};
use crate::source::known::Told;
use crate::source::placement::{PlacementOptions, World};
use crate::source::{FLAG_WITHHELD, SourceError};
use glam::DVec3;

/// Points spread over the set that one place of neighbouring points is worth.
const PLACE_WORTH: f64 = 250.0;
/// Likewise the head of a chunk.
const HEAD_WORTH: f64 = 40.0;

/// What the sample says of one file.
#[derive(Clone, Debug)]
pub struct FileSample {
    /// How all its points' RGB is to be read.
    pub rgb: RgbDepth,
    /// The one colour that all of its points have, as stored, but for black.
    pub rgb_constant: Option<[u16; 3]>,
    /// World box without stray points; `None` for no points, or a file left out.
    pub bounds: Option<Bounds>,
    /// What is framed of it: the points that were asked for; `None` where `bounds` are.
    pub hull: Option<Hull>,
    /// World box that no point lies outside of, as far as the header and the sample say; `None` where they do not.
    pub reach: Option<Bounds>,
    /// Points lie in the nodes that a COPC hierarchy has them in, as far as the sample says.
    pub in_nodes: bool,
    /// Who is wrong about where its chunks lie, as far as the sample says.
    pub contradicted: Option<Told>,
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
    /// Every point was.
    pub whole: bool,
    /// Cell size, density, coverage.
    pub cell: CellChoice,
    /// Of the points that were asked for (where there are none of them, of those shown by default, or of all); counts are
    /// estimates unless `whole`.
    pub attributes: AttributeSummary,
    /// Points of each class, hidden ones included; estimates unless `whole`.
    pub classes: Box<[u64; 256]>,
    /// Kinds of points that were seen, hidden ones included.
    pub kinds: Kinds,
    /// Where the points are that are shown by default, strays aside; `None` for no points.
    pub bounds: Option<Bounds>,
    /// What is framed of those that were asked for; `None` for no points.
    pub hull: Option<Hull>,
    /// The ground below them, roughly.
    pub low: LowSurface,
    /// What is not obvious about that.
    pub notes: Vec<FrameNote>,
    /// Chunks that could not be read (file, why); what they hold will be missing.
    pub problems: Vec<(usize, SourceError)>,
}

/// The points of the sample, each with how many it stands for, where they are in the world.
struct PointsOf<'a> {
    files: &'a [Opened],
    world: &'a World,
    weighted: &'a [Vec<(&'a Seen, f64)>],
}

impl PointsOf<'_> {
    fn place(&self, file: usize, seen: &Seen) -> DVec3 {
        let point = unpack(&self.files[file].file, seen.raw);
        let placement = self.world.placements[file].as_ref().expect("only files that are drawn are sampled");
        placement.place(point.x, point.y, point.z)
    }

    /// Those of a file that are to be shown.
    fn placed(&self, file: usize, shown: impl Fn(&Seen) -> bool) -> impl Iterator<Item = (DVec3, f64)> {
        let points = self.weighted[file].iter().filter(move |(seen, _)| shown(seen));
        let placed = points.map(move |(seen, weight)| (self.place(file, seen), *weight));
        placed.filter(|(point, _)| point.is_finite())
    }

    /// How well a file was seen; `whole`: as all of them.
    fn seen(&self, file: usize, whole: bool) -> shape::Seen {
        match self.files[file].file.chunks.len() {
            _ if whole => shape::Seen::Whole,
            frame::ENOUGH.. => shape::Seen::AllOver,
            _ => shape::Seen::InParts,
        }
    }

    /// What is framed of a file; `header`: what of its header's box counts.
    fn framed(
        &self,
        file: usize,
        shown: impl Fn(&Seen) -> bool,
        header: impl Fn(Bounds) -> Option<Bounds>,
        whole: bool,
    ) -> Option<frame::Framed> {
        let placement = self.world.placements[file].as_ref()?;
        let placed: Vec<(DVec3, f64)> = self.placed(file, shown).collect();
        let of = &self.files[file].file;
        // Points that are all known need no header; a header that leaves out the few that are known is wrong. Of a file
        // of another system the box is wider than what is in it; nothing may lie outside, since nothing is drawn there.
        let header = header_bounds(of, placement, DVec3::ZERO)
            .filter(|bounds| !(whole && placed.len() < frame::ENOUGH) && frame::holds_some(*bounds, &placed))
            .and_then(header);
        let beyond = match self.seen(file, whole) {
            shape::Seen::InParts => frame::SEEN_IN_PARTS,
            shape::Seen::Whole | shape::Seen::AllOver => frame::WELL_SEEN,
        };
        (of.points() > 0).then(|| frame::Framed::of(header, &placed, beyond))
    }
}

/// Takes the opening sample of `files` (sorted by path) and decides; `asked`: what is to be shown at first.
pub fn take(files: &[Opened], options: &PlacementOptions, asked: &Asked, budget: &SampleBudget) -> Sample {
    let mut problems = Vec::new();
    let firsts = read_firsts(files, budget, &mut problems);
    let world = World::of(&facts(files, &firsts), options);
    let drawn: Vec<usize> = (0..files.len()).filter(|&index| world.placements[index].is_some()).collect();
    let points: u64 = drawn.iter().map(|&index| files[index].file.points()).sum();

    let whole = points <= budget.whole;
    let places = match whole {
        true => places::every_place(files, &drawn),
        false => places::chosen_places(files, &drawn, points, budget),
    };
    let seen = read_places(files, &places, &mut problems);
    let heads = if whole { Vec::new() } else { places::heads(files, &drawn, points, budget) };
    // A chunk that is broken from its start is reported when it is drawn.
    let heads_seen = read_places(files, &heads, &mut Vec::new());
    let in_nodes: Vec<bool> =
        (0..files.len()).map(|index| in_nodes(&files[index].file, &firsts[index])).collect();
    let contradicted: Vec<Option<Told>> = files
        .iter()
        .zip(&firsts)
        .map(|(opened, firsts)| opened.known.contradicted(&opened.file, firsts.iter().map(|seen| seen.raw)))
        .collect();
    // A set that is read whole has its first points among the others.
    let firsts = if whole { vec![Vec::new(); files.len()] } else { firsts };
    let stored = rgb_of(files, &drawn, &firsts, &places, &seen, whole);
    let rgb = rgb::decide(files, &stored);

    // All three samples stand for the whole. Neighbours are alike, so a place, or the head of a chunk,
    // tells as much as a few points that are spread out.
    let spread_out: usize = drawn.iter().map(|&index| firsts[index].len()).sum();
    let worth = [spread_out as f64, HEAD_WORTH * heads.len() as f64, PLACE_WORTH * places.len() as f64];
    let share = worth.map(|part| points as f64 * part / worth.iter().sum::<f64>().max(1.0));
    let mut weighted: Vec<Vec<(&Seen, f64)>> = vec![Vec::new(); files.len()];
    for &index in &drawn {
        let part = files[index].file.points() as f64 / points.max(1) as f64;
        let weight = share[0] * part / firsts[index].len().max(1) as f64;
        weighted[index].extend(firsts[index].iter().map(|seen| (seen, weight)));
    }
    for (places, seen, share) in [(&heads, &heads_seen, share[1]), (&places, &seen, share[2])] {
        let weight = share / seen.iter().map(Vec::len).sum::<usize>().max(1) as f64;
        for (place, seen) in places.iter().zip(seen) {
            weighted[place.file].extend(seen.iter().map(|seen| (seen, weight)));
        }
    }

    let points_of = PointsOf { files, world: &world, weighted: &weighted };
    // Where everything is noise, noise is what is measured.
    let everything = weighted.iter().flatten().all(|(seen, _)| hidden_by_default(seen.class, seen.flags));
    let usual = |seen: &Seen| everything || !hidden_by_default(seen.class, seen.flags);
    let is_there = weighted.iter().flatten().any(|(seen, _)| asked.shows(seen.class, seen.flags));
    let shown = |seen: &Seen| if is_there { asked.shows(seen.class, seen.flags) } else { usual(seen) };
    let framed: Vec<frame::Framed> = (0..files.len())
        .map(|index| points_of.framed(index, &usual, |header| Some(header), whole).unwrap_or_default())
        .collect();
    let (frame, in_frame, notes) = frame::whole(&framed, |file| files[file].file.points(), whole);
    let hulls: Vec<Option<Hull>> = framed
        .iter()
        .enumerate()
        .map(|(index, framed)| {
            // Others than usual need not fill the box that the header has for all.
            let bounds = match *asked == Asked::default() || !is_there {
                true => framed.bounds,
                false => points_of.framed(index, &shown, |_| None, whole).and_then(|framed| framed.bounds),
            };
            let points = points_of.placed(index, &shown).map(|(point, _)| point);
            bounds.map(|bounds| {
                shape(
                    &bounds,
                    points.filter(|point| framed.keeps(*point)),
                    drawn.len(),
                    points_of.seen(index, whole),
                )
            })
        })
        .collect();
    let hull = Hull::union(in_frame.iter().filter_map(|&file| hulls[file].as_ref()));
    let mut kinds = Kinds::new();
    let mut classes = vec![0.0; 256];
    let (mut shown_points, mut places_shown) = (Vec::new(), Vec::new());
    for (file, points) in weighted.iter().enumerate() {
        for &(seen, weight) in points {
            kinds.insert((seen.class, seen.flags & FLAG_WITHHELD != 0));
            classes[usize::from(seen.class)] += weight;
            let at = points_of.place(file, seen);
            if shown(seen) && at.is_finite() && framed[file].keeps(at) {
                places_shown.push(at);
                shown_points.push(Shown { seen, weight, u: at.z, rgb: rgb[file].to_8_bit(seen.rgb) });
            }
        }
    }
    let nowhere = Bounds { min: DVec3::ZERO, max: DVec3::ZERO };
    let low = LowSurface::of(&hull.as_ref().map_or(nowhere, Hull::bounds), &places_shown);
    let above = |hull: Option<Hull>| hull.map(|hull| hull.above(&low));
    let (hull, hulls): (_, Vec<_>) = (above(hull), hulls.into_iter().map(above).collect());
    let bounds: Vec<Option<Bounds>> = framed.iter().map(|framed| framed.bounds).collect();
    let ground = ground::Ground {
        files,
        budget,
        drawn: &drawn,
        firsts: &firsts,
        whole,
        shown: &shown,
        place: &|file, seen| points_of.place(file, seen),
        bounds: &bounds,
    };
    let patches = ground::patches(&places, &seen, &ground);
    let reach = |index: usize| {
        let (file, placement) = (&files[index].file, world.placements[index].as_ref()?);
        // Headers round; a step more holds what they mean, however small cells are.
        let header = header_bounds(file, placement, file.header.scale.abs())?;
        let inside = |(seen, _): &(&Seen, f64)| {
            let point = points_of.place(index, seen);
            point.cmpge(header.min).all() && point.cmple(header.max).all()
        };
        weighted[index].iter().all(inside).then_some(header)
    };
    let finest = drawn.iter().map(|&index| files[index].file.header.scale.truncate().min_element());
    Sample {
        points,
        sampled: weighted.iter().map(Vec::len).sum::<usize>() as u64,
        whole,
        cell: cell::choose(&patches, finest.fold(f64::INFINITY, f64::min)),
        attributes: summarise(&shown_points, drawn.iter().any(|&index| rgb::has_rgb(&files[index].file))),
        classes: counts(&classes),
        kinds,
        bounds: frame,
        hull: hull.or_else(|| frame.as_ref().map(Hull::from)),
        low,
        notes,
        files: (0..)
            .zip(rgb)
            .zip(&bounds)
            .zip(hulls)
            .map(|(((index, rgb), &bounds), hull)| {
                let (reach, in_nodes, contradicted) = (reach(index), in_nodes[index], contradicted[index]);
                let rgb_constant = rgb::constant(&stored[index]).filter(|_| rgb != RgbDepth::None);
                FileSample { rgb, rgb_constant, bounds, hull, reach, in_nodes, contradicted }
            })
            .collect(),
        problems,
        world,
    }
}
