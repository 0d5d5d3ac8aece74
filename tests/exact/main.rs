//! The exact picture (`--surface columns --shade none`) against brute force over the finest cells in f64.

#[path = "../common/mod.rs"]
mod common;
mod masks;
mod scaled;
#[path = "../common/scene.rs"]
mod scene;
mod selections;
mod shifted;
mod smooth;
mod stacks;

use common::LAVAPIPE;
use glam::DVec3;
use lasray::attribute::ClassMask;
use lasray::gpu::Gpu;
use lasray::render::camera::{Camera, Projection, RayBasis};
use lasray::render::frame::{Renderer, View};
use lasray::render::image::{Image, MISS_CLASS};
use lasray::render::reference::{ColumnMap, Hit, Tolerance, compare};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::source::FLAG_WITHHELD;
use scene::{Data, MEASURED, points, real_files};
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [256, 144];
/// With a pixel in the very middle.
const ODD: [u32; 2] = [161, 91];

/// A picture to be checked.
struct Shot {
    name: &'static str,
    camera: Camera,
    size: [u32; 2],
    z_scale: f64,
    /// Share of the pixels that must agree on hit or miss and on class.
    share: f64,
}

fn shot(name: &'static str, camera: Camera) -> Shot {
    Shot { name, camera, size: SIZE, z_scale: 1.0, share: 0.999 }
}

const WIDE: Projection = Projection::Perspective { fov: 45.0 };

/// The four cameras that every file is seen from.
fn main_shots(data: &Data, map: &ColumnMap) -> Vec<Shot> {
    let (b, center) = (data.bounds, data.bounds.center());
    let size = b.max - b.min;
    let radius = 0.5 * size.length();
    let far = Projection::Perspective { fov: (2.2 * radius / 50_000.0).to_degrees() };
    vec![
        shot("inside", Camera::look_at(standing(data, map), center.with_z(b.min.z), WIDE).unwrap()),
        shot("down", Camera::frame(&b, [0.0, 90.0], WIDE, SIZE).unwrap()),
        shot("50 km", Camera::orbit(center, [37.0, 21.0], 50_000.0, far).unwrap()),
        shot("oblique", Camera::frame(&b, [215.0, 35.0], WIDE, SIZE).unwrap()),
    ]
}

/// A place above low ground between higher things, 1.7 units over it.
fn standing(data: &Data, map: &ColumnMap) -> DVec3 {
    let (b, cell) = (data.bounds, data.grid.cell());
    let top = |p: DVec3| map.column([p.x, p.y].map(|v| (v / cell).floor() as i64)).map(|c| map.top(c));
    // The lowest of a few columns all over.
    let places = (0..400).map(|k| {
        let (x, y) = (f64::from(k % 20) / 20.0, f64::from(k / 20) / 20.0);
        b.min + (b.max - b.min) * DVec3::new(0.1 + 0.8 * x, 0.1 + 0.8 * y, 0.0)
    });
    let lowest = places
        .filter_map(|p| Some(p.with_z(top(p)?)))
        .min_by(|p, q| p.z.total_cmp(&q.z))
        .expect("a column near");
    lowest + DVec3::Z * 1.7
}

