//! The opening sample, and what is decided from it once for all files: placement, cell size, framing,
//! how RGB is stored, what colours are chosen by. Nothing here depends on the order of reading, on
//! threads, or on how the files were named.
//!
//! Sets of up to 250,000 points are read whole. Of larger ones it reads the first point of (at most
//! 65,536) chunks, the first 1,024 points of 64 chunks, and whole chunks at four places of the set, about
//! 50,000 points each; of a COPC file the nodes over a few small windows instead. Where flight lines overlap, chunks of the other lines are read
//! around each place, at most six. Files with RGB that this leaves with few points are read 256 points
//! further.

mod cell;
mod centre;
mod frame;
mod ground;
mod places;
mod rgb;

pub use cell::{CellChoice, Patch, choose as choose_cell};
pub use frame::{Bounds, FrameNote};
pub use rgb::RgbDepth;

use crate::attribute::{AttributeSummary, Kinds, Spread};
use crate::source::crs::{self, Crs, CrsError};
use crate::source::known::{Known, Told};
use crate::source::placement::{FileFacts, Placement, PlacementOptions, World};
use crate::source::{Decoder, FLAG_WITHHELD, LayerMemory, LidarFile, PointBlock, SourceError};
use glam::DVec3;
use places::Place;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How much is read.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// A set of this many points is read whole.
    pub whole: u64,
    /// Places at which whole chunks are read.
    pub places: u64,
    /// Points wanted at a place.
    pub place_points: u64,
    /// Most points decoded for one window of a COPC file, which takes nodes of every level.
    pub window_points: u64,
    /// First points over all files.
    pub first_points: usize,
    /// Chunks of which the first 1,024 points are read.
    pub heads: u64,
}

impl Default for Budget {
    fn default() -> Budget {
        Budget {
            whole: 250_000,
            places: 4,
            place_points: 50_000,
            window_points: 400_000,
            first_points: 65_536,
            heads: 64,
        }
    }
}

/// Bytes that all threads together may hold for layered chunks.
const DECODER_BYTES: u64 = 256 << 20;
/// A file with RGB and fewer sampled points than this is read a little further.
const RGB_POINTS: usize = 256;
/// Points spread over the set that one place of neighbouring points is worth.
const PLACE_WORTH: f64 = 250.0;
/// Likewise the head of a chunk.
const HEAD_WORTH: f64 = 40.0;
/// Most files that are read further.
const RGB_FILES: usize = 512;

/// A file that is open, and the coordinate system it names.
#[derive(Debug)]
pub struct Opened {
    /// Header, records, chunks.
    pub file: LidarFile,
    /// Its coordinate system.
    pub crs: Option<Crs>,
    /// Definitions that had to be passed over.
    pub crs_errors: Vec<CrsError>,
    /// What is known of where its chunks lie, beside what it says itself: nothing, unless somebody has looked.
    pub known: Known,
}

