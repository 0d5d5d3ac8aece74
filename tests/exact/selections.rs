//! A selection is a filter: the exact picture of the points that take part is, pixel by pixel and bit by bit, that of a file in
//! which only those are. And what the channel of records holds is what a file has whose intensities are that.

use crate::common::{self, LAVAPIPE};
use crate::masks::{Points, cameras, differ, differ_beyond_rounding};
use crate::scene::{Data, MEASURED, real_files};
use lasray::attribute::{Channel, ColorMode, srgb_to_linear};
use lasray::gpu::Gpu;
use lasray::load::LoadOptions;
use lasray::render::frame::View;
use lasray::render::image::MISS_CLASS;
use lasray::resident::pool::Access;
use lasray::sample::Asked;
use lasray::section::Surface;
use lasray::source::{Returns, Selection};
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [192, 108];

type Keeps<'a> = Box<dyn Fn(&las::Point) -> bool + 'a>;

/// A value between two of `values`, which are few or many, at this share of them.
fn between(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.dedup();
    let at = ((values.len() - 1) as f64 * share) as usize;
    0.5 * (values[at] + values[(at + 1).min(values.len() - 1)])
}

/// Selections, and the same written apart from them.
fn selections(points: &Points) -> Vec<(Selection, Keeps<'_>)> {
    let all = Selection::default();
    let of = |value: fn(&las::Point) -> f64, share| between(points.points.iter().map(value).collect(), share);
    let intensity = |share| of(|point| point.intensity.into(), share);
    let [low, high] = [intensity(0.2).floor(), intensity(0.7).ceil()];
    let [bottom, top] = [0.3, 0.8].map(|share| of(|point| point.z, share));
    let returns = |returns| Selection { returns, ..all.clone() };
    let mut made: Vec<(Selection, Keeps)> = vec![
        (returns(Returns::First), Box::new(|point| point.return_number <= 1)),
        (returns(Returns::Last), Box::new(|point| point.return_number >= point.number_of_returns)),
        (returns(Returns::Only), Box::new(|point| point.number_of_returns <= 1)),
        (
            Selection { source_ids: "3,5-6".parse().unwrap(), ..all.clone() },
            Box::new(|point| matches!(point.point_source_id, 3 | 5 | 6)),
        ),
        (
            Selection { intensity: format!("{low}..{high}").parse().unwrap(), ..all.clone() },
            Box::new(move |point| (low..=high).contains(&f64::from(point.intensity))),
        ),
        (
            Selection { heights: format!("{bottom}..").parse().unwrap(), ..all.clone() },
            Box::new(move |point| point.z > bottom),
        ),
        (
            Selection {
                returns: Returns::First,
                heights: format!("..{top}").parse().unwrap(),
                source_ids: "4-7".parse().unwrap(),
                ..all.clone()
            },
            Box::new(move |point| {
                point.return_number <= 1 && point.z < top && (4..8).contains(&point.point_source_id)
            }),
        ),
    ];
    if points.points[0].gps_time.is_some() {
        let time = |share| of(|point| point.gps_time.unwrap(), share);
        let [from, to] = [time(0.25), time(0.6)];
        made.push((
            Selection { gps_time: format!("{from}..{to}").parse().unwrap(), ..all },
            Box::new(move |point| (from..=to).contains(&point.gps_time.unwrap())),
        ));
    }
    made
}

/// The points of a file, with several flight lines and returns where it has but one.
fn points(name: &'static str, path: &Path, cell: f64) -> Points {
    let mut points = Points::read(name, path, cell, 20_000);
    let later = points.points.iter().filter(|point| point.return_number > 1).count();
    let is_single = later < 1000;
    let times: Vec<f64> = points.points.iter().filter_map(|point| point.gps_time).collect();
    let is_one_time = times.iter().all(|time| *time == times[0]);
    for (k, point) in points.points.iter_mut().enumerate() {
        point.point_source_id = 2 + (k / 900 % 7) as u16;
        point.scan_angle = (k % 61) as f32 - 30.0;
        if is_single {
            point.number_of_returns = 1 + (k % 3) as u8;
            point.return_number = 1 + (k / 3) as u8 % point.number_of_returns;
        }
        if is_one_time && point.gps_time.is_some() {
            point.gps_time = Some(1000.0 + k as f64);
        }
        if point.intensity == 0 {
            point.intensity = (k * 7 % 1000) as u16;
        }
    }
    points
}

fn load(points: &Points, path: PathBuf, surface: Surface, selection: &Selection) -> Data {
    Data::load_with(&[path], Some(points.cell), |options| LoadOptions {
        surface,
        rgb_bits: Some(16),
        asked: Asked { selection: selection.clone(), ..Asked::default() },
        ..options
    })
}

