//! The report as a page of text.

use super::ranges::{Box3, Range};
use super::report::{CrsReport, FileReport, InfoReport, Total};
use super::scan::Scan;
use crate::attribute::class_name;
use crate::source::crs::{CrsKind, Unit};
use std::fmt::Write;

/// More files than this stand in a table, one a line.
const BLOCKS: usize = 3;
/// Width of the names on the left.
const NAMES: usize = 11;

/// The whole page.
pub fn page(report: &InfoReport) -> String {
    let (mut page, files, all) = (String::new(), &report.files, &report.all);
    if files.len() > BLOCKS {
        table(&mut page, files);
    } else {
        for file in files {
            let mut rows = file_rows(file);
            match files.len() {
                1 => rows.extend(drawing_rows(all)),
                _ => rows.extend(file.density.map(|density| {
                    row(
                        "density",
                        format!("{} points per {}", significant(density), square(all.unit.as_ref())),
                    )
                })),
            }
            rows.extend(file.left_out.then(|| row("drawn", "no".into())));
            rows.extend(file.transformed.then(|| row("drawn", "transformed into the system of all".into())));
            rows.extend(file.warnings.iter().map(|warning| row("warning", warning.clone())));
            if let Some(scan) = &file.scan {
                rows.extend(scan_rows(scan, file.decimals, units(file.crs.as_ref())));
            }
            block(&mut page, &file.path, &rows);
        }
    }
    if let [_] = files[..] {
        let notes: Vec<Row> = all.notes.iter().map(|note| row("note", note.clone())).collect();
        rows(&mut page, &notes);
    } else if !files.is_empty() {
        let title = match all.files == files.len() {
            true => format!("all {}", count(all.files, "file")),
            false => format!("{} of {}", number(all.files as u64), count(files.len(), "file")),
        };
        page.push('\n');
        block(&mut page, &title, &total_rows(all));
    }
    page
}

