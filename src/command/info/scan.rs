//! What only reading every point tells.

use super::classes::ClassCount;
use super::ranges::{Box3, Range, Span};
use crate::sample::{Opened, parallel};
use crate::source::{
    FLAG_KEY_POINT, FLAG_OVERLAP, FLAG_SYNTHETIC, FLAG_WITHHELD, Fields, LidarFile, PointBlock,
};
use crate::text::harmless;
use indicatif::{ProgressBar, ProgressStyle};
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Counts and ranges over the points of a file, or of all files.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scan {
    /// Points read.
    pub points: u64,
    /// File coordinates; all files: where they are world coordinates.
    pub bounds: Option<Box3>,
    /// Points of each class.
    #[serde(serialize_with = "named")]
    pub classes: Vec<u64>,
    /// Lowest and highest value.
    pub intensity: Range,
    pub return_number: Range,
    pub number_of_returns: Range,
    /// Points of each point source id.
    #[serde(serialize_with = "by_id")]
    pub source_ids: BTreeMap<u16, u64>,
    /// Degrees from the nadir.
    pub scan_angle: Option<Span>,
    /// As stored; absent where no point has one.
    pub gps_time: Option<Span>,
    /// Red, green, blue as stored; absent where the format has none.
    pub rgb: Option<[Range; 3]>,
    pub synthetic: u64,
    pub key_point: u64,
    pub withheld: u64,
    pub overlap: u64,
    /// Chunks that cannot be read, or not to their end.
    pub damage: Vec<String>,
}

impl Default for Scan {
    fn default() -> Scan {
        Scan {
            points: 0,
            bounds: None,
            classes: vec![0; 256],
            intensity: Range::NONE,
            return_number: Range::NONE,
            number_of_returns: Range::NONE,
            source_ids: BTreeMap::new(),
            scan_angle: None,
            gps_time: None,
            rgb: None,
            synthetic: 0,
            key_point: 0,
            withheld: 0,
            overlap: 0,
            damage: Vec::new(),
        }
    }
}

impl Scan {
    /// Adds the points of another file.
    pub fn merge(&mut self, other: &Scan) {
        self.points += other.points;
        self.bounds = match (self.bounds, other.bounds) {
            (Some(a), Some(b)) => Some(Box3 {
                min: std::array::from_fn(|i| a.min[i].min(b.min[i])),
                max: std::array::from_fn(|i| a.max[i].max(b.max[i])),
            }),
            (a, b) => a.or(b),
        };
        self.classes.iter_mut().zip(&other.classes).for_each(|(sum, count)| *sum += count);
        self.intensity.merge(other.intensity);
        self.return_number.merge(other.return_number);
        self.number_of_returns.merge(other.number_of_returns);
        other.source_ids.iter().for_each(|(id, points)| *self.source_ids.entry(*id).or_default() += points);
        Span::merge(&mut self.scan_angle, other.scan_angle);
        Span::merge(&mut self.gps_time, other.gps_time);
        if let Some(other) = other.rgb {
            let rgb = self.rgb.get_or_insert([Range::NONE; 3]);
            rgb.iter_mut().zip(other).for_each(|(range, other)| range.merge(other));
        }
        self.synthetic += other.synthetic;
        self.key_point += other.key_point;
        self.withheld += other.withheld;
        self.overlap += other.overlap;
        self.damage.extend_from_slice(&other.damage);
    }

    fn add(&mut self, file: &LidarFile, block: &PointBlock) {
        if block.is_empty() {
            return;
        }
        self.points += block.len() as u64;
        let columns = [&block.x, &block.y, &block.z];
        let (scale, offset) = (file.header.scale, file.header.offset);
        let corner = |pick: fn(&[i32]) -> i32| {
            std::array::from_fn(|axis| f64::from(pick(columns[axis])) * scale[axis] + offset[axis])
        };
        let of_block = Box3 {
            min: corner(|column| column.iter().copied().min().unwrap_or_default()),
            max: corner(|column| column.iter().copied().max().unwrap_or_default()),
        };
        let counts = Scan { bounds: Some(of_block), ..Scan::default() };
        self.merge(&counts);
        for i in 0..block.len() {
            self.classes[usize::from(block.class[i])] += 1;
            self.intensity.include(block.intensity[i]);
            self.return_number.include(u16::from(block.returns[i] & 15));
            self.number_of_returns.include(u16::from(block.returns[i] >> 4));
            let flags = block.flags[i];
            self.synthetic += u64::from(flags & FLAG_SYNTHETIC != 0);
            self.key_point += u64::from(flags & FLAG_KEY_POINT != 0);
            self.withheld += u64::from(flags & FLAG_WITHHELD != 0);
            self.overlap += u64::from(flags & FLAG_OVERLAP != 0);
        }
        // Points of a line follow each other.
        for run in block.source_id.chunk_by(|a, b| a == b) {
            *self.source_ids.entry(run[0]).or_default() += run.len() as u64;
        }
        for &steps in &block.scan_angle {
            Span::include(&mut self.scan_angle, f64::from(steps) * 6.0 / 1000.0);
        }
        block.gps_time.iter().for_each(|&time| Span::include(&mut self.gps_time, time));
        for rgb in &block.rgb {
            let ranges = self.rgb.get_or_insert([Range::NONE; 3]);
            ranges.iter_mut().zip(rgb).for_each(|(range, &value)| range.include(value));
        }
    }
}

/// Classes that occur: number, name, points.
fn named<S: Serializer>(classes: &[u64], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(ClassCount::all(classes))
}

/// Points of an id.
#[derive(Serialize)]
struct IdCount {
    id: u16,
    points: u64,
}

/// Ids that occur, ascending.
fn by_id<S: Serializer>(ids: &BTreeMap<u16, u64>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(ids.iter().map(|(&id, &points)| IdCount { id, points }))
}

/// Scans on all cores, chunk by chunk; results in the order of `files`.
pub fn every_file(files: &[Opened], quiet: bool) -> Vec<Scan> {
    let chunks: Vec<(usize, usize)> = files
        .iter()
        .enumerate()
        .flat_map(|(file, opened)| (0..opened.file.chunks.len()).map(move |chunk| (file, chunk)))
        .collect();
    let points = files.iter().map(|opened| opened.file.points()).sum();
    // Draws nothing where standard error is no terminal.
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(points) };
    let style =
        ProgressStyle::with_template("scanning {bar:30} {human_pos} of {human_len} points, {per_sec}");
    bar.set_style(style.expect("the template is valid"));
    let scans: Vec<Mutex<Scan>> = files.iter().map(|_| Mutex::default()).collect();
    let damage = parallel(chunks.len(), |decoder, index| {
        let (at, chunk) = chunks[index];
        let file = &files[at].file;
        let chunk = &file.chunks[chunk];
        let mut scan = Scan::default();
        decoder.set_fields(Fields::ALL);
        let read = decoder.decode(file, chunk, 0..chunk.records, &mut |block| scan.add(file, block));
        bar.inc(chunk.records);
        scans[at].lock().unwrap_or_else(PoisonError::into_inner).merge(&scan);
        if chunk.index + 1 == file.chunks.len() as u64 {
            // Another thread may open it once more: handles must not pile up, that is all.
            file.bytes.release();
        }
        read.err().map(|error| harmless(&error.to_string()))
    });
    bar.finish_and_clear();
    let mut scans: Vec<Scan> =
        scans.into_iter().map(|scan| scan.into_inner().unwrap_or_else(PoisonError::into_inner)).collect();
    for ((file, _), damage) in chunks.into_iter().zip(damage) {
        scans[file].damage.extend(damage);
    }
    scans
}
