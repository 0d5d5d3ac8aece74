//! Ranges of values that a ramp's ends stand for.

use super::summary::Spread;
use crate::text::tidy;
use std::fmt;
use std::str::FromStr;

/// One end of a [`ColorRange`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RangeEnd {
    /// A value: CRS units for heights, as stored for intensities.
    Value(f64),
    /// The value that so many of a hundred points are at or below, as far as the opening sample says.
    Percentile(f64),
}

/// The values at a ramp's ends: `180..260`, `2%..98%`, `0..98%`; also `180,260`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorRange {
    /// At its low end.
    pub low: RangeEnd,
    /// At its high end.
    pub high: RangeEnd,
}

/// What is wrong with a range, or with one of its ends.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RangeError {
    /// Not two ends.
    #[error("'{0}' is not A..B, such as 180..260 or 2%..98%")]
    NotTwo(String),
    /// An end that is no number.
    #[error("'{0}' is neither a number nor a percentile such as 2%")]
    NotNumber(String),
    /// Infinite, or not a number.
    #[error("'{0}' is not finite")]
    NotFinite(String),
    /// A percentile of more than all, or less than none.
    #[error("{}% is not within 0% and 100%", tidy(*.0))]
    Percentile(f64),
    /// The wrong way round, or equal.
    #[error("{0} is not below {1}")]
    Order(RangeEnd, RangeEnd),
}

impl fmt::Display for RangeEnd {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match *self {
            RangeEnd::Value(value) => f.write_str(&tidy(value)),
            RangeEnd::Percentile(percent) => write!(f, "{}%", tidy(percent)),
        }
    }
}

impl FromStr for RangeEnd {
    type Err = RangeError;

    fn from_str(text: &str) -> Result<RangeEnd, RangeError> {
        let text = text.trim();
        let percent = text.strip_suffix('%');
        let number = percent.unwrap_or(text).trim();
        let value: f64 = number.parse().map_err(|_| RangeError::NotNumber(text.to_owned()))?;
        match percent {
            _ if !value.is_finite() => Err(RangeError::NotFinite(text.to_owned())),
            Some(_) if !(0.0..=100.0).contains(&value) => Err(RangeError::Percentile(value)),
            Some(_) => Ok(RangeEnd::Percentile(value)),
            None => Ok(RangeEnd::Value(value)),
        }
    }
}

impl RangeEnd {
    /// The value that it stands for in what is spread like that.
    pub fn value(self, spread: &Spread) -> f64 {
        match self {
            RangeEnd::Value(value) => value,
            RangeEnd::Percentile(percent) => spread.percentile(percent),
        }
    }
}

impl ColorRange {
    /// From one value to another.
    pub fn of(low: f64, high: f64) -> ColorRange {
        ColorRange { low: RangeEnd::Value(low), high: RangeEnd::Value(high) }
    }

    /// Errors: ends of the same kind in the wrong order, or equal. Whether a value is below a percentile the data say.
    pub fn checked(self) -> Result<ColorRange, RangeError> {
        use RangeEnd::{Percentile, Value};
        let is_wrong = match (self.low, self.high) {
            (Value(low), Value(high)) | (Percentile(low), Percentile(high)) => low >= high,
            _ => false,
        };
        if is_wrong { Err(RangeError::Order(self.low, self.high)) } else { Ok(self) }
    }

    /// Whether an end is a percentile.
    pub fn has_percentiles(&self) -> bool {
        [self.low, self.high].iter().any(|end| matches!(end, RangeEnd::Percentile(_)))
    }

    /// Whether both ends are percentiles.
    pub(super) fn is_relative(&self) -> bool {
        matches!((self.low, self.high), (RangeEnd::Percentile(_), RangeEnd::Percentile(_)))
    }
}

impl fmt::Display for ColorRange {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}..{}", self.low, self.high)
    }
}

impl FromStr for ColorRange {
    type Err = RangeError;

    fn from_str(text: &str) -> Result<ColorRange, RangeError> {
        let ends = text.split_once("..").or_else(|| text.split_once(','));
        let (low, high) = ends
            .filter(|(low, high)| !low.trim().is_empty() && !high.trim().is_empty() && !high.contains(','))
            .ok_or_else(|| RangeError::NotTwo(text.to_owned()))?;
        ColorRange { low: low.parse()?, high: high.parse()? }.checked()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_and_told_alike() {
        use RangeEnd::{Percentile, Value};
        for (text, low, high, told) in [
            ("180..260", Value(180.0), Value(260.0), "180..260"),
            ("180,260", Value(180.0), Value(260.0), "180..260"),
            (" -3.5 .. 2e1 ", Value(-3.5), Value(20.0), "-3.5..20"),
            ("2%..98%", Percentile(2.0), Percentile(98.0), "2%..98%"),
            ("0.5%,99.5%", Percentile(0.5), Percentile(99.5), "0.5%..99.5%"),
            ("0..98%", Value(0.0), Percentile(98.0), "0..98%"),
            (".5...75", Value(0.5), Value(0.75), "0.5..0.75"),
        ] {
            let range: ColorRange = text.parse().unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!(range, ColorRange { low, high }, "{text}");
            assert_eq!(range.to_string(), told);
            assert_eq!(told.parse(), Ok(range));
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (text, why) in [
            ("5..1", "5 is not below 1"),
            ("5..5", "5 is not below 5"),
            ("98%..2%", "98% is not below 2%"),
            ("NaN..1", "'NaN' is not finite"),
            ("0..inf", "'inf' is not finite"),
            ("0%..101%", "101% is not within 0% and 100%"),
            ("-1%..5%", "-1% is not within 0% and 100%"),
            ("low..5", "'low' is neither a number nor a percentile such as 2%"),
            ("5", "'5' is not A..B, such as 180..260 or 2%..98%"),
            ("..5", "'..5' is not A..B, such as 180..260 or 2%..98%"),
            ("5..", "'5..' is not A..B, such as 180..260 or 2%..98%"),
            ("1,2,3", "'1,2,3' is not A..B, such as 180..260 or 2%..98%"),
            ("", "'' is not A..B, such as 180..260 or 2%..98%"),
            ("1..2..3", "'2..3' is neither a number nor a percentile such as 2%"),
        ] {
            assert_eq!(text.parse::<ColorRange>().unwrap_err().to_string(), why, "{text}");
        }
    }
}
