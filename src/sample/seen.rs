//! A point of the sample, as it is stored, and whether it is shown by default.

use crate::attribute::{ClassMask, Flags, Kind};
use crate::source::{LidarFile, PointBlock, Selection};
use glam::DVec3;

/// What of the points is to be shown at first: ranges of colours and framing are chosen from that, the cell size is not.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Classes; by default all but noise.
    pub classes: ClassMask,
    /// But for points that have one of these flags; by default withheld ones.
    pub hidden_flags: Flags,
    /// Points that take part at all.
    pub selection: Selection,
}

impl Default for Asked {
    fn default() -> Asked {
        let (classes, selection) = (ClassMask::default(), Selection::default());
        Asked { classes, hidden_flags: Flags::WITHHELD, selection }
    }
}

impl Asked {
    /// Whether a point is.
    #[inline]
    pub fn shows(&self, class: u8, flags: u8) -> bool {
        self.classes.shows(class) && !Flags::of(flags).has_any(self.hidden_flags)
    }
}

/// Whether a point is hidden unless asked for: noise and withheld.
#[inline]
pub fn hidden_by_default(class: u8, flags: u8) -> bool {
    matches!(class, 7 | 18) || Flags::of(flags).has_any(Flags::WITHHELD)
}

/// A point of the sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub raw: [i32; 3],
    pub class: u8,
    pub flags: u8,
    pub returns: u8,
    pub intensity: u16,
    pub rgb: [u16; 3],
    pub source_id: u16,
    /// In steps of 0.006°.
    pub scan_angle: i16,
    /// Not a number: there is none.
    pub gps_time: f64,
    /// It takes part.
    pub is_selected: bool,
}

impl Seen {
    /// What shows or hides it.
    pub(super) fn kind(&self) -> Kind {
        (self.class, Flags::of(self.flags))
    }
}

/// Adds the points of a block; whether they take part, as far as that does not depend on where they lie.
pub(super) fn append(block: &PointBlock, selection: &Selection, seen: &mut Vec<Seen>) {
    seen.extend((0..block.len()).map(|i| Seen {
        raw: [block.x[i], block.y[i], block.z[i]],
        class: block.class[i],
        flags: block.flags[i],
        returns: block.returns[i],
        intensity: block.intensity[i],
        rgb: block.rgb.get(i).copied().unwrap_or_default(),
        source_id: block.source_id.get(i).copied().unwrap_or_default(),
        scan_angle: block.scan_angle.get(i).copied().unwrap_or_default(),
        gps_time: block.gps_time.get(i).copied().unwrap_or(f64::NAN),
        is_selected: selection.holds(block, i),
    }));
}

/// File coordinates of a raw point.
pub(super) fn unpack(file: &LidarFile, raw: [i32; 3]) -> DVec3 {
    let (scale, offset) = (file.header.scale, file.header.offset);
    let [x, y, z] = raw.map(f64::from);
    DVec3::new(x * scale.x + offset.x, y * scale.y + offset.y, z * scale.z + offset.z)
}
