//! Saved views on the command line: what they say of files and options becomes words as a user would type them.

use super::outcome::UsageError;
use crate::render::path::CameraPath;
use crate::render::saved_view::SavedView;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// The words of a saved view.
#[derive(Debug, Default)]
pub(super) struct SavedWords {
    /// Files and folders that are shown.
    pub(super) inputs: Vec<OsString>,
    /// Files that are open, but hidden.
    pub(super) hidden: Vec<OsString>,
    /// Options, `--name=value`.
    pub(super) options: Vec<OsString>,
}

/// A path as a word that is no option.
fn word(path: PathBuf) -> OsString {
    let is_option = path.as_os_str().as_encoded_bytes().starts_with(b"-");
    if is_option { Path::new(".").join(path).into_os_string() } else { path.into_os_string() }
}

impl SavedWords {
    /// Of the view of `file`, with the options that are `wanted` by their names.
    pub(super) fn of(file: &Path, view: &SavedView, wanted: impl Fn(&str) -> bool) -> SavedWords {
        let folder = file.parent().unwrap_or(Path::new(""));
        SavedWords {
            inputs: view.inputs(folder).into_iter().map(word).collect(),
            hidden: view.hidden(folder).into_iter().map(word).collect(),
            options: view.words(wanted),
        }
    }
}

/// Whether a file is one that views are saved in, by its name.
pub fn is_view_name(word: &OsStr) -> bool {
    Path::new(word).extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// What is wrong with an option that a view has, as the command line says it.
pub fn wrong_option(file: &Path, error: &clap::Error) -> UsageError {
    let text = error.to_string();
    let line = text.lines().next().unwrap_or_default();
    UsageError(format!("{}: {}", file.display(), line.trim_start_matches("error: ")))
}

/// Options that say together what is shown.
const PAIRS: [[&str; 2]; 2] = [["classes", "hide"], ["withheld", "hide-flags"]];

/// Whether the option `name` of `command` stands in `typed`, under any of its names.
fn is_typed(command: &clap::Command, typed: &[OsString], name: &str) -> bool {
    // One of them says what both do.
    let is_same =
        |long| long == name || PAIRS.iter().any(|pair| pair.contains(&name) && pair.contains(&long));
    let arguments = command.get_arguments().filter(|a| a.get_long().is_some_and(is_same));
    let names: Vec<String> = arguments
        .flat_map(|a| a.get_long().into_iter().chain(a.get_all_aliases().unwrap_or_default()))
        .map(|long| format!("--{long}"))
        .collect();
    typed.iter().take_while(|word| *word != "--").any(|word| {
        let text = word.to_string_lossy();
        names.iter().any(|name| {
            text.strip_prefix(&**name).is_some_and(|rest| rest.is_empty() || rest.starts_with('='))
        })
    })
}

/// The words that were typed and what the camera path of `file` says of files and options, but for options that are typed.
/// `is_window`: a window opens the hidden files, too, and has a size of its own.
///
/// Errors: the file cannot be read, or names no files.
pub fn typed_with_view(
    command: &clap::Command,
    typed: &[OsString],
    file: &Path,
    is_window: bool,
) -> Result<Vec<OsString>, UsageError> {
    let path = CameraPath::read(file).map_err(|error| UsageError(error.to_string()))?;
    let Some(view) = path.saved_view() else {
        let why = format!(
            "{}: a camera path that names no files: give them, too (--path {0} INPUT)",
            file.display()
        );
        return Err(UsageError(why));
    };
    let is_other = |name: &str| is_window && name == "size";
    let is_wanted = |name: &str| !is_other(name) && !is_typed(command, typed, name);
    let SavedWords { inputs, hidden, options } = SavedWords::of(file, view, is_wanted);
    // Behind "--" there are no options.
    let end = typed.iter().position(|word| word == "--").unwrap_or(typed.len());
    let mut words = [&typed[..end], &options[..], &typed[end..]].concat();
    if is_window {
        let hidden_options = hidden.iter().map(|path| {
            let mut word = OsString::from("--hidden=");
            word.push(path);
            word
        });
        words.splice(end..end, hidden_options);
        words.extend(hidden);
    }
    words.extend(inputs);
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_counts_before_what_was_saved() {
        let command = clap::Command::new("render")
            .arg(clap::Arg::new("color").long("color").visible_alias("colour"))
            .arg(clap::Arg::new("classes").long("classes"))
            .arg(clap::Arg::new("hide").long("hide"))
            .arg(clap::Arg::new("withheld").long("withheld").num_args(0))
            .arg(clap::Arg::new("hide_flags").long("hide-flags"));
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("view.json");
        let camera = r#""version": 1, "keyframes": [{"time": 0, "eye": [0, 0, 9], "target": [0, 0, 0]}]"#;
        let view = r#"{"inputs": ["a.las"], "hidden": ["b.las"],
            "options": {"color": "class", "hide": "3-5", "size": "10x10", "withheld": true}}"#;
        std::fs::write(&file, format!("{{{camera}, \"view\": {view}}}")).unwrap();
        let words = |typed: &[&str], is_window| {
            let typed: Vec<_> = typed.iter().map(OsString::from).collect();
            let words = typed_with_view(&command, &typed, &file, is_window).unwrap();
            let place = folder.path().to_str().unwrap();
            let texts = words[typed.len()..].iter().map(|word| word.to_str().unwrap().replace(place, "."));
            texts.collect::<Vec<_>>().join(" ")
        };
        assert_eq!(words(&["render"], false), "--color=class --hide=3-5 --size=10x10 --withheld ./a.las");
        assert_eq!(
            words(&["view"], true),
            "--hidden=./b.las --color=class --hide=3-5 --withheld ./b.las ./a.las"
        );
        assert_eq!(words(&["view", "--"], true).split(' ').next_back(), Some("./a.las"));
        let others = ["render", "--colour=rgb", "--classes", "2"];
        assert_eq!(words(&others, false), "--size=10x10 --withheld ./a.las");
        let flags = words(&["render", "--hide-flags", "overlap"], false);
        assert_eq!(flags, "--color=class --hide=3-5 --size=10x10 ./a.las");
        std::fs::write(&file, format!("{{{camera}}}")).unwrap();
        let error = typed_with_view(&command, &[], &file, false).unwrap_err().to_string();
        assert!(error.contains("view.json: a camera path that names no files"), "{error}");
    }
}
