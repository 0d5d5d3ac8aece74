//! When the next frame is drawn. What the user does is drawn at once, which the window asks for itself; what only arrives,
//! when the frames before have rested long enough; and where nothing is to come, nothing is drawn. Pure: it is told what
//! happens and what time it is.
//!
//! For each frame: [`Redraw::take_outdated`], then [`Redraw::planned`], [`Redraw::submitted`], [`Redraw::presented`] and
//! [`Redraw::shown`]; or [`Redraw::late`] where it could not be drawn. [`Redraw::plan`] comes last, and whenever news were looked for.

use super::pace::Rest;
use std::time::{Duration, Instant};

/// When to look again for what is under way.
pub const SOON: Duration = Duration::from_millis(6);
/// And for an image of a window that gives none.
pub const LATER: Duration = Duration::from_millis(150);
/// How often progress is shown, at least, where nothing else is new.
const PROGRESS: Duration = Duration::from_millis(60);

/// What the window shows, against what there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Freshness {
    /// All that there is now.
    #[default]
    Current,
    /// An image of it that is not finished.
    Unfinished,
    /// Less than there is now.
    Outdated,
}

/// Why a frame is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RedrawReason {
    /// One was asked for that could not be drawn: the device was behind, or the window had no image. At once.
    Late,
    /// There is something new, or the image is not finished. Once the device is done and has rested.
    Image,
    /// More data are read, of which nothing is seen yet. The same, and seldom.
    Progress,
    /// The toolkit wants one, or a notice ends.
    Timer,
}

/// What a frame that was shown leaves to do.
#[derive(Clone, Copy, Debug)]
pub struct FrameState {
    /// The camera moves, by keys or along a path.
    pub is_moving: bool,
    /// An image is being drawn for a file.
    pub is_saving: bool,
    /// All data are there.
    pub is_complete: bool,
    /// The image was begun because the user changed something, not because of what arrived.
    pub is_urgent: bool,
    /// After how long the toolkit wants the next frame.
    pub repaint: Option<Duration>,
}

/// What becomes of [`FrameState`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct After {
    /// The next frame belongs to the same move or image, and follows at once.
    pub goes_on: bool,
    /// A frame is to be drawn at once, for that or for the toolkit.
    pub is_due: bool,
    /// Everything is there and shown, since this frame.
    pub has_settled: bool,
}

/// See the module.
pub struct Redraw {
    content: Freshness,
    /// At the last frame everything was there and shown.
    is_settled: bool,
    /// A frame was asked for that could not be drawn yet.
    is_late: bool,
    /// More is on its way to the device.
    is_uploading: bool,
    /// It is asked what lies under the cursor.
    is_asking: bool,
    /// When the frame was begun that the device is not done with.
    drawing: Option<Instant>,
    rest: Rest,
    /// When a frame was shown last.
    last_shown: Option<Instant>,
    /// When news were looked for last.
    last_look: Instant,
    /// When the toolkit wants the next frame.
    repaint: Option<Instant>,
    /// When to look again if nothing happens.
    next: Option<Instant>,
}

impl Redraw {
    /// Of a window that was begun at `now`.
    pub fn new(now: Instant) -> Redraw {
        Redraw {
            content: Freshness::default(),
            is_settled: false,
            is_late: false,
            is_uploading: false,
            is_asking: false,
            drawing: None,
            rest: Rest::default(),
            last_shown: None,
            last_look: now,
            repaint: None,
            next: None,
        }
    }

    /// When to look again if nothing happens; `None`: the machine rests.
    pub fn next(&self) -> Option<Instant> {
        self.next
    }

    /// Whether to look for news at `now`: they come in crowds.
    pub fn wants_look(&mut self, now: Instant) -> bool {
        let is_crowd = now < self.last_look + SOON / 2;
        if is_crowd {
            self.next = Some(self.next.map_or(now + SOON, |next| next.min(now + SOON)));
        }
        !is_crowd
    }

    /// News are looked for at `now`.
    pub fn looked(&mut self, now: Instant) {
        self.last_look = now;
    }

    /// There is something that is not shown yet.
    pub fn outdate(&mut self) {
        self.content = Freshness::Outdated;
    }

    /// Whether more is on its way to the device.
    pub fn uploads(&mut self, is_uploading: bool) {
        self.is_uploading = is_uploading;
    }

    /// It is asked what lies under the cursor, or told.
    pub fn asks(&mut self, is_asking: bool) {
        self.is_asking = is_asking;
    }

    /// The scene is another one: what was asked of the old one is void. The sooner a frame is drawn, the sooner what is seen
    /// is read.
    pub fn new_scene(&mut self) {
        (self.is_asking, self.drawing, self.is_late) = (false, None, true);
    }

