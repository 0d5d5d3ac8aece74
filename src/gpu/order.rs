//! The ordering rule: who waits for whom, on the device and on the host.
//!
//! ```text
//! transfer queue   copy ─────────┐ BuildAfterCopy
//!       ▲ CopyAfterUse           ▼
//! compute queue    frame ── build: pass ─ pass ── frame: pass ─ pass ─ readback ── frame …
//! ```
//!
//! 1. A point comes from a submit, so no wait is ever submitted before its signal.
//! 2. A section may be named in a table once the host has *seen* its build reached
//!    ([`Order::is_live`]); its build is best submitted once its copy is seen. Then no frame stalls
//!    behind a copy. Frames submit no wait: they follow the builds on the same queue, whose wait for the
//!    copy counts for everything after it, and the barrier at a frame's start makes the builds visible.
//! 3. [`Order::begin_frame`] hands out one of a few table copies, when the frame that used it is done.
//! 4. A copy into a slot waits for the last work that used the slot.
//!
//! Every wait and barrier is emitted here, each named by an [`Edge`], and each is needed:
//! the tests take them out one by one. Where both kinds of work share one queue, waits are barriers.

use std::any::Any;
use std::sync::Arc;
use std::time::Duration;

use ash::vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stages};
use ash::{vk, vk::MemoryBarrier2};

#[cfg(feature = "view")]
use super::acquired::Acquired;
use super::command::{BufferCopy, Commands, IdleCommands};
use super::device::Gpu;
use super::edge::{Edge, Event};
#[cfg(feature = "view")]
use super::error::GpuError;
use super::error::Result;
use super::kinds::QueueKind;
use super::memory::Buffer;
use super::sync::{Stage, SyncPoint, Wait};
use super::timeline::Timeline;

/// Longer than any honest work: a device that takes longer has stopped.
const HANG_TIMEOUT: Duration = Duration::from_secs(120);

/// Begins and submits all work, and so owns every wait and barrier. One per device.
pub struct Order {
    gpu: Gpu,
    idle: Arc<IdleCommands>,
    /// Compute, then transfer unless it is the same queue.
    timelines: Vec<Timeline>,
    /// Highest value of the other queue that a submit to this one has waited for: a wait counts for
    /// all later work on its queue, so none need wait for it again.
    waited: [u64; 2],
    /// The last frame that used each table copy.
    frames: Vec<Option<SyncPoint>>,
    frame: usize,
    without: Option<Edge>,
    events: Option<Vec<Event>>,
}

const COMPUTE: Stages = Stages::COMPUTE_SHADER;
const COPY: Stages = Stages::COPY;
const HOST: Stages = Stages::HOST;
const STORAGE_WRITE: Access = Access::SHADER_STORAGE_WRITE;
const STORAGE: Access =
    Access::from_raw(Access::SHADER_STORAGE_READ.as_raw() | Access::SHADER_STORAGE_WRITE.as_raw());

impl Order {
    /// For a device whose frames take turns on `frames_in_flight` table copies (1 or more).
    pub fn new(gpu: &Gpu, frames_in_flight: usize) -> Result<Order> {
        let mut timelines = vec![Timeline::new(gpu, QueueKind::Compute, "compute timeline")?];
        if gpu.has_transfer_queue() {
            timelines.push(Timeline::new(gpu, QueueKind::Transfer, "transfer timeline")?);
        }
        Ok(Order {
            gpu: gpu.clone(),
            idle: IdleCommands::new(gpu),
            timelines,
            waited: [0; 2],
            frames: vec![None; frames_in_flight.max(1)],
            frame: 0,
            without: None,
            events: None,
        })
    }

    /// The order with one wait or barrier left out: for the tests that show that it is needed.
    #[doc(hidden)]
    pub fn without(mut self, edge: Edge) -> Order {
        self.without = Some(edge);
        self
    }

    /// The order that notes what it does.
    #[doc(hidden)]
    pub fn recording(mut self) -> Order {
        self.events = Some(Vec::new());
        self
    }

    /// What was noted.
    #[doc(hidden)]
    pub fn events(&self) -> &[Event] {
        self.events.as_deref().unwrap_or_default()
    }

