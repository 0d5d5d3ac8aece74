//! The report as a page of text.

use super::classes::ClassCount;
use super::numbers::{fixed, number, significant};
use super::ranges::{Box3, Range, Span};
use super::report::{CrsReport, FileReport, InfoReport, Total};
use super::scan::Scan;
use super::table::{table, wrapped};
use crate::source::crs::{CrsKind, Unit};
use crate::text::rounded;
use std::fmt::Write;

/// More files than this stand in a table, one a line.
const BLOCKS: usize = 3;
/// Width of the names on the left.
const NAMES: usize = 11;

/// The whole page, in lines of at most `width` columns where that is given.
pub fn page(report: &InfoReport, width: Option<usize>) -> String {
    let (files, all) = (&report.files, &report.all);
    let mut page = Page { text: String::new(), width };
    if files.len() > BLOCKS {
        page.text = table(files, width);
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
            page.block(&file.path, &rows);
        }
    }
    if let [_] = files[..] {
        let notes: Vec<Row> = all.notes.iter().map(|note| row("note", note.clone())).collect();
        page.rows(&notes);
    } else if !files.is_empty() {
        let title = match all.files == files.len() {
            true => format!("all {}", count(all.files, "file")),
            false => format!("{} of {}", number(all.files as u64), count(files.len(), "file")),
        };
        page.text.push('\n');
        page.block(&title, &total_rows(all));
    }
    page.text
}

struct Page {
    text: String,
    width: Option<usize>,
}

impl Page {
    /// Names on the left, values on the right.
    fn block(&mut self, title: &str, content: &[Row]) {
        let _ = writeln!(self.text, "{title}");
        self.rows(content);
    }

    fn rows(&mut self, content: &[Row]) {
        for (name, value) in content {
            let first = format!("  {name:NAMES$}  ");
            let indent = " ".repeat(first.len());
            let _ = writeln!(self.text, "{}", wrapped(value.trim_end(), &first, &indent, self.width));
        }
    }
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
    rows.push(row("colour", colour(file)));
    rows
}

/// What the RGB fields hold; a scan knows better than the sample.
fn colour(file: &FileReport) -> String {
    let everywhere =
        if file.is_sampled && file.scan.is_none() { "in all points of a sample" } else { "everywhere" };
    let one = |[r, g, b]: [u16; 3]| format!("{r}, {g}, {b} {everywhere}");
    let scanned = file.scan.as_ref().and_then(|scan| scan.rgb);
    let constant = match (file.rgb, scanned) {
        ("absent", _) => return "none in this point format".into(),
        ("none", Some(ranges)) if ranges.iter().any(|range| range.max > 0) => {
            return "none but in few points, which a sample has not met".into();
        }
        ("none", _) => return format!("none: RGB is {}", one([0; 3])),
        (_, Some(ranges)) => {
            ranges.iter().all(|range| range.min == range.max).then(|| ranges.map(|range| range.min))
        }
        (_, None) => file.rgb_constant,
    };
    let constant = constant.map_or(String::new(), |rgb| format!(", {}", one(rgb)));
    format!("{}{constant}", file.rgb)
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
    let mut rows = vec![
        row("density", format!("{} points per {square}{seen}", significant(all.density))),
        row(
            "cell size",
            format!(
                "{} {unit}, {}{:.0} % of the cells hold a point",
                all.cell,
                if seen.is_empty() { "" } else { "about " },
                100.0 * all.coverage
            ),
        ),
        row(
            "height step",
            all.height_step
                .map_or("none: heights are too far from 0".into(), |step| format!("{step} {unit}")),
        ),
        row("coloured by", all.color.into()),
    ];
    if all.scan.is_none() {
        rows.extend(class_rows(&all.classes, all.points, (!all.classes_counted).then_some(all.sampled)));
    }
    rows
}

/// Classes with their points, of `all`; `sampled`: they are estimates from so many.
fn class_rows(classes: &[ClassCount], all: u64, sampled: Option<u64>) -> Vec<Row> {
    let about = if sampled.is_some() { "~" } else { "" };
    let points = |class: &ClassCount| {
        let points = if sampled.is_some() { rounded(class.points) } else { class.points };
        format!("{about}{}", number(points))
    };
    let width = classes.iter().map(|class| points(class).len()).max().unwrap_or_default();
    let mut lines: Vec<String> = Vec::new();
    lines.extend(sampled.map(|sampled| {
        format!("estimates, from {} points; rare ones may be missing: --scan counts", number(sampled))
    }));
    lines.extend(classes.iter().map(|class| {
        let share = 100.0 * class.points as f64 / all.max(1) as f64;
        format!("{:>3} {:>width$} {share:>5.1} %  {}", class.class, points(class), class.name)
    }));
    lines.into_iter().enumerate().map(|(at, line)| row(if at == 0 { "classes" } else { "" }, line)).collect()
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
        rows.push(row("source ids", ids(&scan.source_ids.keys().copied().collect::<Vec<_>>())));
        if let Some(Span { min, max }) = scan.scan_angle {
            rows.push(row("scan angle", format!("{} to {}°", fixed(min, 2), fixed(max, 2))));
        }
        if let Some(Span { min, max }) = scan.gps_time {
            rows.push(row("GPS time", format!("{} to {} s", fixed(min, 6), fixed(max, 6))));
        }
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
    rows.extend(class_rows(&ClassCount::all(&scan.classes), scan.points, None));
    rows.extend(scan.damage.iter().map(|damage| row("damage", damage.clone())));
    rows
}

/// Ids that are few each, of many the ends.
fn ids(ids: &[u16]) -> String {
    const FEW: usize = 12;
    match ids {
        [] => "none".to_owned(),
        [first, .., last] if ids.len() > FEW => {
            format!("{} from {first} to {last}", number(ids.len() as u64))
        }
        few => few.iter().map(u16::to_string).collect::<Vec<_>>().join(", "),
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
