//! The only unsafe code: device, memory, timelines, pipelines, and the order between queues.
//!
//! One thread records and submits; pipelines are compiled on any. [`Gpu`] is the device, [`Buffer`] memory,
//! [`ComputePipeline`] a compiled shader, [`Commands`] work being recorded; [`Order`] alone begins and submits work,
//! because it owns every wait and barrier. Imports run downward only:
//!
//! | | |
//! |---|---|
//! | drawing in a window | `overlay`, `swapchain` |
//! | helpers of those who record | `ring`, `timestamps` |
//! | the order between queues | `order` |
//! | work, and when it is done | `command`, `timeline` |
//! | what work uses | `binding`, `pipeline`, `memory` |
//! | the device | `device`, `pipeline_cache`, `surface`, `physical`, `instance` |
//! | plain values | `acquired`, `edge`, `sync`, `error`, `kinds`, `lock`, `shaders` |
#![allow(unsafe_code)]

#[cfg(feature = "view")]
mod acquired;
mod binding;
mod command;
mod device;
mod edge;
mod error;
mod instance;
mod kinds;
#[cfg(test)]
pub(crate) mod layout;
mod lock;
mod memory;
mod order;
#[cfg(feature = "view")]
mod overlay;
mod physical;
mod pipeline;
mod pipeline_cache;
mod ring;
pub mod shaders;
#[cfg(feature = "view")]
mod surface;
#[cfg(feature = "view")]
mod swapchain;
mod sync;
mod timeline;
mod timestamps;

#[cfg(feature = "view")]
pub use acquired::Acquired;
pub use binding::{Binding, BindingCache};
pub use command::{BufferCopy, Commands};
pub use device::{Gpu, GpuOptions};
pub use edge::{Edge, Event};
pub use error::{GpuError, Result};
pub use kinds::{BindingKind, MemoryKind, QueueKind};
pub use memory::{Buffer, stream_words};
pub use order::Order;
#[cfg(feature = "view")]
pub use overlay::{Corner, Drawing, Overlay, Texture, TracedImage};
pub use physical::{DeviceInfo, DeviceKind, Limits, list_devices};
pub use pipeline::{ComputePipeline, Executable, PipelineDesc};
pub use ring::UploadRing;
#[cfg(feature = "view")]
pub use surface::Window;
#[cfg(feature = "view")]
pub use swapchain::Swapchain;
pub use sync::SyncPoint;
pub use timestamps::Timestamps;
