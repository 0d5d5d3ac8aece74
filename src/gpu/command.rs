//! Recording: copies, dispatches, and what they keep alive.

use std::any::Any;

use ash::vk;

use super::device::lock;
use super::order::Stage;
use super::timeline::Wait;
use super::{Binding, Buffer, ComputePipeline, Gpu, GpuError, QueueKind, Result};

/// One range of a copy, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferCopy {
    /// Where in the source.
    pub from: u64,
    /// Where in the destination.
    pub to: u64,
    /// How many bytes.
    pub size: u64,
}

/// A command buffer with the pool that it alone uses, so that resetting one never touches another.
pub(super) struct RawCommands {
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
}

impl RawCommands {
    fn new(gpu: &Gpu, queue: QueueKind) -> Result<RawCommands> {
        let device = gpu.device();
        let create = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(gpu.queue(queue).family);
        // SAFETY: the device is alive: `gpu` holds it.
        let pool = unsafe { device.create_command_pool(&create, None) }
            .map_err(|e| GpuError::vulkan("vkCreateCommandPool", e))?;
        let allocate = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: `pool` was just made and is used by this thread alone.
        match unsafe { device.allocate_command_buffers(&allocate) } {
            Ok(buffers) => Ok(RawCommands { pool, buffer: buffers[0] }),
            Err(e) => {
                // SAFETY: nothing was allocated from the pool.
                unsafe { device.destroy_command_pool(pool, None) };
                Err(GpuError::vulkan("vkAllocateCommandBuffers", e))
            }
        }
    }

    /// # Safety
    /// The device must be done with the command buffer, and it is not used afterwards.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: the caller's promise.
        unsafe { device.destroy_command_pool(self.pool, None) };
    }
}

/// Work being recorded for one queue; made by `Order::begin_…`, consumed by [`super::Order::submit`].
///
/// It holds a handle of every buffer, pipeline and binding given to it until the work is done. What
/// shaders reach by address alone is given by [`Commands::keep`].
pub struct Commands {
    gpu: Gpu,
    name: String,
    queue: QueueKind,
    pub(super) stage: Stage,
    /// What the submit waits for.
    pub(super) waits: Vec<Wait>,
    /// For a frame that is shown: the image is free, and it is drawn.
    pub(super) shown: Option<[vk::Semaphore; 2]>,
    raw: Option<RawCommands>,
    kept: Vec<Box<dyn Any + Send>>,
    layout: vk::PipelineLayout,
    push_bytes: u32,
}

impl Commands {
    pub(super) fn begin(gpu: &Gpu, queue: QueueKind, stage: Stage, name: &str) -> Result<Commands> {
        let idle = lock(&gpu.0.idle_commands)[queue as usize].pop();
        let raw = match idle {
            Some(raw) => raw,
            None => RawCommands::new(gpu, queue)?,
        };
        let commands = Commands {
            gpu: gpu.clone(),
            name: name.to_owned(),
            queue,
            stage,
            waits: Vec::new(),
            shown: None,
            raw: Some(raw),
            kept: Vec::new(),
            layout: vk::PipelineLayout::null(),
            push_bytes: 0,
        };
        gpu.name_object(commands.handle(), name);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the command buffer is fresh or its pool was reset when its last work was done.
        unsafe { gpu.device().begin_command_buffer(commands.handle(), &begin) }
            .map_err(|e| GpuError::vulkan(format!("vkBeginCommandBuffer for {name}"), e))?;
        Ok(commands)
    }

    /// The debug name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Keeps `thing` alive until this work is done.
    pub fn keep(&mut self, thing: impl Any + Send) {
        self.kept.push(Box::new(thing));
    }

    /// Copies ranges of `from` into `to`.
    ///
    /// # Panics
    /// When a range is outside its buffer.
    pub fn copy(&mut self, from: &Buffer, to: &Buffer, ranges: &[BufferCopy]) {
        if ranges.is_empty() {
            return;
        }
        let regions: Vec<_> = ranges
            .iter()
            .map(|r| {
                from.check(r.from, r.size);
                to.check(r.to, r.size);
                vk::BufferCopy { src_offset: r.from, dst_offset: r.to, size: r.size }
            })
            .collect();
        self.keep(from.clone());
        self.keep(to.clone());
        // SAFETY: the command buffer is being recorded; both buffers are kept until it is done.
        unsafe { self.gpu.device().cmd_copy_buffer(self.handle(), from.handle(), to.handle(), &regions) };
    }

