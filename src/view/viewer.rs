//! All that a window has: what is on the device, the toolkit, and the parts that decide what is seen and when.

use super::canvas::Canvas;
use super::data::{Data, ReadOptions};
use super::flight::FlightProgress;
use super::input::InputState;
use super::log::EventLog;
use super::navigation::Navigation;
use super::options::{ViewOptions, WindowOptions};
use super::panel::{self, Panel};
use super::pipelines::Pipelines;
use super::redraw::Redraw;
use super::saving::{Saving, Writer};
use super::settings::{Scale, Settings, has_mode};
use super::timing::FrameTiming;
use super::toolkit::Textures;
use crate::attribute::{AttributeError, ColorMode};
use crate::gpu::{DeviceKind, Gpu, Overlay, Swapchain, SyncPoint};
use crate::limits::LIMITS;
use crate::render::path::CameraPath;
use crate::section::Surface;
use crate::text::harmless;
use anyhow::Context as _;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::ModifiersState;
use winit::window::Window;

/// Why there is none, mostly.
#[derive(Debug, thiserror::Error)]
#[error("no window can be opened: is there a display? (lasray render needs none)")]
pub struct NoWindow;
/// How long a notice stays.
const NOTICE: Duration = Duration::from_secs(6);

// Fields are dropped in this order: what is on the device, the device, the window.
/// See the module. Its methods that draw frames and answer events stand in `frame`, `layout`, `news`, `actions` and `events`.
pub struct Viewer {
    pub(super) canvas: Canvas,
    /// Boxed: it is large, and seldom there.
    pub(super) saving: Option<Box<Saving>>,
    pub(super) writer: Writer,
    pub(super) overlay: Overlay,
    pub(super) textures: Textures,
    pub(super) pipelines: Pipelines,
    pub(super) swapchain: Swapchain,
    pub(super) data: Data,
    pub(super) gpu: Gpu,
    pub(super) toolkit: egui_winit::State,
    pub(super) context: egui::Context,
    pub(super) window: Arc<Window>,

    /// Has the window look for news, from any thread.
    pub(super) wake: Arc<dyn Fn() + Send + Sync>,
    pub(super) navigation: Navigation,
    pub(super) input: InputState,
    pub(super) modifiers: ModifiersState,
    pub(super) panel: Panel,
    pub(super) settings: Settings,
    pub(super) redraw: Redraw,
    /// The frame that the device is not done with: see [`Redraw::submitted`].
    pub(super) drawing: Option<SyncPoint>,
    pub(super) timing: FrameTiming,
    pub(super) flown: FlightProgress,
    /// What was opened, and how it is read.
    pub(super) view: ViewOptions,
    pub(super) dropped: Vec<PathBuf>,
    pub(super) notice: Option<(String, Instant)>,
    pub(super) log: EventLog,
}

