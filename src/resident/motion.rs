//! Where the camera will be, from how it has moved: sections that come into sight are read before they do (thesis,
//! §3.2.1: the safe area around the camera and the sections that are loaded as it moves on). Pure.

use glam::DVec3;

/// How far it is looked ahead, seconds.
const AHEAD: f64 = 1.0;
/// Frames that this comes to, at most.
const MOST_FRAMES: f64 = 90.0;
/// A camera that has not moved for so long rests, seconds.
const REST: f64 = 0.5;
/// Steps of one motion are alike: the longer is at most as many times as long.
const ALIKE: f64 = 4.0;
/// And the cosine between them is at least so large.
const SAME_WAY: f64 = 0.7;

/// The last steps of a camera.
#[derive(Clone, Copy, Debug, Default)]
pub struct Motion {
    eye: Option<DVec3>,
    /// Of the last frame that moved.
    step: DVec3,
    /// Between two frames, on average.
    seconds: f64,
    at: f64,
}

impl Motion {
    /// The eye is at `eye` in a frame at `now`, seconds; `None`: rays are parallel. Gives how far it will have come in a
    /// while if it goes on as it does; not where it jumps, rests, or has only just set off.
    pub fn frame(&mut self, eye: Option<DVec3>, now: f64) -> Option<DVec3> {
        let last = std::mem::replace(&mut self.eye, eye);
        let (eye, last) = (eye?, last?);
        let seconds = now - self.at;
        let step = eye - last;
        if step == DVec3::ZERO && seconds < REST {
            // The frame was drawn for another reason.
            return None;
        }
        let before = std::mem::replace(&mut self.step, step);
        self.at = now;
        let (long, short) = (step.length().max(before.length()), step.length().min(before.length()));
        let alike = short > 0.0 && long < ALIKE * short && step.dot(before) > SAME_WAY * long * short;
        if !alike || seconds > REST {
            self.seconds = seconds;
            return None;
        }
        self.seconds = 0.8 * self.seconds + 0.2 * seconds;
        Some(step * (AHEAD / self.seconds.max(1e-6)).min(MOST_FRAMES))
    }

    /// Whether nothing has moved for a while.
    pub fn rests(&self, now: f64) -> bool {
        now - self.at > REST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_motion_is_foreseen_and_jumps_are_not() {
        let mut motion = Motion::default();
        let at = |k: f64| Some(DVec3::new(k * 0.5, 100.0, 7.0));
        assert_eq!(motion.frame(at(0.0), 0.0), None);
        assert_eq!(motion.frame(at(1.0), 0.05), None);
        let ahead = motion.frame(at(2.0), 0.1).unwrap();
        // 10 units a second.
        assert!((ahead - DVec3::new(10.0, 0.0, 0.0)).length() < 1e-6, "{ahead}");
        assert!(!motion.rests(0.2));
        // Drawn again, and on.
        assert_eq!(motion.frame(at(2.0), 0.12), None);
        assert!(motion.frame(at(3.0), 0.15).is_some());
        assert_eq!(motion.frame(at(900.0), 0.2), None);
        assert_eq!(motion.frame(at(-900.0), 0.25), None);
        assert_eq!(motion.frame(at(-901.0), 0.3), None);
        assert!(motion.frame(at(-902.0), 0.35).unwrap().x < 0.0);
        // After a rest it sets off anew.
        assert!(motion.rests(2.0));
        assert_eq!(motion.frame(at(-903.0), 2.0), None);
        // Frames that take no time do not lead to the end of the world.
        let mut motion = Motion::default();
        let steps: Vec<_> = (0..4).map(|k| motion.frame(at(f64::from(k)), 0.0)).collect();
        assert_eq!(steps[3], Some(DVec3::new(0.5 * MOST_FRAMES, 0.0, 0.0)));
        assert_eq!(motion.frame(None, 1.0), None);
    }
}
