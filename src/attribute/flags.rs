//! The flags of a point's class, which show or hide it beside that.

use crate::shared::payload::KEY_FLAGS;
use std::collections::BTreeSet;

/// Flags of a point, or those whose points are hidden: bits of LAS 1.4 R15, table 9.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Flags(u8);

/// What shows or hides a point: its class and its flags.
pub type Kind = (u8, Flags);

/// Kinds of points.
pub type Kinds = BTreeSet<Kind>;

impl Flags {
    /// No flag.
    pub const NONE: Flags = Flags(0);
    /// Made by other means than the laser.
    pub const SYNTHETIC: Flags = Flags(1);
    /// Model key-point.
    pub const KEY_POINT: Flags = Flags(2);
    /// Withheld, i.e. deleted.
    pub const WITHHELD: Flags = Flags(4);
    /// In the overlap of two flight lines (formats 6 to 10).
    pub const OVERLAP: Flags = Flags(8);
    /// Those that points may have.
    pub const ALL: Flags = Flags(KEY_FLAGS as u8);
    /// Each of them, as users name it; that which is hidden unless asked for first.
    pub const NAMED: [(Flags, &str); 4] = [
        (Flags::WITHHELD, "withheld"),
        (Flags::OVERLAP, "overlap"),
        (Flags::SYNTHETIC, "synthetic"),
        (Flags::KEY_POINT, "key-point"),
    ];
    /// Sets of flags that there are.
    pub const SETS: usize = KEY_FLAGS as usize + 1;

    /// Of a byte of flags, which may have others above them.
    #[inline]
    pub const fn of(byte: u8) -> Flags {
        Flags(byte & Flags::ALL.0)
    }

    /// As bits.
    #[inline]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Those of either.
    #[must_use]
    pub const fn with(self, others: Flags) -> Flags {
        Flags(self.0 | others.0)
    }

    /// Those that are not among `others`.
    #[must_use]
    pub const fn without(self, others: Flags) -> Flags {
        Flags(self.0 & !others.0)
    }

    /// Those of both.
    #[must_use]
    pub const fn and(self, others: Flags) -> Flags {
        Flags(self.0 & others.0)
    }

    /// Whether there is any of `others` among them.
    #[inline]
    pub const fn has_any(self, others: Flags) -> bool {
        self.0 & others.0 != 0
    }

    /// Whether there are none.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// By the name that users give it.
    pub fn named(name: &str) -> Option<Flags> {
        Flags::NAMED.iter().find(|(_, known)| *known == name).map(|(flag, _)| *flag)
    }

    /// Each of them, and its name.
    pub fn each(self) -> impl Iterator<Item = (Flags, &'static str)> {
        Flags::NAMED.into_iter().filter(move |(flag, _)| self.has_any(*flag))
    }

    /// Their names, with commas between them.
    pub fn list(self) -> String {
        self.each().map(|(_, name)| name).collect::<Vec<_>>().join(",")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_have_names_and_all_of_them_are_named() {
        let all = Flags::NAMED.iter().fold(Flags::NONE, |all, (flag, _)| all.with(*flag));
        assert_eq!((all, Flags::SETS), (Flags::ALL, 16));
        for (flag, name) in Flags::NAMED {
            assert_eq!((Flags::named(name), flag.bits().count_ones()), (Some(flag), 1));
        }
        assert_eq!(Flags::named("Overlap"), None);
        let some = Flags::OVERLAP.with(Flags::WITHHELD);
        assert_eq!((some.list(), Flags::NONE.list()), ("withheld,overlap".to_owned(), String::new()));
        assert_eq!(
            (some.without(Flags::WITHHELD), some.and(Flags::OVERLAP)),
            (Flags::OVERLAP, Flags::OVERLAP)
        );
        // A scanner's channel and direction are no flags of the class.
        assert_eq!(Flags::of(0xF8), Flags::OVERLAP);
    }
}
