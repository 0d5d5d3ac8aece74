//! The opening sample of real files against the same decisions from every point.

use lasray::attribute::ColorMode;
use lasray::sample::{self, Budget, CellChoice, Opened, Patch, RgbDepth, Sample};
use lasray::source::inputs;
use lasray::source::placement::PlacementOptions;
use lasray::source::{Decoder, LidarFile};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Real files, which are no part of the repository.
fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("LASRAY_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no real files at {} (LASRAY_DATA names another folder)", folder.display());
    None
}

fn open(paths: &[PathBuf]) -> Vec<Opened> {
    sample::open_all(paths).into_iter().filter_map(Result::ok).collect()
}

/// The choice from every shown point of the files that `sample` draws.
fn full_choice(files: &[Opened], sample: &Sample) -> CellChoice {
    let mut patch = Patch { points: Vec::new(), passes: 1.0 };
    let mut known = HashSet::new();
    let mut finest = f64::INFINITY;
    for (Opened { file, .. }, placement) in files.iter().zip(&sample.world.placements) {
        let Some(placement) = placement else { continue };
        let (scale, offset) = (file.header.scale, file.header.offset);
        finest = finest.min(scale.x).min(scale.y);
        every_point(file, |raw, class, flags| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(raw[axis]) * scale[axis] + offset[axis]);
            let point = placement.place(x, y, z);
            if !sample::hidden_by_default(class, flags)
                && known.insert([point.x.to_bits(), point.y.to_bits()])
            {
                patch.points.push([point.x, point.y]);
            }
        });
    }
    sample::choose_cell(&[patch], finest)
}

fn every_point(file: &LidarFile, mut see: impl FnMut([i32; 3], u8, u8)) {
    let mut decoder = Decoder::default();
    for chunk in &file.chunks {
        let _ = decoder.decode(file, chunk, 0..chunk.records, &mut |block| {
            for i in 0..block.len() {
                see([block.x[i], block.y[i], block.z[i]], block.class[i], block.flags[i]);
            }
        });
    }
}

/// Every good file by itself, and every folder of tiles.
fn sets(data: &Path) -> Vec<(String, Vec<PathBuf>)> {
    let files = inputs::expand([data]).files;
    let good = |path: &PathBuf| {
        !path.to_string_lossy().contains("hostile") && !path.to_string_lossy().contains("/odd/")
    };
    let name = |path: &Path| path.strip_prefix(data).unwrap().display().to_string();
    let mut sets: Vec<_> =
        files.iter().filter(|path| good(path)).map(|path| (name(path), vec![path.clone()])).collect();
    for folder in ["urban/multitile_delft", "urban/multitile_ign", "urban/ign_v14", "forest/multitile_bcts"] {
        sets.push((folder.to_owned(), inputs::expand([data.join(folder)]).files));
    }
    sets
}

#[test]
fn the_sampled_cell_size_is_that_of_every_point() {
    let Some(data) = data() else { return };
    let small = Budget { whole: 5_000, places: 1, ..Budget::default() };
    let mut differing = [(0, 0); 2];
    for (name, paths) in sets(&data) {
        let files = open(&paths);
        let points: u64 = files.iter().map(|opened| opened.file.points()).sum();
        if points < 5_000 {
            continue;
        }
        let start = std::time::Instant::now();
        let usual = sample::take(&files, &PlacementOptions::default(), &Budget::default());
        let time = start.elapsed();
        let full = full_choice(&files, &usual);
        let thin = sample::take(&files, &PlacementOptions::default(), &small);
        for (index, (label, sample)) in [("usual", &usual), ("small", &thin)].into_iter().enumerate() {
            if sample.whole {
                assert_eq!(sample.cell, full, "{name}");
                continue;
            }
            let steps = (sample.cell.cell / full.cell).log2();
            differing[index].1 += 1;
            differing[index].0 += i32::from(steps != 0.0);
            println!(
                "{name:60} {label} {points:8} read {:7} cell {:6} of {:6} ({steps:+}) density {:8.3} of {:8.3} coverage {:.3} of {:.3} {:.0?}",
                sample.sampled,
                sample.cell.cell,
                full.cell,
                sample.cell.density,
                full.density,
                sample.cell.coverage,
                full.coverage,
                time
            );
            let most = if index == 0 { 1.0 } else { 2.0 };
            assert!(steps.abs() <= most, "{name} {label}: {:?}, {full:?} from all points", sample.cell);
        }
    }
    let [(usual, of_usual), (small, of_small)] = differing;
    println!("{usual} of {of_usual} differ, with a small budget {small} of {of_small}");
    assert!(usual * 5 <= of_usual && small * 4 <= of_small);
}

fn sample_of(data: &Path, name: &str) -> (Vec<Opened>, Sample) {
    let files = open(&inputs::expand([data.join(name)]).files);
    let sample = sample::take(&files, &PlacementOptions::default(), &Budget::default());
    (files, sample)
}

