//! How many points there are of each kind.

use super::flags::{Flags, Kind, Kinds};
use std::collections::BTreeMap;

/// Points of each kind.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KindCounts {
    /// Kinds that occur. Of a kind that was seen there is at least one point.
    pub of: BTreeMap<Kind, u64>,
    /// Every point was counted; otherwise those that were not are estimated.
    pub is_exact: bool,
}

impl KindCounts {
    /// Points of a class.
    pub fn of_class(&self, class: u8) -> u64 {
        self.sum(class, |_| true)
    }

    /// Those of them that have any of these flags.
    pub fn flagged(&self, class: u8, flags: Flags) -> u64 {
        self.sum(class, |of_point| of_point.has_any(flags))
    }

    fn sum(&self, class: u8, is_meant: impl Fn(Flags) -> bool) -> u64 {
        let of_class = self.of.range((class, Flags::NONE)..=(class, Flags::ALL));
        of_class.filter(|((_, flags), _)| is_meant(*flags)).map(|(_, points)| points).sum()
    }

    /// Flags that occur.
    pub fn flags(&self) -> Flags {
        self.of.keys().fold(Flags::NONE, |all, (_, flags)| all.with(*flags))
    }

    /// Points of any class.
    pub fn all(&self) -> u64 {
        self.of.values().sum()
    }

    /// Kinds that occur.
    pub fn kinds(&self) -> Kinds {
        self.of.keys().copied().collect()
    }
}