/// Cameras that lie where rounding is felt: along axes, on borders, below, parallel, exaggerated.
fn odd_shots(data: &Data) -> Vec<Shot> {
    let (b, center, cell) = (data.bounds, data.bounds.center(), data.grid.cell());
    let size = b.max - b.min;
    let on_border = |v: f64| (v / cell).round() * cell;
    let middle = DVec3::new(on_border(center.x), on_border(center.y), b.min.z + 0.4 * size.z);
    let west = middle - DVec3::X * on_border(0.6 * size.x);
    let below = DVec3::new(b.min.x - 0.3 * size.x, b.min.y - 0.2 * size.y, b.min.z - 0.2 * size.x);
    let parallel = |units_per_pixel| Projection::Orthographic { units_per_pixel };
    let fit = 1.1 * size.truncate().length() / f64::from(SIZE[0]);
    vec![
        Shot {
            size: ODD,
            ..shot("along an axis", Camera::orbit(middle, [90.0, 0.0], 0.6 * size.x, WIDE).unwrap())
        },
        Shot { size: ODD, ..shot("along an axis, west of it", Camera::look_at(west, middle, WIDE).unwrap()) },
        // Every ray of a whole-numbered slope runs through corners.
        Shot {
            size: ODD,
            share: 0.995,
            ..shot("down from a border", Camera::orbit(middle, [0.0, 90.0], size.x, WIDE).unwrap())
        },
        shot(
            "from a corner, diagonal",
            Camera::look_at(middle - DVec3::new(100.0 * cell, 100.0 * cell, 0.0), middle, WIDE).unwrap(),
        ),
        shot("from below", Camera::look_at(below, center, WIDE).unwrap()),
        shot(
            "inside a column",
            Camera::look_at(middle.with_z(b.min.z - 3.0), center.with_z(b.max.z), WIDE).unwrap(),
        ),
        // A few millimetres beside the plumb line: the direction is that of the places as they are given.
        shot(
            "nearly plumb",
            Camera::look_at(center.with_z(b.max.z + 150.0) + DVec3::new(0.0103, 0.0201, 0.0), center, WIDE)
                .unwrap(),
        ),
        shot("up", Camera::orbit(middle, [0.0, -90.0], 0.3 * size.z, WIDE).unwrap()),
        shot("parallel, oblique", Camera::frame(&b, [140.0, 30.0], parallel(fit), SIZE).unwrap()),
        shot(
            "parallel, down, a cell a pixel",
            Camera::orbit(middle, [0.0, 90.0], size.x, parallel(cell)).unwrap(),
        ),
        shot("parallel, level", Camera::orbit(middle, [0.0, 0.0], size.x, parallel(fit)).unwrap()),
        Shot {
            z_scale: 3.0,
            ..shot(
                "exaggerated",
                Camera::frame(&b.exaggerated(3.0, b.min.z), [300.0, 25.0], WIDE, SIZE).unwrap(),
            )
        },
        Shot {
            z_scale: 0.5,
            ..shot(
                "flattened",
                Camera::frame(&b.exaggerated(0.5, b.min.z), [80.0, 15.0], WIDE, SIZE).unwrap(),
            )
        },
    ]
}

/// Draws `shots` and compares them with brute force over `map`. Returns what is wrong.
fn check(
    data: &Data,
    map: &ColumnMap,
    scene: &mut Scene,
    renderer: &mut Renderer,
    what: &str,
    shots: &[Shot],
) -> Vec<String> {
    let mut wrong = Vec::new();
    for shot in shots {
        let view = View { z_scale: shot.z_scale, ..data.exact(&shot.camera, shot.size) };
        let image = renderer.draw(scene, &view).unwrap();
        let basis = shot.camera.basis(shot.size).unwrap().exaggerated(shot.z_scale, view.pivot).unwrap();
        let reference = map.render(&basis, shot.size);
        let tolerance = Tolerance { cell_size: data.grid.cell(), height_step: data.grid.height_step };
        let result = compare(&reference, &basis, shot.size[0], &image.distance, &image.class, tolerance);
        let unclear = unclear(map, &basis, &reference, &image, tolerance);
        println!("{what}, {}, {unclear} unclear: {result}", shot.name);
        let differ = result.hit_or_miss_differs + result.class_differs + result.distance_differs;
        // A ray may pass several corners, each on another side.
        if result.agreement() < shot.share || (differ - unclear) as f64 > 0.001 * result.pixels as f64 {
            wrong.push(format!("{what}, {}, {unclear} unclear: {result}", shot.name));
        }
        let hits = result.hits as f64 / result.pixels as f64;
        assert!(hits > 0.002, "{what}, {}: next to nothing is in the picture", shot.name);
    }
    wrong
}

