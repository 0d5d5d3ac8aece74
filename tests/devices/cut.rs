//! Pictures of mixed levels: against brute force over the same cut, and against the finest level.

use super::common::{self, LAVAPIPE, SWIFTSHADER};
use super::live::{PLENTY, SURFACES, World, tiles};
use super::scene::{self, MEASURED, real_files};
use super::{SIZE, cameras};
use lasray::attribute::ClassMask;
use lasray::coords::{Grid, SECTION_LOG2};
use lasray::render::camera::{Camera, Projection, RayBasis};
use lasray::render::image::Image;
use lasray::render::reference::{ColumnMap, Hit, Point, Spacing, StackMap, Tolerance, compare};
use lasray::resident::cut::Shown;
use lasray::section::Surface;
use lasray::source::FLAG_WITHHELD;
use std::collections::HashMap;
use std::path::PathBuf;

/// Suburbs, a town, a wood, and cells that are finer than a pixel from where they are seen.
const REAL: [(&str, f64); 3] =
    [("autzen/autzen_trim.las", 1.0), ("urban/fusa.laz", 0.25), ("forest/MixedConifer.laz", 0.1)];
/// Whether stacks of these show no more than the finest level shows near there. In the last every tree is unclassified: such
/// a one may stand in coarse stacks and float in finer ones.
const AS_FINEST: [bool; 3] = [true, true, false];

/// What brute force finds: columns, or stacks.
enum Map {
    Columns(ColumnMap),
    Stacks(StackMap),
}

impl Map {
    fn build(points: &[Point], lattice: [f64; 2], surface: Surface, level: u8) -> Map {
        let (points, mask) = (points.iter().copied(), ClassMask::default());
        match surface {
            Surface::Columns => Map::Columns(ColumnMap::build(points, lattice, &mask, FLAG_WITHHELD)),
            _ => Map::Stacks(StackMap::build(points, lattice, spacing(lattice, level), &mask, FLAG_WITHHELD)),
        }
    }

    fn trace(&self, basis: &RayBasis, x: f64, y: f64) -> Option<Hit> {
        match self {
            Map::Columns(map) => map.trace(basis, x, y),
            Map::Stacks(map) => map.trace(basis, x, y),
        }
    }

    fn render(&self, basis: &RayBasis) -> Vec<Option<Hit>> {
        match self {
            Map::Columns(map) => map.render(basis, SIZE),
            Map::Stacks(map) => map.render(basis, SIZE),
        }
    }
}

/// A span reaches a cell below its points, which are at most two cells apart, rounded up to a power of two of steps. Two finest columns
/// around tell what floats, so many as those are on coarser levels.
fn spacing([cell, height_step]: [f64; 2], level: u8) -> Spacing {
    let cell_steps = cell / height_step;
    let gap = (0..62).map(|log2| 1i64 << log2).find(|&gap| gap as f64 >= 2.0 * cell_steps);
    Spacing {
        thickness: cell_steps.ceil().max(1.0) as i64,
        gap: gap.expect("cells of few steps"),
        around: [2, 1].get(usize::from(level)).copied().unwrap_or(0),
    }
}

/// Columns or stacks of every level, each from all points.
struct Levels {
    points: Vec<Point>,
    surface: Surface,
    cell: f64,
    height_step: f64,
    of_level: HashMap<u8, Map>,
}

impl Levels {
    fn new(points: Vec<Point>, surface: Surface, [cell, height_step]: [f64; 2]) -> Levels {
        Levels { points, surface, cell, height_step, of_level: HashMap::new() }
    }

    fn level(&mut self, level: u8) -> &Map {
        let lattice = [self.cell * f64::from(level).exp2(), self.height_step];
        let build = || Map::build(&self.points, lattice, self.surface, level);
        self.of_level.entry(level).or_insert_with(build)
    }

    /// Finest cells as a cut shows them: each what the coarser one holds that it lies in.
    fn of_cut(&mut self, grid: &Grid, shown: &[Shown]) -> Map {
        let (mut columns, mut stacks) = (Vec::new(), Vec::new());
        for (at, from) in shown {
            let map = self.level(from.section.level);
            let side = 1i64 << (SECTION_LOG2 + u32::from(at.level));
            let step = 1i64 << from.section.level;
            let first = [0, 1].map(|a| grid.anchor[a] + i64::from([at.i, at.j][a]) * side);
            for j in (0..side).step_by(step as usize) {
                for i in (0..side).step_by(step as usize) {
                    let low = [first[0] + i, first[1] + j];
                    let cell = low.map(|v| v >> from.section.level);
                    let fine = (0..step * step).map(|k| [low[0] + k % step, low[1] + k / step]);
                    match map {
                        Map::Columns(map) => {
                            let column = map.column(cell).copied();
                            columns.extend(fine.filter_map(|fine| Some((fine, column?))));
                        }
                        Map::Stacks(map) => {
                            let stack = map.stack(cell);
                            stacks.extend(fine.filter_map(|fine| Some((fine, stack?.clone()))));
                        }
                    }
                }
            }
        }
        let lattice = [self.cell, self.height_step];
        match self.surface {
            Surface::Columns => Map::Columns(ColumnMap::from_cells(columns, lattice)),
            _ => Map::Stacks(StackMap::from_cells(stacks, lattice)),
        }
    }
}

