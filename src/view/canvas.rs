//! The image in the window: coarse while something changes, then one sample after the other; and what lies under the cursor.
//!
//! In each frame [`Canvas::plan`], then [`Canvas::record`] and [`Canvas::ask`], then [`Canvas::submitted`].

use super::data::Data;
use super::overlay::ImageArea;
use super::pace::Pace;
use super::settings::{ColorChoice, Colors, SAMPLES, Settings, view_of};
use crate::attribute::{ColorMode, ColorTable};
use crate::gpu::{Commands, Gpu, GpuError, SyncPoint, TracedImage};
use crate::render::camera::Camera;
use crate::render::frame::{Renderer, View, check_size};
use crate::render::screen::{Pick, PickedPoint, Screen};
use crate::resident::table::Table;
use glam::DVec3;
use std::collections::VecDeque;
use std::sync::Arc;

/// What the traced image depends on, but for the data.
#[derive(Clone, PartialEq)]
struct Wanted {
    camera: Camera,
    settings: Settings,
    size: [u32; 2],
}

/// Where it is asked what lies in the middle: shares of the image's width and height.
const MIDDLE: [f64; 2] = [0.5; 2];

/// What it is asked for what lies somewhere.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// It is under the cursor.
    Cursor,
    /// It was clicked on.
    Kept,
    /// It is in the image's middle.
    Middle,
}

/// What lies at a place, and what image that was asked of.
#[derive(Clone, Copy, PartialEq)]
struct Question {
    at: [f64; 2],
    purpose: Purpose,
    /// Images since the start.
    version: u64,
}

/// Where the user has clicked.
#[derive(Clone, Copy)]
enum Kept {
    /// Shares of the image; what lies there is to be asked for.
    Wanted([f64; 2]),
    /// It was.
    Asked([f64; 2]),
    /// What lies there.
    Known(PickedPoint),
}

/// See the module.
pub struct Canvas {
    screen: Screen,
    /// Made when there are data to draw.
    renderer: Option<Renderer>,
    colors: Option<Colors>,
    /// Where in the window the image is.
    pub area: ImageArea,
    wanted: Option<Wanted>,
    /// The image being made is for a view that changes.
    is_coarse: bool,
    /// It was begun because the user changed something, not because of what arrived.
    is_urgent: bool,
    pace: Pace,
    version: u64,
    asked: Option<Question>,
    /// Those that are under way, the oldest first.
    asking: VecDeque<Question>,
    /// The last answer for the cursor, and the camera when it came.
    pick: Option<(Pick, Camera)>,
    kept: Option<Kept>,
    /// Vertical exaggeration of what is to be kept.
    kept_scale: f64,
    /// And that for the middle of the image, which is asked for where the cursor is elsewhere.
    middle: Option<(Pick, Camera)>,
}

impl Canvas {
    /// `is_slow`: on a device that traces on the CPU.
    pub fn new(is_slow: bool) -> Canvas {
        Canvas {
            screen: Screen::default(),
            renderer: None,
            colors: None,
            area: ImageArea { rect: egui::Rect::ZERO, size: [0; 2] },
            wanted: None,
            is_coarse: true,
            is_urgent: false,
            pace: Pace::new(is_slow),
            version: 0,
            asked: None,
            asking: VecDeque::new(),
            pick: None,
            kept: None,
            kept_scale: 1.0,
            middle: None,
        }
    }

    /// Forgets what is of another scene; the last image stays.
    pub fn forget_scene(&mut self) {
        self.renderer = None;
        self.colors = None;
        self.screen.forget();
        self.asking.clear();
        (self.asked, self.pick, self.middle, self.kept) = (None, None, None, None);
    }

    /// Forgets the image, too: nothing is open any more, or something else.
    pub fn clear(&mut self) {
        self.forget_scene();
        self.screen = Screen::default();
        self.wanted = None;
    }

    /// Pixels of the image at rest.
    pub fn size(&self) -> [u32; 2] {
        self.area.size
    }

    /// Pixels of the image that is traced now.
    pub fn traced_size(&self) -> Option<[u32; 2]> {
        self.screen.size()
    }

