//! Files that are written: whole or not at all, and never over a point cloud or another file that the command reads.
//! Everything that the program leaves behind for its user goes through here, but for the point clouds of
//! [`crate::synth`], which have a rule of their own.

use crate::source::inputs::Inputs;
use crate::source::kinds;
use std::collections::HashSet;
use std::ffi::OsString;
use std::fs::{File, Metadata};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Who wrote a file: pictures, figures and synthetic point clouds carry it.
pub const SOFTWARE: &str = concat!("lasray ", env!("CARGO_PKG_VERSION"));

/// Figures that say who wrote them, so that they may be written over.
#[derive(Debug, serde::Serialize)]
pub struct Signed<T> {
    software: &'static str,
    #[serde(flatten)]
    figures: T,
}

impl<T> Signed<T> {
    /// Signs `figures`.
    pub fn new(figures: T) -> Signed<T> {
        Signed { software: SOFTWARE, figures }
    }
}

/// How far into a file it is looked for what it is: text chunks and attributes stand before the pixels.
const HEAD_BYTES: u64 = 1 << 16;

/// Why a file is not written over, or not written at all.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// Its name is that of a point cloud, or of what belongs to one.
    #[error("refused: .{0} is for point clouds, which only `lasray synth` writes: give another name")]
    Name(String),
    /// Its bytes are those of a point cloud.
    #[error("refused: the file there is a point cloud (it begins with LASF): give another name")]
    PointCloud,
    /// Its bytes are those of another kind of file that points are, or may be, in.
    #[error("refused: the file there is {0}, which points may be in: give another name")]
    Data(&'static str),
    /// It is read by the same command.
    #[error("refused: it is an input of this command{}: give another name", also_called(.0))]
    Input(Option<PathBuf>),
    /// It lies among the inputs, and its maker is unknown.
    #[error(
        "refused: the file there lies in the input folder {} and is not of lasray's making: give another name, \
         or move it away",
        .0.display()
    )]
    Foreign(PathBuf),
    /// Nobody typed the name, and what is there has another maker.
    #[error(
        "refused: the file there is not of lasray's making: name the picture (-o FILE), or move the file away"
    )]
    NotOurs,
    /// A side file that does not belong to the picture.
    #[error("left as it is: the file there was not written with this picture")]
    NotOfPicture,
    /// A device, a pipe.
    #[error("refused: it is no regular file; where the result is text, `-` stands for standard output")]
    Special,
    /// It cannot be seen what is there.
    #[error("refused: the file there cannot be read, so it may be a point cloud: {0}")]
    Unreadable(io::Error),
    /// Something is there where nothing may be.
    #[error("refused: there is a file of that name")]
    Taken,
}

fn also_called(input: &Option<PathBuf>) -> String {
    input.as_ref().map_or(String::new(), |input| format!(" ({})", input.display()))
}

impl From<Refusal> for io::Error {
    fn from(refusal: Refusal) -> io::Error {
        io::Error::other(refusal)
    }
}

/// A file that cannot be written, and why.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written: {reason}", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// The system's word, or [`Refusal`]'s.
    pub reason: io::Error,
}

/// What a command reads, and so must not write over. Without anything: point clouds alone are kept safe.
#[derive(Clone, Debug, Default)]
pub struct Protected {
    files: Files,
    /// Canonical, and as they are to be shown.
    folders: Vec<(PathBuf, PathBuf)>,
    /// Names that nobody typed.
    made_up: HashSet<PathBuf>,
}

impl Protected {
    /// What INPUT arguments came to: files, lists, and what lies in folders.
    pub fn of(inputs: &Inputs) -> Protected {
        let mut protected = Protected::default();
        inputs.files.iter().chain(&inputs.lists).for_each(|path| protected.add(path));
        for folder in &inputs.folders {
            // What cannot be found cannot be written to.
            protected.folders.extend(folder.canonicalize().ok().map(|whole| (whole, folder.clone())));
        }
        protected
    }

    /// Another file that is read.
    pub fn add(&mut self, path: &Path) {
        self.files.add(path);
    }

