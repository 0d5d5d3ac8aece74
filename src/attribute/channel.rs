//! What the 16 bits of a record hold that belong to its intensity, where nothing else is asked for.
//!
//! A view stores one channel alone: the one that it colours by, as [`Channel::of`] the colour mode has it. To add another:
//! an entry in [`Channel`] with its codes ([`Channel::code`]) and its values; what it needs of the decoder in
//! `source::Reading::fields`, where it is put in the place of intensities in `ingest::selecting`; a colour mode for it.

/// Steps of a scan angle in a degree: formats 6 to 10 store so many (LAS 1.4 R15, table 14: 0.006°).
const ANGLE_STEPS: f64 = 1.0 / 0.006;
/// Code of a scan angle of 0.
const LEVEL: i32 = 1 << 15;
/// Codes of times that are before the first and after the last that is told apart, and of these two.
const BEFORE: u16 = 1;
const AFTER: u16 = u16::MAX;
const FIRST_TIME: u16 = BEFORE + 1;
const LAST_TIME: u16 = AFTER - 1;

/// Seconds that are told apart in 16 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeScale {
    /// First, GPS time as stored; of what is before only that is known.
    pub from: f64,
    /// Last; of what is after likewise.
    pub to: f64,
}

/// Lengths that are told apart in 16 bits: heights above the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AboveScale {
    /// CRS units between two codes.
    pub unit: f64,
    /// What stands on the ground is no wider, CRS units, where no class tells what is ground.
    pub reach: f64,
}

/// Steps of 16 bits; a power of two, so that they are the same wherever they are counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// Between two codes: CRS units, or points in a square one.
    pub unit: f64,
}

/// What 16 bits of a record hold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Channel {
    /// Pulse return magnitude, as stored.
    #[default]
    Intensity,
    /// Point source id: the flight line, as a rule.
    SourceId,
    /// Scan angle, in steps of 0.006° from the nadir.
    ScanAngle,
    /// GPS time, in steps of its scale.
    GpsTime(TimeScale),
    /// How far the record is above the ground below it, one more; on it or below it: 1. 0: nothing is known of the ground there.
    AboveGround(AboveScale),
    /// Points in a square unit, of the square of cells around. 0: none is counted.
    Density(Steps),
    /// How far flight lines are apart about there, one more; 0: no cell there was seen by several.
    LineDifference(Steps),
}

impl TimeScale {
    /// Seconds between two codes.
    pub fn step(&self) -> f64 {
        (self.to - self.from) / f64::from(LAST_TIME - FIRST_TIME)
    }

    /// Code of a time; 0: there is none.
    #[inline]
    fn code(&self, time: f64) -> u16 {
        match time {
            time if !time.is_finite() => 0,
            time if time < self.from => BEFORE,
            time if time > self.to => AFTER,
            time => (self.place(time).round() as u16).min(LAST_TIME),
        }
    }

    /// Where a time lies among codes, however far beyond them.
    fn place(&self, time: f64) -> f64 {
        let step = self.step();
        // All are at once: a second is as good as any step.
        f64::from(FIRST_TIME) + (time - self.from) / if step > 0.0 { step } else { 1.0 }
    }
}

