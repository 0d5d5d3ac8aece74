//! Which files an INPUT argument names: files, folders, `@list.txt`, patterns the shell left alone.

use super::kinds::{self, Kind};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};

/// What the INPUT arguments came to.
#[derive(Debug, Default)]
pub struct Inputs {
    /// Every file once, ordered by its canonical path: the order of the arguments changes nothing.
    pub files: Vec<PathBuf>,
    /// Folders that were walked, each once.
    pub folders: Vec<PathBuf>,
    /// Lists that were read, or tried.
    pub lists: Vec<PathBuf>,
    /// Each input that could not be used; the others go on.
    pub failed: Vec<InputError>,
}

/// An input that names no file, and why.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// Neither a file, nor a folder, nor a pattern.
    #[error("{path}: no such file or folder", path = path.display())]
    Missing {
        /// As given.
        path: PathBuf,
    },
    /// No file at all: a URL, standard input.
    #[error("{word}: {kind}")]
    NoFile {
        /// As given.
        word: String,
        /// What it is.
        kind: &'static Kind,
    },
    /// A file, folder or list that the system does not let us read.
    #[error("{path}: cannot be read: {source}", path = path.display())]
    Unreadable {
        /// What was tried.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// A folder without LiDAR files in it or below it.
    #[error("{path}: the folder holds no .las or .laz file{}", but(.other), path = path.display())]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
        /// What is there instead, first by name.
        other: Option<Other>,
    },
    /// A pattern that no LiDAR file or folder fits.
    #[error("{pattern}: no .las or .laz file or folder fits this pattern{}", but(.other))]
    NoMatch {
        /// As given.
        pattern: String,
        /// What fits it instead, first by name.
        other: Option<Other>,
    },
    /// A pattern with wrong syntax.
    #[error("{pattern}: not a valid pattern: {reason}")]
    BadPattern {
        /// As given.
        pattern: String,
        /// The parser's word.
        reason: String,
    },
    /// A list that names nothing.
    #[error("{path}: the list is empty", path = path.display())]
    EmptyList {
        /// The list.
        path: PathBuf,
    },
    /// A list that is not text.
    #[error("{path}: not a text file in UTF-8 (byte {byte})", path = path.display())]
    ListNotText {
        /// The list.
        path: PathBuf,
        /// First byte that is not UTF-8.
        byte: usize,
    },
    /// A line of a list that names no file.
    #[error("{path}, line {line}: {source}", path = path.display())]
    InList {
        /// The list.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong with the line.
        source: Box<InputError>,
    },
}

/// A file of a kind that is not read, but may hold points.
pub type Other = (PathBuf, &'static Kind);

fn but(other: &Option<Other>) -> String {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    other.as_ref().map_or(String::new(), |(path, kind)| format!(", but {}, {kind}", name(path)))
}

/// Takes `path` for the other file, if it comes first.
fn note_other(other: &mut Option<Other>, path: &Path) {
    if let Some(kind) = kinds::of_data(path)
        && other.as_ref().is_none_or(|(first, _)| path < first.as_path())
    {
        *other = Some((path.to_owned(), kind));
    }
}

/// Expands `arguments`. A file given by name is taken whatever its extension; folders (walked, links
/// followed) and patterns give `.las` and `.laz` in any case.
pub fn expand<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Inputs {
    let mut found = Found::default();
    for argument in arguments {
        let path = Path::new(argument.as_ref());
        match path.to_str().and_then(|text| text.strip_prefix('@')) {
            Some(list) if !path.exists() => expand_list(Path::new(list), &mut found),
            _ => expand_one(Path::new(""), path, &mut found),
        }
    }
    let Found { files, mut folders, mut lists, failed } = found;
    for paths in [&mut folders, &mut lists] {
        paths.sort();
        paths.dedup();
    }
    Inputs { files: files.into_values().collect(), folders, lists, failed }
}

/// Whether a folder's entry of this name is opened: `.las` or `.laz` (so `.copc.laz`) in any case.
/// `._*.laz` is what macOS leaves beside a file on foreign disks: not a point cloud.
pub fn is_lidar_name(path: &Path) -> bool {
    let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default();
    let twin = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("._"));
    (extension.eq_ignore_ascii_case("las") || extension.eq_ignore_ascii_case("laz")) && !twin
}

