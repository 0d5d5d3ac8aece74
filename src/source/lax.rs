//! The spatial index of LAStools (`NAME.lax` beside `NAME.las`, or record 30 of "LAStools" in a LAZ file): a quadtree
//! whose cells name the records that lie in them. Of interest here is the reverse: in which cells a chunk lies.
//!
//! Layout, little endian (LASzip's `lasindex`, `lasquadtree`, `lasinterval`): "LASX", version; "LASS", type 0; "LASQ",
//! version (old files leave both out), levels, two numbers that are 0, min X, max X, min Y, max Y as f32; "LASV",
//! version, count of cells; of each its index, count of intervals, count of points, and intervals as first and last
//! record. Counts of points and records have 32 bits in version 0, 64 in version 1. Cells of level L have indices from
//! (4^L - 1) / 3 on, two bits a level: 1 is the eastern half, 2 the northern.

use super::known::{Known, RawBounds, Told};
use super::{LidarFile, VlrEntry};
use glam::DVec2;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Most bytes that are read: an index is far smaller than what it is of.
const MOST_BYTES: u64 = 64 << 20;
/// Deepest level: indices of cells have 32 bits.
const MOST_LEVELS: u32 = 15;
/// Most chunks that all intervals touch together: each record is in one cell, so that they overlap little.
const MOST_TOUCHED: u64 = 1 << 24;

/// Why an index is not used.
#[derive(Debug, thiserror::Error)]
pub enum LaxError {
    /// The system refuses.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The index.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// Made before the file that it is of.
    #[error("{path}: not used: older than the file that it is of")]
    Older {
        /// The index.
        path: PathBuf,
    },
    /// It says something that cannot be.
    #[error("{path}: byte {offset}: not used: {reason}")]
    Bad {
        /// The index, or the file that it is in.
        path: PathBuf,
        /// Where, in that file.
        offset: u64,
        /// What.
        reason: String,
    },
}

/// What the index of a file tells of where its chunks lie; nothing where there is none.
pub fn look_up(file: &LidarFile) -> Result<Known, LaxError> {
    if let Some(record) = file.vlr("LAStools", 30) {
        return of_record(file, record);
    }
    let path = beside(file.path());
    let about = match fs::metadata(&path) {
        Ok(about) if about.is_file() => about,
        // Most files have none.
        _ => return Ok(Known::default()),
    };
    if let (Ok(index), Some(of_file)) = (about.modified(), file.bytes.modified())
        && index < of_file
    {
        return Err(LaxError::Older { path });
    }
    if about.len() > MOST_BYTES {
        return Err(too_long(path, 0, about.len()));
    }
    match fs::read(&path) {
        Ok(raw) => of_bytes(file, &raw).map_err(|(at, reason)| bad(path, at as u64, reason)),
        Err(source) => Err(LaxError::Io { path, source }),
    }
}

fn of_record(file: &LidarFile, record: &VlrEntry) -> Result<Known, LaxError> {
    let path = || file.path().to_owned();
    if record.len > MOST_BYTES {
        return Err(too_long(path(), record.offset, record.len));
    }
    let raw = record
        .read(&file.bytes, MOST_BYTES)
        .map_err(|error| bad(path(), record.offset, error.to_string()))?;
    of_bytes(file, &raw).map_err(|(at, reason)| bad(path(), record.offset + at as u64, reason))
}

fn bad(path: PathBuf, offset: u64, reason: String) -> LaxError {
    LaxError::Bad { path, offset, reason }
}

fn too_long(path: PathBuf, offset: u64, len: u64) -> LaxError {
    bad(path, offset, format!("{len} bytes, {MOST_BYTES} are read of an index"))
}

/// The index's path: in capitals where the file's is.
fn beside(path: &Path) -> PathBuf {
    let capitals = path.extension().is_some_and(|e| e.as_encoded_bytes().starts_with(b"LA"));
    path.with_extension(if capitals { "LAX" } else { "lax" })
}

/// Where in the index something is wrong, and what.
type Wrong = (usize, String);

/// The bytes from one place on.
struct Reader<'a> {
    raw: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Wrong> {
        let Some(raw) = self.raw[self.at..].first_chunk() else {
            return Err((self.at, format!("it ends where {N} more bytes should be")));
        };
        self.at += N;
        Ok(*raw)
    }

    fn signature(&mut self, wanted: &[u8; 4]) -> Result<(), Wrong> {
        let at = self.at;
        let found = self.take::<4>()?;
        if &found == wanted {
            return Ok(());
        }
        Err((at, format!("\"{}\" instead of \"{}\"", found.escape_ascii(), wanted.escape_ascii())))
    }

    fn number(&mut self) -> Result<u32, Wrong> {
        self.take().map(u32::from_le_bytes)
    }

    fn float(&mut self) -> Result<f32, Wrong> {
        self.take().map(f32::from_le_bytes)
    }

    /// A number of records.
    fn records(&mut self, wide: bool) -> Result<u64, Wrong> {
        if wide { self.take().map(u64::from_le_bytes) } else { self.number().map(u64::from) }
    }

    /// A number that must be one of `known`.
    fn one_of(&mut self, what: &str, known: std::ops::RangeInclusive<u32>) -> Result<u32, Wrong> {
        let at = self.at;
        let found = self.number()?;
        if known.contains(&found) {
            Ok(found)
        } else {
            Err((at, format!("{what} is {found}, not {known:?}")))
        }
    }
}

/// The quadtree: its levels, and west, south, east, north.
struct Tree {
    levels: u32,
    root: [f32; 4],
}