/// Opens every path on all cores; results in the order of `paths`. Handles are released again: thousands
/// of files may be listed at a time.
pub fn open_all(paths: &[PathBuf]) -> Vec<Result<Opened, SourceError>> {
    let open = |path: &Path| {
        let file = LidarFile::open(path)?;
        let (crs, crs_errors) = crs::of_file(&file)?;
        file.bytes.release();
        Ok(Opened { file, crs, crs_errors, known: Known::default() })
    };
    parallel(paths.len(), |_, index| open(&paths[index]))
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

/// Whether a point is hidden unless asked for: noise and withheld.
#[inline]
pub fn hidden_by_default(class: u8, flags: u8) -> bool {
    matches!(class, 7 | 18) || flags & FLAG_WITHHELD != 0
}

/// A point of the sample.
#[derive(Clone, Copy, Debug)]
struct Seen {
    raw: [i32; 3],
    class: u8,
    flags: u8,
    returns: u8,
    intensity: u16,
    rgb: [u16; 3],
}

fn append(block: &PointBlock, seen: &mut Vec<Seen>) {
    seen.extend((0..block.len()).map(|i| Seen {
        raw: [block.x[i], block.y[i], block.z[i]],
        class: block.class[i],
        flags: block.flags[i],
        returns: block.returns[i],
        intensity: block.intensity[i],
        rgb: block.rgb.get(i).copied().unwrap_or_default(),
    }));
}

/// File coordinates of a raw point.
fn unpack(file: &LidarFile, raw: [i32; 3]) -> DVec3 {
    let (scale, offset) = (file.header.scale, file.header.offset);
    let [x, y, z] = raw.map(f64::from);
    DVec3::new(x * scale.x + offset.x, y * scale.y + offset.y, z * scale.z + offset.z)
}

/// Takes the opening sample of `files` (sorted by path) and decides.
pub fn take(files: &[Opened], options: &PlacementOptions, budget: &Budget) -> Sample {
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
            .filter(|bounds| !(whole && placed.len() < frame::ENOUGH) && bounds.holds_some(&placed));
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
                FileSample { rgb, rgb_constant, bounds, reach, in_nodes, contradicted }
            })
            .collect(),
        problems,
        world,
    }
}

/// The first points of chunks of every file: where it lies, and a thin sample over all of it.
fn read_firsts(
    files: &[Opened],
    budget: &Budget,
    problems: &mut Vec<(usize, SourceError)>,
) -> Vec<Vec<Seen>> {
    let most = (budget.first_points / files.len().max(1)).max(1);
    let firsts = parallel(files.len(), |decoder, index| {
        let file = &files[index].file;
        let mut seen = Vec::new();
        let read = match file.chunks.is_empty() {
            true => Ok(()),
            false => decoder.first_points(file, most).map(|block| append(block, &mut seen)),
        };
        file.bytes.release();
        (seen, read.err())
    });
    let unpacked = firsts.into_iter().enumerate().map(|(index, (seen, error))| {
        problems.extend(error.map(|error| (index, error)));
        seen
    });
    unpacked.collect()
}

/// Whether the first points of chunks, at an even stride, lie in the nodes that the chunks are.
fn in_nodes(file: &LidarFile, firsts: &[Seen]) -> bool {
    let stride = file.chunks.len().div_ceil(firsts.len().max(1)).max(1);
    !firsts.is_empty()
        && file.chunks.iter().step_by(stride).zip(firsts).all(|(chunk, seen)| {
            let Some([low, high]) = file.chunk_bounds(chunk) else { return false };
            let (point, scale) = (unpack(file, seen.raw), file.header.scale.abs());
            point.cmpge(low - scale).all() && point.cmple(high + scale).all()
        })
}

fn facts<'a>(files: &'a [Opened], firsts: &[Vec<Seen>]) -> Vec<FileFacts<'a>> {
    let centres = centre::of_files(files, firsts);
    let facts = |((Opened { file, crs, .. }, seen), centre): ((&'a Opened, &Vec<Seen>), DVec3)| FileFacts {
        path: file.path(),
        crs: crs.as_ref(),
        points: file.points(),
        centre,
        extent: extent(file, seen),
        step: file.header.scale.truncate().max_element(),
    };
    files.iter().zip(firsts).zip(centres).map(facts).collect()
}

/// First points from which on their spread tells how wide a file is; with fewer its header does.
const TELLING: usize = 50;

/// How far a file's points spread, file coordinates: strays aside, as far as the first points show.
fn extent(file: &LidarFile, firsts: &[Seen]) -> DVec3 {
    if firsts.len() < TELLING {
        let of_header = file.header.max - file.header.min;
        return if of_header.is_finite() { of_header.max(DVec3::ZERO) } else { DVec3::ZERO };
    }
    let points: Vec<DVec3> = firsts.iter().map(|seen| unpack(file, seen.raw)).collect();
    let spread = |axis: usize| {
        let mut values: Vec<(f64, f64)> = points.iter().map(|point| (point[axis], 1.0)).collect();
        let mut at = |share| quantile(&mut values, share).unwrap_or(0.0);
        at(0.95) - at(0.05)
    };
    DVec3::new(spread(0), spread(1), spread(2))
}

