//! Decoded points: columns of equal length, one an attribute, and the flags of their classes.

use crate::attribute::Flags;

/// Most records a [`PointBlock`] holds.
pub const BLOCK_RECORDS: usize = 65_536;

/// Up to [`BLOCK_RECORDS`] decoded points of one chunk, as columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointBlock {
    /// Index in the file of the block's first record.
    pub first_record: u64,
    /// Raw X of the record (E = X · scale + offset).
    pub x: Vec<i32>,
    /// Raw Y.
    pub y: Vec<i32>,
    /// Raw Z.
    pub z: Vec<i32>,
    /// ASPRS class, the whole byte (formats 0-5: the low five bits).
    pub class: Vec<u8>,
    /// [`FLAG_SYNTHETIC`] and its neighbours.
    pub flags: Vec<u8>,
    /// Pulse return magnitude.
    pub intensity: Vec<u16>,
    /// Return number in the low nibble, number of returns in the high nibble.
    pub returns: Vec<u8>,
    /// R, G, B as stored; empty when the format has none.
    pub rgb: Vec<[u16; 3]>,
    /// Point source id; empty unless [`Fields::source_id`].
    pub source_id: Vec<u16>,
    /// Scan angle in steps of 0.006°, of formats 0 to 5 their whole degrees; empty unless [`Fields::scan_angle`].
    pub scan_angle: Vec<i16>,
    /// GPS time, s; empty unless [`Fields::gps_time`], and when the format has none.
    pub gps_time: Vec<f64>,
}

/// What is decoded of points beside what pictures always need.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fields {
    /// Point source ids.
    pub source_id: bool,
    /// Scan angles.
    pub scan_angle: bool,
    /// GPS times.
    pub gps_time: bool,
}

impl Fields {
    /// All of them.
    pub const ALL: Fields = Fields { source_id: true, scan_angle: true, gps_time: true };
}

impl PointBlock {
    /// Points in it.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether it holds no point.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}

/// Class flag: made by other means than the laser (LAS 1.4 R15, table 9).
pub const FLAG_SYNTHETIC: u8 = Flags::SYNTHETIC.bits();
/// Class flag: model key-point.
pub const FLAG_KEY_POINT: u8 = Flags::KEY_POINT.bits();
/// Class flag: withheld, i.e. deleted.
pub const FLAG_WITHHELD: u8 = Flags::WITHHELD.bits();
/// Class flag: in the overlap of two flight lines (formats 6-10).
pub const FLAG_OVERLAP: u8 = Flags::OVERLAP.bits();