    /// A name that nobody typed: there, only what this program wrote is replaced.
    pub fn add_made_up(&mut self, target: &Path) {
        self.made_up.insert(target.to_owned());
    }

    /// Whether `target` may be written, as things are now.
    pub fn check(&self, target: &Path) -> Result<(), Refusal> {
        let extension = target.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if ["las", "laz", "lax"].contains(&extension.as_str()) {
            return Err(Refusal::Name(extension));
        }
        // Links are followed. Where nothing is, or no folder, writing succeeds or says what is wrong; what cannot be looked
        // at may be anything.
        let there = match target.metadata() {
            Ok(there) => there,
            Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
                return Ok(());
            }
            Err(error) => return Err(Refusal::Unreadable(error)),
        };
        if there.is_dir() {
            return Ok(());
        }
        if !there.is_file() {
            return Err(Refusal::Special);
        }
        if let Some(input) = self.files.find(target, &there) {
            return Err(Refusal::Input((input != target).then(|| input.to_owned())));
        }
        let head = head(target).map_err(Refusal::Unreadable)?;
        if head.starts_with(b"LASF") {
            return Err(Refusal::PointCloud);
        }
        if let Some(kind) = kinds::of_data_within(&head) {
            return Err(Refusal::Data(kind.what()));
        }
        if self.made_up.contains(target) && !is_ours(&head) {
            return Err(Refusal::NotOurs);
        }
        if !is_ours(&head)
            && let Ok(whole) = target.canonicalize()
            && let Some((_, shown)) = self.folders.iter().find(|(folder, _)| whole.starts_with(folder))
        {
            return Err(Refusal::Foreign(shown.clone()));
        }
        Ok(())
    }

    /// What is wrong with the targets of a command, each with its option: `many`, and a `few`. Some may not be
    /// written, or two options name one file.
    pub fn check_all(
        &self,
        many: impl IntoIterator<Item = (&'static str, PathBuf)>,
        few: &[(&'static str, PathBuf)],
    ) -> Result<(), String> {
        let (mut first, mut more) = (None, 0u64);
        let names: Vec<_> = few.iter().map(|(option, path)| (*option, one_name(path))).collect();
        let last = |path: &Path| path.file_name().unwrap_or_default().to_ascii_lowercase();
        for (at, (option, path)) in few.iter().cloned().chain(many).enumerate() {
            // Each with those before it; of the many, no two are alike.
            let alike = names.iter().take(at).filter(|(_, name)| last(name) == last(&path));
            let same =
                alike.map(|(other, name)| (*other, *name == one_name(&path))).find(|(_, is_same)| *is_same);
            let wrong = match (self.check(&path), same) {
                (Err(refusal), _) => refusal.to_string(),
                (Ok(()), Some((other, _))) => {
                    format!("refused: {other} names the same file: give another name")
                }
                (Ok(()), None) => continue,
            };
            match first {
                None => first = Some(format!("{option} {}: {wrong}", path.display())),
                Some(_) => more += 1,
            }
        }
        match (first, more) {
            (None, _) => Ok(()),
            (Some(first), 0) => Err(first),
            (Some(first), more) => Err(format!("{first} (and {more} more)")),
        }
    }
}

/// The same for two paths that come to one name.
pub fn one_name(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let whole = match (folder.canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    };
    // Most file systems of these take them for one.
    if cfg!(any(windows, target_os = "macos")) {
        PathBuf::from(whole.to_string_lossy().to_lowercase())
    } else {
        whole
    }
}

/// Files by what they are, whatever they are called: links and other spellings come to the same.
#[cfg(unix)]
#[derive(Clone, Debug, Default)]
struct Files(std::collections::HashMap<(u64, u64), PathBuf>);

#[cfg(unix)]
impl Files {
    fn id(metadata: &Metadata) -> (u64, u64) {
        use std::os::unix::fs::MetadataExt;
        (metadata.dev(), metadata.ino())
    }

    fn add(&mut self, path: &Path) {
        if let Ok(metadata) = path.metadata() {
            self.0.entry(Files::id(&metadata)).or_insert_with(|| path.to_owned());
        }
    }

    fn find(&self, _: &Path, metadata: &Metadata) -> Option<&Path> {
        self.0.get(&Files::id(metadata)).map(PathBuf::as_path)
    }
}

/// The same where only open files tell which they are: those of one length are compared.
#[cfg(not(unix))]
#[derive(Clone, Debug, Default)]
struct Files(std::collections::HashMap<u64, Vec<PathBuf>>);

#[cfg(not(unix))]
impl Files {
    fn add(&mut self, path: &Path) {
        if let Ok(metadata) = path.metadata() {
            self.0.entry(metadata.len()).or_default().push(path.to_owned());
        }
    }

    fn find(&self, target: &Path, metadata: &Metadata) -> Option<&Path> {
        let same = |input: &&PathBuf| same_file::is_same_file(input, target).unwrap_or(*input == target);
        self.0.get(&metadata.len())?.iter().find(same).map(PathBuf::as_path)
    }
}

/// The first bytes of a file.
pub fn head(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(HEAD_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Whether `bytes` hold `mark`.
pub fn holds(bytes: &[u8], mark: &[u8]) -> bool {
    bytes.windows(mark.len()).any(|window| window == mark)
}

/// Whether a file that begins with `head` was written by this program, or holds nothing that could be lost.
pub fn is_ours(head: &[u8]) -> bool {
    let is_void = [&b""[..], b"[]"].contains(&head.trim_ascii()) && (head.len() as u64) < HEAD_BYTES;
    let is_png = head.starts_with(b"\x89PNG\r\n\x1a\n") && holds(head, b"Software\0lasray ");
    let is_exr = head.starts_with(b"\x76\x2f\x31\x01")
        && holds(head, b"software\0string\0")
        && holds(head, b"lasray ");
    let is_jpeg = head.starts_with(b"\xff\xd8\xff") && holds(head, b"Exif\0\0") && holds(head, b"\0lasray ");
    let is_svg = head.starts_with(b"<svg") && holds(head, b"<!-- lasray ");
    let is_json = holds(head, b"\"software\": \"lasray ") || holds(head, b"\"software\":\"lasray ");
    is_void || is_png || is_jpeg || is_exr || is_svg || is_json
}

/// A file to be written, and what may be there.
#[derive(Clone, Copy, Debug)]
pub struct Output<'a> {
    path: &'a Path,
    over: Over<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Over<'a> {
    Nothing,
    Others(&'a Protected),
}

impl<'a> Output<'a> {
    /// Where nothing is: what may have come there is left alone.
    pub fn fresh(path: &'a Path) -> Output<'a> {
        Output { path, over: Over::Nothing }
    }

    /// In the place of what is there, unless that is protected.
    pub fn over(path: &'a Path, protected: &'a Protected) -> Output<'a> {
        Output { path, over: Over::Others(protected) }
    }

    /// The file.
    pub fn path(&self) -> &'a Path {
        self.path
    }

    /// Writes it, whole or not at all.
    ///
    /// Errors: what `write` says; [`Refusal`], as things are when all is written; what the system says, or, in plain
    /// words, that the folder does not exist or that the path is a folder itself.
    pub fn write<E: From<io::Error>>(
        &self,
        write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
    ) -> Result<(), E> {
        match self.over {
            Over::Nothing => write_whole(self.path, is_free, write),
            Over::Others(protected) => write_whole(self.path, |path| protected.check(path), write),
        }
    }
}

fn is_free(path: &Path) -> Result<(), Refusal> {
    if path.symlink_metadata().is_ok() { Err(Refusal::Taken) } else { Ok(()) }
}

/// Writes `path` by way of a temporary file in the same folder, which takes its place only when `write`
/// has succeeded, all bytes have reached the disk, and `may` allows it. On an error what is there is untouched.
pub(crate) fn write_whole<E: From<io::Error>>(
    path: &Path,
    may: impl Fn(&Path) -> Result<(), Refusal>,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), E> {
    place_of(path)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lasray-").suffix(".part");
    if let Some(usual) = usual_permissions() {
        builder.permissions(usual);
    }
    let file = builder.tempfile_in(folder_of(path))?;
    let mut out = BufWriter::new(file.as_file());
    write(&mut out)?;
    out.flush()?;
    drop(out);
    // A full disk or a lost share may be reported this late.
    file.as_file().sync_all()?;
    may(path).map_err(io::Error::from)?;
    let nothing_is_there = path.symlink_metadata().is_err_and(|e| e.kind() == io::ErrorKind::NotFound);
    if nothing_is_there {
        // What comes there at the last moment is not replaced, where the file system can tell.
        match file.persist_noclobber(path) {
            Ok(_) => return Ok(()),
            Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => {
                return Err(io::Error::from(Refusal::Taken).into());
            }
            Err(error) => error.file.persist(path).map_err(|e| e.error)?,
        };
        return Ok(());
    }
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if p.as_os_str().is_empty() => Path::new("."),
        Some(p) => p,
        None => Path::new("/"),
    }
}

/// Whether a file can lie there.
fn place_of(path: &Path) -> io::Result<()> {
    if path.is_dir() || path.file_name().is_none() {
        return Err(io::Error::other("it is a folder"));
    }
    let folder = folder_of(path);
    if folder.is_dir() {
        return Ok(());
    }
    let words = if folder.exists() { "is not a folder" } else { "does not exist" };
    Err(io::Error::new(io::ErrorKind::NotFound, format!("{} {words}", folder.display())))
}

/// Those of any new file (the umask takes its part off); a temporary one would be its owner's alone.
#[cfg(unix)]
fn usual_permissions() -> Option<std::fs::Permissions> {
    use std::os::unix::fs::PermissionsExt;
    Some(PermissionsExt::from_mode(0o666))
}

/// New files inherit what their folder grants.
#[cfg(not(unix))]
fn usual_permissions() -> Option<std::fs::Permissions> {
    None
}

/// Where a text goes, as an option names it: a file, or `-`, standard output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// Standard output.
    Stdout,
    /// A file.
    File(PathBuf),
}

impl From<OsString> for Target {
    fn from(word: OsString) -> Target {
        if word == "-" { Target::Stdout } else { Target::File(word.into()) }
    }
}

impl Target {
    /// The file, if it is one.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Target::Stdout => None,
            Target::File(path) => Some(path),
        }
    }

    /// Whether a file can lie there, found out before the work.
    pub fn check_place(&self) -> Result<(), WriteError> {
        let Target::File(path) = self else { return Ok(()) };
        place_of(path).map_err(|reason| WriteError { path: path.clone(), reason })
    }

    /// Writes `text`, to a file whole or not at all. Whoever reads standard output may have enough before its end.
    pub fn write(&self, text: &str, protected: &Protected) -> Result<(), WriteError> {
        match self {
            Target::Stdout => {
                print(text).map_err(|reason| WriteError { path: "standard output".into(), reason })
            }
            Target::File(path) => Output::over(path, protected)
                .write(|out| out.write_all(text.as_bytes()))
                .map_err(|reason| WriteError { path: path.clone(), reason }),
        }
    }
}

