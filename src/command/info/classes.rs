//! Points of classes, as the report has them.

use crate::attribute::class_name;
use serde::Serialize;

/// Points of a class.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct ClassCount {
    pub class: u8,
    pub name: &'static str,
    pub points: u64,
}

impl ClassCount {
    /// Of those of all classes that are not 0.
    pub fn all(points: &[u64]) -> Vec<ClassCount> {
        let seen = (0..=255u8).zip(points).filter(|(_, points)| **points > 0);
        seen.map(|(class, &points)| ClassCount { class, name: class_name(class), points }).collect()
    }
}