    /// Samples that are whole of the image being made.
    pub fn samples(&self) -> u32 {
        self.screen.samples()
    }

    /// Whether the image is coarse, or lacks samples.
    pub fn is_refining(&self) -> bool {
        self.is_coarse || self.screen.samples() < SAMPLES
    }

    /// Whether the image was begun because the user changed something, not because of what arrived.
    pub fn is_urgent(&self) -> bool {
        self.is_urgent
    }

    /// Whether there is something that can be drawn.
    pub fn is_drawn(&self) -> bool {
        self.renderer.is_some() && self.colors.is_some()
    }

    /// The colours in use.
    pub fn colors(&self) -> Option<&Colors> {
        self.colors.as_ref()
    }

    /// What draws the image, once there is something to draw.
    pub fn renderer(&mut self) -> Option<&mut Renderer> {
        self.renderer.as_mut()
    }

    /// What the last answer was, and for which camera.
    pub fn pick(&self) -> Option<&(Pick, Camera)> {
        self.pick.as_ref()
    }

    /// Keeps what lies at `at` (pixels from the image's corner), as soon as that is known.
    pub fn keep(&mut self, at: [f64; 2], z_scale: f64) {
        self.kept = Some(Kept::Wanted(self.area.share(at)));
        self.kept_scale = z_scale;
    }

    /// Keeps nothing any more.
    pub fn let_go(&mut self) {
        self.kept = None;
    }

    /// What was clicked on.
    pub fn kept(&self) -> Option<PickedPoint> {
        match self.kept {
            Some(Kept::Known(point)) => Some(point),
            _ => None,
        }
    }

    /// Where that is seen with a vertical exaggeration about `pivot`.
    pub fn kept_place(&self, z_scale: f64, pivot: f64) -> Option<DVec3> {
        let at = self.kept()?.shown;
        Some(at.with_z(pivot + (at.z - pivot) / self.kept_scale * z_scale))
    }

    /// Whether an answer for the middle is under way.
    pub fn awaits_middle(&self) -> bool {
        self.asking.iter().any(|question| question.purpose == Purpose::Middle)
    }

    /// What lies in the middle of the image of `camera`, where that is known: the last answer to [`Canvas::ask`].
    pub fn middle(&self, camera: &Camera) -> Option<&Pick> {
        self.middle.as_ref().filter(|(_, of)| of == camera).map(|(pick, _)| pick)
    }

    /// Bytes of sections to upload in a frame, of at most `most`.
    pub fn upload_bytes(&self, most: u64) -> u64 {
        if self.is_urgent { self.pace.upload_bytes(self.area.size, most) } else { most }
    }

    /// Milliseconds that the next frame of something that changes takes on the device.
    pub fn frame_ms(&self) -> f64 {
        self.pace.ms(self.pace.coarse(self.area.size))
    }

    /// Rows of an image of full width that a frame may trace.
    pub fn rows(&self) -> u32 {
        self.pace.rows(self.area.size[0])
    }

    /// Whether the colours are what the settings say.
    pub fn has_colors_of(&self, data: &Data, settings: &Settings) -> bool {
        let choice = || self.choice(data, settings);
        self.colors.as_ref().is_none_or(|(of, _)| choice().is_none_or(|(choice, _)| *of == choice))
    }

    /// The colours that an image may have now, and their mode; `None`: those that it has. While some sections hold what is
    /// asked for and others something else, no colours are by that: the ones before stay, or heights are shown.
    fn choice(&self, data: &Data, settings: &Settings) -> Option<(ColorChoice, Settings)> {
        let wanted = ColorChoice::of(settings, data.about());
        let (Some(about), true) = (data.about(), data.is_mixed()) else {
            return Some((wanted, settings.clone()));
        };
        if !wanted.needs_channel(about) {
            return Some((wanted, settings.clone()));
        }
        if self.colors.as_ref().is_some_and(|(of, _)| !of.needs_channel(about)) {
            return None;
        }
        let heights = Settings { color: ColorMode::Height, ..settings.clone() };
        Some((ColorChoice::of(&heights, Some(about)), heights))
    }

