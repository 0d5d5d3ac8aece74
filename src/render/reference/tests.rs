//! The reference against figures that are known, and against points looked at along rays.

use super::columns::Index;
use super::*;
use crate::attribute::ClassMask;
use crate::coords::HEIGHT_STEP as STEP;
use crate::render::camera::{Camera, Projection, RayBasis};
use crate::render::image::MISS_CLASS;
use crate::source::FLAG_WITHHELD as WITHHELD;
use glam::DVec3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng, rngs::StdRng, seq::SliceRandom};

pub(super) const ONE: [u32; 2] = [1, 1];

pub(super) fn point(e: f64, n: f64, u: f64, class: u8) -> Point {
    Point { e, n, u, class, intensity: 0, rgb: [0; 3], returns: 0x11, flags: 0 }
}

fn map(points: &[Point]) -> ColumnMap {
    ColumnMap::build(points.iter().copied(), [1.0, STEP], &ClassMask::default(), WITHHELD)
}

/// The one ray from `eye` to `target`.
pub(super) fn ray(eye: [f64; 3], target: [f64; 3]) -> RayBasis {
    let (eye, target) = (DVec3::from(eye), DVec3::from(target));
    Camera::look_at(eye, target, Projection::default()).unwrap().basis(ONE).unwrap()
}

/// The middle ray hits `face` of `cell` after `distance`.
fn expect(map: &ColumnMap, ray: RayBasis, face: Face, cell: [i64; 2], distance: f64) {
    let hit = map.trace(&ray, 0.0, 0.0).expect("a hit");
    assert_eq!((hit.face, hit.cell), (face, cell));
    assert!((hit.distance - distance).abs() < 1e-9, "{} for {distance}", hit.distance);
}

#[test]
fn single_column_from_all_sides() {
    let map = map(&[point(10.5, 20.5, 3.0, 6)]);
    let cell = [10, 20];
    expect(&map, ray([10.5, 20.5, 13.0], [10.5, 20.5, 0.0]), Face::Top, cell, 10.0);
    expect(&map, ray([0.0, 20.5, 1.0], [10.5, 20.5, 1.0]), Face::West, cell, 10.0);
    expect(&map, ray([21.0, 20.5, 1.0], [10.5, 20.5, 1.0]), Face::East, cell, 10.0);
    expect(&map, ray([10.5, 10.0, -50.0], [10.5, 20.5, -50.0]), Face::South, cell, 10.0);
    expect(&map, ray([10.5, 31.0, 3.0], [10.5, 20.5, 3.0]), Face::North, cell, 10.0);
    expect(&map, ray([10.5, 20.5, 1.0], [10.5, 20.5, 9.0]), Face::Inside, cell, 0.0);
    // Down a slope of 1 in 1, onto the top and onto the side.
    expect(&map, ray([7.25, 20.5, 6.0], [10.25, 20.5, 3.0]), Face::Top, cell, 18f64.sqrt());
    expect(&map, ray([7.0, 20.5, 5.0], [10.0, 20.5, 2.0]), Face::West, cell, 18f64.sqrt());
    // From below, up through the open air beside it, and above it.
    expect(&map, ray([7.0, 20.5, -1.0], [10.0, 20.5, 2.0]), Face::West, cell, 18f64.sqrt());
    for (eye, target) in [
        ([10.5, 20.5, 3.5], [10.5, 20.5, 9.0]),
        ([7.0, 20.5, 1.0], [10.0, 20.5, 4.0]),
        ([0.0, 20.5, 3.001], [10.0, 20.5, 3.001]),
        ([9.5, 20.5, 9.0], [9.5, 20.5, 0.0]),
        ([20.0, 20.5, 1.0], [30.0, 20.5, 1.0]),
    ] {
        assert_eq!(map.trace(&ray(eye, target), 0.0, 0.0), None, "{eye:?} to {target:?}");
    }
}

