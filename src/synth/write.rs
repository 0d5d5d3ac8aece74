//! Tiles to LAS and LAZ files, whole or not at all.

use super::scan::{ORIGIN, SCALE, ScanBlock, Tile, scan};
use super::town::Town;
use crate::output::{SOFTWARE, head};
use laz::LasZipCompressor;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use tempfile::NamedTempFile;

/// ETRS89 / UTM zone 32N, where the town would lie.
const EPSG: u16 = 25832;
/// What stands in the place of a scanner's name.
const SYSTEM: &str = "SYNTHETIC";
/// Bytes gathered before the file is written to.
const BUFFER_BYTES: usize = 1 << 20;

/// Point format of written files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Point format 3 in LAS 1.2, CRS as GeoTIFF keys.
    Three,
    /// Point format 7 in LAS 1.4, CRS as WKT.
    Seven,
}

impl Format {
    fn number(self) -> u8 {
        match self {
            Format::Three => 3,
            Format::Seven => 7,
        }
    }

    /// Bytes in a record (LAS 1.4 R15, tables 10 and 16).
    pub fn record_bytes(self) -> usize {
        match self {
            Format::Three => 34,
            Format::Seven => 36,
        }
    }
}

/// What kept a tile from being written.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// The file could not be made, written or moved into place.
    #[error("{path}: cannot {what}: {source}")]
    Io {
        /// The file that was wanted.
        path: PathBuf,
        /// What was tried.
        what: &'static str,
        /// The system's word.
        source: std::io::Error,
    },
    /// The crates that write LAS or LAZ refused.
    #[error("{path}: cannot write the header: {message}")]
    Header {
        /// The file that was wanted.
        path: PathBuf,
        /// The crate's word.
        message: String,
    },
    /// More points than a LAS 1.2 header can count.
    #[error("{path}: {points} points in one file need format 7: LAS 1.2 counts to {}", u32::MAX)]
    TooManyPoints {
        /// The file that was wanted.
        path: PathBuf,
        /// Points asked for.
        points: u64,
    },
    /// Something is there that this program has not made.
    #[error("{path}: refused: the file there was not made by `lasray synth`: give another name")]
    Foreign {
        /// The file that was wanted.
        path: PathBuf,
    },
    /// Asked to stop.
    #[error("{path}: stopped; nothing was left behind")]
    Stopped {
        /// The file that was being written.
        path: PathBuf,
    },
}

/// Whether a point cloud of this making, a regular file, is at `path`; `None`: nothing is.
/// (LAS 1.4 R15, 2.4: system identifier from byte 26 on, generating software from byte 58 on, 32 bytes each.)
pub fn is_made_here(path: &Path) -> Option<bool> {
    let Ok(there) = path.symlink_metadata() else { return None };
    let head = if there.is_file() { head(path).unwrap_or_default() } else { Vec::new() };
    let has = |at: usize, mark: &[u8]| head.get(at..).is_some_and(|rest| rest.starts_with(mark));
    Some(has(0, b"LASF") && has(26, SYSTEM.as_bytes()) && has(58, b"lasray "))
}

