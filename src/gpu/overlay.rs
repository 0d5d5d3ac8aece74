//! Drawing onto the window's image: the traced picture, and the toolkit's triangles over it.
//!
//! Vertices and textures are buffers that shaders reach by address: there are no images but the window's own.

use std::collections::HashMap;
use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};
use egui::epaint::{ClippedPrimitive, ImageData, ImageDelta, Primitive, Vertex};
use egui::{TextureFilter, TextureId};

use super::acquired::Acquired;
use super::command::Commands;
use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::MemoryKind;
use super::memory::Buffer;
use super::shaders;
use super::swapchain::Swapchain;

/// Behind everything, encoded: what is left free of the picture.
const BACKDROP: [f32; 4] = [0.09, 0.10, 0.11, 1.0];

/// An encoded colour's linear value; `linear_of` of `shaders/overlay.frag` is the same.
fn linear(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Mirrors the push constants of `shaders/overlay.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    vertices: [u32; 2],
    indices: [u32; 2],
    texels: [u32; 2],
    size: [i32; 2],
    to_clip: [f32; 2],
    is_smooth: u32,
}

/// Mirrors `Vertex` there; egui's has the same fields in the same order.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Corner {
    at: [f32; 2],
    uv: [f32; 2],
    color: [u8; 4],
}

impl Corner {
    fn of(v: &Vertex) -> Corner {
        Corner { at: [v.pos.x, v.pos.y], uv: [v.uv.x, v.uv.y], color: v.color.to_array() }
    }
}

/// A picture that passes have written: sRGB bytes, a word a pixel.
pub struct Picture<'a> {
    /// The words, row by row.
    pub words: &'a Buffer,
    /// Pixels that it has.
    pub size: [u32; 2],
    /// Where in the window it is shown: left, top, width, height, in the window's pixels.
    pub place: [u32; 4],
}

struct Texture {
    size: [usize; 2],
    pixels: Vec<[u8; 4]>,
    is_smooth: bool,
    buffer: Buffer,
}

/// Draws on images of one format.
pub struct Overlay {
    gpu: Gpu,
    program: Arc<Program>,
    textures: HashMap<TextureId, Texture>,
    /// Vertices and indices, for every frame in flight.
    meshes: Vec<Option<Buffer>>,
}

impl Overlay {
    /// For the images of `swapchain`.
    pub fn new(gpu: &Gpu, swapchain: &Swapchain) -> Result<Overlay> {
        let program = Arc::new(Program::new(gpu, swapchain.format(), swapchain.is_linear())?);
        Ok(Overlay { gpu: gpu.clone(), program, textures: HashMap::new(), meshes: Vec::new() })
    }

    /// Takes what the toolkit changed of its textures. A changed one gets a new buffer: frames in flight read the
    /// old one, and changes are rare and small.
    pub fn change_textures<Changes: IntoIterator<Item = ImageDelta>>(
        &mut self,
        set: impl IntoIterator<Item = (TextureId, Changes)>,
    ) -> Result<()> {
        for (id, changes) in set {
            for change in changes {
                let ImageData::Color(image) = &change.image;
                let is_smooth = change.options.magnification == TextureFilter::Linear;
                let new = || image.pixels.iter().map(|c| c.to_array());
                let (size, pixels) = match (change.pos, self.textures.remove(&id)) {
                    (Some([left, top]), Some(mut old)) => {
                        let mut new = new();
                        for row in top..top + image.size[1] {
                            let from = row * old.size[0] + left;
                            old.pixels[from..from + image.size[0]].iter_mut().for_each(|p| {
                                *p = new.next().expect("as many as its size says");
                            });
                        }
                        (old.size, old.pixels)
                    }
                    _ => (image.size, new().collect()),
                };
                let bytes: &[u8] = bytemuck::cast_slice(&pixels);
                let buffer = Buffer::new(&self.gpu, "texture", MemoryKind::Upload, bytes.len() as u64)?;
                buffer.write(0, bytes);
                self.textures.insert(id, Texture { size, pixels, is_smooth, buffer });
            }
        }
        Ok(())
    }

    /// Forgets textures once they are drawn for the last time.
    pub fn free_textures(&mut self, free: impl IntoIterator<Item = TextureId>) {
        free.into_iter().for_each(|id| drop(self.textures.remove(&id)));
    }

    /// Draws inside [`super::Order::draw`], in frame `slot`.
    pub fn paint(
        &mut self,
        commands: &mut Commands,
        slot: usize,
        image: &Acquired,
        picture: Option<Picture>,
        (pixels_per_point, primitives): (f32, &[ClippedPrimitive]),
    ) -> Result<()> {
        let (mut corners, mut indices) = (Vec::new(), Vec::new());
        if let Some(Picture { place, .. }) = &picture {
            let [left, top, width, height] = place.map(|v| v as f32 / pixels_per_point);
            let corner =
                |x, y| Corner { at: [left + x * width, top + y * height], uv: [x, y], color: [255; 4] };
            corners.extend([corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)]);
            indices.extend([0u32, 1, 2, 2, 1, 3]);
        }
        for primitive in primitives {
            if let Primitive::Mesh(mesh) = &primitive.primitive {
                corners.extend(mesh.vertices.iter().map(Corner::of));
                indices.extend(&mesh.indices);
            }
        }
        let parts: [&[u8]; 2] = [bytemuck::cast_slice(&corners), bytemuck::cast_slice(&indices)];
        let [corner_bytes, all_bytes] = [parts[0].len() as u64, (parts[0].len() + parts[1].len()) as u64];
        self.meshes.resize_with(self.meshes.len().max(slot + 1), || None);
        let meshes = match self.meshes[slot].take().filter(|b| b.size() >= all_bytes) {
            Some(buffer) => buffer,
            None => Buffer::new(&self.gpu, "triangles", MemoryKind::Upload, all_bytes.next_power_of_two())?,
        };
        meshes.write(0, parts[0]);
        meshes.write(corner_bytes, parts[1]);
        commands.keep(meshes.clone());
        self.meshes[slot] = Some(meshes.clone());

        let target = image.size();
        let backdrop = match image.is_linear {
            true => [linear(BACKDROP[0]), linear(BACKDROP[1]), linear(BACKDROP[2]), BACKDROP[3]],
            false => BACKDROP,
        };
        commands.rendering(image, backdrop, |commands| {
            commands.bind_drawing(&self.program);
            let to_clip = target.map(|pixels| 2.0 * pixels_per_point / pixels as f32);
            let (mut vertices, mut first) = (meshes.address(), meshes.address() + corner_bytes);
            let mut draw =
                |commands: &mut Commands, texels: &Buffer, size: [i32; 2], is_smooth, counts: [usize; 2]| {
                    let push = Push {
                        vertices: halves(vertices),
                        indices: halves(first),
                        texels: halves(texels.address()),
                        size,
                        to_clip,
                        is_smooth: u32::from(is_smooth),
                    };
                    commands.keep(texels.clone());
                    commands.draw(&self.program, bytemuck::bytes_of(&push), counts[1] as u32);
                    vertices += (counts[0] * size_of::<Corner>()) as u64;
                    first += (counts[1] * size_of::<u32>()) as u64;
                };
            if let Some(Picture { words, size, place }) = picture {
                commands.clip([0, 0, target[0], target[1]]);
                let is_smooth = size != [place[2], place[3]];
                draw(commands, words, size.map(|pixels| pixels as i32), is_smooth, [4, 6]);
            }
            for primitive in primitives {
                let Primitive::Mesh(mesh) = &primitive.primitive else { continue };
                let Some(texture) = self.textures.get(&mesh.texture_id) else {
                    unreachable!("the toolkit sends a texture before it draws with it");
                };
                let clip = primitive.clip_rect * pixels_per_point;
                let side = |value: f32, most: u32| (value.round().max(0.0) as u32).min(most);
                let [left, top] = [side(clip.min.x, target[0]), side(clip.min.y, target[1])];
                let [right, bottom] = [side(clip.max.x, target[0]), side(clip.max.y, target[1])];
                commands.clip([left, top, right.saturating_sub(left), bottom.saturating_sub(top)]);
                let size = texture.size.map(|pixels| pixels as i32);
                draw(
                    commands,
                    &texture.buffer,
                    size,
                    texture.is_smooth,
                    [mesh.vertices.len(), mesh.indices.len()],
                );
            }
        });
        Ok(())
    }
}

fn halves(address: u64) -> [u32; 2] {
    [address as u32, (address >> 32) as u32]
}

/// The program that draws triangles.
struct Program {
    gpu: Gpu,
    layout: vk::PipelineLayout,
    handle: vk::Pipeline,
}

const STAGES: vk::ShaderStageFlags = vk::ShaderStageFlags::from_raw(
    vk::ShaderStageFlags::VERTEX.as_raw() | vk::ShaderStageFlags::FRAGMENT.as_raw(),
);

impl Program {
    /// `linear`: what is written in `format` is linear.
    fn new(gpu: &Gpu, format: vk::Format, linear: bool) -> Result<Program> {
        let device = gpu.device();
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} for the overlay"), e);
        let range =
            [vk::PushConstantRange { stage_flags: STAGES, offset: 0, size: size_of::<Push>() as u32 }];
        let create = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&range);
        // SAFETY: the device is alive: `gpu` holds it.
        let layout = unsafe { device.create_pipeline_layout(&create, None) }
            .map_err(|e| failed("vkCreatePipelineLayout", e))?;
        // From here on Drop gives back what there is.
        let mut program = Program { gpu: gpu.clone(), layout, handle: vk::Pipeline::null() };
        let module = |words: &[u32]| {
            // SAFETY: the words are what the shader compiler wrote.
            unsafe { device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(words), None) }
                .map_err(|e| failed("vkCreateShaderModule", e))
        };
        let vertex = module(shaders::OVERLAY_VERT)?;
        let fragment = module(shaders::OVERLAY_FRAG);
        let made = fragment.and_then(|fragment| {
            let stage = |stage, module| {
                vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module).name(c"main")
            };
            let entries =
                [vk::SpecializationMapEntry { constant_id: 0, offset: 0, size: size_of::<vk::Bool32>() }];
            let constants = vk::Bool32::from(linear).to_ne_bytes();
            let constants = vk::SpecializationInfo::default().map_entries(&entries).data(&constants);
            let stages = [
                stage(vk::ShaderStageFlags::VERTEX, vertex),
                stage(vk::ShaderStageFlags::FRAGMENT, fragment).specialization_info(&constants),
            ];
            let input = vk::PipelineVertexInputStateCreateInfo::default();
            let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
                .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
            let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
            let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
            let samples = vk::PipelineMultisampleStateCreateInfo::default()
                .rasterization_samples(vk::SampleCountFlags::TYPE_1);
            let blend = [vk::PipelineColorBlendAttachmentState::default()
                .color_write_mask(vk::ColorComponentFlags::RGBA)
                .blend_enable(true)
                .src_color_blend_factor(vk::BlendFactor::ONE)
                .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
                .src_alpha_blend_factor(vk::BlendFactor::ONE)
                .dst_alpha_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)];
            let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blend);
            let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
            let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
            let formats = [format];
            let mut rendering = vk::PipelineRenderingCreateInfo::default().color_attachment_formats(&formats);
            let create = [vk::GraphicsPipelineCreateInfo::default()
                .stages(&stages)
                .vertex_input_state(&input)
                .input_assembly_state(&assembly)
                .viewport_state(&viewport)
                .rasterization_state(&raster)
                .multisample_state(&samples)
                .color_blend_state(&blend)
                .dynamic_state(&dynamic)
                .layout(layout)
                .push_next(&mut rendering)];
            // SAFETY: every pointer in `create` is alive in this scope; the module is not used afterwards.
            unsafe {
                let made = device.create_graphics_pipelines(gpu.0.pipeline_cache.handle(), &create, None);
                device.destroy_shader_module(fragment, None);
                made.map_err(|(_, e)| failed("vkCreateGraphicsPipelines", e))
            }
        });
        // SAFETY: no pipeline is being made from it any more.
        unsafe { device.destroy_shader_module(vertex, None) };
        program.handle = made?[0];
        gpu.name_object(program.handle, "overlay");
        Ok(program)
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let device = self.gpu.device();
        // SAFETY: this is the last handle; work in flight holds one of its own. Null handles are allowed.
        unsafe {
            device.destroy_pipeline(self.handle, None);
            device.destroy_pipeline_layout(self.layout, None);
        }
    }
}

impl Commands {
    fn bind_drawing(&mut self, program: &Arc<Program>) {
        self.keep(program.clone());
        let point = vk::PipelineBindPoint::GRAPHICS;
        // SAFETY: the command buffer is being recorded; the program is kept until it is done.
        unsafe { self.gpu().device().cmd_bind_pipeline(self.handle(), point, program.handle) };
    }

    /// Draws within `[left, top, width, height]` alone, inside the image.
    fn clip(&mut self, [left, top, width, height]: [u32; 4]) {
        let offset = vk::Offset2D { x: left as i32, y: top as i32 };
        let scissor = vk::Rect2D { offset, extent: vk::Extent2D { width, height } };
        // SAFETY: the command buffer is being recorded.
        unsafe { self.gpu().device().cmd_set_scissor(self.handle(), 0, &[scissor]) };
    }

    /// Draws `indices` corners of triangles.
    fn draw(&mut self, program: &Program, push: &[u8], indices: u32) {
        let device = self.gpu().device();
        // SAFETY: the command buffer is being recorded, the program is bound, and what it reaches by address is
        // kept by the caller.
        unsafe {
            device.cmd_push_constants(self.handle(), program.layout, STAGES, 0, push);
            device.cmd_draw(self.handle(), indices, 1, 0, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{assert_in, members};

    #[test]
    fn linear_colours_are_what_encoding_makes_of_them() {
        for code in 0..=255 {
            let encoded = code as f32 / 255.0;
            let again = crate::attribute::linear_to_srgb(linear(encoded));
            assert!((again - encoded).abs() < 1e-4, "{code}: {again}");
        }
    }

    #[test]
    fn shaders_see_corners_and_constants_as_they_are_written() {
        let both = [("overlay.vert", shaders::OVERLAY_VERT)];
        let push = members!(Push { vertices, indices, texels, size, to_clip, is_smooth });
        // Addresses are two words here and one pointer there.
        let offsets: Vec<u32> = push.iter().map(|(offset, _)| *offset).collect();
        assert_eq!(offsets, [0, 8, 16, 24, 32, 40]);
        assert_eq!(size_of::<Push>(), 44);
        assert_eq!(size_of::<Corner>(), 20);
        let corner = vec![(0, "f32x2".to_owned()), (8, "f32x2".to_owned()), (16, "u32".to_owned())];
        assert_in(&both, &corner);
    }
}
