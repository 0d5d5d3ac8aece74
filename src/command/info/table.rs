//! Many files as a table, no wider than there is room for.

use super::numbers::{fixed, number, significant};
use super::report::FileReport;
use crate::source::crs::CrsKind;
use std::collections::HashSet;
use std::fmt::Write;
use std::path::{Component, Path, PathBuf};
use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

/// A column before the file's name.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    Format,
    Points,
    Density,
    From(usize),
    To(usize),
}

use Column::{Density, Format, From, Points, To};

/// What is shown, from much to little room: columns, and whether coordinates have their decimals.
const LAYOUTS: [(&[Column], bool); 6] = [
    (&[Format, Points, Density, From(0), To(0), From(1), To(1), From(2), To(2)], true),
    (&[Format, Points, Density, From(0), To(0), From(1), To(1), From(2), To(2)], false),
    (&[Format, Points, From(0), To(0), From(1), To(1), From(2), To(2)], false),
    (&[Format, Points, From(0), From(1), From(2), To(2)], false),
    (&[Format, Points, From(0), From(1)], false),
    (&[Points], false),
];
/// A name that is cut shorter says too little.
const LEAST_NAME: usize = 20;
const GAP: &str = "  ";

impl Column {
    fn head(self) -> &'static str {
        match self {
            Format => "format",
            Points => "points",
            Density => "density",
            From(axis) => ["E from", "N from", "U from"][axis],
            To(_) => "to",
        }
    }

    fn cell(self, file: &FileReport, exact: bool) -> String {
        let coordinate = |axis: usize, is_low: bool| {
            let is_angle = axis < 2 && file.crs.as_ref().is_some_and(|crs| crs.kind == CrsKind::Geographic);
            // A thousandth of a degree is a hundred metres.
            let most = if exact || is_angle { 3 } else { 0 };
            file.bounds.as_ref().map_or("-".into(), |bounds| {
                let corner = if is_low { &bounds.min } else { &bounds.max };
                fixed(corner[axis], file.decimals[axis].min(most))
            })
        };
        match self {
            Format => {
                let kept = file.kept_as.map_or(String::new(), |format| format!(" in {format}"));
                format!("{} {} {}{kept}", file.kind, file.version, file.point_format)
            }
            Points => number(file.points),
            Density => file.density.map_or("-".into(), significant),
            From(axis) => coordinate(axis, true),
            To(axis) => coordinate(axis, false),
        }
    }
}

/// Cells of the columns before the name, and how wide each column is.
struct Layout {
    columns: &'static [Column],
    cells: Vec<Vec<String>>,
    widths: Vec<usize>,
}