/// Scans `tile` into the file `path`, LAZ if `compress`; the file appears when it is complete, and replaces an
/// older one that was made here, nothing else. Calls `progress` with the number of points of each block written, and stops when `stop` is set.
///
/// # Errors
/// [`SynthError`]; then nothing of the new file remains, and an older one is untouched.
pub fn write_tile(
    town: &Town,
    tile: &Tile,
    path: &Path,
    format: Format,
    compress: bool,
    stop: &AtomicBool,
    mut progress: impl FnMut(u64),
) -> Result<(), SynthError> {
    let io = |what: &'static str| {
        move |source: std::io::Error| SynthError::Io { path: path.to_owned(), what, source }
    };
    if format == Format::Three && tile.points > u64::from(u32::MAX) {
        return Err(SynthError::TooManyPoints { path: path.to_owned(), points: tile.points });
    }
    let refused = |error: &dyn std::fmt::Display| SynthError::Header {
        path: path.to_owned(),
        message: error.to_string(),
    };
    let header = header(format, compress).map_err(|e| refused(&e))?;
    let mut file =
        BufWriter::with_capacity(BUFFER_BYTES, temporary_beside(path).map_err(io("create the file"))?);
    header.write_to(&mut file).map_err(|e| refused(&e))?;

    let mut output = if compress {
        let vlr = header.laz_vlr().map_err(|e| refused(&e))?;
        Output::Laz(LasZipCompressor::new(file, vlr).map_err(|e| refused(&e))?)
    } else {
        Output::Las(file)
    };
    let mut totals = Totals::default();
    let mut records = Vec::new();
    scan(town, tile, |block| {
        if stop.load(Ordering::Relaxed) {
            return Err(SynthError::Stopped { path: path.to_owned() });
        }
        encode(block, format, &mut records);
        totals.add(block);
        match &mut output {
            Output::Las(file) => file.write_all(&records),
            Output::Laz(compressor) => compressor.compress_many(&records),
        }
        .map_err(io("write points"))?;
        progress(block.len() as u64);
        Ok(())
    })?;
    let mut file = match output {
        Output::Las(file) => file,
        Output::Laz(mut compressor) => {
            compressor.done().map_err(io("write the chunk table"))?;
            compressor.into_inner()
        }
    };
    // The header again, now that counts and bounds are known.
    let mut raw = header.into_raw().map_err(|e| refused(&e))?;
    totals.store(&mut raw, format);
    file.seek(SeekFrom::Start(0)).map_err(io("return to the header"))?;
    raw.write_to(&mut file).map_err(|e| refused(&e))?;
    let file = file.into_inner().map_err(|e| io("write points")(e.into_error()))?;
    file.as_file().sync_all().map_err(io("write points"))?;
    if is_made_here(path) == Some(false) {
        return Err(SynthError::Foreign { path: path.to_owned() });
    }
    file.persist(path).map_err(|e| io("put the file in place")(e.error))?;
    Ok(())
}

enum Output {
    Las(BufWriter<NamedTempFile>),
    Laz(LasZipCompressor<'static, BufWriter<NamedTempFile>>),
}

/// A file in the folder of `path` that vanishes unless it is persisted.
fn temporary_beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    // Opened here, not by the crate: readable by whom the umask allows, and errors are the system's own words.
    tempfile::Builder::new().prefix(".lasray-").suffix(".part").make_in(folder, |path| {
        std::fs::OpenOptions::new().read(true).write(true).create_new(true).open(path)
    })
}

fn header(format: Format, compress: bool) -> las::Result<las::Header> {
    let mut builder = match format {
        Format::Three => las::Builder::from((1, 2)),
        Format::Seven => las::Builder::from((1, 4)),
    };
    builder.point_format = las::point::Format::new(format.number())?;
    builder.point_format.is_compressed = compress;
    builder.gps_time_type = las::GpsTimeType::Standard;
    builder.system_identifier = SYSTEM.to_owned();
    builder.generating_software = SOFTWARE.to_owned();
    let axis = |offset: f64| las::Transform { scale: SCALE, offset };
    builder.transforms = las::Vector { x: axis(ORIGIN[0]), y: axis(ORIGIN[1]), z: axis(0.0) };
    if format == Format::Three {
        builder.vlrs.push(geotiff_keys());
    }
    let mut header = builder.into_header()?;
    if format == Format::Seven {
        let crs = crs_definitions::from_code(EPSG).expect("the crate defines EPSG:25832");
        // The record ends with a null byte (LAS 1.4 R15, 2.7).
        header.set_wkt_crs([crs.wkt.as_bytes(), &[0]].concat())?;
    }
    if compress {
        header.add_laz_vlr()?;
    }
    Ok(header)
}

/// The GeoTIFF key directory of a projected CRS (OGC 19-008r4, 7.1).
fn geotiff_keys() -> las::Vlr {
    // Version 1.1.0 and the number of keys; then key, location, count, value.
    let keys: [[u16; 4]; 5] = [
        [1, 1, 0, 4],
        [1024, 0, 1, 1],    // GTModelType: projected
        [3072, 0, 1, EPSG], // ProjectedCRS
        [3076, 0, 1, 9001], // ProjLinearUnits: metre
        [4099, 0, 1, 9001], // VerticalUnits: metre
    ];
    las::Vlr {
        user_id: "LASF_Projection".to_owned(),
        record_id: 34735,
        description: "GeoTIFF keys".to_owned(),
        data: keys.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect(),
    }
}