/// Compares pictures of `points` under all selections with those of files of what they hold. Returns what is wrong.
fn check(gpu: &Gpu, points: &Points) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(format!("{name}.las"));
    points.write_those(&path("all"), |_| true);
    let (mut wrong, mut hits) = (Vec::new(), 0);
    for (k, (selection, keeps)) in selections(points).into_iter().enumerate() {
        let own_file = path(&k.to_string());
        let count = points.write_those(&own_file, &keeps);
        let what = format!("{}, {count} points: {}", points.name, selection.words());
        assert!(count > 200 && count < points.points.len() - 200, "{what}");
        for surface in [Surface::Columns, Surface::Stacks] {
            let selected = load(points, path("all"), surface, &selection);
            let own = load(points, own_file.clone(), surface, &Selection::default());
            assert_eq!(selected.grid, own.grid, "{what}");
            let [mut scene, mut own_scene] =
                [&selected, &own].map(|data| data.scene(gpu, Access::Address, MEASURED()));
            let mut renderer = selected.renderer(&scene);
            let mut own_renderer = own.renderer(&own_scene);
            let mut differing = Vec::new();
            for camera in &cameras(points, &selected) {
                let image = renderer.draw(&mut scene, &selected.exact(camera, SIZE)).unwrap();
                let view = || View { colors: &selected.colors, ..own.exact(camera, SIZE) };
                let mut draw = |view| own_renderer.draw(&mut own_scene, &view).unwrap();
                differing.push(differ(&image, &draw(View { bounds: selected.bounds, ..view() })));
                differing.push(differ_beyond_rounding(&image, &draw(view())));
                hits += image.class.iter().filter(|class| **class != MISS_CLASS).count();
            }
            if differing.iter().any(|pixels| *pixels > 0) {
                wrong.push(format!("{what}, {}: {differing:?} pixels differ", surface.name()));
            }
        }
    }
    println!("{}: {hits} hits", points.name);
    assert!(hits > 50_000, "{}: {hits}", points.name);
    wrong
}

const FILES: [(&str, f64); 5] = [
    ("powerline/12BZ1_21.laz", 0.5),
    ("urban/multitile_delft/ahn3_cropped_2.laz", 0.25),
    ("urban/fusa.laz", 0.5),
    ("forest/MixedConifer.laz", 0.5),
    ("autzen/autzen_trim.laz", 4.0),
];

#[test]
fn selections_are_filters_of_real_files() {
    let Some(folder) = real_files() else { return };
    common::run("selections::selections_are_filters_of_real_files", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let wrong: Vec<_> = FILES
            .into_iter()
            .flat_map(|(name, cell)| check(&gpu, &points(name, &folder.join(name), cell)))
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn channels_are_what_files_have_whose_intensities_are_that() {
    let Some(folder) = real_files() else { return };
    common::run("selections::channels_are_what_files_have_whose_intensities_are_that", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let made = tempfile::tempdir().unwrap();
        let path = |name: &str| made.path().join(format!("{name}.las"));
        let (name, cell) = FILES[2];
        let points = points(name, &folder.join(name), cell);
        points.write_those(&path("all"), |_| true);
        for mode in [ColorMode::SourceId, ColorMode::ScanAngle, ColorMode::GpsTime] {
            let options = |surface| move |options| LoadOptions { surface, ..options };
            let read = |name: &str, mode| {
                Data::load_colored(&[path(name)], Some(cell), mode, options(Surface::Stacks))
            };
            let data = read("all", mode);
            let channel = data.colors.channel.unwrap();
            let mut coded = Points::read(name, &folder.join(name), cell, 20_000);
            coded.points = points.points.clone();
            for point in &mut coded.points {
                point.intensity = match mode {
                    ColorMode::SourceId => point.point_source_id,
                    // Whole degrees in the old formats.
                    ColorMode::ScanAngle => Channel::ScanAngle.code(f64::from(point.scan_angle)),
                    _ => channel.code(point.gps_time.unwrap()),
                };
            }
            coded.write_those(&path("coded"), |_| true);
            let own = read("coded", ColorMode::Intensity);
            let [mut scene, mut own_scene] =
                [&data, &own].map(|data| data.scene(&gpu, Access::Address, MEASURED()));
            let (mut renderer, mut own_renderer) = (data.renderer(&scene), own.renderer(&own_scene));
            for camera in &cameras(&points, &data) {
                let image = renderer.draw(&mut scene, &data.exact(camera, SIZE)).unwrap();
                let own_image = own_renderer.draw(&mut own_scene, &own.exact(camera, SIZE)).unwrap();
                let (values, own_values) = (image.values.unwrap(), own_image.values.unwrap());
                assert_eq!((values.channel, own_values.channel), (channel, Channel::Intensity));
                assert!(values.codes == own_values.codes, "{name}, {mode:?}");
                let mut seen = std::collections::BTreeSet::new();
                for (k, code) in
                    values.codes.iter().enumerate().filter(|(k, _)| image.class[*k] != MISS_CLASS)
                {
                    seen.insert(*code);
                    let wanted = data.colors.of_channel(*code).map(|v| srgb_to_linear(f32::from(v) / 255.0));
                    let is_near = (0..3).all(|c| (image.color[k][c] - wanted[c]).abs() < 0.006);
                    assert!(is_near, "{name}, {mode:?}: {code} is {:?}, not {wanted:?}", image.color[k]);
                }
                assert!(seen.len() > 3, "{name}, {mode:?}: {seen:?}");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
