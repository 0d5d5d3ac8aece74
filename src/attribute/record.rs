//! Attributes of a point record, and how they are packed.

use super::flags::{Flags, Kind};
use crate::coords::Height;
use crate::shared::payload::{
    HEIGHT_SIGN, RUN_BLUE_SHIFT, RUN_CLASS_SHIFT, RUN_GREEN_SHIFT, RUN_INTENSITY_SHIFT, RUN_RETURNS_SHIFT,
    RUN_WORDS,
};
use bytemuck::{Pod, Zeroable};

/// What a column keeps of the point that won it. The order of the fields is the order in which points
/// are compared: the larger wins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Attributes {
    /// Height on the lattice.
    pub height: Height,
    /// ASPRS class, the whole byte.
    pub class: u8,
    /// Pulse return magnitude, as stored.
    pub intensity: u16,
    /// sRGB, 8 bit a channel; black when the file has no colour.
    pub rgb: [u8; 3],
    /// Return number in the low nibble, number of returns in the high nibble.
    pub returns: u8,
    /// `source::FLAG_…`.
    pub flags: u8,
}

/// [`Attributes`] as three words, shared with the shaders. Comparing the words from first to last is
/// comparing the attributes, so a maximum over records picks the winner of a cell:
///
/// | word | bits 31-24 | 23-16 | 15-8 | 7-0 |
/// |---|---|---|---|---|
/// | 0 | height, biased by 2³¹; 0 = no point | | | |
/// | 1 | class | intensity, high | intensity, low | red |
/// | 2 | green | blue | returns | flags |
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct Record(pub [u32; RUN_WORDS as usize]);

impl Record {
    /// No point: below every other record.
    pub const EMPTY: Record = Record([0; 3]);

    /// Packs `a`.
    #[inline]
    pub fn pack(a: Attributes) -> Record {
        let [r, g, b] = a.rgb.map(u32::from);
        let [class, returns, flags] = [a.class, a.returns, a.flags].map(u32::from);
        Record([
            bias(a.height),
            class << RUN_CLASS_SHIFT | u32::from(a.intensity) << RUN_INTENSITY_SHIFT | r,
            g << RUN_GREEN_SHIFT | b << RUN_BLUE_SHIFT | returns << RUN_RETURNS_SHIFT | flags,
        ])
    }

    /// The attributes; `None` for an empty record.
    #[inline]
    pub fn unpack(self) -> Option<Attributes> {
        let height = self.height()?;
        let [_, w1, w2] = self.0;
        Some(Attributes {
            height,
            class: self.class(),
            intensity: (w1 >> RUN_INTENSITY_SHIFT) as u16,
            rgb: [w1, w2 >> RUN_GREEN_SHIFT, w2 >> RUN_BLUE_SHIFT].map(|word| word as u8),
            returns: (w2 >> RUN_RETURNS_SHIFT) as u8,
            flags: self.flags(),
        })
    }

    /// No point.
    #[inline]
    pub fn is_empty(self) -> bool {
        self.0[0] == 0
    }

    /// Height on the lattice; `None` for an empty record.
    #[inline]
    pub fn height(self) -> Option<Height> {
        (!self.is_empty()).then(|| unbias(self.0[0]))
    }

    /// ASPRS class.
    #[inline]
    pub fn class(self) -> u8 {
        (self.0[1] >> RUN_CLASS_SHIFT) as u8
    }

    /// Flags, [`crate::source::FLAG_WITHHELD`] and its neighbours, and what formats keep beside them.
    #[inline]
    pub fn flags(self) -> u8 {
        self.0[2] as u8
    }

    /// What shows or hides it.
    #[inline]
    pub fn kind(self) -> Kind {
        (self.class(), Flags::of(self.flags()))
    }
}

/// Height as an unsigned number of the same order; 0 is left free, since `Height` is never `i32::MIN`.
#[inline]
pub(crate) fn bias(height: Height) -> u32 {
    height.0 as u32 ^ HEIGHT_SIGN
}

/// The height of [`bias`].
#[inline]
pub(crate) fn unbias(word: u32) -> Height {
    Height((word ^ HEIGHT_SIGN) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn attributes() -> impl Strategy<Value = Attributes> {
        // Few values a field, so that ties reach the last one.
        let byte = || prop_oneof![Just(0u8), Just(1), Just(127), Just(128), Just(255)];
        let height =
            prop_oneof![Just(i32::MIN + 1), Just(-1), Just(0), Just(1), Just(i32::MAX), any::<i32>()];
        let intensity = prop_oneof![Just(0u16), Just(255), Just(256), Just(u16::MAX)];
        (height, byte(), intensity, [byte(), byte(), byte()], byte(), byte()).prop_map(
            |(h, class, intensity, rgb, returns, flags)| Attributes {
                height: Height(h.max(i32::MIN + 1)),
                class,
                intensity,
                rgb,
                returns,
                flags,
            },
        )
    }

    proptest! {
        #[test]
        fn order_of_words_is_order_of_attributes(a in attributes(), b in attributes()) {
            prop_assert_eq!(Record::pack(a).cmp(&Record::pack(b)), a.cmp(&b));
            prop_assert_eq!(Record::pack(a).unpack(), Some(a));
            prop_assert_eq!(Record::pack(a).height(), Some(a.height));
            prop_assert_eq!(Record::pack(a).class(), a.class);
            prop_assert!(Record::pack(a) > Record::EMPTY);
        }
    }

    #[test]
    fn words_are_laid_out_as_documented() {
        let a = Attributes {
            height: Height(5),
            class: 6,
            intensity: 0x1234,
            rgb: [0xaa, 0xbb, 0xcc],
            returns: 0x21,
            flags: 4,
        };
        assert_eq!(Record::pack(a).0, [0x8000_0005, 0x0612_34aa, 0xbbcc_2104]);
        assert_eq!(Record::EMPTY.unpack(), None);
    }
}
