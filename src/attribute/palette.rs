//! The palette of point source ids: 256 colours for 65,536 numbers.

use super::oklab::oklab_to_srgb;
use std::collections::BTreeSet;

/// What the high byte of an id counts where it does not matter: ids that follow each other have different entries.
const USUAL_STEP: u32 = 37;
/// More ids than this share entries whatever is done.
const MOST_APART: usize = 256;

/// Which entries ids have, and in which colours.
pub(super) struct SourcePalette {
    /// What the high byte of an id counts, beside its low byte.
    pub step: u32,
    /// sRGB of each entry.
    pub colors: [[u8; 3]; 256],
}

impl SourcePalette {
    /// For data with these ids, ascending: the first ones have the colours that differ most, and no two of them an entry, as far
    /// as there is a step for that.
    pub fn of(ids: &[u16]) -> SourcePalette {
        let entries = |step: u32| ids.iter().map(move |id| entry(u32::from(*id), step));
        let apart = |step: &u32| entries(*step).collect::<BTreeSet<u32>>().len();
        let steps = || std::iter::once(USUAL_STEP).chain((0..256).filter(|step| *step != USUAL_STEP));
        let step = match ids.len() {
            0..=MOST_APART => {
                steps().find(|step| apart(step) == ids.len()).or_else(|| steps().max_by_key(apart))
            }
            _ => None,
        };
        let step = step.unwrap_or(USUAL_STEP);
        let mut colors = std::array::from_fn(color);
        let mut taken = [false; 256];
        for (rank, entry) in entries(step).enumerate() {
            if !std::mem::replace(&mut taken[entry as usize], true) {
                colors[entry as usize] = color(rank);
            }
        }
        SourcePalette { step, colors }
    }
}

/// The entry that an id has.
pub(super) fn entry(id: u32, step: u32) -> u32 {
    (id + step * (id >> 8)) & 255
}

/// sRGB of the id that comes after so many others: hues turn by the golden angle, and those that come close differ in lightness.
fn color(rank: usize) -> [u8; 3] {
    const LIGHTNESS: [f64; 3] = [0.70, 0.52, 0.84];
    const CHROMA: f64 = 0.13;
    let hue = (40.0 + rank as f64 * 137.507_764_05).to_radians();
    // After 21 turns hues are nearly the first again.
    let lightness = LIGHTNESS[(rank + rank / 21) % LIGHTNESS.len()];
    let lab = [lightness, CHROMA * hue.cos(), CHROMA * hue.sin()];
    oklab_to_srgb(lab).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::super::oklab::{oklab_distance, srgb_to_oklab};
    use super::*;

    /// How far the two of some ids that are most alike are apart.
    fn least_apart(ids: &[u16]) -> f64 {
        let palette = SourcePalette::of(ids);
        let lab = |id: &u16| {
            let color = palette.colors[entry(u32::from(*id), palette.step) as usize];
            srgb_to_oklab(color.map(|v| f64::from(v) / 255.0))
        };
        let labs: Vec<_> = ids.iter().map(lab).collect();
        let pairs = labs.iter().enumerate().flat_map(|(k, a)| labs[..k].iter().map(move |b| (*a, *b)));
        pairs.map(|(a, b)| oklab_distance(a, b)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn ids_that_are_there_differ_well() {
        assert!(least_apart(&[44_266, 57_138]) > 0.2);
        // Such that all share an entry by the usual step.
        let alike: Vec<u16> = (0..16u32).map(|k| ((k << 8) + ((219 * k) & 255)) as u16).collect();
        assert_eq!(alike.iter().map(|id| entry((*id).into(), USUAL_STEP)).collect::<BTreeSet<_>>().len(), 1);
        let spread: Vec<u16> = (0..16).map(|k| 1 + k * 4093).collect();
        let neighbours: Vec<u16> = (7_320..7_336).collect();
        for ids in [alike, spread, neighbours] {
            assert!(least_apart(&ids) > 0.08, "{ids:?}: {}", least_apart(&ids));
        }
        // More than there are colours.
        let many: Vec<u16> = (0..1000).map(|k| k * 65).collect();
        assert_eq!(SourcePalette::of(&many).step, USUAL_STEP);
    }
}
