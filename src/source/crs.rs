//! What a file says about its coordinate reference system: well-known text or GeoTIFF keys to a name,
//! units and kind. Pure functions over the bytes of (E)VLRs. Source: LAS 1.4 R15, 3; OGC 19-008r4.

use super::system::System;
use super::wkt::{self, Node};
use super::{LidarFile, SourceError, VlrEntry};
use crate::text::harmless;
use std::collections::HashMap;
use std::sync::OnceLock;

pub use super::system::CrsKind;

/// A coordinate reference system as far as drawing needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct Crs {
    /// Horizontal system, and " + " the vertical one where it is named.
    pub name: String,
    /// EPSG code of the horizontal system.
    pub epsg: Option<u32>,
    /// Unit of X and Y; an angle where `kind` is [`CrsKind::Geographic`].
    pub horizontal_unit: Unit,
    /// Unit of Z where it is stated.
    pub vertical_unit: Option<Unit>,
    /// What X and Y are.
    pub kind: CrsKind,
    /// The definition: the file's own, else the one of its EPSG code.
    pub wkt: Option<String>,
    /// Name of the vertical system, where there is one.
    pub vertical: Option<String>,
    /// What the horizontal system is, where the definition says it.
    pub system: Option<System>,
}

impl Crs {
    /// Names of the system and of its units as they may be shown. The definition stays as it is.
    fn made_harmless(mut self) -> Crs {
        let units = [Some(&mut self.horizontal_unit), self.vertical_unit.as_mut()];
        let names = units.into_iter().flatten().map(|unit| &mut unit.name).chain([&mut self.name]);
        let names = names.chain(self.vertical.as_mut());
        names.for_each(|name| *name = harmless(name));
        self
    }
}

/// A unit of length or angle.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Unit {
    /// `metre`, `foot` (international), `US survey foot`, `degree`, else as the file has it.
    pub name: String,
    /// Size in metres; in radians for an angle.
    pub si: f64,
}

/// Units that are told apart by name and value; the first three names may be typed (`--z-unit`).
const LENGTHS: [(&str, f64, &str); 4] = [
    ("metre", 1.0, "m"),
    ("foot", 0.3048, "ft"),
    ("US survey foot", 1200.0 / 3937.0, "ftUS"),
    ("kilometre", 1000.0, "km"),
];
const DEGREE: f64 = std::f64::consts::PI / 180.0;
const ANGLES: [(&str, f64, &str); 3] =
    [("degree", DEGREE, "°"), ("grad", DEGREE * 0.9, "gon"), ("radian", 1.0, "rad")];

impl Unit {
    /// The metre.
    pub fn metre() -> Unit {
        Unit { name: "metre".into(), si: 1.0 }
    }

    /// The degree.
    pub fn degree() -> Unit {
        Unit { name: "degree".into(), si: DEGREE }
    }

    /// A unit as a file spells it. The value decides, since "foot" is written for both feet; where it
    /// says 1 and the name says foot, the name does (seen: `UNIT["US survey foot",1.0]`).
    fn from_file(name: &str, si: f64, known: &[(&str, f64, &str)]) -> Option<Unit> {
        let lower = name.to_ascii_lowercase();
        let si = if si == 1.0 && ["foot", "feet", "ft"].iter().any(|foot| lower.contains(foot)) {
            if lower.contains("us") || lower.contains("survey") { LENGTHS[2].1 } else { LENGTHS[1].1 }
        } else {
            si
        };
        if !(si.is_finite() && si > 0.0) {
            return None;
        }
        // The two feet are 6e-7 apart; files write them with 8 digits or more.
        let near = known.iter().find(|unit| (unit.1 - si).abs() < 2e-8 * unit.1.max(1.0));
        Some(match near {
            Some(unit) => Unit { name: unit.0.into(), si: unit.1 },
            None => Unit { name: name.to_owned(), si },
        })
    }

    /// Units of measure by EPSG code; `None` for the rare ones.
    fn from_epsg(code: u16) -> Option<Unit> {
        let (name, si) = match code {
            9001 => (LENGTHS[0].0, LENGTHS[0].1),
            9002 => (LENGTHS[1].0, LENGTHS[1].1),
            9003 => (LENGTHS[2].0, LENGTHS[2].1),
            9036 => (LENGTHS[3].0, LENGTHS[3].1),
            9005 => ("Clarke's foot", 0.304_797_265_4),
            9031 => ("German legal metre", 1.000_013_596_5),
            9040 => ("British yard (Sears 1922)", 0.914_398_414_616_028_7),
            9041 => ("British foot (Sears 1922)", 0.304_799_471_538_676_2),
            9084 => ("Indian yard", 0.914_398_530_744_440_8),
            9094 => ("Gold Coast foot", 0.304_799_710_181_508_8),
            9101 => (ANGLES[2].0, ANGLES[2].1),
            9102 | 9122 => (ANGLES[0].0, ANGLES[0].1),
            9105 => (ANGLES[1].0, ANGLES[1].1),
            _ => return None,
        };
        Some(Unit { name: name.into(), si })
    }

