//! Runs `lasray bench`: checks the arguments, measures part by part, and reports all that was measured whole.

use super::args::Args;
use super::harness::{Harness, STOP};
use crate::bench::report::Report;
use crate::bench::{Stopped, plot};
use crate::command::outcome::{Outcome, UsageError};
use crate::command::targets::check_targets;
use crate::gpu::{Gpu, GpuError, GpuOptions};
use crate::output::{Protected, Target, print};
use crate::problems::Problems;
use crate::render::frame::check_size;
use crate::render::path::CameraPath;
use crate::source::inputs;
use crate::source::learned::Cache;
use anyhow::Context;
use serde_json::json;
use std::sync::atomic::Ordering;

/// Share of pixels in which the pipelines' pictures may differ.
const MOST_DIFFER: f64 = 1e-3;

/// Pixels of a frame.
const SIZE: [u32; 2] = [640, 360];

/// Whether what is asked for goes together; `draws`: frames are measured.
fn check(args: &Args, draws: bool) -> Result<(), UsageError> {
    if args.scaling && args.grid.first().is_some_and(|config| config.levels < 2) {
        return Err(UsageError("--scaling: a configuration of at least two levels is needed".to_owned()));
    }
    if args.plot.is_some() && !draws {
        return Err(UsageError("--plot: no frames are measured".to_owned()));
    }
    if !args.threads.is_empty() && !args.ingest && !args.load {
        return Err(UsageError("--threads: only --ingest and --load take it".to_owned()));
    }
    if args.surface.is_some() && !args.stream && !args.ingest {
        return Err(UsageError("--surface: only --stream and --ingest take it".to_owned()));
    }
    Ok(())
}

/// Measures.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    let usage = |e: &dyn std::fmt::Display| anyhow::Error::from(UsageError(e.to_string()));
    let files = args.path.iter().map(|file| {
        let path = CameraPath::read(file).map_err(|e| usage(&e))?;
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = path.name().map_or(stem, str::to_owned);
        Ok(path.named(name))
    });
    let files = files.collect::<anyhow::Result<Vec<_>>>()?;
    let found = inputs::expand(&args.inputs);
    let mut protected = Protected::of(&found);
    args.path.iter().for_each(|path| protected.add(path));
    let json = args.json.iter().map(|to| ("--json", to));
    check_targets(&protected, [], json.chain(args.plot.iter().map(|to| ("--plot", to))))?;
    if args.peer && cfg!(not(feature = "embree")) {
        return Err(usage(&"--peer: this build is without Embree (cargo build --features embree)"));
    }
    let parts = args.ingest || args.load || args.scaling || args.peer || args.stream || args.complete;
    // What chooses frames for --scaling and --stream too asks for none of its own.
    let chosen = !args.grid.is_empty() || !args.paths.is_empty() && !args.stream;
    let draws = !parts || args.table || !files.is_empty() && !args.stream || chosen && !args.scaling;
    check(&args, draws)?;
    let cache = if args.no_cache { None } else { Cache::of_user() };
    let cache = cache.map(|cache| cache.folder().to_owned());
    let gpu = Gpu::new(&GpuOptions { device: args.device, cache: cache.clone(), ..Default::default() })
        .map_err(|e| match e {
            GpuError::NoSuchDevice { .. } => usage(&e),
            e => e.into(),
        })?;
    let size = args.size.unwrap_or(SIZE);
    check_size(&gpu, size).map_err(|e| usage(&e))?;
    let most = gpu.limits().workgroup_size;
    if args.strip.is_some_and(|[x, y]| x.saturating_mul(y) > most) {
        return Err(usage(&format!("--strip: the device's workgroups have at most {most} invocations")));
    }
    let stop = || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    crate::stop::on_request(stop)?;

    let settings = json!({
        "inputs": args.inputs.iter().map(|i| i.to_string_lossy()).collect::<Vec<_>>(),
        "size": size,
        "strip": args.strip,
        "surface": (args.stream || args.ingest).then(|| args.surface().name()),
        "cell": args.cell,
        "points": args.points,
        "seed": args.seed,
        "truth": args.complete.then_some(args.truth),
        "frames": args.frames,
        "shade": args.stream.then(|| format!("{:?}", args.shade).to_lowercase()),
        "runs": args.stream.then_some(args.runs),
        "device_memory": args.stream.then_some(args.device_memory),
        "host_memory": args.stream.then_some(args.host_memory),
    });
    let mut report = Report::new(&gpu.info().name, &gpu.info().driver, settings);
    problems.look_at(&found);
    let mut harness =
        Harness { args: &args, found: &found, size, cache, gpu: &gpu, report: &mut report, problems };
    let mut result = Ok(());
    if draws {
        result = harness.frames(files.clone());
    }
    // Between parts, too.
    let go_on = |result: anyhow::Result<()>| {
        if STOP.load(Ordering::Relaxed) { result.and(Err(Stopped.into())) } else { result }
    };
    result = go_on(result);
    if args.stream && result.is_ok() {
        result = go_on(harness.stream(files));
    }
    if args.ingest && result.is_ok() {
        result = go_on(harness.ingest());
    }
    if args.load && result.is_ok() {
        result = go_on(harness.load());
    }
    if args.complete && result.is_ok() {
        result = go_on(harness.complete());
    }
    if args.scaling && result.is_ok() {
        result = go_on(harness.scaling());
    }
    #[cfg(feature = "embree")]
    if args.peer && result.is_ok() {
        result = go_on(harness.peer());
    }
    // What was measured before an error or the wish to stop is worth its file.
    report.compare();
    if let Err(error) = &result {
        report.stopped = error.is::<Stopped>();
        problems.blame(&error.to_string());
    }
    // What no part has printed.
    let _ = problems.finish(!args.quiet, &mut std::io::stderr().lock());
    match [&args.json, &args.plot].contains(&&Some(Target::Stdout)) {
        true if args.quiet => {}
        true => eprint!("{}", report.table()),
        false => print(&report.table()).context("cannot write to standard output")?,
    }
    if let Some(to) = &args.json {
        to.write(&report.json()?, &protected)?;
    }
    if let Some(to) = &args.plot
        && (result.is_ok() || !report.rows.is_empty())
    {
        to.write(&plot::svg(&report)?, &protected)?;
    }
    result?;
    let waits: u64 = report.stream.iter().map(|row| row.waits).sum();
    anyhow::ensure!(waits == 0, "frames waited for streaming {waits} times");
    let differ = report.rows.iter().filter_map(|row| row.differ).fold(0.0, f64::max);
    anyhow::ensure!(
        differ <= MOST_DIFFER,
        "pictures of the two pipelines differ in {:.2} % of the pixels",
        100.0 * differ
    );
    Ok(Outcome::Done)
}
