//! What mouse and keys mean. Pure: events in, moves out.

use super::navigate::Standard;
use std::collections::BTreeSet;
use std::time::{Duration, Instant};
use winit::event::MouseButton;
use winit::keyboard::KeyCode;

/// Two clicks closer than this, in time and pixels, are a double click.
const DOUBLE: (Duration, f64) = (Duration::from_millis(400), 6.0);
/// Degrees that a drag across the image's height turns by.
const TURN: f64 = 180.0;
/// Distance from a place that one notch of the wheel leaves.
const NOTCH: f64 = 0.85;
/// Change of the flying speed by one notch.
const FASTER: f64 = 1.25;

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// All of the data.
    FrameAll,
    /// A standard view.
    Standard(Standard),
    /// Parallel rays, or from the eye.
    ToggleProjection,
    /// North comes up.
    NorthUp,
    /// The view before.
    Back,
    /// Asks for coordinates.
    GoTo,
    /// Writes the image.
    SaveImage,
    /// Writes the view.
    SaveView,
    /// Asks for what is to be opened: files, a folder or a view.
    Open,
    /// Copies the command line that draws this.
    CopyCommand,
    /// Copies the coordinates of what was clicked on, or lies under the cursor.
    CopyPoint,
    /// Shows or hides the panel.
    TogglePanel,
    /// Shows or hides the list of keys.
    ToggleKeys,
    /// The next colour mode.
    NextColor,
    /// The next preset of classes.
    NextPreset,
    /// Bridges holes or not.
    ToggleBridge,
    /// Light or plain colours.
    ToggleLight,
    /// Closes what is open.
    Escape,
}

/// The list of keys: what they do, and the keys.
pub const KEYS: [(&str, &str); 26] = [
    ("Left drag", "orbit around the point under the cursor"),
    ("Right drag", "pan"),
    ("Wheel", "zoom to the cursor"),
    ("Click", "keep what lies there in the status bar; Esc lets go"),
    ("Double click", "recentre"),
    ("W A S D", "fly forward, left, back, right"),
    ("Q E", "fly down, up"),
    ("… and drag", "look around while flying"),
    ("… and wheel", "flying speed; Shift: four times as fast"),
    ("F", "frame all that is shown"),
    ("1 … 5", "parallel: from above, to the north, east, south, west"),
    ("6", "oblique, in perspective"),
    ("O", "parallel or perspective"),
    ("Backspace", "the view before"),
    ("G", "go to coordinates"),
    ("C, V", "next colour mode; next classes: bare earth, buildings, …"),
    ("B", "bridge small holes"),
    ("L", "light, or plain colours"),
    ("Tab", "panel"),
    ("P", "save the picture; from above, parallel: with its place"),
    ("Ctrl+S", "save the view: files, camera, colours, layers"),
    ("Ctrl+O", "open files, a folder or a saved view (or drop them)"),
    ("Ctrl+C", "copy the command that draws this view"),
    ("Ctrl+Shift+C", "copy E, N, U of the kept point, or under the cursor"),
    ("Click on N", "turn north up"),
    ("? or F1", "this list"),
];

