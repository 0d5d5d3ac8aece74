//! LAS, LAZ and COPC files made in memory, and what must come out of them.

#![allow(dead_code)] // each test binary uses its part

use lasray::source::{Decoder, LidarFile, PointBlock, SourceError};
use laz::{
    LasZipCompressor, LazItem, LazItemRecordBuilder, LazVlr, LazVlrBuilder,
    record::{RecordCompressor, SequentialPointRecordCompressor},
};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::{
    io::Cursor,
    path::{Path, PathBuf},
};

/// Bytes in a record of each format.
pub const FORMAT_LEN: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// How the points of a made file are cut and compressed.
#[derive(Clone, Debug)]
pub enum Packing {
    /// LAS.
    Plain,
    /// LAZ, chunks of so many records.
    Fixed(u32),
    /// LAZ, chunks of these numbers of records.
    Variable(Vec<usize>),
    /// LAZ without chunks.
    PointWise,
    /// COPC, nodes of these numbers of records.
    Copc(Vec<usize>),
}

/// A file to be made.
#[derive(Clone)]
pub struct Made {
    pub minor: u8,
    pub format: u8,
    pub extra: u16,
    pub packing: Packing,
    /// Version of the compressed items; `None` is the usual one.
    pub items: Option<u8>,
    pub records: Vec<u8>,
    /// Further variable length records: user id, record id, payload.
    pub vlrs: Vec<(&'static str, u16, Vec<u8>)>,
    /// Scale and offset; then the header's bounds are those of the records.
    pub header: Option<([f64; 3], [f64; 3])>,
}

impl std::fmt::Debug for Made {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Made { minor, format, extra, packing, items, .. } = self;
        let points = self.points();
        write!(
            f,
            "LAS 1.{minor} format {format} + {extra} bytes, {points} points, {packing:?}, items {items:?}"
        )
    }
}

impl Made {
    pub fn new(format: u8, packing: Packing, points: usize) -> Made {
        let minor = match format {
            _ if matches!(packing, Packing::Copc(_)) => 4,
            0..=1 => 1,
            2..=3 => 2,
            4..=5 => 3,
            _ => 4,
        };
        let records = records(format, 0, points);
        Made { minor, format, extra: 0, packing, items: None, records, vlrs: Vec::new(), header: None }
    }

    pub fn with_extra(mut self, extra: u16) -> Made {
        let points = self.records.len() / self.record_len();
        self.extra = extra;
        self.records = records(self.format, extra, points);
        self
    }

    pub fn with_items(mut self, version: u8) -> Made {
        self.items = Some(version);
        if let (1, 2 | 3 | 5) = (version, self.format) {
            // 8-bit colours: the `laz` crate encodes others wrongly in version 1.
            let (at, len) = (if self.format == 2 { 20 } else { 28 }, self.record_len());
            for record in self.records.chunks_mut(len) {
                [at + 1, at + 3, at + 5].into_iter().for_each(|i| record[i] = 0);
            }
        }
        self
    }

    pub fn record_len(&self) -> usize {
        usize::from(FORMAT_LEN[usize::from(self.format)] + self.extra)
    }

    pub fn points(&self) -> usize {
        self.records.len() / self.record_len()
    }

    fn laz_items(&self) -> Vec<LazItem> {
        use laz::las::{
            Point0, Point1, Point2, Point3, Point4, Point5, Point6, Point7, Point8, Point9, Point10,
        };
        type Builder = LazItemRecordBuilder;
        let n = self.extra;
        match (self.items, self.format) {
            (None, format) => Builder::default_for_point_format_id(format, n).unwrap(),
            (Some(1), 0) => Builder::version_1_of::<Point0>(n),
            (Some(1), 1) => Builder::version_1_of::<Point1>(n),
            (Some(1), 2) => Builder::version_1_of::<Point2>(n),
            (Some(1), 3) => Builder::version_1_of::<Point3>(n),
            (Some(1), 4) => Builder::version_1_of::<Point4>(n),
            (Some(1), 5) => Builder::version_1_of::<Point5>(n),
            (Some(4), 6) => Builder::version_4_of::<Point6>(n),
            (Some(4), 7) => Builder::version_4_of::<Point7>(n),
            (Some(4), 8) => Builder::version_4_of::<Point8>(n),
            (Some(4), 9) => Builder::version_4_of::<Point9>(n),
            (Some(4), 10) => Builder::version_4_of::<Point10>(n),
            other => panic!("no items {other:?}"),
        }
    }

