//! What is said to lie under the cursor, against the points themselves: the record that won the column, and what the place
//! is that the ray has hit.

use super::common::{self, LAVAPIPE};
use super::scene::{self, BRIDGED, Data, MEASURED};
use lasray::attribute::ClassMask;
use lasray::coords::SectionKey;
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Renderer, View};
use lasray::render::reference::{ColumnMap, Face, Point};
use lasray::render::screen::{PickedPoint, Screen};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::table::Table;
use lasray::section::{Columns, PayloadKey, Surface};
use lasray::source::FLAG_WITHHELD;
use lasray::source::placement::PlacementOptions;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const SIZE: [u32; 2] = [160, 96];
const CELL: f64 = 0.5;

fn houses(folder: &Path) -> PathBuf {
    scene::town(folder, "town.las", [-40.0, -40.0], 80.0)
}

/// What lies at the middles of pixels, one sample each.
fn picks(
    scene: &mut Scene,
    renderer: &mut Renderer,
    view: &View,
    table: &Arc<Table>,
    pixels: &[[u32; 2]],
) -> Vec<Option<PickedPoint>> {
    let view = View { samples: 1, ..view.clone() };
    let mut screen = Screen::default();
    screen.start(view.size);
    screen.prepare(scene, &view).unwrap();
    let mut found = Vec::new();
    for &[x, y] in pixels {
        let (mut commands, slot) = scene.order.begin_frame("picks").unwrap();
        let rows = view.size[1];
        screen.record(renderer, scene, (&mut commands, slot), &view, table, rows).unwrap();
        let at = [x, y].map(|v| f64::from(v) + 0.5);
        let at = [at[0] / f64::from(view.size[0]), at[1] / f64::from(view.size[1])];
        assert!(screen.ask(renderer, scene, (&mut commands, slot), at).unwrap());
        let point = scene.order.submit(commands).unwrap();
        scene.frame_submitted(point);
        screen.submitted(slot, point);
        scene.order.wait(point).unwrap();
        let picks = screen.take_picks(renderer, scene).unwrap();
        let [pick] = picks[..] else { panic!("{picks:?}") };
        assert_eq!(pick.at, at);
        found.push(pick.point);
    }
    found
}

/// Every so many pixels of an image, in rows that are not below each other.
fn pixels(step: u32) -> Vec<[u32; 2]> {
    let row = |y: u32| (y % step..SIZE[0]).step_by(step as usize).map(move |x| [x, y]);
    (0..SIZE[1]).step_by(7).flat_map(row).collect()
}

/// The highest point of each cell that is shown, as the file has it.
fn highest(points: &[Point], cell: f64) -> HashMap<[i64; 2], Point> {
    let mut of_cells: HashMap<[i64; 2], Point> = HashMap::new();
    for &point in points.iter().filter(|point| ClassMask::default().shows(point.class)) {
        let cell = [point.e, point.n].map(|v| (v / cell).floor() as i64);
        let highest = of_cells.entry(cell).or_insert(point);
        if point.u > highest.u {
            *highest = point;
        }
    }
    of_cells
}

