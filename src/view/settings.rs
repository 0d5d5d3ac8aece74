//! What the user has chosen to see, and the view of the data that follows from it.

use super::data::{Data, DataAbout};
use crate::attribute::{ColorMode, ColorRange, ColorTable, Ramp};
use crate::render::camera::{Camera, Projection};
use crate::render::frame::{Background, Shade, Traversal, View};
use crate::resident::visibility::Visibility;
use crate::source::{Reading, Selection};

/// Samples that a resting image adds up.
pub const SAMPLES: u32 = 16;
/// Longest hole that is bridged, cells.
pub const BRIDGE: u32 = 4;

/// In the order of the panel and of the key that goes through them.
pub const MODES: [ColorMode; 5] =
    [ColorMode::Rgb, ColorMode::Height, ColorMode::Class, ColorMode::Intensity, ColorMode::Return];

/// Modes that read points again: the key leaves them out.
pub const MORE_MODES: [ColorMode; 6] = [
    ColorMode::HeightAboveGround,
    ColorMode::Density,
    ColorMode::LineDifference,
    ColorMode::SourceId,
    ColorMode::ScanAngle,
    ColorMode::GpsTime,
];

/// How values become colours of a ramp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scale {
    /// `None`: that of the mode.
    pub ramp: Option<Ramp>,
    /// Values at the ramp's ends; `None`: chosen from the data.
    pub range: Option<ColorRange>,
}

/// What the user has chosen to see.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// What colours show.
    pub color: ColorMode,
    /// The ramp of heights.
    pub heights: Scale,
    /// And that of intensities.
    pub intensities: Scale,
    /// That of scan angles.
    pub angles: Scale,
    /// That of GPS times.
    pub times: Scale,
    /// That of heights above the ground.
    pub above: Scale,
    /// That of densities.
    pub densities: Scale,
    /// That of differences between flight lines.
    pub differences: Scale,
    /// Points that take part.
    pub selection: Selection,
    /// Classes, flags, bridges.
    pub visibility: Visibility,
    /// Vertical exaggeration.
    pub z_scale: f64,
    /// Light.
    pub shade: Shade,
}

impl Settings {
    /// What is seen of the data: near ties count and holes are bridged in lit images alone, as in `lasray render`.
    pub fn seen(&self) -> Visibility {
        match self.shade {
            Shade::Lit => Visibility { near_ties: true, ..self.visibility },
            Shade::None => Visibility { near_ties: false, bridge: 0, ..self.visibility },
        }
    }

    /// What is to be read of the data, which is read in some way now: the channel stays while nothing else is needed.
    pub fn reading(&self, about: &DataAbout, now: &Reading) -> Reading {
        Reading {
            selection: self.selection.clone(),
            channel: self.color.channel(&about.summary).unwrap_or(now.channel),
        }
    }

    /// The ramp of the colour mode, where it has one.
    pub fn scale(&self) -> Scale {
        match self.color {
            ColorMode::Height => self.heights,
            ColorMode::Intensity => self.intensities,
            ColorMode::ScanAngle => self.angles,
            ColorMode::GpsTime => self.times,
            ColorMode::HeightAboveGround => self.above,
            ColorMode::Density => self.densities,
            ColorMode::LineDifference => self.differences,
            ColorMode::Rgb | ColorMode::Class | ColorMode::Return | ColorMode::SourceId => Scale::default(),
        }
    }

    /// The same, to change it.
    pub fn scale_mut(&mut self) -> Option<&mut Scale> {
        match self.color {
            ColorMode::Height => Some(&mut self.heights),
            ColorMode::Intensity => Some(&mut self.intensities),
            ColorMode::ScanAngle => Some(&mut self.angles),
            ColorMode::GpsTime => Some(&mut self.times),
            ColorMode::HeightAboveGround => Some(&mut self.above),
            ColorMode::Density => Some(&mut self.densities),
            ColorMode::LineDifference => Some(&mut self.differences),
            ColorMode::Rgb | ColorMode::Class | ColorMode::Return | ColorMode::SourceId => None,
        }
    }
}

/// Whether the data have something to show by a colour mode.
pub fn has_mode(data: Option<&DataAbout>, mode: ColorMode) -> bool {
    match mode {
        ColorMode::Rgb => data.is_some_and(DataAbout::has_rgb),
        ColorMode::GpsTime => data.is_none_or(|about| about.summary.scales.times.is_some()),
        _ => true,
    }
}

/// Those of [`MODES`] that the data have something to show by.
pub fn modes(data: Option<&DataAbout>) -> impl Iterator<Item = ColorMode> {
    MODES.into_iter().filter(move |mode| has_mode(data, *mode))
}

/// What colours were asked for, which may come to others: a field that is the same everywhere may be drawn through another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorChoice {
    mode: ColorMode,
    scale: Scale,
    has_rgb: bool,
    /// By what ranges are chosen.
    summaries: u32,
}

impl ColorChoice {
    /// Whether they are by what the channel of records holds.
    pub fn needs_channel(&self, data: &DataAbout) -> bool {
        self.mode.channel(&data.summary).is_some()
    }

    /// What they show.
    pub fn mode(&self) -> ColorMode {
        self.mode
    }

    /// That of the settings.
    pub fn of(settings: &Settings, data: Option<&DataAbout>) -> ColorChoice {
        let has_rgb = data.is_some_and(DataAbout::has_rgb);
        let summaries = data.map_or(0, |about| about.summaries);
        ColorChoice { mode: settings.color, scale: settings.scale(), has_rgb, summaries }
    }
}

/// Colours, and what was asked for.
pub type Colors = (ColorChoice, ColorTable);

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
        slab: Some(data.about()?.outline(data.is_first()).slab(data.grid().0.cell())),
        colors: &colors?.1,
        shade: settings.shade,
        // As `lasray render` does: maps and elevations are seen before white.
        background: match camera.projection() {
            Projection::Perspective { .. } => Background::Sky,
            Projection::Orthographic { .. } => Background::White,
        },
        traversal: Traversal::Fast,
        window: None,
    })
}
