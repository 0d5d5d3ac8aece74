//! Lengths as they are typed: a number in the picture's unit, or with a unit of its own.

use super::crs::Unit;
use std::fmt;
use std::str::FromStr;

/// A length above 0, as typed: `0.5` in the unit of the picture, `50cm` in its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    value: f64,
    /// Symbol, and metres.
    unit: Option<(&'static str, f64)>,
}

const UNITS: [(&str, f64); 10] = [
    ("mm", 0.001),
    ("cm", 0.01),
    ("dm", 0.1),
    ("km", 1000.0),
    ("us-ft", 1200.0 / 3937.0),
    ("ftus", 1200.0 / 3937.0),
    ("ft", 0.3048),
    ("in", 0.0254),
    ("yd", 0.9144),
    ("m", 1.0),
];

/// A length with a unit where nothing says what the picture's unit is.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error(
    "{0}: nothing says which unit the coordinates are in: give the number alone, in their unit, or their coordinate \
     system (--assume-crs EPSG:CODE)"
)]
pub struct NoUnit(pub Length);

impl Length {
    /// How many of the picture's `unit` it is.
    pub fn in_units(&self, unit: Option<&Unit>) -> Result<f64, NoUnit> {
        match (self.unit, unit) {
            (None, _) => Ok(self.value),
            (Some((_, metres)), Some(unit)) => {
                // 50 cm are 0.5 m to the last bit.
                Ok(if metres == unit.si { self.value } else { self.value * metres / unit.si })
            }
            (Some(_), None) => Err(NoUnit(*self)),
        }
    }

    /// Whether `text` is meant as a length, be it a wrong one, and not as a name.
    pub fn is_meant_by(text: &str) -> bool {
        let digits = text.trim_start_matches(['+', '-']).trim_start_matches('.');
        digits.starts_with(|c: char| c.is_ascii_digit()) && parts(text).is_ok()
    }
}

/// In the picture's unit.
impl From<f64> for Length {
    fn from(value: f64) -> Length {
        Length { value, unit: None }
    }
}

fn unit_of(text: &str) -> Option<(&'static str, f64)> {
    UNITS.into_iter().find(|(symbol, _)| symbol.eq_ignore_ascii_case(text))
}

/// Number and unit.
type Parts = (f64, Option<(&'static str, f64)>);

fn parts(text: &str) -> Result<Parts, String> {
    let text = text.trim();
    if let Ok(value) = text.parse() {
        return Ok((value, None));
    }
    let number = text.trim_end_matches(|c: char| c.is_alphabetic() || c == '-');
    let unit = &text[number.len()..];
    let value = number.trim().parse().map_err(|_| format!("'{text}' is not a number"))?;
    let known =
        unit_of(unit).ok_or_else(|| format!("'{unit}' is no unit: mm, cm, m, km, ft, us-ft or in"))?;
    Ok((value, Some(known)))
}

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Length, String> {
        let (value, unit) = parts(text)?;
        if !value.is_finite() {
            return Err(format!("'{text}' is not finite"));
        }
        if value <= 0.0 {
            return Err(format!("{text} is not above 0"));
        }
        Ok(Length { value, unit })
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}{}", crate::text::tidy(self.value), self.unit.map_or("", |(symbol, _)| symbol))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_come_in_units() {
        let [metre, foot] = ["m", "ft"].map(|unit| unit.parse::<Unit>().unwrap());
        let length = |text: &str| text.parse::<Length>().unwrap();
        assert_eq!(length("0.5").in_units(None), Ok(0.5));
        assert_eq!(length("0.5").in_units(Some(&foot)), Ok(0.5));
        for (text, metres) in [
            ("50cm", 0.5),
            ("250 mm", 0.25),
            ("2M", 2.0),
            ("0.002km", 2.0),
            ("2dm", 0.2),
            ("1ft", 0.3048),
            ("10in", 0.254),
        ] {
            assert!((length(text).in_units(Some(&metre)).unwrap() - metres).abs() < 1e-15, "{text}");
        }
        assert_eq!(length("2ft").in_units(Some(&foot)), Ok(2.0));
        assert_eq!(length("1m").in_units(Some(&foot)), Ok(1.0 / 0.3048));
        assert!(length("50cm").in_units(None).unwrap_err().to_string().starts_with("50cm: nothing says"));
        for (text, why) in [
            ("", "'' is not a number"),
            ("cm", "'cm' is not a number"),
            ("5parsec", "'parsec' is no unit: mm, cm"),
            ("0", "0 is not above 0"),
            ("-1", "-1 is not above 0"),
            ("0cm", "0cm is not above 0"),
            ("NaN", "'NaN' is not finite"),
            ("infft", "'infft' is not a number"),
        ] {
            assert!(
                text.parse::<Length>().unwrap_err().starts_with(why),
                "{text}: {:?}",
                text.parse::<Length>()
            );
        }
    }

    #[test]
    fn words_that_mean_lengths() {
        for text in ["0.25", "1", "1e-9", ".5", "50cm", "0", "-1", "2us-ft"] {
            assert!(Length::is_meant_by(text), "{text}");
        }
        for text in ["tiles/", "a.las", "2024.laz", "1tile", "nan", "inf", "@list", "", "-o", "12a"] {
            assert!(!Length::is_meant_by(text), "{text}");
        }
    }
}
