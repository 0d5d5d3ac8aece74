//! How long the stages of one piece of work took on the device.

use std::sync::Arc;

use ash::vk;

use super::command::Commands;
use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::QueueKind;
use super::order::Order;
use super::sync::SyncPoint;

/// Measures consecutive stages within one [`Commands`].
pub struct Timestamps {
    pool: Arc<QueryPool>,
    capacity: u32,
    /// The bits of a timestamp that count.
    counted: u64,
    /// Stages of the work being measured, in order; `None` while none is.
    stages: Option<Vec<&'static str>>,
    /// Times of pieces of work that the one being measured goes on from, in the order of their stages.
    before: Vec<(&'static str, f64)>,
}

struct QueryPool {
    gpu: Gpu,
    handle: vk::QueryPool,
}

impl Timestamps {
    /// Room for `stages` stages of work on `queue`; `None` on a device that cannot tell.
    pub fn new(gpu: &Gpu, name: &str, queue: QueueKind, stages: u32) -> Result<Option<Timestamps>> {
        let bits = gpu.limits().timestamp_bits[queue as usize];
        if bits == 0 || gpu.limits().timestamp_ns == 0.0 || !gpu.0.has_host_query_reset {
            return Ok(None);
        }
        let capacity = stages + 1;
        let create =
            vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(capacity);
        // SAFETY: the device is alive: `gpu` holds it.
        let handle = unsafe { gpu.device().create_query_pool(&create, None) }
            .map_err(|e| GpuError::vulkan(format!("vkCreateQueryPool for {name}"), e))?;
        gpu.name_object(handle, name);
        Ok(Some(Timestamps {
            pool: Arc::new(QueryPool { gpu: gpu.clone(), handle }),
            capacity,
            counted: u64::MAX >> 64u32.saturating_sub(bits).min(63),
            stages: None,
            before: Vec::new(),
        }))
    }

    /// Starts the clock at this place in `commands`, which are for the queue that this was made for.
    ///
    /// # Panics
    /// When the last measurement was not resolved.
    pub fn begin(&mut self, commands: &mut Commands) {
        assert!(self.stages.is_none(), "resolve the last measurement first");
        // SAFETY: the last work that wrote the queries was waited for in `resolve`; the feature is on.
        unsafe { self.pool.gpu.device().reset_query_pool(self.pool.handle, 0, self.capacity) };
        commands.keep(self.pool.clone());
        commands.timestamp(self.pool.handle, 0);
        self.stages = Some(Vec::new());
    }

    /// Ends a stage: it began where the one before ended.
    ///
    /// # Panics
    /// Without [`Timestamps::begin`], or beyond the number of stages.
    pub fn end(&mut self, commands: &mut Commands, stage: &'static str) {
        let stages = self.stages.as_mut().expect("begin comes first");
        stages.push(stage);
        assert!((stages.len() as u32) < self.capacity, "more stages than there is room for");
        commands.timestamp(self.pool.handle, stages.len() as u32);
    }

    /// Waits for `point`, the submit of the measured commands; what is measured next, of the same stages, is added to it.
    pub fn go_on(&mut self, order: &mut Order, point: SyncPoint) -> Result<()> {
        self.before = self.resolve(order, point)?;
        Ok(())
    }

    /// Waits for `point`, the submit of the measured commands; (stage, nanoseconds) in order.
    pub fn resolve(&mut self, order: &mut Order, point: SyncPoint) -> Result<Vec<(&'static str, f64)>> {
        order.wait(point)?;
        let before = std::mem::take(&mut self.before);
        let mut times = self.measured()?;
        times.iter_mut().zip(before).for_each(|((_, ns), (_, before))| *ns += before);
        Ok(times)
    }

    /// The last measurement, whose work is done.
    fn measured(&mut self) -> Result<Vec<(&'static str, f64)>> {
        let Some(stages) = self.stages.take() else { return Ok(Vec::new()) };
        let mut ticks = vec![0u64; stages.len() + 1];
        let (device, flags) = (self.pool.gpu.device(), vk::QueryResultFlags::TYPE_64);
        // SAFETY: the pool is alive and has at least that many queries, all written by now.
        unsafe { device.get_query_pool_results(self.pool.handle, 0, &mut ticks, flags) }
            .map_err(|e| GpuError::vulkan("vkGetQueryPoolResults", e))?;
        let step_ns = self.pool.gpu.limits().timestamp_ns;
        let times =
            ticks.windows(2).map(|pair| (pair[1].wrapping_sub(pair[0]) & self.counted) as f64 * step_ns);
        Ok(stages.into_iter().zip(times).collect())
    }
}

impl Drop for QueryPool {
    fn drop(&mut self) {
        // SAFETY: this is the last handle; work in flight holds one of its own.
        unsafe { self.gpu.device().destroy_query_pool(self.handle, None) };
    }
}
