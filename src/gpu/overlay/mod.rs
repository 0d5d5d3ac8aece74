//! Drawing onto the window's image: what passes have traced, and the toolkit's triangles over it.
//!
//! Corners, indices and textures are buffers that shaders reach by address: there are no images but the window's own.
//! What is drawn is a [`Drawing`] of plain triangles; whoever knows the toolkit fills it.
//!
//! Why not the crate `egui-ash-renderer` (0.13.0, by its source): a window that must not stall cannot use it.
//! Each change of a texture is submitted past [`super::Order`] and then waits until the whole queue is idle
//! (`renderer/vulkan.rs:586`), which here is the queue of the frames. A texture that is replaced or freed goes at once
//! (`renderer.rs:382`, `:434`), so frames in flight would have to be waited for as well, and a part of one is written
//! into the image that they read, whose rest the barrier before it discards (old layout `UNDEFINED`,
//! `renderer/vulkan.rs:463`). The colours would be others: textures are decoded, then encoded by an exponent of 2.2
//! (`shaders/shader.frag:13`), all are interpolated (`renderer/vulkan.rs:389`), while the toolkit asks for the nearest
//! texel of some. It wants the allocator in an `Arc<Mutex<_>>` of its own handle (`renderer.rs:144`), and has no way to
//! draw from a buffer, which is where the traced image lies.

mod drawing;
mod pass;
mod pipeline;

pub use drawing::{Corner, Drawing, Texture, TracedImage};
pub use pass::Overlay;
