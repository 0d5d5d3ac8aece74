//! Places of the camera that were typed, in E, N, U as they are shown; for those that count from what is shown there, a
//! picture of one pixel is drawn.

use super::drawing::Drawing;
use crate::command::UsageError;
use crate::command::values::Place;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::View;
use crate::render::image::MISS_CLASS;
use crate::source::placement::Fit;
use anyhow::Context;
use glam::DVec3;

/// The height of a place that is given in full.
pub(super) fn absolute(place: Place, base: &Fit) -> Option<DVec3> {
    match place {
        Place::At(place) => Some(base.place(place)),
        Place::Above(..) => None,
    }
}

impl Drawing<'_> {
    /// Where `place`, given by `option`, is.
    pub(super) fn place(&mut self, option: &str, place: Place, base: &Fit) -> anyhow::Result<DVec3> {
        let (e, n, above) = match place {
            Place::At(place) => return Ok(base.place(place)),
            Place::Above([e, n], above) => (e, n, above),
        };
        let typed = format!("{option} {e},{n},+{above}");
        if base.horizontal_scale().is_none() {
            return Err(UsageError(format!(
                "{typed}: geocentric coordinates have no height above the ground"
            ))
            .into());
        }
        let placed = base.place(DVec3::new(e, n, above));
        let top = self.top(placed).with_context(|| typed.clone())?;
        let View { z_scale, pivot, .. } = self.view;
        let top = top.ok_or_else(|| {
            UsageError(format!(
                "{typed}: nothing is shown there: no point lies at that place, or only hidden ones"
            ))
        })?;
        Ok(placed.with_z(pivot + (top - pivot) * z_scale + placed.z))
    }

    /// The shown top of the finest column at the E, N of `at`, as it is without exaggeration.
    fn top(&mut self, at: DVec3) -> anyhow::Result<Option<f64>> {
        let (cell, bounds) = (self.grid.cell(), self.view.bounds);
        // Above what stands out of the bounds, too; as narrow as a column's middle.
        let above = 4.0 * bounds.size().z + 1024.0 * cell;
        let projection = Projection::Orthographic { units_per_pixel: cell / 1024.0 };
        let camera = Camera::orbit(at.with_z(bounds.max.z), [0.0, 90.0], above, projection)
            .map_err(|error| UsageError(error.to_string()))?;
        let image = self.exact_pixel(&camera)?;
        Ok((image.class[0] != MISS_CLASS).then(|| f64::from(image.hit_height[0])))
    }
}
