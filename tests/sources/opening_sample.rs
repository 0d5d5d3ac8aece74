//! The opening sample of real files against the same decisions from every point.

use crate::made::{Made, Packing};
use crate::scene::real_files as data;
use lasray::attribute::{ClassMask, ColorMode, Flags};
use lasray::sample::{self, Asked, CellChoice, GroundPatch, Opened, RgbDepth, Sample, SampleBudget};
use lasray::source::inputs;
use lasray::source::placement::PlacementOptions;

use lasray::source::{Decoder, LidarFile, Returns, Selection};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

fn open(paths: &[PathBuf]) -> Vec<Opened> {
    sample::open_all(paths).into_iter().filter_map(Result::ok).collect()
}

/// The choice from every shown point of the files that `sample` draws.
fn full_choice(files: &[Opened], sample: &Sample) -> CellChoice {
    let mut patch = GroundPatch { points: Vec::new(), passes: 1.0 };
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
        !["/hostile/", "/odd/", "/reports/"].iter().any(|folder| path.to_string_lossy().contains(folder))
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
    let small = SampleBudget { whole: 5_000, places: 1, ..SampleBudget::default() };
    let mut differing = [(0, 0); 2];
    for (name, paths) in sets(&data) {
        let files = open(&paths);
        let points: u64 = files.iter().map(|opened| opened.file.points()).sum();
        if points < 5_000 {
            continue;
        }
        let start = std::time::Instant::now();
        let usual =
            sample::take(&files, &PlacementOptions::default(), &Asked::default(), &SampleBudget::default());
        let time = start.elapsed();
        let full = full_choice(&files, &usual);
        let thin = sample::take(&files, &PlacementOptions::default(), &Asked::default(), &small);
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
    let sample =
        sample::take(&files, &PlacementOptions::default(), &Asked::default(), &SampleBudget::default());
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
        assert_eq!(sample.color, color, "{name}");
        assert!(sample.problems.is_empty(), "{name}: {:?}", sample.problems);
    }
}

#[test]
fn frames_of_real_files() {
    let Some(data) = data() else { return };
    for (name, paths) in sets(&data) {
        let files = open(&paths);
        let sample =
            sample::take(&files, &PlacementOptions::default(), &Asked::default(), &SampleBudget::default());
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
        let (low, high) =
            (rank(sample.attributes.height.percentile(2.0)), rank(sample.attributes.height.percentile(98.0)));
        println!("{name}: percentiles 2 and 98 of the sample are {:.1} and {:.1}", 100.0 * low, 100.0 * high);
        assert!(low < 0.07 && (0.94..0.999).contains(&high), "{name}: {low} {high}");
    }
}

/// What may be asked for beside everything.
fn asked() -> Vec<Asked> {
    let classes = |list: &[u8]| Asked { classes: ClassMask::only(list), ..Asked::default() };
    let points = |selection| Asked { selection, ..Asked::default() };
    let heights = |text: &str| Selection { heights: text.parse().unwrap(), ..Selection::default() };
    vec![
        classes(&[3, 4, 5]),
        classes(&[14]),
        Asked { hidden_flags: Flags::NONE, ..Asked::default() },
        points(heights("50..60")),
        points(heights("-1..3")),
        points(heights("0.999..1.001")),
        points(Selection { returns: Returns::First, ..heights("-1..3") }),
        points(Selection { source_ids: "7".parse().unwrap(), ..Selection::default() }),
    ]
}

