//! What host and shaders both know of a frame, word by word: constants, push constants and hit records.

use super::options::{Background, Shade, View};
use super::rays::{Origins, ViewRays};
use crate::attribute::ColorMode;
use crate::coords::{Grid, Height, LOW_SIDE, LowSurface, Slab};
use crate::shared::passes::{
    BACKGROUND_NONE, BACKGROUND_SKY, BACKGROUND_WHITE, BITS_FACE_MASK, BITS_FACE_SHIFT, COLOR_CHANNEL,
    COLOR_CLASS, COLOR_HEIGHT, COLOR_KNOWN, COLOR_PALETTE, COLOR_RETURNS, COLOR_RGB, FACE_TOP, SHADE_LIT,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Mirrors `Frame` in `shaders/frame.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct FrameConstants {
    pub(crate) table: [u32; 2],
    pub(crate) hits: [u32; 2],
    pub(crate) colors: [u32; 2],
    pub(crate) ramp: [u32; 2],
    pub(crate) beams: [u32; 2],
    pub(crate) wide_beams: [u32; 2],
    pub(crate) table_mask: u32,
    pub(crate) top_level: i32,
    pub(crate) section_level: i32,
    pub(crate) low: [i32; 2],
    pub(crate) high: [i32; 2],
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) origin_int: [i32; 3],
    pub(crate) origin_fraction: [u32; 3],
    pub(crate) right_int: [i32; 3],
    pub(crate) right_fraction: [u32; 3],
    pub(crate) down_int: [i32; 3],
    pub(crate) down_fraction: [u32; 3],
    pub(crate) depth: f32,
    pub(crate) forward: [f32; 3],
    pub(crate) right: [f32; 3],
    pub(crate) down: [f32; 3],
    pub(crate) to_local: [f32; 3],
    pub(crate) origin_step: f32,
    pub(crate) height_anchor: i32,
    pub(crate) shade: u32,
    pub(crate) color_source: u32,
    pub(crate) range_low: u32,
    pub(crate) range_scale: f32,
    pub(crate) range_offset: f32,
    pub(crate) cell_steps: f32,
    pub(crate) sun: [f32; 3],
    pub(crate) background: u32,
    pub(crate) ground_first: [i32; 2],
    pub(crate) ground_scale: [f32; 2],
    pub(crate) ground_at: [f32; 2],
    pub(crate) slab: f32,
    pub(crate) cell_height: f32,
    pub(crate) slice_log2: i32,
    pub(crate) pixel: [f32; 2],
}

impl FrameConstants {
    /// What `view` alone says: places, table and window are left 0.
    pub(crate) fn new(view: &View, rays: &ViewRays, grid: &Grid, height_anchor: Height) -> FrameConstants {
        let cell = grid.cell();
        let Origins { origin, right, down, step } = rays.origins;
        let (origin_int, origin_fraction) = parts(origin);
        let (right_int, right_fraction) = parts(right.map(|step| step * 16));
        let (down_int, down_fraction) = parts(down.map(|step| step * 16));
        let to_local =
            DVec3::new(1.0 / cell, 1.0 / cell, 1.0 / (grid.height_step * view.z_scale)) * rays.unit;
        let sun = sun();
        let ground = view.slab.as_ref().map_or_else(GroundPlace::default, |slab| GroundPlace::of(slab, grid));
        FrameConstants {
            width: view.size[0],
            height: view.size[1],
            origin_int,
            origin_fraction,
            right_int,
            right_fraction,
            down_int,
            down_fraction,
            depth: (rays.shown.advanced() / rays.unit) as f32,
            forward: rays.shown.d0.as_vec3().to_array(),
            right: (rays.shown.dx / 16.0).as_vec3().to_array(),
            down: (rays.shown.dy / 16.0).as_vec3().to_array(),
            to_local: to_local.as_vec3().to_array(),
            origin_step: step as f32,
            height_anchor: height_anchor.0,
            shade: if view.shade == Shade::Lit { SHADE_LIT } else { 0 },
            color_source: match view.colors.mode {
                ColorMode::Rgb => COLOR_RGB,
                ColorMode::Height => COLOR_HEIGHT,
                ColorMode::Class => COLOR_CLASS,
                ColorMode::Intensity | ColorMode::ScanAngle => COLOR_CHANNEL,
                ColorMode::GpsTime
                | ColorMode::HeightAboveGround
                | ColorMode::Density
                | ColorMode::LineDifference => COLOR_KNOWN,
                ColorMode::SourceId => COLOR_PALETTE,
                ColorMode::Return => COLOR_RETURNS,
            },
            range_low: view.colors.lo,
            range_scale: view.colors.scale,
            range_offset: view.colors.offset,
            cell_steps: (grid.cell_steps(0) / view.z_scale) as f32,
            sun: sun.as_vec3().to_array(),
            background: match view.background {
                Background::None => BACKGROUND_NONE,
                Background::White => BACKGROUND_WHITE,
                Background::Sky => BACKGROUND_SKY,
            },
            slab: view.slab.as_ref().map_or(f32::INFINITY, |slab| (slab.thickness / grid.height_step) as f32),
            cell_height: grid.cell_steps(0) as f32,
            slice_log2: grid.stacking(0).slice_log2 as i32,
            pixel: [rays.shown.ox.length() / cell, rays.shown.dx.length() * rays.unit / cell]
                .map(|v| v as f32),
            ground_first: ground.first,
            ground_scale: ground.scale,
            ground_at: ground.at,
            ..FrameConstants::zeroed()
        }
    }
}

/// Towards the sun: in the north-west, as on maps, 29° high.
pub(in super::super) fn sun() -> DVec3 {
    DVec3::new(-0.75f64.sqrt(), 0.75f64.sqrt(), 0.68).normalize()
}

/// Where on the ground's heights cells lie: see `Frame` in `shaders/frame.glsl`.
#[derive(Default)]
struct GroundPlace {
    first: [i32; 2],
    scale: [f32; 2],
    at: [f32; 2],
}

impl GroundPlace {
    fn of(slab: &Slab, grid: &Grid) -> GroundPlace {
        let (cell, LowSurface { origin, cell: side, .. }) = (grid.cell(), &*slab.low);
        let on_axis = |axis: usize| {
            let first = (origin[axis] / cell).floor();
            let scale = cell / side[axis];
            let local = first as i64 - grid.anchor[axis];
            // To a millionth of a height's distance: wherever in its CRS the data lies it is the same.
            let at = (((first - origin[axis] / cell) * scale - 0.5) * 1048576.0).round() / 1048576.0;
            let local = local.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
            (local, scale.min(f64::from(f32::MAX)) as f32, at.max(f64::from(f32::MIN)) as f32)
        };
        let [east, north] = [on_axis(0), on_axis(1)];
        GroundPlace { first: [east.0, north.0], scale: [east.1, north.1], at: [east.2, north.2] }
    }
}

/// The ground's heights as shaders read them: lattice steps from the anchor.
pub(crate) fn ground_heights(slab: Option<&Slab>, grid: &Grid, height_anchor: Height) -> Vec<f32> {
    let steps = |height: &f64| (height / grid.height_step - f64::from(height_anchor.0)) as f32;
    match slab {
        Some(slab) => slab.low.heights.iter().map(steps).collect(),
        None => vec![f32::MIN; LOW_SIDE * LOW_SIDE],
    }
}

/// Mirrors the push constants of `shaders/frame.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(crate) struct FramePush {
    sample_at: [i32; 2],
    sample_index: u32,
    sample_weight: f32,
    first_row: u32,
    rows: u32,
    origin_int: [i32; 3],
    origin_fraction: [u32; 3],
}

impl FramePush {
    /// One sample of every pixel of `rows` rows from `first_row` on, under `constants`.
    pub(crate) fn new(
        constants: &FrameConstants,
        [sample, samples]: [u32; 2],
        [first_row, rows]: [u32; 2],
    ) -> FramePush {
        let sample_at = sample_at(sample, samples);
        let [origin, right, down] = [
            joined(constants.origin_int, constants.origin_fraction),
            joined(constants.right_int, constants.right_fraction),
            joined(constants.down_int, constants.down_fraction),
        ];
        let sixteenth = |step: [i64; 3]| step.map(|bits| bits >> 4);
        let origin = added(origin, sixteenth(right), sample_at[0].into());
        let (origin_int, origin_fraction) = parts(added(origin, sixteenth(down), sample_at[1].into()));
        let sample_weight = 1.0 / samples as f32;
        FramePush {
            sample_at,
            sample_index: sample,
            sample_weight,
            first_row,
            rows,
            origin_int,
            origin_fraction,
        }
    }

    /// One sample of every pixel, in its centre.
    pub(crate) fn whole(constants: &FrameConstants) -> FramePush {
        FramePush::new(constants, [0, 1], [0, constants.height])
    }
}

/// Mirrors a hit record after shading.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(in super::super) struct HitRecord {
    pub(super) t: f32,
    /// Class (256: a miss) | origin << 9 | face << 12 | detail level << 15 | stands in << 20.
    pub(in super::super) bits: u32,
    /// Nodes that the traversal looked at | what the channel of the record holds << 16, where colours are by that.
    pub(in super::super) rest: u32,
    /// Lattice steps from the anchor.
    pub(super) top: i32,
}