    /// Short form for captions: m, ft, ftUS, °.
    pub fn symbol(&self) -> &str {
        let known = LENGTHS.iter().chain(&ANGLES).find(|unit| unit.0 == self.name);
        known.map_or(&self.name, |unit| unit.2)
    }
}

/// For `--z-unit`: `m`, `ft` or `us-ft`, and their long names.
impl std::str::FromStr for Unit {
    type Err = String;

    fn from_str(text: &str) -> Result<Unit, String> {
        let unit = match text.to_ascii_lowercase().as_str() {
            "m" | "metre" | "meter" => LENGTHS[0],
            "ft" | "foot" | "feet" => LENGTHS[1],
            "us-ft" | "ftus" | "us-foot" | "us survey foot" => LENGTHS[2],
            _ => return Err(format!("unknown unit {text}: m, ft or us-ft")),
        };
        Ok(Unit { name: unit.0.into(), si: unit.1 })
    }
}

/// Why a definition in a file is of no use.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum CrsError {
    /// The text breaks off or is no WKT.
    #[error("coordinate system (WKT): {0}")]
    Syntax(#[from] wkt::SyntaxError),
    /// The bytes are no text.
    #[error("coordinate system (WKT): byte {byte} is not text")]
    NotText {
        /// Offset in the payload.
        byte: usize,
    },
    /// WKT of something else.
    #[error("coordinate system (WKT): {keyword} is not a coordinate system")]
    NotACrs {
        /// The outermost keyword.
        keyword: String,
    },
    /// The GeoTIFF key directory breaks off or has a version that does not exist.
    #[error("coordinate system (GeoTIFF keys): {reason}")]
    Keys {
        /// What is wrong.
        reason: String,
    },
}

/// The coordinate system that `file` names, and what was wrong with definitions that had to be passed over.
pub fn of_file(file: &LidarFile) -> Result<(Option<Crs>, Vec<CrsError>), SourceError> {
    let mut records = Vec::new();
    for entry in &file.vlrs {
        let known = matches!(entry.record_id, 2112 | 34735..=34737);
        // One byte more than is read, so that a text that is too long is told from one that is not.
        if known && matches!(entry.user_id.as_str(), "LASF_Projection" | "liblas") {
            let limit = (wkt::MAX_BYTES + 1) as u64;
            let part = VlrEntry { len: entry.len.min(limit), ..entry.clone() };
            records.push((part.user_id.clone(), part.record_id, part.read(&file.bytes, limit)?));
        }
    }
    let borrowed = records.iter().map(|(user, record, payload)| (user.as_str(), *record, payload.as_slice()));
    let (crs, errors) = from_records(borrowed, file.header.global_encoding & 16 != 0);
    Ok((crs.map(Crs::made_harmless), errors))
}

/// The coordinate system among a file's (E)VLRs, given as user id, record id and payload; and what was
/// wrong with definitions that had to be passed over. `wkt_bit`: bit 4 of the global encoding.
pub fn from_records<'a>(
    records: impl IntoIterator<Item = (&'a str, u16, &'a [u8])>,
    wkt_bit: bool,
) -> (Option<Crs>, Vec<CrsError>) {
    let (mut texts, mut keys, mut doubles, mut ascii) = (Vec::new(), None, &[][..], &[][..]);
    for (user, record, payload) in records {
        match (user, record) {
            // libLAS wrote the same text under its own name as well.
            ("LASF_Projection" | "liblas", 2112) => texts.push(payload),
            ("LASF_Projection", 34735) => keys = keys.or(Some(payload)),
            ("LASF_Projection", 34736) => doubles = payload,
            ("LASF_Projection", 34737) => ascii = payload,
            _ => {}
        }
    }
    let mut errors = Vec::new();
    let text = texts.into_iter().find_map(|payload| match from_wkt_bytes(payload) {
        Ok((crs, fault)) => {
            errors.extend(fault.map(CrsError::Syntax));
            crs
        }
        Err(error) => {
            errors.push(error);
            None
        }
    });
    let keys = keys.and_then(|directory| {
        from_geotiff(directory, doubles, ascii).unwrap_or_else(|error| {
            errors.push(error);
            None
        })
    });
    let (first, second) = if wkt_bit { (text, keys) } else { (keys, text) };
    let crs = match (first, second) {
        // Keys without a code name a projection that only the text beside them defines.
        (Some(first), Some(second)) if first.wkt.is_none() && second.wkt.is_some() => Some(second),
        (first, second) => first.or(second),
    };
    (crs, errors)
}

