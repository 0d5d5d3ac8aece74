//! The waits and barriers of [`super::Order`] by name, and what it notes of them: plain values.

use ash::vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stages};

use super::kinds::QueueKind;
use super::sync::SyncPoint;

/// The waits and barriers between pieces of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Edge {
    /// A copy into a slot waits for the last work that read or wrote the slot.
    CopyAfterUse,
    /// A build reads what copies wrote; frames after it do, too.
    BuildAfterCopy,
    /// A build rewrites what earlier frames read, and reads what earlier builds wrote.
    BuildAfterEarlier,
    /// A pass of a build reads what the pass before wrote.
    BuildPass,
    /// A frame reads what builds wrote, and writes where earlier frames read and wrote.
    FrameAfterEarlier,
    /// A frame writes what the readback of an earlier one still reads.
    FrameAfterReadback,
    /// A pass of a frame reads what the pass before wrote.
    FramePass,
    /// A readback copies what passes wrote.
    ReadbackAfterPass,
    /// What a readback copied is made visible to the host.
    HostAfterReadback,
    /// The host writes into the upload ring where a copy has read.
    RingReuse,
    /// The host writes a table that a frame has read.
    TableReuse,
    /// The host reads what a frame has copied back.
    HostRead,
}

impl Edge {
    /// All of them.
    pub const ALL: [Edge; 12] = [
        Edge::CopyAfterUse,
        Edge::BuildAfterCopy,
        Edge::BuildAfterEarlier,
        Edge::BuildPass,
        Edge::FrameAfterEarlier,
        Edge::FrameAfterReadback,
        Edge::FramePass,
        Edge::ReadbackAfterPass,
        Edge::HostAfterReadback,
        Edge::RingReuse,
        Edge::TableReuse,
        Edge::HostRead,
    ];
}

/// What [`super::Order`] did, for the tests that prove it right.
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// Work on `queue` began with a wait for `point`, before `stages` of it and all after it.
    Wait { edge: Edge, queue: QueueKind, point: SyncPoint, stages: Stages },
    /// A barrier in the work being recorded for `queue`.
    Barrier { edge: Edge, queue: QueueKind, src: (Stages, Access), dst: (Stages, Access) },
    /// The work was submitted.
    Submit { point: SyncPoint },
    /// The host saw `point` reached.
    Seen { edge: Option<Edge>, point: SyncPoint },
}