/// What the ray of pixel (px, py) has hit: distance from the eye as shown, and U; heights count from `anchor`.
pub(super) fn distance_and_height(
    ViewRays { shown, through, unit, .. }: &ViewRays,
    hit: &HitRecord,
    [px, py]: [f64; 2],
    grid: &Grid,
    anchor: Height,
) -> [f64; 2] {
    let t = f64::from(hit.t) * unit;
    let height = if hit.bits >> BITS_FACE_SHIFT & BITS_FACE_MASK == FACE_TOP {
        grid.units(Height(hit.top.wrapping_add(anchor.0)))
    } else {
        let along = through.direction(px, py).z / through.length(px, py);
        through.origin(px, py).z + t * along
    };
    [shown.distance_eye_to_plane(px, py) + t, height]
}

/// An address as shaders have it: low word, high word.
pub(crate) fn halves(address: u64) -> [u32; 2] {
    [address as u32, (address >> 32) as u32]
}

/// `a + n · b`.
fn added(a: [i64; 3], b: [i64; 3], n: i64) -> [i64; 3] {
    std::array::from_fn(|axis| a[axis].wrapping_add(b[axis].wrapping_mul(n)))
}

/// Whole parts and fractions.
fn parts(fixed: [i64; 3]) -> ([i32; 3], [u32; 3]) {
    (fixed.map(|bits| (bits >> 32) as i32), fixed.map(|bits| bits as u32))
}

