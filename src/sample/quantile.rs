//! Order statistics of weighted values and of points.

use glam::DVec3;

/// The value below which `share` of the weight lies; sorts `values` (value, weight).
pub(super) fn quantile(values: &mut [(f64, f64)], share: f64) -> Option<f64> {
    if !values.is_sorted_by(|a, b| a.0 <= b.0) {
        values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    }
    let total: f64 = values.iter().map(|(_, weight)| weight).sum();
    let mut below = 0.0;
    for (value, weight) in values.iter() {
        below += weight;
        if below >= share * total {
            return Some(*value);
        }
    }
    values.last().map(|(value, _)| *value)
}

/// The middle of the finite points, each axis by itself; NaN if there is none.
pub(super) fn median(points: impl Iterator<Item = DVec3>) -> DVec3 {
    let points: Vec<DVec3> = points.filter(|point| point.is_finite()).collect();
    let axis = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    DVec3::new(axis(0), axis(1), axis(2))
}
