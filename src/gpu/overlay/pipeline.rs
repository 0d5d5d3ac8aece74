//! The graphics pipeline that draws textured triangles, and the commands that use it.

use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};

use crate::gpu::command::Commands;
use crate::gpu::device::Gpu;
use crate::gpu::error::{GpuError, Result};
use crate::gpu::shaders;

/// Mirrors the push constants of `shaders/overlay.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct Push {
    pub vertices: [u32; 2],
    pub indices: [u32; 2],
    pub texels: [u32; 2],
    pub size: [i32; 2],
    pub to_clip: [f32; 2],
    pub is_smooth: u32,
}

/// The pipeline that draws triangles into images of one format.
pub(super) struct TrianglePipeline {
    gpu: Gpu,
    layout: vk::PipelineLayout,
    handle: vk::Pipeline,
}

const STAGES: vk::ShaderStageFlags = vk::ShaderStageFlags::from_raw(
    vk::ShaderStageFlags::VERTEX.as_raw() | vk::ShaderStageFlags::FRAGMENT.as_raw(),
);

impl TrianglePipeline {
    /// `linear`: what is written in `format` is linear.
    pub fn new(gpu: &Gpu, format: vk::Format, linear: bool) -> Result<TrianglePipeline> {
        let device = gpu.device();
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} for the overlay"), e);
        let range =
            [vk::PushConstantRange { stage_flags: STAGES, offset: 0, size: size_of::<Push>() as u32 }];
        let create = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&range);
        // SAFETY: the device is alive: `gpu` holds it.
        let layout = unsafe { device.create_pipeline_layout(&create, None) }
            .map_err(|e| failed("vkCreatePipelineLayout", e))?;
        // From here on Drop gives back what there is.
        let mut pipeline = TrianglePipeline { gpu: gpu.clone(), layout, handle: vk::Pipeline::null() };
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
        pipeline.handle = made?[0];
        gpu.name_object(pipeline.handle, "overlay");
        Ok(pipeline)
    }
}

impl Drop for TrianglePipeline {
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
    /// Chooses the pipeline of the triangles that follow.
    pub(super) fn bind_triangles(&mut self, pipeline: &Arc<TrianglePipeline>) {
        self.keep(pipeline.clone());
        let point = vk::PipelineBindPoint::GRAPHICS;
        // SAFETY: the command buffer is being recorded; the pipeline is kept until it is done.
        unsafe { self.gpu().device().cmd_bind_pipeline(self.handle(), point, pipeline.handle) };
    }

    /// Draws within `[left, top, width, height]` alone, inside the image.
    pub(super) fn clip(&mut self, [left, top, width, height]: [u32; 4]) {
        let offset = vk::Offset2D { x: left as i32, y: top as i32 };
        let scissor = vk::Rect2D { offset, extent: vk::Extent2D { width, height } };
        // SAFETY: the command buffer is being recorded.
        unsafe { self.gpu().device().cmd_set_scissor(self.handle(), 0, &[scissor]) };
    }

    /// Draws `indices` corners of triangles.
    pub(super) fn draw(&mut self, pipeline: &TrianglePipeline, push: &Push, indices: u32) {
        let device = self.gpu().device();
        // SAFETY: the command buffer is being recorded, the pipeline is bound, and what it reaches by address is
        // kept by the caller.
        unsafe {
            device.cmd_push_constants(self.handle(), pipeline.layout, STAGES, 0, bytemuck::bytes_of(push));
            device.cmd_draw(self.handle(), indices, 1, 0, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::members;

    #[test]
    fn shaders_see_constants_as_they_are_written() {
        let push = members!(Push { vertices, indices, texels, size, to_clip, is_smooth });
        // Addresses are two words here and one pointer there.
        let offsets: Vec<u32> = push.iter().map(|(offset, _)| *offset).collect();
        assert_eq!(offsets, [0, 8, 16, 24, 32, 40]);
        assert_eq!(size_of::<Push>(), 44);
    }
}
