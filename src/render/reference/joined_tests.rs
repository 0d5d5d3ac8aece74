//! Tubes and what is thick against pieces worked out by hand.

use super::tests::{ONE, point};
use super::*;
use crate::attribute::ClassMask;
use crate::coords::HEIGHT_STEP as STEP;
use crate::render::camera::{Camera, Projection, RayBasis};
use crate::source::FLAG_WITHHELD as WITHHELD;
use glam::DVec3;

/// Cells of 1: a thickness of 1, a gap of 2, jumps of more than 2.5.
fn map(points: &[Point]) -> SmoothMap {
    let spacing = Spacing { thickness: 1024, gap: 2048, around: 2 };
    let stacks =
        StackMap::build(points.iter().copied(), [1.0, STEP], spacing, &ClassMask::default(), WITHHELD);
    SmoothMap::new(stacks, 2560, 2048)
}

/// Points in the middle of cells.
fn cells(of: &[([i32; 2], u8, f64)]) -> Vec<Point> {
    of.iter().map(|&([i, j], class, u)| point(f64::from(i) + 0.5, f64::from(j) + 0.5, u, class)).collect()
}

/// One of many: tubes are as thin as they get.
fn ray(eye: [f64; 3], target: [f64; 3]) -> RayBasis {
    let narrow = Projection::Orthographic { units_per_pixel: 0.01 };
    Camera::look_at(DVec3::from(eye), DVec3::from(target), narrow).unwrap().basis(ONE).unwrap()
}

/// Height at which a ray down at a place hits, and what.
fn down(map: &SmoothMap, [e, n]: [f64; 2]) -> Option<(f64, Face)> {
    let hit = map.trace(&ray([e, n, 40.0], [e, n, 0.0]), 0.0, 0.0)?;
    Some(((hit.height * 1000.0).round() / 1000.0, hit.face))
}

fn up(map: &SmoothMap, [e, n]: [f64; 2]) -> Option<(f64, Face)> {
    let hit = map.trace(&ray([e, n, 0.0], [e, n, 40.0]), 0.0, 0.0)?;
    Some(((hit.height * 1000.0).round() / 1000.0, hit.face))
}

#[test]
fn a_lone_point_is_a_ball() {
    let map = map(&cells(&[([3, 3], 14, 10.0)]));
    // A cell is below it: the middle is half a cell down.
    assert_eq!(down(&map, [3.5, 3.5]), Some((9.7, Face::Top)));
    assert_eq!(up(&map, [3.5, 3.5]), Some((9.3, Face::Bottom)));
    assert_eq!(down(&map, [3.5, 3.71]), None);
    assert_eq!(down(&map, [3.62, 3.59]).map(|(height, _)| height), Some(9.632));
}

#[test]
fn a_wire_goes_from_border_to_border() {
    let map = map(&cells(&[([3, 3], 14, 10.0), ([4, 3], 14, 10.0), ([5, 3], 14, 11.0)]));
    // From the first column's middle to its border.
    assert_eq!(down(&map, [3.2, 3.5]), None);
    assert_eq!(down(&map, [3.75, 3.5]), Some((9.7, Face::Top)));
    // Up to the mean of both, as seen from either column; across, a tube of the slope of a half is higher.
    let higher = 0.2 * 1.25f64.sqrt();
    let wire = |e: f64| 9.5 + 0.5 * (e - 4.0) + higher;
    for e in [4.25, 4.5, 4.75] {
        let (height, face) = down(&map, [e, 3.5]).unwrap();
        assert!((height - wire(e)).abs() < 0.001 && face == Face::Top, "{e}: {height}");
    }
    let (height, _) = down(&map, [5.25, 3.5]).unwrap();
    assert!((height - (10.25 + 0.2 * 2f64.sqrt())).abs() < 0.001, "{height}");
    // As thin as that from the side.
    assert_eq!(down(&map, [4.5, 3.75]), None);
}

#[test]
fn corners_join_where_no_column_beside_does() {
    let diagonal = map(&cells(&[([3, 3], 5, 10.0), ([4, 4], 5, 10.0)]));
    assert_eq!(down(&diagonal, [3.9, 3.9]), Some((9.7, Face::Top)));
    assert_eq!(down(&diagonal, [4.1, 4.1]), Some((9.7, Face::Top)));
    // Round the corner by way of the column between: its tube cuts its own corner off.
    let bent = map(&cells(&[([3, 3], 5, 10.0), ([4, 3], 5, 10.0), ([4, 4], 5, 10.0)]));
    assert_eq!(down(&bent, [3.9, 3.9]), None);
    assert_eq!(down(&bent, [4.25, 3.75]), Some((9.7, Face::Top)));
    assert_eq!(down(&bent, [4.75, 3.25]), None);
}

