//! Limits of streaming and residency, in one place: what is in flight, held, sampled, tried again. What follows from a
//! layout or from mathematics, tells noise from data, or foresees a motion has its constant where it is used.

use std::time::Duration;

/// What streaming and residency may take. See [`LIMITS`].
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Frames that may be in flight at once: so many table copies, and as many images of the window's swapchain.
    pub frames_in_flight: usize,
    /// Bytes that one frame of something that moves may upload.
    pub frame_bytes: u64,
    /// Bytes uploaded between two looks at what else there is to do, where nothing moves.
    pub fill_bytes: u64,
    /// Bytes of the upload ring.
    pub ring_bytes: u64,
    /// Bytes of a payload larger than the ring that a frame copies.
    pub piece_bytes: u64,

    /// Sections that one submit derives.
    pub submit_sections: usize,
    /// Bytes of a buffer with what a dispatch of derived passes reads.
    pub constant_bytes: u64,
    /// Such buffers that wait to be used again.
    pub spare_constants: usize,

    /// Bytes of a page of the pool: small enough for devices that cap a storage buffer at 128 MiB.
    pub page_bytes: u64,
    /// Payloads in a page, at most: the allocator's own memory grows by it.
    pub page_payloads: u32,

    /// Nodes beyond which a cut is refined no further: nobody has the memory.
    pub cut_nodes: usize,
    /// Ticks between two attempts to show more detail again.
    pub detail_ticks: u64,
    /// Payloads whose last use is remembered.
    pub remembered_uses: usize,

    /// Bytes that a section of one class takes while it is made.
    pub section_bytes: u64,
    /// Most sections that a thread touches between two looks at the budget. A block of scattered points may lie in as
    /// many sections as it has points.
    pub touched_sections: usize,
    /// Chunks that wait for a thread, where all of a set is read.
    pub waiting_chunks: usize,
    /// Packed sections that wait to be taken.
    pub arrivals: usize,
    /// What was learned is kept so often: a process that is killed loses no more.
    pub keep_every: Duration,
    /// Points of the sparse sample, about: some 4 MB.
    pub sample_points: usize,
    /// Most records of a chunk of LAS in it.
    pub sample_chunk_records: u64,

    /// Part of the host's budget for layers of the chunks that are being decoded: one in so many bytes.
    pub layers_part: u64,
    /// Most bytes of them, however much there is.
    pub layer_bytes: u64,
    /// Likewise for packed sections on their way from the threads, which are counted twice: another may come.
    pub arriving_part: u64,
    /// Likewise for packed sections that wait to be uploaded.
    pub arrived_part: u64,
    /// Likewise for packed sections kept after they were uploaded. What is left is for sections that are being made.
    pub kept_part: u64,
}

/// The limits of this program.
pub const LIMITS: Limits = Limits {
    frames_in_flight: 2,
    frame_bytes: 4 << 20,
    fill_bytes: 8 << 20,
    ring_bytes: 16 << 20,
    piece_bytes: 4 << 20,

    submit_sections: 64,
    constant_bytes: 16 << 10,
    spare_constants: 32,

    page_bytes: 64 << 20,
    page_payloads: 1 << 14,

    cut_nodes: 1 << 18,
    detail_ticks: 60,
    remembered_uses: 1 << 16,

    section_bytes: 900 << 10,
    touched_sections: 1024,
    waiting_chunks: 64,
    arrivals: 16,
    keep_every: Duration::from_secs(20),
    sample_points: 1 << 17,
    sample_chunk_records: 256,

    layers_part: 8,
    layer_bytes: 512 << 20,
    arriving_part: 32,
    arrived_part: 16,
    kept_part: 4,
};

const _: () = {
    let Limits { frame_bytes, fill_bytes, ring_bytes, piece_bytes, page_bytes, .. } = LIMITS;
    // What is uploaded at a time goes through the ring, and what lies in the ring fits a page.
    assert!(frame_bytes <= ring_bytes && fill_bytes <= ring_bytes && piece_bytes <= ring_bytes);
    assert!(ring_bytes <= page_bytes);
    // The shares of the host's budget leave at least a third to sections that are being made.
    let Limits { layers_part, arriving_part, arrived_part, kept_part, .. } = LIMITS;
    let of = 96;
    assert!(of / layers_part + 2 * of / arriving_part + of / arrived_part + of / kept_part <= of / 3 * 2);
};
