//! Workers: chunks of all files to bins, in parallel over chunks and over files.

use super::bins::{Binner, Bins};
use super::input::Input;
use crate::limits::LIMITS;
use crate::source::contain::caught;
use crate::source::{Chunk, Decoder, Fields, LayerMemory, LidarFile, PointBlock, SourceError, time_reading};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// What takes decoded points, from several threads at once, in any order.
pub trait Sink: Sync {
    /// What a thread keeps between blocks.
    type Own: Default;
    /// What it needs of points beside what pictures always need.
    fn fields(&self) -> Fields;
    /// Takes a block of a chunk of `inputs[index]`.
    fn take(&self, own: &mut Self::Own, index: usize, input: &Input, block: &PointBlock);
}

impl Sink for Bins {
    type Own = Binner;
    fn fields(&self) -> Fields {
        self.reading().fields()
    }
    fn take(&self, own: &mut Binner, _: usize, input: &Input, block: &PointBlock) {
        own.bin(self, input, block);
    }
}

/// How far the reading is; shared with whoever shows it.
#[derive(Debug, Default)]
pub struct ReadProgress {
    /// Points binned.
    pub points: AtomicU64,
    /// Set it to stop early.
    pub stop: AtomicBool,
    /// Where the time goes.
    pub clocks: Clocks,
}

/// Nanoseconds of all workers together; a chunk's are added when it is done.
#[derive(Debug, Default)]
pub struct Clocks {
    /// In positioned reads.
    pub read: AtomicU64,
    /// In decoding what was read.
    pub decode: AtomicU64,
    /// In binning.
    pub prepare: AtomicU64,
}

impl Clocks {
    fn add(&self, read: Duration, decode: Duration, prepare: Duration) {
        for (clock, time) in [(&self.read, read), (&self.decode, decode), (&self.prepare, prepare)] {
            clock.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
        }
    }
}

/// What a panic of this program becomes while `chunk` is read, after so many points.
pub(super) fn panicked(file: &LidarFile, chunk: &Chunk, read: u64, reason: &str) -> SourceError {
    SourceError::Chunk {
        path: file.path().to_owned(),
        chunk: chunk.index,
        offset: chunk.byte_offset,
        read,
        records: chunk.records,
        reason: format!("reading it ended in a fault of the program: {reason}"),
    }
}

/// Reads every chunk of `inputs` on `threads` workers and gives its points to `sink`; returns what went wrong, in the
/// order of files and chunks. A file that cannot be read any more is named once; a broken chunk is named and
/// the next one goes on. `layers`: what decoders share.
pub fn read_all<S: Sink>(
    inputs: &[Input],
    sink: &S,
    threads: usize,
    layers: &LayerMemory,
    progress: &ReadProgress,
) -> Vec<SourceError> {
    struct Job<'a> {
        input: usize,
        chunk: &'a Chunk,
    }
    let errors = Mutex::new(Vec::<(usize, u64, SourceError)>::new());
    // Chunks left in each file: its handle is closed after the last.
    let left: Vec<_> = inputs.iter().map(|i| AtomicUsize::new(i.file.chunks.len())).collect();
    let gone: Vec<_> = inputs.iter().map(|_| AtomicBool::new(false)).collect();
    let (send, receive) = crossbeam_channel::bounded::<Job>(LIMITS.waiting_chunks);
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            let (receive, errors, left, gone) = (receive.clone(), &errors, &left, &gone);
            scope.spawn(move || {
                let new_decoder = || {
                    let mut decoder = Decoder::sharing(layers);
                    decoder.set_fields(sink.fields());
                    decoder
                };
                let (mut decoder, mut own) = (new_decoder(), S::Own::default());
                for Job { input, chunk } in receive {
                    let source = &inputs[input];
                    if !gone[input].load(Ordering::Relaxed) && !progress.stop.load(Ordering::Relaxed) {
                        let (start, read_before) = (Instant::now(), time_reading());
                        let (mut prepare, mut points) = (Duration::ZERO, 0);
                        let result = caught(|| {
                            decoder.decode(&source.file, chunk, 0..chunk.records, &mut |block| {
                                let start = Instant::now();
                                sink.take(&mut own, input, source, block);
                                prepare += start.elapsed();
                                points += block.len() as u64;
                                progress.points.fetch_add(block.len() as u64, Ordering::Relaxed);
                            })
                        });
                        let result = result.unwrap_or_else(|reason| {
                            (decoder, own) = (new_decoder(), S::Own::default());
                            Err(panicked(&source.file, chunk, points, &reason))
                        });
                        let read = time_reading() - read_before;
                        progress.clocks.add(read, start.elapsed().saturating_sub(read + prepare), prepare);
                        if let Err(error) = result {
                            // A file that vanished or changed, or a disk that fails, is named once, not once a chunk.
                            let lost = matches!(error, SourceError::Io { .. } | SourceError::Changed { .. });
                            if !lost || !gone[input].swap(true, Ordering::Relaxed) {
                                let mut errors = errors.lock().unwrap_or_else(|e| e.into_inner());
                                errors.push((input, chunk.index, error));
                            }
                        }
                    }
                    if left[input].fetch_sub(1, Ordering::Relaxed) == 1 {
                        source.file.bytes.release();
                    }
                }
            });
        }
        drop(receive);
        for (input, source) in inputs.iter().enumerate() {
            for chunk in &source.file.chunks {
                // Workers end only when this side hangs up.
                send.send(Job { input, chunk }).expect("workers receive until the end");
            }
        }
        drop(send);
    });
    let mut errors = errors.into_inner().unwrap_or_else(|e| e.into_inner());
    errors.sort_by_key(|(input, chunk, _)| (*input, *chunk));
    errors.into_iter().map(|(_, _, error)| error).collect()
}