/// Reads the payload of a WKT record; `None` when it is empty. With the system comes the fault in the text behind what
/// defines it, if there is one: what was parsed before counts.
pub fn from_wkt_bytes(payload: &[u8]) -> Result<(Option<Crs>, Option<wkt::SyntaxError>), CrsError> {
    let end = payload.iter().position(|&byte| byte == 0).unwrap_or(payload.len());
    let payload = &payload[..end];
    if payload.len() > wkt::MAX_BYTES {
        return Err(wkt::SyntaxError { byte: wkt::MAX_BYTES, reason: "longer than any definition" }.into());
    }
    // Names in Latin-1 occur; they do not spoil the rest.
    let text = String::from_utf8_lossy(payload);
    let text = text.trim().trim_start_matches('\u{feff}');
    if text.is_empty() {
        return Ok((None, None));
    }
    if let Some(byte) = payload.iter().position(|byte| byte.is_ascii_control() && !byte.is_ascii_whitespace())
    {
        return Err(CrsError::NotText { byte });
    }
    let (crs, fault) = parse(text)?;
    Ok((Some(crs), fault))
}

const COMPOUND: &[&str] = &["COMPD_CS", "COMPOUNDCRS"];
const PROJECTED: &[&str] = &["PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS"];
const GEOGRAPHIC: &[&str] = &["GEOGCS", "GEOGCRS", "GEOGRAPHICCRS"];
const GEODETIC: &[&str] = &["GEODCRS", "GEODETICCRS"];
const GEOCENTRIC: &[&str] = &["GEOCCS"];
const HORIZONTAL: &[&str] = &[
    "PROJCS",
    "PROJCRS",
    "PROJECTEDCRS",
    "DERIVEDPROJCRS",
    "GEOGCS",
    "GEOGCRS",
    "GEOGRAPHICCRS",
    "GEODCRS",
    "GEODETICCRS",
    "GEOCCS",
    "LOCAL_CS",
    "ENGCRS",
    "ENGINEERINGCRS",
    "BOUNDCRS",
];
const VERTICAL: &[&str] = &["VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"];
const LENGTH_UNIT: &[&str] = &["UNIT", "LENGTHUNIT"];
const ANGLE_UNIT: &[&str] = &["UNIT", "ANGLEUNIT"];

/// Reads a definition in WKT1 or WKT2.
pub fn from_wkt(text: &str) -> Result<Crs, CrsError> {
    match parse(text)? {
        (_, Some(fault)) => Err(fault.into()),
        (crs, None) => Ok(crs),
    }
}

/// Reads a definition, and says what is wrong with the text behind what was needed of it.
fn parse(text: &str) -> Result<(Crs, Option<wkt::SyntaxError>), CrsError> {
    let (roots, fault) = wkt::parse(text);
    let Some(root) = roots.first() else {
        return Err(fault.unwrap_or(wkt::SyntaxError { byte: 0, reason: "a keyword was expected" }).into());
    };
    let (horizontal, vertical) = split(root);
    // A system that breaks off before its unit could be in any.
    let says_unit = |node: &Node| node.child(&["UNIT", "LENGTHUNIT", "ANGLEUNIT"]).is_some();
    let horizontal = match horizontal {
        Some(node) if !node.is_cut || says_unit(node) => node,
        _ => {
            let not_a_crs = CrsError::NotACrs { keyword: root.keyword.to_owned() };
            return Err(fault.map_or(not_a_crs, CrsError::Syntax));
        }
    };
    // A vertical system belongs beside the horizontal one; ESRI writes it after, others inside it.
    let vertical = vertical
        .or_else(|| roots.iter().find(|node| node.is(VERTICAL)))
        .or_else(|| horizontal.child(VERTICAL));

    let cartesian = || {
        let system = horizontal.child(&["CS"]).and_then(|cs| match cs.values.first() {
            Some(wkt::Value::Word(word)) => Some(*word),
            _ => None,
        });
        system.is_some_and(|word| word.eq_ignore_ascii_case("Cartesian"))
    };
    let kind = if horizontal.is(PROJECTED) {
        CrsKind::Projected
    } else if horizontal.is(GEOCENTRIC) || horizontal.is(GEODETIC) && cartesian() {
        CrsKind::Geocentric
    } else if horizontal.is(GEOGRAPHIC) || horizontal.is(GEODETIC) {
        CrsKind::Geographic
    } else {
        CrsKind::Unknown
    };
    let axes: Vec<&Node> = horizontal.children(&["AXIS"]).collect();
    let horizontal_unit = if kind == CrsKind::Geographic {
        unit(horizontal, axes.first().copied(), ANGLE_UNIT, &ANGLES).unwrap_or_else(Unit::degree)
    } else {
        unit(horizontal, axes.first().copied(), LENGTH_UNIT, &LENGTHS).unwrap_or_else(Unit::metre)
    };
    let vertical_unit = match vertical {
        Some(node) => unit(node, node.child(&["AXIS"]), LENGTH_UNIT, &LENGTHS),
        // A three-dimensional system: its third axis points up.
        None if kind != CrsKind::Geocentric => {
            axes.get(2).and_then(|axis| unit(axis, None, LENGTH_UNIT, &LENGTHS))
        }
        None => None,
    };

    let named = |node: &Node| {
        let name = node.name().unwrap_or_default().trim();
        let empty = ["", "unknown", "unnamed"].iter().any(|none| name.eq_ignore_ascii_case(none));
        (!empty).then(|| name.to_owned())
    };
    let horizontal_name = named(horizontal).unwrap_or_else(|| unnamed(kind));
    let compound_name = root.is(COMPOUND).then(|| named(root)).flatten();
    let vertical_name = vertical.and_then(named);
    let name = compound_name.unwrap_or_else(|| join(horizontal_name, vertical_name.clone()));
    let epsg = epsg(horizontal);
    let crs = Crs {
        name,
        epsg,
        system: System::from_wkt(horizontal, kind, horizontal_unit.si, epsg),
        horizontal_unit,
        vertical_unit,
        kind,
        wkt: Some(text.to_owned()),
        vertical: vertical_name,
    };
    Ok((crs, fault))
}

