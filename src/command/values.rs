//! Values of arguments that several commands take: how they are typed, and which are allowed.

use crate::attribute::{ColorMode, ColorRange, RangeError};
use crate::source::length::Length;
use crate::source::{Interval, Returns, Selection, SourceIds};
use glam::DVec3;
use std::ffi::OsStr;
use std::path::Path;

/// Extensions of pictures, those that cannot be written among them.
const PICTURES: [&str; 16] = [
    "png", "jpg", "jpeg", "exr", "tif", "tiff", "bmp", "gif", "webp", "svg", "pdf", "ppm", "tga", "psd",
    "avif", "heic",
];

/// Whether a word is a picture's name.
pub(super) fn is_picture(word: &OsStr) -> bool {
    let extension = Path::new(word).extension().and_then(OsStr::to_str).unwrap_or_default();
    PICTURES.iter().any(|picture| picture.eq_ignore_ascii_case(extension))
}

/// Side of a cell, or what the data asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell(pub(super) Option<Length>);

/// How much of the world a pixel of parallel rays shows: a length, or as much as a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ortho(pub(super) Option<Length>);

/// A place as typed: E, N, and a height, or how far above what is shown there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    /// Where it is.
    At(DVec3),
    /// E, N, and units above the shown top of the finest column there.
    Above([f64; 2], f64),
}

/// What colours show, or what the data asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Color(pub(super) Option<ColorMode>);

/// Direction of view in degrees, azimuth and elevation; and a distance, if not all of the data is framed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Orbit {
    pub(super) angles: [f64; 2],
    pub(super) distance: Option<f64>,
}

/// Which points take part at all.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct SelectionArgs {
    /// Only these returns of a pulse: first, last or only
    #[arg(long, value_enum, default_value = "all", help_heading = "Points")]
    returns: Returns,
    /// Only points of these point source ids, as a rule flight lines: 3,7-9
    #[arg(long, visible_alias = "point-source-id", help_heading = "Points", value_name = "LIST")]
    source_id: Option<SourceIds>,
    /// Only points of this intensity, as stored: 100..2000, 100.. or ..2000, both ends among them; 100 is 100..100
    #[arg(long, allow_hyphen_values = true, help_heading = "Points", value_name = "LOW..HIGH")]
    intensity: Option<Interval>,
    /// Only points of these heights, in units of the picture: 120..200
    #[arg(
        long,
        visible_alias = "elevations",
        alias = "z-range",
        allow_hyphen_values = true,
        help_heading = "Points",
        value_name = "LOW..HIGH"
    )]
    heights: Option<Interval>,
    /// Only points of these GPS times, s, as stored; points without one are not among them
    #[arg(long, allow_hyphen_values = true, help_heading = "Points", value_name = "FROM..TO")]
    gps_time: Option<Interval>,
}

