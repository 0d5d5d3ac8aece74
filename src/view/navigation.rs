//! The camera, and how it follows mouse and keys: what is held, the views before, and the flight by keys.

use super::canvas::Canvas;
use super::data::Data;
use super::input::Move;
use super::navigate::{self, Standard};
use super::options::ViewOptions;
use super::settings::Settings;
use crate::coords::Hull;
use crate::render::camera::{Camera, CameraError, DEFAULT_ORBIT, Projection};
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use crate::render::screen::Pick;
use glam::DVec3;
use std::time::{Duration, Instant};

/// Views that Backspace goes back through.
const VIEWS: usize = 100;
/// Turns of the wheel closer than this are one move.
const ONE_MOVE: Duration = Duration::from_millis(700);

/// What the camera moves over: the data, how they are shown, and the image they are seen in.
pub type SeenData<'a> = (&'a Data, &'a Settings, &'a Canvas);

/// See the module. What moves the camera tells whether it did.
pub struct Navigation {
    /// Where it is now.
    pub camera: Camera,
    /// The camera shows the data.
    is_framed: bool,
    /// Of perspectives, degrees.
    fov: f64,
    /// The other projection is wanted, as soon as it is known what lies in the middle.
    is_toggling: bool,
    views: Vec<Camera>,
    held: DVec3,
    last_zoom: Option<Instant>,
    last_flight: Option<Instant>,
}

impl Navigation {
    /// A camera that sees nothing yet.
    pub fn new(fov: f64) -> Result<Navigation, CameraError> {
        Ok(Navigation {
            camera: Camera::orbit(DVec3::ZERO, DEFAULT_ORBIT, 100.0, Projection::Perspective { fov })?,
            is_framed: false,
            fov,
            is_toggling: false,
            views: Vec::new(),
            held: DVec3::ZERO,
            last_zoom: None,
            last_flight: None,
        })
    }

    /// Whether the camera shows the data.
    pub fn is_framed(&self) -> bool {
        self.is_framed
    }

    /// Forgets where it was: something else is open.
    pub fn forget(&mut self) {
        (self.is_framed, self.is_toggling, self.last_zoom, self.last_flight) = (false, false, None, None);
        self.views.clear();
    }

    /// Goes to `camera`; Backspace comes back.
    fn go_from_here(&mut self, camera: Camera) {
        self.keep_view();
        self.turn_to(camera);
    }

    fn turn_to(&mut self, camera: Camera) {
        if let Projection::Perspective { fov } = camera.projection() {
            self.fov = fov;
        }
        self.camera = camera;
    }

    /// Keeps the view for Backspace.
    fn keep_view(&mut self) {
        if self.is_framed && self.views.last() != Some(&self.camera) {
            self.views.push(self.camera);
            if self.views.len() > VIEWS {
                self.views.remove(0);
            }
        }
    }

    /// The view before.
    pub fn back(&mut self) {
        if let Some(camera) = self.views.pop() {
            self.turn_to(camera);
        }
    }

    /// What lies at a place of the image: the last answer if it is near and of this view, else a place as far away as the
    /// target.
    fn place_at(&self, at: [f64; 2], canvas: &Canvas) -> anyhow::Result<DVec3> {
        let share = canvas.area.share(at);
        let size = canvas.size();
        if let Some((Pick { at: asked, point: Some(point) }, camera)) = canvas.pick()
            && *camera == self.camera
        {
            let [dx, dy] = [0, 1].map(|axis| (asked[axis] - share[axis]) * f64::from(size[axis]));
            if dx.hypot(dy) < 40.0 {
                // As far away, under this very pixel.
                let (origin, direction) = navigate::ray(&self.camera, share, size)?;
                let depth = (point.shown - origin).dot(self.camera.forward());
                return Ok(origin + direction * depth);
            }
        }
        Ok(navigate::on_target_plane(&self.camera, share, size)?)
    }

    /// Follows the mouse.
    pub fn go(&mut self, by: Move, (data, settings, canvas): SeenData) -> anyhow::Result<bool> {
        if !self.is_framed {
            return Ok(false);
        }
        let Some(bounds) = data.about().map(|about| about.bounds) else { return Ok(false) };
        let size = canvas.size();
        let moved = match by {
            Move::Grab(at) => {
                self.keep_view();
                self.held = self.place_at(at, canvas)?;
                return Ok(false);
            }
            Move::Orbit(turn) => navigate::orbit(&self.camera, self.held, turn),
            Move::Pan(pixels) => navigate::pan(&self.camera, self.held, pixels, size),
            Move::Look(turn) => navigate::look(&self.camera, turn),
            Move::Zoom { at, factor } => {
                if self.last_zoom.is_none_or(|last| last.elapsed() > ONE_MOVE) {
                    self.keep_view();
                    self.held = self.place_at(at, canvas)?;
                }
                self.last_zoom = Some(Instant::now());
                // The cursor may have moved on between two notches.
                let depth = (self.held - self.camera.eye()).dot(self.camera.forward());
                let (origin, direction) = navigate::ray(&self.camera, canvas.area.share(at), size)?;
                self.held = origin + direction * depth;
                navigate::zoom(&self.camera, self.held, factor, &bounds)
            }
            Move::Recentre(at) => {
                let place = self.place_at(at, canvas)?;
                navigate::recentre(&self.camera, place)
            }
        };
        // What cannot be seen from there is not gone to.
        let moved = moved
            .and_then(|camera| before_all(&camera, data, settings))
            .ok()
            .filter(|camera| canvas.can_draw(data, settings, camera));
        moved.inspect(|camera| self.camera = *camera);
        Ok(moved.is_some())
    }

