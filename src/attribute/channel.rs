//! What the 16 bits of a record hold that belong to its intensity, where nothing else is asked for.
//!
//! A view stores one channel alone: the one that it colours by, as [`Channel::of`] the colour mode has it. To add another:
//! an entry in [`Channel`] with its codes ([`Channel::code`]) and its values; what it needs of the decoder in
//! `source::Reading::fields`, where it is put in the place of intensities in `ingest::selecting`; a colour mode for it.

/// Steps of a scan angle in a degree: formats 6 to 10 store so many (LAS 1.4 R15, table 14: 0.006°).
const ANGLE_STEPS: f64 = 1.0 / 0.006;
/// Code of a scan angle of 0.
const LEVEL: i32 = 1 << 15;
/// First code of a time: those before stand for none, so that an entry of a colour table is free for that.
const FIRST_TIME: u16 = 257;

/// Seconds that are told apart in 16 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeScale {
    /// First, GPS time as stored; what is before is taken for this.
    pub from: f64,
    /// Last; what is after is taken for this.
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
    /// How far the record is above the ground below it; on it or below it: 0.
    AboveGround(AboveScale),
    /// Points in a square unit, of the square of cells around. 0: none is counted.
    Density(Steps),
    /// How far flight lines are apart about there, one more; 0: no more than one has seen it.
    LineDifference(Steps),
}

impl TimeScale {
    /// Seconds between two codes.
    pub fn step(&self) -> f64 {
        (self.to - self.from) / f64::from(u16::MAX - FIRST_TIME)
    }

    /// Code of a time; 0: there is none.
    #[inline]
    fn code(&self, time: f64) -> u16 {
        if !time.is_finite() {
            return 0;
        }
        let step = self.step();
        let steps = if step > 0.0 { ((time - self.from) / step).round() } else { 0.0 };
        FIRST_TIME + steps.clamp(0.0, f64::from(u16::MAX - FIRST_TIME)) as u16
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
        match self {
            Channel::Intensity | Channel::SourceId => value.round() as u16,
            Channel::ScanAngle => {
                ((value * ANGLE_STEPS).round() as i32).saturating_add(LEVEL).clamp(0, 65_535) as u16
            }
            Channel::GpsTime(scale) => scale.code(value),
            // What is not a number is 0.
            Channel::AboveGround(AboveScale { unit, .. }) => (value / unit).round() as u16,
            Channel::Density(Steps { unit }) if value > 0.0 => (value / unit).round().max(1.0) as u16,
            Channel::Density(_) => 0,
            Channel::LineDifference(Steps { unit }) => ((value / unit).round() as u16).saturating_add(1),
        }
    }

    /// The value of a code, in its unit; `None`: the point has none.
    pub fn value(&self, code: u16) -> Option<f64> {
        match self {
            Channel::Intensity | Channel::SourceId => Some(code.into()),
            Channel::ScanAngle => Some(f64::from(i32::from(code) - LEVEL) / ANGLE_STEPS),
            Channel::GpsTime(scale) => {
                let steps = code.checked_sub(FIRST_TIME)?;
                Some(scale.from + f64::from(steps) * scale.step())
            }
            Channel::AboveGround(AboveScale { unit, .. }) => Some(f64::from(code) * unit),
            Channel::Density(Steps { unit }) => (code > 0).then(|| f64::from(code) * unit),
            Channel::LineDifference(Steps { unit }) => Some(f64::from(code.checked_sub(1)?) * unit),
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
            return match self {
                Channel::LineDifference(_) => "seen by one flight line".to_owned(),
                _ => format!("no {}", self.name()),
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
        format!("{} {value:.digits$}{space}{unit}", self.name())
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
        assert_eq!((day.code(f64::NAN), day.value(0), day.value(256)), (0, None, None));
        assert_eq!(
            (day.code(100.0), day.code(0.0), day.code(86_500.0), day.code(1e12)),
            (257, 257, 65_535, 65_535)
        );
        assert_eq!(day.value(257), Some(100.0));
        // All at once.
        assert_eq!((of(5.0, 5.0).code(5.0), of(5.0, 5.0).value(257)), (257, Some(5.0)));
        assert_eq!(day.words(257, None), "GPS time 100 s");
        assert_eq!(day.words(3, None), "no GPS time");
        assert_eq!(of(100.0, 160.0).words(257, None), "GPS time 100.0000 s");
        assert_eq!(Channel::ScanAngle.words(Channel::of_angle(-2000), None), "scan angle -12.00°");
        assert_eq!(Channel::SourceId.words(17, None), "source id 17");
        let steps = Steps { unit: 0.0625 };
        let (density, lines) = (Channel::Density(steps), Channel::LineDifference(steps));
        assert_eq!(density.words(0, None), "no point density");
        assert_eq!(density.words(164, Some("m")), "point density 10.25/m²");
        assert_eq!(density.words(164, None), "point density 10.25 a square unit");
        assert_eq!(lines.words(0, Some("m")), "seen by one flight line");
        assert_eq!(lines.words(3, Some("ft")), "line difference 0.12 ft");
        let above = Channel::AboveGround(AboveScale { unit: 0.015625, reach: 30.0 });
        assert_eq!(
            (above.words(0, Some("m")), above.words(3200, None)),
            ("height above ground 0.00 m".to_owned(), "height above ground 50.00".to_owned())
        );
        assert_eq!(
            [above.code(-3.0), above.code(1e9), density.code(0.0), density.code(1e-9)],
            [0, 65_535, 0, 1]
        );
        assert_eq!([lines.code(0.0), lines.code(1e9)], [1, 65_535]);
    }
}
