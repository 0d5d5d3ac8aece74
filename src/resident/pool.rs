//! The pool: device memory in which payloads lie, in pages, sub-allocated. It knows only bytes.

use crate::gpu::{Buffer, DeviceKind, Gpu, GpuError, MemoryKind};
use crate::limits::LIMITS;
use crate::section::slot::{ALIGN, units};
use offset_allocator::{Allocation, Allocator};

/// How shaders reach the pool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// By device address: any number of pages.
    Address,
    /// By device address, and as texels where frames read it: derived parts have one page.
    Texels,
    /// Through one storage buffer, which synchronization validation sees: one page, as large as the device lets such a
    /// buffer be (128 MiB are usual).
    StorageBuffer,
}

impl Access {
    /// How a pool is best reached that will hold derived parts of `bytes` (of slots) at most.
    pub fn best(gpu: &Gpu, bytes: u64) -> Access {
        // Some places will be too small for what is asked for.
        let fits = bytes <= texel_bytes(gpu) / 16 * 15;
        if gpu.info().kind == DeviceKind::Cpu && fits { Access::Texels } else { Access::Address }
    }
}

/// Largest page that can be seen as texels.
fn texel_bytes(gpu: &Gpu) -> u64 {
    let limits = gpu.limits();
    // Shaders count words in an i32.
    (u64::from(limits.texels) * 4).min(limits.buffer_bytes).min(limits.allocation_bytes).min(4 << 30)
}

/// What a slot is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Written by copies, read by derived passes.
    Uploaded,
    /// Written by derived passes, read by frames.
    Derived,
}

/// Where a payload lies. Not `Clone`: given back once, to [`Pool::free`].
pub struct Slot {
    page: usize,
    allocation: Allocation,
    offset: u64,
    /// What it takes of the page.
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
    /// Most bytes that were ever used at once: of a CPU driver's page hardly more is backed by memory.
    most_bytes: u64,
    /// Seen as texels: derived parts alone are in it, and in no other.
    texels: bool,
}

impl Page {
    fn used_bytes(&self) -> u64 {
        self.buffer.size() - self.free_bytes
    }

    fn alloc(&mut self, units: u32) -> Option<(Allocation, u64)> {
        let allocation = self.space.allocate(units)?;
        self.free_bytes -= u64::from(units) * ALIGN;
        self.most_bytes = self.most_bytes.max(self.used_bytes());
        Some((allocation, u64::from(allocation.offset) * ALIGN))
    }
}

/// Pages of device memory under a hard budget.
pub struct Pool {
    gpu: Gpu,
    access: Access,
    pages: Vec<Option<Page>>,
    budget_bytes: u64,
}

impl Pool {
    /// An empty pool of at most `budget_bytes` of pages.
    pub fn new(gpu: &Gpu, access: Access, budget_bytes: u64) -> Pool {
        Pool { gpu: gpu.clone(), access, pages: Vec::new(), budget_bytes }
    }

    /// A place for `bytes`; `None` when the budget has no room for it.
    pub fn alloc(&mut self, part: Part, bytes: u64) -> Result<Option<Slot>, GpuError> {
        let units = units(bytes);
        let texels = self.access == Access::Texels && part == Part::Derived;
        let bytes_held = u64::from(units) * ALIGN;
        let held = self.held_bytes();
        let mut found = None;
        for (index, page) in self.pages.iter_mut().enumerate() {
            let Some(page) = page.as_mut().filter(|page| page.texels == texels) else { continue };
            let grows = (page.used_bytes() + bytes_held).saturating_sub(page.most_bytes);
            if self.access == Access::Texels && held + grows > self.budget_bytes {
                continue;
            }
            found = page.alloc(units).map(|place| (index, place));
            if found.is_some() {
                break;
            }
        }
        if found.is_none() {
            let Some(index) = self.new_page(texels, bytes_held)? else { return Ok(None) };
            let page = self.pages[index].as_mut().expect("just made");
            found = page.alloc(units).map(|place| (index, place));
        }
        let (page, (allocation, offset)) = found.expect("the page was made to hold it");
        Ok(Some(Slot { page, allocation, offset, units }))
    }

