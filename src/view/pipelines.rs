//! The pipelines of a window, made on threads of their own: a driver may take seconds to compile them, and the window
//! answers meanwhile.

use crate::gpu::{ComputePipeline, DeviceKind, Gpu, GpuError, PipelineDesc};
use crate::render::{frame, screen};
use crate::resident::{self, pool::Access};
use crate::section::Surface;
use crossbeam_channel::{Receiver, unbounded};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;

/// Most threads that make pipelines.
const MOST_THREADS: usize = 4;

/// See the module.
pub struct Pipelines {
    made: Receiver<(usize, Result<ComputePipeline, GpuError>)>,
    /// Held, so that whoever wants one finds it.
    kept: Vec<ComputePipeline>,
    /// The first so many of all are what the first image needs; these of them are not there yet.
    needed: usize,
    missing: usize,
    is_over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

/// What the first image needs, what takes longest first; then the rest.
fn pipeline_descs(
    kind: DeviceKind,
    access: Access,
    surface: Surface,
    bridge: bool,
) -> [Vec<PipelineDesc>; 2] {
    let [mut needed, more] = frame::pipeline_descs(kind, access, surface);
    let [derived, others] = resident::derived_pipeline_descs(access, surface, bridge);
    needed.reverse();
    needed.extend(derived);
    needed.push(screen::desc());
    [needed, more.into_iter().chain(others).collect()]
}

impl Pipelines {
    /// Begins to make them; `wake` is called when one is there.
    pub fn make(
        gpu: &Gpu,
        access: Access,
        surface: Surface,
        bridge: bool,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Pipelines {
        let [needed, more] = pipeline_descs(gpu.info().kind, access, surface, bridge);
        let count = needed.len();
        let all: Arc<[PipelineDesc]> = needed.into_iter().chain(more).collect();
        let (send, made) = unbounded();
        let (next, is_over, wake) =
            (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)), Arc::new(wake));
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let thread = |_| {
            let (gpu, all, send) = (gpu.clone(), Arc::clone(&all), send.clone());
            let (next, is_over, wake) = (Arc::clone(&next), Arc::clone(&is_over), Arc::clone(&wake));
            std::thread::spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(desc) = all.get(at) else { return };
                    // The window may be gone.
                    let _ = send.send((at, desc.make(&gpu)));
                    wake();
                }
            })
        };
        let threads = (0..cores.min(MOST_THREADS)).map(thread).collect();
        Pipelines { made, kept: Vec::new(), needed: count, missing: count, is_over, threads }
    }

    /// Whether all are there that the first image needs.
    pub fn are_ready(&self) -> bool {
        self.missing == 0
    }

    /// Takes what was made; whether all are ready since this call.
    pub fn become_ready(&mut self) -> Result<bool, GpuError> {
        // What comes after those is found by whoever wants it without being taken.
        if self.are_ready() {
            return Ok(false);
        }
        for (at, pipeline) in self.made.try_iter() {
            self.kept.push(pipeline?);
            self.missing -= usize::from(at < self.needed);
        }
        Ok(self.are_ready())
    }
}

impl Drop for Pipelines {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        // What a driver is in the middle of cannot be stopped, and must not outlive the device.
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
