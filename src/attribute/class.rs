//! ASPRS classes: which are shown, what they are called, how they are coloured.

use super::oklab::oklab_to_srgb;
use bytemuck::{Pod, Zeroable};

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

/// Whether a class says nothing of what a point is: never classified, unclassified, overlap of flight lines.
pub fn tells_nothing(class: u8) -> bool {
    matches!(class, 0 | 1 | 12)
}

/// Whether points of a class never float: ground, buildings, water, rails, roads.
pub const fn is_always_solid(class: u8) -> bool {
    matches!(class, 2 | 6 | 9 | 10 | 11 | 41)
}

/// Whether points of a class always float: vegetation, wires and what holds them, bridges, what hangs overhead, noise. Of the
/// others, that are not always solid either, what is beneath them tells.
pub const fn always_floats(class: u8) -> bool {
    matches!(class, 3..=5 | 7 | 13..=19)
}

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

/// Colours of classes 0 to 22, sRGB: those of a map. What covers much of the land is pale and grey, what is thin or rare, such
/// as wires, is strong.
const CLASS_COLORS: [[u8; 3]; 23] = [
    [160, 160, 162], // created
    [188, 187, 183], // unclassified
    [205, 190, 163], // ground
    [190, 204, 148], // low vegetation
    [150, 178, 116], // medium vegetation
    [100, 142, 90],  // high vegetation
    [190, 118, 100], // building
    [236, 60, 200],  // low noise
    [206, 166, 90],  // model key-point
    [126, 168, 204], // water
    [132, 112, 140], // rail
    [140, 143, 150], // road
    [206, 203, 176], // overlap
    [236, 214, 96],  // guard wire
    [232, 170, 50],  // conductor
    [88, 92, 150],   // tower
    [158, 128, 206], // connector
    [214, 168, 160], // bridge
    [240, 90, 150],  // high noise
    [80, 156, 158],  // overhead structure
    [158, 136, 112], // ignored ground
    [234, 240, 246], // snow
    [150, 84, 92],   // temporal exclusion
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
    fn classes_are_solid_or_float_or_neither() {
        let (solid, rest): (Vec<u8>, Vec<u8>) = (0..=255).partition(|&class| is_always_solid(class));
        let (floating, rest): (Vec<u8>, Vec<u8>) = rest.into_iter().partition(|&class| always_floats(class));
        assert_eq!(solid, [2, 6, 9, 10, 11, 41]);
        assert_eq!(floating, [3, 4, 5, 7, 13, 14, 15, 16, 17, 18, 19]);
        assert!(rest.iter().all(|&class| class >= 20 || matches!(class, 0 | 1 | 8 | 12)));
        assert_eq!(rest.len(), 256 - 6 - 11);
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