impl Channel {
    /// Name of its values: for files, and to be read.
    pub fn name(&self) -> &'static str {
        match self {
            Channel::Intensity => "intensity",
            Channel::SourceId => "source id",
            Channel::ScanAngle => "scan angle",
            Channel::GpsTime(_) => "GPS time",
            Channel::AboveGround(_) => "height above ground",
            Channel::Density(_) => "point density",
            Channel::LineDifference(_) => "line difference",
        }
    }

    /// Unit of its values, where lengths are in `length` (its symbol); empty: they are numbers.
    pub fn unit(&self, length: Option<&str>) -> String {
        match self {
            Channel::Intensity | Channel::SourceId => String::new(),
            Channel::ScanAngle => "°".to_owned(),
            Channel::GpsTime(_) => "s".to_owned(),
            Channel::AboveGround(_) | Channel::LineDifference(_) => length.unwrap_or_default().to_owned(),
            Channel::Density(_) => length.map_or("a square unit".to_owned(), |length| format!("/{length}²")),
        }
    }

    /// The code of a value in its unit, which is held within what there are codes for.
    #[inline]
    pub fn code(&self, value: f64) -> u16 {
        let lowest = match self {
            Channel::GpsTime(scale) => return scale.code(value),
            Channel::AboveGround(_) if value.is_nan() => return 0,
            Channel::Density(_) if value.is_nan() || value <= 0.0 => return 0,
            Channel::AboveGround(_) | Channel::Density(_) | Channel::LineDifference(_) => 1.0,
            Channel::Intensity | Channel::SourceId | Channel::ScanAngle => 0.0,
        };
        self.place(value).round().clamp(lowest, u16::MAX.into()) as u16
    }

    /// Where a value lies among codes, however far beyond them: of what a code stands for, that code.
    pub fn place(&self, value: f64) -> f64 {
        match self {
            Channel::Intensity | Channel::SourceId => value,
            Channel::ScanAngle => value * ANGLE_STEPS + f64::from(LEVEL),
            Channel::GpsTime(scale) => scale.place(value),
            Channel::Density(Steps { unit }) => value / unit,
            Channel::AboveGround(AboveScale { unit, .. }) | Channel::LineDifference(Steps { unit }) => {
                value / unit + 1.0
            }
        }
    }

    /// The value of a code, in its unit; `None`: the point has none, or a time that is not told apart.
    pub fn value(&self, code: u16) -> Option<f64> {
        match self {
            Channel::Intensity | Channel::SourceId => Some(code.into()),
            Channel::ScanAngle => Some(f64::from(i32::from(code) - LEVEL) / ANGLE_STEPS),
            Channel::GpsTime(scale) => {
                let steps = code.checked_sub(FIRST_TIME).filter(|_| code <= LAST_TIME)?;
                Some(scale.from + f64::from(steps) * scale.step())
            }
            Channel::Density(Steps { unit }) => (code > 0).then(|| f64::from(code) * unit),
            Channel::AboveGround(AboveScale { unit, .. }) | Channel::LineDifference(Steps { unit }) => {
                Some(f64::from(code.checked_sub(1)?) * unit)
            }
        }
    }

    /// Whether a code of 0 says that there is no value.
    pub fn knows_none(&self) -> bool {
        match self {
            Channel::Intensity | Channel::SourceId | Channel::ScanAngle => false,
            Channel::GpsTime(_)
            | Channel::AboveGround(_)
            | Channel::Density(_)
            | Channel::LineDifference(_) => true,
        }
    }

    /// What that means, in words.
    pub fn none_words(&self) -> String {
        match self {
            Channel::AboveGround(_) => "ground unknown".to_owned(),
            Channel::LineDifference(_) => "no cell seen by several flight lines".to_owned(),
            _ => format!("no {}", self.name()),
        }
    }

    /// Code of a scan angle as formats 6 to 10 store it.
    #[inline]
    pub fn of_angle(steps: i16) -> u16 {
        (i32::from(steps) + LEVEL) as u16
    }

    /// A value in words, as exact as it is known; `length` as in [`Channel::unit`].
    pub fn words(&self, code: u16, length: Option<&str>) -> String {
        let Some(value) = self.value(code) else {
            return match (self, code) {
                (Channel::GpsTime(TimeScale { from, .. }), BEFORE) => format!("GPS time before {from} s"),
                (Channel::GpsTime(TimeScale { to, .. }), AFTER) => format!("GPS time after {to} s"),
                _ => self.none_words(),
            };
        };
        let digits = match self {
            Channel::Intensity | Channel::SourceId => 0,
            Channel::ScanAngle => 2,
            Channel::GpsTime(scale) => digits_of(scale.step()),
            Channel::AboveGround(AboveScale { unit, .. }) => digits_of(*unit).min(2),
            Channel::Density(Steps { unit }) => digits_of(*unit).min(2),
            Channel::LineDifference(Steps { unit }) => digits_of(*unit).min(3),
        };
        let unit = self.unit(length);
        let space = if unit.starts_with(char::is_alphabetic) { " " } else { "" };
        // What is measured may be more than there are codes for.
        let is_measured =
            matches!(self, Channel::AboveGround(_) | Channel::Density(_) | Channel::LineDifference(_));
        let at_least = if is_measured && code == u16::MAX { "≥ " } else { "" };
        format!("{} {at_least}{value:.digits$}{space}{unit}", self.name())
    }
}

