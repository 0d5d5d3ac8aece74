//! Payloads on their way to the device: slots of the pool, bytes through the upload ring, and which slots are free again
//! when.
//!
//! The calls for one payload, in order: [`Transfer::allocate`] gives slots ([`Transfer::free`] takes them back where nothing
//! was copied to them); [`Transfer::upload`] or [`Transfer::try_upload`] records the copy and gives a [`Ticket`];
//! [`Transfer::flush`] submits what is recorded, from when on the ticket names the copy's point ([`Transfer::finish`] sees to
//! that, [`Transfer::give_up`] ends a copy that is only begun); [`Transfer::retire`] gives the slots back with all that may
//! still use them. [`Transfer::advance`], once a frame, submits what is recorded and frees retired slots whose uses are over.

use super::pool::{Access, Part, Pool, Slot};
use super::work::{Recording, Submitter, Work};
use crate::gpu::{Buffer, BufferCopy, Gpu, GpuError, SyncPoint, UploadRing, stream_words};
use crate::limits::LIMITS;
use crate::section::{HighestOf, Layout, Payload};
use std::sync::{Arc, OnceLock};

/// Where a payload and what is derived from it lie.
pub struct Slots {
    /// What is copied.
    pub uploaded: Slot,
    /// What the device makes of it.
    pub derived: Slot,
}

/// A payload's copy: which submit ends it, as soon as that is submitted.
#[derive(Clone, Default)]
pub struct Ticket(Arc<OnceLock<SyncPoint>>);

impl Ticket {
    /// The end of the copy; `None`: not all of it has been submitted.
    pub fn point(&self) -> Option<SyncPoint> {
        self.0.get().copied()
    }

    fn end_at(&self, point: SyncPoint) {
        let is_first = self.0.set(point).is_ok();
        debug_assert!(is_first, "a copy ends once");
    }

    fn is(&self, other: &Ticket) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// A payload larger than the ring, on its way in pieces, one a frame.
struct InPieces {
    payload: Arc<Payload>,
    /// Where it goes.
    page: Buffer,
    offset: u64,
    /// Bytes whose copies were recorded.
    copied: u64,
    ticket: Ticket,
}

/// Slots that were given back: free once the last work that used them is over.
struct Freed {
    slots: Slots,
    uses: Vec<SyncPoint>,
}

/// See the module.
pub struct Transfer {
    pool: Pool,
    ring: UploadRing,
    /// The copies that are being recorded, and the tickets that end with them.
    batch: Option<Recording>,
    ending: Vec<Ticket>,
    in_pieces: Option<InPieces>,
    freed: Vec<Freed>,
    /// The latest work, of each submitter, that used a slot which is free again: copies go after it.
    reclaimed: Vec<SyncPoint>,
    waits: u64,
}

impl Transfer {
    /// An empty pool of `budget_bytes` at most, and a ring.
    pub fn new(gpu: &Gpu, access: Access, budget_bytes: u64) -> Result<Transfer, GpuError> {
        Ok(Transfer {
            pool: Pool::new(gpu, access, budget_bytes),
            ring: UploadRing::new(gpu, "upload ring", LIMITS.ring_bytes)?,
            batch: None,
            ending: Vec::new(),
            in_pieces: None,
            freed: Vec::new(),
            reclaimed: Vec::new(),
            waits: 0,
        })
    }

    /// The pool.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Times that an upload waited for the device.
    pub fn waits(&self) -> u64 {
        self.waits
    }

    /// Bytes of host memory that are held for a payload larger than the ring.
    pub fn held_bytes(&self) -> u64 {
        self.in_pieces.as_ref().map_or(0, |large| large.payload.uploaded_bytes())
    }

    /// Whether a payload is on its way in pieces.
    pub fn is_in_pieces(&self) -> bool {
        self.in_pieces.is_some()
    }

    /// Whether a payload goes in pieces and those of another are on their way.
    pub fn waits_for_pieces(&self, layout: &Layout) -> bool {
        layout.uploaded_bytes() > LIMITS.ring_bytes && self.is_in_pieces()
    }

    /// Slots for a payload, if there are any now.
    pub fn allocate(
        &mut self,
        submitter: &mut Submitter,
        layout: &Layout,
    ) -> Result<Option<Slots>, GpuError> {
        if let Some(slots) = self.slots(layout)? {
            return Ok(Some(slots));
        }
        // The copy being recorded knows nothing of slots that come back from here on.
        self.flush(submitter)?;
        self.reclaim(submitter)?;
        self.slots(layout)
    }

