//! The upload ring: mapped memory that copies read from, used again when they are done.

use std::collections::VecDeque;

use super::device::Gpu;
use super::edge::Edge;
use super::error::Result;
use super::kinds::MemoryKind;
use super::memory::Buffer;
use super::order::Order;
use super::sync::SyncPoint;

/// Copies start at multiples of it.
const ALIGN_BYTES: u64 = 16;

/// A persistently mapped ring of bytes on their way to the device.
///
/// Push pieces, record copies from [`UploadRing::buffer`], submit, then [`UploadRing::seal`] with the
/// point of the submit: the space comes back when the point is reached.
pub struct UploadRing {
    buffer: Buffer,
    space: Space,
}

impl UploadRing {
    /// A ring of `size` bytes, rounded up to 16.
    pub fn new(gpu: &Gpu, name: &str, size: u64) -> Result<UploadRing> {
        let size = size.next_multiple_of(ALIGN_BYTES);
        Ok(UploadRing { buffer: Buffer::new(gpu, name, MemoryKind::Upload, size)?, space: Space::new(size) })
    }

    /// What copies read from.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Writes `bytes` into the ring and returns their offset; `None` when there is no room until
    /// [`UploadRing::oldest`] is reached (or ever, when they are larger than the ring).
    pub fn push(&mut self, order: &mut Order, bytes: &[u8]) -> Result<Option<u64>> {
        let at = self.reserve(order, bytes.len() as u64)?;
        Ok(at.inspect(|&at| self.buffer.write(at, bytes)))
    }

    /// A place for `len` bytes, to be written through [`UploadRing::buffer`] before the copy is submitted;
    /// `None` as in [`UploadRing::push`].
    pub fn reserve(&mut self, order: &mut Order, len: u64) -> Result<Option<u64>> {
        while let Some(point) = self.space.oldest() {
            if !order.may_reuse(Edge::RingReuse, point)? {
                break;
            }
            self.space.release_oldest();
        }
        Ok(self.space.reserve(len))
    }

    /// Ties everything pushed since the last seal to the copy that reads it.
    pub fn seal(&mut self, copied: SyncPoint) {
        self.space.seal(copied);
    }

    /// The copy whose end frees the next space.
    pub fn oldest(&self) -> Option<SyncPoint> {
        self.space.oldest()
    }
}

/// Which bytes of the ring are taken; no memory, so it is tested without a device.
struct Space<P = SyncPoint> {
    size: u64,
    /// Where the next piece goes.
    head: u64,
    /// Bytes taken, ending at `head` (around the end of the ring).
    used: u64,
    /// Of `used`: pushed, not sealed.
    open: u64,
    /// Sealed stretches, oldest first.
    sealed: VecDeque<(P, u64)>,
}

impl<P: Copy> Space<P> {
    fn new(size: u64) -> Space<P> {
        Space { size, head: 0, used: 0, open: 0, sealed: VecDeque::new() }
    }

    fn reserve(&mut self, len: u64) -> Option<u64> {
        if self.used == 0 {
            self.head = 0; // the whole ring in one piece
        }
        let len = len.checked_next_multiple_of(ALIGN_BYTES)?;
        // A piece lies in one stretch: what is left before the end of the ring is skipped.
        let skipped = if len > self.size - self.head { self.size - self.head } else { 0 };
        let taken = len.checked_add(skipped)?;
        if taken > self.size - self.used {
            return None;
        }
        let offset = if skipped > 0 { 0 } else { self.head };
        self.head = (offset + len) % self.size;
        self.used += taken;
        self.open += taken;
        Some(offset)
    }

    fn seal(&mut self, point: P) {
        if self.open > 0 {
            self.sealed.push_back((point, std::mem::take(&mut self.open)));
        }
    }

    fn oldest(&self) -> Option<P> {
        self.sealed.front().map(|(p, _)| *p)
    }

    fn release_oldest(&mut self) {
        if let Some((_, bytes)) = self.sealed.pop_front() {
            self.used -= bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever is pushed, sealed and released: no piece overlaps one that is still in use.
        #[test]
        fn pieces_in_use_never_overlap(steps in prop::collection::vec((1u64..400, 0u8..4), 1..200)) {
            let mut space = Space::<u32>::new(1024);
            let (mut live, mut next): (Vec<(u64, u64, Option<u32>)>, u32) = (Vec::new(), 0);
            for (len, what) in steps {
                match what {
                    0 => {
                        space.seal(next);
                        for piece in live.iter_mut().filter(|p| p.2.is_none()) {
                            piece.2 = Some(next);
                        }
                        next += 1;
                    }
                    1 => {
                        if let Some(point) = space.oldest() {
                            space.release_oldest();
                            live.retain(|p| p.2 != Some(point));
                        }
                    }
                    _ => {
                        if let Some(at) = space.reserve(len) {
                            prop_assert!(at % ALIGN_BYTES == 0 && at + len <= 1024);
                            for (from, to, _) in &live {
                                prop_assert!(at + len <= *from || at >= *to);
                            }
                            live.push((at, at + len, None));
                        } else {
                            prop_assert!(space.used > 0);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_full_ring_frees_in_order_and_a_piece_too_large_never_fits() {
        let mut space = Space::<u32>::new(64);
        assert_eq!(space.reserve(65), None);
        assert_eq!(space.reserve(u64::MAX), None);
        assert_eq!((space.reserve(32), space.reserve(20)), (Some(0), Some(32)));
        space.seal(1);
        assert_eq!(space.reserve(1), None);
        space.release_oldest();
        assert_eq!(space.reserve(64), Some(0));
    }
}
