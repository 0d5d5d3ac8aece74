//! The window: opens at once, shows what is there, and answers while the rest is read.

mod actions;
pub mod data;
mod flight;
mod input;
mod moves;
mod navigate;
mod overlay;
mod pace;
mod panel;
mod programs;
mod redraw;
mod save;
mod saving;
mod statistics;
mod toolkit;
pub mod watch;

use crate::attribute::{ColorMode, ColorTable};
use crate::gpu::{DeviceKind, Gpu, GpuOptions, Overlay, Swapchain, SyncPoint};
use crate::output::{Protected, Target};
use crate::problems::Problems;
use crate::render::camera::{Camera, DEFAULT_ORBIT, Projection};
use crate::render::frame::{Renderer, Shade};
use crate::render::path::CameraPath;
use crate::render::screen::{Pick, Screen};
use crate::resident::scene::FRAMES_IN_FLIGHT;
use crate::text::harmless;
use anyhow::Context as _;
use data::Data;
use glam::DVec3;
use input::{Action, Input};
use pace::{Pace, Rest};
use panel::{Panel, Settings, Times};
use programs::Programs;
use saving::{Saving, Writer};
use statistics::Statistics;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{ModifiersState, PhysicalKey};
use winit::window::{Window, WindowId};

/// Why there is none, mostly.
const NO_WINDOW: &str = "no window can be opened: is there a display? (lasray render needs none)";
/// Samples that a resting picture adds up.
const SAMPLES: u32 = 16;
/// Views that Backspace goes back through.
const VIEWS: usize = 100;
/// How long a notice stays.
const NOTICE: Duration = Duration::from_secs(6);
/// Turns of the wheel closer than this are one move.
const ONE_MOVE: Duration = Duration::from_millis(700);
/// When to look again for what is under way.
const SOON: Duration = Duration::from_millis(6);
/// And for an image of a window that gives none.
const LATER: Duration = Duration::from_millis(150);
/// How often progress is shown, at least, where nothing else is new.
const PROGRESS: Duration = Duration::from_millis(60);
/// How long the device may still work at the frame before the last, until the window looks after its events again.
const PATIENCE: Duration = Duration::from_millis(30);

/// What the window opens with.
pub struct Options {
    /// Files, folders, lists and patterns.
    pub inputs: Vec<OsString>,
    /// How they are read, and what is shown of them.
    pub data: data::Options,
    /// The device.
    pub gpu: GpuOptions,
    /// The window's size, in the pixels of a screen of usual density.
    pub size: [u32; 2],
    /// What colours show; `None`: chosen from the data.
    pub color: Option<ColorMode>,
    /// Vertical exaggeration.
    pub z_scale: f64,
    /// Where the camera is: E, N, U of the files.
    pub eye: Option<DVec3>,
    /// What it looks at.
    pub target: Option<DVec3>,
    /// Azimuth and elevation, degrees, and a distance.
    pub orbit: Option<([f64; 2], Option<f64>)>,
    /// Vertical field of view, degrees.
    pub fov: f64,
    /// A camera path that is played, and how many frames of it.
    pub path: Option<(CameraPath, u32)>,
    /// How often.
    pub laps: u32,
    /// Close when the path is at its end.
    pub quit: bool,
    /// Where statistics of the frames go.
    pub json: Option<Target>,
    /// What they are not written over.
    pub protected: Protected,
    /// Tell on standard output what happens, for tests.
    pub log_events: bool,
}

/// From other threads.
enum Wake {
    Data,
    Quit,
}