    /// The same, waiting for slots that were given back; `None` when there are none even after all of those are free.
    pub fn allocate_or_wait(
        &mut self,
        submitter: &mut Submitter,
        layout: &Layout,
    ) -> Result<Option<Slots>, GpuError> {
        loop {
            if let Some(slots) = self.allocate(submitter, layout)? {
                return Ok(Some(slots));
            }
            let Some(last_use) = self.freed.first().and_then(|f| f.uses.last()) else { return Ok(None) };
            self.waits += 1;
            submitter.order.wait(*last_use)?;
        }
    }

    fn slots(&mut self, layout: &Layout) -> Result<Option<Slots>, GpuError> {
        let Some(derived) = self.pool.alloc(Part::Derived, layout.derived_bytes())? else { return Ok(None) };
        let Some(uploaded) = self.pool.alloc(Part::Uploaded, layout.uploaded_bytes())? else {
            self.pool.free(derived);
            return Ok(None);
        };
        Ok(Some(Slots { uploaded, derived }))
    }

    /// Whether slots that were given back are not free yet.
    pub fn has_freed(&self) -> bool {
        !self.freed.is_empty()
    }

    /// Copies what `write` writes, which is given all words of the payload, each to be written once and in order, right
    /// in the upload ring. Waits for older copies if it must.
    pub fn upload(
        &mut self,
        submitter: &mut Submitter,
        slots: &Slots,
        layout: &Layout,
        write: impl FnOnce(&mut [u32]) -> HighestOf,
    ) -> Result<(Ticket, HighestOf), GpuError> {
        let len = layout.uploaded_bytes();
        let (page, offset) = self.place_of(slots);
        let highest_of = if len <= LIMITS.ring_bytes {
            let from = self.reserve(submitter, len)?;
            let highest_of =
                self.ring.buffer().write_with(from, len, |bytes| write(bytemuck::cast_slice_mut(bytes)));
            self.stage(submitter, &page, offset, from, len)?;
            highest_of
        } else {
            let mut words = vec![0; layout.words as usize];
            let highest_of = write(&mut words);
            let piece_bytes = LIMITS.ring_bytes as usize / 2;
            for (piece, part) in bytemuck::cast_slice::<u32, u8>(&words).chunks(piece_bytes).enumerate() {
                let from = self.reserve(submitter, part.len() as u64)?;
                self.ring.buffer().write(from, part);
                let at = offset + (piece * piece_bytes) as u64;
                self.stage(submitter, &page, at, from, part.len() as u64)?;
            }
            highest_of
        };
        Ok((self.ends_with_batch(), highest_of))
    }

    /// Copies a payload without ever waiting for the device; one larger than the ring goes in pieces, one a call of
    /// [`Transfer::advance`]. `None`: the ring has no room now, or pieces of another are on their way.
    pub fn try_upload(
        &mut self,
        submitter: &mut Submitter,
        slots: &Slots,
        payload: &Arc<Payload>,
    ) -> Result<Option<Ticket>, GpuError> {
        let len = payload.uploaded_bytes();
        let (page, offset) = self.place_of(slots);
        if len > LIMITS.ring_bytes {
            if self.is_in_pieces() {
                return Ok(None);
            }
            let ticket = Ticket::default();
            let payload = Arc::clone(payload);
            self.in_pieces = Some(InPieces { payload, page, offset, copied: 0, ticket: ticket.clone() });
            return Ok(Some(ticket));
        }
        let Some(from) = self.ring.reserve(submitter.order, len)? else { return Ok(None) };
        self.ring.buffer().write_with(from, len, |bytes| {
            stream_words(bytemuck::cast_slice_mut(bytes), &payload.words);
        });
        self.stage(submitter, &page, offset, from, len)?;
        Ok(Some(self.ends_with_batch()))
    }

    fn place_of(&self, slots: &Slots) -> (Buffer, u64) {
        (self.pool.buffer(&slots.uploaded).clone(), slots.uploaded.offset())
    }

    fn ends_with_batch(&mut self) -> Ticket {
        let ticket = Ticket::default();
        self.ending.push(ticket.clone());
        ticket
    }

    /// Records the copy of the next piece of a payload larger than the ring, if the ring has room for it now.
    fn stage_piece(&mut self, submitter: &mut Submitter) -> Result<(), GpuError> {
        let Some(large) = &self.in_pieces else { return Ok(()) };
        let (all, copied) = (large.payload.uploaded_bytes(), large.copied);
        let len = LIMITS.piece_bytes.min(all - copied);
        let Some(from) = self.ring.reserve(submitter.order, len)? else { return Ok(()) };
        let words = &large.payload.words[copied as usize / 4..(copied + len) as usize / 4];
        self.ring.buffer().write_with(from, len, |bytes| {
            stream_words(bytemuck::cast_slice_mut(bytes), words);
        });
        let (page, at) = (large.page.clone(), large.offset + copied);
        self.stage(submitter, &page, at, from, len)?;
        if let Some(large) = &mut self.in_pieces {
            large.copied += len;
        }
        let is_over = self.in_pieces.take_if(|large| large.copied == all);
        self.ending.extend(is_over.map(|large| large.ticket));
        Ok(())
    }

