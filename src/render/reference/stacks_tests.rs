//! Stacks against columns made by hand, and against points looked at along rays.

use super::tests::{check_against_samples, point, ray};
use super::*;
use crate::attribute::ClassMask;
use crate::coords::HEIGHT_STEP as STEP;
use crate::source::FLAG_WITHHELD as WITHHELD;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::collections::{BTreeMap, BTreeSet};

/// Cells of 1: a thickness of 1, a gap of 2.
const SPACING: Spacing = Spacing { thickness: 1024, gap: 2048, around: 2 };

fn map(points: &[Point]) -> StackMap {
    shown(points, &ClassMask::default())
}

fn shown(points: &[Point], mask: &ClassMask) -> StackMap {
    StackMap::build(points.iter().copied(), [1.0, STEP], SPACING, mask, WITHHELD)
}

/// Points in the middle of a cell: class and height.
fn pile([i, j]: [i32; 2], of: &[(u8, f64)]) -> Vec<Point> {
    of.iter().map(|&(class, u)| point(f64::from(i) + 0.5, f64::from(j) + 0.5, u, class)).collect()
}

/// The same in cells from `first` on up to `end`.
fn piles(first: [i32; 2], end: [i32; 2], of: &[(u8, f64)]) -> Vec<Point> {
    let cells = (first[1]..end[1]).flat_map(|j| (first[0]..end[0]).map(move |i| [i, j]));
    cells.flat_map(|cell| pile(cell, of)).collect()
}

/// Class, face and cell of what the ray hits, and the hit's height.
fn hit(map: &StackMap, eye: [f64; 3], target: [f64; 3]) -> Option<(u8, Face, [i64; 2], f64)> {
    let ray = ray(eye, target);
    let hit = map.trace(&ray, 0.0, 0.0)?;
    // The distance is that of the height.
    let [direction, length] = [ray.direction(0.0, 0.0).z, ray.length(0.0, 0.0)];
    assert!((eye[2] + hit.distance / length * direction - hit.height).abs() < 1e-9, "{hit:?}");
    Some((hit.class, hit.face, hit.cell, (hit.height * 1e6).round() / 1e6))
}

/// Tops and bottoms of what floats, CRS units.
fn floating(map: &StackMap, cell: [i64; 2]) -> Vec<(u8, f64, f64)> {
    let units =
        |span: &Floating| (span.top.class, map.units(span.top.height_steps), map.units(span.bottom_steps));
    map.stack(cell).unwrap().floating.iter().map(units).collect()
}

fn solid(map: &StackMap, cell: [i64; 2]) -> Option<(u8, f64)> {
    map.stack(cell).unwrap().solid.map(|top| (top.class, map.units(top.height_steps)))
}