#[test]
fn cells_are_half_open() {
    let map = map(&[point(0.0, 0.0, 5.0, 2)]);
    let down = |e, n| map.trace(&ray([e, n, 9.0], [e, n, 0.0]), 0.0, 0.0).is_some();
    assert!(down(0.0, 0.0) && down(0.999, 0.999));
    assert!(!down(1.0, 0.5) && !down(0.5, 1.0) && !down(-1e-5, 0.5));
    let north = |e| map.trace(&ray([e, -4.0, 1.0], [e, 4.0, 1.0]), 0.0, 0.0).is_some();
    assert!(north(0.0) && !north(1.0), "along a border");
    let across = |from: [f64; 2], to: [f64; 2]| {
        map.trace(&ray([from[0], from[1], 1.0], [to[0], to[1], 1.0]), 0.0, 0.0).map(|hit| hit.distance)
    };
    // Diagonals that touch one corner point each: only the south-west one belongs to the cell.
    assert!((across([-2.0, 2.0], [2.0, -2.0]).unwrap() - 8f64.sqrt()).abs() < 1e-12);
    assert!((across([2.0, -2.0], [-2.0, 2.0]).unwrap() - 8f64.sqrt()).abs() < 1e-12);
    assert_eq!(across([-1.0, 3.0], [3.0, -1.0]), None);
    assert_eq!(across([3.0, -1.0], [-1.0, 3.0]), None);
    assert_eq!(across([-2.0, -1.0], [2.0, 3.0]), None);
    assert_eq!(across([2.0, 3.0], [-2.0, -1.0]), None);
    // Through two opposite corners.
    assert!((across([-2.0, -2.0], [2.0, 2.0]).unwrap() - 8f64.sqrt()).abs() < 1e-12);
    assert!((across([2.0, 2.0], [-2.0, -2.0]).unwrap() - 2f64.sqrt()).abs() < 1e-12);
}

#[test]
fn exaggerated_view_measures_what_is_seen() {
    let map = map(&[point(0.5, 10.5, 3.0, 6)]);
    let shown = ray([0.5, 10.5, 26.0], [0.5, 10.5, 0.0]).exaggerated(2.0, 1.0).unwrap();
    let hit = map.trace(&shown.advance(7.0), 0.0, 0.0).unwrap();
    // U 3 is shown at 1 + 2 · 2 = 5.
    assert_eq!((hit.distance, hit.height, hit.face), (21.0, 3.0, Face::Top));
}

#[test]
fn fifty_kilometres_and_a_far_northing_change_nothing() {
    let near = map(&[point(3.5, 7.5, 12.0, 6), point(4.5, 7.5, 9.0, 2)]);
    let (e, n) = (500_000.0, 6_000_000.0);
    let far = map(&[point(e + 3.5, n + 7.5, 12.0, 6), point(e + 4.5, n + 7.5, 9.0, 2)]);
    let (a, b) = (
        near.trace(&ray([3.5, -50_000.0, 10_000.0], [3.5, 7.25, 12.0]), 0.0, 0.0).unwrap(),
        far.trace(&ray([e + 3.5, n - 50_000.0, 10_000.0], [e + 3.5, n + 7.25, 12.0]), 0.0, 0.0).unwrap(),
    );
    assert_eq!((a.face, a.height), (Face::Top, 12.0));
    assert!((a.distance - b.distance).abs() < 1e-6 && a.face == b.face);
    assert_eq!([a.cell[0] + 500_000, a.cell[1] + 6_000_000], b.cell);
}

#[test]
fn winner_is_the_same_in_any_order() {
    let mut rng = StdRng::seed_from_u64(7);
    let mut points: Vec<Point> = (0..20_000)
        .map(|_| Point {
            e: rng.random_range(0.0..8.0),
            n: rng.random_range(0.0..8.0),
            u: f64::from(rng.random_range(0..3)),
            class: rng.random_range(0..4),
            intensity: rng.random_range(0..3),
            rgb: [rng.random_range(0..3), rng.random_range(0..3), 0],
            returns: rng.random_range(0..2),
            flags: rng.random_range(0..8),
        })
        .collect();
    let winners = |points: &[Point]| {
        let map = map(points);
        (0..8).flat_map(|j| (0..8).map(move |i| [i, j])).map(|c| map.column(c).copied()).collect::<Vec<_>>()
    };
    let before = winners(&points);
    points.shuffle(&mut rng);
    assert_eq!(before, winners(&points));
    assert!(
        before.iter().flatten().all(|c| c.height_steps == 2048 && c.class == 3 && c.flags & WITHHELD == 0)
    );
}