/// The horizontal and the vertical part of a definition.
fn split<'n, 'a>(node: &'n Node<'a>) -> (Option<&'n Node<'a>>, Option<&'n Node<'a>>) {
    if node.is(&["BOUNDCRS"]) {
        let source = node.child(&["SOURCECRS"]);
        match source.and_then(|source| source.child(HORIZONTAL).or_else(|| source.child(COMPOUND))) {
            Some(inner) => split(inner),
            None => (None, None),
        }
    } else if node.is(COMPOUND) {
        let horizontal = node.child(HORIZONTAL).and_then(|part| split(part).0);
        let bound =
            || node.children(&["BOUNDCRS"]).find_map(|part| part.child(&["SOURCECRS"])?.child(VERTICAL));
        (horizontal, node.child(VERTICAL).or_else(bound))
    } else {
        (node.is(HORIZONTAL).then_some(node), None)
    }
}

/// The unit that stands in `node`, else in its first axis (WKT2 allows either).
fn unit(
    node: &Node,
    axis: Option<&Node>,
    keywords: &'static [&'static str],
    known: &[(&str, f64, &str)],
) -> Option<Unit> {
    let unit = node.child(keywords).or_else(|| axis?.child(keywords))?;
    Unit::from_file(unit.name()?, unit.number(1)?, known)
}

fn epsg(node: &Node) -> Option<u32> {
    let id = node.child(&["AUTHORITY", "ID"])?;
    let code = id.number(1)?;
    (id.name()?.eq_ignore_ascii_case("EPSG") && (1.0..1e6).contains(&code)).then_some(code as u32)
}

fn unnamed(kind: CrsKind) -> String {
    match kind {
        CrsKind::Projected => "unnamed projected system",
        CrsKind::Geographic => "unnamed geographic system",
        CrsKind::Geocentric => "unnamed geocentric system",
        CrsKind::Unknown => "unnamed system",
    }
    .to_owned()
}

fn join(horizontal: String, vertical: Option<String>) -> String {
    match vertical {
        Some(vertical) => format!("{horizontal} + {vertical}"),
        None => horizontal,
    }
}

/// GeoTIFF key numbers (OGC 19-008r4, annex B).
mod key {
    pub const MODEL_TYPE: u16 = 1024;
    pub const CITATION: u16 = 1026;
    pub const GEODETIC_CRS: u16 = 2048;
    pub const GEODETIC_CITATION: u16 = 2049;
    pub const SEMI_MAJOR_AXIS: u16 = 2057;
    pub const INVERSE_FLATTENING: u16 = 2059;
    pub const ANGULAR_UNIT: u16 = 2054;
    pub const ANGULAR_UNIT_SIZE: u16 = 2055;
    pub const PROJECTED_CRS: u16 = 3072;
    pub const PROJECTED_CITATION: u16 = 3073;
    pub const PROJECTION: u16 = 3074;
    pub const PROJECTION_METHOD: u16 = 3075;
    pub const LINEAR_UNIT: u16 = 3076;
    pub const LINEAR_UNIT_SIZE: u16 = 3077;
    pub const VERTICAL_CRS: u16 = 4096;
    pub const VERTICAL_CITATION: u16 = 4097;
    pub const VERTICAL_UNIT: u16 = 4099;
}

const USER_DEFINED: u16 = 32767;

struct GeoKeys<'a> {
    /// Id, place of the value, count, value or offset.
    entries: Vec<[u16; 4]>,
    doubles: &'a [u8],
    ascii: &'a [u8],
}