#[test]
fn a_wire_over_the_ground_from_all_sides() {
    let mut points = piles([0, 0], [20, 20], &[(2, 0.0)]);
    points.extend(pile([10, 10], &[(14, 10.0)]));
    let map = map(&points);
    let wire = [10, 10];
    assert_eq!(floating(&map, wire), [(14, 10.0, 9.0)]);
    assert_eq!(solid(&map, wire), Some((2, 0.0)));
    assert_eq!(hit(&map, [10.5, 10.5, 30.0], [10.5, 10.5, 0.0]), Some((14, Face::Top, wire, 10.0)));
    assert_eq!(hit(&map, [10.5, 10.5, 2.0], [10.5, 10.5, 30.0]), Some((14, Face::Bottom, wire, 9.0)));
    assert_eq!(hit(&map, [7.5, 10.5, 6.0], [10.75, 10.5, 9.25]), Some((14, Face::Bottom, wire, 9.0)));
    // As thick as it is said to be, both ends included, from each side; air above and below.
    for u in [9.0, 9.5, 10.0] {
        for (eye, face) in [
            ([0.5, 10.5], Face::West),
            ([19.5, 10.5], Face::East),
            ([10.5, 0.5], Face::South),
            ([10.5, 19.5], Face::North),
        ] {
            let eye = [eye[0], eye[1], u];
            assert_eq!(hit(&map, eye, [10.5, 10.5, u]), Some((14, face, wire, u)));
        }
    }
    for u in [0.5, 8.999, 10.001] {
        assert_eq!(hit(&map, [0.5, 10.5, u], [10.5, 10.5, u]), None);
    }
    // Below it through to the ground, over it to the ground behind.
    assert_eq!(hit(&map, [8.5, 10.5, 2.0], [10.5, 10.5, 0.0]), Some((2, Face::Top, [10, 10], 0.0)));
    assert_eq!(hit(&map, [8.5, 10.5, 12.125], [10.5, 10.5, 10.125]).unwrap().1, Face::Top);
    assert_eq!(hit(&map, [8.5, 10.5, 16.5], [10.5, 10.5, 12.5]), Some((2, Face::Top, [16, 10], 0.0)));
    assert_eq!(hit(&map, [-9.0, 10.5, -3.0], [10.5, 10.5, -3.0]), Some((2, Face::West, [0, 10], -3.0)));
    // From within.
    assert_eq!(hit(&map, [10.5, 10.5, 9.5], [10.5, 10.5, 0.0]), Some((14, Face::Inside, wire, 9.5)));
    assert_eq!(hit(&map, [10.25, 10.5, 9.5], [30.0, 10.5, 9.5]), Some((14, Face::Inside, wire, 9.5)));
    assert_eq!(hit(&map, [10.5, 10.5, 8.5], [10.5, 10.5, 0.0]), Some((2, Face::Top, wire, 0.0)));
    assert_eq!(hit(&map, [10.5, 10.5, -8.5], [10.5, 10.5, 30.0]), Some((2, Face::Inside, wire, -8.5)));
}

#[test]
fn a_ray_rises_under_a_bridge() {
    let mut points = piles([0, 0], [40, 1], &[(2, 0.0)]);
    points.extend(piles([10, 0], [30, 1], &[(17, 8.0)]));
    let map = map(&points);
    // One up in two: at 12.5 it is as high as the deck is low.
    let found = hit(&map, [0.5, 0.5, 1.0], [20.5, 0.5, 11.0]);
    assert_eq!(found, Some((17, Face::Bottom, [12, 0], 7.0)));
    assert_eq!(hit(&map, [0.5, 0.5, 3.0], [20.5, 0.5, 13.0]), Some((17, Face::West, [10, 0], 7.75)));
    assert_eq!(hit(&map, [0.5, 0.5, 3.0], [39.5, 0.5, 3.0]), None);
    assert_eq!(hit(&map, [0.5, 0.5, 6.0], [32.5, 0.5, 0.0]), Some((2, Face::Top, [32, 0], 0.0)));
}

#[test]
fn points_of_a_crown_are_one_span() {
    let mut points = piles([0, 0], [30, 1], &[(2, 0.0)]);
    points.extend(piles([10, 0], [20, 1], &[(5, 6.0), (5, 8.0), (5, 10.0), (5, 3.9)]));
    let map = map(&points);
    // Two apart is near enough; a little more is another span.
    assert_eq!(floating(&map, [12, 0]), [(5, 10.0, 5.0), (5, 3.900390625, 2.900390625)]);
    assert_eq!(hit(&map, [0.5, 0.5, 5.0], [15.5, 0.5, 5.0]), Some((5, Face::West, [10, 0], 5.0)));
    assert_eq!(hit(&map, [0.5, 0.5, 4.5], [29.5, 0.5, 4.5]), None);
    // Ground under the crown.
    assert_eq!(hit(&map, [5.5, 0.5, 2.5], [15.5, 0.5, 0.0]), Some((2, Face::Top, [15, 0], 0.0)));
    assert_eq!(hit(&map, [15.5, 0.5, 20.0], [15.5, 0.5, 0.0]), Some((5, Face::Top, [15, 0], 10.0)));
    // Hidden points hold nothing together.
    let mut points = pile([3, 0], &[(5, 6.0), (5, 8.0), (5, 10.0)]);
    points[1].flags = WITHHELD;
    let seen = |hidden_flags| {
        let map = StackMap::build(points.clone(), [1.0, STEP], SPACING, &ClassMask::all(), hidden_flags);
        floating(&map, [3, 0])
    };
    assert_eq!(seen(WITHHELD), [(5, 10.0, 9.0), (5, 6.0, 5.0)]);
    // Nor do those of other flags.
    assert_eq!(seen(0), [(5, 10.0, 9.0), (5, 8.0, 7.0), (5, 6.0, 5.0)]);
}