    /// Flies by keys: right, forward and up in distances to the target a second; `None`: no key is held.
    pub fn fly(&mut self, by: Option<[f64; 3]>, (data, settings, canvas): SeenData) {
        let now = Instant::now();
        let Some([right, forward, up]) = by.filter(|_| self.is_framed) else {
            self.last_flight = None;
            return;
        };
        let Some(last) = self.last_flight.replace(now) else { return self.keep_view() };
        let seconds = (now - last).as_secs_f64().min(0.25);
        let camera = &self.camera;
        let moved = match (camera.projection(), data.about()) {
            // There is no nearer: forward is larger.
            (Projection::Orthographic { units_per_pixel }, Some(about)) => {
                let by = (camera.right() * right + DVec3::Z * up) * (seconds * units_per_pixel);
                let factor = (-forward * seconds).exp();
                navigate::shift(camera, by * f64::from(canvas.size()[1]))
                    .and_then(|camera| navigate::zoom(&camera, camera.target(), factor, &about.bounds))
                    .and_then(|camera| before_all(&camera, data, settings))
            }
            _ => {
                let distance = (camera.target() - camera.eye()).length();
                let by = camera.right() * right + camera.forward() * forward + DVec3::Z * up;
                navigate::shift(camera, by * (seconds * distance))
            }
        };
        if let Ok(camera) = moved
            && canvas.can_draw(data, settings, &camera)
        {
            self.camera = camera;
        }
    }

    /// A projection of the kind; what is framed gets the scale that it needs.
    fn kind(&self, is_parallel: bool) -> Projection {
        match is_parallel {
            true => Projection::Orthographic { units_per_pixel: 1.0 },
            false => Projection::Perspective { fov: self.fov },
        }
    }

    /// All that is shown, from these angles; `is_parallel`: `None` as it is now.
    pub fn look_from(
        &mut self,
        angles: [f64; 2],
        is_parallel: Option<bool>,
        (data, settings, canvas): SeenData,
    ) {
        let Some(framed) = framed(data, settings) else { return };
        let is_parallel = is_parallel.unwrap_or(navigate::is_parallel(self.camera.projection()));
        if let Ok(camera) = navigate::framing(&framed, angles, self.kind(is_parallel), canvas.size()) {
            self.go_from_here(camera);
        }
    }

    /// All of a part of the data, as it is looked at now.
    pub fn look_at(&mut self, hull: &Hull, (data, settings, canvas): SeenData) {
        let Some(shown) = shown(hull, data, settings) else { return };
        let projection = self.kind(navigate::is_parallel(self.camera.projection()));
        let camera = navigate::framing(&shown, self.camera.angles(), projection, canvas.size());
        if let Ok(camera) = camera.and_then(|camera| before_all(&camera, data, settings)) {
            self.go_from_here(camera);
        }
    }

    /// Brings a parallel camera back before all of the data, which may be others or higher than they were.
    pub fn keep_before(&mut self, data: &Data, settings: &Settings) {
        if let Ok(camera) = before_all(&self.camera, data, settings) {
            self.camera = camera;
        }
    }

    /// North comes up.
    pub fn north_up(&mut self, (data, settings, _): SeenData) {
        let turned = navigate::north_up(&self.camera);
        if let Ok(camera) = turned.and_then(|camera| before_all(&camera, data, settings)) {
            self.go_from_here(camera);
        }
    }

    /// Asks for the other projection; see [`Navigation::toggle`].
    pub fn ask_for_toggle(&mut self) {
        self.is_toggling = self.is_framed;
    }

    /// Whether it is to be found out what lies in the middle of the image.
    pub fn is_toggling(&self) -> bool {
        self.is_toggling
    }

    /// Turns to the other projection where that was asked for: what lies at `middle`, in the middle of the image, stays as
    /// large as it is. Where nothing is known to lie there: what is as far away as the target.
    pub fn toggle(&mut self, middle: Option<DVec3>, (data, settings, canvas): SeenData) {
        if !std::mem::take(&mut self.is_toggling) {
            return;
        }
        let depth = (middle.unwrap_or(self.camera.target()) - self.camera.eye()).dot(self.camera.forward());
        let toggled = navigate::toggled(&self.camera, depth, self.fov, canvas.size());
        let toggled = toggled.and_then(|camera| before_all(&camera, data, settings)).ok();
        if let Some(camera) = toggled.filter(|camera| canvas.can_draw(data, settings, camera)) {
            self.go_from_here(camera);
        }
    }

