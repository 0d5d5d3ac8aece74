//! Jobs on all cores, each thread with a decoder of its own.

use crate::source::{Decoder, LayerMemory};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes that all threads together may hold for layered chunks.
const DECODER_BYTES: u64 = 256 << 20;

/// Runs `job` for 0..count on all cores, each thread with a decoder of its own; results in order.
pub(crate) fn parallel<T: Send>(count: usize, job: impl Fn(&mut Decoder, usize) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(count);
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<T>>> = Mutex::new((0..count).map(|_| None).collect());
    let layers = LayerMemory::new(DECODER_BYTES);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut decoder = Decoder::sharing(&layers);
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        break;
                    }
                    let result = job(&mut decoder, index);
                    done.lock().expect("no job panics while it holds the lock")[index] = Some(result);
                }
            });
        }
    });
    let done = done.into_inner().expect("all threads have ended");
    done.into_iter().map(|result| result.expect("every index was taken")).collect()
}
