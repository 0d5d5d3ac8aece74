//! ASPRS classes: which are shown, what they are called, how they are coloured.

use super::oklab::oklab_to_srgb;
use bytemuck::{Pod, Zeroable};
use std::collections::BTreeSet;

/// Which of the 256 classes are shown; bit `class % 32` of word `class / 32`, as the shaders read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct ClassMask(pub [u32; 8]);

impl Default for ClassMask {
    /// All but low noise (7) and high noise (18).
    fn default() -> ClassMask {
        ClassMask::all().without(&[7, 18])
    }
}

impl ClassMask {
    /// Every class.
    pub const fn all() -> ClassMask {
        ClassMask([u32::MAX; 8])
    }

    /// These classes alone.
    pub fn only(classes: &[u8]) -> ClassMask {
        ClassMask([0; 8]).with(classes)
    }

    /// Shows `classes` too.
    pub fn with(mut self, classes: &[u8]) -> ClassMask {
        classes.iter().for_each(|&c| self.0[usize::from(c >> 5)] |= 1 << (c & 31));
        self
    }

    /// Hides `classes`.
    pub fn without(mut self, classes: &[u8]) -> ClassMask {
        classes.iter().for_each(|&c| self.0[usize::from(c >> 5)] &= !(1 << (c & 31)));
        self
    }

    /// Whether `class` is shown.
    #[inline]
    pub fn shows(&self, class: u8) -> bool {
        self.0[usize::from(class >> 5)] >> (class & 31) & 1 != 0
    }
}

/// Kinds of points, by what shows or hides them: class, and whether they are withheld.
pub type Kinds = BTreeSet<(u8, bool)>;

/// Name of a class: LAS 1.4 R15, table 17; 8 and 12 as LAS 1.0 to 1.3 used them; 40 to 45 from the
/// topo-bathymetric domain profile.
pub fn class_name(class: u8) -> &'static str {
    match class {
        0 => "created, never classified",
        1 => "unclassified",
        2 => "ground",
        3 => "low vegetation",
        4 => "medium vegetation",
        5 => "high vegetation",
        6 => "building",
        7 => "low point (noise)",
        8 => "model key-point (legacy)",
        9 => "water",
        10 => "rail",
        11 => "road surface",
        12 => "overlap (legacy)",
        13 => "wire, guard (shield)",
        14 => "wire, conductor (phase)",
        15 => "transmission tower",
        16 => "wire-structure connector",
        17 => "bridge deck",
        18 => "high noise",
        19 => "overhead structure",
        20 => "ignored ground",
        21 => "snow",
        22 => "temporal exclusion",
        40 => "bathymetric point",
        41 => "water surface",
        42 => "derived water surface",
        43 => "submerged object",
        44 => "IHO S-57 object",
        45 => "no bottom found",
        23..64 => "reserved",
        64.. => "user-defined",
    }
}

/// Colours of classes 0 to 22, sRGB.
const CLASS_COLORS: [[u8; 3]; 23] = [
    [158, 158, 162], // created
    [196, 194, 188], // unclassified
    [168, 126, 84],  // ground
    [178, 214, 106], // low vegetation
    [104, 176, 72],  // medium vegetation
    [38, 124, 56],   // high vegetation
    [224, 96, 62],   // building
    [255, 0, 255],   // low noise
    [206, 160, 60],  // model key-point
    [62, 134, 214],  // water
    [116, 92, 148],  // rail
    [112, 118, 128], // road
    [214, 208, 154], // overlap
    [250, 226, 74],  // guard wire
    [255, 184, 0],   // conductor
    [64, 68, 150],   // tower
    [160, 116, 228], // connector
    [236, 164, 148], // bridge
    [255, 64, 148],  // high noise
    [0, 168, 168],   // overhead structure
    [116, 82, 62],   // ignored ground
    [236, 243, 252], // snow
    [146, 54, 70],   // temporal exclusion
];

/// sRGB colour of a class: fixed for 0 to 22; above, the hue turns by the golden angle from class to
/// class, so that neighbours differ and the colour never depends on what else is in the data.
pub fn class_color(class: u8) -> [u8; 3] {
    let k = f64::from(class);
    CLASS_COLORS.get(usize::from(class)).copied().unwrap_or_else(|| {
        let hue = (k * 137.507_764_05).to_radians();
        let (lightness, chroma) = (0.58 + 0.08 * (k % 4.0), 0.11);
        let lab = [lightness, chroma * hue.cos(), chroma * hue.sin()];
        oklab_to_srgb(lab).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
    })
}

#[cfg(test)]
mod tests {
    use super::super::oklab::{oklab_distance, srgb_to_oklab};
    use super::*;

    #[test]
    fn masks_show_and_hide_each_class() {
        let default = ClassMask::default();
        let hidden: Vec<u8> = (0..=255).filter(|&c| !default.shows(c)).collect();
        assert_eq!(hidden, [7, 18]);
        let only = ClassMask::only(&[2, 64, 255]);
        assert_eq!((0..=255).filter(|&c| only.shows(c)).collect::<Vec<u8>>(), [2, 64, 255]);
        assert_eq!(only.without(&[64]).0, [4, 0, 0, 0, 0, 0, 0, 0x8000_0000]);
    }

    #[test]
    fn class_colors_are_distinct() {
        let lab = |c: u8| srgb_to_oklab(class_color(c).map(|v| f64::from(v) / 255.0));
        for a in 0..=255u8 {
            for b in 0..a {
                let least = if a < 23 { 0.03 } else { 1e-3 };
                assert!(oklab_distance(lab(a), lab(b)) > least, "{a} looks like {b}");
            }
        }
        let greenest = |c: u8| class_color(c)[1] == *class_color(c).iter().max().unwrap();
        assert!(greenest(3) && greenest(4) && greenest(5));
    }
}