    /// Coordinates of the world's system, from near.
    pub fn go_to(&mut self, (e, n, u): (f64, f64, Option<f64>), (data, settings, canvas): SeenData) -> bool {
        let size = canvas.size();
        let Some(about) = data.about() else { return false };
        let (bounds, base) = (about.bounds, about.base);
        let middle = base.unplace(bounds.center());
        let world = base.place(DVec3::new(e, n, u.unwrap_or(middle.z)));
        let shown = world.with_z(bounds.min.z + (world.z - bounds.min.z) * settings.z_scale);
        let length = (bounds.max - bounds.min).truncate().max_element();
        let cell = data.grid().0.cell();
        let distance = (self.camera.target() - self.camera.eye()).length().min(length * 0.1).max(cell);
        let angles = self.camera.angles();
        let projection = match self.camera.projection() {
            Projection::Orthographic { units_per_pixel } => {
                let near = length * 0.1 / f64::from(size[1].max(1));
                Projection::Orthographic { units_per_pixel: units_per_pixel.min(near) }
            }
            perspective => perspective,
        };
        let camera = Camera::orbit(shown, angles, distance, projection);
        let Ok(camera) = camera.and_then(|camera| before_all(&camera, data, settings)) else {
            return false;
        };
        self.go_from_here(camera);
        true
    }

    /// The view of a path that was read. Errors: why there is none, in words.
    pub fn open(&mut self, view: &CameraPath, data: &Data, settings: &Settings) -> Result<(), String> {
        let Some(about) = data.about() else { return Ok(()) };
        let view = view.placed(|v| about.base.place(v)).map_err(|e| e.to_string())?;
        let camera = view.camera(0).and_then(|camera| before_all(&camera, data, settings));
        self.go_from_here(camera.map_err(|e| e.to_string())?);
        Ok(())
    }

    /// The first view: as the options say, or all of the data. `false`: nothing is known of them yet.
    pub fn first_view(&mut self, options: &ViewOptions, seen: SeenData) -> anyhow::Result<bool> {
        let (data, settings, canvas) = seen;
        let (Some(framed), Some(about)) = (framed(data, settings), data.about()) else { return Ok(false) };
        let place = |v: DVec3| about.base.place(v);
        let (projection, usual) = match options.ortho {
            Some(units_per_pixel) => (Projection::Orthographic { units_per_pixel }, Standard::Top.angles()),
            None => (Projection::Perspective { fov: options.fov }, DEFAULT_ORBIT),
        };
        let (angles, distance) = options.orbit.unwrap_or((usual, None));
        let size = canvas.size();
        let target = options.target.map(place);
        let camera = match (&options.saved, options.eye.map(place), target) {
            (Some(saved), ..) => saved.placed(place)?.camera(0)?,
            (None, Some(eye), Some(target)) => Camera::look_at(eye, target, projection)?,
            (None, _, target) => {
                // The scale that was asked for is kept.
                let whole = match options.ortho {
                    Some(_) => Camera::frame_hull(&framed, angles, projection, size)?,
                    None => navigate::framing(&framed, angles, projection, size)?,
                };
                match (target, distance) {
                    (None, None) => whole,
                    (target, distance) => {
                        let distance = distance.unwrap_or((whole.eye() - framed.bounds().center()).length());
                        Camera::orbit(
                            target.unwrap_or(framed.bounds().center()),
                            angles,
                            distance,
                            projection,
                        )?
                    }
                }
            }
        };
        self.turn_to(before_all(&camera, data, settings)?);
        self.is_framed = true;
        Ok(true)
    }
}

/// What is framed of what is shown, in light with the slab below it, as shown.
fn framed(data: &Data, settings: &Settings) -> Option<Hull> {
    shown(&data.about()?.shown_hull(data.is_first()), data, settings)
}

/// A part of the data, in light with the slab below it, as shown.
fn shown(hull: &Hull, data: &Data, settings: &Settings) -> Option<Hull> {
    let about = data.about()?;
    let cell = data.grid().0.cell();
    let hull = match settings.shade {
        Shade::Lit => hull.of_cells(cell).on_slab(&about.outline(data.is_first()).slab(cell)),
        Shade::None => hull.of_cells(cell),
    };
    Some(hull.exaggerated(settings.z_scale, about.bounds.min.z))
}

/// The camera, so far back that a parallel one has all of the data before it.
fn before_all(camera: &Camera, data: &Data, settings: &Settings) -> Result<Camera, CameraError> {
    let Some(about) = data.about() else { return Ok(*camera) };
    let shown = about.bounds.exaggerated(settings.z_scale, about.bounds.min.z);
    navigate::before_all(camera, &shown.of_cells(data.grid().0.cell()))
}
