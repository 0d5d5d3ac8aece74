//! Where points of some classes may lie of which a sample has seen a few: what is framed of them.

use crate::coords::Bounds;
use glam::DVec3;

/// Cells each way, at most, of which each is judged by itself.
const MOST_CELLS: usize = 32;
/// Points that a cell should have on average.
const CELL_POINTS: usize = 64;
/// Parts of a cell each way. Points in one part are neighbours, most often of one class: together they count once.
const PARTS: usize = 8;
/// Parts with points in them, from which on a cell has been seen.
const SEEN_PARTS: u32 = 16;
/// How many parts with points that are asked for a cell without any should have had, to be believed: a cell where there
/// are some shows none with a probability of 2 %.
const MISSED_PARTS: f64 = 4.0;

/// Which of `points`, each with whether it is asked for, are to be framed so that what is asked for and was not sampled is
/// not cut off: those, and all in cells that were not seen well enough to say that there is none. Of those
/// outside of `bounds` the former.
pub(super) fn may_hold(bounds: &Bounds, points: &[(DVec3, bool)]) -> Vec<bool> {
    let side = (points.len() / CELL_POINTS).isqrt().clamp(1, MOST_CELLS);
    let size = bounds.size();
    let cell_and_part = |point: DVec3| {
        let at = DVec3::select(size.cmpgt(DVec3::ZERO), (point - bounds.min) / size, DVec3::ZERO);
        let is_inside =
            at.truncate().cmpge(glam::DVec2::ZERO).all() && at.truncate().cmple(glam::DVec2::ONE).all();
        let index = |v: f64| ((v * (side * PARTS) as f64) as usize).min(side * PARTS - 1);
        let (x, y) = (index(at.x), index(at.y));
        is_inside.then_some(((y / PARTS) * side + x / PARTS, (y % PARTS) * PARTS + x % PARTS))
    };
    // Bits: the parts with any points, and with such as are asked for.
    let mut cells = vec![[0u64; 2]; side * side];
    for &(point, is_asked) in points {
        if let Some((cell, part)) = cell_and_part(point) {
            cells[cell][0] |= 1 << part;
            cells[cell][1] |= u64::from(is_asked) << part;
        }
    }
    let parts = |[any, asked]: &[u64; 2]| [any.count_ones(), asked.count_ones()];
    // The share where there are some: of four such cells, three have more.
    let mut shares: Vec<f64> = cells
        .iter()
        .map(parts)
        .filter(|[any, asked]| *any >= SEEN_PARTS && *asked > 0)
        .map(|[any, asked]| f64::from(asked) / f64::from(any))
        .collect();
    shares.sort_by(f64::total_cmp);
    let share = shares.get(shares.len() / 4).copied().unwrap_or(0.0);
    let is_without = |cell: &[u64; 2]| {
        let [any, asked] = parts(cell);
        asked == 0 && any >= SEEN_PARTS && f64::from(any) * share >= MISSED_PARTS
    };
    let may: Vec<bool> = cells.iter().map(|cell| !is_without(cell)).collect();
    points
        .iter()
        .map(|(point, is_asked)| *is_asked || cell_and_part(*point).is_some_and(|(cell, _)| may[cell]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    const BOX: Bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(1000.0, 1000.0, 10.0) };

    /// `n` points all over the box, asked for where `asked` says so of E, N and a number from 0 to 1.
    fn all_over(n: usize, asked: impl Fn(f64, f64, f64) -> bool) -> Vec<(DVec3, bool)> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(1);
        let mut number = || random.random::<f64>();
        (0..n)
            .map(|_| {
                let [x, y, z] = [(); 3].map(|()| 1000.0 * number());
                (DVec3::new(x, y, 0.01 * z), asked(x, y, number()))
            })
            .collect()
    }

    /// The box around what is framed.
    fn framed(points: &[(DVec3, bool)]) -> Bounds {
        let may = may_hold(&BOX, points);
        let kept: Vec<DVec3> = points.iter().zip(may).filter(|(_, may)| *may).map(|((p, _), _)| *p).collect();
        Bounds::around(&kept).unwrap()
    }

    #[test]
    fn a_village_is_framed_by_itself_where_the_sample_has_seen_all_around_it() {
        let village =
            |x: f64, y: f64, n: f64| (400.0..600.0).contains(&x) && (300.0..500.0).contains(&y) && n < 0.3;
        let found = framed(&all_over(65_536, village));
        assert!(found.min.x > 330.0 && found.max.x < 670.0, "{found:?}");
        assert!(found.min.y > 230.0 && found.max.y < 570.0, "{found:?}");
    }

    #[test]
    fn what_is_rare_is_framed_with_all_where_more_of_it_may_be() {
        // One point in 500: most places that hold some have shown none.
        let found = framed(&all_over(65_536, |x, _, n| x < 300.0 && n < 0.002));
        assert!(found.min.x < 10.0 && found.max.x > 990.0, "{found:?}");
        // Of a few points that are neighbours nothing follows for what lies beside them.
        let mut runs = all_over(4096, |x, _, _| x < 300.0);
        runs.iter_mut()
            .for_each(|(point, _)| *point = (*point / 250.0).floor() * 250.0 + (*point % 250.0) * 0.01);
        let found = framed(&runs);
        assert!(found.max.x > 740.0, "{found:?}");
    }
}
