//! The pool: device memory in which payloads lie, in pages, sub-allocated. It knows only bytes.

use crate::gpu::{Buffer, Gpu, GpuError, MemoryKind};
use offset_allocator::{Allocation, Allocator, ext::min_allocator_size};

/// Bytes of a page: small enough for devices that cap a storage buffer at 128 MiB.
const PAGE_BYTES: u64 = 64 << 20;
/// The only page of a pool that is reached through a storage buffer.
const SINGLE_PAGE_BYTES: u64 = 128 << 20;
/// Payloads start at multiples of this.
const ALIGN: u64 = 256;

/// How shaders reach the pool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// By device address: any number of pages.
    Address,
    /// Through one storage buffer, which synchronization validation sees: one page of 128 MiB.
    StorageBuffer,
}

/// What `bytes` take of a page, units of [`ALIGN`]. The allocator keeps free space by size classes, and looks into
/// those alone that hold nothing smaller than what is asked for: a place of a class's very size (at most 12.5 %
/// more) is found again when it is free.
fn units(bytes: u64) -> u32 {
    let units = u32::try_from(bytes.div_ceil(ALIGN)).unwrap_or(u32::MAX);
    if units > 1 << 31 { units } else { min_allocator_size(units) }
}

/// Bytes of a page that a payload of `bytes` takes.
pub fn slot_bytes(bytes: u64) -> u64 {
    u64::from(units(bytes)) * ALIGN
}

/// Where a payload lies. Not `Clone`: given back once, to [`Pool::free`].
pub struct Slot {
    page: usize,
    allocation: Allocation,
    offset: u64,
    /// What was asked for, and what it takes of the page.
    bytes: u64,
    units: u32,
}

impl Slot {
    /// Byte at which it starts in its page.
    pub fn offset(&self) -> u64 {
        self.offset
    }
}

struct Page {
    buffer: Buffer,
    space: Allocator,
    free_bytes: u64,
}

/// Pages of device memory under a hard budget.
pub struct Pool {
    gpu: Gpu,
    access: Access,
    pages: Vec<Option<Page>>,
    budget_bytes: u64,
    page_bytes: u64,
    used_bytes: u64,
}

impl Pool {
    /// An empty pool of at most `budget_bytes` of pages.
    pub fn new(gpu: &Gpu, access: Access, budget_bytes: u64) -> Pool {
        let page_bytes = match access {
            Access::Address => PAGE_BYTES,
            Access::StorageBuffer => SINGLE_PAGE_BYTES,
        };
        Pool { gpu: gpu.clone(), access, pages: Vec::new(), budget_bytes, page_bytes, used_bytes: 0 }
    }

    /// A place for `bytes`; `None` when the budget has no room for it.
    pub fn alloc(&mut self, bytes: u64) -> Result<Option<Slot>, GpuError> {
        let units = units(bytes);
        for (index, page) in self.pages.iter_mut().enumerate() {
            let Some(page) = page else { continue };
            if let Some(allocation) = page.space.allocate(units) {
                page.free_bytes -= u64::from(units) * ALIGN;
                self.used_bytes += bytes;
                let offset = u64::from(allocation.offset) * ALIGN;
                return Ok(Some(Slot { page: index, allocation, offset, bytes, units }));
            }
        }
        let Some(index) = self.new_page(u64::from(units) * ALIGN)? else { return Ok(None) };
        let page = self.pages[index].as_mut().expect("just made");
        let allocation = page.space.allocate(units).expect("the page was made to hold it");
        page.free_bytes -= u64::from(units) * ALIGN;
        self.used_bytes += bytes;
        Ok(Some(Slot { page: index, offset: u64::from(allocation.offset) * ALIGN, allocation, bytes, units }))
    }

    /// Adds a page that holds at least `bytes`, if the budget allows.
    fn new_page(&mut self, bytes: u64) -> Result<Option<usize>, GpuError> {
        if self.access == Access::StorageBuffer && self.buffers().next().is_some() {
            return Ok(None);
        }
        let held: u64 = self.pages.iter().flatten().map(|p| p.buffer.size()).sum();
        let left = self.budget_bytes.saturating_sub(held) / ALIGN * ALIGN;
        // The last page may be smaller than the others.
        let size = self.page_bytes.max(bytes).min(left);
        if size < bytes || size == 0 {
            return Ok(None);
        }
        let buffer =
            Buffer::new(&self.gpu, &format!("pool page {}", self.pages.len()), MemoryKind::Device, size)?;
        let space = Allocator::new((size / ALIGN) as u32);
        let page = Some(Page { buffer, space, free_bytes: size });
        let vacant = self.pages.iter().position(Option::is_none);
        let index = vacant.unwrap_or(self.pages.len());
        match vacant {
            Some(_) => self.pages[index] = page,
            None => self.pages.push(page),
        }
        Ok(Some(index))
    }

    /// Gives a place back. What the device may still read of it must be over: see `gpu::Order`.
    pub fn free(&mut self, slot: Slot) {
        let page = self.pages[slot.page].as_mut().expect("a slot's page stays");
        page.space.free(slot.allocation);
        page.free_bytes += u64::from(slot.units) * ALIGN;
        self.used_bytes -= slot.bytes;
        if page.free_bytes == page.buffer.size() {
            // Work in flight holds the buffer until it is done.
            self.pages[slot.page] = None;
        }
    }

    /// The page that a slot is in.
    pub fn buffer(&self, slot: &Slot) -> &Buffer {
        &self.pages[slot.page].as_ref().expect("a slot's page stays").buffer
    }

    /// A slot's place as the shaders take it.
    pub fn place(&self, slot: &Slot) -> [u32; 2] {
        self.place_of_word(slot, 0)
    }

    /// The place of word `word` of a slot.
    pub fn place_of_word(&self, slot: &Slot, word: u32) -> [u32; 2] {
        let offset = slot.offset + 4 * u64::from(word);
        match self.access {
            Access::Address => {
                let address = self.buffer(slot).address() + offset;
                [address as u32, (address >> 32) as u32]
            }
            // Place 0, 0 stands for "none".
            Access::StorageBuffer => [(offset / 4) as u32, 1],
        }
    }

    /// How shaders reach it.
    pub fn access(&self) -> Access {
        self.access
    }

    /// All pages.
    pub fn buffers(&self) -> impl Iterator<Item = &Buffer> {
        self.pages.iter().flatten().map(|p| &p.buffer)
    }

    /// Bytes handed out.
    pub fn used_bytes(&self) -> u64 {
        self.used_bytes
    }

    /// Bytes of all pages.
    pub fn held_bytes(&self) -> u64 {
        self.buffers().map(Buffer::size).sum()
    }
}
