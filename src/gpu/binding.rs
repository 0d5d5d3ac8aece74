//! Descriptor sets: which buffers the bindings of a pipeline are.

use std::sync::Arc;

use ash::vk;

use super::error::{GpuError, Result};
use super::kinds::BindingKind;
use super::memory::Buffer;
use super::pipeline::ComputePipeline;

impl ComputePipeline {
    /// Ties `buffers` to bindings 0, 1, ... of this pipeline, whole.
    ///
    /// # Panics
    /// When there are not as many as the pipeline declares.
    pub fn binding(&self, buffers: &[&Buffer]) -> Result<Binding> {
        let pipeline = &self.0;
        assert_eq!(buffers.len(), pipeline.bindings.len(), "buffers of {}", pipeline.name);
        let device = pipeline.gpu.device();
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} for {}", pipeline.name), e);
        let sizes: Vec<_> = pipeline
            .bindings
            .iter()
            .map(|kind| vk::DescriptorPoolSize { ty: kind.descriptor(), descriptor_count: 1 })
            .collect();
        let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the device is alive: the pipeline holds it.
        let pool = unsafe { device.create_descriptor_pool(&create, None) }
            .map_err(|e| failed("vkCreateDescriptorPool", e))?;
        let buffers: Vec<Buffer> = buffers.iter().map(|&b| b.clone()).collect();
        let mut set = BoundSet {
            pool,
            set: vk::DescriptorSet::null(),
            pipeline: self.clone(),
            buffers,
            views: Vec::new(),
        };
        let layouts = [pipeline.set_layout];
        let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are alive and used by this thread alone.
        set.set = unsafe { device.allocate_descriptor_sets(&allocate) }
            .map_err(|e| failed("vkAllocateDescriptorSets", e))?[0];
        let infos: Vec<_> = set
            .buffers
            .iter()
            .map(|b| [vk::DescriptorBufferInfo { buffer: b.handle(), offset: 0, range: vk::WHOLE_SIZE }])
            .collect();
        for (buffer, kind) in set.buffers.iter().zip(&pipeline.bindings) {
            let mut view = vk::BufferView::null();
            if *kind == BindingKind::Texels {
                let create = vk::BufferViewCreateInfo::default()
                    .buffer(buffer.handle())
                    .format(vk::Format::R32_UINT)
                    .range(vk::WHOLE_SIZE);
                // SAFETY: the buffer is alive and was made for such views.
                view = unsafe { device.create_buffer_view(&create, None) }
                    .map_err(|e| failed("vkCreateBufferView", e))?;
            }
            set.views.push([view]);
        }
        let writes: Vec<_> = (0u32..)
            .zip(infos.iter().zip(&pipeline.bindings).zip(&set.views))
            .map(|(i, ((info, kind), view))| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set.set)
                    .dst_binding(i)
                    .descriptor_type(kind.descriptor())
                    .buffer_info(info)
                    .texel_buffer_view(view)
            })
            .collect();
        // SAFETY: the set is new, so no work uses it; the buffers live as long as the set.
        unsafe { device.update_descriptor_sets(&writes, &[]) };
        Ok(Binding(Arc::new(set)))
    }
}

/// Buffers tied to a pipeline; holds the buffers. A clone is another handle.
#[derive(Clone)]
pub struct Binding(Arc<BoundSet>);

impl PartialEq for Binding {
    /// Whether both are the same descriptor set.
    fn eq(&self, other: &Binding) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

struct BoundSet {
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    pipeline: ComputePipeline,
    buffers: Vec<Buffer>,
    /// Of the buffers that are seen as texels; null for others.
    views: Vec<[vk::BufferView; 1]>,
}

/// Bindings of the passes of one frame in flight, for the next time. A set is never written again, so it serves as
/// long as pipeline and buffers are the same.
#[derive(Default)]
pub struct BindingCache {
    now: Vec<Binding>,
    before: Vec<Binding>,
}

impl BindingCache {
    /// A frame begins. What the last one did not use is dropped, and so are its buffers.
    pub fn begin(&mut self) {
        self.before = std::mem::take(&mut self.now);
    }

    /// [`ComputePipeline::binding`], made where this frame or the last one had none.
    pub fn get(&mut self, pipeline: &ComputePipeline, buffers: &[&Buffer]) -> Result<Binding> {
        let known = self.now.iter().chain(&self.before).find(|binding| binding.ties(pipeline, buffers));
        let binding = match known {
            Some(binding) => binding.clone(),
            None => pipeline.binding(buffers)?,
        };
        self.now.push(binding.clone());
        Ok(binding)
    }
}

impl Binding {
    /// Whether it ties these buffers to this pipeline.
    fn ties(&self, pipeline: &ComputePipeline, buffers: &[&Buffer]) -> bool {
        let BoundSet { pipeline: tied, buffers: own, .. } = &*self.0;
        let same = |(a, b): (&Buffer, &&Buffer)| a.is(b);
        Arc::ptr_eq(&tied.0, &pipeline.0) && own.len() == buffers.len() && own.iter().zip(buffers).all(same)
    }

    pub(super) fn set(&self) -> vk::DescriptorSet {
        self.0.set
    }
}

impl Drop for BoundSet {
    fn drop(&mut self) {
        let device = self.pipeline.0.gpu.device();
        // SAFETY: this is the last handle; work in flight holds one of its own. Null handles are allowed.
        unsafe {
            device.destroy_descriptor_pool(self.pool, None);
            self.views.iter().flatten().for_each(|view| device.destroy_buffer_view(*view, None));
        }
    }
}
