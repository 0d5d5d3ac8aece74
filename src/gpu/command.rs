//! Recording: copies, dispatches, drawing, and what they keep alive.

use std::any::Any;
use std::mem;
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

#[cfg(feature = "view")]
use super::acquired::Acquired;
use super::binding::Binding;
use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::QueueKind;
use super::lock::lock;
use super::memory::Buffer;
use super::pipeline::ComputePipeline;
use super::sync::{Stage, Wait};

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
struct RawCommands {
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
    unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: the caller's promise.
        unsafe { device.destroy_command_pool(self.pool, None) };
    }
}

/// Command buffers whose work is done, by queue, to be recorded again. Those in use hold a handle of it.
pub(super) struct IdleCommands {
    gpu: Gpu,
    idle: Mutex<[Vec<RawCommands>; 2]>,
}

impl IdleCommands {
    pub fn new(gpu: &Gpu) -> Arc<IdleCommands> {
        Arc::new(IdleCommands { gpu: gpu.clone(), idle: Mutex::default() })
    }

    fn take(&self, queue: QueueKind) -> Result<RawCommands> {
        let idle = lock(&self.idle)[queue as usize].pop();
        idle.map_or_else(|| RawCommands::new(&self.gpu, queue), Ok)
    }
}

impl Drop for IdleCommands {
    fn drop(&mut self) {
        for raw in mem::take(self.idle.get_mut().unwrap_or_else(PoisonError::into_inner)).iter().flatten() {
            // SAFETY: what lies here was never submitted or is done, and was reset; this is the last handle.
            unsafe { raw.destroy(self.gpu.device()) };
        }
    }
}

/// Work being recorded for one queue; made by `Order::begin_…`, consumed by [`super::Order::submit`].
///
/// It holds a handle of every buffer, pipeline and binding given to it until the work is done. What
/// shaders reach by address alone is given by [`Commands::keep`].
pub struct Commands {
    idle: Arc<IdleCommands>,
    name: String,
    queue: QueueKind,
    pub(super) stage: Stage,
    /// What the submit waits for.
    pub(super) waits: Vec<Wait>,
    /// For a frame that is shown: the image is free, and it is drawn.
    pub(super) shown: Option<[vk::Semaphore; 2]>,
    /// Taken by Drop alone.
    raw: Option<RawCommands>,
    kept: Vec<Box<dyn Any + Send>>,
    layout: vk::PipelineLayout,
    push_bytes: u32,
}

impl Commands {
    pub(super) fn begin(
        idle: &Arc<IdleCommands>,
        queue: QueueKind,
        stage: Stage,
        name: &str,
    ) -> Result<Commands> {
        let commands = Commands {
            idle: idle.clone(),
            name: name.to_owned(),
            queue,
            stage,
            waits: Vec::new(),
            shown: None,
            raw: Some(idle.take(queue)?),
            kept: Vec::new(),
            layout: vk::PipelineLayout::null(),
            push_bytes: 0,
        };
        let gpu = &idle.gpu;
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
        unsafe { self.gpu().device().cmd_copy_buffer(self.handle(), from.handle(), to.handle(), &regions) };
    }

    /// Chooses the pipeline of the dispatches that follow.
    pub fn bind(&mut self, pipeline: &ComputePipeline) {
        self.keep(pipeline.clone());
        (self.layout, self.push_bytes) = (pipeline.layout(), pipeline.push_bytes());
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the command buffer is being recorded; the pipeline is kept until it is done.
        unsafe { self.gpu().device().cmd_bind_pipeline(self.handle(), point, pipeline.handle()) };
    }

    /// Gives the bound pipeline its buffers.
    pub fn bind_buffers(&mut self, binding: &Binding) {
        self.keep(binding.clone());
        // SAFETY: the command buffer is being recorded; the set is kept until it is done, was made for
        // a pipeline of the same layout, and is never written again.
        unsafe {
            self.gpu().device().cmd_bind_descriptor_sets(
                self.handle(),
                vk::PipelineBindPoint::COMPUTE,
                self.layout,
                0,
                &[binding.set()],
                &[],
            );
        }
    }

    /// Sets the push constants of the bound pipeline, all of them.
    ///
    /// # Panics
    /// When `bytes` is not what the pipeline declares.
    pub fn push(&mut self, bytes: &[u8]) {
        assert_eq!(bytes.len(), self.push_bytes as usize, "push constants of {}", self.name);
        let stage = vk::ShaderStageFlags::COMPUTE;
        // SAFETY: the command buffer is being recorded; the layout is that of the bound pipeline, which
        // is kept; the size was checked against it.
        unsafe { self.gpu().device().cmd_push_constants(self.handle(), self.layout, stage, 0, bytes) };
    }

    /// Runs the bound pipeline on `groups` workgroups.
    pub fn dispatch(&mut self, groups: [u32; 3]) {
        let [x, y, z] = groups;
        // SAFETY: the command buffer is being recorded, and what the shader reaches is kept.
        unsafe { self.gpu().device().cmd_dispatch(self.handle(), x, y, z) };
    }

    /// Runs `paint` between the start and the end of drawing on `image`, all of which is `backdrop` before.
    #[cfg(feature = "view")]
    pub(super) fn rendering<R>(
        &mut self,
        image: &Acquired,
        backdrop: [f32; 4],
        paint: impl FnOnce(&mut Commands) -> R,
    ) -> R {
        let [width, height] = image.size;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
        let clear = vk::ClearValue { color: vk::ClearColorValue { float32: backdrop } };
        let attachments = [vk::RenderingAttachmentInfo::default()
            .image_view(image.view)
            .image_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(clear)];
        let rendering =
            vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&attachments);
        let viewport = vk::Viewport {
            width: width as f32,
            height: height as f32,
            max_depth: 1.0,
            ..vk::Viewport::default()
        };
        let (device, buffer) = (self.gpu().device().clone(), self.handle());
        // SAFETY: the command buffer is being recorded; the image is the swapchain's, which waits for the device
        // before it goes.
        unsafe {
            device.cmd_begin_rendering(buffer, &rendering);
            device.cmd_set_viewport(buffer, 0, &[viewport]);
        }
        let painted = paint(self);
        // SAFETY: begun above.
        unsafe { device.cmd_end_rendering(buffer) };
        painted
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
        unsafe { self.gpu().device().cmd_pipeline_barrier2(self.handle(), &dependency) };
    }

    pub(super) fn timestamp(&mut self, pool: vk::QueryPool, query: u32) {
        // SAFETY: the command buffer is being recorded; the caller keeps `pool` and has reset `query`.
        unsafe {
            let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
            self.gpu().device().cmd_write_timestamp2(self.handle(), stage, pool, query);
        }
    }

    pub(super) fn end(&mut self) -> Result<vk::CommandBuffer> {
        // SAFETY: the command buffer is being recorded.
        unsafe { self.gpu().device().end_command_buffer(self.handle()) }
            .map_err(|e| GpuError::vulkan(format!("vkEndCommandBuffer of {}", self.name), e))?;
        Ok(self.handle())
    }

    /// The queue that it is for.
    pub fn queue(&self) -> QueueKind {
        self.queue
    }

    pub(super) fn gpu(&self) -> &Gpu {
        &self.idle.gpu
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
            unsafe { self.gpu().device().reset_command_pool(raw.pool, vk::CommandPoolResetFlags::empty()) };
        match reset {
            Ok(()) => lock(&self.idle.idle)[self.queue as usize].push(raw),
            // SAFETY: as above.
            Err(_) => unsafe { raw.destroy(self.gpu().device()) },
        }
    }
}