/// Digits behind the point that tell steps apart.
fn digits_of(step: f64) -> usize {
    (-step.max(1e-6).log10()).ceil().clamp(0.0, 6.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn values_come_back_from_their_codes(code in any::<u16>(), time in 0.0f64..1.0) {
            let scale = TimeScale { from: 3.0e8, to: 3.0e8 + 7200.0 };
            let steps = Steps { unit: 0.0625 };
            let measures = [
                Channel::AboveGround(AboveScale { unit: 0.015625, reach: 30.0 }),
                Channel::Density(steps),
                Channel::LineDifference(steps),
            ];
            let stored = [Channel::Intensity, Channel::SourceId, Channel::ScanAngle, Channel::GpsTime(scale)];
            for channel in stored.into_iter().chain(measures) {
                if let Some(value) = channel.value(code) {
                    prop_assert_eq!(channel.code(value), code);
                }
            }
            let time = scale.from + 7200.0 * time;
            let channel = Channel::GpsTime(scale);
            prop_assert!((channel.value(channel.code(time)).unwrap() - time).abs() <= 0.51 * scale.step());
        }

        #[test]
        fn angles_as_stored_are_their_codes(steps in any::<i16>()) {
            let code = Channel::of_angle(steps);
            prop_assert_eq!(Channel::ScanAngle.code(f64::from(steps) * 0.006), code);
        }
    }

    #[test]
    fn times_that_are_none_or_outside_are_told_apart() {
        let of = |from, to| Channel::GpsTime(TimeScale { from, to });
        let day = of(100.0, 86_500.0);
        assert_eq!((day.code(f64::NAN), day.value(0)), (0, None));
        assert_eq!(
            (day.code(100.0), day.code(0.0), day.code(86_500.0), day.code(1e12)),
            (2, 1, 65_534, 65_535)
        );
        assert_eq!(
            [1, 2, 65_534, 65_535].map(|code| day.value(code)),
            [None, Some(100.0), Some(86_500.0), None]
        );
        // All at once.
        let once = of(5.0, 5.0);
        assert_eq!(([4.9, 5.0, 5.1].map(|time| once.code(time)), once.value(2)), ([1, 2, 65_535], Some(5.0)));
        assert_eq!(day.words(2, None), "GPS time 100 s");
        assert_eq!(day.words(0, None), "no GPS time");
        assert_eq!(day.words(1, None), "GPS time before 100 s");
        assert_eq!(day.words(65_535, None), "GPS time after 86500 s");
        assert_eq!(of(100.0, 160.0).words(2, None), "GPS time 100.0000 s");
        assert_eq!(Channel::ScanAngle.words(Channel::of_angle(-2000), None), "scan angle -12.00°");
        assert_eq!(Channel::SourceId.words(17, None), "source id 17");
        let steps = Steps { unit: 0.0625 };
        let (density, lines) = (Channel::Density(steps), Channel::LineDifference(steps));
        assert_eq!(density.words(0, None), "no point density");
        assert_eq!(density.words(164, Some("m")), "point density 10.25/m²");
        assert_eq!(density.words(164, None), "point density 10.25 a square unit");
        assert_eq!(lines.words(0, Some("m")), "no cell seen by several flight lines");
        assert_eq!(lines.words(3, Some("ft")), "line difference 0.12 ft");
        let above = Channel::AboveGround(AboveScale { unit: 0.015625, reach: 30.0 });
        assert_eq!(
            [above.words(1, Some("m")), above.words(3201, None), above.words(0, None)],
            ["height above ground 0.00 m", "height above ground 50.00", "ground unknown"].map(str::to_owned)
        );
        assert_eq!(
            [above.code(-3.0), above.code(1e9), above.code(f64::NAN), density.code(0.0), density.code(1e-9)],
            [1, 65_535, 0, 0, 1]
        );
        // There are no codes for more.
        assert_eq!(above.words(65_535, Some("m")), "height above ground ≥ 1023.97 m");
        assert_eq!(density.words(65_535, None), "point density ≥ 4095.94 a square unit");
        assert_eq!(lines.words(65_535, Some("m")), "line difference ≥ 4095.88 m");
        assert_eq!(Channel::Intensity.words(65_535, None), "intensity 65535");
        assert_eq!([lines.code(0.0), lines.code(1e9)], [1, 65_535]);
    }
}