#[test]
fn cells_and_codes_are_the_same_whatever_is_asked_for() {
    let Some(data) = data() else { return };
    let sets = ["urban/fusa.laz", "copc/fusa.copc.laz"];
    // Read whole; in parts with nothing asked for; in parts.
    let budgets = [250_000, 2_000].map(|whole| SampleBudget { whole, ..SampleBudget::default() });
    let budgets = budgets.into_iter().chain([SampleBudget {
        whole: 2_000,
        whole_of_classes: 2_000,
        ..SampleBudget::default()
    }]);
    let cells: Vec<f64> = sets
        .iter()
        .flat_map(|set| budgets.clone().map(move |budget| (set, budget)))
        .map(|(set, budget)| {
            let files = open(&inputs::expand([data.join(set)]).files);
            let take = |asked: &Asked| sample::take(&files, &PlacementOptions::default(), asked, &budget);
            let all = take(&Asked::default());
            for asked in asked() {
                let some = take(&asked);
                let what = format!("{set} {budget:?} {asked:?}");
                assert_eq!(some.cell, all.cell, "{what}");
                assert_eq!(some.attributes.scales, all.attributes.scales, "{what}");
                assert_eq!(some.color, all.color, "{what}");
            }
            all.cell.cell
        })
        .collect();
    assert_eq!(cells, [0.5; 6]);
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
        let sample = sample::take(
            &open(files),
            &PlacementOptions::default(),
            &Asked::default(),
            &SampleBudget::default(),
        );
        format!("{:?}", sample)
    };
    assert_eq!(take(&forth), take(&forth));
    assert_eq!(take(&forth), take(&back));
}

/// Records of format 1 at these raw X, Y, Z; a file with the header fields `scale` and `offset`.
fn points(raw: &[[i32; 3]], packing: Packing, scale: [f64; 3], offset: [f64; 3]) -> Made {
    let mut made = Made::new(1, packing, raw.len());
    for (record, raw) in made.records.chunks_mut(28).zip(raw) {
        record[..12].copy_from_slice(&raw.map(i32::to_le_bytes).concat());
        record[14..16].copy_from_slice(&[0x09, 2]);
    }
    made.header = Some((scale, offset));
    made
}

fn sample_made(files: &[Made], budget: &SampleBudget) -> Sample {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (0..files.len()).map(|k| folder.path().join(format!("{k}.laz"))).collect();
    for (path, made) in paths.iter().zip(files) {
        std::fs::write(path, made.bytes()).unwrap();
    }
    let files = open(&paths);
    assert_eq!(files.len(), paths.len());
    sample::take(&files, &PlacementOptions::default(), &Asked::default(), budget)
}

const CENTIMETRES: [f64; 3] = [0.01; 3];

/// Raw points every metre over a square with this south-west corner, in metres.
fn square(side: i32, corner: [i32; 2]) -> Vec<[i32; 3]> {
    let at = |k: i32| [(corner[0] + k % side) * 100, (corner[1] + k / side) * 100, 1000 + k % 50];
    (0..side * side).map(at).collect()
}

/// One point of these among so many others.
fn strewn(mut among: Vec<[i32; 3]>, every: usize, point: [i32; 3]) -> Vec<[i32; 3]> {
    among.iter_mut().step_by(every).for_each(|p| *p = point);
    among
}

#[test]
fn points_without_a_position_are_not_framed() {
    let budgets = [SampleBudget::default(), SampleBudget { whole: 1_000, ..SampleBudget::default() }];
    for (budget, every) in budgets.iter().flat_map(|budget| [3, 20, 2_000].map(|every| (budget, every))) {
        for packing in [Packing::Fixed(50_000), Packing::Fixed(500)] {
            let town = strewn(square(120, [2000, 24_000]), every, [0; 3]);
            let sample = sample_made(&[points(&town, packing, CENTIMETRES, [0.0; 3])], budget);
            let bounds = sample.bounds.unwrap();
            assert!(bounds.min.x >= 2000.0 && bounds.size().x < 120.0, "{every}: {bounds:?}");
            assert!(bounds.min.y >= 24_000.0 && bounds.min.z >= 10.0, "{every}: {bounds:?}");
            // A third of the cells are holes.
            assert_eq!(sample.cell.cell, if every == 3 { 2.0 } else { 1.0 }, "{every}");
            if sample.whole {
                let [note] = &sample.notes[..] else { panic!("{:?}", sample.notes) };
                let zeros = 14_400_usize.div_ceil(every);
                let words = note.words(None);
                assert!(words.starts_with(&format!("{zeros} points")), "{words}");
                assert!(words.contains(" at 0, 0, 24083 units from the others, are not framed"), "{words}");
                assert!((10.0..10.1).contains(&sample.attributes.height.percentile(2.0)));
            } else if every <= 20 {
                assert!(sample.notes[0].words(None).starts_with("about "), "{:?}", sample.notes);
            }
        }
    }
}