#[test]
fn a_pick_is_the_record_that_won_the_column() {
    common::run("picks::a_pick_is_the_record_that_won_the_column", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = houses(folder.path());
        let data = Data::load(std::slice::from_ref(&path), Some(CELL));
        let points = scene::points(&path, &data.placement);
        let step = data.grid.height_step;
        let map =
            ColumnMap::build(points.iter().copied(), [CELL, step], &ClassMask::default(), FLAG_WITHHELD);
        let of_cells = highest(&points, CELL);
        let b = data.bounds;
        let eye = b.center().with_z(b.min.z + 12.0);
        let wide = Projection::default();
        let cameras = [
            Camera::frame(&b, [30.0, 35.0], wide, SIZE).unwrap(),
            Camera::look_at(eye, eye + glam::DVec3::new(-9.0, 31.0, -4.0), wide).unwrap(),
        ];
        let mut scene = data.scene(&gpu, Access::Address, MEASURED());
        let (mut tops, mut sides, mut unlike) = (0, 0, 0);
        for camera in &cameras {
            let basis = camera.basis(SIZE).unwrap();
            for view in [data.exact(camera, SIZE), View { slab: None, ..data.lit(camera, SIZE) }] {
                let mut renderer = data.renderer(&scene);
                let table = renderer.table(&scene);
                let pixels = pixels(7);
                let found = picks(&mut scene, &mut renderer, &view, &table, &pixels);
                for (&[x, y], pick) in pixels.iter().zip(found) {
                    let hit = map.trace(&basis, x.into(), y.into());
                    let (Some(hit), Some(pick)) = (hit, pick) else {
                        unlike += usize::from(hit.is_some() != pick.is_some());
                        continue;
                    };
                    let record = of_cells[&hit.cell];
                    let below = record.u - hit.height;
                    // Rays through the very edge of a column end elsewhere in f32.
                    let is_alike = (pick.height - record.u).abs() <= 0.51 * step
                        && pick.class == hit.class
                        && match (hit.face, pick.below) {
                            (Face::Top, None) => true,
                            (Face::Top, _) | (_, None) => false,
                            (_, Some(is)) => (is - below).abs() < 0.05 + 0.01 * below.abs(),
                        };
                    unlike += usize::from(!is_alike);
                    tops += usize::from(hit.face == Face::Top);
                    sides += usize::from(hit.face != Face::Top);
                    assert!(!pick.is_bridged && pick.coarse_cell.is_none() && !pick.stands_in, "{pick:?}");
                }
            }
        }
        println!("{tops} tops, {sides} sides, {unlike} unlike the reference");
        assert!(tops > 100 && sides > 100 && unlike * 50 <= tops + sides, "{tops} {sides} {unlike}");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn a_pick_on_a_bridge_says_so() {
    common::run("picks::a_pick_on_a_bridge_says_so", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = houses(folder.path());
        // Finer than the points lie: many cells hold none.
        let cell = 0.25;
        let data = Data::load(std::slice::from_ref(&path), Some(cell));
        let points = scene::points(&path, &data.placement);
        let of_cells = highest(&points, cell);
        let parallel = Projection::Orthographic { units_per_pixel: 0.4 };
        let camera = Camera::frame(&data.bounds, [0.0, 90.0], parallel, SIZE).unwrap();
        let mut scene = data.scene(&gpu, Access::Address, BRIDGED());
        let mut renderer = data.renderer(&scene);
        let table = renderer.table(&scene);
        let found = picks(&mut scene, &mut renderer, &data.exact(&camera, SIZE), &table, &pixels(13));
        let [mut measured, mut bridged] = [0; 2];
        for pick in found.into_iter().flatten() {
            let at = [pick.shown.x, pick.shown.y].map(|v| (v / cell).floor() as i64);
            assert_eq!(pick.below, None, "from above");
            match of_cells.get(&at) {
                Some(record) => {
                    assert!(
                        !pick.is_bridged && (pick.height - record.u).abs() <= 0.51 * data.grid.height_step
                    );
                    measured += 1;
                }
                None => {
                    assert!(pick.is_bridged, "{pick:?}");
                    bridged += 1;
                }
            }
        }
        println!("{measured} measured, {bridged} bridged");
        assert!(measured > 20 && bridged > 20);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn a_pick_on_a_coarser_cell_says_how_large_it_is_and_whether_it_stands_in() {
    let test = "picks::a_pick_on_a_coarser_cell_says_how_large_it_is_and_whether_it_stands_in";
    common::run(test, LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = houses(folder.path());
        let data = Data::load(std::slice::from_ref(&path), Some(CELL));
        let points = scene::points(&path, &data.placement);
        let of_cells = highest(&points, 2.0 * CELL);
        let options = LoadOptions {
            surface: Surface::Columns,
            cell: Some(CELL.into()),
            placement: PlacementOptions::default(),
            rgb_bits: None,
            asked: lasray::sample::Asked::default(),
            budget: Budget { host_bytes: 1 << 31, device_bytes: 1 << 30 },
            cache: None,
            quiet: true,
        };
        let loaded = load::paths(std::slice::from_ref(&path), &options, &mut Problems::default()).unwrap();
        let mut parents: HashMap<SectionKey, Columns> = HashMap::new();
        let mut children = Vec::new();
        for (key, columns) in loaded.sections {
            columns.coarsen_into(key.i, key.j, parents.entry(key.parent()).or_default());
            children.push(key);
        }
        let mut scene = data.empty(&gpu, Access::Address, |order| order, MEASURED(), 1 << 30);
        for (key, columns) in &parents {
            assert!(scene.upload(*key, &columns.pack()).unwrap());
        }
        scene.settle().unwrap();
        let camera = Camera::frame(&data.bounds, [20.0, 80.0], Projection::default(), SIZE).unwrap();
        let mut renderer = data.renderer(&scene);
        let in_their_place: Vec<_> = parents.keys().map(|&key| (key, PayloadKey::columns(key))).collect();
        let standing_in: Vec<_> =
            children.iter().map(|&key| (key, PayloadKey::columns(key.parent()))).collect();
        for (shown, stands_in) in [(in_their_place, false), (standing_in, true)] {
            let table = renderer.table_of(&scene, &shown);
            for view in [data.exact(&camera, SIZE), data.lit(&camera, SIZE)] {
                let found = picks(&mut scene, &mut renderer, &view, &table, &pixels(9));
                let [mut all, mut unlike] = [0; 2];
                for pick in found.into_iter().flatten() {
                    assert_eq!((pick.coarse_cell, pick.stands_in), (Some(2.0 * CELL), stands_in));
                    let at = [pick.shown.x, pick.shown.y].map(|v| (v / (2.0 * CELL)).floor() as i64);
                    let own = of_cells.get(&at).map(|record| (pick.height - record.u).abs());
                    all += 1;
                    // On a side, its very border may be either cell's.
                    let is_own = own.is_some_and(|off| off <= 0.51 * data.grid.height_step);
                    unlike += usize::from(pick.below.is_none() && !is_own);
                }
                assert!(all > 40 && unlike * 20 <= all, "{unlike} of {all}");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