    /// The device is done with the frame of [`Redraw::submitted`].
    pub fn device_done(&mut self, now: Instant) {
        if let Some(begun) = self.drawing.take() {
            self.rest.after(now - begun, now);
        }
    }

    /// A frame could not be drawn; it is tried again at `again`, or sooner if something happens.
    pub fn late(&mut self, again: Instant) {
        (self.is_late, self.next) = (true, Some(again));
    }

    /// Whether there is something that was not shown; the frame that begins shows it.
    pub fn take_outdated(&mut self) -> bool {
        std::mem::take(&mut self.content) == Freshness::Outdated
    }

    /// Whether the image will not be finished by this frame.
    pub fn planned(&mut self, has_more: bool) {
        self.content = if has_more { Freshness::Unfinished } else { Freshness::Current };
    }

    /// The device is given a frame that was begun at `begun`.
    pub fn submitted(&mut self, begun: Instant) {
        self.drawing.get_or_insert(begun);
    }

    /// The frame that was begun at `begun` is shown.
    pub fn shown(&mut self, begun: Instant, frame: FrameState) -> After {
        self.is_late = false;
        let has_more = self.content != Freshness::Current;
        let goes_on =
            frame.is_moving || frame.is_saving || has_more && (frame.is_complete || frame.is_urgent);
        self.repaint = frame.repaint.filter(|wait| !wait.is_zero()).and_then(|wait| begun.checked_add(wait));
        let is_settled = !has_more && !self.is_uploading && !frame.is_moving && frame.is_complete;
        let was_settled = std::mem::replace(&mut self.is_settled, is_settled);
        After {
            goes_on,
            is_due: goes_on || frame.repaint.is_some_and(|wait| wait.is_zero()),
            has_settled: is_settled && !was_settled,
        }
    }

    /// A frame is on the screen at `now`; when the one before was.
    pub fn presented(&mut self, now: Instant) -> Option<Instant> {
        self.last_shown.replace(now)
    }

    /// The next frame that will be due, and why.
    fn due(
        &self,
        now: Instant,
        is_settled: bool,
        notice: Option<Instant>,
    ) -> Option<(Instant, RedrawReason)> {
        let timer = self.repaint.into_iter().chain(notice).min().map(|at| (at, RedrawReason::Timer));
        let late = self.is_late.then_some((now, RedrawReason::Late));
        let rested = self.rest.end(now);
        let arriving = match self.content {
            // While the device draws it is not known how long that takes.
            _ if self.drawing.is_some() => None,
            Freshness::Unfinished | Freshness::Outdated => Some((rested, RedrawReason::Image)),
            // Progress moves without news.
            Freshness::Current if !is_settled => {
                Some((rested.max(self.last_shown.unwrap_or(now) + PROGRESS), RedrawReason::Progress))
            }
            Freshness::Current => None,
        };
        late.into_iter().chain(arriving).chain(timer).min()
    }

