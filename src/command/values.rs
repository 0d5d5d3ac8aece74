//! Values of arguments that several commands take: how they are typed, and which are allowed.

use crate::attribute::ColorMode;
use glam::DVec3;

/// Side of a cell, or what the data asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell(pub(super) Option<f64>);

/// What colours show, or what the data asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Color(pub(super) Option<ColorMode>);

/// Direction of view in degrees, azimuth and elevation; and a distance, if not all of the data is framed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Orbit {
    pub(super) angles: [f64; 2],
    pub(super) distance: Option<f64>,
}

/// Classes, in the order in which they were typed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ClassList(pub(super) Vec<u8>);

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
    if text == "auto" { Ok(Cell(None)) } else { positive(text).map(|c| Cell(Some(c))) }
}

pub(super) fn color(text: &str) -> Result<Color, String> {
    if text == "auto" {
        return Ok(Color(None));
    }
    let mode = clap::ValueEnum::from_str(text, true);
    mode.map(|m| Color(Some(m)))
        .map_err(|_| "possible values: auto, rgb, height, class, intensity, return".to_owned())
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

pub(super) fn range(text: &str) -> Result<(f64, f64), String> {
    match numbers(text)?[..] {
        [lo, hi] if lo < hi => Ok((lo, hi)),
        [lo, hi] => Err(format!("{lo} is not below {hi}")),
        _ => Err(format!("'{text}' is not LO,HI")),
    }
}

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.trim().parse::<u32>().ok();
    let parsed = text.split_once(['x', 'X', '×']).and_then(|(w, h)| Some([side(w)?, side(h)?]));
    match parsed {
        Some([w, h]) if w > 0 && h > 0 => Ok([w, h]),
        Some(_) => Err("a picture has at least one pixel each way".to_owned()),
        None => Err(format!("'{text}' is not WIDTHxHEIGHT such as 1280x720")),
    }
}

pub(super) fn classes(text: &str) -> Result<ClassList, String> {
    let class = |s: &str| {
        let value: u32 = s
            .trim()
            .parse()
            .map_err(|_| format!("'{s}' is not a class: those are numbers, such as 3,4,5"))?;
        u8::try_from(value).map_err(|_| format!("class {value} is out of range: classes are 0 to 255"))
    };
    let mut list = Vec::new();
    for part in text.split(',') {
        match part.split_once('-') {
            Some((lo, hi)) => {
                let (lo, hi) = (class(lo)?, class(hi)?);
                if lo > hi {
                    return Err(format!("classes {lo}-{hi}: {lo} is above {hi}"));
                }
                list.extend(lo..=hi);
            }
            None => list.push(class(part)?),
        }
    }
    Ok(ClassList(list))
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
