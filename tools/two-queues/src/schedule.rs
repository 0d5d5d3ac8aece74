//! Two virtual queues on one real one: who goes when.

use std::collections::{HashMap, VecDeque};

use ash::vk;

/// Which submits are held back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// None, not even for their waits.
    Direct,
    /// Those whose waits are not met.
    Eager,
    /// All of this family until something demands them.
    Late(usize),
}

impl Mode {
    /// From the environment variable `TWO_QUEUES`.
    pub fn from_env() -> Mode {
        match std::env::var("TWO_QUEUES").as_deref() {
            Ok("direct") => Mode::Direct,
            Ok("late0") => Mode::Late(0),
            Ok("late1") => Mode::Late(1),
            Ok("eager") | Err(_) => Mode::Eager,
            Ok(other) => panic!("TWO_QUEUES={other}: direct, eager, late0 or late1"),
        }
    }
}

/// One batch of a submit, copied out of the caller's memory.
pub struct Submit {
    pub waits: Vec<vk::SemaphoreSubmitInfo<'static>>,
    pub commands: Vec<vk::CommandBufferSubmitInfo<'static>>,
    pub signals: Vec<vk::SemaphoreSubmitInfo<'static>>,
    pub fence: vk::Fence,
}

/// What the host waits for.
#[derive(Clone, Copy)]
pub enum Want {
    Semaphore(vk::Semaphore, u64),
    Fence(vk::Fence),
}

/// The driver below, as far as the scheduler needs it.
pub trait Driver {
    fn submit(&self, submit: &Submit) -> vk::Result;
    /// Value of a timeline semaphore now.
    fn counter(&self, semaphore: vk::Semaphore) -> u64;
}

/// Deeper than any chain of waits between two queues in a test.
const MAX_DEPTH: usize = 256;

pub struct Scheduler<D> {
    pub driver: D,
    mode: Mode,
    held: [VecDeque<Submit>; 2],
    /// Timeline semaphores, with the highest value whose signal went to the driver. Others are binary.
    timelines: HashMap<vk::Semaphore, u64>,
    wants: HashMap<u64, Want>,
    next_want: u64,
}

impl<D: Driver> Scheduler<D> {
    pub fn new(driver: D, mode: Mode) -> Scheduler<D> {
        let (held, timelines, wants) = Default::default();
        Scheduler { driver, mode, held, timelines, wants, next_want: 0 }
    }

    pub fn submit(&mut self, family: usize, submits: Vec<Submit>) -> vk::Result {
        for submit in submits {
            if self.mode == Mode::Direct {
                let result = self.driver.submit(&submit);
                if result != vk::Result::SUCCESS {
                    return result;
                }
                self.forwarded(&submit);
            } else {
                self.held[family].push_back(submit);
            }
        }
        self.pump();
        vk::Result::SUCCESS
    }

    pub fn add_timeline(&mut self, semaphore: vk::Semaphore, initial: u64) {
        self.timelines.insert(semaphore, initial);
    }

    pub fn remove_semaphore(&mut self, semaphore: vk::Semaphore) {
        self.timelines.remove(&semaphore);
    }

    /// Registers what a host thread is about to wait for, until [`Scheduler::unwant`].
    pub fn want(&mut self, want: Want) -> u64 {
        self.next_want += 1;
        self.wants.insert(self.next_want, want);
        self.next_want
    }

    pub fn unwant(&mut self, id: u64) {
        self.wants.remove(&id);
    }

    /// After a poll that saw `seen`: lets one held submit go that would raise the value.
    pub fn polled(&mut self, semaphore: vk::Semaphore, seen: u64) {
        if let Some(family) = self.holder(semaphore, seen.saturating_add(1)) {
            self.advance(family, 0);
        }
        self.pump();
    }

    /// A poll of `fence`: whether its submit was still held back. It goes afterwards.
    pub fn polled_fence(&mut self, fence: vk::Fence) -> bool {
        let holder = self.fence_holder(fence);
        if let Some(family) = holder {
            self.advance(family, 0);
        }
        self.pump();
        holder.is_some()
    }

    /// Hands over all that can go of one family.
    pub fn flush(&mut self, family: usize) {
        while self.advance(family, 0) {}
    }

    /// Hands over everything.
    pub fn flush_all(&mut self) {
        self.flush(0);
        self.flush(1);
        self.flush(0);
    }

    /// Hands over what the mode lets go, and what is demanded.
    pub fn pump(&mut self) {
        loop {
            let mut moved = false;
            for family in 0..2 {
                if self.mode != Mode::Late(family) {
                    while self.advance(family, 0) {
                        moved = true;
                    }
                }
            }
            let wants: Vec<Want> = self.wants.values().copied().collect();
            for want in wants {
                moved |= match want {
                    Want::Semaphore(semaphore, value) => {
                        !self.met(semaphore, value) && self.demand(semaphore, value, 0)
                    }
                    Want::Fence(fence) => {
                        self.fence_holder(fence).is_some_and(|family| self.advance(family, 0))
                    }
                };
            }
            if !moved {
                return;
            }
        }
    }

    /// Hands the first submit of `family` to the driver, what it waits for first. False if it cannot go.
    fn advance(&mut self, family: usize, depth: usize) -> bool {
        let Some(first) = self.held[family].front() else { return false };
        if depth > MAX_DEPTH {
            return false;
        }
        let before = self.held[family].len();
        let waits: Vec<_> = first.waits.iter().map(|w| (w.semaphore, w.value)).collect();
        for (semaphore, value) in waits {
            if !self.demand(semaphore, value, depth + 1) {
                return false;
            }
            if self.held[family].len() != before {
                return true; // the other queue waited for this one, and took it along
            }
        }
        let Some(submit) = self.held[family].pop_front() else { return false };
        let result = self.driver.submit(&submit);
        if result != vk::Result::SUCCESS {
            eprintln!("two-queues: a held submit failed: {result}");
        }
        self.forwarded(&submit);
        true
    }