    /// Begins copies into slots. `last_use` is the last work of any kind that touched a slot now
    /// written again: the latest frame that could name it, or its build or copy if none could.
    pub fn begin_copy(&mut self, name: &str, last_use: &[SyncPoint]) -> Result<Commands> {
        let mut commands = Commands::begin(&self.idle, self.queue(QueueKind::Transfer), Stage::Copy, name)?;
        // A transfer queue knows no compute stage.
        let earlier = if self.timelines.len() == 1 { COMPUTE | COPY } else { COPY };
        let written =
            if self.timelines.len() == 1 { STORAGE_WRITE } else { Access::NONE } | Access::TRANSFER_WRITE;
        self.after(
            &mut commands,
            Edge::CopyAfterUse,
            last_use,
            (earlier, written),
            (COPY, Access::TRANSFER_WRITE),
        );
        Ok(commands)
    }

    /// Begins derived passes that read what `copied` wrote, and what earlier builds wrote.
    pub fn begin_build(&mut self, name: &str, copied: &[SyncPoint]) -> Result<Commands> {
        let mut commands = Commands::begin(&self.idle, QueueKind::Compute, Stage::Build, name)?;
        let (src, dst) = ((COPY, Access::TRANSFER_WRITE), (COMPUTE, STORAGE));
        self.after(&mut commands, Edge::BuildAfterCopy, copied, src, dst);
        self.barrier(&mut commands, Edge::BuildAfterEarlier, (COMPUTE, STORAGE_WRITE), (COMPUTE, STORAGE));
        Ok(commands)
    }

    /// Begins the passes of a frame, and says which table copy (and anything else that exists once per
    /// frame in flight) it uses: 0, 1, ... in turn. Waits until the frame that used that copy is done,
    /// so the host may rewrite it until the submit.
    pub fn begin_frame(&mut self, name: &str) -> Result<(Commands, usize)> {
        let slot = self.frame % self.frames.len();
        if let Some(point) = self.frames[slot] {
            self.host_wait(Edge::TableReuse, point)?;
        }
        let mut commands = Commands::begin(&self.idle, QueueKind::Compute, Stage::Frame, name)?;
        self.barrier(&mut commands, Edge::FrameAfterEarlier, (COMPUTE, STORAGE_WRITE), (COMPUTE, STORAGE));
        // An earlier readback may have written where this frame's will write, too.
        let (src, dst) = ((COPY, Access::TRANSFER_WRITE), (COMPUTE | COPY, Access::TRANSFER_WRITE));
        self.barrier(&mut commands, Edge::FrameAfterReadback, src, dst);
        Ok((commands, slot))
    }

    /// Whether [`Order::begin_frame`] would not wait; looks again for so long at most.
    #[cfg(feature = "view")]
    pub fn has_free_frame(&mut self, patience: Duration) -> Result<bool> {
        let Some(point) = self.frames[self.frame % self.frames.len()] else { return Ok(true) };
        match self.wait_for(point, patience) {
            Err(GpuError::Timeout { .. }) => Ok(false),
            done => done.map(|()| true),
        }
    }

    /// Stands between two passes of a build or a frame of which the second reads or overwrites what the
    /// first wrote.
    pub fn next_pass(&mut self, commands: &mut Commands) {
        let edge = match commands.stage {
            Stage::Build => Edge::BuildPass,
            Stage::Frame => Edge::FramePass,
            Stage::Copy => panic!("{}: copies have no passes", commands.name()),
        };
        self.barrier(commands, edge, (COMPUTE, STORAGE_WRITE), (COMPUTE, STORAGE));
    }

    /// Ends a frame by copying what its passes wrote into buffers that the host reads with
    /// [`Order::read`] once the frame is submitted. One call a frame, with all of it.
    pub fn readback(&mut self, commands: &mut Commands, copies: &[(&Buffer, &Buffer, BufferCopy)]) {
        assert_eq!(commands.stage, Stage::Frame, "{}: only frames are read back", commands.name());
        let src = (COMPUTE, STORAGE_WRITE);
        self.barrier(commands, Edge::ReadbackAfterPass, src, (COPY, Access::TRANSFER_READ));
        for (from, to, range) in copies {
            commands.copy(from, to, &[*range]);
        }
        let src = (COPY, Access::TRANSFER_WRITE);
        self.barrier(commands, Edge::HostAfterReadback, src, (HOST, Access::HOST_READ));
    }