    /// Makes the colours what the settings say; whether they were not.
    pub fn apply_colors(&mut self, data: &Data, settings: &Settings) -> anyhow::Result<bool> {
        let Some((choice, settings)) = self.choice(data, settings) else { return Ok(false) };
        let is_current = self.colors.as_ref().is_some_and(|(of, _)| *of == choice);
        let Some(about) = data.about().filter(|_| !is_current) else { return Ok(false) };
        let scale = settings.scale();
        let table = ColorTable::new(settings.color, &about.summary, &data.grid().0, scale.ramp, scale.range)?;
        self.colors = Some((choice, table));
        Ok(true)
    }

    /// Whether an image from there is not too wide to be drawn.
    pub fn can_draw(&self, data: &Data, settings: &Settings, camera: &Camera) -> bool {
        let view = view_of(data, settings, camera, self.colors.as_ref(), self.area.size);
        view.zip(self.renderer.as_ref()).is_none_or(|(view, renderer)| renderer.check(&view).is_ok())
    }

    /// Begins an image of known data where one is wanted; whether there is something left to trace.
    pub fn plan(
        &mut self,
        gpu: &Gpu,
        data: &Data,
        (camera, settings): (&Camera, &Settings),
        is_changed: bool,
    ) -> anyhow::Result<bool> {
        let size = self.area.size;
        check_size(gpu, size)?;
        if self.renderer.is_none() {
            let (grid, anchor) = data.grid();
            self.renderer = Some(Renderer::new(data.scene(), grid, anchor)?);
            self.wanted = None;
        }
        let wanted = Wanted { camera: *camera, settings: settings.clone(), size };
        let coarse = self.pace.coarse(size);
        let is_wanted = self.wanted.as_ref() == Some(&wanted);
        if is_changed || !is_wanted {
            self.is_urgent = !is_wanted;
            self.wanted = Some(wanted);
            self.is_coarse = coarse != size;
            self.screen.start(coarse);
        } else if self.is_coarse && self.screen.samples() > 0 {
            self.is_coarse = false;
            self.screen.start(size);
        }
        // Until all is there the image will be another one soon: what computes is left to the reading.
        let enough = if data.is_complete() { SAMPLES } else { 1 };
        Ok(self.is_coarse || self.screen.samples() < enough)
    }

    /// What the next frame traces, and what it may see. Before the frame begins: the scene may have to derive what is to be
    /// shown.
    pub fn prepare(
        &mut self,
        data: &mut Data,
        (settings, camera): (&Settings, &Camera),
    ) -> Result<Arc<Table>, GpuError> {
        let table = self.renderer.as_mut().map(|renderer| data.table(renderer)).unwrap_or_default();
        let size = self.screen.size().unwrap_or(self.area.size);
        if let Some(view) = view_of(data, settings, camera, self.colors.as_ref(), size) {
            self.screen.prepare(data.scene_mut(), &view)?;
        }
        Ok(table)
    }

    /// Records the next rows of the image in frame `slot`; whether there is anything to draw.
    pub fn record(
        &mut self,
        data: &mut Data,
        (settings, camera): (&Settings, &Camera),
        (commands, slot): (&mut Commands, usize),
        table: &Arc<Table>,
    ) -> anyhow::Result<bool> {
        let size = self.screen.size().unwrap_or(self.area.size);
        let view = view_of(data, settings, camera, self.colors.as_ref(), size);
        // A coarse image is one sample in the middle of each pixel.
        let view = view.map(|view| if self.is_coarse { View { samples: 1, ..view } } else { view });
        let (Some(view), Some(renderer)) = (view, &mut self.renderer) else { return Ok(false) };
        let before = self.screen.samples();
        let rows = if self.is_coarse { size[1] } else { self.pace.rows(size[0]) };
        self.screen.record(renderer, data.scene_mut(), (commands, slot), &view, table, rows)?;
        self.version += u64::from(self.screen.samples() != before && before == 0);
        Ok(true)
    }

