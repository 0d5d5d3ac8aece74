//! Arguments about coordinate systems and units, of every command that reads files.

use crate::source::crs::{self, Crs, Unit};
use crate::source::placement::{Assumption, PlacementOptions};

/// Coordinate systems and units.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct PlacementArgs {
    /// The picture's coordinate system, into which files of others are transformed [default: that of most files]
    #[arg(long, value_parser = system, help_heading = "Data", value_name = "EPSG:CODE")]
    crs: Option<Crs>,
    /// System of files that name none, or one that cannot be; with a pattern of those whose names fit, whatever they
    /// say: 'old_*.laz=EPSG:31467'. May be given several times
    #[arg(long, value_parser = assumption, help_heading = "Data", value_name = "[PATTERN=]EPSG:CODE")]
    assume_crs: Vec<Assumption>,
    /// Take files of different coordinate systems together, by their raw coordinates
    #[arg(long, conflicts_with_all = ["crs", "assume_crs"], help_heading = "Data")]
    mix_crs: bool,
    /// Unit of heights, where the files are wrong: m, ft or us-ft
    #[arg(long, help_heading = "Data", value_name = "UNIT")]
    z_unit: Option<Unit>,
}

impl PlacementArgs {
    /// What they say of files that are opened first.
    pub fn options(&self) -> PlacementOptions {
        PlacementOptions {
            mix_crs: self.mix_crs,
            z_unit: self.z_unit.clone(),
            crs: self.crs.clone(),
            assume: self.assume_crs.clone(),
            known: None,
        }
    }
}

/// `EPSG:25832`, or the code alone.
fn system(text: &str) -> Result<Crs, String> {
    let wrong = || format!("'{text}' is not EPSG:CODE such as EPSG:25832");
    let code = match text.split_once(':') {
        Some((authority, code)) if authority.eq_ignore_ascii_case("EPSG") => code,
        Some(_) => return Err(wrong()),
        None => text,
    };
    let code: u32 = code.trim().parse().map_err(|_| wrong())?;
    let known = u16::try_from(code).ok().and_then(crs::definition);
    known.ok_or_else(|| format!("EPSG:{code} is no horizontal system of the register that is built in"))
}

fn assumption(text: &str) -> Result<Assumption, String> {
    match text.rsplit_once('=') {
        None => Ok(Assumption { pattern: None, crs: system(text)? }),
        Some((pattern, code)) => {
            let pattern = glob::Pattern::new(pattern).map_err(|error| format!("'{pattern}': {error}"))?;
            Ok(Assumption { pattern: Some(pattern), crs: system(code)? })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_named_by_code() {
        for text in ["EPSG:25832", "epsg:25832", "25832"] {
            assert_eq!(system(text).unwrap().epsg, Some(25832), "{text}");
        }
        for (text, part) in
            [("ESRI:102003", "not EPSG:CODE"), ("EPSG:x", "not EPSG:CODE"), ("EPSG:1", "EPSG:1 is no")]
        {
            assert!(system(text).unwrap_err().contains(part), "{text}");
        }
        let one = assumption("old_*.laz=EPSG:31467").unwrap();
        assert!(one.pattern.unwrap().matches("old_7.laz") && one.crs.epsg == Some(31467));
        assert!(assumption("4326").unwrap().pattern.is_none());
        assert!(assumption("[=EPSG:4326").is_err());
    }
}
