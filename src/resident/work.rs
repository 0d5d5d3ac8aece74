//! What is submitted for sections: the last of each kind, and what it takes on the device.

use crate::gpu::{Commands, Gpu, GpuError, Order, QueueKind, SyncPoint, Timestamps};

/// What the device does for sections.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Work {
    /// Copies into slots.
    Copy,
    /// Derived passes.
    Build,
    /// Derived passes of sections that are shown under another mask.
    Again,
}

/// Work that is being recorded, and the timestamps around it where it is measured.
pub struct Recording {
    work: Work,
    /// The work itself.
    pub commands: Commands,
    timestamps: Option<Timestamps>,
}

/// Submits that are measured, and timestamps that wait to be used again.
#[derive(Default)]
struct Clock {
    /// Every submit is; else those alone that derive sections again.
    measures_all: bool,
    idle: Vec<(QueueKind, Timestamps)>,
    running: Vec<(Work, QueueKind, SyncPoint, Timestamps)>,
    /// What was measured of all and not asked for yet, nanoseconds.
    times: Vec<(Work, f64)>,
    /// And of those that derive again.
    again_ns: f64,
}

/// Every submit for sections: `start`, record, `submit`.
pub struct Submits {
    gpu: Gpu,
    clock: Clock,
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
        Submits {
            gpu: gpu.clone(),
            clock: Clock::default(),
            last_copy: None,
            last_build: None,
            last_frame: None,
        }
    }

    /// Measures every submit from now on.
    pub fn measure(&mut self) {
        self.clock.measures_all = true;
    }

    /// Begins to measure what is recorded from here on, where `work` is measured.
    pub fn start(&mut self, work: Work, mut commands: Commands) -> Result<Recording, GpuError> {
        let clock = &mut self.clock;
        if !clock.measures_all && work != Work::Again {
            return Ok(Recording { work, commands, timestamps: None });
        }
        let queue = commands.queue();
        let idle = clock.idle.iter().position(|(of, _)| *of == queue).map(|at| clock.idle.swap_remove(at).1);
        let mut timestamps = match idle {
            Some(timestamps) => Some(timestamps),
            None => Timestamps::new(&self.gpu, "sections", queue, 1)?,
        };
        timestamps.iter_mut().for_each(|t| t.begin(&mut commands));
        Ok(Recording { work, commands, timestamps })
    }

    /// Submits what was recorded.
    pub fn submit(&mut self, order: &mut Order, recording: Recording) -> Result<SyncPoint, GpuError> {
        let Recording { work, mut commands, timestamps } = recording;
        let queue = commands.queue();
        let timestamps = timestamps.map(|mut timestamps| {
            timestamps.end(&mut commands, "all");
            timestamps
        });
        let point = order.submit(commands)?;
        match work {
            Work::Copy => self.last_copy = Some(point),
            Work::Build | Work::Again => self.last_build = Some(point),
        }
        self.clock.running.extend(timestamps.map(|timestamps| (work, queue, point, timestamps)));
        Ok(point)
    }

    /// Device times of the work that is done and was not asked for yet, nanoseconds; empty on a device that cannot tell.
    pub fn take_times(&mut self, order: &mut Order) -> Result<Vec<(Work, f64)>, GpuError> {
        self.resolve(order)?;
        Ok(std::mem::take(&mut self.clock.times))
    }

    /// Device time of the sections that were derived again since the last time, milliseconds; `None` on a device that cannot
    /// tell.
    pub fn take_again_ms(&mut self, order: &mut Order) -> Result<Option<f64>, GpuError> {
        self.resolve(order)?;
        let ns = std::mem::take(&mut self.clock.again_ns);
        Ok((ns > 0.0).then_some(ns / 1e6))
    }

    fn resolve(&mut self, order: &mut Order) -> Result<(), GpuError> {
        let clock = &mut self.clock;
        let mut still = Vec::new();
        for (work, queue, point, mut timestamps) in clock.running.drain(..) {
            if !order.reached(point)? {
                still.push((work, queue, point, timestamps));
                continue;
            }
            for (_, ns) in timestamps.resolve(order, point)? {
                if work == Work::Again {
                    clock.again_ns += ns;
                }
                if clock.measures_all {
                    clock.times.push((work, ns));
                }
            }
            clock.idle.push((queue, timestamps));
        }
        clock.running = still;
        Ok(())
    }
}
