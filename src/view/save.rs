//! What leaves the window: images, views, and the command line that draws the same.

use super::data::{self, DataAbout};
use super::settings::Settings;
use crate::attribute::ClassMask;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use crate::text::tidy;
use glam::DVec3;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The first name of the kind `stem-0001.extension` in `folder` that is free.
pub fn next_free(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let name = |number: u32| folder.join(format!("{stem}-{number:04}.{extension}"));
    (1..).map(name).find(|path| path.symlink_metadata().is_err()).expect("some number is free")
}

/// The last name of that kind that is taken.
pub fn last_taken(folder: &Path, stem: &str, extension: &str) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    let is_one = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&format!("{stem}-")) && name.ends_with(&format!(".{extension}"))
    };
    entries.flatten().map(|entry| entry.path()).filter(is_one).max()
}

/// The view as a camera path of one keyframe, in coordinates of the world's system.
pub fn view(camera: &Camera, about: Option<&DataAbout>) -> Result<CameraPath, String> {
    let path = CameraPath::view(camera);
    match about {
        Some(about) => path.placed(|v| about.base.unplace(v)).map_err(|e| e.to_string()),
        None => Ok(path),
    }
}

/// Classes as `--hide` takes them: 3-5,7.
fn list(classes: impl Iterator<Item = u8>) -> String {
    let mut ranges: Vec<(u8, u8)> = Vec::new();
    for class in classes {
        match ranges.last_mut() {
            Some((_, last)) if u32::from(*last) + 1 == u32::from(class) => *last = class,
            _ => ranges.push((class, class)),
        }
    }
    let text =
        |(first, last): &(u8, u8)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    ranges.iter().map(text).collect::<Vec<_>>().join(",")
}

/// A word of a command line as shells on Unix take it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// The `lasray render` that draws what the window shows.
pub fn command(
    inputs: &[OsString],
    camera: &Camera,
    about: &DataAbout,
    settings: &Settings,
    size: [u32; 2],
    opened: &data::ReadOptions,
) -> String {
    // To millimetres of metres, and of what is nearer than one unit to as much of its distance.
    let distance = (camera.target() - camera.eye()).length();
    let up = (3.0 - distance.log10().floor()).clamp(3.0, 17.0) as usize;
    let place = |v: DVec3| {
        let v = about.base.unplace(v);
        // Degrees need more digits than metres.
        let digits = if about.base.is_identity() { up } else { 9 };
        format!("{:.digits$},{:.digits$},{:.up$}", v.x, v.y, v.z)
    };
    let mut words = vec!["lasray".to_owned(), "render".to_owned()];
    words.extend(inputs.iter().map(|input| quoted(&input.to_string_lossy())));
    let mut option = |name: &str, value: String| words.push(format!("--{name}={}", quoted(&value)));
    option("eye", place(camera.eye()));
    option("target", place(camera.target()));
    match camera.projection() {
        Projection::Perspective { fov } => option("fov", tidy(fov)),
        Projection::Orthographic { units_per_pixel } => option("ortho", tidy(units_per_pixel)),
    }
    option("size", format!("{}x{}", size[0], size[1]));
    option("color", settings.color.name().to_owned());
    let shown = settings.visibility.classes;
    let usual = ClassMask::default();
    // What is hidden unless asked for must be asked for.
    let asked = (0..=255).any(|c| shown.shows(c) && !usual.shows(c));
    if asked {
        option("classes", list((0..=255).filter(|&c| shown.shows(c))));
    } else if shown != usual {
        option("hide", list((0..=255).filter(|&c| usual.shows(c) && !shown.shows(c))));
    }
    if settings.z_scale != 1.0 {
        option("z-scale", tidy(settings.z_scale));
    }
    if let Some(cell) = opened.cell {
        option("cell", cell.to_string());
    }
    if let Some(code) = opened.placement.crs.as_ref().and_then(|crs| crs.epsg) {
        option("crs", format!("EPSG:{code}"));
    }
    for assumption in &opened.placement.assume {
        if let Some(code) = assumption.crs.epsg {
            let pattern = assumption.pattern.as_ref().map_or(String::new(), |pattern| format!("{pattern}="));
            option("assume-crs", format!("{pattern}EPSG:{code}"));
        }
    }
    if let Some(unit) = &opened.placement.z_unit {
        option("z-unit", unit.symbol().to_owned());
    }
    if let Some(bits) = opened.rgb_bits {
        option("rgb-bits", bits.to_string());
    }
    if settings.shade == Shade::None {
        option("shade", "none".to_owned());
    } else if settings.visibility.bridge == 0 {
        words.push("--no-bridge".to_owned());
    }
    for (name, is_on) in
        [("--mix-crs", opened.placement.mix_crs), ("--withheld", settings.visibility.withheld)]
    {
        words.extend(is_on.then(|| name.to_owned()));
    }
    words.extend(["-o".to_owned(), "view.png".to_owned()]);
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_count_on_from_what_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let name = |n: u32| folder.path().join(format!("lasray-{n:04}.png"));
        assert_eq!(next_free(folder.path(), "lasray", "png"), name(1));
        assert_eq!(last_taken(folder.path(), "lasray", "png"), None);
        for n in [1, 2] {
            std::fs::write(name(n), "").unwrap();
        }
        assert_eq!(next_free(folder.path(), "lasray", "png"), name(3));
        assert_eq!(last_taken(folder.path(), "lasray", "png"), Some(name(2)));
    }

    #[test]
    fn lists_and_words_are_as_the_shell_takes_them() {
        assert_eq!(list([3, 4, 5, 7, 9, 10].into_iter()), "3-5,7,9-10");
        assert_eq!(list((0..=255).filter(|c| *c != 7)), "0-6,8-255");
        assert_eq!(quoted("tiles/a.laz"), "tiles/a.laz");
        assert_eq!(quoted("it's here"), r"'it'\''s here'");
        assert_eq!(quoted(""), "''");
    }
}
