//! Kinds of files that are not read, and what can be done about them: one table, by content and by name.

use std::fmt;
use std::path::Path;

impl Kind {
    /// What it is, with its article.
    pub fn what(&self) -> &'static str {
        self.what
    }
}

/// A kind of file that is not read.
#[derive(Debug)]
pub struct Kind {
    /// With its article.
    what: &'static str,
    /// What the user can do.
    advice: &'static str,
    /// Bytes, and where they stand: one of these tells the kind.
    marks: &'static [(usize, &'static [u8])],
    /// Endings of names, in lower case: where no mark tells.
    endings: &'static [&'static str],
    /// Points are, or may be, in it: worth a word where a folder holds nothing else.
    is_data: bool,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.what, self.advice)
    }
}

const UNPACK: &str = "unpack it first";
const CONVERT: &str = "convert it to LAS or LAZ first, for instance with PDAL or CloudCompare";
const TEXT: &str = "convert it to LAS or LAZ first, for instance with PDAL or CloudCompare; a list of files takes an @ \
                    before its name";
const EXPORT: &str = "export it as LAS or LAZ with the program that made it";
const NO_POINTS: &str = "it holds no points; give the .las or .laz files that it was made of";

const fn kind(
    what: &'static str,
    advice: &'static str,
    marks: &'static [(usize, &'static [u8])],
    endings: &'static [&'static str],
) -> Kind {
    Kind { what, advice, marks, endings, is_data: true }
}

const fn no_data(
    what: &'static str,
    advice: &'static str,
    marks: &'static [(usize, &'static [u8])],
    endings: &'static [&'static str],
) -> Kind {
    Kind { what, advice, marks, endings, is_data: false }
}

/// Content is asked before names, both from the top down.
static KINDS: &[Kind] = &[
    kind("a ZIP archive", UNPACK, &[(0, b"PK\x03\x04"), (0, b"PK\x05\x06")], &[".zip"]),
    kind("a gzip archive", UNPACK, &[(0, b"\x1f\x8b")], &[".gz", ".tgz"]),
    kind("a 7z archive", UNPACK, &[(0, b"7z\xbc\xaf\x27\x1c")], &[".7z"]),
    kind("a tar archive", UNPACK, &[(257, b"ustar")], &[".tar"]),
    kind("a bzip2 archive", UNPACK, &[(0, b"BZh")], &[".bz2"]),
    kind("an xz archive", UNPACK, &[(0, b"\xfd7zXZ\0")], &[".xz"]),
    kind("a Zstandard archive", UNPACK, &[(0, b"\x28\xb5\x2f\xfd")], &[".zst"]),
    kind("a RAR archive", UNPACK, &[(0, b"Rar!\x1a\x07")], &[".rar"]),
    kind("an E57 file", CONVERT, &[(0, b"ASTM-E57")], &[".e57"]),
    kind("a PLY file", CONVERT, &[(0, b"ply\n"), (0, b"ply\r")], &[".ply"]),
    kind("a PCD file", CONVERT, &[(0, b"# .PCD")], &[".pcd"]),
    kind("an Esri zLAS file", "convert it to LAS first, with Esri's EzLAS", &[], &[".zlas"]),
    kind("a ReCap file", EXPORT, &[], &[".rcp", ".rcs"]),
    kind("a scanner's own file", EXPORT, &[], &[".fls", ".lsproj", ".rdbx", ".rxp", ".zfs"]),
    kind(
        "an Entwine point tile set (EPT)",
        "give its folder ept-data, where the tiles are .laz, or convert it to LAZ with PDAL",
        &[],
        &["ept.json", ".ept"],
    ),
    no_data(
        "a Git LFS pointer",
        "the file itself is still to be fetched: git lfs pull",
        &[(0, b"version https://git-lfs")],
        &[],
    ),
    no_data(
        "a web page",
        "the download ended at a page instead of the file: download it again",
        &[(0, b"<!DOCTYPE html"), (0, b"<!doctype html"), (0, b"<html"), (0, b"<HTML")],
        &[".html", ".htm"],
    ),
    no_data(
        "an XML file",
        "where it was downloaded, it may be the server's error message: look into it",
        &[(0, b"<?xml")],
        &[],
    ),
    no_data("a picture (PNG)", NO_POINTS, &[(0, b"\x89PNG\r\n\x1a\n")], &[".png"]),
    no_data("a picture (JPEG)", NO_POINTS, &[(0, b"\xff\xd8\xff")], &[".jpg", ".jpeg"]),
    no_data(
        "a raster (TIFF)",
        NO_POINTS,
        &[(0, b"II\x2a\0"), (0, b"MM\0\x2a"), (0, b"II\x2b\0"), (0, b"MM\0\x2b")],
        &[".tif", ".tiff"],
    ),
    no_data("a raster (ASCII grid)", NO_POINTS, &[(0, b"ncols"), (0, b"NCOLS")], &[".asc"]),
    no_data("a raster", NO_POINTS, &[], &[".img", ".vrt", ".jp2"]),
    no_data("a GeoPackage", NO_POINTS, &[(0, b"SQLite format 3\0")], &[".gpkg"]),
    no_data("a shapefile", NO_POINTS, &[(0, b"\0\0\x27\x0a")], &[".shp"]),
    no_data("a spatial index", "give the .las or .laz file that it belongs to", &[(0, b"LASX")], &[".lax"]),
    kind("a mesh (OBJ)", CONVERT, &[], &[".obj"]),
    // Such names may as well be anything else.
    no_data("a text file", TEXT, &[], &[".xyz", ".txt", ".csv", ".pts", ".ptx"]),
];

