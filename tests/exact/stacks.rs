//! The exact picture of stacks (`--surface stacks --shade none`) against brute force over the points in f64.

use crate::common::{self, LAVAPIPE};
use crate::scene::{self, Data, MEASURED, points, real_files};
use crate::{ODD, Shot, WIDE, odd_shots, shot};
use glam::DVec3;
use lasray::attribute::{ClassMask, Flags};
use lasray::coords::Grid;
use lasray::gpu::Gpu;
use lasray::load::LoadOptions;
use lasray::render::camera::{Camera, Projection, RayBasis};
use lasray::render::frame::{Renderer, View};
use lasray::render::image::{Image, MISS_CLASS};
use lasray::render::reference::{Column, Face, Hit, Point, Spacing, Stack, StackMap, Tolerance, compare};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::Surface;
use std::fs;
use std::path::Path;

/// A file with stacks, or what else `surface` says, in cells of `cell` units (`None`: as chosen).
pub fn loaded(path: &Path, cell: Option<f64>, surface: Surface) -> Data {
    Data::load_with(&[path.to_owned()], cell, |options| LoadOptions { surface, ..options })
}

/// A span reaches a cell below its points, which are at most two cells apart, rounded up to a power of two of steps.
pub fn spacing(grid: &Grid) -> Spacing {
    let cell_steps = grid.cell() / grid.height_step;
    let gap = (0..62).map(|log2| 1i64 << log2).find(|&gap| gap as f64 >= 2.0 * cell_steps);
    Spacing { thickness: cell_steps.ceil().max(1.0) as i64, gap: gap.expect("cells of few steps"), around: 2 }
}

const SIZE: [u32; 2] = [160, 90];

/// What is shown, beside the name of it.
pub struct Mask {
    pub name: &'static str,
    pub classes: ClassMask,
    pub hidden_flags: Flags,
}

pub fn mask(name: &'static str, classes: ClassMask) -> Mask {
    Mask { name, classes, hidden_flags: Flags::WITHHELD }
}

/// Of the ground and what stands on it, of what floats, and of both; without the ground no gap is seen below the rest.
fn masks() -> Vec<Mask> {
    let (default, only) = (ClassMask::default(), ClassMask::only);
    vec![
        Mask { name: "all, withheld too", classes: ClassMask::all(), hidden_flags: Flags::NONE },
        mask("all", ClassMask::all()),
        mask("no ground", default.without(&[2])),
        mask("no vegetation", default.without(&[3, 4, 5])),
        mask("nothing that stands", default.without(&[2, 6, 9, 10, 11, 41])),
        mask("ground and unclassified", only(&[1, 2])),
        mask("ground and high vegetation", only(&[2, 5])),
        mask("vegetation, wires, towers, bridges", only(&[3, 4, 5, 13, 14, 15, 16, 17])),
        Mask { name: "default, withheld too", classes: default, hidden_flags: Flags::NONE },
        Mask { name: "no overlap", classes: default, hidden_flags: Flags::WITHHELD.with(Flags::OVERLAP) },
        Mask {
            name: "what stands, but nothing synthetic",
            classes: only(&[2, 6, 9, 10, 11, 41]),
            hidden_flags: Flags::SYNTHETIC,
        },
        Mask { name: "without any flag", classes: ClassMask::all(), hidden_flags: Flags::ALL },
    ]
}

pub fn map_of(data: &Data, points: &[Point], mask: &Mask) -> StackMap {
    let lattice = [data.grid.cell(), data.grid.height_step];
    StackMap::build(
        points.iter().copied(),
        lattice,
        spacing(&data.grid),
        &mask.classes,
        mask.hidden_flags.bits(),
    )
}

/// Steps of air below what floats lowest.
fn clearance(stack: &Stack) -> i64 {
    let lowest = stack.floating.iter().map(|span| span.bottom_steps).min();
    lowest.zip(stack.solid).map_or(0, |(bottom, top)| bottom - top.height_steps)
}

fn is_wire(column: &Column) -> bool {
    matches!(column.class, 13..=16)
}

/// The middle of a cell at a height.
fn place(data: &Data, [i, j]: [i64; 2], u: f64) -> DVec3 {
    let cell = data.grid.cell();
    DVec3::new((i as f64 + 0.53) * cell, (j as f64 + 0.46) * cell, u)
}