    /// Ends a frame by drawing onto an image of the window what its passes, or those of earlier frames, wrote: `paint`
    /// renders it.
    /// The submit waits until the image is free; [`super::Swapchain::present`] comes after it.
    #[cfg(feature = "view")]
    pub fn draw<R>(
        &mut self,
        commands: &mut Commands,
        image: &Acquired,
        paint: impl FnOnce(&mut Commands) -> R,
    ) -> R {
        assert_eq!(commands.stage, Stage::Frame, "{}: only frames are shown", commands.name());
        let whole = vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .level_count(1)
            .layer_count(1);
        let of_image = vk::ImageMemoryBarrier2::default().image(image.image).subresource_range(whole);
        let output = Stages::COLOR_ATTACHMENT_OUTPUT;
        let written = MemoryBarrier2::default()
            .src_stage_mask(COMPUTE)
            .src_access_mask(STORAGE_WRITE)
            .dst_stage_mask(Stages::VERTEX_SHADER | Stages::FRAGMENT_SHADER)
            .dst_access_mask(Access::SHADER_STORAGE_READ);
        // The semaphore is waited for at this stage: the old content is dropped after it.
        let free = of_image
            .src_stage_mask(output)
            .dst_stage_mask(output)
            .dst_access_mask(Access::COLOR_ATTACHMENT_WRITE | Access::COLOR_ATTACHMENT_READ)
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL);
        commands.barriers(&[written], &[free]);
        commands.shown = Some([image.free, image.drawn]);
        let painted = paint(commands);
        let shown = of_image
            .src_stage_mask(output)
            .src_access_mask(Access::COLOR_ATTACHMENT_WRITE)
            .dst_stage_mask(output)
            .old_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .new_layout(vk::ImageLayout::PRESENT_SRC_KHR);
        // The passes of the next frame write what was drawn from.
        let read = MemoryBarrier2::default().src_stage_mask(Stages::FRAGMENT_SHADER).dst_stage_mask(COMPUTE);
        commands.barriers(&[read], &[shown]);
        painted
    }

    /// Submits; the commands and what they keep are dropped by [`Order::collect`] once they are done.
    pub fn submit(&mut self, mut commands: Commands) -> Result<SyncPoint> {
        let queue = commands.queue();
        let stage = commands.stage;
        let mut waits: Vec<_> = commands
            .waits
            .iter()
            .map(|wait| {
                vk::SemaphoreSubmitInfo::default()
                    .semaphore(self.timelines[wait.point.queue as usize].semaphore())
                    .value(wait.point.value)
                    .stage_mask(wait.stages)
            })
            .collect();
        waits.extend(commands.shown.map(|[free, _]| {
            vk::SemaphoreSubmitInfo::default().semaphore(free).stage_mask(Stages::COLOR_ATTACHMENT_OUTPUT)
        }));
        let waited = commands.waits.iter().map(|wait| wait.point.value).max().unwrap_or(0);
        let buffer = commands.end()?;
        let drawn = commands.shown.map(|[_, drawn]| drawn);
        let timeline = &mut self.timelines[queue as usize];
        // SAFETY: the commands were recorded for this queue and have ended; the waited values were submitted before
        // (a `SyncPoint` proves it); the commands, which keep what they use, are retired at the point.
        let point = unsafe { timeline.submit(commands.name(), buffer, &waits, drawn) }?;
        timeline.retire(point.value, Box::new(commands));
        self.waited[queue as usize] = self.waited[queue as usize].max(waited);
        if stage == Stage::Frame {
            let slot = self.frame % self.frames.len();
            self.frames[slot] = Some(point);
            self.frame += 1;
        }
        self.note(Event::Submit { point });
        Ok(point)
    }

    /// Whether the host has seen `built`, the build of a section (or its copy), reached: from then on
    /// tables may name the section.
    pub fn is_live(&mut self, built: SyncPoint) -> Result<bool> {
        self.reached(built)
    }

    /// Whether the work is done.
    pub fn reached(&mut self, point: SyncPoint) -> Result<bool> {
        let reached = self.timeline(point).reached(point.value)?;
        if reached {
            self.note(Event::Seen { edge: None, point });
        }
        Ok(reached)
    }

    /// Whether the host knows already that the work is done. Asks nothing: an answer would hide from validation
    /// that a barrier is missing between that work and the next.
    pub fn is_known_done(&mut self, point: SyncPoint) -> bool {
        self.timeline(point).is_known_past(point.value)
    }

    /// Waits until the work is done, 120 seconds at most.
    pub fn wait(&mut self, point: SyncPoint) -> Result<()> {
        self.wait_for(point, HANG_TIMEOUT)
    }

    /// Waits until the work is done, or fails after `timeout`.
    pub fn wait_for(&mut self, point: SyncPoint, timeout: Duration) -> Result<()> {
        self.timeline(point).wait(point.value, timeout)?;
        self.note(Event::Seen { edge: None, point });
        Ok(())
    }

    /// Waits for `frame`, then reads at `offset` of `buffer`, which the frame's readback has written.
    pub fn read(&mut self, frame: SyncPoint, buffer: &Buffer, offset: u64, bytes: &mut [u8]) -> Result<()> {
        self.host_wait(Edge::HostRead, frame)?;
        buffer.read(offset, bytes);
        Ok(())
    }

    /// Keeps `thing` alive until `point` is reached.
    pub fn retire(&mut self, point: SyncPoint, thing: impl Any + Send) {
        self.timeline(point).retire(point.value, Box::new(thing));
    }

    /// Submitted work and retired things that are not known to be done: what they use is kept.
    pub fn in_flight(&self) -> usize {
        self.timelines.iter().map(Timeline::in_flight).sum()
    }

    /// Drops what is done; once a frame is enough. What the host has seen done anyway goes with every submit.
    pub fn collect(&mut self) -> Result<()> {
        self.timelines.iter_mut().try_for_each(Timeline::collect)
    }

    /// Whether the host may write again what the work of `point` reads.
    pub(super) fn may_reuse(&mut self, edge: Edge, point: SyncPoint) -> Result<bool> {
        if self.without == Some(edge) {
            return Ok(true);
        }
        let reached = self.timeline(point).reached(point.value)?;
        if reached {
            self.note(Event::Seen { edge: Some(edge), point });
        }
        Ok(reached)
    }

    fn host_wait(&mut self, edge: Edge, point: SyncPoint) -> Result<()> {
        if self.without != Some(edge) {
            self.timeline(point).wait(point.value, HANG_TIMEOUT)?;
            self.note(Event::Seen { edge: Some(edge), point });
        }
        Ok(())
    }

    /// Orders `commands` after `points`: by a wait for those of the other queue, by a barrier for those
    /// of its own.
    fn after(
        &mut self,
        commands: &mut Commands,
        edge: Edge,
        points: &[SyncPoint],
        src: (Stages, Access),
        dst: (Stages, Access),
    ) {
        let own = commands.queue();
        let latest = points.iter().filter(|p| p.queue != own).max_by_key(|p| p.value);
        if let Some(&point) = latest
            && point.value > self.waited[own as usize]
            && self.without != Some(edge)
        {
            commands.waits.push(Wait { point, stages: dst.0 });
            self.note(Event::Wait { edge, queue: own, point, stages: dst.0 });
        }
        if points.iter().any(|p| p.queue == own) {
            self.barrier(commands, edge, src, dst);
        }
    }

    fn barrier(&mut self, commands: &mut Commands, edge: Edge, src: (Stages, Access), dst: (Stages, Access)) {
        if self.without == Some(edge) {
            return;
        }
        commands.barrier(
            MemoryBarrier2::default()
                .src_stage_mask(src.0)
                .src_access_mask(src.1)
                .dst_stage_mask(dst.0)
                .dst_access_mask(dst.1),
        );
        self.note(Event::Barrier { edge, queue: commands.queue(), src, dst });
    }

    /// The queue that `kind` means on this device.
    fn queue(&self, kind: QueueKind) -> QueueKind {
        if self.timelines.len() == 1 { QueueKind::Compute } else { kind }
    }

    fn timeline(&mut self, point: SyncPoint) -> &mut Timeline {
        &mut self.timelines[point.queue as usize]
    }

    fn note(&mut self, event: Event) {
        if let Some(events) = &mut self.events {
            events.push(event);
        }
    }
}

impl Drop for Order {
    fn drop(&mut self) {
        // What is retired may be in use until here.
        self.gpu.wait_idle();
    }
}
