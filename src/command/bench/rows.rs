//! Rows of the report, from what was measured.

use crate::bench::FrameTimes;
use crate::bench::frames::{PoolRun, ThesisRun, Traced};
use crate::bench::report::{Pipeline, Row, Stat};
use crate::bench::steady::Repeats;
use crate::bench::thesis::Config;

fn stat(times: &[FrameTimes], of: impl Fn(&FrameTimes) -> f64) -> Option<Stat> {
    // A sum of nothing is -0.
    Stat::of(times.iter().map(|t| of(t) + 0.0).collect())
}

/// Device times of pictures, ms: at steady clocks, or, where the device has none, as they were drawn.
pub(super) fn trace_ms(traced: &Traced, drawn: &[FrameTimes]) -> Vec<f64> {
    if traced.all.is_empty() {
        return drawn.iter().map(|t| t.trace_ms).collect();
    }
    Traced::medians(&traced.all)
}

/// Whether all of them were taken after the device's clock had time to rise.
pub(super) fn is_warm(traced: &Traced) -> bool {
    traced.all.iter().all(|frame| !frame.is_cold)
}

/// What both pipelines have: streaming over `streamed` frames, others over `drawn` ones, tracing over `traced` ones.
fn row(
    pipeline: Pipeline,
    config: Config,
    path: &str,
    rays: u64,
    [streamed, drawn]: [&[FrameTimes]; 2],
    traced: &Traced,
) -> Row {
    let repeats = Repeats::sum(&traced.all);
    let passes = traced.passes.iter();
    let passes = passes.filter_map(|(name, f)| Some(((*name).to_owned(), Stat::of(Traced::medians(f))?)));
    Row {
        passes_ms: passes.collect(),
        spread: repeats.spread(),
        steady: repeats.is_steady(),
        repeats,
        frames: drawn.len() as u32,
        rays,
        prepare_ms: stat(streamed, |t| t.prepare_ms),
        copy_ms: stat(streamed, |t| t.copy_ms),
        copy_bytes: stat(streamed, |t| t.copy_bytes as f64),
        trace_ms: Stat::of(trace_ms(traced, drawn)),
        trace_wall_ms: stat(drawn, |t| t.trace_wall_ms),
        total_ms: stat(drawn, |t| t.total_ms),
        ..Row::new(pipeline, config.grid, config.levels, path)
    }
}

pub(super) fn thesis_row(run: &ThesisRun, config: Config, path: &str, rays: u64) -> Row {
    row(Pipeline::Thesis, config, path, rays, [&run.drawn; 2], &run.traced)
}

/// Streaming over every frame, tracing over those that were drawn.
pub(super) fn pool_row(run: &PoolRun, config: Config, path: &str, rays: u64) -> Row {
    let both = row(Pipeline::Pool, config, path, rays, [&run.stream, &run.drawn], &run.traced);
    let steps = run.steps_per_ray();
    Row {
        table_ms: stat(&run.drawn, |t| t.table_ms),
        wait_ms: stat(&run.stream, |t| t.wait_ms),
        missing_sections: Some(run.missing as u64),
        steps_per_ray: Some(steps),
        ns_per_step: both.trace_ms.as_ref().map(|t| t.median * 1e6 / (rays as f64 * steps)),
        ..both
    }
}
