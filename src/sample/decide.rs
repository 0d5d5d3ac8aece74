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
use super::seen::{Seen, hidden_by_default, unpack};
use super::summary::{Shown, summarise};
use crate::attribute::{AttributeSummary, Kinds};
use crate::coords::Bounds;
use crate::source::known::Told;
use crate::source::placement::{PlacementOptions, World};
use crate::source::{FLAG_WITHHELD, SourceError};
use glam::DVec3;
use std::collections::BTreeMap;

/// Points spread over the set that one place of neighbouring points is worth.
const PLACE_WORTH: f64 = 250.0;
/// Likewise the head of a chunk.
const HEAD_WORTH: f64 = 40.0;

/// The kinds of points (class, withheld) that the sample has seen of a file.
#[derive(Clone, Debug, Default)]
pub struct SampledKinds {
    /// What they weigh among each other; points, where `is_whole`.
    pub weights: BTreeMap<(u8, bool), f64>,
    /// Every point of the file was seen.
    pub is_whole: bool,
}

impl SampledKinds {
    fn of(seen: &[(&Seen, f64)], is_whole: bool) -> SampledKinds {
        let mut weights = BTreeMap::new();
        for (seen, weight) in seen {
            let kind = (seen.class, seen.flags & FLAG_WITHHELD != 0);
            *weights.entry(kind).or_default() += if is_whole { 1.0 } else { *weight };
        }
        SampledKinds { weights, is_whole }
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
    /// World box that no point lies outside of, as far as the header and the sample say; `None` where they do not.
    pub reach: Option<Bounds>,
    /// Points lie in the nodes that a COPC hierarchy has them in, as far as the sample says.
    pub in_nodes: bool,
    /// Who is wrong about where its chunks lie, as far as the sample says.
    pub contradicted: Option<Told>,
    /// What its points are, as far as they were seen.
    pub kinds: SampledKinds,
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
    /// Of the points shown by default (of all, where none is); counts are estimates unless `whole`.
    pub attributes: AttributeSummary,
    /// Kinds of points that were seen, hidden ones included.
    pub kinds: Kinds,
    /// What is to be framed; `None` for no points.
    pub bounds: Option<Bounds>,
    /// What is not obvious about that.
    pub notes: Vec<FrameNote>,
    /// Chunks that could not be read (file, why); what they hold will be missing.
    pub problems: Vec<(usize, SourceError)>,
}

/// Takes the opening sample of `files` (sorted by path) and decides.
pub fn take(files: &[Opened], options: &PlacementOptions, budget: &SampleBudget) -> Sample {
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

    // Where everything is noise, noise is what is measured.
    let everything = weighted.iter().flatten().all(|(seen, _)| hidden_by_default(seen.class, seen.flags));
    let shown = |seen: &Seen| everything || !hidden_by_default(seen.class, seen.flags);
    let place = |file: usize, seen: &Seen| {
        let point = unpack(&files[file].file, seen.raw);
        let placement = world.placements[file].as_ref().expect("only files that are drawn are sampled");
        placement.place(point.x, point.y, point.z)
    };
    let framed = |index: usize| {
        let placement = world.placements[index].as_ref()?;
        let placed = weighted[index].iter().filter(|(seen, _)| shown(seen));
        let placed = placed.map(|(seen, weight)| (place(index, seen), *weight));
        let placed: Vec<(DVec3, f64)> = placed.filter(|(point, _)| point.is_finite()).collect();
        let file = &files[index].file;
        // Points that are all known need no header; a header that leaves out the few that are known is wrong. Of a file
        // of another system the box is wider than what is in it; nothing may lie outside, since nothing is drawn there.
        let header = header_bounds(file, placement, DVec3::ZERO)
            .filter(|bounds| !(whole && placed.len() < frame::ENOUGH) && frame::holds_some(*bounds, &placed));
        (file.points() > 0).then(|| frame::Framed::of(header, &placed))
    };
    let framed: Vec<frame::Framed> =
        (0..files.len()).map(|index| framed(index).unwrap_or_default()).collect();
    let mut kinds = Kinds::new();
    let mut shown_points = Vec::new();
    for (file, points) in weighted.iter().enumerate() {
        for &(seen, weight) in points {
            kinds.insert((seen.class, seen.flags & FLAG_WITHHELD != 0));
            let at = place(file, seen);
            if shown(seen) && at.is_finite() && framed[file].keeps(at) {
                shown_points.push(Shown { seen, weight, u: at.z, rgb: rgb[file].to_8_bit(seen.rgb) });
            }
        }
    }
    let bounds: Vec<Option<Bounds>> = framed.iter().map(|framed| framed.bounds).collect();
    let ground = ground::Ground {
        files,
        budget,
        drawn: &drawn,
        firsts: &firsts,
        whole,
        shown: &shown,
        place: &place,
        bounds: &bounds,
    };
    let patches = ground::patches(&places, &seen, &ground);
    let reach = |index: usize| {
        let (file, placement) = (&files[index].file, world.placements[index].as_ref()?);
        // Headers round; a step more holds what they mean, however small cells are.
        let header = header_bounds(file, placement, file.header.scale.abs())?;
        let inside = |(seen, _): &(&Seen, f64)| {
            let point = place(index, seen);
            point.cmpge(header.min).all() && point.cmple(header.max).all()
        };
        weighted[index].iter().all(inside).then_some(header)
    };
    let finest = drawn.iter().map(|&index| files[index].file.header.scale.truncate().min_element());
    let (frame, notes) = frame::whole(&framed, |file| files[file].file.points(), whole);
    Sample {
        points,
        sampled: weighted.iter().map(Vec::len).sum::<usize>() as u64,
        whole,
        cell: cell::choose(&patches, finest.fold(f64::INFINITY, f64::min)),
        attributes: summarise(&shown_points, drawn.iter().any(|&index| rgb::has_rgb(&files[index].file))),
        kinds,
        bounds: frame,
        notes,
        files: (0..)
            .zip(rgb)
            .zip(&bounds)
            .map(|((index, rgb), &bounds)| {
                let (reach, in_nodes, contradicted) = (reach(index), in_nodes[index], contradicted[index]);
                let rgb_constant = rgb::constant(&stored[index]).filter(|_| rgb != RgbDepth::None);
                let (seen, all) = (&weighted[index], files[index].file.points());
                let kinds = SampledKinds::of(seen, whole && seen.len() as u64 == all);
                FileSample { rgb, rgb_constant, bounds, reach, in_nodes, contradicted, kinds }
            })
            .collect(),
        problems,
        world,
    }
}