    /// Decides when to look again if nothing happens; why a frame is to be drawn now, if it is. `is_complete`: all data are
    /// there; `notice`: when one ends.
    pub fn plan(&mut self, now: Instant, is_complete: bool, notice: Option<Instant>) -> Option<RedrawReason> {
        let is_settled = self.is_settled && is_complete;
        let due = self.due(now, is_settled, notice);
        let reason = due.filter(|(at, _)| *at <= now).map(|(_, reason)| reason);
        let again = if reason.is_some() { Some(now + LATER) } else { due.map(|(at, _)| at) };
        let is_watched = self.drawing.is_some() && !is_settled;
        let soon = (self.is_uploading || self.is_asking || is_watched).then_some(now + SOON);
        self.next = again.into_iter().chain(soon).min();
        reason
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    /// A frame of a window at rest.
    const STILL: FrameState =
        FrameState { is_moving: false, is_saving: false, is_complete: true, is_urgent: false, repaint: None };

    /// A window whose frame was shown at `now`, and is done.
    fn after(now: Instant, has_more: bool, frame: FrameState) -> (Redraw, After) {
        let mut redraw = Redraw::new(now);
        redraw.planned(has_more);
        redraw.submitted(now);
        let after = redraw.shown(now, frame);
        redraw.presented(now);
        redraw.device_done(now);
        (redraw, after)
    }

    #[test]
    fn a_finished_image_of_all_data_lets_the_machine_rest() {
        let now = Instant::now();
        let (mut redraw, after) = after(now, false, STILL);
        assert_eq!(after, After { goes_on: false, is_due: false, has_settled: true });
        assert_eq!(redraw.plan(now + MS, true, None), None);
        assert_eq!(redraw.next(), None);
        // That it has settled is told once.
        redraw.planned(false);
        assert!(!redraw.shown(now, STILL).has_settled);
        // Until something arrives.
        redraw.outdate();
        assert_eq!(redraw.plan(now + MS, true, None), Some(RedrawReason::Image));
        assert!(redraw.take_outdated() && !redraw.take_outdated());
    }

    #[test]
    fn what_arrives_waits_for_the_device_and_its_rest() {
        let now = Instant::now();
        let mut redraw = Redraw::new(now);
        redraw.outdate();
        redraw.submitted(now);
        assert_eq!(redraw.plan(now, false, None), None, "the device draws");
        assert_eq!(redraw.next(), Some(now + SOON));
        let done = now + 20 * MS;
        redraw.device_done(done);
        assert_eq!(redraw.plan(done, false, None), None);
        assert_eq!(redraw.next(), Some(done + 40 * MS), "twice as long as it drew");
        assert_eq!(redraw.plan(done + 40 * MS, false, None), Some(RedrawReason::Image));
        assert_eq!(redraw.next(), Some(done + 40 * MS + LATER), "where the request comes to nothing");
    }

    #[test]
    fn progress_is_shown_now_and_then_while_data_are_read() {
        let now = Instant::now();
        let (mut redraw, after) = after(now, false, FrameState { is_complete: false, ..STILL });
        assert!(!after.has_settled);
        assert_eq!(redraw.plan(now, false, None), None);
        assert_eq!(redraw.next(), Some(now + PROGRESS));
        assert_eq!(redraw.plan(now + PROGRESS, false, None), Some(RedrawReason::Progress));
    }

    #[test]
    fn moves_and_images_of_all_data_go_on_at_once() {
        let now = Instant::now();
        let goes_on = |has_more, frame| after(now, has_more, frame).1.goes_on;
        let reading = FrameState { is_complete: false, ..STILL };
        assert!(goes_on(true, STILL) && !goes_on(false, STILL));
        assert!(!goes_on(true, reading), "what computes is left to the reading");
        assert!(goes_on(true, FrameState { is_urgent: true, ..reading }));
        assert!(goes_on(false, FrameState { is_moving: true, ..reading }));
        assert!(goes_on(false, FrameState { is_saving: true, ..STILL }));
        let (mut redraw, after) = after(now, true, reading);
        assert!(!after.is_due && !after.has_settled);
        assert_eq!(redraw.plan(now, false, None), Some(RedrawReason::Image), "nothing was drawn for long");
    }

    #[test]
    fn frames_that_could_not_be_drawn_are_due_at_once() {
        let now = Instant::now();
        let (mut redraw, _) = after(now, false, STILL);
        redraw.submitted(now);
        redraw.late(now + SOON);
        assert_eq!(redraw.next(), Some(now + SOON));
        assert_eq!(redraw.plan(now, true, None), Some(RedrawReason::Late), "whatever the device does");
        redraw.shown(now, STILL);
        assert_eq!(redraw.plan(now, true, None), None);
        redraw.new_scene();
        assert_eq!(redraw.plan(now, true, None), Some(RedrawReason::Late));
    }

    #[test]
    fn the_toolkit_and_notices_have_their_time() {
        let now = Instant::now();
        let (mut redraw, after_toolkit) = after(now, false, FrameState { repaint: Some(50 * MS), ..STILL });
        assert!(!after_toolkit.is_due);
        assert_eq!(redraw.plan(now, true, Some(now + 30 * MS)), None);
        assert_eq!(redraw.next(), Some(now + 30 * MS));
        assert_eq!(redraw.plan(now + 50 * MS, true, None), Some(RedrawReason::Timer));
        let (_, at_once) = after(now, false, FrameState { repaint: Some(Duration::ZERO), ..STILL });
        assert_eq!(at_once, After { goes_on: false, is_due: true, has_settled: true });
    }

    #[test]
    fn what_is_under_way_is_looked_for_soon_but_not_in_crowds() {
        let now = Instant::now();
        let (mut redraw, _) = after(now, false, STILL);
        redraw.asks(true);
        assert_eq!((redraw.plan(now, true, None), redraw.next()), (None, Some(now + SOON)));
        redraw.asks(false);
        redraw.uploads(true);
        assert_eq!((redraw.plan(now, true, None), redraw.next()), (None, Some(now + SOON)));
        redraw.looked(now);
        assert!(!redraw.wants_look(now + MS) && redraw.wants_look(now + SOON));
    }
}