    /// The whole file.
    pub fn bytes(&self) -> Vec<u8> {
        let variable = matches!(self.packing, Packing::Variable(_) | Packing::Copc(_));
        let mut vlrs = Vec::new();
        if let Packing::Copc(_) = self.packing {
            vlrs.push(("copc", 1, vec![0; 160]));
        }
        vlrs.extend(self.vlrs.iter().cloned());
        vlrs.push(("LASF_Projection", 2112, b"not a CRS\0".to_vec()));
        let mut laz = None;
        if !matches!(self.packing, Packing::Plain) {
            let mut builder = LazVlrBuilder::new(self.laz_items());
            if let Packing::Fixed(size) = self.packing {
                builder = builder.with_fixed_chunk_size(size);
            }
            if variable {
                builder = builder.with_variable_chunk_size();
            }
            let vlr = builder.build();
            let mut payload = Vec::new();
            vlr.write_to(&mut payload).unwrap();
            if let Packing::PointWise = self.packing {
                payload[0] = 1;
            }
            vlrs.push((LazVlr::USER_ID, LazVlr::RECORD_ID, payload));
            laz = Some(vlr);
        }
        let header_size = [227, 227, 227, 235, 375][usize::from(self.minor)];
        let count = self.points() as u64;
        let mut header = las::raw::Header {
            version: las::Version::new(1, self.minor),
            header_size,
            offset_to_point_data: u32::from(header_size)
                + vlrs.iter().map(|v| 54 + v.2.len() as u32).sum::<u32>(),
            number_of_variable_length_records: vlrs.len() as u32,
            point_data_record_format: self.format | if laz.is_some() { 128 } else { 0 },
            point_data_record_length: self.record_len() as u16,
            number_of_point_records: if self.minor < 4 { count as u32 } else { 0 },
            large_file: (self.minor == 4).then(|| las::raw::header::LargeFile {
                number_of_point_records: count,
                ..Default::default()
            }),
            ..Default::default()
        };
        (header.x_scale_factor, header.y_scale_factor, header.z_scale_factor) = (0.01, 0.01, 0.001);
        (header.x_offset, header.y_offset) = (500_000.0, 6_000_000.0);
        (header.max_x, header.max_y, header.max_z) = (600_000.0, 6_100_000.0, 1_000.0);
        if let Some((scale, offset)) = self.header {
            (header.x_scale_factor, header.y_scale_factor, header.z_scale_factor) = scale.into();
            (header.x_offset, header.y_offset, header.z_offset) = offset.into();
            let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
            for record in self.records.chunks(self.record_len()) {
                for (axis, [low, high]) in ends.iter_mut().enumerate() {
                    let raw = i32::from_le_bytes(record[4 * axis..4 * axis + 4].try_into().unwrap());
                    let value = f64::from(raw) * scale[axis] + offset[axis];
                    (*low, *high) = (low.min(value), high.max(value));
                }
            }
            [[header.min_x, header.max_x], [header.min_y, header.max_y], [header.min_z, header.max_z]] = ends;
        }
        let mut file = Vec::new();
        header.write_to(&mut file).unwrap();
        for (user_id, record_id, payload) in &vlrs {
            file.extend(record_head(user_id, *record_id, (payload.len() as u16).to_le_bytes().as_slice()));
            file.extend(payload);
        }
        assert_eq!(file.len(), header.offset_to_point_data as usize);
        let Some(vlr) = laz else {
            file.extend(&self.records);
            return file;
        };
        match &self.packing {
            Packing::Plain => unreachable!(),
            Packing::PointWise => {
                let mut compressor = SequentialPointRecordCompressor::new(file);
                compressor.set_fields_from(vlr.items()).unwrap();
                compressor.compress_many(&self.records).unwrap();
                compressor.done().unwrap();
                compressor.into_inner()
            }
            Packing::Fixed(_) => {
                let mut out = Cursor::new(file);
                out.set_position(out.get_ref().len() as u64);
                let mut compressor = LasZipCompressor::new(out, vlr).unwrap();
                compressor.compress_many(&self.records).unwrap();
                compressor.done().unwrap();
                compressor.into_inner().into_inner()
            }
            Packing::Variable(counts) | Packing::Copc(counts) => {
                let mut out = Cursor::new(file);
                out.set_position(out.get_ref().len() as u64);
                let mut compressor = LasZipCompressor::new(out, vlr).unwrap();
                compressor.reserve_offset_to_chunk_table().unwrap();
                let (mut rest, mut ends) = (self.records.as_slice(), Vec::new());
                for &count in counts {
                    let (chunk, others) = rest.split_at(count * self.record_len());
                    compressor.compress_many(chunk).unwrap();
                    compressor.finish_current_chunk().unwrap();
                    ends.push(compressor.get().position());
                    rest = others;
                }
                assert!(rest.is_empty());
                compressor.done().unwrap();
                let mut file = compressor.into_inner().into_inner();
                if let Packing::Copc(_) = self.packing {
                    add_hierarchy(&mut file, header.offset_to_point_data, counts, &ends);
                }
                file
            }
        }
    }
}

