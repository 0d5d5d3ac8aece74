//! Pictures of mixed levels: against brute force over the same cut, and against the finest level.

use super::common::{self, LAVAPIPE, SWIFTSHADER};
use super::live::{PLENTY, World, tiles};
use super::scene::{self, MEASURED, real_files};
use super::{SIZE, cameras};
use lasray::attribute::ClassMask;
use lasray::coords::{Grid, SECTION_LOG2};
use lasray::render::camera::{Camera, Projection, RayBasis};
use lasray::render::image::Image;
use lasray::render::reference::{Column, ColumnMap, Point, Tolerance, compare};
use lasray::resident::cut::Shown;
use lasray::resident::pool::Access;
use std::collections::HashMap;
use std::path::PathBuf;

/// Suburbs, a town, a wood, and cells that are finer than a pixel from where they are seen.
const REAL: [(&str, f64); 3] =
    [("autzen/autzen_trim.las", 1.0), ("urban/fusa.laz", 0.25), ("forest/MixedConifer.laz", 0.1)];

/// Columns of every level, each from all points.
struct Levels {
    points: Vec<Point>,
    cell: f64,
    height_step: f64,
    of_level: HashMap<u8, ColumnMap>,
}

impl Levels {
    fn new(points: Vec<Point>, [cell, height_step]: [f64; 2]) -> Levels {
        Levels { points, cell, height_step, of_level: HashMap::new() }
    }

    fn level(&mut self, level: u8) -> &ColumnMap {
        let lattice = [self.cell * f64::from(level).exp2(), self.height_step];
        let points = &self.points;
        let build = || ColumnMap::build(points.iter().copied(), lattice, &ClassMask::default(), false);
        self.of_level.entry(level).or_insert_with(build)
    }

    /// Finest cells as a cut shows them: each the top of the coarser one that it lies in.
    fn of_cut(&mut self, grid: &Grid, shown: &[Shown]) -> ColumnMap {
        let mut cells: Vec<([i64; 2], Column)> = Vec::new();
        for (at, from) in shown {
            let columns = self.level(from.section.level);
            let side = 1i64 << (SECTION_LOG2 + u32::from(at.level));
            let step = 1i64 << from.section.level;
            let first = [0, 1].map(|a| grid.anchor[a] + i64::from([at.i, at.j][a]) * side);
            for j in (0..side).step_by(step as usize) {
                for i in (0..side).step_by(step as usize) {
                    let low = [first[0] + i, first[1] + j];
                    let Some(&column) = columns.column(low.map(|v| v >> from.section.level)) else {
                        continue;
                    };
                    let fine = |k: i64| [low[0] + k % step, low[1] + k / step];
                    cells.extend((0..step * step).map(|k| (fine(k), column)));
                }
            }
        }
        ColumnMap::from_cells(cells, [self.cell, self.height_step])
    }
}

/// Samples of the finest level a pixel, each way: of all pixels, and of those that these leave in doubt.
const FINER: [usize; 2] = [3, 24];

/// Pixels of a picture that show what the finest level shows nowhere within a pixel of there. `slack`: CRS units, sides of
/// two cells as they are drawn.
fn beyond_a_pixel(finest: &ColumnMap, image: &Image, basis: &RayBasis, slack: f64) -> usize {
    let [width, height] = [image.width as usize, image.height as usize];
    let beyond = |k: usize, finer: usize| {
        let [x, y] = [k % width, k / width].map(|v| v as f64);
        // From the middle of the pixel before to that of the one after.
        let steps = || (0..=2 * finer).map(move |k| k as f64 / finer as f64 - 1.0);
        let hits = steps().flat_map(|dy| steps().map(move |dx| finest.trace(basis, x + dx, y + dy)));
        let (mut least, mut most, mut missed) = (f64::INFINITY, 0.0f64, false);
        for hit in hits {
            match hit {
                Some(hit) => (least, most) = (least.min(hit.distance), most.max(hit.distance)),
                None => missed = true,
            }
        }
        // As far as a ray goes while it crosses that.
        let d = basis.direction(x, y) / basis.length(x, y);
        let slack = slack / d.x.hypot(d.y).max(d.z.abs());
        let is = f64::from(image.distance[k]);
        let within = (least - slack..=most + slack).contains(&is) || missed && is >= least - slack;
        !(if is.is_finite() { within } else { missed })
    };
    let threads = 2;
    std::thread::scope(|scope| {
        let part = |first: usize| (first..width * height).step_by(threads);
        let count =
            |first| move || part(first).filter(|&k| FINER.iter().all(|&finer| beyond(k, finer))).count();
        let counts: Vec<_> = (0..threads).map(|first| scope.spawn(count(first))).collect();
        counts.into_iter().map(|count| count.join().unwrap()).sum()
    })
}

