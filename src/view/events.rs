//! What the window tells: keys, mouse, sizes and files that are dropped.

use super::input::{self, Action, Move};
use super::overlay;
use super::viewer::Viewer;
use std::time::Instant;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::PhysicalKey;

impl Viewer {
    /// Answers an event of the window, but for redraws and the end.
    pub fn event(&mut self, event: WindowEvent) -> anyhow::Result<()> {
        let is_tab = matches!(&event, WindowEvent::KeyboardInput { event, .. }
            if event.physical_key == PhysicalKey::Code(winit::keyboard::KeyCode::Tab));
        // The toolkit would walk through its widgets.
        let repaint = (!is_tab || self.panel.boxes.is_typing())
            && self.toolkit.on_window_event(&self.window, &event).repaint;
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
                let at = self.in_image(position.x, position.y);
                if let Some(by) = self.input.moved(at, f64::from(self.canvas.size()[1].max(1))) {
                    self.go(by)?;
                }
            }
            WindowEvent::CursorLeft { .. } => {
                self.input.left();
                // What is told of the place under it is of the middle now.
                self.window.request_redraw();
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button: MouseButton::Left, .. }
                if self.is_over_image() && self.is_over_compass() =>
            {
                self.act(Action::NorthUp)?;
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. } if self.is_over_image() => {
                if let Some(by) = self.input.pressed(button, Instant::now()) {
                    self.go(by)?;
                }
            }
            WindowEvent::MouseInput { state: ElementState::Released, button, .. } => {
                if let Some(at) = self.input.released(button) {
                    self.canvas.keep(at, self.settings.z_scale);
                    self.window.request_redraw();
                }
            }
            WindowEvent::MouseWheel { delta, .. } if self.is_over_image() => {
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
                        self.act(Action::Escape)?;
                    }
                    return Ok(());
                }
                if (!control || !down) && self.input.key(key, down) {
                    self.window.request_redraw();
                } else if down
                    && !event.repeat
                    && let Some(action) = input::action(key, control, self.modifiers.shift_key())
                {
                    self.act(action)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn go(&mut self, by: Move) -> anyhow::Result<()> {
        if self.navigation.go(by, (&self.data, &self.settings, &self.canvas))? {
            self.window.request_redraw();
        }
        Ok(())
    }

    /// Whether keys are letters of a text.
    fn is_typing(&self) -> bool {
        self.panel.boxes.is_typing() || self.context.egui_wants_keyboard_input()
    }

    /// A place in the window, in pixels, from the image's corner.
    fn in_image(&self, x: f64, y: f64) -> [f64; 2] {
        let corner = self.canvas.area.rect.min * self.context.pixels_per_point();
        [x - f64::from(corner.x), y - f64::from(corner.y)]
    }

    /// Where the cursor is, points.
    fn cursor_at(&self) -> Option<egui::Pos2> {
        let [x, y] = self.input.cursor()?;
        Some(self.canvas.area.rect.min + egui::vec2(x as f32, y as f32) / self.context.pixels_per_point())
    }

    fn is_over_image(&self) -> bool {
        let Some(at) = self.cursor_at() else { return false };
        let is_free = self.context.layer_id_at(at).is_none_or(|layer| layer.order == egui::Order::Background);
        self.canvas.area.rect.contains(at) && is_free
    }

    /// Over the compass, while there is one.
    fn is_over_compass(&self) -> bool {
        let (middle, radius) = overlay::compass(self.canvas.area);
        self.navigation.is_framed() && self.cursor_at().is_some_and(|at| at.distance(middle) <= radius)
    }
}