#[test]
fn colours_of_real_files() {
    let Some(data) = data() else { return };
    use ColorMode::{Class, Height, Rgb};
    use RgbDepth::{Eight, None, Sixteen};
    let cases = [
        ("autzen/autzen_trim.las", Eight, Rgb),
        ("autzen/autzen_test.copc.laz", Sixteen, Rgb),
        ("copc/1.2-with-color.copc.laz", Eight, Rgb),
        ("urban/870000_6618000.subset.50mx100m.las", Sixteen, Rgb),
        ("urban/multitile_ign", None, Class),
        ("urban/ign_v14", None, Class),
        ("urban/multitile_delft", None, Class),
        ("urban/fusa.laz", None, Class),
        ("copc/fusa.copc.laz", None, Class),
        ("powerline/12BZ1_21.laz", Sixteen, Rgb),
        ("rgb/red-rocks-merged.laz", Eight, Rgb),
        ("odd/noise-dirty.las", Eight, Rgb),
        ("forest/Megaplot.laz", None, Height),
        ("ground_truth/CSite4_orig-utm.laz", None, Height),
    ];
    for (name, rgb, color) in cases {
        let (_, sample) = sample_of(&data, name);
        assert!(sample.files.iter().all(|file| file.rgb == rgb), "{name}: {:?}", sample.files);
        assert_eq!(ColorMode::auto(&sample.attributes), color, "{name}");
        assert!(sample.problems.is_empty(), "{name}: {:?}", sample.problems);
    }
}

#[test]
fn frames_of_real_files() {
    let Some(data) = data() else { return };
    for (name, paths) in sets(&data) {
        let files = open(&paths);
        let sample = sample::take(&files, &PlacementOptions::default(), &Budget::default());
        let Some(bounds) = sample.bounds else { continue };
        let (mut inside, mut shown) = (0, 0);
        for (Opened { file, .. }, placement) in files.iter().zip(&sample.world.placements) {
            let (scale, offset) = (file.header.scale, file.header.offset);
            every_point(file, |raw, class, flags| {
                let [x, y, z] = [0, 1, 2].map(|axis| f64::from(raw[axis]) * scale[axis] + offset[axis]);
                let point = placement.as_ref().unwrap().place(x, y, z);
                if !sample::hidden_by_default(class, flags) {
                    shown += 1;
                    // Header bounds are rounded in their last digit.
                    let near = scale.max_element();
                    inside += u64::from(
                        point.cmpge(bounds.min - near).all() && point.cmple(bounds.max + near).all(),
                    );
                }
            });
        }
        assert!(
            inside as f64 >= 0.9999 * f64::from(shown as u32),
            "{name}: {inside} of {shown} in {bounds:?}"
        );
    }
    let (_, good) = sample_of(&data, "hostile/base_ok_1.2.las");
    // A record at the ends of i32; a header without bounds. The real extent is 28 x 18 x 8.
    for name in ["hostile/outlier_xyz.las", "hostile/bounds_nan.las"] {
        let (_, sample) = sample_of(&data, name);
        let size = sample.bounds.unwrap().size();
        assert!(size.x < 29.0 && size.y < 19.0 && size.z < 9.0, "{name}: {size}");
        assert_eq!(sample.cell.cell, good.cell.cell, "{name}");
    }
}

/// Percentiles 2 and 98 of the sample, as percentiles of every point.
#[test]
fn percentiles_of_real_files() {
    let Some(data) = data() else { return };
    for name in [
        "urban/fusa.laz",
        "copc/fusa.copc.laz",
        "powerline/12BZ1_21.laz",
        "urban/multitile_delft",
        "urban/multitile_ign",
        "forest/multitile_bcts",
    ] {
        let (files, sample) = sample_of(&data, name);
        assert!(!sample.whole, "{name} is no sample");
        let mut heights = Vec::new();
        for Opened { file, .. } in &files {
            every_point(file, |raw, class, flags| {
                if !sample::hidden_by_default(class, flags) {
                    heights.push(f64::from(raw[2]) * file.header.scale.z + file.header.offset.z);
                }
            });
        }
        heights.sort_unstable_by(f64::total_cmp);
        let rank =
            |value: f64| heights.partition_point(|&height| height < value) as f64 / heights.len() as f64;
        let (low, high) = (rank(sample.attributes.height.p2), rank(sample.attributes.height.p98));
        println!("{name}: percentiles 2 and 98 of the sample are {:.1} and {:.1}", 100.0 * low, 100.0 * high);
        assert!(low < 0.07 && (0.94..0.999).contains(&high), "{name}: {low} {high}");
    }
}

#[test]
fn the_order_of_the_inputs_changes_nothing() {
    let Some(data) = data() else { return };
    let folder = |name: &str| data.join("forest/multitile_bcts").join(name);
    let forth = inputs::expand([folder("bcts_1.laz"), folder("bcts_2.laz")]).files;
    let back =
        inputs::expand([folder("bcts_2.laz"), folder("bcts_1.laz"), folder("../multitile_bcts")]).files;
    let real = |paths: &[PathBuf]| paths.iter().map(|p| p.canonicalize().unwrap()).collect::<Vec<_>>();
    assert_eq!(real(&forth), real(&back));
    let take = |files: &[PathBuf]| {
        let sample = sample::take(&open(files), &PlacementOptions::default(), &Budget::default());
        format!("{:?}", sample)
    };
    assert_eq!(take(&forth), take(&forth));
    assert_eq!(take(&forth), take(&back));
}