#[test]
fn unclassified_things_float_over_lower_points() {
    let ([west, south], [east, north]) = ([10, 10], [15, 15]);
    let above = piles([west, south], [east, north], &[(1, 6.0), (1, 7.0)]);
    // A roof: nothing is seen through it.
    let roof = map(&[piles([0, 0], [10, 20], &[(2, 0.0)]), above.clone()].concat());
    assert_eq!((solid(&roof, [12, 12]), floating(&roof, [12, 12])), (Some((1, 7.0)), vec![]));
    // But its rim: beside it is lower ground, as below eaves.
    assert_eq!(hit(&roof, [5.5, 12.5, 3.0], [12.5, 12.5, 3.0]), Some((1, Face::West, [12, 12], 3.0)));
    // A tree: three places where the ground is seen are enough, two are not, wherever they are of the 25 columns.
    let mut points = above.clone();
    points.extend(pile([10, 14], &[(2, 0.0)]));
    points.extend(pile([14, 10], &[(2, 0.0)]));
    assert_eq!(solid(&map(&points), [12, 12]), Some((1, 7.0)));
    points.extend(pile([12, 12], &[(2, 0.0)]));
    let tree = map(&points);
    assert_eq!((solid(&tree, [12, 12]), floating(&tree, [12, 12])), (Some((2, 0.0)), vec![(1, 7.0, 5.0)]));
    assert_eq!(hit(&tree, [12.5, 12.5, 3.0], [12.5, 12.5, 30.0]), Some((1, Face::Bottom, [12, 12], 5.0)));
    // Of its neighbour only two are near.
    assert_eq!((solid(&tree, [11, 12]), floating(&tree, [11, 12])), (Some((1, 7.0)), vec![]));
    // Where the ground is hidden, nothing lower is seen.
    assert_eq!(solid(&shown(&points, &ClassMask::only(&[1])), [12, 12]), Some((1, 7.0)));
    // The things above a gap float, what stands on the ground does not.
    let low = piles([west, south], [east, north], &[(2, 0.0), (1, 1.0), (1, 9.0)]);
    assert_eq!(
        (solid(&map(&low), [12, 12]), floating(&map(&low), [12, 12])),
        (Some((1, 1.0)), vec![(1, 9.0, 8.0)])
    );
    // A gap is more than two, below the things and below the lowest of what they are.
    for (u, floats) in [(4.0, false), (3.999, true)] {
        let near = map(&[above.clone(), piles([west, south], [east, north], &[(2, u)])].concat());
        assert_eq!(!floating(&near, [12, 12]).is_empty(), floats, "{u}");
    }
}

#[test]
fn lower_points_count_within_a_section() {
    // The southern and western half of the tree is in another section: what the ground tells there, counts there alone.
    let mut points = piles([250, 250], [262, 262], &[(1, 9.0)]);
    points.extend([[254, 254], [255, 255], [254, 255]].iter().flat_map(|&cell| pile(cell, &[(2, 0.0)])));
    let map = map(&points);
    assert_eq!(floating(&map, [255, 254]), [(1, 9.0, 8.0)]);
    assert_eq!(floating(&map, [254, 253]), [(1, 9.0, 8.0)]);
    assert_eq!((solid(&map, [256, 255]), solid(&map, [255, 256])), (Some((1, 9.0)), Some((1, 9.0))));
    // And the cell before the first of all is of another section than that.
    let shift = |p: &Point| Point { e: p.e - 256.0, n: p.n - 256.0, ..*p };
    let map = self::map(&points.iter().map(shift).collect::<Vec<_>>());
    assert_eq!(floating(&map, [-1, -2]), [(1, 9.0, 8.0)]);
    assert_eq!(solid(&map, [0, -1]), Some((1, 9.0)));
}