    fn forwarded(&mut self, submit: &Submit) {
        for signal in &submit.signals {
            if let Some(value) = self.timelines.get_mut(&signal.semaphore) {
                *value = (*value).max(signal.value);
            }
        }
    }

    /// Sees to it that a wait for `value` would end. False if nothing submitted so far signals it.
    fn demand(&mut self, semaphore: vk::Semaphore, value: u64, depth: usize) -> bool {
        while !self.met(semaphore, value) {
            match self.holder(semaphore, value) {
                Some(family) if self.advance(family, depth) => {}
                _ => return false,
            }
        }
        true
    }

    fn met(&self, semaphore: vk::Semaphore, value: u64) -> bool {
        match self.timelines.get(&semaphore) {
            Some(&forwarded) => forwarded >= value || self.driver.counter(semaphore) >= value,
            None => self.holder(semaphore, 0).is_none(),
        }
    }

    /// The family that holds back a signal of `semaphore` to `value` or more.
    fn holder(&self, semaphore: vk::Semaphore, value: u64) -> Option<usize> {
        let is_timeline = self.timelines.contains_key(&semaphore);
        (0..2).find(|&family| {
            self.held[family]
                .iter()
                .flat_map(|submit| &submit.signals)
                .any(|signal| signal.semaphore == semaphore && (!is_timeline || signal.value >= value))
        })
    }

    fn fence_holder(&self, fence: vk::Fence) -> Option<usize> {
        (0..2).find(|&family| self.held[family].iter().any(|submit| submit.fence == fence))
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use ash::vk::Handle;

    use super::*;

    /// Notes the first signalled value of each submit; signals at once.
    #[derive(Default)]
    struct Recorder {
        order: RefCell<Vec<u64>>,
        values: RefCell<HashMap<vk::Semaphore, u64>>,
    }

    impl Driver for Recorder {
        fn submit(&self, submit: &Submit) -> vk::Result {
            self.order.borrow_mut().push(submit.signals[0].value);
            for signal in &submit.signals {
                self.values.borrow_mut().insert(signal.semaphore, signal.value);
            }
            vk::Result::SUCCESS
        }

        fn counter(&self, semaphore: vk::Semaphore) -> u64 {
            self.values.borrow().get(&semaphore).copied().unwrap_or(0)
        }
    }

    fn info(semaphore: u64, value: u64) -> vk::SemaphoreSubmitInfo<'static> {
        vk::SemaphoreSubmitInfo::default().semaphore(vk::Semaphore::from_raw(semaphore)).value(value)
    }

    fn submit(waits: &[(u64, u64)], signal: (u64, u64)) -> Vec<Submit> {
        let waits = waits.iter().map(|&(s, v)| info(s, v)).collect();
        vec![Submit {
            waits,
            commands: vec![],
            signals: vec![info(signal.0, signal.1)],
            fence: vk::Fence::null(),
        }]
    }

    fn scheduler(mode: Mode) -> Scheduler<Recorder> {
        let mut scheduler = Scheduler::new(Recorder::default(), mode);
        for family in [1, 2] {
            scheduler.add_timeline(vk::Semaphore::from_raw(family), 0);
        }
        scheduler
    }

    fn send(scheduler: &mut Scheduler<Recorder>, family: usize, waits: &[(u64, u64)], signal: (u64, u64)) {
        assert_eq!(scheduler.submit(family, submit(waits, signal)), vk::Result::SUCCESS);
    }

    /// Compute (semaphore 1) signals 10, 11, ...; transfer (semaphore 2) signals 20, 21, ...
    fn order(mode: Mode) -> Vec<u64> {
        let mut scheduler = scheduler(mode);
        send(&mut scheduler, 1, &[], (2, 20));
        send(&mut scheduler, 0, &[], (1, 10));
        send(&mut scheduler, 0, &[(2, 20)], (1, 11));
        send(&mut scheduler, 1, &[(1, 10)], (2, 21));
        send(&mut scheduler, 0, &[], (1, 12));
        scheduler.flush_all();
        scheduler.driver.order.take()
    }

    #[test]
    fn each_mode_has_its_order_and_keeps_the_waits() {
        assert_eq!(order(Mode::Direct), [20, 10, 11, 21, 12]);
        assert_eq!(order(Mode::Eager), [20, 10, 11, 21, 12]);
        assert_eq!(order(Mode::Late(1)), [10, 20, 11, 12, 21]);
        assert_eq!(order(Mode::Late(0)), [20, 10, 21, 11, 12]);
    }

    #[test]
    fn a_wait_before_its_signal_is_held_until_the_signal_comes() {
        let mut scheduler = scheduler(Mode::Eager);
        send(&mut scheduler, 0, &[(2, 20)], (1, 10));
        assert!(scheduler.driver.order.borrow().is_empty());
        send(&mut scheduler, 1, &[], (2, 20));
        assert_eq!(scheduler.driver.order.take(), [20, 10]);
    }

    #[test]
    fn a_poll_and_a_host_wait_let_held_work_go() {
        let mut scheduler = scheduler(Mode::Late(1));
        for value in [20, 21, 22] {
            send(&mut scheduler, 1, &[], (2, value));
        }
        scheduler.polled(vk::Semaphore::from_raw(2), 0);
        assert_eq!(*scheduler.driver.order.borrow(), [20]);
        let id = scheduler.want(Want::Semaphore(vk::Semaphore::from_raw(2), 21));
        scheduler.pump();
        scheduler.unwant(id);
        assert_eq!(*scheduler.driver.order.borrow(), [20, 21]);
    }
}
