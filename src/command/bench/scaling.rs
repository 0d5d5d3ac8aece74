//! What four times the cells under the same image cost, and four times the points.

use super::harness::{Harness, STOP};
use super::reading::{INGEST_POINTS, LOAD_RUNS};
use super::rows::trace_ms;
use crate::bench::frames::{self, FlightOptions};
use crate::bench::ingest::{self, IngestOptions};
use crate::bench::report::{Pipeline, ScalingRow, Stat};
use crate::bench::thesis::Config;
use crate::load;
use crate::render::path::PathKind;

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
            // [thesis, pool], coarse and fine.
            let mut times = [const { [const { Vec::new() }; 2] }; 2];
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
                        times[1][step].extend(trace_ms(&pool.traced, &pool.drawn));
                    }
                    if let Some(thesis) = flight.thesis {
                        times[0][step].extend(trace_ms(&thesis.traced, &thesis.drawn));
                    }
                }
            }
            for (pipeline, times) in [Pipeline::Thesis, Pipeline::Pool].into_iter().zip(times) {
                let medians = times.map(|times| Stat::of(times).map(|stat| stat.median));
                let [Some(less), Some(more)] = medians else { continue };
                self.report.scaling.push(ScalingRow {
                    what: format!("trace, {}, {}", pipeline.name(), path.name().unwrap_or("path")),
                    of: "cells".to_owned(),
                    amount: cells,
                    ms: [less, more],
                    ratio: more / less,
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
                ratio: ms[1] / ms[0],
            });
        }
        Ok(())
    }
}
