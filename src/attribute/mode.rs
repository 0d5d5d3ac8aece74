//! What points are coloured by.

use super::channel::Channel;
use super::summary::{AttributeSummary, Spread};
use clap::ValueEnum;

/// What a point is coloured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ColorMode {
    /// The points' own colours.
    Rgb,
    /// Height, by a ramp.
    Height,
    /// ASPRS class, by a palette.
    Class,
    /// Intensity, by a ramp.
    Intensity,
    /// Single, first, intermediate or last return.
    Return,
    /// Point source id, by a palette: flight lines.
    SourceId,
    /// Scan angle, by a ramp about the nadir.
    ScanAngle,
    /// GPS time, by a ramp.
    GpsTime,
    /// Height above the ground, by a ramp.
    HeightAboveGround,
    /// Points in a square unit, by a ramp.
    Density,
    /// How far flight lines are apart, by a ramp.
    LineDifference,
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
            ColorMode::SourceId => "source-id",
            ColorMode::ScanAngle => "scan-angle",
            ColorMode::GpsTime => "gps-time",
            ColorMode::HeightAboveGround => "height-above-ground",
            ColorMode::Density => "density",
            ColorMode::LineDifference => "line-difference",
        }
    }

    /// What records are to hold for it; `None`: what they hold of class, height, returns and colours will do.
    pub fn channel(self, sample: &AttributeSummary) -> Option<Channel> {
        match self {
            ColorMode::Rgb | ColorMode::Height | ColorMode::Class | ColorMode::Return => None,
            ColorMode::Intensity => Some(Channel::Intensity),
            ColorMode::SourceId => Some(Channel::SourceId),
            ColorMode::ScanAngle => Some(Channel::ScanAngle),
            ColorMode::GpsTime => Some(Channel::GpsTime(sample.scales.times.unwrap_or_default())),
            ColorMode::HeightAboveGround => Some(Channel::AboveGround(sample.scales.above_scale())),
            ColorMode::Density => Some(Channel::Density(sample.scales.density_steps())),
            ColorMode::LineDifference => Some(Channel::LineDifference(sample.scales.difference_steps())),
        }
    }

    /// Whether its values become colours of a ramp.
    pub fn has_ramp(self) -> bool {
        !matches!(self, ColorMode::Rgb | ColorMode::Class | ColorMode::Return | ColorMode::SourceId)
    }

    /// Whether what codes of its channel mean follows from the data.
    pub fn is_scaled(self) -> bool {
        matches!(
            self,
            ColorMode::GpsTime
                | ColorMode::HeightAboveGround
                | ColorMode::Density
                | ColorMode::LineDifference
        )
    }

    /// How what its ramp is of is spread; `None`: it has no ramp, or nothing is known.
    pub fn spread(self, sample: &AttributeSummary) -> Option<&Spread> {
        match self {
            ColorMode::Height => Some(&sample.height),
            ColorMode::Intensity => Some(&sample.intensity),
            ColorMode::ScanAngle => Some(&sample.scan_angle),
            ColorMode::GpsTime => Some(&sample.time),
            ColorMode::HeightAboveGround => Some(&sample.above),
            ColorMode::Rgb
            | ColorMode::Class
            | ColorMode::Return
            | ColorMode::SourceId
            | ColorMode::Density
            | ColorMode::LineDifference => None,
        }
    }

    /// By a sample of everything, shown or not: RGB if 5 % of it is not black (and not all of one colour), else class if classes beyond
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
