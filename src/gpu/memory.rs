//! Buffers: the only kind of memory that is used.

use std::fmt;
use std::mem::ManuallyDrop;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::MemoryKind;
use super::lock::lock;

/// A buffer of this size or more gets an allocation of its own.
const DEDICATED_BYTES: u64 = 8 << 20;

/// A storage buffer with a device address, shared by both queues. A clone is another handle to the
/// same memory; [`super::Commands`] hold one of each buffer they were given until they are done.
#[derive(Clone)]
pub struct Buffer(Arc<Inner>);

struct Inner {
    gpu: Gpu,
    handle: vk::Buffer,
    address: u64,
    size: u64,
    name: String,
    /// Locked around host accesses, so that two threads never touch the bytes at once.
    allocation: Mutex<ManuallyDrop<Allocation>>,
}

impl Buffer {
    /// Makes a buffer of `size` bytes (at least 4 are made); what it holds is undefined.
    pub fn new(gpu: &Gpu, name: &str, kind: MemoryKind, size: u64) -> Result<Buffer> {
        let size = size.max(4);
        let no_memory =
            |reason: String| GpuError::Memory { name: name.to_owned(), kind, bytes: size, reason };
        let limits = gpu.limits();
        if size > limits.buffer_bytes.min(limits.allocation_bytes) {
            return Err(no_memory(format!(
                "the device's limit is {} bytes a buffer, {} an allocation",
                limits.buffer_bytes, limits.allocation_bytes
            )));
        }
        let families = gpu.families();
        let mut create = vk::BufferCreateInfo::default().size(size).usage(
            vk::BufferUsageFlags::STORAGE_BUFFER
                | vk::BufferUsageFlags::UNIFORM_BUFFER
                | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER
                | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
                | vk::BufferUsageFlags::TRANSFER_SRC
                | vk::BufferUsageFlags::TRANSFER_DST,
        );
        if families.len() > 1 {
            create = create.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(&families);
        }
        let device = gpu.device();
        // SAFETY: the device is alive: `gpu` holds it.
        let handle = unsafe { device.create_buffer(&create, None) }.map_err(|e| no_memory(e.to_string()))?;
        // SAFETY: as above; `handle` was just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(handle) };
        let allocated = lock(&gpu.0.allocator).allocate(&AllocationCreateDesc {
            name,
            requirements,
            location: match kind {
                MemoryKind::Device => MemoryLocation::GpuOnly,
                MemoryKind::Upload => MemoryLocation::CpuToGpu,
                MemoryKind::Readback => MemoryLocation::GpuToCpu,
            },
            linear: true,
            allocation_scheme: if size >= DEDICATED_BYTES {
                AllocationScheme::DedicatedBuffer(handle)
            } else {
                AllocationScheme::GpuAllocatorManaged
            },
        });
        let allocation = match allocated {
            Ok(allocation) => allocation,
            Err(e) => {
                // SAFETY: the buffer is unbound and unknown to anyone else.
                unsafe { device.destroy_buffer(handle, None) };
                return Err(no_memory(e.to_string()));
            }
        };
        gpu.0.allocated_bytes.fetch_add(allocation.size(), Ordering::Relaxed);
        // From here on Drop gives both back.
        let mut inner = Inner {
            gpu: gpu.clone(),
            handle,
            address: 0,
            size,
            name: name.to_owned(),
            allocation: Mutex::new(ManuallyDrop::new(allocation)),
        };
        {
            let allocation = lock(&inner.allocation);
            // SAFETY: the memory was allocated for this buffer's requirements and outlives it.
            unsafe { device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) }
                .map_err(|e| no_memory(e.to_string()))?;
        }
        // SAFETY: the buffer is bound and was made with SHADER_DEVICE_ADDRESS.
        inner.address = unsafe {
            device.get_buffer_device_address(&vk::BufferDeviceAddressInfo::default().buffer(handle))
        };
        gpu.name_object(handle, name);
        Ok(Buffer(Arc::new(inner)))
    }

    /// Where shaders find byte 0.
    pub fn address(&self) -> u64 {
        self.0.address
    }

    /// Bytes.
    pub fn size(&self) -> u64 {
        self.0.size
    }

    /// The debug name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Writes `bytes` at `offset`. The device must not be reading them: see [`super::Order`].
    ///
    /// # Panics
    /// When the range is outside the buffer, or the host cannot reach it.
    pub fn write(&self, offset: u64, bytes: &[u8]) {
        self.write_with(offset, bytes.len() as u64, |to| to.copy_from_slice(bytes));
    }

    /// Lends the `len` bytes at `offset` to `write`, which had better not read them: the memory may be
    /// write-combined. What they hold is undefined. The device must not be using them: see [`super::Order`].
    ///
    /// # Panics
    /// When the range is outside the buffer, or the host cannot reach it.
    pub fn write_with<R>(&self, offset: u64, len: u64, write: impl FnOnce(&mut [u8]) -> R) -> R {
        self.check(offset, len);
        let allocation = lock(&self.0.allocation);
        let mapped = allocation.mapped_ptr().expect("the host writes only to mapped buffers");
        // SAFETY: the range is inside the mapping (checked above), which lives as long as the
        // allocation; the lock keeps other host threads out while the bytes are lent, so nothing else
        // refers to them; any bytes are valid `u8`s (the driver hands out initialised pages).
        let bytes = unsafe {
            std::slice::from_raw_parts_mut(mapped.as_ptr().cast::<u8>().add(offset as usize), len as usize)
        };
        write(bytes)
    }

    /// Reads at `offset` into `bytes`. The device must be done writing: see [`super::Order::read`].
    ///
    /// # Panics
    /// When the range is outside the buffer, or the host cannot reach it.
    pub(super) fn read(&self, offset: u64, bytes: &mut [u8]) {
        self.check(offset, bytes.len() as u64);
        let allocation = lock(&self.0.allocation);
        let mapped = allocation.mapped_ptr().expect("the host reads only from mapped buffers");
        // SAFETY: as in `write`, the other way round.
        unsafe {
            let from = mapped.as_ptr().cast::<u8>().add(offset as usize);
            from.copy_to_nonoverlapping(bytes.as_mut_ptr(), bytes.len());
        }
    }

    pub(super) fn check(&self, offset: u64, len: u64) {
        let end = offset.checked_add(len);
        assert!(
            end.is_some_and(|end| end <= self.0.size),
            "{len} bytes at {offset} are outside {} of {} bytes",
            self.0.name,
            self.0.size
        );
    }

    /// Whether both are handles to the same memory.
    pub(super) fn is(&self, other: &Buffer) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    pub(super) fn handle(&self) -> vk::Buffer {
        self.0.handle
    }
}

