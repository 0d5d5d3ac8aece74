//! Files that are written whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes `path` by way of a temporary file in the same folder, which takes its place only when `write`
/// has succeeded and all bytes have reached the disk. On an error an older file of that name is untouched.
///
/// Errors: what `write` says; what the system says, or, in plain words, that the folder does not exist or
/// that the path is a folder itself.
pub fn write_whole<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), E> {
    let folder = match path.parent() {
        Some(p) if p.as_os_str().is_empty() => Path::new("."),
        Some(p) => p,
        None => Path::new("/"),
    };
    if path.is_dir() || path.file_name().is_none() {
        return Err(io::Error::other("it is a folder").into());
    }
    if !folder.is_dir() {
        let words = if folder.exists() { "is not a folder" } else { "does not exist" };
        return Err(io::Error::new(io::ErrorKind::NotFound, format!("{} {words}", folder.display())).into());
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lasray-").suffix(".part");
    if let Some(usual) = usual_permissions() {
        builder.permissions(usual);
    }
    let file = builder.tempfile_in(folder)?;
    let mut out = BufWriter::new(file.as_file());
    write(&mut out)?;
    out.flush()?;
    drop(out);
    // A full disk or a lost share may be reported this late.
    file.as_file().sync_all()?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn replaces_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Straße 点.txt");
        let write = |text: &str, fail: bool| {
            write_whole(&path, |out| {
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
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    }

    #[test]
    fn permissions_are_those_of_any_file() {
        let folder = tempfile::tempdir().unwrap();
        let (plain, whole) = (folder.path().join("plain"), folder.path().join("whole"));
        File::create(&plain).unwrap();
        write_whole(&whole, |_| io::Result::Ok(())).unwrap();
        assert_eq!(fs::metadata(plain).unwrap().permissions(), fs::metadata(whole).unwrap().permissions());
    }

    #[test]
    fn says_why_it_cannot() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "x").unwrap();
        let words = |path: &Path| write_whole(path, |_| io::Result::Ok(())).unwrap_err().to_string();
        assert!(words(&folder.path().join("none/a.png")).ends_with("none does not exist"));
        assert!(words(&file.join("a.png")).ends_with("file is not a folder"));
        assert_eq!(words(folder.path()), "it is a folder");
    }
}