/// Opens the window and runs it to its end. What is wrong with inputs is printed as it comes up, and counted in
/// `problems`.
pub fn run(options: Options, problems: &mut Problems) -> anyhow::Result<()> {
    let started = Instant::now();
    let events = EventLoop::<Wake>::with_user_event().build().context(NO_WINDOW)?;
    let proxy = events.create_proxy();
    let quit = proxy.clone();
    // The loop may be gone already.
    crate::stop::on_request(move || drop(quit.send_event(Wake::Quit)))?;
    let mut app = App { options, proxy, started, viewer: None, error: None };
    events.run_app(&mut app).context("the window's event loop")?;
    let App { options, mut viewer, error, .. } = app;
    if let Some(viewer) = &mut viewer {
        *problems = viewer.data.take_problems();
    }
    if let Some(error) = error {
        return Err(error);
    }
    let Some(viewer) = viewer else { return Ok(()) };
    if let Some(to) = &options.json {
        let waited = viewer.data.status().frames_waited;
        to.write(&viewer.statistics.json(waited)?, &options.protected)?;
    }
    let (gpu, failed) = (viewer.gpu.clone(), viewer.data.status().failed);
    drop(viewer);
    anyhow::ensure!(
        gpu.messages().is_empty() || !options.gpu.validate,
        "the validation layers reported errors"
    );
    match failed {
        Some(why) => anyhow::bail!(why),
        None => Ok(()),
    }
}

struct App {
    options: Options,
    proxy: EventLoopProxy<Wake>,
    started: Instant,
    viewer: Option<Viewer>,
    error: Option<anyhow::Error>,
}

impl App {
    fn end(&mut self, events: &ActiveEventLoop, result: anyhow::Result<()>) {
        if let Err(error) = result {
            self.error.get_or_insert(error);
            events.exit();
        }
    }
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.viewer.is_none() {
            match Viewer::new(events, &self.options, self.proxy.clone(), self.started) {
                Ok(viewer) => self.viewer = Some(viewer),
                Err(error) => self.end(events, Err(error)),
            }
        }
    }

    fn new_events(&mut self, events: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(viewer)) = (cause, &mut self.viewer) {
            let result = viewer.look();
            self.end(events, result);
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, wake: Wake) {
        match (wake, &mut self.viewer) {
            (Wake::Quit, _) => events.exit(),
            (Wake::Data, Some(viewer)) => {
                let result = viewer.look();
                self.end(events, result);
            }
            (Wake::Data, None) => {}
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(viewer) = &mut self.viewer else { return };
        if let WindowEvent::CloseRequested = event {
            return events.exit();
        }
        let result = match event {
            WindowEvent::RedrawRequested => viewer.redraw(&self.options).map(|is_over| {
                if is_over {
                    events.exit();
                }
            }),
            event => viewer.event(&self.options, event),
        };
        self.end(events, result);
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(viewer) = &self.viewer else { return };
        events.set_control_flow(match viewer.next {
            Some(at) => ControlFlow::WaitUntil(at),
            None => ControlFlow::Wait,
        });
    }
}

/// What the traced picture depends on, but for the data.
#[derive(Clone, PartialEq)]
struct Wanted {
    camera: Camera,
    settings: Settings,
    size: [u32; 2],
}

/// What is under the cursor, and what picture it was asked of.
#[derive(Clone, Copy, PartialEq)]
struct Question {
    cursor: [f64; 2],
    /// Pictures and samples since the start.
    version: u64,
}

// Fields are dropped in this order: what is on the device, the device, the window.
struct Viewer {
    screen: Screen,
    renderer: Option<Renderer>,
    /// Boxed: it is large, and seldom there.
    saving: Option<Box<Saving>>,
    writer: Writer,
    overlay: Overlay,
    textures: toolkit::Textures,
    programs: Programs,
    swapchain: Swapchain,
    data: Data,
    gpu: Gpu,
    toolkit: egui_winit::State,
    context: egui::Context,
    window: Arc<Window>,