static REMOTE: Kind = no_data(
    "a remote file",
    "download it first: remote files are not read yet, COPC no more than others",
    &[],
    &[],
);
static LOCAL_URL: Kind = no_data("a URL of a local file", "give its path, without file://", &[], &[]);
static STDIN: Kind = no_data(
    "standard input",
    "give the name of a file: points are read in any order, which no pipe allows",
    &[],
    &[],
);

/// What a file that begins with `head` is, and is called `path`; `None`: unknown.
pub fn of_file(head: &[u8], path: &Path) -> Option<&'static Kind> {
    let has = |(at, mark): &(usize, &[u8])| head.get(*at..).is_some_and(|rest| rest.starts_with(mark));
    KINDS.iter().find(|kind| kind.marks.iter().any(has)).or_else(|| of_name(path))
}

/// What a file of that name is.
pub fn of_name(path: &Path) -> Option<&'static Kind> {
    let name = path.file_name()?.to_string_lossy().to_lowercase();
    KINDS.iter().find(|kind| kind.endings.iter().any(|ending| name.ends_with(ending)))
}

/// The same, of those that points are in.
pub fn of_data(path: &Path) -> Option<&'static Kind> {
    of_name(path).filter(|kind| kind.is_data)
}

/// Of those that points are in, what a file that begins with `head` is by its content.
pub fn of_data_within(head: &[u8]) -> Option<&'static Kind> {
    let has = |(at, mark): &(usize, &[u8])| head.get(*at..).is_some_and(|rest| rest.starts_with(mark));
    KINDS.iter().find(|kind| kind.is_data && kind.marks.iter().any(has))
}

/// What is no file at all: a URL, standard input.
pub fn of_word(word: &str) -> Option<&'static Kind> {
    let scheme = word.split_once("://").map(|(scheme, _)| scheme);
    let letter = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    match scheme {
        _ if word == "-" => Some(&STDIN),
        // GDAL's spelling.
        _ if ["/vsicurl/", "/vsis3/", "/vsigs/", "/vsiaz/"].iter().any(|v| word.starts_with(v)) => {
            Some(&REMOTE)
        }
        Some(scheme) if scheme.eq_ignore_ascii_case("file") => Some(&LOCAL_URL),
        Some(scheme) if scheme.len() > 1 && scheme.chars().all(letter) => Some(&REMOTE),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_tells_before_names() {
        let of = |head: &[u8], name: &str| of_file(head, Path::new(name)).map(ToString::to_string);
        let says = |head: &[u8], name: &str, words: &str| {
            let said = of(head, name).unwrap_or_default();
            assert!(said.contains(words), "{name}: {said}");
        };
        says(b"PK\x03\x04rest", "tile.laz", "a ZIP archive: unpack it first");
        says(b"\x1f\x8b\x08", "tile.las", "a gzip archive: unpack");
        says(&[&[0; 257][..], b"ustar\0"].concat(), "x", "a tar archive");
        says(b"ply\nformat ascii", "x.txt", "a PLY file: convert it to LAS or LAZ first");
        says(b"ASTM-E57", "x", "an E57 file");
        says(b"1 2 3\n", "X.XYZ", "a text file: convert");
        says(b"{}", "data/EPT.json", "Entwine");
        says(b"II\x2a\0", "x", "a raster (TIFF): it holds no points");
        says(b"ncols 5", "dgm.txt", "a raster (ASCII grid)");
        says(b"<!DOCTYPE html>", "tile.laz", "download it again");
        assert_eq!(of(b"Once upon", "tile.las"), None);
        assert_eq!(of(b"", "tile.laz"), None);
    }

    #[test]
    fn words_that_are_no_files() {
        for remote in ["https://a.b/c.copc.laz", "s3://bucket/key.laz", "HTTP://x/?a=*", "/vsicurl/http://a"]
        {
            assert!(
                of_word(remote).is_some_and(|kind| kind.to_string().contains("download it first")),
                "{remote}"
            );
        }
        assert!(of_word("-").is_some() && of_word("file:///a.las").is_some());
        for path in ["C:/tiles", "a.laz", "://x", "tiles/", "c://tiles/a.las", "-.las"] {
            assert!(of_word(path).is_none(), "{path}");
        }
    }

    #[test]
    fn every_kind_says_what_to_do() {
        for kind in KINDS.iter().chain([&REMOTE, &LOCAL_URL, &STDIN]) {
            assert!(!kind.advice.is_empty() && kind.what.starts_with(['a', 's']), "{kind}");
            assert!(kind.endings.iter().all(|ending| *ending == ending.to_lowercase()), "{kind}");
        }
    }
}
