//! The window: opens at once, shows what is there, and answers while the rest is read.
//!
//! From below: `data` is what is loaded, `settings` what is chosen, `canvas` the image, `navigation` the camera, `redraw` when
//! the next frame is drawn, `panel` and `overlay` what stands beside and over the image. `viewer` has them all, `news`
//! takes what has come, `layout` and `frame` draw, `events` and `actions` answer the user; here they are tied to the event loop.

mod actions;
mod boxes;
mod canvas;
mod class_part;
mod color_part;
pub mod data;
mod events;
mod fates;
mod file_list;
mod flight;
mod frame;
mod input;
mod layers;
mod layout;
mod log;
mod navigate;
mod navigation;
mod news;
mod numbers;
mod options;
mod overlay;
mod pace;
mod panel;
mod pick;
mod pipelines;
mod redraw;
mod remarks;
mod save;
mod saving;
mod selection_part;
mod settings;
mod state;
mod statistics;
mod timing;
mod toolkit;
mod viewer;
pub mod watch;
mod widgets;

pub use options::{OpenedView, ViewOptions, WindowOptions};
pub use viewer::NoWindow;

use crate::problems::Problems;
use anyhow::Context as _;
use std::sync::Arc;
use std::time::Instant;
use viewer::Viewer;
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::WindowId;

/// From other threads.
enum WakeEvent {
    Data,
    Quit,
}

/// Opens the window and runs it to its end. What is wrong with inputs is printed as it comes up, and counted in
/// `problems`.
pub fn run(options: WindowOptions, problems: &mut Problems) -> anyhow::Result<()> {
    let started = Instant::now();
    let events = EventLoop::<WakeEvent>::with_user_event().build().context(NoWindow)?;
    let proxy = events.create_proxy();
    let quit = proxy.clone();
    // The loop may be gone already.
    crate::stop::on_request(move || drop(quit.send_event(WakeEvent::Quit)))?;
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
        to.write(&viewer.timing.statistics.json(waited)?, &options.protected)?;
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
    options: WindowOptions,
    proxy: EventLoopProxy<WakeEvent>,
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

impl ApplicationHandler<WakeEvent> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.viewer.is_none() {
            let proxy = self.proxy.clone();
            let wake = Arc::new(move || drop(proxy.send_event(WakeEvent::Data)));
            match Viewer::new(events, &self.options, wake, self.started) {
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

    fn user_event(&mut self, events: &ActiveEventLoop, wake: WakeEvent) {
        match (wake, &mut self.viewer) {
            (WakeEvent::Quit, _) => events.exit(),
            (WakeEvent::Data, Some(viewer)) => {
                let result = viewer.look();
                self.end(events, result);
            }
            (WakeEvent::Data, None) => {}
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(viewer) = &mut self.viewer else { return };
        if let WindowEvent::CloseRequested = event {
            return events.exit();
        }
        let result = match event {
            WindowEvent::RedrawRequested => viewer.draw(&self.options).map(|is_over| {
                if is_over {
                    events.exit();
                }
            }),
            event => viewer.event(event),
        };
        self.end(events, result);
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(viewer) = &self.viewer else { return };
        events.set_control_flow(match viewer.redraw.next() {
            Some(at) => ControlFlow::WaitUntil(at),
            None => ControlFlow::Wait,
        });
    }
}