    started: Instant,
    wake: Arc<dyn Fn() + Send + Sync>,
    /// Those are made that the first picture needs.
    has_programs: bool,
    camera: Camera,
    /// The camera shows the data.
    is_framed: bool,
    views: Vec<Camera>,
    input: Input,
    modifiers: ModifiersState,
    panel: Panel,
    settings: Settings,
    /// Of the mode that was asked for: a field that is the same everywhere may be drawn through another.
    colors: Option<(ColorMode, ColorTable)>,
    /// Where in the window the picture is.
    place: overlay::Place,
    wanted: Option<Wanted>,
    /// The picture being made is for a view that changes.
    is_coarse: bool,
    /// It was begun because the user changed something, not because of what arrived.
    is_urgent: bool,
    /// It is not finished.
    has_more: bool,
    /// What is shown is not what there is now.
    has_news: bool,
    /// A frame was asked for that could not be drawn yet.
    is_late: bool,
    /// More is on its way to the device.
    is_busy: bool,
    /// The last frame, until the device is done with it, and when it was begun.
    drawn: Option<(SyncPoint, Instant)>,
    rest: Rest,
    pace: Pace,
    version: u64,
    asked: Option<Question>,
    answers_due: bool,
    pick: Option<(Pick, Camera)>,
    held: DVec3,
    dropped: Vec<PathBuf>,
    notice: Option<(String, Instant)>,
    times: Times,
    /// Milliseconds since the last frame that went into taking what arrived.
    upload_ms: f64,
    last_frame: Option<Instant>,
    /// When one was shown.
    last_shown: Option<Instant>,
    last_look: Instant,
    last_zoom: Option<Instant>,
    last_flight: Option<Instant>,
    /// When the toolkit wants the next frame.
    repaint: Option<Instant>,
    flown: flight::Progress,
    statistics: Statistics,
    has_settled: bool,
    /// When to draw next if nothing happens.
    next: Option<Instant>,
    log_events: bool,
    /// Pixels of the window in the last frame.
    shown_size: [u32; 2],
    /// Where the checks of files are, as told last.
    checks: Vec<(usize, egui::Pos2)>,
}

impl Viewer {
    fn new(
        events: &ActiveEventLoop,
        options: &Options,
        proxy: EventLoopProxy<Wake>,
        started: Instant,
    ) -> anyhow::Result<Viewer> {
        let [width, height] = options.size;
        let attributes = Window::default_attributes()
            .with_title(title(&options.inputs))
            .with_inner_size(winit::dpi::LogicalSize::new(width, height))
            .with_min_inner_size(winit::dpi::LogicalSize::new(480, 320));
        let window = Arc::new(events.create_window(attributes).context(NO_WINDOW)?);
        let gpu = Gpu::for_window(&options.gpu, &window)?;
        let pixels: [u32; 2] = window.inner_size().into();
        let swapchain = Swapchain::new(&gpu, window.clone(), pixels, FRAMES_IN_FLIGHT)?;
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
        let wake: Arc<dyn Fn() + Send + Sync> = Arc::new(move || drop(proxy.send_event(Wake::Data)));
        let (news, made) = (Arc::clone(&wake), Arc::clone(&wake));
        let mut data = Data::open(&gpu, options.inputs.clone(), options.data.clone(), move || news())?;
        data.hold(true);
        let is_bridged = options.data.visibility.bridge > 0;
        let programs = Programs::make(&gpu, data.scene().pool().access(), is_bridged, move || made());
        let projection = Projection::Perspective { fov: options.fov };
        window.request_redraw();
        Ok(Viewer {
            screen: Screen::default(),
            renderer: None,
            saving: None,
            writer: Writer::default(),
            overlay,
            textures: toolkit::Textures::new(&gpu),
            programs,
            swapchain,
            data,
            pace: Pace::new(gpu.info().kind == DeviceKind::Cpu),
            gpu,
            toolkit,
            context,
            started,
            wake,
            has_programs: false,
            camera: Camera::orbit(DVec3::ZERO, DEFAULT_ORBIT, 100.0, projection)?,
            is_framed: false,
            views: Vec::new(),
            input: Input::default(),
            modifiers: ModifiersState::empty(),
            panel: Panel::default(),
            settings: Settings {
                color: options.color.unwrap_or(ColorMode::Height),
                visibility: options.data.visibility,
                z_scale: options.z_scale,
                shade: Shade::Lit,
            },
            colors: None,
            place: overlay::Place { rect: egui::Rect::ZERO, size: [0; 2] },
            wanted: None,
            is_coarse: true,
            is_urgent: false,
            has_more: false,
            has_news: false,
            is_late: false,
            is_busy: false,
            drawn: None,
            rest: Rest::default(),
            version: 0,
            asked: None,
            answers_due: false,
            pick: None,
            held: DVec3::ZERO,
            dropped: Vec::new(),
            notice: None,
            times: Times::default(),
            upload_ms: 0.0,
            last_frame: None,
            last_shown: None,
            last_look: started,
            last_zoom: None,
            last_flight: None,
            repaint: None,
            flown: flight::Progress::default(),
            statistics: Statistics::default(),
            has_settled: false,
            next: None,
            log_events: options.log_events,
            shown_size: [0; 2],
            checks: Vec::new(),
            window,
        })
    }