/// The points of each place.
fn read_places(
    files: &[Opened],
    places: &[Place],
    problems: &mut Vec<(usize, SourceError)>,
) -> Vec<Vec<Seen>> {
    // Chunk by chunk: two tiles of a few chunks keep all cores busy.
    let jobs: Vec<(usize, usize, u64)> = places
        .iter()
        .enumerate()
        .flat_map(|(place, at)| at.chunks.iter().map(move |&(chunk, records)| (place, chunk, records)))
        .collect();
    let left: Vec<AtomicUsize> = places.iter().map(|place| AtomicUsize::new(place.chunks.len())).collect();
    let read = parallel(jobs.len(), |decoder, index| {
        let (place, chunk, records) = jobs[index];
        let file = &files[places[place].file].file;
        let mut seen = Vec::new();
        let sink = &mut |block: &PointBlock| append(block, &mut seen);
        let error = decoder.decode(file, &file.chunks[chunk], 0..records, sink).err();
        if left[place].fetch_sub(1, Ordering::Relaxed) == 1 {
            file.bytes.release();
        }
        (seen, error)
    });
    let mut of_places = vec![Vec::new(); places.len()];
    for ((place, ..), (seen, error)) in jobs.into_iter().zip(read) {
        problems.extend(error.map(|error| (places[place].file, error)));
        if of_places[place].is_empty() {
            of_places[place] = seen;
        } else {
            of_places[place].extend(seen);
        }
    }
    of_places
}

/// RGB of sampled points a file; where those are few, of some more.
fn rgb_of(
    files: &[Opened],
    drawn: &[usize],
    firsts: &[Vec<Seen>],
    places: &[Place],
    seen: &[Vec<Seen>],
    whole: bool,
) -> Vec<Vec<[u16; 3]>> {
    let mut rgb: Vec<Vec<[u16; 3]>> =
        firsts.iter().map(|seen| seen.iter().map(|seen| seen.rgb).collect()).collect();
    for (place, seen) in places.iter().zip(seen) {
        rgb[place.file].extend(seen.iter().map(|seen| seen.rgb));
    }
    let thin = |index: &usize| !whole && rgb::has_rgb(&files[*index].file) && rgb[*index].len() < RGB_POINTS;
    let thin: Vec<usize> = drawn.iter().copied().filter(thin).take(RGB_FILES).collect();
    let more = parallel(thin.len(), |decoder, index| {
        let file = &files[thin[index]].file;
        let mut more = Vec::new();
        // A broken chunk is reported when it is drawn; here it only tells less.
        if let Some(chunk) = file.chunks.get(file.chunks.len() / 2) {
            let sink = &mut |block: &PointBlock| more.extend_from_slice(&block.rgb);
            let _ = decoder.decode(file, chunk, 0..RGB_POINTS as u64, sink);
        }
        file.bytes.release();
        more
    });
    thin.into_iter().zip(more).for_each(|(index, more)| rgb[index].extend(more));
    rgb
}

/// A point that is shown by default, and how many it stands for.
struct Shown<'a> {
    seen: &'a Seen,
    weight: f64,
    u: f64,
    rgb: [u8; 3],
}

fn summarise(shown: &[Shown], has_rgb: bool) -> AttributeSummary {
    let (mut classes, mut returns) = (vec![0.0; 256], vec![0.0; 256]);
    for point in shown {
        classes[usize::from(point.seen.class)] += point.weight;
        returns[usize::from(point.seen.returns)] += point.weight;
    }
    let total = |keep: &dyn Fn(&Shown) -> bool| {
        shown.iter().filter(|point| keep(point)).map(|point| point.weight).sum::<f64>().round() as u64
    };
    let first = shown.first().map_or([0; 3], |point| point.rgb);
    AttributeSummary {
        points: total(&|_| true),
        height: spread(shown.iter().map(|point| (point.u, point.weight))),
        intensity: spread(shown.iter().map(|point| (f64::from(point.seen.intensity), point.weight))),
        classes: counts(&classes),
        returns: counts(&returns),
        has_rgb,
        colored: total(&|point| point.rgb != [0; 3]),
        rgb_constant: shown.iter().all(|point| point.rgb == first).then_some(first),
    }
}

