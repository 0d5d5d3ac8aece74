//! What leaves the window: images, views, and the command line that draws the same.

use super::data::{Data, DataAbout};
use super::settings::Settings;
use crate::attribute::{ClassMask, ColorRange, ColorTable, Flags};
use crate::render::camera::{Camera, DEFAULT_FOV, Projection};
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use crate::render::saved_view::{OptionValue, SavedView};
use crate::section::Surface;
use crate::source::placement::Treatment;
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The first name of the kind `stem-0001.extension` in `folder` that is free under all of `extensions`, with the first.
pub fn next_free(folder: &Path, stem: &str, extensions: &[&str]) -> PathBuf {
    let name = |number: u32| folder.join(format!("{stem}-{number:04}.{}", extensions[0]));
    let is_free = |path: &PathBuf| {
        extensions.iter().all(|extension| path.with_extension(extension).symlink_metadata().is_err())
    };
    (1..).map(name).find(is_free).expect("some number is free")
}

/// What is seen: all that makes a picture.
pub struct Seen<'a> {
    /// Files, and how they were read.
    pub data: &'a Data,
    /// What is known of them.
    pub about: &'a DataAbout,
    /// From where.
    pub camera: &'a Camera,
    /// How.
    pub settings: &'a Settings,
    /// In what colours.
    pub colors: Option<&'a ColorTable>,
    /// Width and height, pixels.
    pub size: [u32; 2],
}