    /// One line for tests.
    fn log(&self, line: std::fmt::Arguments) {
        if self.log_events {
            println!("{line}");
        }
    }

    fn notify(&mut self, words: impl Into<String>) {
        let words = harmless(&words.into());
        self.log(format_args!("notice {words}"));
        self.notice = Some((words, Instant::now() + NOTICE));
    }

    fn event(&mut self, options: &Options, event: WindowEvent) -> anyhow::Result<()> {
        let is_tab = matches!(&event, WindowEvent::KeyboardInput { event, .. }
            if event.physical_key == PhysicalKey::Code(winit::keyboard::KeyCode::Tab));
        // The toolkit would walk through its widgets.
        let repaint =
            (!is_tab || self.panel.is_typing()) && self.toolkit.on_window_event(&self.window, &event).repaint;
        if repaint {
            self.window.request_redraw();
        }
        match event {
            WindowEvent::Resized(PhysicalSize { width, height }) => {
                self.swapchain.resize([width, height]);
                self.window.request_redraw();
            }
            WindowEvent::ScaleFactorChanged { .. } | WindowEvent::Occluded(false) => {
                self.window.request_redraw()
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                self.modifiers = modifiers.state();
                self.input.shift(self.modifiers.shift_key());
            }
            WindowEvent::Focused(false) => self.input.release_all(),
            WindowEvent::DroppedFile(path) => {
                self.dropped.push(path);
                self.window.request_redraw();
            }
            WindowEvent::CursorMoved { position, .. } => {
                let at = self.in_picture(position.x, position.y);
                if let Some(by) = self.input.moved(at, f64::from(self.place.size[1].max(1))) {
                    self.go(by)?;
                }
            }
            WindowEvent::CursorLeft { .. } => self.input.left(),
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. }
                if self.is_over_picture() =>
            {
                if let Some(by) = self.input.pressed(button, Instant::now()) {
                    self.go(by)?;
                }
            }
            WindowEvent::MouseInput { state: ElementState::Released, button, .. } => {
                self.input.released(button)
            }
            WindowEvent::MouseWheel { delta, .. } if self.is_over_picture() => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / 50.0,
                };
                if let Some(by) = self.input.wheel(notches) {
                    self.go(by)?;
                }
            }
            WindowEvent::KeyboardInput { event, .. } => {
                let PhysicalKey::Code(key) = event.physical_key else { return Ok(()) };
                let down = event.state == ElementState::Pressed;
                let control = self.modifiers.control_key() || self.modifiers.super_key();
                if down && self.is_typing() {
                    if key == winit::keyboard::KeyCode::Escape {
                        self.act(options, Action::Escape)?;
                    }
                    return Ok(());
                }
                if (!control || !down) && self.input.key(key, down) {
                    self.window.request_redraw();
                } else if down
                    && !event.repeat
                    && let Some(action) = input::action(key, control, self.modifiers.shift_key())
                {
                    self.act(options, action)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Whether keys are letters of a text.
    fn is_typing(&self) -> bool {
        self.panel.is_typing() || self.context.egui_wants_keyboard_input()
    }

    /// A place in the window, in pixels, from the picture's corner.
    fn in_picture(&self, x: f64, y: f64) -> [f64; 2] {
        let corner = self.place.rect.min * self.context.pixels_per_point();
        [x - f64::from(corner.x), y - f64::from(corner.y)]
    }

    fn is_over_picture(&self) -> bool {
        let Some(cursor) = self.input.cursor() else { return false };
        let at = self.place.rect.min
            + egui::vec2(cursor[0] as f32, cursor[1] as f32) / self.context.pixels_per_point();
        let is_free = self.context.layer_id_at(at).is_none_or(|layer| layer.order == egui::Order::Background);
        self.place.rect.contains(at) && is_free
    }
}

/// A path as it is told: absolute where that can be found out.
fn shown_path(path: &Path) -> String {
    std::path::absolute(path).unwrap_or(path.to_owned()).display().to_string()
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