/// To standard output; `lasray info … | head` is no failure.
pub fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn replaces_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Straße 点.txt");
        let nothing = Protected::default();
        let write = |text: &str, fail: bool| {
            Output::over(&path, &nothing).write(|out| {
                out.write_all(text.as_bytes())?;
                if fail { Err(io::Error::other("broken off")) } else { Ok(()) }
            })
        };
        assert!(write("first", true).is_err());
        assert!(!path.exists());
        write("second", false).unwrap();
        assert!(write("third", true).is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "second");
        write("4", false).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "4");
        let fresh = Output::fresh(&path).write(|out| out.write_all(b"5"));
        assert!(fresh.unwrap_err().to_string().contains("there is a file of that name"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "4");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    }

    #[test]
    fn what_is_written_here_is_known_again() {
        #[derive(serde::Serialize)]
        struct Figure {
            ms: f64,
        }
        let signed = || Signed::new(Figure { ms: 1.5 });
        let pretty = serde_json::to_string_pretty(&[signed()]).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&pretty).unwrap()[0]["ms"], 1.5);
        for ours in [pretty, serde_json::to_string(&signed()).unwrap(), "[]\n".to_owned(), String::new()] {
            assert!(is_ours(ours.as_bytes()), "{ours}");
        }
        assert!(!is_ours(b"{\"software\": \"other 1.0\"}") && !is_ours(b"\x89PNG\r\n\x1a\n"));
        assert!(!is_ours(&[b' '; HEAD_BYTES as usize]));
    }

    #[test]
    fn permissions_are_those_of_any_file() {
        let folder = tempfile::tempdir().unwrap();
        let (plain, whole) = (folder.path().join("plain"), folder.path().join("whole"));
        File::create(&plain).unwrap();
        Output::fresh(&whole).write(|_| io::Result::Ok(())).unwrap();
        assert_eq!(fs::metadata(plain).unwrap().permissions(), fs::metadata(whole).unwrap().permissions());
    }

    #[test]
    fn says_why_it_cannot() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "x").unwrap();
        let words = |path: &Path| Output::fresh(path).write(|_| io::Result::Ok(())).unwrap_err().to_string();
        assert!(words(&folder.path().join("none/a.png")).ends_with("none does not exist"));
        assert!(words(&file.join("a.png")).ends_with("file is not a folder"));
        assert_eq!(words(folder.path()), "it is a folder");
    }

    /// What came there while the result was made is found when it is put in place.
    #[test]
    fn what_appears_in_between_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let nothing = Protected::default();
        assert!(nothing.check(&path).is_ok());
        let written = Output::over(&path, &nothing).write(|out| {
            fs::write(&path, b"LASF and points")?;
            out.write_all(b"picture")
        });
        assert!(written.unwrap_err().to_string().contains("is a point cloud"));
        assert_eq!(fs::read(&path).unwrap(), b"LASF and points");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    }

    #[test]
    fn inputs_are_known_by_any_name() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::create_dir_all(at("in/sub")).unwrap();
        for name in ["in/points.las", "in/notes.json", "in/sub/foreign.png", "cloud", "list.txt", "out.json"]
        {
            fs::write(at(name), name).unwrap();
        }
        fs::write(at("in/ours.json"), "{\n  \"software\": \"lasray 0.0.1\"\n}").unwrap();
        fs::write(at("list.txt"), "cloud\n").unwrap();
        let list = format!("@{}", at("list.txt").display());
        let found = crate::source::inputs::expand([at("in").into_os_string(), list.into()]);
        let protected = Protected::of(&found);
        let why = |path: &Path| protected.check(path).err().map(|refusal| refusal.to_string());
        let says = |path: &Path, word: &str| {
            let why = why(path).unwrap_or_default();
            assert!(why.contains(word), "{}: {why}", path.display());
        };
        assert_eq!(why(&at("new.json")), None);
        assert_eq!(why(&at("out.json")), None);
        assert_eq!(why(&at("in/new.json")), None);
        assert_eq!(why(&at("in/ours.json")), None);
        says(&at("new.LAS"), ".las is for point clouds");
        says(&at("new.lax"), ".lax is for point clouds");
        says(&at("cloud"), "an input of this command:");
        says(&at("in/../cloud"), "an input of this command (");
        says(&at("list.txt"), "an input of this command");
        says(&at("in/notes.json"), "lies in the input folder");
        says(&at("in/sub/foreign.png"), "lies in the input folder");
        fs::hard_link(at("cloud"), at("hard.png")).unwrap();
        says(&at("hard.png"), "an input of this command (");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("cloud"), at("soft.png")).unwrap();
            says(&at("soft.png"), "an input of this command (");
            says(Path::new("/dev/null"), "no regular file");
        }
        let [picture, json] = [("-o", at("a.png")), ("--json", at("in/../a.png"))];
        let twice = protected.check_all([picture.clone()], &[json]).unwrap_err();
        assert!(twice.starts_with("-o ") && twice.contains("--json names the same file"), "{twice}");
        assert!(protected.check_all([picture.clone()], &[("--json", at("b.png"))]).is_ok());
        let many = protected.check_all([picture, ("-o", at("cloud")), ("-o", at("a.las"))], &[]).unwrap_err();
        assert!(many.contains("cloud: refused: ") && many.ends_with("(and 1 more)"), "{many}");
    }
}
