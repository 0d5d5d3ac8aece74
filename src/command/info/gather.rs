//! Gathers the report: opens the files, takes the opening sample, scans them where that is asked for.

use super::args::Args;
use super::classes::ClassCount;
use super::report::{FileReport, InfoReport, Total};
use super::scan::{self, Scan};
use crate::coords::{Bounds, height_step};
use crate::problems::Problems;
use crate::sample::{self, FrameNote, Opened, RgbDepth, Sample, SampleBudget};
use crate::source::crs::{Crs, CrsKind};
use crate::source::inputs::Inputs;
use crate::source::placement::{Placement, PlacementNote};
use crate::text::harmless;

/// What is missing, in whole or in part, goes to `problems`, too.
pub(super) fn gather(args: &Args, found: &Inputs, problems: &mut Problems) -> InfoReport {
    problems.look_at(found);
    let mut failed: Vec<String> = found.failed.iter().map(|error| harmless(&error.to_string())).collect();
    let mut files = Vec::new();
    for opened in sample::open_all(&found.files) {
        match opened {
            Ok(opened) => files.push(opened),
            Err(error) => {
                problems.error(&error);
                failed.push(harmless(&error.to_string()));
            }
        }
    }
    let options = args.placement.options();
    let sample = sample::take(&files, &options, &sample::Asked::default(), &SampleBudget::default());
    let scans = if args.scan { scan::every_file(&files, args.quiet) } else { Vec::new() };
    let mut scans = scans.into_iter();

    let mut reports: Vec<FileReport> = files
        .iter()
        .enumerate()
        .map(|(index, opened)| FileReport { scan: scans.next(), ..of_file(index, opened, &sample) })
        .collect();
    for (index, problem) in &sample.problems {
        // A scan meets it again, and says how many points are lost.
        reports[*index].unreadable = true;
        if reports[*index].scan.is_none() {
            problems.error(problem);
            reports[*index].warnings.push(harmless(&problem.to_string()));
        }
    }
    for note in &sample.world.notes {
        if let (PlacementNote::LeftOut { .. }, Some(file)) = (note, note.file()) {
            problems.error(format!("{}: {note}", reports[file].path));
        }
    }
    for (report, opened) in reports.iter().zip(&files) {
        let damage = report.scan.iter().flat_map(|scan| &scan.damage);
        damage.for_each(|damage| problems.error(damage));
        if report.is_damaged() {
            let (path, warnings) = (&report.path, &opened.file.warnings);
            warnings.iter().for_each(|warning| problems.warn(format!("{path}: {warning}")));
            problems.lost(opened.file.path());
        }
    }
    let all = total(&sample, &reports);
    InfoReport { files: reports, failed, all }
}

fn of_file(index: usize, opened: &Opened, sample: &Sample) -> FileReport {
    let Opened { file, crs, crs_errors, .. } = opened;
    let header = &file.header;
    let bounds = Bounds::new(header.min, header.max).filter(|_| file.points() > 0);
    let density = sample.files[index].bounds.and_then(|bounds| {
        let area = bounds.size().x * bounds.size().y;
        (area > 0.0).then(|| file.points() as f64 / area)
    });
    let rgb = match (sample.files[index].rgb, matches!(header.format, 2 | 3 | 5 | 7 | 8 | 10)) {
        (_, false) => "absent",
        (RgbDepth::None, _) => "none",
        (RgbDepth::Eight, _) => "8 bit",
        (RgbDepth::Sixteen, _) => "16 bit",
    };
    let warnings = file.warnings.iter().map(ToString::to_string);
    FileReport {
        path: harmless(&file.path().to_string_lossy()),
        version: format!("{}.{}", header.version.0, header.version.1),
        kind: match (header.compressed, &file.copc) {
            (_, Some(_)) => "COPC",
            (true, None) => "LAZ",
            (false, None) => "LAS",
        },
        point_format: header.format,
        kept_as: Some(header.stored_format).filter(|&stored| stored != header.format),
        points: file.points(),
        claimed_points: header.claimed_points,
        chunks: file.chunks.len(),
        bounds: bounds.map(Into::into),
        decimals: header.scale.to_array().map(decimals),
        crs: crs.as_ref().map(Into::into),
        density,
        rgb,
        transformed: sample.world.placements[index].as_ref().is_some_and(Placement::is_transformed),
        rgb_constant: sample.files[index].rgb_constant,
        is_sampled: !sample.whole,
        left_out: sample.world.placements[index].is_none() && file.points() > 0,
        unreadable: file.points() < header.claimed_points,
        warnings: warnings
            .chain(crs_errors.iter().map(ToString::to_string))
            .map(|line| harmless(&line))
            .collect(),
        scan: None,
    }
}

