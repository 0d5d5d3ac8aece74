//! The exact picture of smooth surfaces (`--surface smooth --shade none`) against brute force over the points in f64.

use crate::common::{self, LAVAPIPE, made};
use crate::scene::{self, Data, MEASURED, points, real_files};
use crate::stacks::{Mask, loaded, main_shots, map_of, mask, spacing};
use crate::{Shot, WIDE, odd_shots, shot};
use glam::DVec3;
use lasray::attribute::ClassMask;
use lasray::gpu::Gpu;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Renderer, View};
use lasray::render::image::{Image, MISS_CLASS};
use lasray::render::reference::{Face, Hit, Point, SmoothMap};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::Surface;
use std::path::Path;

/// Columns beside each other are of one surface if they differ by no more cells.
const JUMP: f64 = 2.5;

fn smooth_map(data: &Data, points: &[Point], mask: &Mask) -> SmoothMap {
    let jump = (JUMP * data.grid.cell() / data.grid.height_step).max(1.0) as i64;
    SmoothMap::new(map_of(data, points, mask), jump, spacing(&data.grid).gap)
}

/// Whether a pixel shows what the reference hits.
fn agrees(image: &Image, k: usize, want: Option<&Hit>, allowed: impl Fn(&Hit) -> f64) -> bool {
    let Some(hit) = want else { return image.class[k] == MISS_CLASS };
    let off = (f64::from(image.distance[k]) - hit.distance).abs();
    image.class[k] == u32::from(hit.class) && off <= allowed(hit)
}

/// Draws `shots` and compares them with brute force over `map`. Returns what is wrong.
fn check(
    data: &Data,
    map: &SmoothMap,
    (scene, renderer): (&mut Scene, &mut Renderer),
    what: &str,
    shots: &[Shot],
) -> Vec<String> {
    let mut wrong = Vec::new();
    for shot in shots {
        let view = View { z_scale: shot.z_scale, ..data.exact(&shot.camera, shot.size) };
        let image = renderer.draw(scene, &view).unwrap();
        let basis = shot.camera.basis(shot.size).unwrap().exaggerated(shot.z_scale, view.pivot).unwrap();
        let reference = map.render(&basis, shot.size);
        let pixel = |k: usize| [k % image.width as usize, k / image.width as usize].map(|v| v as f64);
        let is_as = |k: usize, want: Option<&Hit>| {
            agrees(&image, k, want, |hit| map.tolerance(hit, &basis, pixel(k)))
        };
        let class_of = |hit: &Option<Hit>| hit.map_or(MISS_CLASS, |hit| hit.class.into());
        let pixels = reference.len();
        let of_class = (0..pixels).filter(|&k| image.class[k] != class_of(&reference[k])).count();
        let differ: Vec<usize> = (0..pixels).filter(|&k| !is_as(k, reference[k].as_ref())).collect();
        // Not from what is seen a ten-thousandth of a pixel beside: rays through corners and along edges.
        let is_unclear = |k: &&usize| {
            let [x, y] = pixel(**k);
            let beside = [(-1e-4, -1e-4), (1e-4, -1e-4), (-1e-4, 1e-4), (1e-4, 1e-4)];
            beside.iter().any(|(dx, dy)| is_as(**k, map.trace(&basis, x + dx, y + dy).as_ref()))
        };
        let unclear = differ.iter().filter(is_unclear).count();
        let met = reference.iter().flatten().filter(|hit| hit.face == Face::Top).count();
        let mut said = format!(
            "{what}, {}: {pixels} pixels, {met} from above; class differs on {of_class}, class or distance on {}, \
             {unclear} of them unclear",
            shot.name,
            differ.len()
        );
        for &k in differ.iter().filter(|k| !is_unclear(k)).take(6) {
            let [x, y] = pixel(k);
            let (distance, class, face) = (image.distance[k], image.class[k], image.face[k]);
            said +=
                &format!("\n  {x}, {y}: class {class} at {distance}, face {face}, for {:?}", reference[k]);
        }
        println!("{said}");
        let pixels = pixels as f64;
        if of_class as f64 > (1.0 - shot.share) * pixels || (differ.len() - unclear) as f64 > 0.001 * pixels {
            wrong.push(said);
        }
    }
    wrong
}