#[test]
fn two_columns_abreast_are_one_wire() {
    let abreast = (2..=5).flat_map(|i| [([i, 3], 14, 10.0), ([i, 4], 14, 10.0)]);
    let map = map(&cells(&abreast.collect::<Vec<_>>()));
    for e in [3.25, 3.5, 4.0, 4.75] {
        // Along the border between them, seen from either.
        for n in [3.999, 4.0, 4.001] {
            assert_eq!(down(&map, [e, n]), Some((9.7, Face::Top)), "{e} {n}");
        }
        assert_eq!((down(&map, [e, 3.75]), down(&map, [e, 4.25])), (None, None));
    }
}

#[test]
fn other_classes_and_what_is_far_above_do_not_join() {
    for other in [([4, 3], 16, 10.0), ([4, 3], 14, 12.6), ([4, 3], 14, 7.4)] {
        let map = map(&cells(&[([3, 3], 14, 10.0), other]));
        assert_eq!(down(&map, [3.9, 3.5]), None, "{other:?}");
    }
    // Of two wires each goes on to what is nearer.
    let two = [([3, 3], 14, 10.0), ([3, 3], 14, 14.0), ([4, 3], 14, 10.5), ([4, 3], 14, 13.0)];
    let map = map(&cells(&two));
    let near = |height: Option<(f64, Face)>, want: f64| (height.unwrap().0 - want).abs() < 0.05;
    assert!(near(down(&map, [3.95, 3.5]), 13.33) && near(up(&map, [3.95, 3.5]), 9.5));
}

fn pile(cell: [i32; 2], low: i32, high: i32) -> Vec<Point> {
    (low..=high).flat_map(|u| cells(&[(cell, 5, f64::from(u))])).collect()
}

#[test]
fn a_crown_shares_its_corners() {
    let columns = (0..9).map(|k| [2 + k % 3, 2 + k / 3]);
    let map = map(&columns.flat_map(|[i, j]| pile([i, j], 4 + 2 * i, 14 + 2 * i)).collect::<Vec<_>>());
    // Tops of 18, 20 and 22, bottoms of 7, 9 and 11: means on the borders between.
    let rounded = 1.0 / 32.0;
    for (place, top, bottom) in [([3.5, 3.5], 20.0, 9.0), ([3.001, 3.5], 19.0, 8.0), ([4.5, 3.5], 21.5, 10.5)]
    {
        let (found_top, found_bottom) = (down(&map, place).unwrap(), up(&map, place).unwrap());
        assert!((found_top.0 - top).abs() <= rounded && found_top.1 == Face::Top, "{place:?}: {found_top:?}");
        assert!(
            (found_bottom.0 - bottom).abs() <= rounded && found_bottom.1 == Face::Bottom,
            "{place:?}: {found_bottom:?}"
        );
    }
    // A ray from the side meets a side between the two.
    let side = map.trace(&ray([0.0, 3.5, 15.0], [10.0, 3.5, 15.1]), 0.0, 0.0).unwrap();
    assert_eq!((side.face, side.cell), (Face::West, [2, 3]));
}

#[test]
fn what_is_thick_and_alone_stands_upright() {
    let map = map(&pile([3, 3], 10, 20));
    let round = 0.75f64.sqrt() / 2.0;
    assert_eq!(
        (down(&map, [3.5, 3.5]), up(&map, [3.5, 3.5])),
        (Some((20.0, Face::Top)), Some((9.0, Face::Bottom)))
    );
    assert!((down(&map, [3.75, 3.5]).unwrap().0 - (19.5 + round)).abs() < 0.001);
    assert_eq!(down(&map, [3.05, 3.05]), None);
    let side = map.trace(&ray([0.0, 3.75, 15.0], [10.0, 3.75, 15.0]), 0.0, 0.0).unwrap();
    assert!(side.face == Face::West && (side.distance - (3.5 - round)).abs() < 1e-6, "{side:?}");
}

#[test]
fn what_is_thin_and_one_of_many_is_a_slab() {
    let columns = (0..9).map(|k| [2 + k % 3, 2 + k / 3]);
    let map = map(&cells(&columns.map(|cell| (cell, 5, 10.0)).collect::<Vec<_>>()));
    // In the middle of an edge as in the very middle; not at the corners.
    for place in [[3.05, 3.05], [3.95, 3.5], [4.95, 3.9]] {
        assert_eq!(
            (down(&map, place), up(&map, place)),
            (Some((10.0, Face::Top)), Some((9.0, Face::Bottom)))
        );
    }
    assert_eq!(down(&map, [2.05, 2.05]), None);
}

#[test]
fn decks_of_bridges_are_no_tubes() {
    let map = map(&cells(&[([3, 3], 17, 10.0), ([4, 3], 17, 10.0)]));
    for place in [[3.05, 3.05], [3.9, 3.9], [4.5, 3.1]] {
        assert_eq!(
            (down(&map, place), up(&map, place)),
            (Some((10.0, Face::Top)), Some((9.0, Face::Bottom)))
        );
    }
}