fn total(sample: &Sample, reports: &[FileReport]) -> Total {
    let note = |note: &PlacementNote| match note.file() {
        Some(index) => format!("{}: {note}", reports[index].path),
        None => note.to_string(),
    };
    let frame_note = |note: &FrameNote| {
        let words = note.words(sample.world.unit.as_ref());
        note.file().map_or(words.clone(), |index| format!("{}: {words}", reports[index].path))
    };
    let drawn = reports.iter().filter(|report| !report.left_out);
    let (attributes, mut scan) = (&sample.attributes, None);
    for part in drawn.clone().filter_map(|report| report.scan.as_ref()) {
        scan.get_or_insert_with(Scan::default).merge(part);
    }
    if let Some(scan) = &mut scan {
        // Files may differ in how their coordinates come into the world; each has its own bounds.
        let as_is = |placement: &Option<Placement>| placement.as_ref().is_none_or(Placement::is_identity);
        scan.bounds = scan.bounds.filter(|_| sample.world.placements.iter().all(as_is));
        scan.damage.clear();
    }
    let finest = drawn.clone().filter(|report| !report.transformed).map(|report| report.decimals);
    let (classes, classes_counted) = match &scan {
        Some(scan) => (ClassCount::all(&scan.classes), true),
        None => (ClassCount::all(&*sample.classes), sample.counted),
    };
    Total {
        files: drawn.clone().count(),
        points: sample.points,
        bounds: sample.bounds.map(Into::into),
        decimals: match is_degrees(sample.world.crs.as_ref()) {
            true => [2; 3],
            false => finest.reduce(|a, b| [0, 1, 2].map(|i| a[i].max(b[i]))).unwrap_or([2; 3]),
        },
        crs: sample.world.crs.as_ref().map(Into::into),
        unit: sample.world.unit.clone(),
        density: sample.cell.density,
        cell: sample.cell.cell,
        height_step: sample.bounds.and_then(|b| height_step(sample.cell.cell, [b.min.z, b.max.z])),
        coverage: sample.cell.coverage,
        color: sample.color.name(),
        height_p2_p98: [2.0, 98.0].map(|percent| attributes.height.percentile(percent)),
        intensity_p2_p98: [2.0, 98.0].map(|percent| attributes.intensity.percentile(percent)),
        sampled: sample.sampled,
        classes,
        classes_counted,
        notes: sample
            .world
            .notes
            .iter()
            .map(note)
            .chain(sample.notes.iter().map(frame_note))
            .map(|line| harmless(&line))
            .collect(),
        scan,
    }
}

fn is_degrees(crs: Option<&Crs>) -> bool {
    crs.is_some_and(|crs| crs.kind == CrsKind::Geographic)
}

/// Digits behind the point of coordinates in steps of `scale`.
fn decimals(scale: f64) -> usize {
    (-scale.log10()).ceil().clamp(0.0, 9.0) as usize
}

#[cfg(test)]
mod tests {
    use super::super::ranges::Span;
    use super::super::text;
    use super::*;
    use crate::source::inputs;
    use crate::synth::{Format, Tile, Town, write_tile};
    use clap::Parser as _;
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