/// Checks a file from four sides, and under other masks from two of them.
fn check_file(gpu: &Gpu, path: &Path, cell: Option<f64>, odd: bool, masks: &[Mask]) -> Vec<String> {
    let data = loaded(path, cell, Surface::Smooth);
    let mut scene = data.scene(gpu, Access::Address, MEASURED());
    let mut renderer = data.renderer(&scene);
    let points = points(path, &data.placement);
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let all = mask("", ClassMask::default());
    let map = smooth_map(&data, &points, &all);
    let mut shots = main_shots(&data, &map_of(&data, &points, &all));
    if odd {
        shots.extend(odd_shots(&data));
    }
    let mut wrong = check(&data, &map, (&mut scene, &mut renderer), &name, &shots);
    for mask in masks {
        scene
            .set_visibility(Visibility {
                classes: mask.classes,
                hidden_flags: mask.hidden_flags,
                ..MEASURED()
            })
            .unwrap();
        let map = smooth_map(&data, &points, mask);
        let what = format!("{name}, {}", mask.name);
        wrong.extend(check(&data, &map, (&mut scene, &mut renderer), &what, &shots[2..4]));
    }
    assert_eq!(gpu.messages(), [""; 0]);
    wrong
}

fn masks() -> Vec<Mask> {
    vec![mask("ground", ClassMask::only(&[2])), mask("buildings", ClassMask::only(&[6]))]
}