#[test]
fn mask_and_rounding_decide_the_top() {
    let all = [point(0.5, 0.5, 1.0, 2), point(0.5, 0.5, 4.0001, 5), point(0.5, 0.5, 90.0, 7)];
    let top = |mask: &ClassMask| {
        ColumnMap::build(all, [1.0, STEP], mask, WITHHELD).column([0, 0]).map(|c| (c.height_steps, c.class))
    };
    assert_eq!(top(&ClassMask::default()), Some((4097, 5)));
    assert_eq!(top(&ClassMask::default().without(&[5])), Some((1024, 2)));
    assert_eq!(top(&ClassMask::all()), Some((90 * 1024, 7)));
    assert_eq!(top(&ClassMask::only(&[6])), None);
    let mut withheld = point(0.5, 0.5, 50.0, 2);
    withheld.flags = WITHHELD;
    let seen = |hidden| ColumnMap::build([withheld], [1.0, STEP], &ClassMask::default(), hidden).len();
    assert_eq!([WITHHELD, 12, 0, 8, 11].map(seen), [0, 0, 1, 1, 1]);
    let odd = [point(f64::NAN, 0.0, 0.0, 2), point(0.0, 0.0, f64::INFINITY, 2), point(1e300, 0.0, 0.0, 2)];
    assert!(map(&odd).is_empty());
    assert_eq!(map(&odd).trace(&ray([0.0; 3], [1.0; 3]), 0.0, 0.0), None);
}

/// A small town of columns around (e, n), some cells empty.
fn town(seed: u64, cell: f64, e: f64, n: f64) -> Vec<Point> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut points = Vec::new();
    for j in 0..24 {
        for i in 0..24 {
            if rng.random_bool(0.8) {
                let u = if rng.random_bool(0.15) {
                    rng.random_range(2.0..9.0)
                } else {
                    rng.random_range(0.0..1.0)
                };
                let at = |k: i32| (f64::from(k) + rng.random_range(0.2..0.8)) * cell;
                let [x, y] = [i, j].map(at);
                points.push(point(e + x, n + y, u * cell, rng.random_range(0..7)));
            }
        }
    }
    points
}

