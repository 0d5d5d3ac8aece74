//! What makes a view besides its camera: files, colours, layers and options, as they stand in the file of a camera path.
//!
//! Options have the names and values that they have on the command line: what reads a view is what reads that.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};

/// Options that a view may have: what is seen, never where something is written.
pub const OPTIONS: [&str; 23] = [
    "assume-crs",
    "cell",
    "classes",
    "color",
    "crs",
    "gps-time",
    "heights",
    "hide",
    "hide-flags",
    "intensity",
    "mix-crs",
    "no-bridge",
    "ramp",
    "range",
    "returns",
    "rgb-bits",
    "shade",
    "size",
    "source-id",
    "surface",
    "withheld",
    "z-scale",
    "z-unit",
];

/// The value of an option.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum OptionValue {
    /// Of one without a value: whether it is given.
    Flag(bool),
    /// A number.
    Number(f64),
    /// As it is typed.
    Text(String),
    /// Of one that is given several times.
    Many(Vec<String>),
}

/// A file or folder, by where it lies from the view's own file, and from the root.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "PathText")]
pub struct SavedPath {
    /// From the folder that the view lies in, with `/` between its parts; absolute where there is no such way.
    path: String,
    /// Where it was when the view was saved.
    #[serde(skip_serializing_if = "Option::is_none")]
    absolute: Option<String>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum PathText {
    Plain(String),
    Both(BothPaths),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BothPaths {
    path: String,
    absolute: Option<String>,
}

impl From<PathText> for SavedPath {
    fn from(text: PathText) -> SavedPath {
        match text {
            PathText::Plain(path) => SavedPath { path, absolute: None },
            PathText::Both(BothPaths { path, absolute }) => SavedPath { path, absolute },
        }
    }
}

impl SavedPath {
    /// Of a file that is there, for a view in `folder`.
    fn of(word: &OsStr, folder: &Path) -> Result<SavedPath, String> {
        let text = |path: &Path| {
            let no_text = || format!("{}: its name is no text, and no view can name it", path.display());
            path.to_str().map(str::to_owned).ok_or_else(no_text)
        };
        let absolute = std::path::absolute(word).map_err(|error| format!("{}: {error}", word.display()))?;
        let near = absolute.canonicalize().ok().zip(folder.canonicalize().ok());
        let path = match near.and_then(|(file, folder)| way(&folder, &file)) {
            Some(parts) => parts.join("/"),
            None => text(&absolute)?,
        };
        Ok(SavedPath { path, absolute: Some(text(&absolute)?) })
    }

    /// Where it lies for a view in `folder`: moved along with it, or where it was. Where it is neither, that is what is
    /// named.
    fn find(&self, folder: &Path) -> PathBuf {
        let near = folder.join(&self.path);
        match &self.absolute {
            Some(absolute) if !near.exists() => PathBuf::from(absolute),
            _ => near,
        }
    }
}

/// The parts of the way from a folder to a file, both canonical; `None`: there is none, or not in text.
fn way(folder: &Path, file: &Path) -> Option<Vec<String>> {
    let (folder, file): (Vec<_>, Vec<_>) = (folder.components().collect(), file.components().collect());
    let shared = folder.iter().zip(&file).take_while(|(a, b)| a == b).count();
    // Other drives.
    if !matches!(folder.get(shared.checked_sub(1)?)?, Component::RootDir | Component::Normal(_)) {
        return None;
    }
    let up = folder[shared..].iter().map(|_| Some("..".to_owned()));
    let down = file[shared..].iter().map(|part| part.as_os_str().to_str().map(str::to_owned));
    let parts: Vec<String> = up.chain(down).collect::<Option<_>>()?;
    Some(if parts.is_empty() { vec![".".to_owned()] } else { parts })
}

/// See the module.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedView {
    inputs: Vec<SavedPath>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    hidden: Vec<SavedPath>,
    #[serde(default)]
    options: Options,
}

/// By name, in the order of names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "BTreeMap<String, OptionValue>")]
struct Options(BTreeMap<String, OptionValue>);

impl TryFrom<BTreeMap<String, OptionValue>> for Options {
    type Error = String;

    fn try_from(options: BTreeMap<String, OptionValue>) -> Result<Options, String> {
        match options.keys().find(|name| !OPTIONS.contains(&name.as_str())) {
            Some(name) => Err(format!("options: `{name}` is none of a view's: {}", OPTIONS.join(", "))),
            None => Ok(Options(options)),
        }
    }
}

impl SavedView {
    /// Of files and folders that are shown, of files that are hidden, and of options; for a file in `folder`. Errors: in
    /// words.
    pub fn new<'p>(
        folder: &Path,
        inputs: &[OsString],
        hidden: impl IntoIterator<Item = &'p Path>,
        options: impl IntoIterator<Item = (&'static str, OptionValue)>,
    ) -> Result<SavedView, String> {
        let folder = if folder == Path::new("") { Path::new(".") } else { folder };
        let inputs: Result<_, _> = inputs.iter().map(|word| SavedPath::of(word, folder)).collect();
        let hidden: Result<_, _> =
            hidden.into_iter().map(|path| SavedPath::of(path.as_os_str(), folder)).collect();
        let options: BTreeMap<_, _> =
            options.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        Ok(SavedView { inputs: inputs?, hidden: hidden?, options: options.try_into()? })
    }

