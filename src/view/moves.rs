//! How the camera follows mouse and keys.

use super::input::Move;
use super::redraw::{floor, traced};
use super::{ONE_MOVE, Options, VIEWS, Viewer, navigate};
use crate::coords::Bounds;
use crate::render::camera::{Camera, DEFAULT_ORBIT, Projection};
use crate::render::screen::Pick;
use glam::DVec3;
use std::time::Instant;

impl Viewer {
    pub(super) fn set(&mut self, camera: Camera) {
        self.camera = camera;
        self.window.request_redraw();
    }

    /// Keeps the view for Backspace.
    pub(super) fn keep_view(&mut self) {
        if self.is_framed && self.views.last() != Some(&self.camera) {
            self.views.push(self.camera);
            if self.views.len() > VIEWS {
                self.views.remove(0);
            }
        }
    }

    /// Shares of the picture's width and height.
    pub(super) fn share(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [width, height] = self.place.size.map(|n| f64::from(n.max(1)));
        [x / width, y / height]
    }

    /// What lies at a place of the picture: the last answer if it is near and of this view, else a place as far away
    /// as the target.
    fn place_at(&self, at: [f64; 2]) -> anyhow::Result<DVec3> {
        let share = self.share(at);
        let size = self.place.size;
        if let Some((Pick { at: asked, place: Some(place) }, camera)) = &self.pick
            && *camera == self.camera
        {
            let [dx, dy] = [0, 1].map(|axis| (asked[axis] - share[axis]) * f64::from(size[axis]));
            if dx.hypot(dy) < 40.0 {
                // As far away, under this very pixel.
                let (origin, direction) = navigate::ray(&self.camera, share, size)?;
                let depth = (place.shown - origin).dot(self.camera.forward());
                return Ok(origin + direction * depth);
            }
        }
        Ok(navigate::on_target_plane(&self.camera, share, size)?)
    }

    pub(super) fn go(&mut self, by: Move) -> anyhow::Result<()> {
        if !self.is_framed {
            return Ok(());
        }
        let Some(bounds) = self.data.about().map(|about| about.bounds) else { return Ok(()) };
        let size = self.place.size;
        let moved = match by {
            Move::Grab(at) => {
                self.keep_view();
                self.held = self.place_at(at)?;
                return Ok(());
            }
            Move::Orbit(turn) => navigate::orbit(&self.camera, self.held, turn),
            Move::Pan(pixels) => navigate::pan(&self.camera, self.held, pixels, size),
            Move::Look(turn) => navigate::look(&self.camera, turn),
            Move::Zoom { at, factor } => {
                if self.last_zoom.is_none_or(|last| last.elapsed() > ONE_MOVE) {
                    self.keep_view();
                    self.held = self.place_at(at)?;
                }
                self.last_zoom = Some(Instant::now());
                // The cursor may have moved on between two notches.
                let depth = (self.held - self.camera.eye()).dot(self.camera.forward());
                let (origin, direction) = navigate::ray(&self.camera, self.share(at), size)?;
                self.held = origin + direction * depth;
                navigate::zoom(&self.camera, self.held, factor, &bounds)
            }
            Move::Recentre(at) => {
                let place = self.place_at(at)?;
                navigate::recentre(&self.camera, place)
            }
        };
        // What cannot be seen from there is not gone to.
        if let Ok(camera) = moved
            && self.can_draw(&camera)
        {
            self.set(camera);
        }
        Ok(())
    }

    /// Whether a picture from there is not too wide to be drawn.
    fn can_draw(&self, camera: &Camera) -> bool {
        let view = traced(&self.data, &self.settings, camera, self.colors.as_ref(), self.place.size);
        view.zip(self.renderer.as_ref()).is_none_or(|(view, renderer)| renderer.check(&view).is_ok())
    }

    /// Where most of the data is, with the slab below it, as shown.
    pub(super) fn framed(&self) -> Option<Bounds> {
        let about = self.data.about()?;
        let slab = Bounds { min: about.bounds.min.with_z(floor(&self.data)?), ..about.bounds };
        let cell = self.data.grid().0.cell();
        Some(slab.exaggerated(self.settings.z_scale, about.bounds.min.z).of_cells(cell))
    }

    pub(super) fn look_from(&mut self, angles: [f64; 2]) {
        let Some(framed) = self.framed() else { return };
        // A parallel projection keeps its scale, which need not show all: frames are perspective.
        let projection = match self.camera.projection() {
            Projection::Orthographic { .. } => Projection::default(),
            perspective => perspective,
        };
        if let Ok(camera) = Camera::frame(&framed, angles, projection, self.place.size) {
            self.keep_view();
            self.set(camera);
        }
    }

    /// The first view: as the options say, or all of the data.
    pub(super) fn first_view(&mut self, options: &Options) -> anyhow::Result<()> {
        let (Some(framed), Some(about)) = (self.framed(), self.data.about()) else { return Ok(()) };
        let place = |v: DVec3| about.base.place(v);
        let projection = Projection::Perspective { fov: options.fov };
        let (angles, distance) = options.orbit.unwrap_or((DEFAULT_ORBIT, None));
        let size = self.place.size;
        let target = options.target.map(place);
        let camera = match (options.eye.map(place), target) {
            (Some(eye), Some(target)) => Camera::look_at(eye, target, projection)?,
            (_, target) => {
                let whole = Camera::frame(&framed, angles, projection, size)?;
                match (target, distance) {
                    (None, None) => whole,
                    (target, distance) => {
                        let distance = distance.unwrap_or((whole.eye() - framed.center()).length());
                        Camera::orbit(target.unwrap_or(framed.center()), angles, distance, projection)?
                    }
                }
            }
        };
        if options.color.is_none() {
            self.settings.color = about.color;
        }
        self.is_framed = true;
        self.set(camera);
        Ok(())
    }

    pub(super) fn fly(&mut self) {
        let now = Instant::now();
        if !self.input.is_flying() || !self.is_framed {
            self.last_flight = None;
            return;
        }
        let Some(last) = self.last_flight.replace(now) else { return self.keep_view() };
        let seconds = (now - last).as_secs_f64().min(0.25);
        let [right, forward, up] = self.input.flight();
        let camera = &self.camera;
        let distance = (camera.target() - camera.eye()).length();
        let by = camera.right() * right + camera.forward() * forward + DVec3::Z * up;
        if let Ok(camera) = navigate::shift(camera, by * (seconds * distance))
            && self.can_draw(&camera)
        {
            self.camera = camera;
        }
    }

    pub(super) fn go_to(&mut self, (e, n, u): (f64, f64, Option<f64>)) {
        let Some(about) = self.data.about() else { return };
        let (bounds, base) = (about.bounds, about.base);
        let middle = base.unplace(bounds.center());
        let world = base.place(DVec3::new(e, n, u.unwrap_or(middle.z)));
        let shown = world.with_z(bounds.min.z + (world.z - bounds.min.z) * self.settings.z_scale);
        let length = (bounds.max - bounds.min).truncate().max_element();
        let cell = self.data.grid().0.cell();
        let distance = (self.camera.target() - self.camera.eye()).length().min(length * 0.1).max(cell);
        let angles = self.camera.angles();
        if let Ok(camera) = Camera::orbit(shown, angles, distance, self.camera.projection()) {
            self.keep_view();
            self.set(camera);
        }
    }
}