fn record_head(user_id: &str, record_id: u16, len: &[u8]) -> Vec<u8> {
    let mut head = vec![0; 2];
    head.extend(user_id.as_bytes());
    head.resize(18, 0);
    head.extend(record_id.to_le_bytes());
    head.extend(len);
    head.extend([0; 32]);
    head
}

/// An entry of the extra bytes record (LAS 1.4 R15, table 24): type, options, name.
pub fn extra_entry(kind: u8, options: u8, name: &str) -> Vec<u8> {
    let mut entry = vec![0, 0, kind, options];
    entry.extend(name.as_bytes());
    entry.resize(192, 0);
    entry
}

/// `points` points of `format` (6 to 10, as [`records`] makes them), kept in LASzip's compatibility mode behind `extra`
/// bytes of their own; and the records that they are meant to be. Written after the writer's side of LASzip.
pub fn compatible(format: u8, extra: u16, packing: Packing, points: usize) -> (Made, Vec<u8>) {
    let len = usize::from(FORMAT_LEN[usize::from(format)]);
    let mut meant = records(format, 0, points);
    // Up to fifteen returns.
    for (k, record) in meant.chunks_mut(len).enumerate() {
        let count = 1 + k as u8 % 15;
        record[14] = (1 + (k / 7) as u8 % count) | count << 4;
    }
    let stored = match format {
        6 => 1,
        7 | 8 => 3,
        other => other - 5,
    };
    let has_infrared = matches!(format, 8 | 10);
    let mut made = Made::new(stored, packing, 0);
    made.minor = made.minor.max(2);
    made.extra = extra + if has_infrared { 7 } else { 5 };
    for r in meant.chunks(len) {
        let to = &mut made.records;
        let ([number, count], class) = ([r[14] & 15, r[14] >> 4], r[16]);
        let (few, first) = match (count, number) {
            (..=7, _) => (count, number.min(7)),
            (_, ..=4) => (7, number),
            _ if count <= number => (7, 7),
            _ if count - number >= 3 => (7, 4),
            _ => (7, 7 - (count - number)),
        };
        to.extend(&r[..14]);
        to.push(first | few << 3);
        to.push(if class > 31 { 0 } else { class } | (r[15] & 7) << 5);
        to.extend([0, r[17], r[20], r[21]]);
        to.extend(&r[22..30]);
        if matches!(format, 7 | 8 | 10) {
            to.extend(&r[30..36]);
        }
        if format > 8 {
            to.extend(&r[len - 29..]);
        }
        to.extend(vec![0xab; extra.into()]);
        to.extend([r[18], r[19], (number - first) << 4 | (count - few)]);
        to.push(if class > 31 { class } else { 0 });
        to.push((r[15] >> 4 & 3) << 1 | r[15] >> 3 & 1);
        if has_infrared {
            to.extend(&r[36..38]);
        }
    }
    let mut entries = if extra > 0 { extra_entry(0, extra as u8, "own") } else { Vec::new() };
    entries.extend(extra_entry(4, 0, "LAS 1.4 scan angle"));
    for name in ["LAS 1.4 extended returns", "LAS 1.4 classification", "LAS 1.4 flags and channel"] {
        entries.extend(extra_entry(1, 0, name));
    }
    if has_infrared {
        entries.extend(extra_entry(3, 0, "LAS 1.4 NIR band"));
    }
    let mut mode = vec![0; 156];
    mode[2] = 3;
    mode[28..36].copy_from_slice(&(points as u64).to_le_bytes());
    made.vlrs = vec![("LASF_Spec", 4, entries), ("lascompatible", 22204, mode)];
    assert_eq!(made.points(), points);
    (made, meant)
}