/// The four cameras that every file is seen from.
pub fn main_shots(data: &Data, map: &StackMap) -> Vec<Shot> {
    let (b, cell) = (data.bounds, data.grid.cell());
    let center = b.center().truncate();
    let high = |stack: &Stack| clearance(stack) as f64 * data.grid.height_step > 4.0 * cell;
    // Of what hangs over air, wires if there are any, what is nearest to the middle.
    let (over, stack) = map
        .cells()
        .filter(|(_, stack)| high(stack))
        .min_by(|(a, a_stack), (b, b_stack)| {
            let wires = |stack: &Stack| stack.floating.iter().any(|span| is_wire(&span.top));
            let off = |cell: [i64; 2]| place(data, cell, 0.0).truncate().distance(center);
            wires(b_stack).cmp(&wires(a_stack)).then(off(*a).total_cmp(&off(*b))).then(a.cmp(b))
        })
        .expect("something floats");
    let air = clearance(stack) as f64 * data.grid.height_step;
    let stands = map.units(stack.solid.expect("above it").height_steps);
    let eye = place(data, over, stands + 0.37 * air.min(8.0 * cell));
    let level = level_with(data, map, over, stack);
    let wide = Projection::Perspective { fov: 75.0 };
    vec![
        Shot {
            size: SIZE,
            ..shot("up from below", Camera::look_at(eye, eye + DVec3::new(0.3, 0.5, 1.1), wide).unwrap())
        },
        Shot { size: ODD, ..shot("level, through what floats", level) },
        Shot { size: SIZE, ..shot("down", Camera::frame(&b, [0.0, 90.0], WIDE, SIZE).unwrap()) },
        Shot { size: SIZE, ..shot("oblique", Camera::frame(&b, [215.0, 12.0], WIDE, SIZE).unwrap()) },
    ]
}

/// From a place in the open as high as the middle of what floats, towards it.
fn level_with(data: &Data, map: &StackMap, over: [i64; 2], stack: &Stack) -> Camera {
    let span = stack.floating.last().expect("it floats");
    let u = 0.5 * map.units(span.top.height_steps + span.bottom_steps);
    let is_open = |cell: &[i64; 2]| {
        map.stack(*cell).is_none_or(|stack| {
            let within = |[low, high]: [i64; 2]| map.units(low) <= u && u <= map.units(high);
            stack.solid.is_none_or(|top| map.units(top.height_steps) < u)
                && !stack.floating.iter().any(|span| within([span.bottom_steps, span.top.height_steps]))
        })
    };
    let around = [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1]];
    let places = (20..400).flat_map(|far| around.map(|[i, j]| [over[0] + i * far, over[1] + j * far]));
    let from = places.into_iter().find(is_open).expect("a place in the open");
    Camera::look_at(place(data, from, u), place(data, over, u), WIDE).unwrap()
}

/// Whether a pixel shows what the reference hits, its face too.
fn agrees(image: &Image, k: usize, want: &Option<Hit>, basis: &RayBasis, tolerance: Tolerance) -> bool {
    let pixel = [k % image.width as usize, k / image.width as usize].map(|v| v as f64);
    let Some(hit) = want else { return image.class[k] == MISS_CLASS };
    let off = (f64::from(image.distance[k]) - hit.distance).abs();
    image.class[k] == u32::from(hit.class)
        && image.face[k] == hit.face as u8
        && off <= tolerance.at(hit, basis, pixel[0], pixel[1])
}

/// Draws `shots` and compares them with brute force over `map`. Returns what is wrong, and how many bottoms were seen.
fn check(
    data: &Data,
    map: &StackMap,
    (scene, renderer): (&mut Scene, &mut Renderer),
    what: &str,
    shots: &[Shot],
) -> (Vec<String>, usize) {
    let (mut wrong, mut bottoms) = (Vec::new(), 0);
    let tolerance = Tolerance { cell_size: data.grid.cell(), height_step: data.grid.height_step };
    for shot in shots {
        let view = View { z_scale: shot.z_scale, ..data.exact(&shot.camera, shot.size) };
        let image = renderer.draw(scene, &view).unwrap();
        let basis = shot.camera.basis(shot.size).unwrap().exaggerated(shot.z_scale, view.pivot).unwrap();
        let reference = map.render(&basis, shot.size);
        let result = compare(&reference, &basis, shot.size[0], &image.distance, &image.class, tolerance);
        let differ: Vec<usize> =
            (0..reference.len()).filter(|&k| !agrees(&image, k, &reference[k], &basis, tolerance)).collect();
        // Not from what is seen a ten-thousandth of a pixel beside: rays through corners and along edges.
        let beside = [(-1e-4, -1e-4), (1e-4, -1e-4), (-1e-4, 1e-4), (1e-4, 1e-4)];
        let is_unclear = |k: &&usize| {
            let [x, y] = [**k % image.width as usize, **k / image.width as usize].map(|v| v as f64);
            let near = |(dx, dy): &(f64, f64)| map.trace(&basis, x + dx, y + dy);
            beside.iter().any(|by| agrees(&image, **k, &near(by), &basis, tolerance))
        };
        let unclear = differ.iter().filter(is_unclear).count();
        let is_of_face = |k: &&usize| {
            reference[**k].is_some_and(|hit| {
                image.class[**k] == u32::from(hit.class) && image.face[**k] != hit.face as u8
            })
        };
        let faces = differ.iter().filter(is_of_face).count();
        let seen = reference.iter().flatten().filter(|hit| hit.face == Face::Bottom).count();
        bottoms += seen;
        let said = format!(
            "{what}, {}: {seen} bottoms, {unclear} unclear, {faces} of another face: {result}",
            shot.name
        );
        println!("{said}");
        let pixels = result.pixels as f64;
        let of_what = (result.hit_or_miss_differs + result.class_differs + faces) as f64;
        if of_what > (1.0 - shot.share) * pixels || (differ.len() - unclear) as f64 > 0.001 * pixels {
            wrong.push(said);
        }
    }
    (wrong, bottoms)
}

