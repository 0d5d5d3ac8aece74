//! What four times the cells under the same image cost, and four times the points.

use super::harness::{Harness, STOP};
use super::reading::{INGEST_POINTS, LOAD_RUNS};
use super::rows::{is_warm, trace_ms};
use crate::bench::FrameTimes;
use crate::bench::frames::{self, FlightOptions, Traced};
use crate::bench::ingest::{self, IngestOptions};
use crate::bench::report::{Pipeline, ScalingRow, Stat};
use crate::bench::steady::Repeats;
use crate::bench::thesis::Config;
use crate::load;
use crate::render::benchmark_path::PathKind;
use crate::section::Surface;

/// Frames of a path that scaling is measured by, and the paths.
const SCALING_FRAMES: u32 = 30;

/// Times that they are drawn, a part of them each.
const SCALING_ROUNDS: u32 = 3;

const SCALING_PATHS: [PathKind; 3] = [PathKind::Rest, PathKind::Turn, PathKind::Grazing];

impl Harness<'_> {
    /// Cells of twice the side and of `--cell`: the same data, the same window in units, the same cameras. Then
    /// files of a quarter of the points and of all, where no files are given.
    pub(super) fn scaling(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let fine = args.grid.first().copied().unwrap_or(Config { grid: 32, levels: 8 });
        let coarse = Config { levels: fine.levels - 1, ..fine };
        let kinds = if args.paths.is_empty() { &SCALING_PATHS[..] } else { &args.paths };
        let frames = args.frames.unwrap_or(SCALING_FRAMES);
        let frames = frames.div_ceil(SCALING_ROUNDS);
        let options = FlightOptions { size: self.size, frames, rounds: 1, quiet: args.quiet, stop: &STOP };
        let mut sides = Vec::new();
        for (config, cell) in [(coarse, 2.0 * args.cell), (fine, args.cell)] {
            let (world, _) = self.world(cell, 2.0 * args.cell)?;
            sides.push((world, config, self.thesis(config)?));
        }
        let stage = frames::stage(&sides[0].0, coarse);
        let paths: Vec<_> =
            kinds.iter().map(|kind| kind.path(&stage, args.seed)).collect::<Result<_, _>>()?;
        for (world, config, thesis) in &mut sides {
            if let (Some(thesis), Some(path)) = (thesis, paths.first()) {
                self.choose_strip(world, *config, path, thesis)?;
            }
        }
        let cells = [coarse, fine].map(|config| f64::from(config.side()).powi(2));
        // In turn, so that what else the machine does is the same for both.
        for path in &paths {
            // [thesis, pool], coarse and fine: of each frame, and of all frames of a round.
            let mut times = [const { [const { Vec::new() }; 2] }; 2];
            let mut rounds: [[Repeats; 2]; 2] = Default::default();
            let mut add = |pipeline: usize, step: usize, traced: &Traced, drawn: &[FrameTimes]| {
                let ms = trace_ms(traced, drawn);
                rounds[pipeline][step].push(ms.iter().sum(), is_warm(traced));
                times[pipeline][step].extend(ms);
            };
            for round in 1..=SCALING_ROUNDS {
                self.say(format_args!(
                    "scaling: {}, {round} of {SCALING_ROUNDS}",
                    path.name().unwrap_or("path")
                ));
                // A short film: what streams in meanwhile is not asked for.
                for (step, (world, config, thesis)) in sides.iter_mut().enumerate() {
                    let flight =
                        frames::run(self.gpu, world, *config, path, true, thesis.as_mut(), &options)?;
                    if let Some(pool) = flight.pool {
                        let pool = pool?;
                        add(1, step, &pool.traced, &pool.drawn);
                    }
                    if let Some(thesis) = flight.thesis {
                        add(0, step, &thesis.traced, &thesis.drawn);
                    }
                }
            }
            for ((pipeline, times), [coarse, fine]) in
                [Pipeline::Thesis, Pipeline::Pool].into_iter().zip(times).zip(rounds)
            {
                let medians = times.map(|times| Stat::of(times).map(|stat| stat.median));
                let [Some(less), Some(more)] = medians else { continue };
                self.report.scaling.push(ScalingRow {
                    what: format!("trace, {}, {}", pipeline.name(), path.name().unwrap_or("path")),
                    of: "cells".to_owned(),
                    amount: cells,
                    ms: [less, more],
                    spreads: [coarse.spread(), fine.spread()],
                    ratio: fine.ratio_to(&coarse),
                });
            }
        }
        if args.inputs.is_empty() { self.scaling_of_points() } else { Ok(()) }
    }

    /// Files of a quarter of the points and of all.
    fn scaling_of_points(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let all = args.points.unwrap_or(INGEST_POINTS);
        let mut read = Vec::new();
        for points in [(all / 4).max(1), all] {
            let options = IngestOptions {
                points,
                files: Vec::new(),
                surface: Surface::Columns,
                cold: false,
                runs: LOAD_RUNS,
                threads: vec![load::threads() as u32],
                ..self.ingest_options()?
            };
            let mut rows = Vec::new();
            ingest::run(&options, &mut |what| self.say(format_args!("{what}")), &STOP, &mut rows)?;
            read.push(rows);
        }
        for (less, more) in read[0].iter().zip(&read[1]) {
            let rows = [less, more];
            let ms = rows.map(|row| row.points as f64 / row.total_mpts_s / 1e3);
            self.report.scaling.push(ScalingRow {
                what: format!("read and binned, {}, {} threads", less.file, less.threads),
                of: "points".to_owned(),
                amount: rows.map(|row| row.points as f64),
                ms,
                spreads: [None; 2],
                ratio: Some(ms[1] / ms[0]),
            });
        }
        Ok(())
    }
}
