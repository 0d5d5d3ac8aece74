//! Ranges of values, as the report has them.

use crate::coords::Bounds;
use serde::Serialize;

/// Lowest and highest value; upside down where there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Range {
    pub min: u16,
    pub max: u16,
}

impl Range {
    pub const NONE: Range = Range { min: u16::MAX, max: 0 };

    pub fn include(&mut self, value: u16) {
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }

    pub fn merge(&mut self, other: Range) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }
}

/// A box, E, N, U.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Box3 {
    pub min: [f64; 3],
    pub max: [f64; 3],
}

impl From<Bounds> for Box3 {
    fn from(bounds: Bounds) -> Box3 {
        Box3 { min: bounds.min.to_array(), max: bounds.max.to_array() }
    }
}