/// Checks a file from four sides, and under other masks from two of them.
fn check_file(gpu: &Gpu, path: &Path, cell: Option<f64>, odd: bool, masks: &[Mask]) -> Vec<String> {
    let data = loaded(path, cell, Surface::Stacks);
    let mut scene = data.scene(gpu, Access::Address, MEASURED());
    let mut renderer = data.renderer(&scene);
    let points = points(path, &data.placement);
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let map = map_of(&data, &points, &mask("", ClassMask::default()));
    let floating = map.cells().filter(|(_, stack)| !stack.floating.is_empty()).count();
    println!(
        "{name}: {} points, cell {}, {} columns, {floating} with something that floats",
        points.len(),
        data.grid.cell(),
        map.tops().len()
    );
    let shots = main_shots(&data, &map);
    let (mut wrong, bottoms) = check(&data, &map, (&mut scene, &mut renderer), &name, &shots);
    assert!(bottoms > 100, "{name}: {bottoms} pixels show something from below");
    if odd {
        wrong.extend(check(&data, &map, (&mut scene, &mut renderer), &name, &odd_shots(&data)).0);
    }
    for mask in masks {
        scene
            .set_visibility(Visibility {
                classes: mask.classes,
                hidden_flags: mask.hidden_flags,
                ..MEASURED()
            })
            .unwrap();
        let map = map_of(&data, &points, mask);
        let what = format!("{name}, {}", mask.name);
        wrong.extend(check(&data, &map, (&mut scene, &mut renderer), &what, &shots[..2]).0);
    }
    assert_eq!(gpu.messages(), [""; 0]);
    wrong
}

#[test]
fn real_files_are_drawn_exactly() {
    let Some(folder) = real_files() else { return };
    common::run("stacks::real_files_are_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let files = [
            ("powerline/12BZ1_21.laz", masks()),
            ("forest/multitile_bcts/bcts_1.laz", vec![]),
            ("urban/multitile_delft/ahn3_cropped_2.laz", masks()),
            ("urban/fusa.laz", vec![]),
            ("forest/MixedConifer.laz", vec![]),
            ("autzen/autzen_trim.laz", vec![]),
        ];
        let wrong: Vec<_> = files
            .into_iter()
            .flat_map(|(name, masks)| check_file(&gpu, &folder.join(name), None, false, &masks))
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

/// Marks some points of a LAS file of point format 6 or above as synthetic (every seventh), withheld (every fifth), key-points
/// (every eleventh) or overlap (every fourth).
fn mark(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let first = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let length = usize::from(u16::from_le_bytes(bytes[105..107].try_into().unwrap()));
    for (k, record) in bytes[first..].chunks_exact_mut(length).enumerate() {
        record[15] |= u8::from(k % 7 == 0) | u8::from(k % 5 == 0) << 2;
        record[15] |= u8::from(k % 11 == 0) << 1 | u8::from(k % 4 == 1) << 3;
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn the_town_is_drawn_exactly() {
    common::run("stacks::the_town_is_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = scene::town(folder.path(), "town.las", [-80.0, -80.0], 160.0);
        mark(&path);
        let mut wrong = check_file(&gpu, &path, Some(0.5), true, &masks());
        // Cells that no power of two divides.
        wrong.extend(check_file(&gpu, &path, Some(0.7), false, &[]));
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}