/// What a key that went down does; `control`: with Ctrl, on macOS Command.
pub fn action(key: KeyCode, control: bool, shift: bool) -> Option<Action> {
    let standard = |k: usize| Some(Action::Standard(Standard::ALL[k]));
    if control {
        return match key {
            KeyCode::KeyS => Some(Action::SaveView),
            KeyCode::KeyO => Some(Action::Open),
            KeyCode::KeyC if shift => Some(Action::CopyPoint),
            KeyCode::KeyC => Some(Action::CopyCommand),
            _ => None,
        };
    }
    match key {
        KeyCode::KeyF => Some(Action::FrameAll),
        KeyCode::Digit1 | KeyCode::Numpad1 => standard(0),
        KeyCode::Digit2 | KeyCode::Numpad2 => standard(1),
        KeyCode::Digit3 | KeyCode::Numpad3 => standard(2),
        KeyCode::Digit4 | KeyCode::Numpad4 => standard(3),
        KeyCode::Digit5 | KeyCode::Numpad5 => standard(4),
        KeyCode::Digit6 | KeyCode::Numpad6 => standard(5),
        KeyCode::KeyO => Some(Action::ToggleProjection),
        KeyCode::Backspace => Some(Action::Back),
        KeyCode::KeyG => Some(Action::GoTo),
        KeyCode::KeyP => Some(Action::SaveImage),
        KeyCode::KeyC => Some(Action::NextColor),
        KeyCode::KeyV => Some(Action::NextPreset),
        KeyCode::KeyB => Some(Action::ToggleBridge),
        KeyCode::KeyL => Some(Action::ToggleLight),
        KeyCode::Tab => Some(Action::TogglePanel),
        KeyCode::F1 => Some(Action::ToggleKeys),
        KeyCode::Slash if shift => Some(Action::ToggleKeys),
        KeyCode::Escape => Some(Action::Escape),
        _ => None,
    }
}

/// A move of the camera, in pixels from the image's top left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// A drag begins here: what lies here is held.
    Grab([f64; 2]),
    /// Turns about what is held, degrees of azimuth and elevation.
    Orbit([f64; 2]),
    /// Moves what is held by pixels.
    Pan([f64; 2]),
    /// Turns the camera where it is, degrees.
    Look([f64; 2]),
    /// Brings the eye to this share of its distance from what lies at `at`.
    Zoom {
        /// Pixels.
        at: [f64; 2],
        /// Below 1: nearer.
        factor: f64,
    },
    /// Brings what lies here to the middle.
    Recentre([f64; 2]),
}

/// Whether two places are so near, in pixels, that no drag lies between them.
fn is_near(a: [f64; 2], b: [f64; 2]) -> bool {
    (a[0] - b[0]).hypot(a[1] - b[1]) <= DOUBLE.1
}

/// Mouse and held keys over the image.
#[derive(Debug, Default)]
pub struct InputState {
    cursor: Option<[f64; 2]>,
    dragged: Option<MouseButton>,
    click: Option<(Instant, [f64; 2])>,
    /// Where the left button went down, until the cursor is elsewhere: there it is a click.
    pressed_at: Option<[f64; 2]>,
    held: BTreeSet<KeyCode>,
    faster: bool,
    speed: Option<f64>,
}

impl InputState {
    /// Where the cursor is, if it is over the window.
    pub fn cursor(&self) -> Option<[f64; 2]> {
        self.cursor
    }

    /// The cursor moved; `height`: of the image, pixels.
    pub fn moved(&mut self, to: [f64; 2], height: f64) -> Option<Move> {
        let from = self.cursor.replace(to)?;
        self.pressed_at = self.pressed_at.filter(|&at| is_near(at, to));
        let by = [to[0] - from[0], to[1] - from[1]];
        if by == [0.0; 2] {
            return None;
        }
        // The world turns with the hand: to the right the azimuth grows, downward the eye rises.
        let turn = by.map(|pixels| pixels * TURN / height);
        match self.dragged? {
            _ if self.is_flying() => Some(Move::Look(turn.map(|angle| angle * 0.5))),
            MouseButton::Left => Some(Move::Orbit(turn)),
            _ => Some(Move::Pan(by)),
        }
    }

    /// The cursor left the window.
    pub fn left(&mut self) {
        if self.dragged.is_none() {
            self.cursor = None;
        }
    }

    /// A button went down over the image.
    pub fn pressed(&mut self, button: MouseButton, now: Instant) -> Option<Move> {
        let at = self.cursor?;
        if !matches!(button, MouseButton::Left | MouseButton::Right) {
            return None;
        }
        self.dragged = Some(button);
        if button == MouseButton::Left {
            let twice = self.click.is_some_and(|(then, place)| now - then <= DOUBLE.0 && is_near(place, at));
            self.click = (!twice).then_some((now, at));
            self.pressed_at = (!twice).then_some(at);
            if twice {
                self.dragged = None;
                return Some(Move::Recentre(at));
            }
        }
        Some(Move::Grab(at))
    }