impl GeoKeys<'_> {
    fn entry(&self, id: u16, place: u16) -> Option<[u16; 4]> {
        self.entries.iter().copied().find(|entry| entry[0] == id && entry[1] == place)
    }

    fn short(&self, id: u16) -> Option<u16> {
        self.entry(id, 0).map(|entry| entry[3])
    }

    /// A code that stands for something: not 0 (undefined), nor user-defined.
    fn code(&self, id: u16) -> Option<u16> {
        self.short(id).filter(|code| (1..USER_DEFINED).contains(code))
    }

    fn double(&self, id: u16) -> Option<f64> {
        let start = usize::from(self.entry(id, 34736)?[3]) * 8;
        let bytes = self.doubles.get(start..start + 8)?;
        Some(f64::from_le_bytes(bytes.try_into().expect("8 bytes")))
    }

    fn text(&self, id: u16) -> Option<String> {
        let [_, _, count, start] = self.entry(id, 34737)?;
        let bytes = self.ascii.get(usize::from(start)..)?;
        let bytes = &bytes[..bytes.len().min(usize::from(count))];
        let end = bytes.iter().position(|&byte| byte == 0 || byte == b'|').unwrap_or(bytes.len());
        let text = String::from_utf8_lossy(&bytes[..end]).trim().to_owned();
        (!text.is_empty()).then_some(text)
    }

    fn unit(&self, code: u16, size: u16, known: &[(&str, f64, &str)]) -> Option<Unit> {
        match self.short(code)? {
            USER_DEFINED => Unit::from_file("user-defined", self.double(size)?, known),
            code => Unit::from_epsg(code),
        }
    }
}

/// Reads the GeoTIFF keys of records 34735 (directory), 34736 (doubles) and 34737 (text); `None` when
/// they say nothing of a coordinate system.
pub fn from_geotiff(directory: &[u8], doubles: &[u8], ascii: &[u8]) -> Result<Option<Crs>, CrsError> {
    let wrong = |reason: String| CrsError::Keys { reason };
    let words: Vec<u16> = directory.chunks_exact(2).map(|two| u16::from_le_bytes([two[0], two[1]])).collect();
    if words.iter().all(|&word| word == 0) {
        return Ok(None);
    }
    let &[version, _, _, count, ref entries @ ..] = &words[..] else {
        return Err(wrong(format!("{} bytes are too short for a key directory", directory.len())));
    };
    if version != 1 {
        return Err(wrong(format!("key directory version {version} does not exist")));
    }
    // The count may promise more than the record holds: what is there counts.
    let entries =
        entries.chunks_exact(4).take(usize::from(count)).map(|e| [e[0], e[1], e[2], e[3]]).collect();
    let keys = GeoKeys { entries, doubles, ascii };

    let projected_code = keys.code(key::PROJECTED_CRS);
    let projects = [key::PROJECTED_CRS, key::PROJECTION, key::PROJECTION_METHOD]
        .iter()
        .any(|&id| keys.short(id).is_some());
    let geodetic_code = keys.code(key::GEODETIC_CRS);
    let kind = match keys.short(key::MODEL_TYPE) {
        Some(1) => CrsKind::Projected,
        Some(2) => CrsKind::Geographic,
        Some(3) => CrsKind::Geocentric,
        _ if projects => CrsKind::Projected,
        _ if geodetic_code.is_some() => CrsKind::Geographic,
        _ => CrsKind::Unknown,
    };
    let (code, stated) = match kind {
        CrsKind::Geographic => (geodetic_code, keys.unit(key::ANGULAR_UNIT, key::ANGULAR_UNIT_SIZE, &ANGLES)),
        CrsKind::Geocentric => (geodetic_code, keys.unit(key::LINEAR_UNIT, key::LINEAR_UNIT_SIZE, &LENGTHS)),
        _ => (projected_code, keys.unit(key::LINEAR_UNIT, key::LINEAR_UNIT_SIZE, &LENGTHS)),
    };
    let citation = [
        if kind == CrsKind::Projected { key::PROJECTED_CITATION } else { key::GEODETIC_CITATION },
        key::CITATION,
    ]
    .iter()
    .find_map(|&id| keys.text(id));
    if kind == CrsKind::Unknown && code.is_none() && citation.is_none() {
        return Ok(None);
    }
    let mut crs = match code.and_then(definition) {
        Some(crs) => with_unit(crs, stated, citation),
        None => {
            let horizontal_unit = stated.unwrap_or_else(|| match kind {
                CrsKind::Geographic => Unit::degree(),
                _ => Unit::metre(),
            });
            let spelled_out = || {
                let angle = keys.unit(key::ANGULAR_UNIT, key::ANGULAR_UNIT_SIZE, &ANGLES);
                let angle = angle.unwrap_or_else(Unit::degree);
                let ellipsoid = keys.double(key::SEMI_MAJOR_AXIS).zip(keys.double(key::INVERSE_FLATTENING));
                System::from_geokeys(
                    [keys.code(key::PROJECTION_METHOD), keys.code(key::PROJECTION), geodetic_code],
                    horizontal_unit.si,
                    angle.si,
                    ellipsoid.map(|(a, rf)| [a, rf]),
                    |id| keys.double(id),
                )
            };
            Crs {
                name: citation
                    .or_else(|| code.map(|code| format!("EPSG:{code}")))
                    .unwrap_or_else(|| unnamed(kind)),
                epsg: code.map(u32::from),
                system: (kind == CrsKind::Projected).then(spelled_out).flatten(),
                horizontal_unit,
                vertical_unit: None,
                kind,
                wkt: None,
                vertical: None,
            }
        }
    };
    let vertical = keys.code(key::VERTICAL_CRS).and_then(vertical_definition);
    let stated = keys.short(key::VERTICAL_UNIT).and_then(Unit::from_epsg);
    let (name, unit) = vertical.map_or((None, None), |(name, unit)| (Some(name), unit));
    crs.vertical_unit = stated.or(unit).or(crs.vertical_unit);
    // A compound code has named its vertical part already.
    if !crs.wkt.as_ref().is_some_and(|text| text.starts_with(COMPOUND[0])) {
        crs.vertical = name.or_else(|| keys.text(key::VERTICAL_CITATION));
        crs.name = join(crs.name, crs.vertical.clone());
    }
    Ok(Some(crs))
}