fn check(setup: common::Setup, paths: &[PathBuf], cell: f64) -> [usize; 8] {
    let gpu = setup.gpu();
    let mut world = World::with_cell(&gpu, paths, cell, PLENTY, Access::Address, MEASURED());
    let placement = world.placement.clone();
    let points = paths.iter().flat_map(|path| scene::points(path, &placement)).collect();
    let mut levels = Levels::new(points, [cell, world.grid.height_step]);
    let mut found = [0; 8];
    let name = paths[0].file_name().unwrap().to_string_lossy().into_owned();
    let b = world.bounds;
    let mut shots = cameras(&b);
    shots.push(
        Camera::orbit(b.center(), [120.0, 12.0], (b.max - b.min).length(), Projection::default()).unwrap(),
    );
    for (k, camera) in shots.iter().enumerate() {
        let sight = world.sight(camera, 1.0);
        world.complete(&sight);
        // The sparse sample stands in only for what is not seen.
        let made = |shown: &&Shown| usize::from(shown.1.section.level) < found.len();
        let shown: Vec<_> = world.live.shown().iter().filter(made).copied().collect();
        shown.iter().for_each(|(_, from)| found[usize::from(from.section.level)] += 1);
        let image = world.picture(camera);
        let basis = camera.basis(SIZE).unwrap();
        let map = levels.of_cut(&world.grid, &shown);
        let reference = map.render(&basis, SIZE);
        let tolerance = Tolerance { cell_size: cell, height_step: world.grid.height_step };
        let result = compare(&reference, &basis, SIZE[0], &image.distance, &image.class, tolerance);
        assert!(result.hits > 500, "{name}, camera {k}: nothing is seen");
        // Cells cover up to a pixel where they are nearest.
        let nearest = reference.iter().flatten().map(|hit| hit.distance).fold(f64::INFINITY, f64::min);
        let side = cell.max(sight.pixel * if sight.eye.is_some() { nearest } else { 1.0 });
        let beyond = beyond_a_pixel(levels.level(0), &image, &basis, 2.0 * side);
        println!("{name}, camera {k}: {result}; unlike the finest beyond a pixel: {beyond}");
        let differ = result.hit_or_miss_differs + result.class_differs + result.distance_differs;
        assert!(differ * 1000 <= result.pixels, "{name}, camera {k}: {result}");
        assert!(beyond * 10_000 <= result.pixels, "{name}, camera {k}: {beyond} pixels");
    }
    assert_eq!(gpu.messages(), [""; 0]);
    found
}

#[test]
fn mixed_levels_are_what_brute_force_finds() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("cut::mixed_levels_are_what_brute_force_finds", setup, |setup| {
            let folder = tempfile::tempdir().unwrap();
            let found = check(setup, &tiles(folder.path()), 0.25);
            println!("places of each level: {found:?}");
            assert!(found[0] > 0 && found[1] > 0 && found[2] > 0, "{found:?}");
        });
    }
}

#[test]
fn mixed_levels_of_real_files_are_what_brute_force_finds() {
    let Some(folder) = real_files() else { return };
    common::run("cut::mixed_levels_of_real_files_are_what_brute_force_finds", LAVAPIPE, |setup| {
        for (name, cell) in REAL {
            let found = check(setup, &[folder.join(name)], cell);
            println!("{name}: places of each level: {found:?}");
            assert!(found[1..].iter().sum::<usize>() > 0, "{name}: {found:?}");
        }
    });
}
