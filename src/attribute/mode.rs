//! What points are coloured by.

use super::summary::AttributeSummary;
use clap::ValueEnum;

/// What a point is coloured by. The numbers are what the shaders switch on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[repr(u32)]
pub enum ColorMode {
    /// The points' own colours.
    Rgb = 0,
    /// Height, by a ramp.
    Height = 1,
    /// ASPRS class, by a palette.
    Class = 2,
    /// Intensity, by a ramp.
    Intensity = 3,
    /// Single, first, intermediate or last return.
    Return = 4,
}

impl ColorMode {
    /// As typed.
    pub fn name(self) -> &'static str {
        match self {
            ColorMode::Rgb => "rgb",
            ColorMode::Height => "height",
            ColorMode::Class => "class",
            ColorMode::Intensity => "intensity",
            ColorMode::Return => "return",
        }
    }

    /// RGB if 5 % of the sample is not black (and not all of one colour), else class if classes beyond
    /// 0, 1, 2, 7, 12 and 18 exceed 10 %, else height.
    pub fn auto(sample: &AttributeSummary) -> ColorMode {
        let telling: u64 = (0..=255u8)
            .filter(|c| !matches!(c, 0..=2 | 7 | 12 | 18))
            .map(|c| sample.classes[usize::from(c)])
            .sum();
        if sample.points == 0 {
            ColorMode::Height
        } else if sample.colored * 20 >= sample.points && sample.rgb_constant.is_none() {
            ColorMode::Rgb
        } else if telling * 10 > sample.points {
            ColorMode::Class
        } else {
            ColorMode::Height
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::summary::tests::{point, summary};
    use super::*;

    #[test]
    fn auto_mode_follows_what_the_data_has() {
        let mode = |rgb: fn(i32) -> [u8; 3], class: fn(i32) -> u8| {
            ColorMode::auto(&summary((0..100).map(|k| point(k, class(k), 0, rgb(k)))))
        };
        let black = |_| [0; 3];
        let ground = |_| 2;
        assert_eq!(mode(|k| if k < 5 { [9; 3] } else { [0; 3] }, ground), ColorMode::Rgb);
        assert_eq!(mode(|k| if k < 4 { [9; 3] } else { [0; 3] }, ground), ColorMode::Height);
        assert_eq!(mode(|_| [255; 3], ground), ColorMode::Height);
        assert_eq!(mode(black, |k| if k < 11 { 6 } else { 1 }), ColorMode::Class);
        assert_eq!(mode(black, |k| if k < 10 { 6 } else { 1 }), ColorMode::Height);
        assert_eq!(mode(black, |k| if k < 50 { 12 } else { 18 }), ColorMode::Height);
        assert_eq!(ColorMode::auto(&summary([])), ColorMode::Height);
    }
}
