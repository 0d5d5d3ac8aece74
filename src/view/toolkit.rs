//! What the toolkit draws, as textures and triangles of [`crate::gpu`].

use std::collections::HashMap;

use egui::epaint::{ClippedPrimitive, ImageData, ImageDelta, Primitive, Vertex};
use egui::{TextureFilter, TextureId};

use crate::gpu::{Corner, Drawing, Gpu, GpuError, Texture};

/// The toolkit's textures: what each is now, on the host and on the device.
pub(super) struct Textures {
    gpu: Gpu,
    known: HashMap<TextureId, Known>,
}

struct Known {
    size: [usize; 2],
    texels: Vec<[u8; 4]>,
    texture: Texture,
}

impl Textures {
    pub fn new(gpu: &Gpu) -> Textures {
        Textures { gpu: gpu.clone(), known: HashMap::new() }
    }

    /// Takes what the toolkit changed. A changed texture is a new one on the device: changes are rare and small.
    pub fn change<Changes: IntoIterator<Item = ImageDelta>>(
        &mut self,
        set: impl IntoIterator<Item = (TextureId, Changes)>,
    ) -> Result<(), GpuError> {
        for (id, changes) in set {
            for change in changes {
                let ImageData::Color(image) = &change.image;
                let is_smooth = change.options.magnification == TextureFilter::Linear;
                let new = || image.pixels.iter().map(|c| c.to_array());
                let (size, texels) = match (change.pos, self.known.remove(&id)) {
                    (Some([left, top]), Some(mut old)) => {
                        let mut new = new();
                        for row in top..top + image.size[1] {
                            let from = row * old.size[0] + left;
                            old.texels[from..from + image.size[0]].iter_mut().for_each(|texel| {
                                *texel = new.next().expect("as many as its size says");
                            });
                        }
                        (old.size, old.texels)
                    }
                    _ => (image.size, new().collect()),
                };
                let texture = Texture::new(&self.gpu, size, &texels, is_smooth)?;
                self.known.insert(id, Known { size, texels, texture });
            }
        }
        Ok(())
    }

    /// Forgets textures once they are drawn for the last time.
    pub fn free(&mut self, free: impl IntoIterator<Item = TextureId>) {
        free.into_iter().for_each(|id| drop(self.known.remove(&id)));
    }

    /// Adds the toolkit's triangles to `drawing`.
    pub fn draw(&self, drawing: &mut Drawing, pixels_per_point: f32, primitives: &[ClippedPrimitive]) {
        for primitive in primitives {
            let Primitive::Mesh(mesh) = &primitive.primitive else { continue };
            let Some(Known { texture, .. }) = self.known.get(&mesh.texture_id) else {
                unreachable!("the toolkit sends a texture before it draws with it");
            };
            let clip = primitive.clip_rect * pixels_per_point;
            let clip = [clip.min.x, clip.min.y, clip.max.x, clip.max.y];
            drawing.triangles(clip, texture, mesh.vertices.iter().map(corner), &mesh.indices);
        }
    }
}

fn corner(v: &Vertex) -> Corner {
    Corner { at: [v.pos.x, v.pos.y], uv: [v.uv.x, v.uv.y], color: v.color.to_array() }
}