impl Tree {
    fn read(from: &mut Reader) -> Result<Tree, Wrong> {
        from.signature(b"LASS")?;
        from.one_of("the type of index", 0..=0)?;
        if from.raw[from.at..].starts_with(b"LASQ") {
            from.signature(b"LASQ")?;
            from.one_of("the quadtree's version", 0..=0)?;
        }
        let levels = from.one_of("the number of levels", 0..=MOST_LEVELS)?;
        from.one_of("the level index", 0..=0)?;
        from.one_of("the number of implicit levels", 0..=0)?;
        let at = from.at;
        let [west, east, south, north] = [from.float()?, from.float()?, from.float()?, from.float()?];
        let root = [west, south, east, north];
        let is_box = root.iter().all(|v| v.is_finite()) && west < east && south < north;
        is_box.then_some(Tree { levels, root }).ok_or_else(|| (at, format!("{root:?} is no box")))
    }

    /// West, south, east, north of a cell. Points beyond the root's border lie in the cells at that border: those reach
    /// to infinity. Halved in f32, as where the index is made.
    fn cell(&self, index: u32) -> Option<[f64; 4]> {
        let (mut level, mut first) = (0, 0u32);
        while index - first >= 1 << (2 * level) {
            first += 1 << (2 * level);
            level += 1;
            if level > self.levels {
                return None;
            }
        }
        let [mut west, mut south, mut east, mut north] = self.root;
        let place = index - first;
        for step in (0..level).rev() {
            let quarter = place >> (2 * step) & 3;
            let middle = [(west + east) / 2.0, (south + north) / 2.0];
            if quarter & 1 == 0 {
                east = middle[0]
            } else {
                west = middle[0]
            }
            if quarter & 2 == 0 { north = middle[1] } else { south = middle[1] }
        }
        let [w, s, e, n] = self.root;
        let open = |side: f32, border: f32, beyond: f64| if side == border { beyond } else { side.into() };
        Some([
            open(west, w, f64::NEG_INFINITY),
            open(south, s, f64::NEG_INFINITY),
            open(east, e, f64::INFINITY),
            open(north, n, f64::INFINITY),
        ])
    }
}

fn of_bytes(file: &LidarFile, raw: &[u8]) -> Result<Known, Wrong> {
    let mut from = Reader { raw, at: 0 };
    from.signature(b"LASX")?;
    from.one_of("the index's version", 0..=0)?;
    let tree = Tree::read(&mut from)?;
    from.signature(b"LASV")?;
    let wide = from.one_of("the version of its intervals", 0..=1)? == 1;
    let cells_at = from.at;
    let cells = from.number()?;
    let points = file.points();
    let mut boxes: Vec<Option<[f64; 4]>> = vec![None; file.chunks.len()];
    let mut intervals = Vec::new();
    let mut touched = 0;
    for _ in 0..cells {
        let at = from.at;
        let index = from.number()?;
        let cell = tree
            .cell(index)
            .ok_or_else(|| (at, format!("there is no cell {index} in {} levels", tree.levels)))?;
        let count = from.number()?;
        let claimed = from.records(wide)?;
        let mut held = 0u64;
        for _ in 0..count {
            let at = from.at;
            let (first, last) = (from.records(wide)?, from.records(wide)?);
            if first > last || last >= points {
                return Err((at, format!("records {first} to {last} of {points}")));
            }
            held = held.saturating_add(last - first + 1);
            intervals.push((first, last));
            let start = file.chunks.partition_point(|chunk| chunk.first_record + chunk.records <= first);
            let end = file.chunks.partition_point(|chunk| chunk.first_record <= last);
            touched += (end - start) as u64;
            if touched > MOST_TOUCHED {
                return Err((at, "its intervals overlap too much".into()));
            }
            for known in &mut boxes[start..end] {
                let [west, south, east, north] = known.unwrap_or(cell);
                *known = Some([west.min(cell[0]), south.min(cell[1]), east.max(cell[2]), north.max(cell[3])]);
            }
        }
        if held < claimed {
            return Err((at, format!("cell {index} has {claimed} points in {held} records")));
        }
    }
    // Without some of its points a chunk would be believed to be smaller than it is.
    intervals.sort_unstable();
    let mut next = 0;
    for (first, last) in intervals {
        if first > next {
            break;
        }
        next = next.max(last + 1);
    }
    if next < points {
        return Err((cells_at, format!("record {next} of {points} is in no cell")));
    }
    Ok(Known::new(Told::Index, boxes.into_iter().map(|of_chunk| Some(raw_bounds(file, of_chunk?))).collect()))
}

/// Raw coordinates that such a box may hold; where it has no end, the header's bounds are one.
fn raw_bounds(file: &LidarFile, [west, south, east, north]: [f64; 4]) -> RawBounds {
    let header = &file.header;
    let (min, max) = (header.min.truncate(), header.max.truncate());
    let low = DVec2::new(west, south);
    let high = DVec2::new(east, north);
    let or = |side: f64, of_header: f64| {
        if side.is_infinite() && of_header.is_finite() { of_header } else { side }
    };
    let low = DVec2::new(or(low.x, min.x), or(low.y, min.y));
    let high = DVec2::new(or(high.x, max.x), or(high.y, max.y));
    let (scale, offset) = (header.scale.truncate(), header.offset.truncate());
    // A step more: coordinates are rounded.
    let (low, high) = ((low - offset) / scale, (high - offset) / scale);
    RawBounds {
        min: [low.x.floor() as i32, low.y.floor() as i32, i32::MIN].map(|v| v.saturating_sub(1)),
        max: [high.x.ceil() as i32, high.y.ceil() as i32, i32::MAX].map(|v| v.saturating_add(1)),
    }
}