#[test]
fn of_what_stands_on_the_ground_the_highest_counts() {
    // A wall to the ground under what is unclassified: of the building only its top is known.
    let points = piles([0, 0], [5, 5], &[(1, 11.0), (6, 10.0), (6, 0.0)]);
    assert_eq!(solid(&map(&points), [2, 2]), Some((1, 11.0)));
    let points = piles([0, 0], [5, 5], &[(1, 11.0), (6, 10.0), (2, 0.0)]);
    assert_eq!(
        (solid(&map(&points), [2, 2]), floating(&map(&points), [2, 2])),
        (Some((6, 10.0)), vec![(1, 11.0, 10.0)])
    );
    // What does not come out of what is solid is not there; of some as high as each other the larger record does.
    let points = pile([0, 0], &[(5, 3.0), (6, 10.0), (14, 10.0), (5, 10.0), (5, 12.0)]);
    assert_eq!(
        (solid(&map(&points), [0, 0]), floating(&map(&points), [0, 0])),
        (Some((6, 10.0)), vec![(5, 12.0, 9.0), (14, 10.0, 9.0)])
    );
}

#[test]
fn the_larger_record_wins() {
    let map = map(&[
        pile([0, 0], &[(5, 8.0), (5, 6.0), (5, 4.0), (14, 7.0)]),
        pile([10, 0], &[(5, 8.0), (14, 8.0), (2, 7.5)]),
        pile([20, 0], &[(5, 8.0), (14, 8.5)]),
    ]
    .concat());
    let level =
        |i: f64, u: f64| hit(&map, [i - 2.0, 0.5, u], [i, 0.5, u]).map(|(class, face, ..)| (class, face));
    // Below the first of them there is air, up to the third.
    assert_eq!(
        (level(0.5, 6.5), level(0.5, 3.0), level(0.5, 2.9)),
        (Some((5, Face::West)), Some((5, Face::West)), Some((2, Face::West)))
    );
    let up = |i: f64| hit(&map, [i, 0.5, 0.0], [i, 0.5, 9.0]).map(|(class, face, _, u)| (class, face, u));
    let down = |i: f64| hit(&map, [i, 0.5, 20.0], [i, 0.5, 9.0]).map(|(class, face, _, u)| (class, face, u));
    assert_eq!((up(0.5), down(0.5)), (Some((5, Face::Bottom, 3.0)), Some((5, Face::Top, 8.0))));
    // As high: the class decides; what floats is before what it comes out of.
    assert_eq!(down(10.5), Some((14, Face::Top, 8.0)));
    assert_eq!((level(10.5, 7.25), level(10.5, 6.5)), (Some((14, Face::West)), Some((2, Face::West))));
    assert_eq!(up(10.5), Some((2, Face::Inside, 0.0)));
    // From below the lower bottom is first, from the side the higher top.
    assert_eq!((up(20.5), level(20.5, 7.75)), (Some((5, Face::Bottom, 7.0)), Some((14, Face::West))));
}

#[test]
fn where_nothing_floats_stacks_are_columns() {
    let mut rng = StdRng::seed_from_u64(3);
    let solid = [2, 6, 9, 10, 11, 41];
    let points: Vec<Point> = (0..4000)
        .map(|_| {
            let [e, n, u] = [30.0, 30.0, 8.0].map(|most: f64| rng.random_range(0.0..most));
            point(e, n, u, solid[rng.random_range(0..solid.len())])
        })
        .collect();
    let (stacks, columns) = (
        map(&points),
        ColumnMap::build(points.iter().copied(), [1.0, STEP], &ClassMask::default(), WITHHELD),
    );
    assert_eq!(stacks.cells().count(), columns.len());
    for _ in 0..2000 {
        let mut place = |low: f64, high: f64| {
            [(-20.0, 50.0), (-20.0, 50.0), (low, high)].map(|(low, high)| rng.random_range(low..high))
        };
        let ray = ray(place(-5.0, 40.0), place(0.0, 8.0));
        assert_eq!(stacks.trace(&ray, 0.0, 0.0), columns.trace(&ray, 0.0, 0.0));
    }
}