/// The image by looking at points along the ray, a thousandth of a cell apart. Nothing
/// may lie before the hit, and something must lie at it: `holds` says whether anything does in a cell between two heights.
pub(super) fn check_against_samples(
    hit: Option<Hit>,
    c: f64,
    basis: &RayBasis,
    holds: impl Fn([i64; 2], [f64; 2]) -> bool,
) -> Result<(), TestCaseError> {
    let (o, d) = (basis.origin(0.0, 0.0), basis.direction(0.0, 0.0));
    let solid = |t: f64| {
        let p = o + d * t;
        holds([(p.x / c).floor() as i64, (p.y / c).floor() as i64], [p.z; 2])
    };
    let (unit, step) = (basis.length(0.0, 0.0), c / 1000.0);
    // Off the eye, coordinates at a far northing are good to 1e-9.
    let blur = 1e-8 * c.max(1.0) / unit;
    let end = hit.map_or(70.0 * c, |h| h.distance) / unit;
    let mut t = 0.0;
    while t < end - blur {
        // A sample that grazes a border within the blur says nothing.
        prop_assert!(
            !(solid(t) && solid(t - blur) && solid(t + blur)) || t < blur,
            "solid at {t}, before {hit:?}"
        );
        t += step / unit;
    }
    if let Some(hit) = hit {
        // Around and not only behind: a ray may touch no more than the corner of a cell.
        let p = o + d * (hit.distance / unit);
        let near = [-1.0, 0.0, 1.0].map(|k| k * blur * unit);
        let around = near.iter().any(|x| {
            near.iter().any(|y| {
                let cell = [((p.x + x) / c).floor() as i64, ((p.y + y) / c).floor() as i64];
                cell == hit.cell && holds(cell, [p.z + near[0], p.z + near[2]])
            })
        });
        prop_assert!(around, "nothing at {hit:?}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn walk_agrees_with_sampling(
        seed in 0u64..6, cell in prop_oneof![Just(1.0), Just(0.3), Just(2.5)], far: bool,
        eye in [-10.0f64..34.0, -10.0f64..34.0, -3.0f64..20.0], target in [0.0f64..24.0, 0.0f64..24.0, -1.0f64..6.0],
        round: bool,
    ) {
        // Half of the rays start and aim at cell corners.
        let place = |v: [f64; 3]| {
            let v = if round { v.map(f64::round) } else { v };
            let (e, n) = if far { (500_000.0, 6_000_000.0) } else { (0.0, 0.0) };
            [e + v[0] * cell, n + v[1] * cell, v[2] * cell]
        };
        let (eye, target, origin) = (place(eye), place(target), place([0.0; 3]));
        prop_assume!(eye != target);
        let points = town(seed, cell, origin[0], origin[1]);
        let map = ColumnMap::build(points, [cell, STEP], &ClassMask::all(), 0);
        let ray = ray(eye, target);
        check_against_samples(map.trace(&ray, 0.0, 0.0), cell, &ray, |cell, [low, _]| {
            map.column(cell).is_some_and(|column| low <= map.top(column))
        })?;
    }
}

#[test]
fn flat_array_and_hash_map_agree() {
    let mut points = town(3, 1.0, 0.0, 0.0);
    let dense = map(&points);
    points.push(point(185_000.0, 90_000.0, 0.0, 2));
    let sparse = map(&points);
    assert!(matches!(dense.index, Index::Dense(_)) && matches!(sparse.index, Index::Sparse(_)));
    let eye = DVec3::new(12.0, -20.0, 25.0);
    let camera = Camera::look_at(eye, DVec3::new(12.0, 12.0, 0.0), Projection::default()).unwrap();
    let basis = camera.basis([32, 24]).unwrap();
    let (a, b) = (dense.render(&basis, [32, 24]), sparse.render(&basis, [32, 24]));
    assert_eq!(a, b);
    assert!(a.iter().flatten().count() > 200 && a.contains(&None));
    assert_eq!(a[5 * 32 + 9], dense.trace(&basis, 9.0, 5.0));
}

/// Planes as a perfect renderer writes them.
fn planes(hits: &[Option<Hit>]) -> (Vec<f32>, Vec<u32>) {
    let distance = |h: &Option<Hit>| h.map_or(f32::INFINITY, |h| h.distance as f32);
    let class = |h: &Option<Hit>| h.map_or(MISS_CLASS, |h| h.class.into());
    (hits.iter().map(distance).collect(), hits.iter().map(class).collect())
}

#[test]
fn comparison_finds_what_differs_and_nothing_else() {
    let map = map(&town(1, 1.0, 0.0, 0.0));
    let size = [40, 30];
    let camera =
        Camera::look_at(DVec3::new(12.0, -6.0, 30.0), DVec3::new(12.0, 12.0, 0.0), Projection::default());
    let basis = camera.unwrap().basis(size).unwrap();
    let hits = map.render(&basis, size);
    let tolerance = Tolerance { cell_size: 1.0, height_step: STEP };
    let run = |(distance, class): (Vec<f32>, Vec<u32>)| {
        compare(&hits, &basis, size[0], &distance, &class, tolerance)
    };
    let perfect = run(planes(&hits));
    assert!(perfect.agrees(1.0) && perfect.loose == 0 && perfect.hits > 300, "{perfect}");

    let hit = hits.iter().position(Option::is_some).unwrap();
    let miss = hits.iter().position(Option::is_none).unwrap();
    let mut wrong = planes(&hits);
    wrong.0[hit] += 0.1;
    let result = run(wrong.clone());
    assert!(!result.agrees(0.9) && result.distance_differs == 1 && result.agreement() == 1.0);
    assert!(result.to_string().contains("tolerances off"), "{result}");
    wrong.1[hit] = 99;
    wrong.0[miss] = 4.0;
    let result = run(wrong);
    assert_eq!((result.class_differs, result.hit_or_miss_differs, result.distance_differs), (1, 1, 0));
    assert!(result.to_string().contains("should miss") && result.agrees(0.99) && !result.agrees(0.9999));

    // Stored heights one step up are within the tolerance, eight are not.
    let raised = |steps: i64| {
        let cells = (0..24).flat_map(|j| (0..24).map(move |i| [i, j])).filter_map(|cell| {
            let column = *map.column(cell)?;
            Some((cell, Column { height_steps: column.height_steps + steps, ..column }))
        });
        run(planes(&ColumnMap::from_cells(cells, [1.0, STEP]).render(&basis, size)))
    };
    assert!(raised(1).agreement() > 0.99 && raised(1).distance_differs == 0, "{}", raised(1));
    assert!(raised(8).distance_differs > 100, "{}", raised(8));
}

#[test]
fn plumb_rays_are_checked_tightly() {
    let map = map(&[point(0.5, 0.5, 3.0, 6)]);
    let down = ray([0.5, 0.5, 13.0], [0.5, 0.5, 0.0]);
    let hit = map.trace(&down, 0.0, 0.0).unwrap();
    let tolerance = Tolerance { cell_size: 1.0, height_step: STEP };
    assert!(tolerance.at(&hit, &down, 0.0, 0.0) < 1.1 / 1024.0);
    // A level ray onto a side says little about heights: allowed, and counted.
    let level = ray([-9.0, 0.5, 1.0], [0.0, 0.5, 1.0]);
    let hits = map.render(&level, ONE);
    let (distance, class) = planes(&hits);
    assert_eq!(compare(&hits, &level, 1, &distance, &class, tolerance).loose, 1);
}