impl Viewer {
    /// Opens a window; `wake` is to make it look for news.
    pub fn new(
        events: &ActiveEventLoop,
        options: &WindowOptions,
        wake: Arc<dyn Fn() + Send + Sync>,
        started: Instant,
    ) -> anyhow::Result<Viewer> {
        let [width, height] = options.size;
        let attributes = Window::default_attributes()
            .with_title(title(&options.view.inputs))
            .with_inner_size(winit::dpi::LogicalSize::new(width, height))
            .with_min_inner_size(winit::dpi::LogicalSize::new(480, 320));
        let window = Arc::new(events.create_window(attributes).context(NoWindow)?);
        let gpu = Gpu::for_window(&options.gpu, &window)?;
        let pixels: [u32; 2] = window.inner_size().into();
        let swapchain = Swapchain::new(&gpu, window.clone(), pixels, LIMITS.frames_in_flight)?;
        let overlay = Overlay::new(&gpu, &swapchain)?;
        let context = egui::Context::default();
        panel::style(&context);
        let toolkit = egui_winit::State::new(
            context.clone(),
            egui::ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            None,
            None,
        );
        let (news, made) = (Arc::clone(&wake), Arc::clone(&wake));
        let view = options.view.clone();
        let mut data =
            Data::open(&gpu, view.inputs.clone(), &view.hidden, view.data.clone(), move || news())?;
        data.hold_uploads(true);
        let is_bridged = view.data.visibility.bridge > 0;
        let pipelines =
            Pipelines::make(&gpu, data.scene().pool().access(), view.data.surface, is_bridged, move || {
                made()
            });
        window.request_redraw();
        Ok(Viewer {
            canvas: Canvas::new(gpu.info().kind == DeviceKind::Cpu),
            saving: None,
            writer: Writer::default(),
            overlay,
            textures: Textures::new(&gpu),
            pipelines,
            swapchain,
            data,
            gpu,
            toolkit,
            context,
            window,
            wake,
            navigation: Navigation::new(view.fov)?,
            input: InputState::default(),
            modifiers: ModifiersState::empty(),
            panel: Panel::default(),
            settings: settings_of(&view),
            view,
            redraw: Redraw::new(started),
            drawing: None,
            timing: FrameTiming::new(started),
            flown: FlightProgress::default(),
            dropped: Vec::new(),
            notice: None,
            log: EventLog::new(options.log_events),
        })
    }

    /// Says something over the image, for a while.
    pub fn notify(&mut self, words: impl Into<String>) {
        let words = harmless(&words.into());
        self.log.line(format_args!("notice {words}"));
        self.notice = Some((words, Instant::now() + NOTICE));
    }

    /// Opens what `view` says in the place of all that is open.
    pub fn reopen(&mut self, view: ViewOptions) -> anyhow::Result<()> {
        // What is not of the view, but of this machine, stays as it is.
        let data = ReadOptions {
            host_bytes: self.view.data.host_bytes,
            device_bytes: self.view.data.device_bytes,
            cache: self.view.data.cache.clone(),
            ..view.data.clone()
        };
        self.view = ViewOptions { data: data.clone(), ..view };
        if self.saving.take().is_some() {
            self.notify("The picture was not saved: something else was opened");
        }
        self.canvas.clear();
        self.navigation.forget();
        self.panel.forget();
        self.settings = settings_of(&self.view);
        let surface = data.surface;
        let is_other = surface != self.data.options().surface;
        self.data.reopen(&self.gpu, self.view.inputs.clone(), &self.view.hidden, data)?;
        if is_other {
            self.data.hold_uploads(true);
            let is_bridged = self.settings.visibility.bridge > 0;
            let (access, wake) = (self.data.scene().pool().access(), Arc::clone(&self.wake));
            self.pipelines = Pipelines::make(&self.gpu, access, surface, is_bridged, move || wake());
        }
        self.name_window(&self.view.inputs);
        self.log.line(format_args!("opened {} inputs", self.view.inputs.len()));
        self.window.request_redraw();
        Ok(())
    }

    /// Opens what is open again, with its points standing for something else, and goes on as it is.
    pub fn show_as(&mut self, surface: Surface) -> anyhow::Result<()> {
        let camera = self
            .data
            .about()
            .map(|about| CameraPath::view(&self.navigation.camera).placed(|v| about.base.unplace(v)));
        let hidden: Vec<PathBuf> = self.data.hidden_files().map(Path::to_owned).collect();
        let mut inputs = self.data.shown_inputs(false);
        inputs.extend(hidden.iter().map(|path| path.clone().into_os_string()));
        let (settings, color) = (self.settings.clone(), Some(self.settings.color));
        let data = ReadOptions { surface, color, ..self.data.options().clone() };
        let saved = camera.transpose()?;
        self.log.line(format_args!("surface {}", surface.name()));
        self.reopen(ViewOptions { inputs, hidden, data, color, saved, ..self.view.clone() })?;
        self.settings = settings;
        Ok(())
    }

