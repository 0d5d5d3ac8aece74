//! One queue's progress as a number.

use std::any::Any;
use std::collections::VecDeque;
use std::time::Duration;

use ash::vk;

use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::QueueKind;
use super::lock::lock;
use super::sync::SyncPoint;

/// A queue with its timeline semaphore. Choosing the value and submitting is one step, and things in
/// use wait here until the queue is past them.
pub(super) struct Timeline {
    gpu: Gpu,
    queue: QueueKind,
    semaphore: vk::Semaphore,
    /// Value of the last submit.
    submitted: u64,
    /// Highest value that the host has seen.
    seen: u64,
    /// Ordered by value: things are retired at submits, or at points that are already old.
    retired: VecDeque<(u64, Box<dyn Any + Send>)>,
}

impl Timeline {
    pub fn new(gpu: &Gpu, queue: QueueKind, name: &str) -> Result<Timeline> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let create = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device is alive: `gpu` holds it.
        let semaphore = unsafe { gpu.device().create_semaphore(&create, None) }
            .map_err(|e| GpuError::vulkan(format!("vkCreateSemaphore for {name}"), e))?;
        gpu.name_object(semaphore, name);
        Ok(Timeline { gpu: gpu.clone(), queue, semaphore, submitted: 0, seen: 0, retired: VecDeque::new() })
    }

    pub fn semaphore(&self) -> vk::Semaphore {
        self.semaphore
    }

    /// Submits the recorded `buffer` after `waits` (semaphore, value, stages); `also_signalled`: a binary semaphore.
    ///
    /// # Safety
    /// `buffer` is executable and of this queue's family; every waited value was submitted before, and a waited binary
    /// semaphore has its signal pending; `also_signalled` is unsignalled, with no signal pending. The caller keeps the
    /// buffer, all that it uses and those semaphores until the queue is past the point: see [`Timeline::retire`].
    pub unsafe fn submit(
        &mut self,
        name: &str,
        buffer: vk::CommandBuffer,
        waits: &[vk::SemaphoreSubmitInfo<'_>],
        also_signalled: Option<vk::Semaphore>,
    ) -> Result<SyncPoint> {
        let value = self.submitted + 1;
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(buffer)];
        let signal = |semaphore: vk::Semaphore, value: u64| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(semaphore)
                .value(value)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        let mut signals = vec![signal(self.semaphore, value)];
        signals.extend(also_signalled.map(|semaphore| signal(semaphore, 0)));
        let submit = vk::SubmitInfo2::default()
            .wait_semaphore_infos(waits)
            .command_buffer_infos(&buffers)
            .signal_semaphore_infos(&signals);
        {
            let _guard = lock(&self.gpu.0.submitting);
            let queue = self.gpu.queue(self.queue).handle;
            // SAFETY: the lock makes this thread the queue's only user; the rest is the caller's promise.
            unsafe { self.gpu.device().queue_submit2(queue, &[submit], vk::Fence::null()) }
                .map_err(|e| GpuError::vulkan(format!("vkQueueSubmit2 of {name}"), e))?;
        }
        self.submitted = value;
        // Nothing is asked of the device: what the host knows to be done by now is given back with every submit, so
        // that what is kept does not grow with the number of submits.
        self.drop_seen();
        Ok(SyncPoint { queue: self.queue, value })
    }

    /// Whether the host knows already that the queue is past `value`; asks nothing.
    pub fn is_known_past(&self, value: u64) -> bool {
        self.seen >= value
    }

    /// Whether the queue is past `value`.
    pub fn reached(&mut self, value: u64) -> Result<bool> {
        self.assert_submitted(value);
        if self.seen < value {
            // SAFETY: the semaphore lives as long as `self`.
            let now = unsafe { self.gpu.device().get_semaphore_counter_value(self.semaphore) }
                .map_err(|e| GpuError::vulkan("vkGetSemaphoreCounterValue", e))?;
            // A lost device may report any value.
            if now > self.submitted {
                return Err(GpuError::DeviceLost { what: format!("{:?} timeline at {now}", self.queue) });
            }
            self.seen = self.seen.max(now);
        }
        Ok(self.seen >= value)
    }

    /// Waits until the queue is past `value`.
    pub fn wait(&mut self, value: u64, timeout: Duration) -> Result<()> {
        self.assert_submitted(value);
        if self.seen >= value {
            return Ok(());
        }
        let (semaphores, values) = ([self.semaphore], [value]);
        let wait = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        let nanoseconds = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
        let what = || format!("{:?} work {value}", self.queue);
        // SAFETY: the semaphore lives as long as `self`.
        match unsafe { self.gpu.device().wait_semaphores(&wait, nanoseconds) } {
            Ok(()) => {
                self.seen = self.seen.max(value);
                Ok(())
            }
            Err(vk::Result::TIMEOUT) => Err(GpuError::Timeout { what: what(), after: timeout }),
            Err(e) => Err(GpuError::vulkan(what(), e)),
        }
    }

    /// Keeps `thing` alive until the queue is past `value`.
    pub fn retire(&mut self, value: u64, thing: Box<dyn Any + Send>) {
        self.assert_submitted(value);
        let at = self.retired.partition_point(|(v, _)| *v <= value);
        self.retired.insert(at, (value, thing));
    }

    /// Drops what the queue is past.
    pub fn collect(&mut self) -> Result<()> {
        let Some((oldest, _)) = self.retired.front() else { return Ok(()) };
        if self.reached(*oldest)? {
            self.drop_seen();
        }
        Ok(())
    }

    /// Things that are kept until the queue is past them.
    pub fn in_flight(&self) -> usize {
        self.retired.len()
    }

    fn drop_seen(&mut self) {
        let done = self.retired.partition_point(|(v, _)| *v <= self.seen);
        self.retired.drain(..done);
    }

    fn assert_submitted(&self, value: u64) {
        assert!(value <= self.submitted, "a point of another device: {value} of {}", self.submitted);
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        // The owner has waited for the device, so nothing uses the semaphore or what was retired.
        self.retired.clear();
        // SAFETY: see above.
        unsafe { self.gpu.device().destroy_semaphore(self.semaphore, None) };
    }
}