    /// Asks in frame `slot` what lies under the cursor (pixels from the image's corner), or in the middle where that is
    /// elsewhere or the middle is `wanted`, if that is another question than the last; whether it was asked. Nothing is
    /// asked where `is_taken`: the frame copies something else.
    pub fn ask(
        &mut self,
        data: &mut Data,
        (commands, slot): (&mut Commands, usize),
        cursor: Option<[f64; 2]>,
        (middle_is_wanted, is_taken): (bool, bool),
    ) -> Result<bool, GpuError> {
        if let (Some(Kept::Wanted(at)), Some(renderer), false) = (self.kept, &self.renderer, is_taken) {
            let is_asked = self.screen.ask(renderer, data.scene_mut(), (commands, slot), at)?;
            if is_asked {
                // What lies under the cursor is asked for again, after it.
                (self.kept, self.asked) = (Some(Kept::Asked(at)), None);
                self.asking.push_back(Question { at, purpose: Purpose::Kept, version: self.version });
            }
            return Ok(is_asked);
        }
        let is_inside = |at: &[f64; 2]| at.iter().all(|v| (0.0..1.0).contains(v));
        let cursor = cursor.map(|at| self.area.share(at)).filter(is_inside);
        if cursor.is_none() {
            self.pick = None;
        }
        let cursor = cursor.filter(|_| !middle_is_wanted);
        let purpose = if cursor.is_some() { Purpose::Cursor } else { Purpose::Middle };
        let question = Question { at: cursor.unwrap_or(MIDDLE), purpose, version: self.version };
        let Some(renderer) = self.renderer.as_ref().filter(|_| !is_taken && self.asked != Some(question))
        else {
            return Ok(false);
        };
        let is_asked = self.screen.ask(renderer, data.scene_mut(), (commands, slot), question.at)?;
        if is_asked {
            self.asked = Some(question);
            self.asking.push_back(question);
        }
        Ok(is_asked)
    }

    /// Tells that frame `slot` was submitted.
    pub fn submitted(&mut self, slot: usize, point: SyncPoint) {
        self.screen.submitted(slot, point);
    }

    /// Answers that are there by now, the latest last, each with what it was asked for, and kept as one for `camera`. Waits
    /// for nothing.
    pub fn take_picks(&mut self, data: &mut Data, camera: &Camera) -> Result<Vec<(Pick, Purpose)>, GpuError> {
        let Some(renderer) = &self.renderer else { return Ok(Vec::new()) };
        let mut answers = Vec::new();
        for pick in self.screen.take_picks(renderer, data.scene_mut())? {
            // Those that were lost on the way are followed by others.
            while let Some(asked) = self.asking.pop_front() {
                if asked.at != pick.at {
                    continue;
                }
                match asked.purpose {
                    Purpose::Middle => self.middle = Some((pick, *camera)),
                    Purpose::Cursor => self.pick = Some((pick, *camera)),
                    Purpose::Kept => {
                        self.pick = Some((pick, *camera));
                        if matches!(self.kept, Some(Kept::Asked(at)) if at == pick.at) {
                            self.kept = pick.point.map(Kept::Known);
                        }
                    }
                }
                answers.push((pick, asked.purpose));
                break;
            }
        }
        Ok(answers)
    }

    /// Learns from frames that are done; gives their milliseconds.
    pub fn take_times(&mut self, data: &mut Data) -> Result<Vec<f64>, GpuError> {
        let times = self.screen.take_times(data.scene_mut())?;
        times.iter().for_each(|(pixels, ms)| self.pace.learn(*pixels, *ms));
        Ok(times.into_iter().map(|(_, ms)| ms).collect())
    }

    /// The last image that is whole, where it lies in the window.
    pub fn shown(&self, pixels_per_point: f32) -> Option<TracedImage<'_>> {
        let corner = self.area.rect.min * pixels_per_point;
        let [left, top] = [corner.x, corner.y].map(|v| v.round().max(0.0) as u32);
        let [width, height] = self.area.size;
        self.screen.image_at([left, top, width, height])
    }
}
