//! Everything that `lasray info` tells of files: what is printed, and what is written as JSON.

use super::classes::ClassCount;
use super::ranges::Box3;
use super::scan::Scan;
use crate::source::crs::{Crs, CrsKind, Unit};
use serde::Serialize;

/// Everything that is printed.
#[derive(Debug, Serialize)]
pub(super) struct InfoReport {
    pub files: Vec<FileReport>,
    /// Inputs that could not be used, and why.
    pub failed: Vec<String>,
    pub all: Total,
}

/// One file.
#[derive(Debug, Serialize)]
pub(super) struct FileReport {
    pub path: String,
    /// LAS version.
    pub version: String,
    /// LAS, LAZ or COPC.
    pub kind: &'static str,
    /// What the points are.
    pub point_format: u8,
    /// The format that they are kept in, where it is another one: LASzip's compatibility mode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept_as: Option<u8>,
    /// Points that can be read.
    pub points: u64,
    /// Points that the header claims.
    pub claimed_points: u64,
    pub chunks: usize,
    /// As the header has them, file coordinates; null where they are no bounds.
    pub bounds: Option<Box3>,
    /// Digits behind the point that its coordinates have.
    #[serde(skip)]
    pub decimals: [usize; 3],
    pub crs: Option<CrsReport>,
    /// Points in a square world unit of its bounds.
    pub density: Option<f64>,
    /// "absent" where the format has none; "none" where the fields hold no colour.
    pub rgb: &'static str,
    /// As stored, where it is the same everywhere and not black.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rgb_constant: Option<[u16; 3]>,
    /// Its coordinate system is transformed into that of all.
    pub transformed: bool,
    /// Some of its points were not looked at.
    #[serde(skip)]
    pub is_sampled: bool,
    /// It is not drawn, since there is no way from its coordinate system into that of all.
    pub left_out: bool,
    /// A part of it could not be read.
    #[serde(skip)]
    pub unreadable: bool,
    pub warnings: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scan: Option<Scan>,
}

impl FileReport {
    /// Points are missing.
    pub fn is_damaged(&self) -> bool {
        self.unreadable || self.scan.as_ref().is_some_and(|scan| !scan.damage.is_empty())
    }
}

/// All files that are drawn.
#[derive(Debug, Serialize)]
pub(super) struct Total {
    pub files: usize,
    pub points: u64,
    /// World coordinates, without stray points: what a picture frames.
    pub bounds: Option<Box3>,
    #[serde(skip)]
    pub decimals: [usize; 3],
    pub crs: Option<CrsReport>,
    /// Of world coordinates.
    pub unit: Option<Unit>,
    /// Points of different E, N in a square unit of the ground they cover.
    pub density: f64,
    /// What `--cell auto` comes to, world units.
    pub cell: f64,
    /// Step of the heights' lattice beside such cells, world units; none where there is none.
    pub height_step: Option<f64>,
    /// Share of the ground's cells that hold a point at that size.
    pub coverage: f64,
    /// What `--color auto` comes to.
    pub color: &'static str,
    /// Percentiles 2 and 98 of shown points.
    pub height_p2_p98: [f64; 2],
    pub intensity_p2_p98: [f64; 2],
    /// Points that density, cell and colour rest on, and classes unless they were counted.
    pub sampled: u64,
    /// Classes that were seen, by number.
    pub classes: Vec<ClassCount>,
    /// Their points were counted, every one; otherwise they are estimates, and rare classes may be missing.
    pub classes_counted: bool,
    pub notes: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scan: Option<Scan>,
}

/// A coordinate system.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct CrsReport {
    pub name: String,
    pub epsg: Option<u32>,
    pub kind: CrsKind,
    pub unit: Unit,
    pub vertical_unit: Option<Unit>,
}

impl From<&Crs> for CrsReport {
    fn from(crs: &Crs) -> CrsReport {
        CrsReport {
            name: crs.name.clone(),
            epsg: crs.epsg,
            kind: crs.kind,
            unit: crs.horizontal_unit.clone(),
            vertical_unit: crs.vertical_unit.clone(),
        }
    }
}
