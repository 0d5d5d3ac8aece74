//! The rays of a view: origins in fixed point, from a plane just before the data on.

use super::super::camera::{CameraError, RayBasis};
use super::options::View;
use crate::coords::{CELL_LIMIT, Grid, Height, power_of_two_at_most};
use crate::shared::passes::WIDE_TILE;
use glam::DVec3;

/// The rays of an image, from a plane just before the data on.
#[derive(Clone)]
pub(crate) struct ViewRays {
    /// As they are shown.
    pub(super) shown: RayBasis,
    /// As they run through unexaggerated data.
    pub(super) through: RayBasis,
    /// Of those, what the device is given.
    pub(super) origins: Origins,
    /// CRS units in one of the device's lengths: a power of two, so that it rounds nothing, and not above a cell, so that
    /// the device computes with the same numbers whatever the unit is.
    pub(super) unit: f64,
}

/// Origins of rays as the device has them: cells, cells and height steps from the anchors, in 32.32 fixed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Origins {
    /// At the top left corner of the image's middle pixel.
    pub(super) origin: [i64; 3],
    /// Per sixteenth of a pixel, of which samples and the centre of an odd size are whole numbers.
    pub(super) right: [i64; 3],
    pub(super) down: [i64; 3],
    /// Height steps in one of the third coordinate: 1, or a power of two where the image reaches farther up or down
    /// than whole steps can be counted.
    pub(super) step: f64,
}

/// Steps of a plane before the data's depth, in height steps: it is rounded so that it does not depend on where in its
/// CRS the data lies.
const STEPS_OF_DEPTH: f64 = 64.0;

/// Whole cells and height steps from the anchors within which origins must lie, each way: differences from what is there
/// fit 32 bits.
const ORIGIN_REACH: i128 = 1 << 30;
const _: () = assert!(ORIGIN_REACH + CELL_LIMIT as i128 <= 1 << 31);

/// More doublings of [`Origins::step`] than any image needs whose width can be counted in cells.
const MOST_STEP_LOG2: i32 = 64;

impl ViewRays {
    /// Of `view`, over cells and heights of `grid`, the heights counted from `anchor` on the device.
    /// Errors: the image takes in too much to be counted in cells.
    pub(crate) fn of(view: &View, grid: &Grid, anchor: Height) -> Result<ViewRays, CameraError> {
        let shown = view.camera.drawn_basis(view.size, grid.height_step)?;
        let bounds = view.bounds.exaggerated(view.z_scale, view.pivot);
        // Not less than a cell before the data, so that rounding does not reach it.
        let depth = shown.depth_of(&bounds, view.camera.forward(), view.size) - grid.cell();
        let step = STEPS_OF_DEPTH * grid.height_step;
        let shown = shown.advance(((depth / step).floor() * step).max(0.0));
        let through = shown.exaggerated(view.z_scale, view.pivot)?;
        let origins = Origins::of(&through, view.size, grid, anchor).ok_or_else(|| CameraError::TooWide {
            width: [through.ox, through.oy]
                .into_iter()
                .zip(view.size)
                .map(|(pixel, pixels)| pixel.length() * f64::from(pixels))
                .fold(0.0, f64::max),
            cell: grid.cell(),
        })?;
        Ok(ViewRays { shown, through, origins, unit: power_of_two_at_most(grid.cell()) })
    }
}

impl Origins {
    /// `None` where a ray of the image starts too many cells from the anchor.
    fn of(rays: &RayBasis, size: [u32; 2], grid: &Grid, height_anchor: Height) -> Option<Origins> {
        let cell = grid.cell();
        let anchor = DVec3::new(grid.anchor[0] as f64, grid.anchor[1] as f64, f64::from(height_anchor.0));
        // Divided as cell indices are: a border is a whole number.
        let eye = rays.eye / DVec3::new(cell, cell, grid.height_step) - anchor;
        let per_unit = DVec3::new(1.0 / cell, 1.0 / cell, grid.height_step.recip());
        let odd_half = size.map(|pixels| -8 * i128::from(pixels & 1));
        (0..MOST_STEP_LOG2).find_map(|log2| {
            let step = f64::from(log2).exp2();
            let counted = DVec3::new(1.0, 1.0, step);
            // Added in fixed point, so that what is left of the eye's place in the world does not round the rest; and
            // before they have to fit 64 bits: eyes may be far from the data, origins are near.
            let [eye, from_eye] = [eye, rays.o0 * per_unit].map(|v| fixed3(v / counted));
            let [right, down] = [rays.ox, rays.oy].map(|pixel| fixed3(pixel / 16.0 * per_unit / counted));
            let (eye, from_eye, right, down) = (eye?, from_eye?, right?, down?);
            let origin: [i128; 3] = std::array::from_fn(|axis| {
                eye[axis] + from_eye[axis] + right[axis] * odd_half[0] + down[axis] * odd_half[1]
            });
            // Beams' corners lie up to a wide tile beyond the edge.
            let [x, y] = size.map(|pixels| 16 * i128::from(pixels / 2 + WIDE_TILE));
            let fits = (0..3).all(|axis| {
                let reach = origin[axis].abs() + right[axis].abs() * x + down[axis].abs() * y;
                reach >> 32 < ORIGIN_REACH
            });
            let narrow = |v: [i128; 3]| v.map(|bits| bits as i64);
            fits.then(|| Origins { origin: narrow(origin), right: narrow(right), down: narrow(down), step })
        })
    }
}

/// Fixed point with 32 bits of fraction, of places so far away that a few of them can be added and multiplied by pixels;
/// `None` beyond.
fn fixed3(v: DVec3) -> Option<[i128; 3]> {
    const REACH: f64 = (1u128 << 96) as f64;
    let bits = (v * 4_294_967_296.0).round();
    // NaN fails.
    bits.abs().cmplt(DVec3::splat(REACH)).all().then(|| bits.to_array().map(|bits| bits as i128))
}
