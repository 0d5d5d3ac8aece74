//! How many points there are of each kind.

use super::class::Kinds;
use std::collections::BTreeMap;

/// Points of each kind: class, and whether they are withheld.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KindCounts {
    /// Kinds that occur. Of a kind that was seen there is at least one point.
    pub of: BTreeMap<(u8, bool), u64>,
    /// Every point was counted; otherwise those that were not are estimated.
    pub is_exact: bool,
}

impl KindCounts {
    /// Points of a class, withheld or not, and how many of them are withheld.
    pub fn of_class(&self, class: u8) -> [u64; 2] {
        let [shown, withheld] = [false, true].map(|withheld| self.of.get(&(class, withheld)).copied());
        [shown.unwrap_or(0) + withheld.unwrap_or(0), withheld.unwrap_or(0)]
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
