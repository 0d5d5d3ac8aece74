//! What is submitted for sections: the last of each kind, and what it takes on the device.

use crate::gpu::{Commands, Gpu, GpuError, Order, QueueKind, SyncPoint, Timestamps};

/// What the device does for sections.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Work {
    /// Copies into slots.
    Copy,
    /// Derived passes.
    Build,
}

/// Work that is being recorded, and the timestamps around it where it is measured.
pub struct Recording {
    /// The work itself.
    pub commands: Commands,
    timestamps: Option<Timestamps>,
}

/// Submits that are measured, and timestamps that wait to be used again.
#[derive(Default)]
struct Clock {
    idle: Vec<(QueueKind, Timestamps)>,
    running: Vec<(Work, QueueKind, SyncPoint, Timestamps)>,
}

/// Every submit for sections: `start`, record, `submit`.
pub struct Submits {
    gpu: Gpu,
    clock: Option<Clock>,
    /// The last copy into slots.
    pub last_copy: Option<SyncPoint>,
    /// The last derived passes: they write to published slots, too, and read those of neighbours.
    pub last_build: Option<SyncPoint>,
    /// The last frame that could read every published section.
    pub last_frame: Option<SyncPoint>,
}

/// What copies and derived passes are submitted with.
pub struct Submitter<'a> {
    /// Who waits for whom.
    pub order: &'a mut Order,
    /// What was submitted before.
    pub submits: &'a mut Submits,
}

impl Submits {
    /// None yet.
    pub fn new(gpu: &Gpu) -> Submits {
        Submits { gpu: gpu.clone(), clock: None, last_copy: None, last_build: None, last_frame: None }
    }

    /// Measures every submit from now on.
    pub fn measure(&mut self) {
        self.clock.get_or_insert_default();
    }

    /// Begins to measure what is recorded from here on, if submits are measured.
    pub fn start(&mut self, mut commands: Commands) -> Result<Recording, GpuError> {
        let Some(clock) = &mut self.clock else { return Ok(Recording { commands, timestamps: None }) };
        let queue = commands.queue();
        let idle = clock.idle.iter().position(|(of, _)| *of == queue).map(|at| clock.idle.swap_remove(at).1);
        let mut timestamps = match idle {
            Some(timestamps) => Some(timestamps),
            None => Timestamps::new(&self.gpu, "sections", queue, 1)?,
        };
        timestamps.iter_mut().for_each(|t| t.begin(&mut commands));
        Ok(Recording { commands, timestamps })
    }

    /// Submits what was recorded.
    pub fn submit(
        &mut self,
        order: &mut Order,
        work: Work,
        recording: Recording,
    ) -> Result<SyncPoint, GpuError> {
        let Recording { mut commands, timestamps } = recording;
        let queue = commands.queue();
        let timestamps = timestamps.map(|mut timestamps| {
            timestamps.end(&mut commands, "all");
            timestamps
        });
        let point = order.submit(commands)?;
        match work {
            Work::Copy => self.last_copy = Some(point),
            Work::Build => self.last_build = Some(point),
        }
        if let (Some(clock), Some(timestamps)) = (&mut self.clock, timestamps) {
            clock.running.push((work, queue, point, timestamps));
        }
        Ok(point)
    }

    /// Device times of the work that is done and was not asked for yet, nanoseconds; empty on a device that cannot tell.
    pub fn take_times(&mut self, order: &mut Order) -> Result<Vec<(Work, f64)>, GpuError> {
        let Some(clock) = &mut self.clock else { return Ok(Vec::new()) };
        let (mut times, mut still) = (Vec::new(), Vec::new());
        for (work, queue, point, mut timestamps) in clock.running.drain(..) {
            if order.reached(point)? {
                times.extend(timestamps.resolve(order, point)?.into_iter().map(|(_, ns)| (work, ns)));
                clock.idle.push((queue, timestamps));
            } else {
                still.push((work, queue, point, timestamps));
            }
        }
        clock.running = still;
        Ok(times)
    }
}