/// The EPSG definition of `code`, if the register that is built in has it.
pub fn definition(code: u16) -> Option<Crs> {
    from_wkt(crs_definitions::from_code(code)?.wkt).ok()
}

/// `crs` of a code with the unit that the keys state. Files in feet often name the metric code of their
/// zone: then the code of the same zone in feet is meant, if there is one.
fn with_unit(crs: Crs, stated: Option<Unit>, citation: Option<String>) -> Crs {
    let Some(stated) = stated.filter(|stated| (stated.si / crs.horizontal_unit.si - 1.0).abs() > 1e-9) else {
        return crs;
    };
    let twin = register().twins.get(format!("{} ({})", crs.name, stated.symbol()).as_str());
    match twin.copied().and_then(definition) {
        Some(twin) if twin.horizontal_unit == stated => twin,
        _ => Crs {
            name: citation.unwrap_or_else(|| format!("{} in {}", crs.name, stated.name)),
            epsg: None,
            system: crs.system.map(|system| system.in_unit(stated.si)),
            horizontal_unit: stated,
            wkt: None,
            ..crs
        },
    }
}

/// What the built-in register has no key of its own for.
struct Register {
    /// Codes of projected systems named "… (ft)" or "… (ftUS)".
    twins: HashMap<&'static str, u16>,
    /// Vertical systems, out of the compound ones.
    vertical: HashMap<u32, (String, Option<Unit>)>,
}

fn register() -> &'static Register {
    static REGISTER: OnceLock<Register> = OnceLock::new();
    REGISTER.get_or_init(|| {
        let mut register = Register { twins: HashMap::new(), vertical: HashMap::new() };
        for definition in (0..=u16::MAX).filter_map(crs_definitions::from_code) {
            let text: &'static str = definition.wkt;
            if let Some(rest) = text.strip_prefix("PROJCS[\"") {
                let name = rest.split('"').next().unwrap_or_default();
                if name.ends_with("(ft)") || name.ends_with("(ftUS)") {
                    register.twins.insert(name, definition.code);
                }
            } else if text.starts_with(COMPOUND[0])
                && let (roots, None) = wkt::parse(text)
                && let Some(node) = roots[0].child(VERTICAL)
                && let (Some(code), Some(name)) = (epsg(node), node.name())
            {
                let unit = unit(node, None, LENGTH_UNIT, &LENGTHS);
                register.vertical.insert(code, (name.to_owned(), unit));
            }
        }
        register
    })
}

fn vertical_definition(code: u16) -> Option<(String, Option<Unit>)> {
    register().vertical.get(&u32::from(code)).cloned()
}

impl Crs {
    /// The text of a `.prj` file beside an image: the horizontal system, in WKT1 where that is known.
    pub fn prj(&self) -> Option<String> {
        let code = self.epsg.and_then(|code| u16::try_from(code).ok());
        let own = self.wkt.as_deref()?;
        let (roots, _) = wkt::parse(own);
        let horizontal = split(roots.first()?).0.filter(|node| !node.is_cut)?;
        let wkt1 = ["PROJCS", "GEOGCS", "GEOCCS", "LOCAL_CS"];
        if !horizontal.is(&wkt1)
            && let Some(known) = code.and_then(crs_definitions::from_code)
            && let (known, None) = wkt::parse(known.wkt)
            && let Some(known) = split(&known[0]).0
            && known.is(&wkt1)
        {
            return Some(known.text.to_owned());
        }
        Some(horizontal.text.to_owned())
    }