/// Pixels that differ, but not from what the reference finds a ten-thousandth of a pixel beside: rays that
/// run through corners of cells or just touch an edge, finer than the numbers of either side can tell.
fn unclear(
    map: &ColumnMap,
    basis: &RayBasis,
    reference: &[Option<Hit>],
    image: &Image,
    tolerance: Tolerance,
) -> usize {
    let agrees = |want: &Option<Hit>, k: usize, x: f64, y: f64| match want {
        None => image.class[k] == MISS_CLASS,
        Some(hit) => {
            let off = (f64::from(image.distance[k]) - hit.distance).abs();
            image.class[k] == u32::from(hit.class) && off <= tolerance.at(hit, basis, x, y)
        }
    };
    let beside = [(-1e-4, -1e-4), (1e-4, -1e-4), (-1e-4, 1e-4), (1e-4, 1e-4)];
    (0..reference.len())
        .filter(|&k| {
            let (x, y) = ((k % image.width as usize) as f64, (k / image.width as usize) as f64);
            let near = || beside.iter().any(|(dx, dy)| agrees(&map.trace(basis, x + dx, y + dy), k, x, y));
            !agrees(&reference[k], k, x, y) && near()
        })
        .count()
}

fn check_file(gpu: &Gpu, path: &Path, cell: Option<f64>, odd: bool, mask: &[u8]) -> Vec<String> {
    let data = Data::load(&[path.to_owned()], cell);
    let mut scene = data.scene(gpu, Access::Address, MEASURED());
    let mut renderer = data.renderer(&scene);
    let points = points(path, &data.placement);
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let map = ColumnMap::build(
        points.iter().copied(),
        [data.grid.cell(), data.grid.height_step],
        &ClassMask::default(),
        FLAG_WITHHELD,
    );
    println!("{name}: {} points, cell {}, {} columns", points.len(), data.grid.cell(), map.len());
    let mut shots = main_shots(&data, &map);
    if odd {
        shots.extend(odd_shots(&data));
    }
    let mut wrong = check(&data, &map, &mut scene, &mut renderer, &name, &shots);
    if !mask.is_empty() {
        let classes = ClassMask::only(mask);
        scene.set_visibility(Visibility { classes, ..MEASURED() }).unwrap();
        let map = ColumnMap::build(
            points.iter().copied(),
            [data.grid.cell(), data.grid.height_step],
            &classes,
            FLAG_WITHHELD,
        );
        wrong.extend(check(
            &data,
            &map,
            &mut scene,
            &mut renderer,
            &format!("{name}, classes {mask:?}"),
            &main_shots(&data, &map),
        ));
    }
    assert_eq!(gpu.messages(), [""; 0]);
    wrong
}

#[test]
fn real_files_are_drawn_exactly() {
    let Some(folder) = real_files() else { return };
    common::run("real_files_are_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let files: [(&str, bool, &[u8]); 8] = [
            ("urban/fusa.laz", true, &[2]),
            ("forest/MixedConifer.laz", false, &[2]),
            ("urban/multitile_delft/ahn3_cropped_2.laz", false, &[2, 9]),
            ("autzen/autzen_trim.las", true, &[1]),
            ("water/Topography.laz", false, &[2, 9]),
            ("urban/multitile_ign/test_data_77050_627755_LA93_IGN69.laz", false, &[3, 4, 5]),
            ("ground_truth/samp53-utm.laz", false, &[2]),
            ("water/corse.laz", false, &[2]),
        ];
        let wrong: Vec<_> = files
            .into_iter()
            .flat_map(|(name, odd, mask)| check_file(&gpu, &folder.join(name), None, odd, mask))
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

#[test]
fn the_town_is_drawn_exactly() {
    common::run("the_town_is_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path: PathBuf = scene::town(folder.path(), "town.las", [-80.0, -80.0], 160.0);
        let mut wrong = check_file(&gpu, &path, Some(0.5), true, &[2]);
        // Cells that no power of two divides, and sections of one column.
        wrong.extend(check_file(&gpu, &path, Some(0.7), false, &[]));
        wrong.extend(check_file(&gpu, &path, Some(40.0), false, &[]));
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}