    /// Chooses the program for the dispatches that follow.
    pub fn bind(&mut self, pipeline: &ComputePipeline) {
        self.keep(pipeline.clone());
        (self.layout, self.push_bytes) = (pipeline.layout(), pipeline.push_bytes());
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the command buffer is being recorded; the pipeline is kept until it is done.
        unsafe { self.gpu.device().cmd_bind_pipeline(self.handle(), point, pipeline.handle()) };
    }

    /// Gives the bound program its storage buffers.
    pub fn bind_buffers(&mut self, binding: &Binding) {
        self.keep(binding.clone());
        // SAFETY: the command buffer is being recorded; the set is kept until it is done, was made for
        // a pipeline of the same layout, and is never written again.
        unsafe {
            self.gpu.device().cmd_bind_descriptor_sets(
                self.handle(),
                vk::PipelineBindPoint::COMPUTE,
                self.layout,
                0,
                &[binding.set()],
                &[],
            );
        }
    }

    /// Sets the push constants of the bound program, all of them.
    ///
    /// # Panics
    /// When `bytes` is not what the program declares.
    pub fn push(&mut self, bytes: &[u8]) {
        assert_eq!(bytes.len(), self.push_bytes as usize, "push constants of {}", self.name);
        let stage = vk::ShaderStageFlags::COMPUTE;
        // SAFETY: the command buffer is being recorded; the layout is that of the bound pipeline, which
        // is kept; the size was checked against it.
        unsafe { self.gpu.device().cmd_push_constants(self.handle(), self.layout, stage, 0, bytes) };
    }

    /// Runs the bound program on `groups` workgroups.
    pub fn dispatch(&mut self, groups: [u32; 3]) {
        let [x, y, z] = groups;
        // SAFETY: the command buffer is being recorded, and what the program reaches is kept.
        unsafe { self.gpu.device().cmd_dispatch(self.handle(), x, y, z) };
    }

    pub(super) fn barrier(&mut self, barrier: vk::MemoryBarrier2<'_>) {
        self.barriers(&[barrier], &[]);
    }

    pub(super) fn barriers(
        &mut self,
        barriers: &[vk::MemoryBarrier2<'_>],
        images: &[vk::ImageMemoryBarrier2<'_>],
    ) {
        let dependency =
            vk::DependencyInfo::default().memory_barriers(barriers).image_memory_barriers(images);
        // SAFETY: the command buffer is being recorded; a global barrier names no object, and images are a
        // swapchain's, which waits for the device before it goes.
        unsafe { self.gpu.device().cmd_pipeline_barrier2(self.handle(), &dependency) };
    }

    pub(super) fn timestamp(&mut self, pool: vk::QueryPool, query: u32) {
        // SAFETY: the command buffer is being recorded; the caller keeps `pool` and has reset `query`.
        unsafe {
            let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
            self.gpu.device().cmd_write_timestamp2(self.handle(), stage, pool, query);
        }
    }

    pub(super) fn end(&mut self) -> Result<vk::CommandBuffer> {
        // SAFETY: the command buffer is being recorded.
        unsafe { self.gpu.device().end_command_buffer(self.handle()) }
            .map_err(|e| GpuError::vulkan(format!("vkEndCommandBuffer of {}", self.name), e))?;
        Ok(self.handle())
    }

    /// The queue that it is for.
    pub fn queue(&self) -> QueueKind {
        self.queue
    }

    #[cfg(feature = "view")]
    pub(super) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    pub(super) fn handle(&self) -> vk::CommandBuffer {
        self.raw.as_ref().expect("taken only by Drop").buffer
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        // Never submitted, or retired and reached: either way the device does not use it.
        let Some(raw) = self.raw.take() else { return };
        // SAFETY: see above; resetting the pool ends recording too.
        let reset =
            unsafe { self.gpu.device().reset_command_pool(raw.pool, vk::CommandPoolResetFlags::empty()) };
        match reset {
            Ok(()) => lock(&self.gpu.0.idle_commands)[self.queue as usize].push(raw),
            // SAFETY: as above.
            Err(_) => unsafe { raw.destroy(self.gpu.device()) },
        }
    }
}
