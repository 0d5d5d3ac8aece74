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

/// Lowest and highest of numbers that are no whole ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Span {
    pub min: f64,
    pub max: f64,
}

impl Span {
    /// Takes in another; of what is not a number there is none.
    pub fn merge(span: &mut Option<Span>, other: Option<Span>) {
        let Some(other) = other.filter(|other| other.min.is_finite() && other.max.is_finite()) else {
            return;
        };
        let all = span.get_or_insert(other);
        (all.min, all.max) = (all.min.min(other.min), all.max.max(other.max));
    }

    pub fn include(span: &mut Option<Span>, value: f64) {
        Span::merge(span, Some(Span { min: value, max: value }));
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