fn joined(int: [i32; 3], fraction: [u32; 3]) -> [i64; 3] {
    std::array::from_fn(|axis| i64::from(int[axis]) << 32 | i64::from(fraction[axis]))
}

/// Where in a pixel its sample lies, sixteenths from the top left corner. One: the centre; more: a lattice
/// that puts each into a row and a column of its own.
pub(in super::super) fn sample_at(sample: u32, samples: u32) -> [i32; 2] {
    if samples == 1 {
        return [8, 8];
    }
    // The R2 sequence: low discrepancy for any count.
    let at = |step: f64| ((0.5 + f64::from(sample) * step).fract() * 16.0) as i32;
    match (samples, sample) {
        (4, k) => [[6, 2], [14, 6], [2, 10], [10, 14]][k as usize],
        _ => [at(0.754_877_666_246_693), at(0.569_840_290_998_053)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{assert_in, members};
    use crate::resident::readers::{readers_of_tables, readers_of_texels};

    #[test]
    fn shaders_see_the_structs_as_they_are_written() {
        let readers = readers_of_tables();
        let constants = members!(FrameConstants {
            table,
            hits,
            colors,
            ramp,
            beams,
            wide_beams,
            table_mask,
            top_level,
            section_level,
            low,
            high,
            width,
            height,
            origin_int,
            origin_fraction,
            right_int,
            right_fraction,
            down_int,
            down_fraction,
            depth,
            forward,
            right,
            down,
            to_local,
            origin_step,
            height_anchor,
            shade,
            color_source,
            range_low,
            range_scale,
            range_offset,
            cell_steps,
            sun,
            background,
            ground_first,
            ground_scale,
            ground_at,
            slab,
            cell_height,
            slice_log2,
            pixel,
        });
        let texels = readers_of_texels();
        assert_in(&readers, &constants);
        assert_in(&texels, &constants);
        let push = members!(FramePush {
            sample_at,
            sample_index,
            sample_weight,
            first_row,
            rows,
            origin_int,
            origin_fraction
        });
        assert_in(&readers, &push);
        assert_in(&texels, &push);
    }
}