    /// A button went up; where it was a click, and no part of a double one, its place.
    pub fn released(&mut self, button: MouseButton) -> Option<[f64; 2]> {
        if self.dragged != Some(button) {
            return None;
        }
        self.dragged = None;
        self.pressed_at.take().filter(|_| button == MouseButton::Left)
    }

    /// The wheel turned by `notches`, away from the user above 0.
    pub fn wheel(&mut self, notches: f64) -> Option<Move> {
        if self.is_flying() {
            self.speed = Some((self.speed.unwrap_or(1.0) * FASTER.powf(notches)).clamp(1e-3, 1e3));
            return None;
        }
        Some(Move::Zoom { at: self.cursor?, factor: NOTCH.powf(notches) })
    }

    /// A key went down or up; whether it is one that flies.
    pub fn key(&mut self, key: KeyCode, down: bool) -> bool {
        let flies = matches!(
            key,
            KeyCode::KeyW | KeyCode::KeyA | KeyCode::KeyS | KeyCode::KeyD | KeyCode::KeyQ | KeyCode::KeyE
        );
        if flies && down {
            self.held.insert(key);
        } else {
            self.held.remove(&key);
        }
        flies
    }

    /// Whether Shift is held.
    pub fn shift(&mut self, held: bool) {
        self.faster = held;
    }

    /// Lets go of everything: the window is no longer the one that gets keys.
    pub fn release_all(&mut self) {
        self.held.clear();
        (self.dragged, self.pressed_at) = (None, None);
    }

    /// Whether a key that flies is held.
    pub fn is_flying(&self) -> bool {
        !self.held.is_empty()
    }