impl SelectionArgs {
    /// What they ask for.
    pub(super) fn selection(&self) -> Selection {
        Selection {
            returns: self.returns,
            source_ids: self.source_id.clone().unwrap_or_default(),
            intensity: self.intensity.unwrap_or_default(),
            heights: self.heights.unwrap_or_default(),
            gps_time: self.gps_time.unwrap_or_default(),
        }
    }
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("'{text}' is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("'{text}' is not finite")) }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("{value} is not above 0")) }
}

pub(super) fn detail(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value >= 0.0 { Ok(value) } else { Err(format!("{value} is below 0")) }
}

pub(super) fn fov(text: &str) -> Result<f64, String> {
    let value = positive(text)?;
    if value < 180.0 { Ok(value) } else { Err(format!("{value} degrees is not below 180")) }
}

pub(super) fn cell(text: &str) -> Result<Cell, String> {
    if text == "auto" { Ok(Cell(None)) } else { text.parse().map(|length| Cell(Some(length))) }
}

/// What [`Ortho`] is called where it is a cell.
pub(super) const CELL: &str = "cell";

pub(super) fn ortho(text: &str) -> Result<Ortho, String> {
    if text == CELL { Ok(Ortho(None)) } else { text.parse().map(|length| Ortho(Some(length))) }
}

pub(super) fn color(text: &str) -> Result<Color, String> {
    let mode = match text.to_lowercase().as_str() {
        "auto" => None,
        "elevation" | "altitude" | "z" | "u" => Some(ColorMode::Height),
        "classes" | "classification" => Some(ColorMode::Class),
        "returns" => Some(ColorMode::Return),
        "i" => Some(ColorMode::Intensity),
        "hag" | "height-above" | "above-ground" => Some(ColorMode::HeightAboveGround),
        "point-density" => Some(ColorMode::Density),
        "line-differences" | "strip-difference" | "dz" => Some(ColorMode::LineDifference),
        "source" | "point-source-id" | "flight-line" | "line" => Some(ColorMode::SourceId),
        "angle" => Some(ColorMode::ScanAngle),
        "time" => Some(ColorMode::GpsTime),
        name => match clap::ValueEnum::from_str(name, true) {
            Ok(mode) => Some(mode),
            Err(_) => {
                return Err(
                    "possible values: auto, rgb, height (or elevation, z), class, intensity, return, source-id, scan-angle, gps-time, height-above-ground (or hag), density, line-difference"
                        .to_owned(),
                );
            }
        },
    };
    Ok(Color(mode))
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',').map(number).collect()
}

pub(super) fn vector(text: &str) -> Result<DVec3, String> {
    match numbers(text)?[..] {
        [e, n, u] => Ok(DVec3::new(e, n, u)),
        _ => Err(format!("'{text}' is not E,N,U")),
    }
}

/// `E,N,U`, or `E,N,+3`.
pub(super) fn place(text: &str) -> Result<Place, String> {
    let DVec3 { x, y, z } =
        vector(text).map_err(|why| format!("{why}; U may be +3: 3 above what is shown there"))?;
    let is_above = text.rsplit(',').next().is_some_and(|up| up.trim().starts_with('+'));
    Ok(if is_above { Place::Above([x, y], z) } else { Place::At(DVec3::new(x, y, z)) })
}

pub(super) fn orbit(text: &str) -> Result<Orbit, String> {
    match numbers(text)?[..] {
        [_, elevation, ..] if elevation.abs() > 90.0 => {
            Err(format!("elevation {elevation} is not within -90 (straight up) and 90 (straight down)"))
        }
        [azimuth, elevation] => Ok(Orbit { angles: [azimuth, elevation], distance: None }),
        [azimuth, elevation, d] if d > 0.0 => Ok(Orbit { angles: [azimuth, elevation], distance: Some(d) }),
        [_, _, d] => Err(format!("distance {d} is not above 0")),
        _ => Err(format!("'{text}' is not AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,DISTANCE")),
    }
}

pub(super) fn range(text: &str) -> Result<ColorRange, RangeError> {
    text.parse()
}

/// `1280x720`.
pub(super) fn pair(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.trim().parse::<u32>().ok();
    let parsed = text.split_once(['x', 'X', '×', ',']).and_then(|(w, h)| Some([side(w)?, side(h)?]));
    match parsed {
        Some([w, h]) if w > 0 && h > 0 => Ok([w, h]),
        Some(_) => Err("a picture has at least one pixel each way".to_owned()),
        None => Err(format!("'{text}' is not WIDTHxHEIGHT such as 1280x720")),
    }
}

/// A size of a picture: `1280x720`, `1280,720`, or a width alone, which is 16:9.
pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    match text.trim().parse::<u32>() {
        Ok(0) => Err("a picture has at least one pixel each way".to_owned()),
        Ok(width) => Ok([width, ((u64::from(width) * 9 + 8) / 16).max(1) as u32]),
        Err(_) => pair(text).map_err(|why| match why.ends_with("1280x720") {
            true => format!("{why}, nor a width such as 1280"),
            false => why,
        }),
    }
}

pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || format!("'{text}' is not a number of bytes such as 512MiB or 2GiB");
    let split = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (digits, unit) = text.split_at(split);
    let shift = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kib" | "kb" => 10,
        "m" | "mib" | "mb" => 20,
        "g" | "gib" | "gb" => 30,
        "t" | "tib" | "tb" => 40,
        _ => return Err(wrong()),
    };
    let value = digits.trim().parse::<f64>().map_err(|_| wrong())? * f64::from(shift).exp2();
    if (1.0..9e18).contains(&value) { Ok(value as u64) } else { Err(wrong()) }
}

/// `500k`, `2M`, `1.5G` or plain digits; at least 1.
pub(super) fn count(text: &str) -> Result<u64, String> {
    let wrong = || format!("'{text}' is not a count such as 750000, 500k or 2M");
    let (digits, factor) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (&text[..at], 1e3),
        Some((at, 'm' | 'M')) => (&text[..at], 1e6),
        Some((at, 'g' | 'G')) => (&text[..at], 1e9),
        _ => (text, 1.0),
    };
    if factor == 1.0 {
        return digits.parse().ok().filter(|&n| n > 0).ok_or_else(wrong);
    }
    let value = digits.parse::<f64>().map_err(|_| wrong())? * factor;
    if (1.0..1e15).contains(&value) { Ok(value.round() as u64) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_pairs_or_widths() {
        for (text, pixels) in [
            ("800", [800, 450]),
            ("800x600", [800, 600]),
            ("800,600", [800, 600]),
            ("800X600", [800, 600]),
            (" 640 × 360 ", [640, 360]),
            ("1", [1, 1]),
            ("1366", [1366, 768]),
        ] {
            assert_eq!(size(text), Ok(pixels), "{text}");
        }
        for (text, why) in [
            ("0", "at least one pixel"),
            ("0x4", "at least one pixel"),
            ("-3", "is not WIDTHxHEIGHT"),
            ("big", "'big' is not WIDTHxHEIGHT such as 1280x720, nor a width"),
            ("99999999999", "is not WIDTHxHEIGHT"),
        ] {
            assert!(size(text).unwrap_err().contains(why), "{text}");
        }
        assert!(pair("8").is_err());
    }

    #[test]
    fn places_are_absolute_or_above_the_ground() {
        assert_eq!(place("1,2,3"), Ok(Place::At(DVec3::new(1.0, 2.0, 3.0))));
        assert_eq!(place("1,2,-3"), Ok(Place::At(DVec3::new(1.0, 2.0, -3.0))));
        assert_eq!(place("1,2,+3"), Ok(Place::Above([1.0, 2.0], 3.0)));
        assert_eq!(place("+1,+2, +0"), Ok(Place::Above([1.0, 2.0], 0.0)));
        assert!(place("1,2").unwrap_err().contains("is not E,N,U; U may be +3"));
    }

    #[test]
    fn colours_have_other_names() {
        for (text, mode) in [
            ("elevation", ColorMode::Height),
            ("Z", ColorMode::Height),
            ("classification", ColorMode::Class),
            ("returns", ColorMode::Return),
            ("RGB", ColorMode::Rgb),
            ("source-id", ColorMode::SourceId),
            ("flight-line", ColorMode::SourceId),
            ("Scan-Angle", ColorMode::ScanAngle),
            ("gps-time", ColorMode::GpsTime),
        ] {
            assert_eq!(color(text), Ok(Color(Some(mode))), "{text}");
        }
        assert_eq!(color("auto"), Ok(Color(None)));
        assert!(color("beige").unwrap_err().contains("elevation"));
    }

    #[test]
    fn counts_with_suffixes() {
        assert_eq!(count("2M"), Ok(2_000_000));
        assert_eq!(count("500k"), Ok(500_000));
        assert_eq!(count("1.5m"), Ok(1_500_000));
        assert_eq!(count("300M"), Ok(300_000_000));
        assert_eq!(count("18446744073709551615"), Ok(u64::MAX));
        for wrong in ["", "0", "-1", "M", "2MM", "1e99k", "nank", "infM", "0.0001k", "é"] {
            assert!(count(wrong).is_err(), "{wrong}");
        }
    }
}
