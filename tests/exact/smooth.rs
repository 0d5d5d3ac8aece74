//! The exact picture of smooth surfaces (`--surface smooth --shade none`) against brute force over the points in f64.

use crate::common::{self, LAVAPIPE};
use crate::scene::{self, Data, MEASURED, points, real_files};
use crate::stacks::{Mask, loaded, main_shots, map_of, mask};
use crate::{Shot, odd_shots};
use lasray::attribute::ClassMask;
use lasray::gpu::Gpu;
use lasray::render::camera::RayBasis;
use lasray::render::frame::{Renderer, View};
use lasray::render::image::{Image, MISS_CLASS};
use lasray::render::reference::{Face, Hit, Point, SmoothMap, Tolerance};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::Surface;
use std::path::Path;

/// Columns beside each other are of one surface if they differ by no more cells.
const JUMP: f64 = 2.5;

fn smooth_map(data: &Data, points: &[Point], mask: &Mask) -> SmoothMap {
    let jump = (JUMP * data.grid.cell() / data.grid.height_step).max(1.0) as i64;
    SmoothMap::new(map_of(data, points, mask), jump)
}

/// What a distance may be off by: as where columns are flat; and where the surface is met, what it takes the ray to come nearer to
/// it by a step of the heights' lattice and by what the slope makes of a thousandth of a cell.
fn allowed(map: &SmoothMap, hit: &Hit, basis: &RayBasis, data: &Data, [px, py]: [f64; 2]) -> f64 {
    let (cell_size, height_step) = (data.grid.cell(), data.grid.height_step);
    let flat = Tolerance { cell_size, height_step }.at(hit, basis, px, py);
    if hit.face != Face::Top {
        return flat;
    }
    let (o, d, length) = (basis.origin(px, py), basis.direction(px, py), basis.length(px, py));
    let along = (hit.distance - basis.distance_eye_to_plane(px, py)) / length;
    let place = o + d * along;
    let Some([east, north]) = map.slope(hit.cell, [place.x, place.y]) else { return flat };
    let closing = (d.z - east * d.x - north * d.y).abs() / length;
    flat + (height_step + 0.001 * cell_size * east.hypot(north)) / closing
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
            agrees(&image, k, want, |hit| allowed(map, hit, &basis, data, pixel(k)))
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
            .set_visibility(Visibility { classes: mask.classes, withheld: mask.withheld, ..MEASURED() })
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
        // The last has sections whose codes are wide.
        let files = ["urban/fusa.laz", "urban/multitile_delft/ahn3_cropped_2.laz", "autzen/autzen_trim.laz"];
        let wrong: Vec<_> = files
            .into_iter()
            .flat_map(|name| check_file(&gpu, &folder.join(name), None, false, &masks()))
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
