//! What the user has chosen to see, and the view of the data that follows from it.

use super::data::Data;
use crate::attribute::{ColorMode, ColorTable};
use crate::render::camera::Camera;
use crate::render::frame::{Background, Shade, Traversal, View};
use crate::resident::visibility::Visibility;

/// Samples that a resting image adds up.
pub const SAMPLES: u32 = 16;
/// Longest hole that is bridged, cells.
pub const BRIDGE: u32 = 4;

/// In the order of the panel and of the key that goes through them.
pub const MODES: [ColorMode; 5] =
    [ColorMode::Rgb, ColorMode::Height, ColorMode::Class, ColorMode::Intensity, ColorMode::Return];

/// What the user has chosen to see.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// What colours show.
    pub color: ColorMode,
    /// Classes, withheld points, bridges.
    pub visibility: Visibility,
    /// Vertical exaggeration.
    pub z_scale: f64,
    /// Light.
    pub shade: Shade,
}

/// Colours, and the mode that was asked for: a field that is the same everywhere may be drawn through another.
pub type Colors = (ColorMode, ColorTable);

/// The view that an image of `size` pixels shows; `None` while nothing is known of the data.
pub fn view_of<'a>(
    data: &Data,
    settings: &Settings,
    camera: &'a Camera,
    colors: Option<&'a Colors>,
    size: [u32; 2],
) -> Option<View<'a>> {
    let bounds = data.about()?.bounds;
    Some(View {
        camera,
        size,
        samples: SAMPLES,
        z_scale: settings.z_scale,
        pivot: bounds.min.z,
        bounds,
        slab: Some(data.about()?.slab(data.grid().0.cell())),
        colors: &colors?.1,
        shade: settings.shade,
        background: Background::Sky,
        traversal: Traversal::Fast,
        window: None,
    })
}
