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
        }
    }

    /// Unit of its values; empty: they are numbers.
    pub fn unit(&self) -> &'static str {
        match self {
            Channel::Intensity | Channel::SourceId => "",
            Channel::ScanAngle => "°",
            Channel::GpsTime(_) => "s",
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
        }
    }

    /// Code of a scan angle as formats 6 to 10 store it.
    #[inline]
    pub fn of_angle(steps: i16) -> u16 {
        (i32::from(steps) + LEVEL) as u16
    }

    /// A value in words, as exact as it is known.
    pub fn words(&self, code: u16) -> String {
        let Some(value) = self.value(code) else { return format!("no {}", self.name()) };
        let digits = match self {
            Channel::Intensity | Channel::SourceId => 0,
            Channel::ScanAngle => 2,
            Channel::GpsTime(scale) => (-scale.step().max(1e-6).log10()).ceil().clamp(0.0, 6.0) as usize,
        };
        let space = if self.unit() == "s" { " " } else { "" };
        format!("{} {value:.digits$}{space}{}", self.name(), self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn values_come_back_from_their_codes(code in any::<u16>(), time in 0.0f64..1.0) {
            let scale = TimeScale { from: 3.0e8, to: 3.0e8 + 7200.0 };
            for channel in [Channel::Intensity, Channel::SourceId, Channel::ScanAngle, Channel::GpsTime(scale)] {
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
        assert_eq!(day.words(257), "GPS time 100 s");
        assert_eq!(day.words(3), "no GPS time");
        assert_eq!(of(100.0, 160.0).words(257), "GPS time 100.0000 s");
        assert_eq!(Channel::ScanAngle.words(Channel::of_angle(-2000)), "scan angle -12.00°");
        assert_eq!(Channel::SourceId.words(17), "source id 17");
    }
}