    /// Calls the window by what is open.
    pub fn name_window(&self, inputs: &[OsString]) {
        self.window.set_title(&title(inputs));
    }

    /// Whether scene and colours are what the settings say.
    pub fn is_applied(&self) -> bool {
        let is_read = self
            .data
            .about()
            .is_none_or(|about| self.settings.reading(about, self.data.reading()) == *self.data.reading());
        is_read
            && self.data.scene().visibility() == self.settings.seen()
            && self.canvas.has_colors_of(&self.data, &self.settings)
    }

    /// Makes the scene and the colours what the settings say.
    pub fn apply_settings(&mut self) -> anyhow::Result<()> {
        if self.data.about().is_some_and(|about| !has_mode(Some(about), self.settings.color)) {
            let what = if self.settings.color == ColorMode::Rgb { "RGB" } else { "a GPS time" };
            self.settings.color = ColorMode::Height;
            self.notify(format!("No file has {what}: heights are shown"));
        }
        if let Some(about) = self.data.about() {
            let reading = self.settings.reading(about, self.data.reading());
            if reading != *self.data.reading() {
                let (words, channel) = (reading.selection.words(), reading.channel.name());
                self.log.line(format_args!("reading {words}; {channel}"));
                self.data.set_reading(reading);
                self.redraw.outdate();
            }
        }
        let visibility = self.settings.seen();
        if self.data.scene().visibility() != visibility {
            let shown: Vec<_> = (0..=255u8).filter(|&c| visibility.classes.shows(c)).collect();
            let (hidden, bridge) = (visibility.hidden_flags.list(), visibility.bridge);
            self.log.line(format_args!("classes shown {} bridge {bridge} hidden {hidden}", shown.len()));
            self.data.scene_mut().switch_visibility(visibility)?;
            self.redraw.outdate();
        }
        let applied = match self.canvas.apply_colors(&self.data, &self.settings) {
            // A range that these data do not have.
            Err(error) if error.is::<AttributeError>() => {
                self.notify(error.to_string());
                if let Some(scale) = self.settings.scale_mut() {
                    scale.range = None;
                }
                self.canvas.apply_colors(&self.data, &self.settings)?
            }
            applied => applied?,
        };
        if applied {
            let (name, scale) = (self.settings.color.name(), self.settings.scale());
            let ramp = scale.ramp.map_or("usual".to_owned(), |ramp| ramp.name());
            let range = self.canvas.colors().and_then(|(_, table)| table.range);
            let range = range.map_or(String::new(), |(low, high)| format!(" {low:.2},{high:.2}"));
            self.log.line(format_args!("color {name} {ramp}{range}"));
            self.redraw.outdate();
        }
        Ok(())
    }
}

/// What is chosen at first.
fn settings_of(view: &ViewOptions) -> Settings {
    let color = view.color.unwrap_or(ColorMode::Height);
    let mut settings = Settings {
        color,
        heights: Scale::default(),
        intensities: Scale::default(),
        angles: Scale::default(),
        times: Scale::default(),
        above: Scale::default(),
        densities: Scale::default(),
        differences: Scale::default(),
        selection: view.data.selection.clone(),
        visibility: view.data.visibility,
        z_scale: view.z_scale,
        shade: view.shade,
    };
    if let Some(scale) = settings.scale_mut() {
        *scale = Scale { ramp: view.ramp, range: view.range };
    }
    settings
}

/// What the window is called: by its inputs, of many the first.
fn title(inputs: &[OsString]) -> String {
    let name = |input: &OsString| {
        let path = std::path::absolute(input).unwrap_or_default();
        path.file_name().map_or(input.clone(), |name| name.to_owned()).to_string_lossy().into_owned()
    };
    match inputs {
        [] => "lasray".to_owned(),
        [only] => format!("{} – lasray", name(only)),
        [first, rest @ ..] => format!("{} and {} more – lasray", name(first), rest.len()),
    }
}