    /// Flight: right, forward and up, in distances to the target a second.
    pub fn flight(&self) -> [f64; 3] {
        let along =
            |plus, minus| f64::from(self.held.contains(&plus)) - f64::from(self.held.contains(&minus));
        let speed = 0.35 * self.speed.unwrap_or(1.0) * if self.faster { 4.0 } else { 1.0 };
        [
            along(KeyCode::KeyD, KeyCode::KeyA),
            along(KeyCode::KeyW, KeyCode::KeyS),
            along(KeyCode::KeyE, KeyCode::KeyQ),
        ]
        .map(|way| way * speed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drags_orbit_pan_and_look() {
        let now = Instant::now();
        let mut input = InputState::default();
        assert_eq!(input.pressed(MouseButton::Left, now), None, "the cursor is elsewhere");
        assert_eq!(input.moved([100.0, 50.0], 900.0), None);
        assert_eq!(input.pressed(MouseButton::Left, now), Some(Move::Grab([100.0, 50.0])));
        assert_eq!(input.moved([110.0, 45.0], 900.0), Some(Move::Orbit([2.0, -1.0])));
        assert_eq!(input.moved([110.0, 45.0], 900.0), None);
        input.released(MouseButton::Right);
        assert_eq!(input.dragged, Some(MouseButton::Left));
        input.released(MouseButton::Left);
        assert_eq!(input.moved([0.0, 0.0], 900.0), None);
        assert_eq!(input.pressed(MouseButton::Right, now), Some(Move::Grab([0.0; 2])));
        assert_eq!(input.moved([3.0, -4.0], 900.0), Some(Move::Pan([3.0, -4.0])));
        assert!(input.key(KeyCode::KeyW, true) && !input.key(KeyCode::KeyX, true));
        assert!(matches!(input.moved([6.0, -4.0], 900.0), Some(Move::Look([x, 0.0])) if x > 0.0));
        assert_eq!(input.pressed(MouseButton::Middle, now), None);
        input.release_all();
        assert!(!input.is_flying() && input.dragged.is_none());
    }

    #[test]
    fn two_quick_clicks_recentre_and_a_third_is_a_first_one() {
        let start = Instant::now();
        let after = |ms| start + Duration::from_millis(ms);
        let mut input = InputState::default();
        input.moved([10.0, 10.0], 100.0);
        let mut click = |ms| {
            let said = input.pressed(MouseButton::Left, after(ms));
            input.released(MouseButton::Left);
            matches!(said, Some(Move::Recentre(_)))
        };
        assert_eq!([0, 300, 500, 2000].map(&mut click), [false, true, false, false]);
        input.moved([30.0, 10.0], 100.0);
        assert_eq!(
            input.pressed(MouseButton::Left, after(2100)),
            Some(Move::Grab([30.0, 10.0])),
            "elsewhere"
        );
    }

    #[test]
    fn a_click_is_no_drag_and_no_double_click() {
        let start = Instant::now();
        let mut input = InputState::default();
        input.moved([10.0, 10.0], 100.0);
        let mut gesture = |ms, way: &[[f64; 2]]| {
            input.pressed(MouseButton::Left, start + Duration::from_millis(ms));
            way.iter().for_each(|&to| _ = input.moved(to, 100.0));
            input.released(MouseButton::Left)
        };
        assert_eq!(gesture(0, &[[12.0, 11.0]]), Some([10.0, 10.0]));
        assert_eq!(gesture(100, &[]), None, "the second of two quick ones");
        assert_eq!(gesture(1000, &[[40.0, 10.0], [12.0, 11.0]]), None, "away and back");
        input.pressed(MouseButton::Right, start);
        assert_eq!(input.released(MouseButton::Right), None);
    }

    #[test]
    fn the_wheel_zooms_and_sets_the_speed_of_a_flight() {
        let mut input = InputState::default();
        assert_eq!(input.wheel(1.0), None);
        input.moved([5.0, 6.0], 100.0);
        assert_eq!(input.wheel(1.0), Some(Move::Zoom { at: [5.0, 6.0], factor: NOTCH }));
        let zoomed = input.wheel(-1.0);
        assert!(matches!(zoomed, Some(Move::Zoom { factor, .. }) if (factor * NOTCH - 1.0).abs() < 1e-12));
        assert_eq!(input.flight(), [0.0; 3]);
        input.key(KeyCode::KeyW, true);
        input.key(KeyCode::KeyA, true);
        let [right, forward, up] = input.flight();
        assert!(right < 0.0 && forward > 0.0 && up == 0.0);
        assert_eq!(input.wheel(2.0), None);
        assert!(input.flight()[1] > forward);
        input.shift(true);
        assert!(input.flight()[1] > 4.0 * forward);
        input.key(KeyCode::KeyS, true);
        assert_eq!(input.flight()[1], 0.0);
    }

    #[test]
    fn keys_do_what_the_list_says() {
        assert_eq!(action(KeyCode::KeyF, false, false), Some(Action::FrameAll));
        assert_eq!(action(KeyCode::Digit1, false, false), Some(Action::Standard(Standard::Top)));
        assert_eq!(action(KeyCode::Numpad6, false, false), Some(Action::Standard(Standard::Oblique)));
        assert_eq!(action(KeyCode::KeyS, true, false), Some(Action::SaveView));
        assert_eq!(action(KeyCode::KeyO, true, false), Some(Action::Open));
        assert_eq!(action(KeyCode::KeyO, false, false), Some(Action::ToggleProjection));
        assert_eq!(action(KeyCode::KeyS, false, false), None, "it flies");
        assert_eq!(action(KeyCode::KeyV, false, false), Some(Action::NextPreset));
        assert_eq!(action(KeyCode::KeyV, true, false), None);
        assert_eq!(action(KeyCode::KeyC, true, false), Some(Action::CopyCommand));
        assert_eq!(action(KeyCode::KeyC, true, true), Some(Action::CopyPoint));
        assert_eq!(action(KeyCode::Slash, false, true), Some(Action::ToggleKeys));
        assert_eq!(action(KeyCode::Slash, false, false), None);
    }
}
