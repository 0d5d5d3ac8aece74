//! The ground at the sampled places: what the cell size is chosen from.

use super::budget::SampleBudget;
use super::cell::{self, GroundPatch};
use super::frame;
use super::open::Opened;
use super::parallel::parallel;
use super::places::Place;
use super::quantile::median;
use super::seen::{Seen, append, unpack};
use crate::coords::Bounds;
use crate::source::{Fields, PointBlock, Selection};
use glam::{DVec2, DVec3};
use std::collections::HashSet;

/// The patches that the cell size is chosen from: different E, N of points that count at each place. A place
/// of a set that is not read whole is one pass over its ground; how many there are follows from the ground
/// that all points would cover at the places' density, and the ground that there is. Where there are
/// several, their points may be thinned against each other, so chunks of the other passes are read too.
pub(super) fn patches(places: &[Place], seen: &[Vec<Seen>], ground: &Ground) -> Vec<GroundPatch> {
    let mut patches: Vec<GroundPatch> = Vec::new();
    let mut known = HashSet::new();
    for (at, seen) in places.iter().zip(seen) {
        if !ground.whole || patches.is_empty() {
            known.clear();
            patches.push(GroundPatch { points: Vec::new(), passes: 1.0 });
        }
        let patch = patches.last_mut().expect("pushed above");
        for seen in seen.iter().filter(|seen| (ground.counts)(seen)) {
            let raw = unpack(&ground.files[at.file].file, seen.raw);
            let inside = at.window.is_none_or(|[west, south, east, north]| {
                (west..east).contains(&raw.x) && (south..north).contains(&raw.y)
            });
            let point = (ground.place)(at.file, seen);
            if inside && point.is_finite() && known.insert([point.x.to_bits(), point.y.to_bits()]) {
                patch.points.push([point.x, point.y]);
            }
        }
    }
    let is_run = |index: &usize| places[*index].window.is_none() && !patches[*index].points.is_empty();
    let runs: Vec<usize> = if ground.whole { Vec::new() } else { (0..places.len()).filter(is_run).collect() };
    let spacing = (1.0 / cell::choose(&patches, 0.0).density).sqrt();
    if runs.is_empty() || !spacing.is_finite() {
        return patches;
    }
    // COPC files are read in windows.
    let in_runs: Vec<usize> =
        ground.drawn.iter().copied().filter(|&index| ground.files[index].file.copc.is_none()).collect();
    let points: u64 = in_runs.iter().map(|&index| ground.files[index].file.points()).sum();
    let boxes: Vec<Bounds> = in_runs.iter().filter_map(|&index| ground.bounds[index]).collect();
    let looked_at: usize = runs.iter().map(|&run| seen[run].len()).sum();
    let areas: Vec<f64> =
        runs.iter().map(|&run| cell::footprint_area(&patches[run].points, spacing)).collect();
    let all_once = areas.iter().sum::<f64>() * points as f64 / looked_at as f64;
    // Neither can there be less than one, nor does anyone fly more than a few dozen.
    let passes = (all_once / frame::covered_area(&boxes)).clamp(1.0, 64.0);
    if passes.is_nan() || passes < SEVERAL_PASSES {
        return patches;
    }
    let density = runs.iter().map(|&run| patches[run].points.len() as f64).sum::<f64>()
        / areas.iter().sum::<f64>()
        * passes;
    let mut windows: Vec<Window> = runs
        .iter()
        .zip(&areas)
        .map(|(&run, area)| {
            let patch = &patches[run];
            let center = median(patch.points.iter().map(|p| DVec3::new(p[0], p[1], 0.0))).truncate();
            let reach = area.sqrt() / 2.0;
            let mut window =
                Window { center, reach, points: Vec::new(), known: HashSet::new(), chunks: Vec::new() };
            window.take(&patch.points);
            window.chunks = chunks_near(ground, center, reach, &places[run]);
            window.chunks.reverse();
            window
        })
        .collect();
    let is_open = |window: &Window| {
        // Until all passes are there.
        !window.chunks.is_empty() && window.points.len() as f64 <= 0.9 * density * window.reach * window.reach
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    loop {
        let open: Vec<usize> = (0..windows.len()).filter(|&index| is_open(&windows[index])).collect();
        if open.is_empty() {
            break;
        }
        // Where there are cores to spare, more than one chunk of each at a time; what then is too much is left out, so
        // that the number of cores changes nothing.
        let each = (threads / open.len()).max(1);
        let jobs: Vec<(usize, (usize, usize))> = open
            .iter()
            .flat_map(|&index| {
                windows[index].chunks.iter().rev().take(each).map(move |&chunk| (index, chunk))
            })
            .collect();
        let read = parallel(jobs.len(), |decoder, job| {
            let (_, (file, chunk)) = jobs[job];
            let lidar = &ground.files[file].file;
            let mut seen = Vec::new();
            decoder.set_fields(Fields::default());
            let sink = &mut |block: &PointBlock| append(block, &Selection::default(), &mut seen);
            // A broken chunk is reported when it is drawn; here it only tells less.
            let _ = decoder.decode(lidar, &lidar.chunks[chunk], 0..ground.budget.place_points, sink);
            lidar.bytes.release();
            let points = seen.iter().filter(|seen| (ground.counts)(seen));
            let points = points.map(|seen| (ground.place)(file, seen));
            points.map(|point| [point.x, point.y]).collect::<Vec<_>>()
        });
        for ((index, _), points) in jobs.into_iter().zip(read) {
            if is_open(&windows[index]) {
                windows[index].chunks.pop();
                windows[index].take(&points);
            }
        }
    }
    let windows = windows.into_iter().zip(&runs).map(|(Window { points, .. }, &run)| {
        // Where the middle of a pass is a void, the pass itself has to do.
        if points.len() < patches[run].points.len() / 8 {
            return GroundPatch { points: patches[run].points.clone(), passes };
        }
        let here = points.len() as f64 / cell::footprint_area(&points, spacing);
        GroundPatch { points, passes: (density / here).clamp(1.0, passes) }
    });
    let windows: Vec<GroundPatch> = windows.collect();
    for (run, window) in runs.into_iter().zip(windows) {
        patches[run] = window;
    }
    patches
}

/// Points of all passes about the middle of a place.
struct Window {
    center: DVec2,
    reach: f64,
    /// No two alike.
    points: Vec<[f64; 2]>,
    known: HashSet<[u64; 2]>,
    /// Chunks that may hold more (file, index), the nearest last.
    chunks: Vec<(usize, usize)>,
}

impl Window {
    fn take(&mut self, points: &[[f64; 2]]) {
        for point in points {
            let is_inside = (DVec2::from_array(*point) - self.center).abs().max_element() <= self.reach / 2.0;
            if is_inside && self.known.insert(point.map(f64::to_bits)) {
                self.points.push(*point);
            }
        }
    }
}

/// Passes from which on those of one place are looked for.
const SEVERAL_PASSES: f64 = 1.2;
/// Most chunks read around a place.
const NEIGHBOURS: usize = 6;

/// Chunks (file, index) that seem to lie within `reach` of `center`: points are mostly stored in the order
/// of flight, so a chunk lies along the way from its first point to the next chunk's.
fn chunks_near(ground: &Ground, center: DVec2, reach: f64, not: &Place) -> Vec<(usize, usize)> {
    let mut near = Vec::new();
    for (file, firsts) in ground.firsts.iter().enumerate() {
        // Of large files not every chunk's first point is known.
        let known = firsts.len() == ground.files[file].file.chunks.len();
        if !known || ground.bounds[file].is_none_or(|b| distance_to_box(center, b) > 2.0 * reach) {
            continue;
        }
        let at = |index: usize| (ground.place)(file, &firsts[index]).truncate();
        for chunk in 0..firsts.len() {
            if file == not.file && not.chunks.iter().any(|(own, _)| *own == chunk) {
                continue;
            }
            let (from, to) = (at(chunk), at((chunk + 1).min(firsts.len() - 1)));
            let way = to - from;
            let along =
                ((center - from).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            let distance = center.distance(from + way * along);
            if distance <= 2.0 * reach {
                near.push((distance, file, chunk));
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    near.truncate(NEIGHBOURS);
    near.into_iter().map(|(_, file, chunk)| (file, chunk)).collect()
}

fn distance_to_box(point: DVec2, bounds: Bounds) -> f64 {
    point.distance(point.clamp(bounds.min.truncate(), bounds.max.truncate()))
}

/// What [`patches`] must know.
pub(super) struct Ground<'a> {
    pub files: &'a [Opened],
    pub budget: &'a SampleBudget,
    /// Files that are drawn.
    pub drawn: &'a [usize],
    /// First points of chunks, a file.
    pub firsts: &'a [Vec<Seen>],
    /// The places are all there is.
    pub whole: bool,
    /// Whether a point counts.
    pub counts: &'a (dyn Fn(&Seen) -> bool + Sync),
    /// World coordinates of a point of a file.
    pub place: &'a (dyn Fn(usize, &Seen) -> DVec3 + Sync),
    /// A file; none where there are no points.
    pub bounds: &'a [Option<Bounds>],
}
