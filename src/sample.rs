//! The opening sample, and what is decided from it once for all files: placement, cell size, framing,
//! colour. Nothing here depends on the order of reading, on threads, or on how the files were named.
//!
//! Sets of up to 250,000 points are read whole. Of larger ones it reads the first point of (at most
//! 65,536) chunks, and whole chunks at four places of the set, about 50,000 points each; of a COPC file the
//! nodes over a few small windows instead. Files with RGB that this leaves with few points are read 256
//! points further.

mod cell;
mod frame;

pub use cell::{CellChoice, Patch, choose as choose_cell};
pub use frame::Bounds;

use crate::source::crs::{self, Crs, CrsError};
use crate::source::placement::{FileFacts, Placement, PlacementOptions, World};
use crate::source::{Chunk, Copc, Decoder, FLAG_WITHHELD, LidarFile, PointBlock, SourceError, VoxelKey};
use glam::{DVec2, DVec3};
use std::collections::{HashMap, HashSet};
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
}

impl Default for Budget {
    fn default() -> Budget {
        Budget {
            whole: 250_000,
            places: 4,
            place_points: 50_000,
            window_points: 400_000,
            first_points: 65_536,
        }
    }
}

/// Bytes a thread may hold for one layered chunk.
const DECODER_BYTES: u64 = 256 << 20;
/// A file with RGB and fewer sampled points than this is read a little further.
const RGB_POINTS: usize = 256;
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
}

/// Opens every path on all cores; results in the order of `paths`. Handles are released again: thousands
/// of files may be listed at a time.
pub fn open_all(paths: &[PathBuf]) -> Vec<Result<Opened, SourceError>> {
    let open = |path: &Path| {
        let file = LidarFile::open(path)?;
        let (crs, crs_errors) = crs::of_file(&file)?;
        file.bytes.release();
        Ok(Opened { file, crs, crs_errors })
    };
    parallel(paths.len(), |_, index| open(&paths[index]))
}

/// What a file's RGB fields hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Rgb {
    /// The format has no such fields.
    Absent,
    /// The same everywhere (most often zero): no colour.
    Constant,
    /// 0 to 255.
    Eight,
    /// 0 to 65,535.
    Sixteen,
}

impl Rgb {
    /// Whether there is colour to show.
    pub fn is_color(self) -> bool {
        matches!(self, Rgb::Eight | Rgb::Sixteen)
    }
}

/// What `--color auto` comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AutoColor {
    /// 5 % of the sample or more has a colour that is not zero.
    Rgb,
    /// More than 10 % is in a class that tells something: not 0, 1, 2, 7, 12, 18.
    Class,
    /// Neither.
    Height,
}

/// Where given shares of an attribute's values lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Percentiles {
    /// 0.5 % of the values lie below.
    pub p0_5: f64,
    /// 2 %.
    pub p2: f64,
    /// Half of them.
    pub p50: f64,
    /// 98 %.
    pub p98: f64,
    /// 99.5 %.
    pub p99_5: f64,
}

/// Attributes with one value only, which are drawn grey and named.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Constant {
    /// ASPRS class.
    pub class: bool,
    /// Intensity.
    pub intensity: bool,
    /// Return number and number of returns.
    pub returns: bool,
}

