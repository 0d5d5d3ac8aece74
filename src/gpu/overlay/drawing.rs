//! What is drawn onto one image of the window: textured triangles in order, as plain data.

use bytemuck::{Pod, Zeroable};

use crate::gpu::device::Gpu;
use crate::gpu::error::Result;
use crate::gpu::kinds::MemoryKind;
use crate::gpu::memory::Buffer;

/// A corner of a triangle; mirrors `Vertex` of `shaders/overlay.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct Corner {
    /// Points from the window's top left corner.
    pub at: [f32; 2],
    /// Of the texture, 0..1.
    pub uv: [f32; 2],
    /// sRGB-encoded, multiplied by alpha.
    pub color: [u8; 4],
}

/// An image that passes have written: sRGB bytes, a word a pixel.
pub struct TracedImage<'a> {
    /// The words, row by row.
    pub words: &'a Buffer,
    /// Pixels that it has.
    pub size: [u32; 2],
    /// Where in the window it is shown: left, top, width, height, in the window's pixels.
    pub place: [u32; 4],
}

/// Texels that triangles are filled with. Never written again: what changes gets a new one, so that frames in flight
/// read what they were recorded with.
pub struct Texture {
    size: [usize; 2],
    is_smooth: bool,
    buffer: Buffer,
}

impl Texture {
    /// Of `size` texels, row by row, sRGB-encoded and multiplied by alpha. `is_smooth`: they are interpolated; else
    /// the nearest is taken.
    pub fn new(gpu: &Gpu, size: [usize; 2], texels: &[[u8; 4]], is_smooth: bool) -> Result<Texture> {
        let bytes: &[u8] = bytemuck::cast_slice(texels);
        let buffer = Buffer::new(gpu, "texture", MemoryKind::Upload, bytes.len() as u64)?;
        buffer.write(0, bytes);
        Ok(Texture { size, is_smooth, buffer })
    }
}

/// Triangles of one texture within one rectangle.
pub(super) struct Draw {
    /// Left, top, right, bottom, pixels.
    pub clip: [f32; 4],
    pub texels: Buffer,
    pub size: [i32; 2],
    pub is_smooth: bool,
    /// How many of the drawing's it has.
    pub corners: usize,
    pub indices: usize,
}

/// Triangles over each other, the first lowest.
pub struct Drawing {
    pub(super) pixels_per_point: f32,
    pub(super) corners: Vec<Corner>,
    /// Each counts from the first corner of its draw.
    pub(super) indices: Vec<u32>,
    pub(super) draws: Vec<Draw>,
}

impl Drawing {
    /// An empty one.
    pub fn new(pixels_per_point: f32) -> Drawing {
        Drawing { pixels_per_point, corners: Vec::new(), indices: Vec::new(), draws: Vec::new() }
    }

    /// Adds what passes have drawn.
    pub fn traced_image(&mut self, TracedImage { words, size, place }: TracedImage<'_>) {
        let [left, top, width, height] = place.map(|v| v as f32 / self.pixels_per_point);
        let corner = |x, y| Corner { at: [left + x * width, top + y * height], uv: [x, y], color: [255; 4] };
        self.corners.extend([corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)]);
        self.indices.extend([0, 1, 2, 2, 1, 3]);
        self.draws.push(Draw {
            clip: [0.0, 0.0, f32::INFINITY, f32::INFINITY],
            texels: words.clone(),
            size: size.map(|pixels| pixels as i32),
            is_smooth: size != [place[2], place[3]],
            corners: 4,
            indices: 6,
        });
    }

    /// Adds triangles (three indices of `corners` each) within `clip`: left, top, right, bottom, pixels.
    pub fn triangles(
        &mut self,
        clip: [f32; 4],
        texture: &Texture,
        corners: impl IntoIterator<Item = Corner>,
        indices: &[u32],
    ) {
        let before = self.corners.len();
        self.corners.extend(corners);
        self.indices.extend(indices);
        self.draws.push(Draw {
            clip,
            texels: texture.buffer.clone(),
            size: texture.size.map(|texels| texels as i32),
            is_smooth: texture.is_smooth,
            corners: self.corners.len() - before,
            indices: indices.len(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::assert_in;
    use crate::gpu::shaders;

    #[test]
    fn shaders_see_corners_as_they_are_written() {
        assert_eq!(size_of::<Corner>(), 20);
        let corner = vec![(0, "f32x2".to_owned()), (8, "f32x2".to_owned()), (16, "u32".to_owned())];
        assert_in(&[("overlay.vert", shaders::OVERLAY_VERT)], &corner);
    }
}
