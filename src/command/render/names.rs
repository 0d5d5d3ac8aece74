//! Which of the words are inputs, and what the pictures are called.

use super::args::Args;
use crate::command::UsageError;
use crate::command::saved::is_view_name;
use crate::command::values::is_picture;
use crate::output;
use crate::render::image::Format;
use crate::render::path::CameraPath;
use crate::source::inputs::Inputs;
use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};

/// Splits the words into inputs and the name of the picture, where one was typed: behind `-o`, or as the last word.
pub(super) fn split(args: &Args) -> Result<(Vec<OsString>, Option<PathBuf>), UsageError> {
    let mut inputs = args.inputs.clone();
    let wrong = |why: String| Err(UsageError(why));
    let is_gone = |word: &OsString| Path::new(word).symlink_metadata().is_err();
    let mut output = args.output.clone();
    if let Some(last) = inputs.last().filter(|word| is_picture(word)).cloned() {
        let name = Path::new(&last).display();
        let head = output::head(Path::new(&last)).unwrap_or_default();
        match &output {
            Some(other) if is_gone(&last) => {
                let other = other.display();
                return wrong(format!("{name} and -o {other}: two names for the picture: give one"));
            }
            // A name behind -o: the others are inputs.
            Some(_) => {}
            // What was written before is written again.
            None if is_gone(&last) || output::is_ours(&head) => {
                inputs.pop();
                output = Some(last.into());
            }
            None if Path::new(&last).is_dir() || head.starts_with(b"LASF") => {}
            None => {
                return wrong(format!(
                    "{name}: is it the picture to write, or an input? lasray has not made the file there: to write \
                     over it, say -o {name}"
                ));
            }
        }
    }
    if let (None, Some(early)) = (&output, inputs.iter().find(|word| is_picture(word) && is_gone(word))) {
        let early = Path::new(early).display();
        return wrong(format!("{early}: no such file; the picture to write comes last, or behind -o"));
    }
    if args.demo && !inputs.is_empty() {
        return wrong(format!(
            "--demo cannot be used with inputs, such as {}",
            Path::new(&inputs[0]).display()
        ));
    }
    if let (None, Some(view)) = (&args.path, inputs.iter().find(|word| is_view(word))) {
        let view = Path::new(view).display();
        return wrong(format!("{view}: it says where a camera is: lasray render --path {view} draws it"));
    }
    if !args.demo && inputs.is_empty() {
        return wrong("no INPUT: files, folders, @lists or patterns to draw".to_owned());
    }
    Ok((inputs, output))
}

/// Whether a word is a file that says where a camera is.
fn is_view(word: &OsString) -> bool {
    is_view_name(word) && CameraPath::read(Path::new(word)).is_ok()
}

/// A name for the picture where none was typed: the first input's, in the current folder.
pub(super) fn made_up(args: &Args, inputs: &[OsString], found: &Inputs, pictures: u32) -> PathBuf {
    if args.each {
        return "{stem}.png".into();
    }
    let stem = match inputs.first() {
        None => "demo".to_owned(),
        Some(word) => stem_of_word(word, found),
    };
    match args.path {
        // Signs that would stand for a number.
        Some(_) if pictures > 1 => format!("{}-%04d.png", stem.replace('%', "%%")).into(),
        Some(_) => format!("{}.png", stem.replace('%', "%%")).into(),
        None => format!("{stem}.png").into(),
    }
}

/// What an INPUT argument is called.
fn stem_of_word(word: &OsStr, found: &Inputs) -> String {
    let path = Path::new(word);
    let text = word.to_string_lossy();
    if path.exists() {
        // `.` and `..` have names, too.
        let whole = path.canonicalize().ok().filter(|_| path.file_name().is_none());
        return stem(whole.as_deref().unwrap_or(path));
    }
    if let Some(list) = text.strip_prefix('@') {
        return Path::new(list).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    }
    match found.files.first() {
        Some(first) if text.contains(['*', '?', '[']) => stem(first),
        _ => stem(path),
    }
}

/// The name of an input without its extensions.
fn stem(input: &Path) -> String {
    let name = input.file_name().unwrap_or(OsStr::new("lasray")).to_string_lossy();
    let lower = name.to_lowercase();
    let cut = [".copc.laz", ".laz", ".las"].iter().find(|e| lower.ends_with(**e)).map_or(0, |e| e.len());
    name[..name.len() - cut].to_owned()
}