    #[derive(clap::Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    fn report(words: &[&Path], options: &[&str]) -> InfoReport {
        let words = words.iter().map(|path| path.to_str().unwrap()).chain(options.iter().copied());
        let args = Cli::parse_from(["info", "--quiet"].into_iter().chain(words)).args;
        gather(&args, &inputs::expand(&args.inputs), &mut Problems::default())
    }

    fn town(path: &Path, corner: [f64; 2], points: u64, compress: bool) {
        let tile = Tile { corner, size: [60.0, 60.0], points };
        let format = if compress { Format::Seven } else { Format::Three };
        let stop = AtomicBool::new(false);
        write_tile(&Town::new(1), &tile, path, format, compress, &stop, |_| {}).unwrap();
    }

    #[test]
    fn decimals_follow_the_scale() {
        assert_eq!([1.0, 0.01, 0.001, 0.00025, 1e-7, 10.0].map(decimals), [0, 2, 3, 4, 7, 0]);
    }

    #[test]
    fn a_town_is_described() {
        let folder = tempfile::tempdir().unwrap();
        let (east, west) = (folder.path().join("east.laz"), folder.path().join("west.las"));
        town(&west, [0.0, 0.0], 30_000, false);
        town(&east, [60.0, 0.0], 20_000, true);
        std::fs::write(folder.path().join("bad.las"), "no LAS").unwrap();
        let report = report(&[folder.path(), Path::new("gone.laz")], &["--scan"]);
        assert_eq!(report.failed.len(), 2, "{:?}", report.failed);
        let kinds: Vec<_> =
            report.files.iter().map(|file| (file.kind, file.point_format, file.points)).collect();
        assert_eq!(kinds, [("LAZ", 7, 20_000), ("LAS", 3, 30_000)]);
        let all = &report.all;
        assert_eq!((all.files, all.points, all.color), (2, 50_000, "rgb"));
        let scan = all.scan.as_ref().unwrap();
        assert_eq!(scan.points, 50_000);
        assert_eq!(scan.classes.iter().sum::<u64>(), 50_000);
        let (bounds, frame) = (scan.bounds.unwrap(), all.bounds.unwrap());
        for axis in 0..2 {
            assert!((bounds.min[axis] - frame.min[axis]).abs() < 0.01, "{bounds:?} {frame:?}");
            assert!((bounds.max[axis] - frame.max[axis]).abs() < 0.01, "{bounds:?} {frame:?}");
        }
        assert!((5.0..25.0).contains(&all.density), "{}", all.density);

        let span = |span: Option<Span>| span.map(|span| [span.min, span.max]).unwrap();
        let [lowest, highest] = span(scan.scan_angle);
        assert!(lowest < 0.0 && highest > 0.0 && lowest > -90.0 && highest < 90.0, "{lowest} {highest}");
        let [first, last] = span(scan.gps_time);
        assert!(first > 0.0 && last > first);
        assert_eq!(scan.source_ids.values().sum::<u64>(), 50_000);

        let page = text::page(&report, None);
        let ids: Vec<_> = scan.source_ids.keys().map(u16::to_string).collect();
        for part in
            [format!("source ids   {}", ids.join(", ")), "scan angle   ".into(), "GPS time     ".into()]
        {
            assert!(page.contains(&part), "{part} is not in\n{page}");
        }
        for part in ["all 2 files", "point format 7, LAZ", "points       30,000 in 1 chunk"] {
            assert!(page.contains(part), "{part} is not in\n{page}");
        }
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!(json["files"][1]["points"], 30_000);
        assert_eq!(json["all"]["cell"], all.cell);
        let scanned = &json["all"]["scan"];
        assert!(scanned["classes"][0]["name"].is_string());
        assert_eq!(scanned["source_ids"][0]["id"].as_u64().map(|id| id.to_string()), Some(ids[0].clone()));
        assert_eq!(scanned["gps_time"]["min"], first);
        assert_eq!(scanned["scan_angle"]["max"], highest);
    }

    #[test]
    fn damage_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut.laz");
        town(&path, [0.0, 0.0], 60_000, true);
        // Zeros in the middle of the first chunk's data.
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 3;
        bytes[middle..middle + 4000].fill(0);
        std::fs::write(&path, bytes).unwrap();
        let report = report(&[&path], &["--scan"]);
        let file = &report.files[0];
        assert!(file.scan.as_ref().unwrap().points <= 60_000);
        assert_eq!(file.is_damaged(), file.scan.as_ref().unwrap().points < 60_000);
        assert_eq!(file.scan.as_ref().unwrap().damage.is_empty(), !file.is_damaged());
        assert!(text::page(&report, None).contains("scanned"));
    }
}