    /// Whether X and Y mean the same in both: by what the systems are, whatever they are called. Where a definition does
    /// not say it, by code if both have one, else by name; and by unit.
    pub fn same_horizontal(&self, other: &Crs) -> bool {
        if let (Some(a), Some(b)) = (&self.system, &other.system) {
            return a.is(b);
        }
        let same_unit = (self.horizontal_unit.si / other.horizontal_unit.si - 1.0).abs() < 1e-9;
        let same = match (self.epsg, other.epsg) {
            (Some(a), Some(b)) => a == b,
            _ => plain(&self.name) == plain(&other.name),
        };
        same && same_unit && self.kind == other.kind
    }

    /// WGS 84 as longitude and latitude, or counted from the Earth's centre: what coordinates are recognised as.
    pub fn recognised(geocentric: bool) -> Crs {
        let (name, epsg, kind, unit) = match geocentric {
            false => ("WGS 84", 4326, CrsKind::Geographic, Unit::degree()),
            true => ("WGS 84 (geocentric)", 4978, CrsKind::Geocentric, Unit::metre()),
        };
        Crs {
            name: name.into(),
            epsg: Some(epsg),
            horizontal_unit: unit,
            vertical_unit: None,
            kind,
            wkt: definition(epsg as u16).and_then(|crs| crs.wkt),
            vertical: None,
            system: Some(System::wgs84(geocentric)),
        }
    }
}