#[derive(Default)]
struct Found {
    /// Canonical path to the path to show.
    files: BTreeMap<PathBuf, PathBuf>,
    folders: Vec<PathBuf>,
    lists: Vec<PathBuf>,
    failed: Vec<InputError>,
}

impl Found {
    fn add(&mut self, path: &Path) {
        match path.canonicalize() {
            Ok(canonical) => {
                let shown = self.files.entry(canonical).or_insert_with(|| path.to_owned());
                // Of several names for one file the same one is shown in whatever order they come.
                if path < shown.as_path() {
                    *shown = path.to_owned();
                }
            }
            Err(source) => self.failed.push(InputError::Unreadable { path: path.to_owned(), source }),
        }
    }
}

/// Whether `name` is no file at all, which is said then.
fn is_no_file(name: &Path, found: &mut Found) -> bool {
    let word = name.to_string_lossy();
    let kind = kinds::of_word(&word);
    found.failed.extend(kind.map(|kind| InputError::NoFile { word: word.into_owned(), kind }));
    kind.is_some()
}

/// `name` as given, relative to `folder` (which is no pattern, whatever letters are in it).
fn expand_one(folder: &Path, name: &Path, found: &mut Found) {
    let path = folder.join(name);
    match path.metadata() {
        Ok(data) if data.is_dir() => walk(&path, found),
        Ok(_) => found.add(&path),
        Err(source) if source.kind() == io::ErrorKind::PermissionDenied => {
            found.failed.push(InputError::Unreadable { path, source });
        }
        Err(_) if is_no_file(name, found) => {}
        Err(_) => match (folder.to_str(), name.to_str()) {
            (Some(folder), Some(name)) if name.contains(['*', '?', '[']) => {
                let pattern = Path::new(&glob::Pattern::escape(folder)).join(name);
                expand_pattern(pattern.to_string_lossy().into_owned(), found);
            }
            _ => found.failed.push(InputError::Missing { path }),
        },
    }
}

fn walk(folder: &Path, found: &mut Found) {
    let (mut empty, mut other) = (true, None);
    found.folders.push(folder.to_owned());
    for entry in walkdir::WalkDir::new(folder).follow_links(true) {
        match entry {
            Ok(entry) => {
                if is_lidar_name(entry.path()) && !entry.file_type().is_dir() {
                    empty = false;
                    found.add(entry.path());
                } else if empty && !entry.file_type().is_dir() {
                    note_other(&mut other, entry.path());
                }
            }
            // A link back to a folder above: what is there has been seen.
            Err(error) if error.loop_ancestor().is_some() => {}
            Err(error) => {
                let path = error.path().unwrap_or(folder).to_owned();
                // A dead link to something else than LiDAR is none of our business.
                let dead_link = path.symlink_metadata().is_ok_and(|data| data.is_symlink());
                if dead_link && !is_lidar_name(&path) {
                    continue;
                }
                empty = false;
                let source = error.into_io_error().unwrap_or_else(|| io::ErrorKind::Other.into());
                found.failed.push(InputError::Unreadable { path, source });
            }
        }
    }
    if empty {
        found.failed.push(InputError::EmptyFolder { path: folder.to_owned(), other });
    }
}

fn expand_pattern(pattern: String, found: &mut Found) {
    let options = glob::MatchOptions { case_sensitive: !cfg!(windows), ..Default::default() };
    let entries = match glob::glob_with(&pattern, options) {
        Ok(entries) => entries,
        Err(error) => {
            let reason = error.to_string();
            return found.failed.push(InputError::BadPattern { pattern, reason });
        }
    };
    let (mut empty, mut other) = (true, None);
    for entry in entries {
        match entry {
            Ok(path) if path.is_dir() => {
                empty = false;
                walk(&path, found);
            }
            Ok(path) if is_lidar_name(&path) => {
                empty = false;
                found.add(&path);
            }
            Ok(path) => note_other(&mut other, &path),
            Err(error) => {
                empty = false;
                let path = error.path().to_owned();
                found.failed.push(InputError::Unreadable { path, source: error.into() });
            }
        }
    }
    if empty {
        found.failed.push(InputError::NoMatch { pattern, other });
    }
}