/// Samples of the finest level a pixel, each way: of all pixels, and of those that these leave in doubt.
const FINER: [usize; 2] = [3, 24];

/// Pixels of a picture, of one in `every` of them, that show what the finest level shows nowhere within a pixel of there, or
/// within `up` pixels up and down. `slack`: CRS units, sides of two cells as they are drawn.
fn beyond_a_pixel(
    (finest, every, up): (&Map, usize, usize),
    image: &Image,
    basis: &RayBasis,
    slack: f64,
) -> usize {
    let [width, height] = [image.width as usize, image.height as usize];
    let beyond = |k: usize, finer: usize| {
        let [x, y] = [k % width, k / width].map(|v| v as f64);
        // From the middle of the pixel before to that of the one after.
        let steps =
            |reach: usize| (0..=2 * reach * finer).map(move |k| k as f64 / finer as f64 - reach as f64);
        let hits = steps(up).flat_map(|dy| steps(1).map(move |dx| finest.trace(basis, x + dx, y + dy)));
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
        let part = |first: usize| (first * every..width * height).step_by(threads * every);
        let count =
            |first| move || part(first).filter(|&k| FINER.iter().all(|&finer| beyond(k, finer))).count();
        let counts: Vec<_> = (0..threads).map(|first| scope.spawn(count(first))).collect();
        counts.into_iter().map(|count| count.join().unwrap()).sum()
    })
}

/// `as_finest`: of stacks, see [`AS_FINEST`].
fn check(
    setup: common::Setup,
    surface: Surface,
    paths: &[PathBuf],
    (cell, as_finest): (f64, bool),
) -> [usize; 8] {
    let gpu = setup.gpu();
    let mut world = World::with_cell(&gpu, surface, paths, cell, PLENTY, MEASURED());
    let placement = world.placement.clone();
    let points = paths.iter().flat_map(|path| scene::points(path, &placement)).collect();
    let mut levels = Levels::new(points, surface, [cell, world.grid.height_step]);
    let mut found = [0; 8];
    let name = format!("{}, {}", paths[0].file_name().unwrap().to_string_lossy(), surface.name());
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
        let reference = map.render(&basis);
        let tolerance = Tolerance { cell_size: cell, height_step: world.grid.height_step };
        let result = compare(&reference, &basis, SIZE[0], &image.distance, &image.class, tolerance);
        assert!(result.hits > 500, "{name}, camera {k}: nothing is seen");
        // Cells cover up to a pixel where they are nearest.
        let nearest = reference.iter().flatten().map(|hit| hit.distance).fold(f64::INFINITY, f64::min);
        let side = cell.max(sight.pixel * if sight.eye.is_some() { nearest } else { 1.0 });
        // Of stacks one in so many pixels is looked at: a cut is the same on all drivers. Their spans go over gaps of up to four
        // cells, and end a cell below their points.
        let [every, up, most] = match surface {
            Surface::Columns => [1, 1, 10_000],
            _ if setup == LAVAPIPE && as_finest => [16, 5, 1000],
            _ => [result.pixels, 5, 1],
        };
        let beyond = beyond_a_pixel((levels.level(0), every, up), &image, &basis, 2.0 * side);
        let looked_at = result.pixels / every;
        println!("{name}, camera {k}: {result}; unlike the finest beyond a pixel: {beyond} of {looked_at}");
        let differ = result.hit_or_miss_differs + result.class_differs + result.distance_differs;
        assert!(differ * 1000 <= result.pixels, "{name}, camera {k}: {result}");
        assert!(beyond * most <= looked_at, "{name}, camera {k}: {beyond} pixels");
    }
    assert_eq!(gpu.messages(), [""; 0]);
    found
}

#[test]
fn mixed_levels_are_what_brute_force_finds() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("cut::mixed_levels_are_what_brute_force_finds", setup, |setup| {
            let folder = tempfile::tempdir().unwrap();
            for surface in SURFACES {
                let found = check(setup, surface, &tiles(folder.path()), (0.25, true));
                println!("places of each level: {found:?}");
                assert!(found[0] > 0 && found[1] > 0 && found[2] > 0, "{found:?}");
            }
        });
    }
}

#[test]
fn mixed_levels_of_real_files_are_what_brute_force_finds() {
    let Some(folder) = real_files() else { return };
    common::run("cut::mixed_levels_of_real_files_are_what_brute_force_finds", LAVAPIPE, |setup| {
        for surface in SURFACES {
            for ((name, cell), as_finest) in REAL.into_iter().zip(AS_FINEST) {
                let found = check(setup, surface, &[folder.join(name)], (cell, as_finest));
                println!("{name}: places of each level: {found:?}");
                assert!(found[1..].iter().sum::<usize>() > 0, "{name}: {found:?}");
            }
        }
    });
}