/// The horizontal part of a name without what programs spell differently: `RGF93_Lambert_93`.
fn plain(name: &str) -> String {
    let horizontal = name.split(" + ").next().unwrap_or_default();
    horizontal.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A key directory of entries whose values stand in place.
    fn keys(entries: &[(u16, u16)]) -> Vec<u8> {
        let mut words = vec![1, 1, 0, entries.len() as u16];
        words.extend(entries.iter().flat_map(|&(id, value)| [id, 0, 1, value]));
        words.into_iter().flat_map(u16::to_le_bytes).collect()
    }

    fn geotiff(entries: &[(u16, u16)]) -> Crs {
        from_geotiff(&keys(entries), &[], &[]).unwrap().unwrap()
    }

    #[test]
    fn every_definition_of_the_register_is_read() {
        let mut count = [0; 4];
        for code in 0..=u16::MAX {
            let Some(known) = crs_definitions::from_code(code) else { continue };
            if known.wkt.is_empty() {
                continue; // The register has a few codes without a definition.
            }
            let crs = from_wkt(known.wkt).unwrap_or_else(|error| panic!("{code}: {error}"));
            count[crs.kind as usize] += 1;
            let feet = known.proj4.contains("+units=us-ft ") || known.proj4.contains("+to_meter=0.3048006");
            if feet && crs.kind == CrsKind::Projected {
                assert_eq!(crs.horizontal_unit.name, "US survey foot", "{code}");
            }
            if known.proj4.contains("+units=m ") && crs.kind == CrsKind::Projected {
                assert_eq!(crs.horizontal_unit.name, "metre", "{code}");
            }
            if known.proj4.contains("+proj=longlat") {
                assert_eq!(crs.kind, CrsKind::Geographic, "{code}");
            }
        }
        assert!(count[0] > 5000 && count[1] > 500 && count[2] > 10, "{count:?}");
    }

    #[test]
    fn compound_codes_bring_their_vertical_unit() {
        let crs = geotiff(&[(1024, 1), (3072, 7405)]);
        assert_eq!(crs.name, "OSGB 1936 / British National Grid + ODN height");
        assert_eq!((crs.epsg, crs.vertical_unit), (Some(27700), Some(Unit::metre())));
    }

    #[test]
    fn a_metric_code_with_feet_is_the_zone_in_feet() {
        let crs = geotiff(&[(1024, 1), (3072, 26995), (3076, 9003)]);
        assert_eq!(crs.name, "NAD83 / Mississippi West (ftUS)");
        assert_eq!(crs.epsg, Some(2255));
        assert_eq!(crs.horizontal_unit.name, "US survey foot");
        let crs = geotiff(&[(1024, 1), (3072, 32632), (3076, 9003)]);
        assert_eq!(
            (crs.name.as_str(), crs.epsg, crs.wkt),
            ("WGS 84 / UTM zone 32N in US survey foot", None, None)
        );
    }

    #[test]
    fn vertical_keys() {
        let crs = geotiff(&[(1024, 1), (3072, 26912), (4096, 6360)]);
        assert_eq!(crs.vertical_unit.unwrap().name, "US survey foot");
        let crs = geotiff(&[(1024, 1), (3072, 26912), (4099, 9002)]);
        assert_eq!(crs.vertical_unit.unwrap().name, "foot");
    }

    #[test]
    fn wkt2_units_in_axes_and_bound_systems() {
        let text = r#"COMPOUNDCRS["x",BOUNDCRS[SOURCECRS[PROJCRS["NAD83(2011) / Oregon North (ft)",
            BASEGEOGCRS["NAD83(2011)",DATUM["d",ELLIPSOID["GRS 1980",6378137,298.257222101,LENGTHUNIT["metre",1]]]],
            CONVERSION["c",METHOD["m"],PARAMETER["p",1,LENGTHUNIT["foot",0.3048]]],CS[Cartesian,2],
            AXIS["easting (X)",east,ORDER[1],LENGTHUNIT["foot",0.3048]],AXIS["northing (Y)",north,ORDER[2],
            LENGTHUNIT["foot",0.3048]],ID["EPSG",6559]]],TARGETCRS[GEOGCRS["WGS 84"]]],
            VERTCRS["NAVD88 height (ftUS)",VDATUM["n"],CS[vertical,1],AXIS["up (H)",up,
            LENGTHUNIT["US survey foot",0.304800609601219]],ID["EPSG",6360]]]"#;
        let crs = from_wkt(text).unwrap();
        assert_eq!((crs.kind, crs.epsg), (CrsKind::Projected, Some(6559)));
        assert_eq!(crs.horizontal_unit.name, "foot");
        assert_eq!(crs.vertical_unit.as_ref().unwrap().name, "US survey foot");
        assert!(crs.prj().unwrap().starts_with("PROJCS[\"NAD83(2011) / Oregon North (ft)\""));
        let geocentric = from_wkt(r#"GEODCRS["WGS 84",CS[Cartesian,3],LENGTHUNIT["metre",1]]"#).unwrap();
        assert_eq!(geocentric.kind, CrsKind::Geocentric);
        let spatial = definition(4979).unwrap();
        assert_eq!((spatial.kind, spatial.vertical_unit), (CrsKind::Geographic, Some(Unit::metre())));
    }

    #[test]
    fn the_name_decides_where_a_foot_has_one_metre() {
        let crs = from_wkt(
            r#"PROJCS["a",UNIT["Foot_US",1.0],AUTHORITY["EPSG","1"]],VERTCS["v",UNIT["Meter",1.0]]"#,
        );
        let crs = crs.unwrap();
        assert_eq!(crs.horizontal_unit.name, "US survey foot");
        assert_eq!((crs.vertical_unit, crs.name.as_str()), (Some(Unit::metre()), "a + v"));
    }

    #[test]
    fn broken_definitions_are_named_and_the_other_one_serves() {
        let directory = keys(&[(1024, 1), (3072, 2154)]);
        let records =
            [("LASF_Projection", 2112, &b"PROJCS[\"cut"[..]), ("LASF_Projection", 34735, &directory[..])];
        let (crs, errors) = from_records(records, true);
        assert_eq!(crs.unwrap().epsg, Some(2154));
        assert!(matches!(errors[..], [CrsError::Syntax(_)]));
        assert!(from_wkt_bytes(b"VERT_CS[\"x\"]").is_err());
        assert!(from_wkt_bytes(&[1, 2, 3, 200]).is_err());
        assert_eq!(from_wkt_bytes(b"").unwrap(), (None, None));
        assert_eq!(from_wkt_bytes(b"  \0junk").unwrap(), (None, None));
    }

    #[test]
    fn no_directory_is_too_odd_to_be_read() {
        for length in 0..40 {
            for fill in [1, 0x7f, 0xff] {
                let bytes = vec![fill; length];
                let _ = from_geotiff(&bytes, &bytes, &bytes);
            }
        }
        // The count promises 65,535 keys; offsets point past the doubles and the text.
        let words: [u16; 12] = [1, 1, 0, 0xffff, 3076, 0, 1, 32767, 3077, 34736, 1, 0xffff];
        let mut bytes: Vec<u8> = words.into_iter().flat_map(u16::to_le_bytes).collect();
        bytes.extend([0x02, 0x04, 0xb1, 0x87, 0xff, 0xff, 0xff, 0xff]);
        assert_eq!(from_geotiff(&bytes, &[0; 16], b"x").unwrap(), None);
    }

    #[test]
    fn same_horizontal_by_code_else_by_name() {
        let wkt = from_wkt(r#"PROJCS["RGF93_Lambert_93",UNIT["Meter",1.0]]"#).unwrap();
        let code = geotiff(&[(1024, 1), (3072, 2154)]);
        let esri = Crs { name: "RGF93 / Lambert-93 + IGN69".into(), epsg: None, ..code.clone() };
        assert!(wkt.same_horizontal(&esri));
        assert!(!code.same_horizontal(&definition(32632).unwrap()));
    }
}