#[test]
fn real_files_are_drawn_exactly() {
    let Some(folder) = real_files() else { return };
    common::run("smooth::real_files_are_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        // Those of wires and of crowns; that of feet has sections whose codes are wide.
        let files = [
            ("powerline/12BZ1_21.laz", vec![]),
            ("forest/multitile_bcts/bcts_1.laz", vec![]),
            ("urban/fusa.laz", masks()),
            ("urban/multitile_delft/ahn3_cropped_2.laz", masks()),
            ("autzen/autzen_trim.laz", masks()),
            ("urban/ign_v14/test_data_77055_627755_LA93_IGN69.laz", vec![]),
        ];
        let wrong: Vec<_> = files
            .into_iter()
            .flat_map(|(name, masks)| check_file(&gpu, &folder.join(name), None, false, &masks))
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

#[test]
fn the_town_is_drawn_exactly() {
    common::run("smooth::the_town_is_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = scene::town(folder.path(), "town.las", [-80.0, -80.0], 160.0);
        let mut wrong = check_file(&gpu, &path, Some(0.5), true, &masks());
        // Cells that no power of two divides.
        wrong.extend(check_file(&gpu, &path, Some(0.7), false, &[]));
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

/// Places along a wire, units from its start.
type Wire = fn(f64) -> [f64; 3];
/// Over a border of sections each way, which cells of 0.5 units have 96 units east and 64 north: along an axis, diagonal, sagging
/// askew.
const ALONG: Wire = |s| [70.0 + s, 30.2, 12.0];
const DIAGONAL: Wire = |s| [75.2 + 0.7 * s, 44.2 + 0.7 * s, 10.0];
const ASKEW: Wire = |s| [68.1 + s, 55.3 + 0.31 * s, 9.0 + (s / 22.5 - 1.0).powi(2) * 5.0];
const STEEP: Wire = |s| [90.3 + 0.3 * s, 12.2 + 0.1 * s, 3.0 + 0.9 * s];

/// Wires over flat ground, twigs and a crown, as a file.
fn write_wires(path: &Path, wires: &[Wire], twigs: u32) {
    let ground = made::field([120.0, 80.0], 0.5, |_, _| Some((0.0, 2)));
    let wires = wires.iter().flat_map(|at| (0..150).map(move |k| (at(f64::from(k) * 0.3), 14)));
    let unit =
        |k: u32, prime: u32| f64::from(k.wrapping_mul(2_654_435_761).wrapping_mul(prime) >> 8) / 16_777_216.0;
    let crown = (0..6 * twigs).map(move |k| {
        let [x, y, z] = [5, 13, 17].map(|prime| unit(k, prime) - 0.5);
        ([82.0 + 7.0 * x, 70.0 + 7.0 * y, 8.0 + 5.0 * z], 4)
    });
    let twigs = (0..twigs).map(move |k| {
        let [x, y, z] = [3, 7, 11].map(|prime| unit(k, prime));
        ([92.0 + 8.0 * x, 60.0 + 8.0 * y, 3.0 + 6.0 * z], 5)
    });
    made::write(path, ground.chain(wires).chain(twigs).chain(crown));
}

#[test]
fn wires_and_twigs_are_drawn_exactly() {
    common::run("smooth::wires_and_twigs_are_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wires.las");
        write_wires(&path, &[ALONG, DIAGONAL, ASKEW, STEEP], 700);
        let data = loaded(&path, Some(0.5), Surface::Smooth);
        let mut scene = data.scene(&gpu, Access::Address, MEASURED());
        let mut renderer = data.renderer(&scene);
        let all = mask("", ClassMask::default());
        let points = points(&path, &data.placement);
        let map = smooth_map(&data, &points, &all);
        let corner = DVec3::new(500_000.0, 5_000_000.0, 0.0);
        let near = |eye: [f64; 3], target: [f64; 3]| {
            let [eye, target] = [eye, target].map(|place| corner + DVec3::from(place));
            Camera::look_at(eye, target, WIDE).unwrap()
        };
        let mut shots = main_shots(&data, &map_of(&data, &points, &all));
        shots.extend([
            // Some 50 pixels a cell.
            shot("along an axis, over the border", near([96.1, 28.0, 12.9], [96.0, 30.2, 11.9])),
            shot("diagonal, over the border", near([94.0, 61.0, 11.4], [96.0, 64.9, 9.8])),
            shot("askew, from below", near([90.0, 60.0, 6.0], [91.0, 62.4, 9.0])),
            shot("twigs", near([91.0, 59.0, 8.0], [96.0, 64.0, 6.0])),
            shot("up through a crown", near([81.0, 69.0, 3.0], [82.1, 70.2, 9.0])),
            Shot { z_scale: 3.0, ..shot("exaggerated", near([91.0, 50.0, 20.0], [96.0, 64.0, 16.0])) },
            Shot { z_scale: 0.4, ..shot("flattened", near([91.0, 50.0, 8.0], [96.0, 64.0, 4.0])) },
        ]);
        shots.extend(odd_shots(&data));
        let wrong = check(&data, &map, (&mut scene, &mut renderer), "wires", &shots);
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// At 24 pixels a cell wires are lines without gaps, as thick all along as a tube is, across the borders of sections, too.
#[test]
fn wires_are_no_beads() {
    common::run("smooth::wires_are_no_beads", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let corner = DVec3::new(500_000.0, 5_000_000.0, 0.0);
        // What it looks at, and from where.
        let views: [(&str, Wire, f64, [f64; 3]); 4] = [
            ("along an axis", ALONG, 26.0, [0.0, -20.0, 0.0]),
            ("along an axis, from above", ALONG, 26.0, [0.0, 0.0, 40.0]),
            ("diagonal", DIAGONAL, 28.5, [14.0, -14.0, 0.0]),
            ("askew", ASKEW, 27.9, [6.2, -20.0, 0.0]),
        ];
        let mut wrong = Vec::new();
        for (name, wire, at, from) in views {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("wire.las");
            write_wires(&path, &[wire], 0);
            let data = loaded(&path, Some(0.5), Surface::Smooth);
            let mut scene = data.scene(&gpu, Access::Address, MEASURED());
            scene.set_visibility(Visibility { classes: ClassMask::only(&[14]), ..MEASURED() }).unwrap();
            let mut renderer = data.renderer(&scene);
            let target = corner + DVec3::from(wire(at));
            let parallel = Projection::Orthographic { units_per_pixel: 0.5 / 24.0 };
            let camera = Camera::look_at(target + DVec3::from(from), target, parallel).unwrap();
            let image = renderer.draw(&mut scene, &data.exact(&camera, [480, 480])).unwrap();
            let thick = |x: usize| (0..480).filter(|y| image.class[y * 480 + x] == 14).count();
            let thick: Vec<usize> = (0..480).map(thick).collect();
            let (least, most) = (thick.iter().min().unwrap(), thick.iter().max().unwrap());
            println!("{name}: {least} to {most} pixels thick");
            // A tube is 0.4 cells thick, 9.6 pixels; where it bends or is oblique, more.
            if *least < 8 || *most > 20 {
                wrong.push(format!("{name}: {thick:?}"));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