/// The names of `files`, no two alike: those of the same stem have the names of their folders before it, as many as tell
/// them apart, else their extension behind it, or a number.
pub(super) fn distinct_stems(files: &[PathBuf]) -> Vec<String> {
    let folders: Vec<Vec<String>> = files
        .iter()
        .map(|file| {
            let parts = file.parent().into_iter().flat_map(Path::components);
            let named = parts.filter_map(|part| match part {
                Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
                _ => None,
            });
            named.collect()
        })
        .collect();
    let mut names: Vec<String> = files.iter().map(|file| stem(file)).collect();
    let depth = folders.iter().map(Vec::len).max().unwrap_or_default();
    for level in 1..=depth {
        for at in alike(&names) {
            let above = &folders[at][folders[at].len().saturating_sub(level)..];
            names[at] = above.iter().cloned().chain([stem(&files[at])]).collect::<Vec<_>>().join("-");
        }
    }
    for at in alike(&names) {
        let extension = files[at].extension().unwrap_or_default().to_string_lossy();
        names[at] = format!("{}-{extension}", names[at]);
    }
    let mut number = 1;
    while let [_, at, ..] = alike(&names)[..] {
        number += 1;
        names[at] = format!("{}-{number}", names[at]);
    }
    names
}

/// Which names occur more than once, on file systems that take upper for lower case, too.
fn alike(names: &[String]) -> Vec<usize> {
    let lower: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
    let mut counts: HashMap<&str, usize> = HashMap::new();
    lower.iter().for_each(|name| *counts.entry(name).or_default() += 1);
    (0..names.len()).filter(|&at| counts[lower[at].as_str()] > 1).collect()
}

/// `{stem}` in `pattern` by `stem`.
pub(super) fn each_output(pattern: &Path, stem: &str) -> PathBuf {
    PathBuf::from(pattern.to_string_lossy().replace("{stem}", stem))
}

/// Finds out before the work whether its result can be written.
pub(super) fn check(output: &Path, each: bool) -> anyhow::Result<()> {
    Format::of(output).map_err(|e| UsageError(e.to_string()))?;
    if each && !output.to_string_lossy().contains("{stem}") {
        return Err(UsageError("--each needs {stem} in the output's name: -o '{stem}.png'".to_owned()).into());
    }
    if !each && output.to_string_lossy().contains("{stem}") {
        return Err(UsageError("{stem} in the output's name goes with --each".to_owned()).into());
    }
    let folder = match output.parent() {
        Some(p) if !p.as_os_str().is_empty() && !p.to_string_lossy().contains("{stem}") => p,
        Some(p) if p.to_string_lossy().contains("{stem}") => return Ok(()),
        _ => Path::new("."),
    };
    let wrong = if output.is_dir() {
        "it is a folder".to_owned()
    } else if !folder.exists() {
        format!("the folder {} does not exist", folder.display())
    } else {
        match tempfile::tempfile_in(folder) {
            Ok(_) => return Ok(()),
            Err(error) => format!("{}: {error}", folder.display()),
        }
    };
    anyhow::bail!("{}: cannot be written: {wrong}", output.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stems_are_told_apart() {
        let names = |files: &[&str]| distinct_stems(&files.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(names(&["x/a.laz", "x/b.copc.laz", "c.LAS"]), ["a", "b", "c"]);
        assert_eq!(names(&["a/tile.laz", "b/tile.laz", "b/other.laz"]), ["a-tile", "b-tile", "other"]);
        assert_eq!(names(&["tile.las", "sub/tile.las"]), ["tile", "sub-tile"]);
        assert_eq!(names(&["x/a/tile.laz", "y/a/tile.laz"]), ["x-a-tile", "y-a-tile"]);
        assert_eq!(names(&["d/tile.las", "d/tile.laz"]), ["d-tile-las", "d-tile-laz"]);
        assert_eq!(names(&["/d/Tile.laz", "/e/tile.laz"]), ["d-Tile", "e-tile"]);
        assert_eq!(names(&["a/tile.laz", "b/tile.laz", "a-tile.laz"]).len(), 3);
        let odd = names(&["a/tile.laz", "../a/tile.laz", "./a/tile.laz", "a-tile.laz"]);
        let mut unlike = odd.clone();
        unlike.sort();
        unlike.dedup();
        assert_eq!(unlike.len(), 4, "{odd:?}");
        assert_eq!(names(&[]), [""; 0]);
    }

    #[test]
    fn words_have_stems() {
        let found = Inputs { files: vec!["tiles/first.laz".into()], ..Inputs::default() };
        let name = |word: &str| stem_of_word(OsStr::new(word), &found);
        assert_eq!(name("a/b.copc.laz"), "b");
        assert_eq!(name("tiles.v2/"), "tiles.v2");
        assert_eq!(name("@lists/tiles.txt"), "tiles");
        assert_eq!(name("tiles/*.laz"), "first");
        let here = std::env::current_dir().unwrap();
        assert_eq!(name("."), here.file_name().unwrap().to_string_lossy());
        assert_eq!(name("/"), "lasray");
    }
}