#[test]
fn places_far_apart_are_framed_and_said_to_be() {
    let [here, there] = [square(100, [0, 0]), square(60, [185_000, 0])];
    let both: Vec<_> = here.iter().chain(&there).copied().collect();
    let of = |raw: &[[i32; 3]]| points(raw, Packing::Fixed(5_000), CENTIMETRES, [0.0; 3]);
    for files in [vec![of(&both)], vec![of(&here), of(&there)]] {
        let sample = sample_made(&files, &SampleBudget::default());
        assert_eq!(sample.bounds.unwrap().size().x, 185_059.0);
        let [note] = &sample.notes[..] else { panic!("{:?}", sample.notes) };
        // The one of two files that is named.
        assert_eq!((note.is_warning(), note.files()), (files.len() == 2, &[1][..files.len() - 1]));
        assert_eq!(
            note.words(None),
            "the data lies at places 184901 units apart: with all of it framed, each is small"
        );
    }
    let sample = sample_made(&[of(&here)], &SampleBudget::default());
    assert!(sample.notes.is_empty(), "{:?}", sample.notes);
}

/// The latitude that degrees are scaled at comes from the middle of the file, whatever its first record says.
#[test]
fn one_wrong_first_point_does_not_move_the_middle_of_a_file() {
    let degree = |k: i32| [k % 80 * 90, k / 80 * 90, 1000 + k % 30];
    let town: Vec<_> = (0..6400).map(degree).collect();
    let keys: Vec<u8> =
        [1u16, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326].iter().flat_map(|k| k.to_le_bytes()).collect();
    let file = |first: [i32; 3], packing| {
        let mut raw = town.clone();
        raw[0] = first;
        let mut made = points(&raw, packing, [1e-7, 1e-7, 0.01], [10.0, 60.0, 0.0]);
        made.vlrs.push(("LASF_Projection", 34735, keys.clone()));
        sample_made(&[made], &SampleBudget::default())
    };
    for packing in [Packing::Fixed(50_000), Packing::Fixed(2_500), Packing::Fixed(300)] {
        let sound = file(town[0], packing.clone());
        assert!(sound.notes.is_empty(), "{:?}", sound.notes);
        // 0, 0, 0 in degrees.
        let wrong = file([-100_000_000, -600_000_000, 0], packing);
        assert_eq!(wrong.world.placements, sound.world.placements);
        let (wrong, sound) = (wrong.bounds.unwrap(), sound.bounds.unwrap());
        assert!((wrong.size() - sound.size()).abs().max_element() < 2.0, "{wrong:?}, not {sound:?}");
        assert!((wrong.size().x / wrong.size().y - 0.5).abs() < 0.01, "{wrong:?}");
    }
}

/// Files made after what people reported of other readers.
#[test]
fn reported_files_are_framed_as_they_are_meant() {
    let Some(folder) = data().map(|data| data.join("reports")).filter(|folder| folder.is_dir()) else {
        println!("skipped: no files after reports");
        return;
    };
    let (_, zeros) = sample_of(&folder, "zeros5pct.laz");
    let size = zeros.bounds.unwrap().size();
    assert!(size.x < 81.0 && size.y < 81.0, "{size}");
    let said: Vec<_> = zeros.notes.iter().map(|note| note.words(None)).collect();
    assert_eq!(said, ["320 points (5.0 %) at 0, 0, 5427105 units from the others, are not framed"]);
    let (_, degrees) = sample_of(&folder, "deg60_first_is_zero.laz");
    let size = degrees.bounds.unwrap().size();
    assert!((size.x - 80.0).abs() < 1.0 && (size.y - 80.0).abs() < 1.0, "{size}");
    let (_, few) = sample_of(&folder, "twenty_points.laz");
    assert_eq!(few.bounds.unwrap().size().round(), glam::DVec3::new(402.0, 375.0, 17.0));
    let (_, white) = sample_of(&folder, "rgb_white.laz");
    assert_eq!((white.files[0].rgb, white.files[0].rgb_constant), (RgbDepth::Sixteen, Some([65_535; 3])));
    assert_eq!(white.attributes.rgb_constant, Some([255; 3]));
}