/// Records of `format` (LAS 1.4 R15, tables 10 and 16) from the columns of `block`, replacing what `out` held.
fn encode(block: &ScanBlock, format: Format, out: &mut Vec<u8>) {
    let points = &block.points;
    let size = format.record_bytes();
    out.clear();
    out.resize(block.len() * size, 0);
    for (k, record) in out.chunks_exact_mut(size).enumerate() {
        record[0..4].copy_from_slice(&points.x[k].to_le_bytes());
        record[4..8].copy_from_slice(&points.y[k].to_le_bytes());
        record[8..12].copy_from_slice(&points.z[k].to_le_bytes());
        record[12..14].copy_from_slice(&points.intensity[k].to_le_bytes());
        let (number, count) = (points.returns[k] & 15, points.returns[k] >> 4);
        let edge = u8::from(block.edge_of_line[k]) << 7;
        // The mirror turns one way: every scan line runs in the positive direction.
        let scan_direction = 1 << 6;
        let (source, time, color) = match format {
            Format::Three => {
                record[14] = number | count << 3 | scan_direction | edge;
                record[15] = points.class[k] & 31;
                record[16] = block.scan_angle[k].round() as i8 as u8;
                (18, 20, 28)
            }
            Format::Seven => {
                record[14] = points.returns[k];
                record[15] = points.flags[k] & 15 | scan_direction | edge;
                record[16] = points.class[k];
                // Steps of 0.006 degrees.
                let angle = (block.scan_angle[k] / 0.006).round() as i16;
                record[18..20].copy_from_slice(&angle.to_le_bytes());
                (20, 22, 30)
            }
        };
        record[source..source + 2].copy_from_slice(&block.source_id[k].to_le_bytes());
        record[time..time + 8].copy_from_slice(&block.gps_time[k].to_le_bytes());
        for (channel, value) in points.rgb[k].iter().enumerate() {
            let at = color + 2 * channel;
            record[at..at + 2].copy_from_slice(&value.to_le_bytes());
        }
    }
}

/// What the header says of all points.
struct Totals {
    min: [i32; 3],
    max: [i32; 3],
    by_return: [u64; 15],
}

impl Default for Totals {
    fn default() -> Totals {
        Totals { min: [i32::MAX; 3], max: [i32::MIN; 3], by_return: [0; 15] }
    }
}

impl Totals {
    fn add(&mut self, block: &ScanBlock) {
        let points = &block.points;
        for (axis, column) in [&points.x, &points.y, &points.z].into_iter().enumerate() {
            for &value in column {
                self.min[axis] = self.min[axis].min(value);
                self.max[axis] = self.max[axis].max(value);
            }
        }
        for returns in &points.returns {
            self.by_return[usize::from(returns & 15) - 1] += 1;
        }
    }

    fn store(&self, raw: &mut las::raw::Header, format: Format) {
        let total: u64 = self.by_return.iter().sum();
        match format {
            Format::Three => {
                raw.number_of_point_records = total as u32; // checked against u32::MAX before the scan
                raw.number_of_points_by_return = std::array::from_fn(|k| self.by_return[k] as u32);
            }
            // Formats 6 and up leave the legacy counts at zero (LAS 1.4 R15, 2.4).
            Format::Seven => {
                raw.large_file = Some(las::raw::header::LargeFile {
                    number_of_point_records: total,
                    number_of_points_by_return: self.by_return,
                });
            }
        }
        if total > 0 {
            let world =
                |value: i32, axis: usize| f64::from(value) * SCALE + [ORIGIN[0], ORIGIN[1], 0.0][axis];
            [raw.min_x, raw.min_y, raw.min_z] = std::array::from_fn(|axis| world(self.min[axis], axis));
            [raw.max_x, raw.max_y, raw.max_z] = std::array::from_fn(|axis| world(self.max[axis], axis));
        }
    }
}
