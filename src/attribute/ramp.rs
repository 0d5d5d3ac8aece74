//! Colour ramps.

use super::oklab::{even_path, oklab_to_srgb};
use clap::ValueEnum;

/// A colour ramp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Ramp {
    /// Blue-green lowland to pale heights: even steps to the eye, and never so dark that relief drowns.
    Relief,
    /// Dark violet, green, yellow; even steps to the eye.
    Viridis,
    /// Blue to yellow; the same with colour-blind eyes.
    Cividis,
    /// Black, red, pale yellow; even steps to the eye.
    Magma,
    /// Rainbow: many hues, uneven to the eye.
    Turbo,
    /// Dark to light grey.
    Grey,
    /// Blue, yellow, red, with a break at half the height: seed of the method, §3.3.4.
    Thesis,
}

/// Control colours of [`Ramp::Relief`], sRGB; lightness rises from each to the next.
const RELIEF: [[u8; 3]; 6] =
    [[44, 94, 122], [58, 128, 116], [112, 158, 88], [190, 184, 98], [232, 206, 148], [252, 242, 224]];

impl Ramp {
    /// As typed.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// sRGB colour at `t` in 0 to 1.
    pub fn at(self, t: f64) -> [f64; 3] {
        let t = t.clamp(0.0, 1.0);
        let published = |g: colorous::Gradient| {
            let c = g.eval_continuous(t);
            [c.r, c.g, c.b].map(|v| f64::from(v) / 255.0)
        };
        match self {
            Ramp::Relief => oklab_to_srgb(even_path(&RELIEF, t)).map(|v| v.clamp(0.0, 1.0)),
            Ramp::Viridis => published(colorous::VIRIDIS),
            Ramp::Cividis => published(colorous::CIVIDIS),
            Ramp::Magma => published(colorous::MAGMA),
            Ramp::Turbo => published(colorous::TURBO),
            Ramp::Grey => [0.12 + 0.86 * t; 3],
            Ramp::Thesis => {
                let h = 2.0 * t;
                if h >= 1.0 { [1.0, 2.0 - h, 0.0] } else { [h, h, 1.0 - h] }
            }
        }
    }

    /// Table index that stands for t = 1. The break of `Thesis` at t = ½ must fall on an entry for the
    /// interpolation between entries to be exact.
    pub(super) fn last_index(self) -> f64 {
        if self == Ramp::Thesis { 254.0 } else { 255.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::super::oklab::{oklab_distance, srgb_to_oklab};
    use super::*;

    #[test]
    fn relief_rises_in_even_steps() {
        let path: Vec<_> = (0..=255).map(|i| srgb_to_oklab(Ramp::Relief.at(f64::from(i) / 255.0))).collect();
        let steps: Vec<f64> = path.windows(2).map(|w| oklab_distance(w[0], w[1])).collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        for (w, step) in path.windows(2).zip(&steps) {
            assert!(w[1][0] > w[0][0], "lightness falls: {w:?}");
            // A step over a corner between two stops is a little shorter.
            assert!((0.7..1.1).contains(&(step / mean)), "uneven: {step} of {mean}");
        }
        assert!(path[0][0] > 0.4, "relief would drown in the dark");
    }
}
