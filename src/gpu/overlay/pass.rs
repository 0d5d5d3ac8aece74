//! The pass that draws onto an image of the window.

use std::sync::Arc;

use super::drawing::{Corner, Drawing};
use super::pipeline::{Push, TrianglePipeline};
use crate::gpu::acquired::Acquired;
use crate::gpu::command::Commands;
use crate::gpu::device::Gpu;
use crate::gpu::error::Result;
use crate::gpu::kinds::MemoryKind;
use crate::gpu::memory::Buffer;
use crate::gpu::swapchain::Swapchain;

/// Behind everything, encoded: what is left free of the traced image.
const BACKDROP: [f32; 4] = [0.09, 0.10, 0.11, 1.0];

/// An encoded colour's linear value; `linear_of` of `shaders/overlay.frag` is the same.
fn linear(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Draws on images of one format.
pub struct Overlay {
    gpu: Gpu,
    pipeline: Arc<TrianglePipeline>,
    /// Corners and indices, for every frame in flight.
    triangles: Vec<Option<Buffer>>,
}

impl Overlay {
    /// For the images of `swapchain`.
    pub fn new(gpu: &Gpu, swapchain: &Swapchain) -> Result<Overlay> {
        let pipeline = Arc::new(TrianglePipeline::new(gpu, swapchain.format(), swapchain.is_linear())?);
        Ok(Overlay { gpu: gpu.clone(), pipeline, triangles: Vec::new() })
    }

    /// Draws inside [`crate::gpu::Order::draw`], in frame `slot`.
    pub fn paint(
        &mut self,
        commands: &mut Commands,
        slot: usize,
        image: &Acquired,
        drawing: &Drawing,
    ) -> Result<()> {
        let corners: &[u8] = bytemuck::cast_slice(&drawing.corners);
        let triangles = self.write(slot, corners, bytemuck::cast_slice(&drawing.indices))?;
        commands.keep(triangles.clone());
        let target = image.size();
        let backdrop = match image.is_linear {
            true => [linear(BACKDROP[0]), linear(BACKDROP[1]), linear(BACKDROP[2]), BACKDROP[3]],
            false => BACKDROP,
        };
        let to_clip = target.map(|pixels| 2.0 * drawing.pixels_per_point / pixels as f32);
        let (mut vertices, mut indices) = (triangles.address(), triangles.address() + corners.len() as u64);
        commands.rendering(image, backdrop, |commands| {
            commands.bind_triangles(&self.pipeline);
            for draw in &drawing.draws {
                let side = |value: f32, most: u32| (value.round().max(0.0) as u32).min(most);
                let [left, top] = [side(draw.clip[0], target[0]), side(draw.clip[1], target[1])];
                let [right, bottom] = [side(draw.clip[2], target[0]), side(draw.clip[3], target[1])];
                commands.clip([left, top, right.saturating_sub(left), bottom.saturating_sub(top)]);
                let push = Push {
                    vertices: halves(vertices),
                    indices: halves(indices),
                    texels: halves(draw.texels.address()),
                    size: draw.size,
                    to_clip,
                    is_smooth: u32::from(draw.is_smooth),
                };
                commands.keep(draw.texels.clone());
                commands.draw(&self.pipeline, &push, draw.indices as u32);
                vertices += (draw.corners * size_of::<Corner>()) as u64;
                indices += (draw.indices * size_of::<u32>()) as u64;
            }
        });
        Ok(())
    }

    /// Corners, and indices behind them, in the buffer of frame `slot`, which grows where they do not fit: frames in
    /// flight keep the old one.
    fn write(&mut self, slot: usize, corners: &[u8], indices: &[u8]) -> Result<Buffer> {
        let all_bytes = (corners.len() + indices.len()) as u64;
        self.triangles.resize_with(self.triangles.len().max(slot + 1), || None);
        let buffer = match self.triangles[slot].take().filter(|b| b.size() >= all_bytes) {
            Some(buffer) => buffer,
            None => Buffer::new(&self.gpu, "triangles", MemoryKind::Upload, all_bytes.next_power_of_two())?,
        };
        buffer.write(0, corners);
        buffer.write(corners.len() as u64, indices);
        self.triangles[slot] = Some(buffer.clone());
        Ok(buffer)
    }
}

fn halves(address: u64) -> [u32; 2] {
    [address as u32, (address >> 32) as u32]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_colours_are_what_encoding_makes_of_them() {
        for code in 0..=255 {
            let encoded = code as f32 / 255.0;
            let again = crate::attribute::linear_to_srgb(linear(encoded));
            assert!((again - encoded).abs() < 1e-4, "{code}: {again}");
        }
    }
}