/// The view as a camera path of one keyframe, in coordinates of the world's system, with all that is seen; for a file in
/// `folder`.
pub fn view(seen: &Seen, folder: &Path) -> Result<CameraPath, String> {
    let path = CameraPath::view(seen.camera);
    let path = path.placed(|v| seen.about.base.unplace(v)).map_err(|e| e.to_string())?;
    // A later version may choose others from the data.
    let color = ("color", text(seen.settings.color.name()));
    let options = options(seen).into_iter().filter(|(name, _)| *name != "color").chain([color]);
    let bridge = (seen.settings.visibility.bridge == 0).then_some(("no-bridge", OptionValue::Flag(true)));
    let inputs = seen.data.shown_inputs(true);
    let view = SavedView::new(folder, &inputs, seen.data.hidden_files(), options.chain(bridge))?;
    Ok(path.with_view(view))
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

fn text(words: impl Into<String>) -> OptionValue {
    OptionValue::Text(words.into())
}

/// The option that shows the classes of `mask` of those `present`: the shortest, of several the one that also says the same
/// of others; `None`: none is needed.
fn classes(mask: ClassMask, present: &BTreeSet<u8>) -> Option<(&'static str, String)> {
    let usual = ClassMask::default();
    let all: BTreeSet<u8> = (0..=255).collect();
    let known = if present.is_empty() { &all } else { present };
    let differs = |class: &u8| mask.shows(*class) != usual.shows(*class);
    if !known.iter().any(differs) {
        return None;
    }
    let option = |of: &BTreeSet<u8>| {
        let shown: Vec<u8> = of.iter().copied().filter(|&c| mask.shows(c)).collect();
        let hidden = of.iter().copied().filter(|&c| !mask.shows(c) && usual.shows(c));
        // What is hidden unless asked for must be asked for.
        let is_asked = shown.iter().any(|&c| !usual.shows(c));
        let hide = (!is_asked).then(|| ("hide", list(hidden)));
        let show = (!shown.is_empty()).then(|| ("classes", list(shown.into_iter())));
        hide.into_iter().chain(show)
    };
    option(&all).chain(option(known)).min_by_key(|(name, list)| name.len() + list.len())
}

/// Options that differ from what is chosen without them.
fn options(seen: &Seen) -> Vec<(&'static str, OptionValue)> {
    let Seen { data, about, settings, size, .. } = seen;
    let read = data.options();
    // What was chosen by the first files and points is said where others would choose it now.
    let is_other = data.shows_others() || !data.is_first();
    let mut options = vec![("size", text(format!("{}x{}", size[0], size[1])))];
    if settings.color != about.color || is_other {
        options.push(("color", text(settings.color.name())));
    }
    let scale = settings.scale();
    if let Some(ramp) = scale.ramp {
        options.push(("ramp", text(ramp.name())));
    }
    let chosen = seen.colors.and_then(|colors| colors.range).filter(|_| is_other);
    // What the first files say of percentiles others would say otherwise.
    let typed = scale.range.filter(|range| !is_other || !range.has_percentiles());
    if let Some(range) = typed.or(chosen.map(|(low, high)| ColorRange::of(low, high))) {
        options.push(("range", text(range.to_string())));
    }
    let counted = data.status().kinds.kinds();
    let present = data.scene().kinds().union(&about.kinds).chain(&counted).map(|(class, _)| *class).collect();
    if let Some((name, list)) = classes(settings.visibility.classes, &present) {
        options.push((name, text(list)));
    }
    options.extend(settings.selection.options().into_iter().map(|(name, value)| (name, text(value))));
    if settings.z_scale != 1.0 {
        options.push(("z-scale", OptionValue::Number(settings.z_scale)));
    }
    if let Some(cell) = read.cell.or(data.shows_others().then_some(about.cell.into())) {
        options.push(("cell", text(cell.to_string())));
    }
    let is_moved = |file: &super::data::FileAbout| matches!(file.treatment, Treatment::Transformed { .. });
    let is_chosen = read.placement.crs.is_some() || about.files.iter().any(is_moved);
    if let Some(code) = about.crs.as_ref().filter(|_| is_chosen).and_then(|crs| crs.epsg) {
        options.push(("crs", text(format!("EPSG:{code}"))));
    }
    let assumed = read.placement.assume.iter().filter_map(|assumption| {
        let code = assumption.crs.epsg?;
        let pattern = assumption.pattern.as_ref().map_or(String::new(), |pattern| format!("{pattern}="));
        Some(format!("{pattern}EPSG:{code}"))
    });
    let assumed: Vec<_> = assumed.collect();
    if !assumed.is_empty() {
        options.push(("assume-crs", OptionValue::Many(assumed)));
    }
    if let Some(unit) = &read.placement.z_unit {
        options.push(("z-unit", text(unit.symbol())));
    }
    if let Some(bits) = read.rgb_bits {
        options.push(("rgb-bits", OptionValue::Number(bits.into())));
    }
    if read.surface != Surface::default() {
        options.push(("surface", text(read.surface.name())));
    }
    if settings.shade == Shade::None {
        options.push(("shade", text("none")));
    } else if settings.visibility.bridge == 0 {
        options.push(("no-bridge", OptionValue::Flag(true)));
    }
    let hidden = settings.visibility.hidden_flags;
    let others = hidden.without(Flags::WITHHELD);
    if !others.is_empty() {
        options.push(("hide-flags", text(others.list())));
    }
    let flags = [("mix-crs", read.placement.mix_crs), ("withheld", !hidden.has_any(Flags::WITHHELD))];
    options.extend(
        flags.into_iter().filter(|(_, is_on)| *is_on).map(|(name, _)| (name, OptionValue::Flag(true))),
    );
    options
}

/// The `lasray render` that draws what the window shows, for shells on Unix: the shortest.
pub fn command(seen: &Seen) -> String {
    let Seen { data, about, camera, .. } = seen;
    // To millimetres of metres, and of what is nearer than one unit to as much of its distance.
    let distance = (camera.target() - camera.eye()).length();
    let up = (3.0 - distance.log10().floor()).clamp(3.0, 17.0) as usize;
    let place = |v: DVec3| {
        let v = about.base.unplace(v);
        // Degrees need more digits than metres.
        let digits = if about.base.is_identity() { up } else { 9 };
        format!("{:.digits$},{:.digits$},{:.up$}", v.x, v.y, v.z)
    };
    let mut options = vec![("eye", text(place(camera.eye()))), ("target", text(place(camera.target())))];
    match camera.projection() {
        Projection::Perspective { fov } if fov == DEFAULT_FOV => {}
        Projection::Perspective { fov } => options.push(("fov", OptionValue::Number(fov))),
        Projection::Orthographic { units_per_pixel } => {
            options.push(("ortho", OptionValue::Number(units_per_pixel)));
        }
    }
    options.extend(self::options(seen));
    let mut words = vec!["lasray".to_owned(), "render".to_owned()];
    words.extend(data.shown_inputs(false).iter().map(|input| {
        let word = input.to_string_lossy();
        // Not an option.
        quoted(&if word.starts_with('-') { format!("./{word}").into() } else { word })
    }));
    let mut option = |name: &str, value: &str| {
        let value = quoted(value);
        // A value that begins like an option is part of the word.
        words.extend(match value.starts_with('-') {
            true => vec![format!("--{name}={value}")],
            false => vec![format!("--{name}"), value],
        });
    };
    for (name, value) in &options {
        match value {
            OptionValue::Number(number) => option(name, &number.to_string()),
            OptionValue::Text(text) => option(name, text),
            OptionValue::Many(many) => many.iter().for_each(|text| option(name, text)),
            OptionValue::Flag(_) => {}
        }
    }
    let flags = options.iter().filter(|(_, value)| matches!(value, OptionValue::Flag(true)));
    words.extend(flags.map(|(name, _)| format!("--{name}")));
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
        let next = || next_free(folder.path(), "lasray", &["png", "pgw"]);
        assert_eq!(next(), name(1));
        std::fs::write(name(1), "").unwrap();
        // What lies beside a picture that is gone is not taken for that of another.
        std::fs::write(name(2).with_extension("pgw"), "").unwrap();
        assert_eq!(next(), name(3));
    }

    #[test]
    fn lists_and_words_are_as_the_shell_takes_them() {
        assert_eq!(list([3, 4, 5, 7, 9, 10].into_iter()), "3-5,7,9-10");
        assert_eq!(list((0..=255).filter(|c| *c != 7)), "0-6,8-255");
        assert_eq!(quoted("tiles/a.laz"), "tiles/a.laz");
        assert_eq!(quoted("it's here"), r"'it'\''s here'");
        assert_eq!(quoted(""), "''");
    }

    #[test]
    fn classes_are_told_in_as_few_letters_as_there_are_classes() {
        let present: BTreeSet<u8> = [1, 2, 3, 4, 5, 6, 7, 9, 18].into();
        let usual = ClassMask::default();
        let told = |mask| classes(mask, &present).map(|(name, list)| format!("--{name} {list}"));
        assert_eq!(told(usual), None);
        assert_eq!(told(ClassMask::only(&[2])).unwrap(), "--classes 2");
        // One after the other unchecked, the others of the 256 left as they are.
        assert_eq!(told(usual.without(&[1, 3, 4, 5, 6, 9])).unwrap(), "--classes 2");
        assert_eq!(told(usual.without(&[3, 4, 5])).unwrap(), "--hide 3-5");
        assert_eq!(told(usual.without(&[15])), None, "there is none");
        assert_eq!(told(ClassMask::all()).unwrap(), "--classes 0-255");
        assert_eq!(told(usual.with(&[7])).unwrap(), "--classes 1-7,9");
        assert_eq!(told(ClassMask::only(&[])).unwrap(), "--hide 1-6,9");
        // While nothing is known, all are.
        let unknown = classes(usual.without(&[6]), &BTreeSet::new()).unwrap();
        assert_eq!(unknown, ("hide", "6".to_owned()));
    }
}