    /// Submits all of a copy, waiting for the ring if it must.
    pub fn finish(&mut self, submitter: &mut Submitter, ticket: &Ticket) -> Result<(), GpuError> {
        while self.in_pieces.as_ref().is_some_and(|large| large.ticket.is(ticket)) {
            self.wait_for_ring(submitter)?;
            self.stage_piece(submitter)?;
        }
        if ticket.point().is_none() { self.flush(submitter) } else { Ok(()) }
    }

    /// Copies no more of a payload: what was copied of it ends with the last copy. Call it when nothing is recorded.
    pub fn give_up(&mut self, ticket: &Ticket, last_copy: Option<SyncPoint>) {
        debug_assert!(self.batch.is_none(), "what is recorded ends later than the last copy");
        if self.in_pieces.take_if(|large| large.ticket.is(ticket)).is_some()
            && let Some(point) = last_copy
        {
            ticket.end_at(point);
        }
    }

    /// A place for `len` bytes in the upload ring: waits for older copies if it must.
    fn reserve(&mut self, submitter: &mut Submitter, len: u64) -> Result<u64, GpuError> {
        loop {
            if let Some(from) = self.ring.reserve(submitter.order, len)? {
                return Ok(from);
            }
            self.wait_for_ring(submitter)?;
        }
    }

    /// Waits until a part of the ring is free that is not now.
    pub fn wait_for_ring(&mut self, submitter: &mut Submitter) -> Result<(), GpuError> {
        self.flush(submitter)?;
        if let Some(oldest) = self.ring.oldest() {
            self.waits += 1;
            submitter.order.wait(oldest)?;
        }
        Ok(())
    }

    /// Records the copy of `len` bytes at `from` of the ring to byte `at` of a page.
    fn stage(
        &mut self,
        submitter: &mut Submitter,
        page: &Buffer,
        at: u64,
        from: u64,
        len: u64,
    ) -> Result<(), GpuError> {
        let mut recording = match self.batch.take() {
            Some(recording) => recording,
            None => {
                let mut after = self.reclaimed.clone();
                if self.pool.access() == Access::StorageBuffer {
                    // Validation takes a bound buffer as touched all over.
                    after
                        .extend(submitter.submits.last_build.into_iter().chain(submitter.submits.last_frame));
                }
                let commands = submitter.order.begin_copy("uploads", &after)?;
                submitter.submits.start(Work::Copy, commands)?
            }
        };
        let range = BufferCopy { from, to: at, size: len };
        recording.commands.copy(self.ring.buffer(), page, &[range]);
        self.batch = Some(recording);
        Ok(())
    }

    /// Submits the copies recorded so far.
    pub fn flush(&mut self, submitter: &mut Submitter) -> Result<(), GpuError> {
        let Some(recording) = self.batch.take() else { return Ok(()) };
        let point = submitter.submits.submit(submitter.order, recording)?;
        self.ring.seal(point);
        self.ending.drain(..).for_each(|ticket| ticket.end_at(point));
        Ok(())
    }

    /// What a frame does: the next piece, submitted with all that is recorded, and slots freed. Never waits.
    pub fn advance(&mut self, submitter: &mut Submitter) -> Result<(), GpuError> {
        self.stage_piece(submitter)?;
        self.flush(submitter)?;
        self.reclaim(submitter)
    }

    /// Frees slots that nothing uses.
    pub fn free(&mut self, slots: Slots) {
        self.pool.free(slots.uploaded);
        self.pool.free(slots.derived);
    }

    /// Gives slots back that `uses` may still read or write: none is one of later work.
    pub fn retire(&mut self, slots: Slots, uses: Vec<SyncPoint>) {
        self.freed.push(Freed { slots, uses });
    }

    /// Frees slots whose last use the host has seen over.
    fn reclaim(&mut self, submitter: &mut Submitter) -> Result<(), GpuError> {
        let mut still = Vec::new();
        for freed in std::mem::take(&mut self.freed) {
            let mut over = true;
            for &point in &freed.uses {
                over &= submitter.order.reached(point)?;
            }
            if !over {
                still.push(freed);
                continue;
            }
            for point in freed.uses {
                match self.reclaimed.iter_mut().find(|p| p.queue() == point.queue()) {
                    Some(known) if known.value() >= point.value() => {}
                    Some(known) => *known = point,
                    None => self.reclaimed.push(point),
                }
            }
            self.free(freed.slots);
        }
        self.freed = still;
        submitter.order.collect()
    }
}