impl Layout {
    fn of(files: &[FileReport], (columns, exact): (&'static [Column], bool)) -> Layout {
        let cells: Vec<Vec<String>> = files
            .iter()
            .map(|file| columns.iter().map(|column| column.cell(file, exact)).collect())
            .collect();
        let width = |(at, column): (usize, &Column)| {
            let widest = cells.iter().map(|row| row[at].width()).max().unwrap_or_default();
            widest.max(column.head().width())
        };
        let widths = columns.iter().enumerate().map(width).collect();
        Layout { columns, cells, widths }
    }

    /// Columns of the terminal up to the name.
    fn width(&self) -> usize {
        self.widths.iter().map(|width| width + GAP.len()).sum()
    }
}

/// One line a file, what differs from file to file; in at most `width` columns where that is given.
pub(super) fn table(files: &[FileReport], width: Option<usize>) -> String {
    let paths: Vec<&Path> = files.iter().map(|file| Path::new(&file.path)).collect();
    // Where there is little room, a folder that all lie in is said once.
    let folder = width.map_or(PathBuf::new(), |_| common_folder(&paths));
    let names: Vec<String> = paths
        .iter()
        .map(|path| path.strip_prefix(&folder).unwrap_or(path).to_string_lossy().into_owned())
        .collect();
    let longest = names.iter().map(|name| name.width()).max().unwrap_or_default();
    let room = |layout: &Layout| width.map(|all| all.saturating_sub(layout.width()));
    let shown =
        |layout: &Layout, name: &str| room(layout).map_or(name.to_owned(), |room| shortened(name, room));
    let fits = |layout: &Layout| room(layout).is_none_or(|room| room >= longest.min(LEAST_NAME));
    // Names that look alike when they are shortened are worth a column.
    let tells = |layout: &Layout| {
        let count = |names: &mut dyn Iterator<Item = String>| names.collect::<HashSet<_>>().len();
        count(&mut names.iter().map(|name| shown(layout, name))) == count(&mut names.iter().cloned())
    };
    let mut layouts: Vec<Layout> = LAYOUTS.into_iter().map(|layout| Layout::of(files, layout)).collect();
    let telling = layouts.iter().position(|layout| fits(layout) && tells(layout));
    let chosen = telling.or_else(|| layouts.iter().position(fits)).unwrap_or(LAYOUTS.len() - 1);
    let layout = layouts.swap_remove(chosen);

    let line = |cells: &mut dyn Iterator<Item = &str>, name: &str| -> String {
        let padded =
            |(cell, width): (&str, &usize)| format!("{}{cell}{GAP}", " ".repeat(width - cell.width()));
        cells.zip(&layout.widths).map(padded).collect::<String>() + &shown(&layout, name) + "\n"
    };
    let mut table = String::new();
    if !folder.as_os_str().is_empty() {
        let _ = writeln!(table, "{}", wrapped(&folder.to_string_lossy(), "in ", "   ", width));
    }
    table += &line(&mut layout.columns.iter().map(|column| column.head()), "file");
    for ((file, cells), name) in files.iter().zip(&layout.cells).zip(&names) {
        table += &line(&mut cells.iter().map(String::as_str), name);
        let said = [(file.left_out, "left out"), (file.transformed, "transformed into the system of all")];
        let said = said.into_iter().filter(|(is_so, _)| *is_so).map(|(_, what)| what);
        let damage = file.scan.iter().flat_map(|scan| &scan.damage).map(String::as_str);
        for what in said.chain(file.warnings.iter().map(String::as_str)).chain(damage) {
            let _ = writeln!(table, "{}", wrapped(what, "    ", "      ", width));
        }
    }
    table
}

/// The folder that all of `paths` lie in.
fn common_folder(paths: &[&Path]) -> PathBuf {
    let folders = || paths.iter().map(|path| path.parent().unwrap_or(Path::new("")).components());
    let Some(first) = folders().next() else { return PathBuf::new() };
    let alike =
        |&(at, component): &(usize, Component)| folders().all(|mut folder| folder.nth(at) == Some(component));
    first.enumerate().take_while(alike).map(|(_, component)| component).collect()
}

/// `text` with what is in the middle left out, so that it takes at most `room` columns. More is kept of its end.
fn shortened(text: &str, room: usize) -> String {
    if text.width() <= room {
        return text.to_owned();
    }
    let kept = room.saturating_sub(1);
    let head_room = kept / 3;
    let (mut head, mut tail) = (String::new(), Vec::new());
    let mut used = 0;
    for letter in text.chars() {
        used += letter.width().unwrap_or(0);
        if used > head_room {
            break;
        }
        head.push(letter);
    }
    let mut left = kept - head.width();
    for letter in text.chars().rev() {
        let Some(rest) = left.checked_sub(letter.width().unwrap_or(0)) else { break };
        left = rest;
        tail.push(letter);
    }
    format!("{head}…{}", tail.iter().rev().collect::<String>())
}

/// `text` behind `first`, further lines behind `next`.
pub(super) fn wrapped(text: &str, first: &str, next: &str, width: Option<usize>) -> String {
    let Some(width) = width else { return format!("{first}{text}") };
    // A terminal that is too narrow for anything breaks lines itself.
    let options =
        textwrap::Options::new(width.max(next.width() + 10)).initial_indent(first).subsequent_indent(next);
    textwrap::fill(text, options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lose_their_middle() {
        assert_eq!(shortened("tile.laz", 8), "tile.laz");
        assert_eq!(shortened("test_data_77050_627755_LA93.laz", 16), "test_…5_LA93.laz");
        for room in 1..40 {
            for name in
                ["test_data_77050_627755_LA93.laz", "航空测量/点群データ_東京_2026.laz", "Höhe/ñ.copc.laz"]
            {
                let short = shortened(name, room);
                assert!(short.width() <= room, "{room}: {short}");
                assert!(room < 12 || short.ends_with(".laz"), "{room}: {short}");
                assert!(short == name || short.contains('…'));
            }
        }
    }

    #[test]
    fn folders_of_all_are_found() {
        let folder = |paths: &[&str]| common_folder(&paths.iter().map(Path::new).collect::<Vec<_>>());
        assert_eq!(folder(&["/a/b/c.laz", "/a/b/d/e.laz"]), Path::new("/a/b"));
        assert_eq!(folder(&["a.laz", "b/c.laz"]), Path::new(""));
        assert_eq!(folder(&["b/c.laz", "bc/d.laz"]), Path::new(""));
        assert_eq!(folder(&["./x/c.laz", "./x/d.laz"]), Path::new("./x"));
        assert_eq!(folder(&[]), Path::new(""));
    }
}