/// Appends two extended records, the hierarchy second, in two pages; points the info record at it.
fn add_hierarchy(file: &mut Vec<u8>, points: u32, counts: &[usize], ends: &[u64]) {
    let evlrs = file.len() as u64;
    file.extend(record_head("LASF_Projection", 2112, &9u64.to_le_bytes()));
    file.extend(b"still not");
    let entry = |key: [i32; 4], offset: u64, len: i32, count: i32| {
        let mut entry: Vec<u8> = key.iter().flat_map(|k| k.to_le_bytes()).collect();
        entry.extend(offset.to_le_bytes());
        entry.extend(len.to_le_bytes());
        entry.extend(count.to_le_bytes());
        entry
    };
    let nodes: Vec<Vec<u8>> = (0..counts.len())
        .map(|i| {
            let start = if i == 0 { u64::from(points) + 8 } else { ends[i - 1] };
            let key =
                if i == 0 { [0, 0, 0, 0] } else { [3, (i % 8) as i32, (i / 8 % 8) as i32, (i / 64) as i32] };
            entry(key, start, (ends[i] - start) as i32, counts[i] as i32)
        })
        .collect();
    // Root page: the first half, an empty node, and the page with the rest.
    let half = nodes.len().div_ceil(2);
    let root_len = 32 * (half as u64 + 2);
    let second_len = 32 * (nodes.len() - half) as u64;
    file.extend(record_head("copc", 1000, &(root_len + second_len).to_le_bytes()));
    let root = file.len() as u64;
    let page = |file: &mut Vec<u8>, nodes: &[Vec<u8>]| nodes.iter().for_each(|n| file.extend(n));
    page(file, &nodes[..half]);
    file.extend(entry([1, 1, 1, 1], 0, 0, 0));
    file.extend(entry([1, 0, 0, 0], root + root_len, second_len as i32, -1));
    page(file, &nodes[half..]);
    let info = 375 + 54;
    for (i, value) in [550_000.0, 6_050_000.0, 500.0, 50_000.0, 100.0f64].iter().enumerate() {
        file[info + 8 * i..info + 8 * i + 8].copy_from_slice(&value.to_le_bytes());
    }
    file[info + 40..info + 48].copy_from_slice(&root.to_le_bytes());
    file[info + 48..info + 56].copy_from_slice(&root_len.to_le_bytes());
    file[235..243].copy_from_slice(&evlrs.to_le_bytes());
    file[243..247].copy_from_slice(&2u32.to_le_bytes());
}

/// Raw records as a scanner might leave them: neighbours close by, several returns, channels and colours.
pub fn records(format: u8, extra: u16, points: usize) -> Vec<u8> {
    let mut rng = Pcg64Mcg::seed_from_u64(u64::from(format) << 32 | u64::from(extra));
    let mut raw = Vec::new();
    let (mut x, mut y, mut z) = (1_000_000i32, 2_000_000i32, 100_000i32);
    let mut time = 1e8f64;
    for _ in 0..points {
        x += rng.random_range(-300..300);
        y += rng.random_range(-300..300);
        z += rng.random_range(-2000..2000);
        let start = raw.len();
        for v in [x, y, z] {
            raw.extend(v.to_le_bytes());
        }
        raw.extend(rng.random_range(0..3000u16).to_le_bytes());
        if rng.random_bool(0.3) {
            time += rng.random_range(0.0..1e-3);
        }
        let returns = rng.random_range(1..5u8);
        let this = rng.random_range(1..=returns);
        if format < 6 {
            raw.push(this | returns << 3);
            raw.push(
                rng.random_range(0..20) | if rng.random_bool(0.1) { rng.random::<u8>() & 0xe0 } else { 0 },
            );
            raw.push(rng.random_range(0..20));
            raw.push(0);
            raw.extend(((x >> 6 & 3) as u16).to_le_bytes());
            if [1, 3, 4, 5].contains(&format) {
                raw.extend(time.to_le_bytes());
            }
        } else {
            raw.push(this | returns << 4);
            let channel = if rng.random_bool(0.05) { rng.random_range(0..4u8) } else { 0 };
            let flags = if rng.random_bool(0.1) { rng.random::<u8>() & 0xcf } else { 0 };
            raw.push(flags | channel << 4);
            raw.push(if rng.random_bool(0.1) { rng.random() } else { 2 });
            raw.push(7);
            raw.extend(rng.random_range(-3000..3000i16).to_le_bytes());
            raw.extend(((x >> 6 & 3) as u16).to_le_bytes());
            raw.extend(time.to_le_bytes());
        }
        let rest = usize::from(FORMAT_LEN[usize::from(format)] + extra) - (raw.len() - start);
        let mut tail = vec![0; rest];
        rng.fill_bytes(&mut tail);
        raw.extend(tail);
    }
    raw
}