/// Whole points; what was seen at all is never 0.
fn counts(weights: &[f64]) -> Box<[u64; 256]> {
    let count = |&weight: &f64| if weight > 0.0 { (weight.round() as u64).max(1) } else { 0 };
    let counts: Vec<u64> = weights.iter().map(count).collect();
    counts.into_boxed_slice().try_into().expect("one a class")
}

/// Spread of (value, weight). Strays lie more than ten spans of percentiles 1-99 away; without a span
/// nothing tells a stray from a roof, and all values count.
fn spread(values: impl Iterator<Item = (f64, f64)>) -> Spread {
    let mut values: Vec<(f64, f64)> = values.filter(|(value, _)| value.is_finite()).collect();
    let mut at = |share| quantile(&mut values, share);
    let (Some(p1), Some(p2), Some(p98), Some(p99)) = (at(0.01), at(0.02), at(0.98), at(0.99)) else {
        return Spread::default();
    };
    let reach = if p99 > p1 { 10.0 * (p99 - p1) } else { f64::INFINITY };
    let near =
        values.iter().map(|(value, _)| *value).filter(|value| (p1 - reach..=p99 + reach).contains(value));
    let (min, max) = near.fold((p1, p99), |(min, max), value| (value.min(min), value.max(max)));
    Spread { min, max, p2, p98 }
}

/// Header bounds in the world, where points of the file can lie at them, wider by `slack` file units on each side.
fn header_bounds(file: &LidarFile, placement: &Placement, slack: DVec3) -> Option<Bounds> {
    let (min, max) = (file.header.min, file.header.max);
    // Raw coordinates are i32; half a step is what rounding takes.
    let stored = |corner: DVec3| {
        ((corner - file.header.offset) / file.header.scale).abs().max_element() < 2_147_483_648.5
    };
    if !placement.keeps_axes() || !stored(min) || !stored(max) || !min.cmple(max).all() {
        return None;
    }
    let [min, max] = placement.bounds(min - slack, max + slack)?;
    Bounds::new(min, max)
}

/// The value below which `share` of the weight lies; sorts `values` (value, weight).
fn quantile(values: &mut [(f64, f64)], share: f64) -> Option<f64> {
    if !values.is_sorted_by(|a, b| a.0 <= b.0) {
        values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    }
    let total: f64 = values.iter().map(|(_, weight)| weight).sum();
    let mut below = 0.0;
    for (value, weight) in values.iter() {
        below += weight;
        if below >= share * total {
            return Some(*value);
        }
    }
    values.last().map(|(value, _)| *value)
}

/// The middle of the finite points, each axis by itself; NaN if there is none.
fn median(points: impl Iterator<Item = DVec3>) -> DVec3 {
    let points: Vec<DVec3> = points.filter(|point| point.is_finite()).collect();
    let axis = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    DVec3::new(axis(0), axis(1), axis(2))
}

/// Runs `job` for 0..count on all cores, each thread with a decoder of its own; results in order.
pub(crate) fn parallel<T: Send>(count: usize, job: impl Fn(&mut Decoder, usize) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(count);
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<T>>> = Mutex::new((0..count).map(|_| None).collect());
    let layers = LayerMemory::new(DECODER_BYTES);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut decoder = Decoder::sharing(&layers);
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        break;
                    }
                    let result = job(&mut decoder, index);
                    done.lock().expect("no job panics while it holds the lock")[index] = Some(result);
                }
            });
        }
    });
    let done = done.into_inner().expect("all threads have ended");
    done.into_iter().map(|result| result.expect("every index was taken")).collect()
}