/// What the sample says of one file.
#[derive(Clone, Debug)]
pub struct FileSample {
    /// Decided here once for all its points.
    pub rgb: Rgb,
    /// World box without stray points; `None` for no points, or a file left out.
    pub bounds: Option<Bounds>,
    /// Over the file's sampled points.
    pub constant: Constant,
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
    /// U of shown points, world units.
    pub height: Percentiles,
    /// Intensity of shown points.
    pub intensity: Percentiles,
    /// Points of each class, hidden ones included; estimates unless `whole`.
    pub classes: Box<[f64; 256]>,
    /// What is to be framed; `None` for no points.
    pub bounds: Option<Bounds>,
    /// `--color auto`.
    pub color: AutoColor,
    /// Over all files.
    pub constant: Constant,
    /// Chunks that could not be read; what they hold will be missing.
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

/// A place of a file that is read: which records, and the window that counts, if not everything does.
#[derive(Clone, Debug)]
struct Place {
    file: usize,
    /// Chunk index and records of it from its start.
    chunks: Vec<(usize, u64)>,
    /// West, south, east, north in file coordinates: all that lies in it is in `chunks`.
    window: Option<[f64; 4]>,
}

/// Takes the opening sample of `files` (sorted by path) and decides.
pub fn take(files: &[Opened], options: &PlacementOptions, budget: &Budget) -> Sample {
    let mut problems = Vec::new();

    // First points: where each file lies, and a thin sample over everything.
    let most = (budget.first_points / files.len().max(1)).max(1);
    let firsts = parallel(files.len(), |decoder, index| {
        let file = &files[index].file;
        let mut seen = Vec::new();
        let result = if file.chunks.is_empty() {
            Ok(())
        } else {
            decoder.first_points(file, most).map(|block| append(block, &mut seen))
        };
        file.bytes.release();
        (seen, result.err())
    });
    let mut first_points = Vec::with_capacity(files.len());
    for (index, (seen, error)) in firsts.into_iter().enumerate() {
        problems.extend(error.map(|error| (index, error)));
        first_points.push(seen);
    }
    let facts: Vec<FileFacts> = files
        .iter()
        .zip(&first_points)
        .map(|(Opened { file, crs, .. }, seen)| FileFacts {
            crs: crs.as_ref(),
            points: file.points(),
            centre: median(seen.iter().map(|seen| unpack(file, seen.raw))),
        })
        .collect();
    let world = World::of(&facts, options);
    let drawn = |index: usize| world.placements[index].is_some();

    // Whole chunks.
    let points: u64 = (0..files.len()).filter(|&i| drawn(i)).map(|i| files[i].file.points()).sum();
    let places = if points <= budget.whole {
        every_place(files, drawn)
    } else {
        chosen_places(files, drawn, points, budget)
    };
    let whole = points <= budget.whole;
    let read = parallel(places.len(), |decoder, index| {
        let place = &places[index];
        let (mut seen, mut errors) = (Vec::new(), Vec::new());
        let file = &files[place.file].file;
        for &(chunk, records) in &place.chunks {
            let result =
                decoder.decode(file, &file.chunks[chunk], 0..records, &mut |block| append(block, &mut seen));
            errors.extend(result.err());
        }
        file.bytes.release();
        (seen, errors)
    });
    let mut patches = Vec::with_capacity(places.len());
    for (place, (seen, errors)) in places.iter().zip(read) {
        problems.extend(errors.into_iter().map(|error| (place.file, error)));
        patches.push(seen);
    }

    // RGB of files that the places passed by.
    let mut rgb_points: Vec<Vec<[u16; 3]>> = vec![Vec::new(); files.len()];
    if !whole {
        first_points
            .iter()
            .enumerate()
            .for_each(|(i, seen)| rgb_points[i].extend(seen.iter().map(|s| s.rgb)));
    }
    for (place, seen) in places.iter().zip(&patches) {
        rgb_points[place.file].extend(seen.iter().map(|s| s.rgb));
    }
    let thin: Vec<usize> = (0..files.len())
        .filter(|&i| !whole && drawn(i) && has_rgb(&files[i].file) && rgb_points[i].len() < RGB_POINTS)
        .take(RGB_FILES)
        .collect();
    let more = parallel(thin.len(), |decoder, index| {
        let file = &files[thin[index]].file;
        let mut seen = Vec::new();
        // A broken chunk is reported when it is drawn; here it only tells less.
        if let Some(chunk) = file.chunks.get(file.chunks.len() / 2) {
            let _ = decoder.decode(file, chunk, 0..RGB_POINTS as u64, &mut |block| append(block, &mut seen));
        }
        file.bytes.release();
        seen
    });
    for (&index, seen) in thin.iter().zip(more) {
        rgb_points[index].extend(seen.iter().map(|seen| seen.rgb));
    }
    let rgb = decide_rgb(files, &rgb_points);

    // All points with their weights: first points and chunks each stand for the whole.
    let decoded: usize = patches.iter().map(Vec::len).sum();
    let chunk_weight = points as f64 / decoded.max(1) as f64;
    let mut weighted: Vec<Vec<(&Seen, f64)>> = vec![Vec::new(); files.len()];
    for index in (0..files.len()).filter(|&i| drawn(i) && !whole) {
        let seen = &first_points[index];
        let weight = files[index].file.points() as f64 / seen.len().max(1) as f64;
        weighted[index].extend(seen.iter().map(|seen| (seen, weight)));
    }
    for (place, seen) in places.iter().zip(&patches) {
        weighted[place.file].extend(seen.iter().map(|seen| (seen, chunk_weight)));
    }
    let all =
        || weighted.iter().enumerate().flat_map(|(file, seen)| seen.iter().map(move |s| (file, s.0, s.1)));
    // Where everything is noise, noise is what is measured.
    let any_shown = all().any(|(_, seen, _)| !hidden_by_default(seen.class, seen.flags));
    let shown = |seen: &Seen| !any_shown || !hidden_by_default(seen.class, seen.flags);
    let place = |file: usize, seen: &Seen| {
        let point = unpack(&files[file].file, seen.raw);
        world.placements[file].expect("drawn files alone are sampled").place(point.x, point.y, point.z)
    };

    let mut classes = Box::new([0.0; 256]);
    let (mut colored, mut telling, mut weight_sum) = (0.0, 0.0, 0.0);
    let (mut heights, mut intensities) = (Vec::new(), Vec::new());
    for (file, seen, weight) in all() {
        classes[usize::from(seen.class)] += weight;
        if shown(seen) {
            weight_sum += weight;
            colored += if rgb[file].is_color() && seen.rgb != [0; 3] { weight } else { 0.0 };
            telling += if matches!(seen.class, 0 | 1 | 2 | 7 | 12 | 18) { 0.0 } else { weight };
            heights.push((place(file, seen).z, weight));
            intensities.push((f64::from(seen.intensity), weight));
        }
    }
    if !whole {
        // Both samples stand for all points.
        classes.iter_mut().for_each(|count| *count /= 2.0);
    }
    let color = if colored >= 0.05 * weight_sum && weight_sum > 0.0 {
        AutoColor::Rgb
    } else if telling > 0.1 * weight_sum {
        AutoColor::Class
    } else {
        AutoColor::Height
    };

    let file_samples: Vec<FileSample> = (0..files.len())
        .map(|index| {
            let Some(placement) = &world.placements[index] else {
                return FileSample { rgb: rgb[index], bounds: None, constant: Constant::default() };
            };
            let placed: Vec<(DVec3, f64)> = weighted[index]
                .iter()
                .filter(|(seen, _)| shown(seen))
                .map(|(seen, weight)| (place(index, seen), *weight))
                .filter(|(point, _)| point.is_finite())
                .collect();
            let header = header_bounds(&files[index].file, placement);
            let bounds =
                if files[index].file.points() == 0 { None } else { frame::file_bounds(header, &placed) };
            let constant = constant(weighted[index].iter().map(|(seen, _)| *seen));
            FileSample { rgb: rgb[index], bounds, constant }
        })
        .collect();
    let boxes: Vec<(Bounds, u64)> = file_samples
        .iter()
        .zip(files)
        .filter_map(|(sample, opened)| Some((sample.bounds?, opened.file.points())))
        .collect();

    let in_runs = || (0..files.len()).filter(|&i| drawn(i) && files[i].file.copc.is_none());
    let ground = Ground {
        whole,
        shown: &shown,
        place: &place,
        files,
        budget,
        first_points: &first_points,
        boxes_of: file_samples.iter().map(|sample| sample.bounds).collect(),
        boxes: in_runs().filter_map(|i| file_samples[i].bounds).collect(),
        points: in_runs().map(|i| files[i].file.points()).sum(),
    };
    let patches = ground_patches(&places, &patches, &ground);
    let finest = (0..files.len())
        .filter(|&i| drawn(i))
        .map(|i| files[i].file.header.scale.truncate().min_element())
        .fold(f64::INFINITY, f64::min);
    let sampled = decoded + if whole { 0 } else { first_points.iter().map(Vec::len).sum() };
    Sample {
        files: file_samples,
        points,
        sampled: sampled as u64,
        whole,
        cell: cell::choose(&patches, finest),
        height: percentiles(heights),
        intensity: percentiles(intensities),
        classes,
        bounds: frame::whole_bounds(&boxes),
        color,
        constant: constant(all().map(|(_, seen, _)| seen)),
        problems,
        world,
    }
}

/// The places of a set that is read whole: its files.
fn every_place(files: &[Opened], drawn: impl Fn(usize) -> bool) -> Vec<Place> {
    let all = |file: usize| files[file].file.chunks.iter().map(|chunk| (chunk.index as usize, chunk.records));
    let place = |file| Place { file, chunks: all(file).collect(), window: None };
    (0..files.len()).filter(|&file| drawn(file)).map(place).collect()
}

/// `budget.places` places at even distances in the order of points.
fn chosen_places(
    files: &[Opened],
    drawn: impl Fn(usize) -> bool,
    points: u64,
    budget: &Budget,
) -> Vec<Place> {
    let mut places: Vec<Place> = Vec::new();
    let (mut before, mut next) = (0, 0);
    for (index, Opened { file, .. }) in files.iter().enumerate().filter(|(index, _)| drawn(*index)) {
        while next < budget.places {
            let wanted =
                (u128::from(points) * u128::from(2 * next + 1) / u128::from(2 * budget.places)) as u64;
            let Some(record) = wanted.checked_sub(before).filter(|&record| record < file.points()) else {
                break;
            };
            let at = file.chunks.partition_point(|chunk| chunk.first_record <= record) - 1;
            let place = match &file.copc {
                Some(copc) => window_at(index, file, copc, at, budget),
                None => run_at(index, &file.chunks, at, budget.place_points),
            };
            // Large chunks, or windows that grew, may come up twice.
            if !places.iter().any(|known| known.file == place.file && known.chunks == place.chunks) {
                places.push(place);
            }
            next += 1;
        }
        before += file.points();
    }
    places
}

/// Neighbouring chunks from `at` on, until there are enough points to have an inside.
fn run_at(file: usize, chunks: &[Chunk], at: usize, wanted: u64) -> Place {
    let (mut run, mut points) = (Vec::new(), 0);
    for (index, chunk) in chunks.iter().enumerate().skip(at) {
        let records = chunk.records.min(wanted - points);
        run.push((index, records));
        points += records;
        if points >= wanted / 2 {
            break;
        }
    }
    Place { file, chunks: run, window: None }
}

/// All nodes over one small window: a node holds one level of its region, so the node `at` is followed
/// down to a leaf, and the window is widened to the leaf's ancestors until it holds enough points.
fn window_at(file: usize, lidar: &LidarFile, copc: &Copc, at: usize, budget: &Budget) -> Place {
    let records: HashMap<VoxelKey, usize> =
        copc.nodes.iter().enumerate().map(|(index, &key)| (key, index)).collect();
    let count = |key: &VoxelKey| records.get(key).map_or(0, |&index| lidar.chunks[index].records);
    let mut key = copc.nodes[at];
    loop {
        let child = |corner: i32| VoxelKey {
            level: key.level + 1,
            x: key.x * 2 + (corner & 1),
            y: key.y * 2 + (corner >> 1 & 1),
            z: key.z * 2 + (corner >> 2),
        };
        if key.level >= 29 {
            break;
        }
        match (0..8)
            .map(child)
            .filter(|child| records.contains_key(child))
            .max_by_key(|child| (count(child), -child.z))
        {
            Some(child) => key = child,
            None => break,
        }
    }
    let mut best = None;
    loop {
        // The whole column over the node's square, whatever its height.
        let over = |node: &VoxelKey| {
            let shift = i32::from(node.level) - i32::from(key.level);
            if shift >= 0 {
                (node.x >> shift, node.y >> shift) == (key.x, key.y)
            } else {
                (node.x, node.y) == (key.x >> -shift, key.y >> -shift)
            }
        };
        let chunks: Vec<(usize, u64)> = copc
            .nodes
            .iter()
            .enumerate()
            .filter(|(_, node)| over(node))
            .map(|(index, _)| (index, lidar.chunks[index].records))
            .collect();
        // Of a coarser node one part in four a level lies in the window.
        let cost: u64 = chunks.iter().map(|(_, records)| records).sum();
        let inside: u64 = chunks
            .iter()
            .map(|&(index, records)| {
                records >> (2 * key.level.saturating_sub(copc.nodes[index].level)).min(63)
            })
            .sum();
        if best.is_some() && cost > budget.window_points {
            break;
        }
        let [min, max] = copc.bounds(key);
        best = Some(Place { file, chunks, window: Some([min.x, min.y, max.x, max.y]) });
        if inside >= budget.place_points / 2 || key.level == 0 {
            break;
        }
        key = VoxelKey { level: key.level - 1, x: key.x >> 1, y: key.y >> 1, z: key.z >> 1 };
    }
    best.expect("the first window is always taken")
}

/// The patches that the cell size is chosen from: different E, N of shown points at each place. A place
/// of a set that is not read whole is one pass over its ground; how many there are follows from the ground
/// that all points would cover at the places' density, and the ground that there is. Where there are
/// several, their points may be thinned against each other, so chunks of the other passes are read too.
fn ground_patches(places: &[Place], seen: &[Vec<Seen>], ground: &Ground) -> Vec<Patch> {
    let mut patches: Vec<Patch> = Vec::new();
    let mut known = HashSet::new();
    for (at, seen) in places.iter().zip(seen) {
        if !ground.whole || patches.is_empty() {
            known.clear();
            patches.push(Patch { points: Vec::new(), passes: 1.0 });
        }
        let patch = patches.last_mut().expect("pushed above");
        for seen in seen.iter().filter(|seen| (ground.shown)(seen)) {
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
    let looked_at: usize = runs.iter().map(|&run| seen[run].len()).sum();
    let areas: Vec<f64> =
        runs.iter().map(|&run| cell::footprint_area(&patches[run].points, spacing)).collect();
    let all_once = areas.iter().sum::<f64>() * ground.points as f64 / looked_at as f64;
    // Neither can there be less than one, nor does anyone fly more than a few dozen.
    let passes = (all_once / frame::covered_area(&ground.boxes)).clamp(1.0, 64.0);
    if passes.is_nan() || passes < SEVERAL_PASSES {
        return patches;
    }
    let density = runs.iter().map(|&run| patches[run].points.len() as f64).sum::<f64>()
        / areas.iter().sum::<f64>()
        * passes;
    let windows = parallel(runs.len(), |decoder, index| {
        let (at, patch) = (&places[runs[index]], &patches[runs[index]]);
        let center = median(patch.points.iter().map(|p| DVec3::new(p[0], p[1], 0.0))).truncate();
        let reach = areas[index].sqrt() / 2.0;
        let inside = |p: &[f64; 2]| (DVec2::from_array(*p) - center).abs().max_element() <= reach / 2.0;
        let mut points: Vec<[f64; 2]> = patch.points.iter().copied().filter(inside).collect();
        let mut known: HashSet<[u64; 2]> = points.iter().map(|p| p.map(f64::to_bits)).collect();
        for (file, chunk) in chunks_near(ground, center, reach, at) {
            if points.len() as f64 > 0.9 * density * reach * reach {
                break; // All passes are there.
            }
            let lidar = &ground.files[file].file;
            let mut seen = Vec::new();
            // A broken chunk is reported when it is drawn; here it only tells less.
            let _ =
                decoder.decode(lidar, &lidar.chunks[chunk], 0..ground.budget.place_points, &mut |block| {
                    append(block, &mut seen);
                });
            lidar.bytes.release();
            for seen in seen.iter().filter(|seen| (ground.shown)(seen)) {
                let point = (ground.place)(file, seen);
                let point = [point.x, point.y];
                if inside(&point) && known.insert(point.map(f64::to_bits)) {
                    points.push(point);
                }
            }
        }
        // Where the middle of a pass is a void, the pass itself has to do.
        if points.len() < patch.points.len() / 8 {
            return Patch { points: patch.points.clone(), passes };
        }
        let here = points.len() as f64 / cell::footprint_area(&points, spacing);
        Patch { points, passes: (density / here).clamp(1.0, passes) }
    });
    for (run, window) in runs.into_iter().zip(windows) {
        patches[run] = window;
    }
    patches
}

/// Passes from which on those of one place are looked for.
const SEVERAL_PASSES: f64 = 1.2;
/// Most chunks read around a place.
const NEIGHBOURS: usize = 6;

/// Chunks (file, index) that seem to lie within `reach` of `center`: points are mostly stored in the order
/// of flight, so a chunk lies along the way from its first point to the next chunk's.
fn chunks_near(ground: &Ground, center: DVec2, reach: f64, not: &Place) -> Vec<(usize, usize)> {
    let mut near = Vec::new();
    for (file, firsts) in ground.first_points.iter().enumerate() {
        // Of large files not every chunk's first point is known.
        let known = firsts.len() == ground.files[file].file.chunks.len();
        if !known || ground.boxes_of[file].is_none_or(|b| distance_to_box(center, b) > 2.0 * reach) {
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

/// What [`ground_patches`] must know.
struct Ground<'a> {
    files: &'a [Opened],
    budget: &'a Budget,
    first_points: &'a [Vec<Seen>],
    whole: bool,
    shown: &'a (dyn Fn(&Seen) -> bool + Sync),
    /// World coordinates of a point of a file.
    place: &'a (dyn Fn(usize, &Seen) -> DVec3 + Sync),
    /// Of every file that is drawn.
    boxes_of: Vec<Option<Bounds>>,
    /// Of the files that are read in runs of chunks, not in windows.
    boxes: Vec<Bounds>,
    /// Points in them.
    points: u64,
}

/// Header bounds in the world, where they are bounds.
fn header_bounds(file: &LidarFile, placement: &Placement) -> Option<Bounds> {
    let (min, max) = (file.header.min, file.header.max);
    match placement {
        Placement::Turned { .. } => None,
        _ => Bounds::new(placement.place(min.x, min.y, min.z), placement.place(max.x, max.y, max.z)),
    }
}

fn has_rgb(file: &LidarFile) -> bool {
    matches!(file.header.format, 2 | 3 | 5 | 7 | 8 | 10)
}

/// 8 or 16 bit, a file at a time. A file of which little was seen, and nothing beyond 255, follows the
/// other files of its format.
fn decide_rgb(files: &[Opened], seen: &[Vec<[u16; 3]>]) -> Vec<Rgb> {
    let alone = |index: usize| {
        let (file, seen) = (&files[index].file, &seen[index]);
        if !has_rgb(file) {
            return Rgb::Absent;
        }
        let bright = seen.iter().filter(|rgb| rgb.iter().any(|&value| value > 255)).count();
        let same = seen.windows(2).all(|two| two[0] == two[1]);
        if seen.iter().all(|rgb| *rgb == [0; 3]) || same && seen.len() >= 16 {
            Rgb::Constant
        } else if bright * 200 > seen.len() {
            Rgb::Sixteen
        } else {
            Rgb::Eight
        }
    };
    let alone: Vec<Rgb> = (0..files.len()).map(alone).collect();
    let decide = |index: usize| {
        let (format, own) = (files[index].file.header.format, alone[index]);
        let sure = matches!(own, Rgb::Absent | Rgb::Sixteen) || seen[index].len() >= RGB_POINTS;
        if sure {
            return own;
        }
        let others = (0..files.len()).filter(|&other| files[other].file.header.format == format);
        let mut votes = [0u64; 3];
        for other in others.filter(|&other| seen[other].len() >= RGB_POINTS || alone[other] == Rgb::Sixteen) {
            match alone[other] {
                Rgb::Eight => votes[0] += 1,
                Rgb::Sixteen => votes[1] += 1,
                _ => votes[2] += 1,
            }
        }
        match votes {
            [0, 0, 0] => own,
            [eight, sixteen, none] if sixteen > eight && sixteen >= none => Rgb::Sixteen,
            [eight, _, none] if eight >= none => Rgb::Eight,
            _ => own,
        }
    };
    (0..files.len()).map(decide).collect()
}

fn constant<'a>(mut seen: impl Iterator<Item = &'a Seen>) -> Constant {
    let Some(first) = seen.next() else { return Constant::default() };
    let (mut constant, mut count) = (Constant { class: true, intensity: true, returns: true }, 1);
    for seen in seen {
        constant.class &= seen.class == first.class;
        constant.intensity &= seen.intensity == first.intensity;
        constant.returns &= seen.returns == first.returns;
        count += 1;
    }
    if count > 1 { constant } else { Constant::default() }
}

fn percentiles(mut values: Vec<(f64, f64)>) -> Percentiles {
    values.retain(|(value, _)| value.is_finite());
    let mut at = |share| quantile(&mut values, share).unwrap_or(0.0);
    Percentiles { p0_5: at(0.005), p2: at(0.02), p50: at(0.5), p98: at(0.98), p99_5: at(0.995) }
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
fn parallel<T: Send>(count: usize, job: impl Fn(&mut Decoder, usize) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(count);
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<T>>> = Mutex::new((0..count).map(|_| None).collect());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut decoder = Decoder::new(DECODER_BYTES);
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
