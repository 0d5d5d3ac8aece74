//! Points on a queue's timeline, waits for them, and what a piece of work is: plain values.

use ash::vk;

use super::kinds::QueueKind;

/// What a piece of work is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    Copy,
    Build,
    Frame,
}

/// A submitted piece of work. Only a submit makes one, so no wait can come before its signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SyncPoint {
    pub(super) queue: QueueKind,
    pub(super) value: u64,
}

impl SyncPoint {
    /// The queue that the work was submitted to; a device with one queue has only compute points.
    pub fn queue(self) -> QueueKind {
        self.queue
    }

    /// Counts the submits of that queue, from 1.
    pub fn value(self) -> u64 {
        self.value
    }
}

/// What a submit waits for: a point of the other queue, before these stages.
#[derive(Clone, Copy)]
pub(super) struct Wait {
    pub point: SyncPoint,
    pub stages: vk::PipelineStageFlags2,
}