fn expand_list(list: &Path, found: &mut Found) {
    found.lists.push(list.to_owned());
    let text = match std::fs::read(list) {
        Ok(bytes) => match String::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) => {
                let byte = error.utf8_error().valid_up_to();
                return found.failed.push(InputError::ListNotText { path: list.to_owned(), byte });
            }
        },
        Err(source) => {
            return found.failed.push(InputError::Unreadable { path: list.to_owned(), source });
        }
    };
    let folder = list.parent().unwrap_or(Path::new(""));
    let mut empty = true;
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        empty = false;
        let before = found.failed.len();
        expand_one(folder, Path::new(line), found);
        for failed in found.failed.split_off(before) {
            let (path, line) = (list.to_owned(), index + 1);
            found.failed.push(InputError::InList { path, line, source: Box::new(failed) });
        }
    }
    if empty {
        found.failed.push(InputError::EmptyList { path: list.to_owned() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn tree() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for name in [
            "a.las",
            "B.LAZ",
            "Süd blick/ツ.copc.laz",
            "Süd blick/deep/d.Laz",
            "Süd blick/._d.laz",
            "notes.txt",
            "empty/readme.md",
            "odd [1]/x.las",
        ] {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"x").unwrap();
        }
        root
    }

    fn names(root: &Path, inputs: &Inputs) -> Vec<String> {
        let name = |path: &PathBuf| path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
        inputs.files.iter().map(name).collect()
    }

    #[test]
    fn a_folder_is_walked_in_any_case_and_script() {
        let root = tree();
        let inputs = expand([root.path()]);
        assert!(inputs.failed.is_empty(), "{:?}", inputs.failed);
        assert_eq!(
            names(root.path(), &inputs),
            ["B.LAZ", "Süd blick/deep/d.Laz", "Süd blick/ツ.copc.laz", "a.las", "odd [1]/x.las"]
        );
    }

    #[test]
    fn order_and_repetition_change_nothing() {
        let root = tree();
        let (a, b) = (root.path().join("a.las"), root.path().join("B.LAZ"));
        let twice = root.path().join("empty/../a.las");
        let forth = expand([&a, &b, &twice]);
        let back = expand([&twice, &b, &a]);
        assert_eq!(forth.files, back.files);
        assert_eq!(forth.files, [b, a]);
    }

    #[test]
    fn patterns_fit_where_no_such_path_exists() {
        let root = tree();
        let inputs = expand([root.path().join("*.las"), root.path().join("odd [1]/x.las")]);
        assert_eq!(names(root.path(), &inputs), ["a.las", "odd [1]/x.las"]);
        let none = expand([root.path().join("*.copc")]);
        assert!(matches!(none.failed[..], [InputError::NoMatch { .. }]), "{:?}", none.failed);
        let wrong = expand([root.path().join("a[.las")]);
        assert!(matches!(wrong.failed[..], [InputError::BadPattern { .. }]), "{:?}", wrong.failed);
    }

    #[test]
    fn a_list_is_relative_to_its_folder() {
        let root = tree();
        let list = root.path().join("odd [1]/list.txt");
        fs::write(&list, "\u{feff}# two tiles\r\n../a.las\r\n\r\n  *.las \n../gone.laz\n").unwrap();
        let inputs = expand([format!("@{}", list.display())]);
        let real: Vec<_> = inputs.files.iter().map(|p| p.canonicalize().unwrap()).collect();
        let root = root.path().canonicalize().unwrap();
        assert_eq!(real, [root.join("a.las"), root.join("odd [1]/x.las")]);
        let [failed] = &inputs.failed[..] else { panic!("{:?}", inputs.failed) };
        let text = failed.to_string();
        assert!(text.contains("list.txt, line 5") && text.contains("gone.laz: no such file"), "{text}");
    }

    #[test]
    fn what_cannot_be_used_is_named_and_the_rest_goes_on() {
        let root = tree();
        fs::write(root.path().join("raw.txt"), [b'a', 0xff]).unwrap();
        fs::write(root.path().join("nil.txt"), "# nothing\n").unwrap();
        let at = |name: &str| root.path().join(name).into_os_string();
        let list = |name: &str| OsStr::new(&format!("@{}", root.path().join(name).display())).to_owned();
        let inputs = expand([
            at("gone.las"),
            at("empty"),
            list("raw.txt"),
            list("nil.txt"),
            list("no.txt"),
            at("a.las"),
        ]);
        assert_eq!(names(root.path(), &inputs), ["a.las"]);
        assert!(
            matches!(
                inputs.failed[..],
                [
                    InputError::Missing { .. },
                    InputError::EmptyFolder { .. },
                    InputError::ListNotText { byte: 1, .. },
                    InputError::EmptyList { .. },
                    InputError::Unreadable { .. },
                ]
            ),
            "{:?}",
            inputs.failed
        );
    }

    #[test]
    fn other_kinds_are_named_with_what_to_do() {
        let root = tree();
        fs::create_dir(root.path().join("packed")).unwrap();
        ["b.zip", "a.zip", "readme.txt"].iter().for_each(|name| {
            fs::write(root.path().join("packed").join(name), b"x").unwrap();
        });
        let at = |name: &str| root.path().join(name).into_os_string();
        let words = ["https://a.b/c.laz?x=*", "-", "s3://b/c"].map(OsStr::new).map(OsStr::to_owned);
        let inputs = expand([at("packed"), at("packed/*.zip")].into_iter().chain(words));
        let said: Vec<_> = inputs.failed.iter().map(ToString::to_string).collect();
        assert!(
            said[0].ends_with("no .las or .laz file, but a.zip, a ZIP archive: unpack it first"),
            "{said:?}"
        );
        assert!(
            said[1].ends_with("fits this pattern, but a.zip, a ZIP archive: unpack it first"),
            "{said:?}"
        );
        assert!(said[2].starts_with("https://a.b/c.laz?x=*: a remote file: download it first"), "{said:?}");
        assert!(said[3].starts_with("-: standard input: "), "{said:?}");
        assert!(said[4].starts_with("s3://b/c: a remote file"), "{said:?}");
        assert_eq!(inputs.folders, [root.path().join("packed")]);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_but_not_in_circles() {
        use std::os::unix::fs::symlink;
        let root = tree();
        symlink(root.path(), root.path().join("empty/up")).unwrap();
        symlink(root.path().join("a.las"), root.path().join("same.las")).unwrap();
        symlink("nowhere", root.path().join("dead.laz")).unwrap();
        symlink("nowhere", root.path().join("dead.txt")).unwrap();
        let inputs = expand([root.path()]);
        assert_eq!(inputs.files.len(), 5, "{:?}", inputs.files);
        let [InputError::Unreadable { path, .. }] = &inputs.failed[..] else { panic!("{:?}", inputs.failed) };
        assert!(path.ends_with("dead.laz"));
    }

    #[cfg(unix)]
    #[test]
    fn a_locked_folder_is_named() {
        use std::os::unix::fs::PermissionsExt;
        let root = tree();
        let locked = root.path().join("odd [1]");
        fs::set_permissions(&locked, fs::Permissions::from_mode(0o000)).unwrap();
        let may_anyway = fs::read_dir(&locked).is_ok();
        let inputs = expand([root.path()]);
        fs::set_permissions(&locked, fs::Permissions::from_mode(0o755)).unwrap();
        if may_anyway {
            eprintln!("skipped: this user may read everything");
            return;
        }
        assert_eq!(inputs.files.len(), 4);
        assert!(matches!(&inputs.failed[..], [InputError::Unreadable { path, .. }] if *path == locked));
    }
}