/// Things that stand and float, in cells of `cell`.
fn scene(seed: u64, cell: f64) -> Vec<Point> {
    let mut rng = StdRng::seed_from_u64(seed);
    let classes = [1, 2, 5, 6, 14];
    (0..1500)
        .map(|_| {
            let [e, n] =
                [0; 2].map(|_| (f64::from(rng.random_range(0..24)) + rng.random_range(0.2..0.8)) * cell);
            let u = if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..14.0) };
            point(e, n, u * cell, if u == 0.0 { 2 } else { classes[rng.random_range(0..classes.len())] })
        })
        .collect()
}

/// What a section keeps of a column's points, and what spans come of that: by class, flags and slice the highest point and
/// the lowest height, of what always stands the highest point alone. And the lowest of all heights.
fn from_slices(points: &[Column], gap: i64) -> (BTreeSet<(Column, i64)>, Option<i64>) {
    let mut runs: BTreeMap<(u8, u8, i64), (Column, i64)> = BTreeMap::new();
    for &point in points {
        let (height, stands) = (point.height_steps, [2, 6, 9, 10, 11, 41].contains(&point.class));
        let slice = if stands { 0 } else { height.div_euclid(gap) };
        let run = runs.entry((point.class, point.flags, slice)).or_insert((point, height));
        *run = (run.0.max(point), if stands { run.0.max(point).height_steps } else { run.1.min(height) });
    }
    let mut downward: Vec<(Column, i64)> = runs.into_values().collect();
    downward.sort_unstable_by(|a, b| b.cmp(a));
    let lowest = downward.iter().map(|(_, low)| *low).min();
    let mut spans: Vec<(Column, i64)> = Vec::new();
    for run in downward {
        let key = |column: &Column| (column.class, column.flags);
        match spans.iter_mut().rev().find(|span| key(&span.0) == key(&run.0)) {
            Some(span) if span.1 - run.0.height_steps <= gap => span.1 = run.1,
            _ => spans.push(run),
        }
    }
    (spans.into_iter().collect(), lowest)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn walk_among_stacks_agrees_with_sampling(
        seed in 0u64..6, cell in prop_oneof![Just(1.0), Just(0.3)], round: bool,
        eye in [-6.0f64..30.0, -6.0f64..30.0, -3.0f64..18.0], target in [0.0f64..24.0, 0.0f64..24.0, -1.0f64..14.0],
    ) {
        // Half of the rays start and aim at cell corners.
        let place = |v: [f64; 3]| (if round { v.map(f64::round) } else { v }).map(|v| v * cell);
        let (eye, target) = (place(eye), place(target));
        prop_assume!(eye != target);
        let gap = if cell == 1.0 { 2048 } else { 1024 };
        let spacing = Spacing { thickness: (cell / STEP).ceil() as i64, gap, around: 2 };
        let map = StackMap::build(scene(seed, cell), [cell, STEP], spacing, &ClassMask::all(), 0);
        let ray = ray(eye, target);
        check_against_samples(map.trace(&ray, 0.0, 0.0), cell, &ray, |cell, [low, high]| {
            map.stack(cell).is_some_and(|stack| {
                let meets = |f: &Floating| low <= map.units(f.top.height_steps) && map.units(f.bottom_steps) <= high;
                stack.solid.is_some_and(|top| low <= map.units(top.height_steps)) || stack.floating.iter().any(meets)
            })
        })?;
    }

    #[test]
    fn slices_keep_what_spans_are_made_of(
        points in prop::collection::vec((0usize..5, -600i64..600, 0u8..3), 1..40),
    ) {
        let (classes, gap) = ([1, 2, 5, 6, 14], 64);
        let column = |(class, height_steps, flags): (usize, i64, u8)| Column {
            height_steps, class: classes[class], intensity: 0, rgb: [0; 3], returns: 0, flags: flags & 1,
        };
        let points: Vec<Column> = points.into_iter().map(column).collect();
        prop_assert_eq!(stacks::spans_of(points.clone(), gap), from_slices(&points, gap));
    }
}