/// Copies words with stores that go past the caches, where the machine has them: what is meant for the device need not
/// be fetched first, nor push out what the host still reads.
///
/// # Panics
/// When the lengths differ.
pub fn stream_words(to: &mut [u32], from: &[u32]) {
    assert_eq!(to.len(), from.len(), "words to copy");
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{__m128i, _mm_loadu_si128, _mm_sfence, _mm_stream_si128};
        /// Words of a cache line.
        const LINE_WORDS: usize = 16;
        let head = to.as_ptr().align_offset(64).min(to.len());
        let lines = (to.len() - head) / LINE_WORDS;
        let (first, rest) = (head, head + lines * LINE_WORDS);
        to[..first].copy_from_slice(&from[..first]);
        to[rest..].copy_from_slice(&from[rest..]);
        let (into, out) = (to[first..rest].as_mut_ptr(), from[first..rest].as_ptr());
        // SAFETY: both run over `lines` whole lines of slices that are borrowed here, `into` on an aligned
        // address; every x86-64 has SSE2. The fence comes before anyone else can see the words.
        unsafe {
            for line in 0..lines {
                for part in 0..4 {
                    let at = line * LINE_WORDS + part * 4;
                    let words = _mm_loadu_si128(out.add(at).cast::<__m128i>());
                    _mm_stream_si128(into.add(at).cast::<__m128i>(), words);
                }
            }
            _mm_sfence();
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    to.copy_from_slice(from);
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Buffer({}, {} bytes)", self.0.name, self.0.size)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        let allocation = self.allocation.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        // SAFETY: taken once, here; nothing uses `self.allocation` afterwards.
        let allocation = unsafe { ManuallyDrop::take(allocation) };
        self.gpu.0.allocated_bytes.fetch_sub(allocation.size(), Ordering::Relaxed);
        // SAFETY: this is the last handle. Work in flight holds one of its own until its timeline value
        // is reached, so the device is done with the buffer.
        unsafe { self.gpu.device().destroy_buffer(self.handle, None) };
        if let Err(e) = lock(&self.gpu.0.allocator).free(allocation) {
            tracing::error!("freeing {}: {e}", self.name);
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn words_are_streamed_whatever_their_place() {
        let from: Vec<u32> = (1..200).collect();
        for first in 0..20 {
            for len in [0, 1, 15, 16, 17, 40, 100, from.len() - first] {
                let mut to = vec![0; 220];
                super::stream_words(&mut to[first..first + len], &from[..len]);
                assert_eq!(to[first..first + len], from[..len]);
                assert!(to[..first].iter().chain(&to[first + len..]).all(|&word| word == 0));
            }
        }
    }
}