    /// Adds a page that holds at least `bytes`, if the budget allows.
    fn new_page(&mut self, texels: bool, bytes: u64) -> Result<Option<usize>, GpuError> {
        let left = self.budget_bytes.saturating_sub(self.held_bytes()) / ALIGN * ALIGN;
        // The last page may be smaller than the others, where all of it counts.
        let size = match self.access {
            Access::Texels if texels => texel_bytes(&self.gpu) / ALIGN * ALIGN,
            Access::Texels => LIMITS.page_bytes.max(bytes),
            Access::Address => LIMITS.page_bytes.max(bytes).min(left),
            Access::StorageBuffer => (self.gpu.limits().storage_buffer_range / ALIGN * ALIGN).min(left),
        };
        let only = texels || self.access == Access::StorageBuffer;
        if only && self.pages.iter().flatten().any(|page| page.texels == texels)
            || size < bytes
            || left < bytes
        {
            return Ok(None);
        }
        let name = format!("pool page {}", self.pages.len());
        let buffer = match Buffer::new(&self.gpu, &name, MemoryKind::Device, size) {
            Ok(buffer) => buffer,
            // Others use the device, too: what is held by now is all that can be had.
            Err(error @ GpuError::Memory { .. }) if self.held_bytes() > 0 => {
                tracing::warn!("the device has no more memory: {error}");
                self.budget_bytes = self.held_bytes();
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        let space = Allocator::with_max_allocs((size / ALIGN) as u32, LIMITS.page_payloads);
        let page = Some(Page { buffer, space, free_bytes: size, most_bytes: 0, texels });
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
        if page.free_bytes == page.buffer.size() {
            // Work in flight holds the buffer until it is done.
            self.pages[slot.page] = None;
        }
    }

    /// The page that a slot is in.
    pub fn buffer(&self, slot: &Slot) -> &Buffer {
        &self.pages[slot.page].as_ref().expect("a slot's page stays").buffer
    }

    /// The place of word `word` of a slot, for those who write it.
    pub fn place(&self, slot: &Slot, word: u32) -> [u32; 2] {
        match self.access {
            Access::Address | Access::Texels => {
                let address = self.buffer(slot).address() + slot.offset + 4 * u64::from(word);
                [address as u32, (address >> 32) as u32]
            }
            Access::StorageBuffer => self.word_of_page(slot, word),
        }
    }

    /// The same for those who read it.
    pub fn place_to_read(&self, slot: &Slot, word: u32) -> [u32; 2] {
        match self.access {
            Access::Address => self.place(slot, word),
            Access::Texels | Access::StorageBuffer => self.word_of_page(slot, word),
        }
    }

    /// Place 0, 0 stands for "none".
    fn word_of_page(&self, slot: &Slot, word: u32) -> [u32; 2] {
        [(slot.offset / 4) as u32 + word, 1]
    }

    /// How shaders reach it.
    pub fn access(&self) -> Access {
        self.access
    }

    /// All pages.
    pub fn buffers(&self) -> impl Iterator<Item = &Buffer> {
        self.pages.iter().flatten().map(|p| &p.buffer)
    }

    /// The page that derived parts are in, where it is the only one.
    pub fn derived_page(&self) -> Option<&Buffer> {
        self.pages.iter().flatten().find(|p| p.texels == (self.access == Access::Texels)).map(|p| &p.buffer)
    }

    /// Bytes that all pages take of the budget.
    pub fn held_bytes(&self) -> u64 {
        let of = |page: &Page| match self.access {
            Access::Texels => page.most_bytes,
            Access::Address | Access::StorageBuffer => page.buffer.size(),
        };
        self.pages.iter().flatten().map(of).sum()
    }
}