type Row = (&'static str, String);

fn row(name: &'static str, value: String) -> Row {
    (name, value)
}

fn file_rows(file: &FileReport) -> Vec<Row> {
    let compressed = if file.kind == "LAS" { String::new() } else { format!(", {}", file.kind) };
    let kept_as = file
        .kept_as
        .map_or(String::new(), |format| format!(", kept as {format} (LASzip's compatibility mode)"));
    let mut rows = vec![
        row(
            "format",
            format!("LAS {}, point format {}{kept_as}{compressed}", file.version, file.point_format),
        ),
        row("points", format!("{} in {}", number(file.points), count(file.chunks, "chunk"))),
    ];
    match file.bounds {
        Some(bounds) => rows.extend(bounds_rows(&bounds, file.decimals, units(file.crs.as_ref()))),
        None => rows.push(row("bounds", "none in the header".into())),
    }
    rows.push(row("system", system(file.crs.as_ref())));
    let colour = match file.rgb {
        "absent" => "none in this point format",
        "none" => "none: RGB is 0, 0, 0 everywhere",
        depth => depth,
    };
    let everywhere =
        file.rgb_constant.map_or(String::new(), |[r, g, b]| format!(", {r}, {g}, {b} everywhere"));
    rows.push(row("colour", format!("{colour}{everywhere}")));
    rows
}

fn total_rows(all: &Total) -> Vec<Row> {
    let unit = all.unit.as_ref().map_or("", Unit::symbol);
    let mut rows = vec![row("points", number(all.points))];
    if let Some(bounds) = all.bounds {
        rows.extend(bounds_rows(&bounds, all.decimals, [unit; 3]));
    }
    rows.push(row("system", system(all.crs.as_ref())));
    rows.extend(drawing_rows(all));
    rows.extend(all.notes.iter().map(|note| row("note", note.clone())));
    rows.extend(all.scan.as_ref().map(|scan| scan_rows(scan, all.decimals, [unit; 3])).into_iter().flatten());
    rows
}

/// What the opening sample decides.
fn drawing_rows(all: &Total) -> Vec<Row> {
    if all.points == 0 {
        return Vec::new();
    }
    let unit = all.unit.as_ref().map_or("units", Unit::symbol);
    let square = square(all.unit.as_ref());
    let seen = if all.sampled >= all.points {
        String::new()
    } else {
        format!(", from {} points", number(all.sampled))
    };
    vec![
        row("density", format!("{} points per {square}{seen}", significant(all.density))),
        row(
            "cell size",
            format!("{} {unit}, {:.0} % of the cells hold a point", all.cell, 100.0 * all.coverage),
        ),
        row(
            "height step",
            all.height_step
                .map_or("none: heights are too far from 0".into(), |step| format!("{step} {unit}")),
        ),
        row("coloured by", all.color.into()),
    ]
}

fn bounds_rows(bounds: &Box3, decimals: [usize; 3], units: [&str; 3]) -> Vec<Row> {
    let column = |corner: &[f64; 3]| -> Vec<String> {
        (0..3).map(|axis| fixed(corner[axis], decimals[axis])).collect()
    };
    let size: [f64; 3] = std::array::from_fn(|axis| bounds.max[axis] - bounds.min[axis]);
    let columns = [column(&bounds.min), column(&bounds.max), column(&size)];
    let width =
        columns.each_ref().map(|column| column.iter().map(|text| text.len()).max().unwrap_or_default());
    let line = |axis: usize| {
        format!(
            "{} {:>w0$} to {:>w1$}  = {:>w2$} {}",
            ["E", "N", "U"][axis],
            columns[0][axis],
            columns[1][axis],
            columns[2][axis],
            units[axis],
            w0 = width[0],
            w1 = width[1],
            w2 = width[2],
        )
    };
    vec![row("bounds", line(0)), row("", line(1)), row("", line(2))]
}

fn scan_rows(scan: &Scan, decimals: [usize; 3], units: [&str; 3]) -> Vec<Row> {
    let mut rows = vec![row("scanned", format!("{} points", number(scan.points)))];
    if let Some(bounds) = &scan.bounds {
        let mut bounds = bounds_rows(bounds, decimals, units);
        bounds[0].0 = "true bounds";
        rows.extend(bounds);
    }
    if scan.points > 0 {
        let range = |range: Range| format!("{} to {}", number(range.min.into()), number(range.max.into()));
        rows.push(row("intensity", range(scan.intensity)));
        rows.push(row(
            "return",
            format!("{} of {}", range(scan.return_number), range(scan.number_of_returns)),
        ));
        if let Some([red, green, blue]) = scan.rgb {
            rows.push(row("RGB", format!("R {}, G {}, B {}", range(red), range(green), range(blue))));
        }
        let flags = [
            ("synthetic", scan.synthetic),
            ("key-point", scan.key_point),
            ("withheld", scan.withheld),
            ("overlap", scan.overlap),
        ];
        let set = flags.iter().filter(|(_, count)| *count > 0);
        let set: Vec<String> = set.map(|(name, count)| format!("{} {name}", number(*count))).collect();
        rows.push(row("flags", if set.is_empty() { "none set".into() } else { set.join(", ") }));
    }
    let width = scan.seen_classes().map(|(_, count)| number(count).len()).max().unwrap_or_default();
    for (index, (class, count)) in scan.seen_classes().enumerate() {
        let share = 100.0 * count as f64 / scan.points as f64;
        let line = format!("{class:>3} {:>width$} {share:>5.1} %  {}", number(count), class_name(class));
        rows.push(row(if index == 0 { "classes" } else { "" }, line));
    }
    rows.extend(scan.damage.iter().map(|damage| row("damage", damage.clone())));
    rows
}

/// Names on the left, values on the right.
fn block(page: &mut String, title: &str, content: &[Row]) {
    let _ = writeln!(page, "{title}");
    rows(page, content);
}

fn rows(page: &mut String, content: &[Row]) {
    for (name, value) in content {
        let _ = writeln!(page, "  {name:NAMES$}  {}", value.trim_end());
    }
}

/// One line a file; what differs from file to file.
fn table(page: &mut String, files: &[FileReport]) {
    const HEAD: [&str; 11] =
        ["LAS", "format", "", "points", "density", "E from", "to", "N from", "to", "U from", "to"];
    let cells = |file: &FileReport| -> [String; 11] {
        let at = |corner: fn(&Box3) -> &[f64; 3], axis: usize| {
            file.bounds
                .as_ref()
                .map_or("-".into(), |bounds| fixed(corner(bounds)[axis], file.decimals[axis].min(3)))
        };
        [
            file.version.clone(),
            match file.kept_as {
                Some(format) => format!("{} in {format}", file.point_format),
                None => file.point_format.to_string(),
            },
            file.kind.into(),
            number(file.points),
            file.density.map_or("-".into(), significant),
            at(|b| &b.min, 0),
            at(|b| &b.max, 0),
            at(|b| &b.min, 1),
            at(|b| &b.max, 1),
            at(|b| &b.min, 2),
            at(|b| &b.max, 2),
        ]
    };
    let rows: Vec<[String; 11]> = files.iter().map(cells).collect();
    let widths: [usize; 11] = std::array::from_fn(|column| {
        rows.iter().map(|row| row[column].len()).max().unwrap_or_default().max(HEAD[column].len())
    });
    let mut line = |cells: &[&str; 11], end: &str| {
        for (cell, width) in cells.iter().zip(widths) {
            let _ = write!(page, "{cell:>width$}  ");
        }
        let _ = writeln!(page, "{end}");
    };
    line(&HEAD, "file");
    for (row, file) in rows.iter().zip(files) {
        line(&row.each_ref().map(String::as_str), &file.path);
        for (is_so, what) in [(file.left_out, "  left out"), (file.transformed, "  transformed")] {
            if is_so {
                line(&[""; 11], what);
            }
        }
        let damage = file.scan.iter().flat_map(|scan| &scan.damage);
        for warning in file.warnings.iter().chain(damage) {
            line(&[""; 11], &format!("  {warning}"));
        }
    }
}

fn system(crs: Option<&CrsReport>) -> String {
    let Some(crs) = crs else { return "not named".into() };
    let code = crs.epsg.map_or(String::new(), |code| format!(" (EPSG:{code})"));
    let kind = match crs.kind {
        CrsKind::Projected => "",
        CrsKind::Geographic => ", geographic",
        CrsKind::Geocentric => ", geocentric",
        CrsKind::Unknown => ", of unknown kind",
    };
    let heights = match &crs.vertical_unit {
        Some(unit) if *unit != crs.unit => format!(", heights in {}", unit.name),
        _ => String::new(),
    };
    format!("{}{code}{kind}, in {}{heights}", crs.name, crs.unit.name)
}

/// Units of a file's E, N, U; empty where nothing names them.
fn units(crs: Option<&CrsReport>) -> [&str; 3] {
    let Some(crs) = crs else { return [""; 3] };
    let up = match (&crs.vertical_unit, crs.kind) {
        (Some(unit), _) => unit.symbol(),
        (None, CrsKind::Geographic) => "",
        (None, _) => crs.unit.symbol(),
    };
    [crs.unit.symbol(), crs.unit.symbol(), up]
}

/// m², or words where nothing names the unit.
fn square(unit: Option<&Unit>) -> String {
    unit.map_or("square unit".into(), |unit| format!("{}²", unit.symbol()))
}

fn count(things: usize, name: &str) -> String {
    format!("{} {name}{}", number(things as u64), if things == 1 { "" } else { "s" })
}

/// 1234567 → 1,234,567.
fn number(value: u64) -> String {
    group(&value.to_string())
}

fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let (sign, text) = text.strip_prefix('-').map_or(("", text.as_str()), |rest| ("-", rest));
    match text.split_once('.') {
        Some((whole, part)) => format!("{sign}{}.{part}", group(whole)),
        None => format!("{sign}{}", group(text)),
    }
}

fn group(digits: &str) -> String {
    let mut grouped = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

/// Three digits that count.
fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0".into();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    fixed(value, decimals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(number(0), "0");
        assert_eq!(number(999), "999");
        assert_eq!(number(1_234_567), "1,234,567");
        assert_eq!(fixed(-1234.5, 2), "-1,234.50");
        assert_eq!(fixed(6_122_250.0, 0), "6,122,250");
        assert_eq!(
            [0.0, 0.001_234, 4.444, 16.28, 1234.5].map(significant),
            ["0", "0.00123", "4.44", "16.3", "1,234"]
        );
    }
}