/// What must come out of raw records, field by field (LAS 1.4 R15, tables 7 to 18).
pub fn columns(format: u8, record_len: usize, raw: &[u8]) -> PointBlock {
    let mut block = PointBlock::default();
    let rgb = [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];
    for r in raw.chunks_exact(record_len) {
        let int = |at: usize| i32::from_le_bytes(r[at..at + 4].try_into().unwrap());
        let word = |at: usize| u16::from_le_bytes(r[at..at + 2].try_into().unwrap());
        block.x.push(int(0));
        block.y.push(int(4));
        block.z.push(int(8));
        block.intensity.push(word(12));
        if format < 6 {
            block.returns.push((r[14] & 0b111) + (r[14] >> 3 & 0b111) * 16);
            block.class.push(r[15] % 32);
            block.flags.push(r[15] / 32);
        } else {
            block.returns.push(r[14]);
            block.class.push(r[16]);
            block.flags.push(r[15] % 16);
        }
        if let Some(at) = rgb[usize::from(format)] {
            block.rgb.push([word(at), word(at + 2), word(at + 4)]);
        }
    }
    block
}

/// What else must come out of raw records, where it is asked for: source ids, scan angles in steps of 0.006°, bits of times.
pub fn more_columns(format: u8, record_len: usize, raw: &[u8]) -> (Vec<u16>, Vec<i16>, Vec<u64>) {
    let (mut ids, mut angles, mut times) = (Vec::new(), Vec::new(), Vec::new());
    for r in raw.chunks_exact(record_len) {
        let word = |at: usize| u16::from_le_bytes(r[at..at + 2].try_into().unwrap());
        let time = |at: usize| u64::from_le_bytes(r[at..at + 8].try_into().unwrap());
        if format < 6 {
            ids.push(word(18));
            angles.push((f64::from(r[16] as i8) * 1000.0 / 6.0).round() as i16);
        } else {
            ids.push(word(20));
            angles.push(word(18) as i16);
        }
        match format {
            0 | 2 => {}
            1 | 3..=5 => times.push(time(20)),
            _ => times.push(time(22)),
        }
    }
    (ids, angles, times)
}

/// Appends `block` to `all`.
pub fn append(all: &mut PointBlock, block: &PointBlock) {
    assert!(block.len() <= lasray::source::BLOCK_RECORDS && !block.is_empty());
    all.x.extend(&block.x);
    all.y.extend(&block.y);
    all.z.extend(&block.z);
    all.class.extend(&block.class);
    all.flags.extend(&block.flags);
    all.intensity.extend(&block.intensity);
    all.returns.extend(&block.returns);
    all.rgb.extend(&block.rgb);
}

/// Everything that `file` gives, and the chunks that failed.
pub fn decode_all(file: &LidarFile) -> (PointBlock, Vec<SourceError>) {
    let (mut all, mut errors) = (PointBlock::default(), Vec::new());
    let mut decoder = Decoder::default();
    for chunk in &file.chunks {
        let mut next = chunk.first_record;
        let result = decoder.decode(file, chunk, 0..u64::MAX, &mut |block| {
            assert_eq!(block.first_record, next);
            next += block.len() as u64;
            append(&mut all, block);
        });
        errors.extend(result.err());
    }
    (all, errors)
}

/// Real files: `../shared/data`, or `LASRAY_DATA`; says so where there are none.
pub fn data_dir() -> Option<PathBuf> {
    let dir = std::env::var_os("LASRAY_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    eprintln!("skipped: no real files at {} (set LASRAY_DATA)", dir.display());
    None
}

/// The small files that the `las` crate's package carries, where cargo keeps it.
pub fn las_crate_files() -> Vec<PathBuf> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|h| h.join(".cargo"))).unwrap_or_default();
    let pattern = home.join("registry/src/*/las-0.11*/tests/data/*.la[sz]");
    let files: Vec<_> = glob::glob(&pattern.to_string_lossy()).unwrap().filter_map(Result::ok).collect();
    if files.is_empty() {
        eprintln!("skipped: no files at {}", pattern.display());
    }
    files
}

/// All LAS and LAZ files below `dir`, sorted.
pub fn lidar_files(dir: &Path) -> Vec<PathBuf> {
    let is_lidar = |p: &Path| {
        let extension = p.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        extension == "las" || extension == "laz"
    };
    let mut files: Vec<_> = walkdir::WalkDir::new(dir)
        .into_iter()
        .map(|e| e.unwrap().into_path())
        .filter(|p| is_lidar(p))
        .collect();
    files.sort();
    files
}