    /// Files and folders that are shown, where they lie for a view in `folder`.
    pub fn inputs(&self, folder: &Path) -> Vec<PathBuf> {
        self.inputs.iter().map(|path| path.find(folder)).collect()
    }

    /// And files that are open, but hidden.
    pub fn hidden(&self, folder: &Path) -> Vec<PathBuf> {
        self.hidden.iter().map(|path| path.find(folder)).collect()
    }

    /// Options as words of a command line, those that are `wanted` by their names.
    pub fn words(&self, wanted: impl Fn(&str) -> bool) -> Vec<OsString> {
        let mut words = Vec::new();
        for (name, value) in self.options.0.iter().filter(|(name, _)| wanted(name)) {
            match value {
                OptionValue::Flag(is_on) => words.extend(is_on.then(|| format!("--{name}"))),
                OptionValue::Number(number) => words.push(format!("--{name}={number}")),
                OptionValue::Text(text) => words.push(format!("--{name}={text}")),
                OptionValue::Many(many) => words.extend(many.iter().map(|text| format!("--{name}={text}"))),
            }
        }
        words.into_iter().map(OsString::from).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_are_found_from_the_views_own_place_then_where_they_were() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        fs::create_dir_all(at("project/tiles")).unwrap();
        fs::create_dir_all(at("project/views")).unwrap();
        fs::write(at("project/tiles/a b.las"), "").unwrap();
        let tile = at("project/tiles/a b.las");
        let inputs = [tile.clone().into_os_string(), at("project/tiles").into_os_string()];
        let view = SavedView::new(&at("project/views"), &inputs, [&*tile], []).unwrap();
        let text = serde_json::to_string(&view).unwrap();
        assert!(text.contains(r#""path":"../tiles/a b.las""#), "{text}");
        assert_eq!(serde_json::from_str::<SavedView>(&text).unwrap(), view);
        let found = |folder: &str| view.inputs(&at(folder))[0].canonicalize().unwrap();
        assert_eq!(found("project/views"), tile.canonicalize().unwrap());
        // From elsewhere, by the place where it was.
        assert_eq!(found(""), tile.canonicalize().unwrap());
        // Moved along, with another in its old place: the one beside the view counts.
        fs::create_dir_all(at("copy/tiles")).unwrap();
        fs::create_dir_all(at("copy/views")).unwrap();
        fs::write(at("copy/tiles/a b.las"), "").unwrap();
        assert_eq!(found("copy/views"), at("copy/tiles/a b.las").canonicalize().unwrap());
        fs::remove_dir_all(at("project")).unwrap();
        assert_eq!(found("copy/views"), at("copy/tiles/a b.las").canonicalize().unwrap());
        assert_eq!(view.hidden(&at("")), [tile], "one that is missing is named by where it was");
    }

    #[test]
    fn the_page_on_saved_views_lists_their_options() {
        let page = include_str!("../../docs/camera-paths.md");
        let listed = format!("without their dashes: `{}`.", OPTIONS.join("`, `"));
        assert!(page.contains(&listed), "{listed}");
    }

    #[test]
    fn options_are_words_of_the_command_line_and_no_others() {
        let text = r#"{"inputs": ["a.las", {"path": "b"}],
            "options": {"hide": "3-5", "hide-flags": "overlap", "withheld": true, "mix-crs": false, "z-scale": 2, "assume-crs": ["1", "x=2"]}}"#;
        let view: SavedView = serde_json::from_str(text).unwrap();
        assert_eq!(view.inputs(Path::new("d")), [Path::new("d/a.las"), Path::new("d/b")]);
        let words = view.words(|_| true);
        assert_eq!(
            words,
            [
                "--assume-crs=1",
                "--assume-crs=x=2",
                "--hide=3-5",
                "--hide-flags=overlap",
                "--withheld",
                "--z-scale=2"
            ]
        );
        assert_eq!(view.words(|name| name == "hide"), ["--hide=3-5"]);
        for (wrong, part) in [
            (r#"{"inputs": [], "options": {"output": "a.png"}}"#, "`output` is none of a view's"),
            (r#"{"inputs": [], "files": []}"#, "unknown field"),
            (r#"{"options": {}}"#, "missing field `inputs`"),
        ] {
            let error = serde_json::from_str::<SavedView>(wrong).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
