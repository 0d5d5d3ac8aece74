//! What Vulkan promises about the order of memory accesses, as far as the program uses it: the dependency
//! chains of "Synchronization and Cache Control" (Vulkan 1.3, chapter 7) over barriers, timeline
//! semaphores, host waits and submits.

use std::ops::Range;

use ash::vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stages};
use lasray::gpu::{Event, QueueKind, SyncPoint};

/// Who touches memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Agent {
    Host,
    Device { queue: QueueKind, stage: Stages },
}

/// One access to a range of a buffer.
#[derive(Clone, Debug)]
pub struct Touch {
    pub agent: Agent,
    pub buffer: String,
    pub bytes: Range<u64>,
    pub write: bool,
}

impl Touch {
    fn conflicts(&self, other: &Touch) -> bool {
        let overlap = self.bytes.start < other.bytes.end && other.bytes.start < self.bytes.end;
        self.buffer == other.buffer && overlap && (self.write || other.write)
    }

    fn access(&self, stage: Stages) -> Access {
        match (stage, self.write) {
            (Stages::COPY, false) => Access::TRANSFER_READ,
            (Stages::COPY, true) => Access::TRANSFER_WRITE,
            (_, false) => Access::SHADER_STORAGE_READ,
            (_, true) => Access::SHADER_STORAGE_WRITE,
        }
    }
}

/// One step of a program, in the order in which the host took it.
#[derive(Clone, Debug)]
pub enum Step {
    Touch(Touch),
    Event(Event),
}

/// What is known of an access on the way from it: how far its write has travelled.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
struct Reach {
    available: bool,
    host: bool,
}

/// Every pair of accesses that conflict and are not ordered, as text. A read after a write needs the write
/// made available and visible, so does a write after a write; a write after a read needs order alone.
pub fn hazards(steps: &[Step]) -> Vec<String> {
    let mut found = Vec::new();
    for (i, step) in steps.iter().enumerate() {
        let Step::Touch(first) = step else { continue };
        let reached = reach(steps, i, first);
        for (j, step) in steps.iter().enumerate().skip(i + 1) {
            let Step::Touch(second) = step else { continue };
            if first.conflicts(second) && !ordered(steps, (i, first), (j, second), &reached) {
                found.push(format!("{first:?} and then {second:?}"));
            }
        }
    }
    found
}

/// Index of the submit that carries the device work at `index`.
fn submit_of(steps: &[Step], index: usize, queue: QueueKind) -> usize {
    let submits =
        |step: &Step| matches!(step, Step::Event(Event::Submit { point }) if point.queue() == queue);
    index + steps[index..].iter().position(submits).expect("all work is submitted")
}

/// Which synchronisation steps a dependency chain from `first` (at `start`) reaches, and how.
fn reach(steps: &[Step], start: usize, first: &Touch) -> Vec<Option<Reach>> {
    let mut reached: Vec<Option<Reach>> = vec![None; steps.len()];
    let Agent::Device { queue, stage } = first.agent else { return reached };
    let access = first.access(stage);
    // Chains only lead forward in the host's order, so one pass finds them all.
    for (at, step) in steps.iter().enumerate().skip(start + 1) {
        let Step::Event(event) = step else { continue };
        let mut now: Option<Reach> = None;
        let mut join = |reach: Reach| {
            let old = now.unwrap_or_default();
            now = Some(Reach { available: old.available | reach.available, host: old.host | reach.host });
        };
        match *event {
            Event::Barrier { queue: q, src, dst, .. } => {
                if q == queue && src.0.contains(stage) {
                    join(Reach { available: first.write && src.1.contains(access), host: false });
                }
                earlier(steps, &reached, at)
                    .filter(|(_, e, _)| leads(e, q, src.0))
                    .for_each(|(_, _, r)| join(r));
                if let Some(reach) = &mut now {
                    reach.host |= reach.available && dst.1.contains(Access::HOST_READ);
                }
            }
            Event::Submit { point } => {
                // Its signal covers all work before it on the queue.
                if point.queue() == queue {
                    join(Reach { available: first.write, host: false });
                }
                let all = Stages::from_raw(u64::MAX);
                earlier(steps, &reached, at)
                    .filter(|(_, e, _)| leads(e, point.queue(), all))
                    .for_each(|(_, _, r)| join(r));
            }
            Event::Wait { point, .. } | Event::Seen { point, .. } => {
                earlier(steps, &reached, at)
                    .filter(|(_, e, _)| signals(e, point))
                    .for_each(|(_, _, r)| join(r));
            }
        }
        reached[at] = now;
    }
    reached
}

/// The synchronisation steps before `at` that the chain reaches, with their place.
fn earlier<'a>(
    steps: &'a [Step],
    reached: &'a [Option<Reach>],
    at: usize,
) -> impl Iterator<Item = (usize, &'a Event, Reach)> {
    steps[..at].iter().zip(reached).enumerate().filter_map(|(i, (step, reach))| match step {
        Step::Event(event) => Some((i, event, (*reach)?)),
        Step::Touch(_) => None,
    })
}

/// Whether `event` orders later work of `stages` on `queue`.
fn leads(event: &Event, queue: QueueKind, stages: Stages) -> bool {
    match *event {
        Event::Barrier { queue: q, dst, .. } => q == queue && dst.0.intersects(stages),
        Event::Wait { queue: q, stages: s, .. } => q == queue && s.intersects(stages),
        Event::Submit { .. } | Event::Seen { .. } => false,
    }
}

/// Whether reaching `point` implies the signal of `event`.
fn signals(event: &Event, point: SyncPoint) -> bool {
    matches!(event, Event::Submit { point: p } if p.queue() == point.queue() && p.value() <= point.value())
}

fn ordered(
    steps: &[Step],
    first: (usize, &Touch),
    second: (usize, &Touch),
    reached: &[Option<Reach>],
) -> bool {
    let ((i, first), (j, second)) = (first, second);
    let begins = match second.agent {
        Agent::Host => j,
        // Submitting orders all that the host did before, and shows its writes to the device.
        Agent::Device { queue, .. } => submit_of(steps, j, queue),
    };
    if first.agent == Agent::Host {
        return i < begins;
    }
    earlier(steps, reached, j.max(begins)).any(|(at, event, reach)| {
        match (*event, second.agent) {
            (Event::Barrier { queue, dst, .. }, Agent::Device { queue: q, stage }) => {
                let visible = reach.available && dst.1.contains(second.access(stage));
                at < j && q == queue && dst.0.contains(stage) && (!first.write || visible)
            }
            (Event::Wait { queue, stages, .. }, Agent::Device { queue: q, stage }) => {
                at < j && q == queue && stages.contains(stage) && (!first.write || reach.available)
            }
            // The host saw the first done before it began the second: order, but nothing made visible.
            (Event::Seen { .. }, Agent::Device { .. }) => !first.write,
            (Event::Seen { .. }, Agent::Host) => at < j && (!first.write || second.write || reach.host),
            _ => false,
        }
    })
}
