//! What tells queues, memory and bindings apart: plain values that every file of this layer may name.

use std::fmt;

use ash::vk;

/// The two lines of work. On a device with one queue both are that queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum QueueKind {
    /// Builds and frames.
    Compute,
    /// Uploads.
    Transfer,
}

/// Where a buffer lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryKind {
    /// The device's own memory; the host cannot reach it.
    Device,
    /// Written by the host, read by the device (write-combined where the driver has that).
    Upload,
    /// Written by the device, read by the host (cached).
    Readback,
}

impl fmt::Display for MemoryKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            MemoryKind::Device => "device",
            MemoryKind::Upload => "upload",
            MemoryKind::Readback => "readback",
        })
    }
}

/// What a binding of a shader is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BindingKind {
    /// A buffer of any size that shaders may write.
    Storage,
    /// A small buffer of constants.
    Uniform,
    /// A buffer of words that shaders see as texels: as many as the device's limit says.
    Texels,
}

impl BindingKind {
    pub(super) fn descriptor(self) -> vk::DescriptorType {
        match self {
            BindingKind::Storage => vk::DescriptorType::STORAGE_BUFFER,
            BindingKind::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
            BindingKind::Texels => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
        }
    }
}
