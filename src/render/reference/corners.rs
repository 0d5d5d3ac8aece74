//! Surfaces that are bilinear between the corners of a column: of what is solid, and tops and bottoms of what floats.

use super::trace::{Contact, Face, Stay};
use glam::DVec3;

/// Corners of a column, U: south-west, south-east, north-west, north-east.
pub(super) type Corners = [f64; 4];

/// Of the surface between the corners of a column.
pub(super) fn normal_of([sw, se, nw, ne]: Corners, cell: [i64; 2], place: DVec3, size: f64) -> DVec3 {
    let [x, y] =
        [place.x / size - cell[0] as f64, place.y / size - cell[1] as f64].map(|v| v.clamp(0.0, 1.0));
    let mix = |a: f64, b: f64, at: f64| a + (b - a) * at;
    DVec3::new(-mix(se - sw, ne - nw, y) / size, -mix(nw - sw, ne - se, x) / size, 1.0).normalize()
}

/// Mean height of those of four columns in a circle around a corner that hang together with the first: each differs from one
/// beside it by no more than `jump`.
pub(super) fn mean_corner(tops: [Option<i64>; 4], jump: i64) -> Option<i64> {
    tops[0]?;
    let mut hangs_together = [true, false, false, false];
    // As far as any is from the first.
    for _ in 0..3 {
        for k in 0..4 {
            let beside = [(k + 1) % 4, (k + 3) % 4];
            let joins = |&n: &usize| {
                hangs_together[n] && tops[n].zip(tops[k]).is_some_and(|(a, b)| (a - b).abs() <= jump)
            };
            hangs_together[k] |= beside.iter().any(joins);
        }
    }
    let those = (0..4).filter(|&k| hangs_together[k]).filter_map(|k| tops[k]);
    let (sum, n) = those.fold((0, 0), |(sum, n), top| (sum + top, n + 1));
    Some(sum.div_euclid(n))
}

impl Stay {
    /// The first contact with what is solid below a surface between `corners`, in cells of `size`.
    pub(super) fn surface_contact(&self, size: f64, [sw, se, nw, ne]: Corners) -> Option<Contact> {
        let (o, d) = (self.origin, self.direction);
        let start = o + d * self.t_in;
        let [x, y] = [start.x / size - self.cell[0] as f64, start.y / size - self.cell[1] as f64]
            .map(|v| v.clamp(0.0, 1.0));
        let (dx, dy) = (d.x / size, d.y / size);
        let (east, north, twist) = (se - sw, nw - sw, ne - nw - se + sw);
        // Height above the surface s after the entry: a + b s + c s².
        let a = start.z - (sw + east * x + north * y + twist * x * y);
        let b = d.z - (east * dx + north * dy + twist * (x * dy + y * dx));
        let c = -twist * dx * dy;
        if a <= 0.0 {
            return Some(Contact { t: self.t_in, height: start.z, face: self.side });
        }
        let square = b * b - 4.0 * a * c;
        if square < 0.0 {
            return None;
        }
        let q = -0.5 * (b + square.sqrt().copysign(b));
        let s = [a / q, q / c].into_iter().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
        let t = self.t_in + s;
        let is_there = t < self.t_out || (t == self.t_out && self.out_closed);
        is_there.then_some(Contact { t, height: start.z + s * d.z, face: Face::Top })
    }
}
