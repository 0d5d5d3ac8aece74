//! Both pipelines along camera paths.

use super::harness::{Harness, STOP};
use super::rows::{pool_row, thesis_row};
use crate::bench;
use crate::bench::frames::{self, FlightOptions};
use crate::bench::report::{Pipeline, Row, Skipped};
use crate::bench::thesis::{Config, Thesis};
use crate::bench::world::World;
use crate::command::UsageError;
use crate::gpu::DeviceKind;
use crate::render::benchmark_path::PathKind;
use crate::render::path::CameraPath;

impl Harness<'_> {
    /// Both pipelines along all paths.
    pub(super) fn frames(&mut self, files: Vec<CameraPath>) -> anyhow::Result<()> {
        let args = self.args;
        let configs = match (args.table, &args.grid[..]) {
            (true, _) => Config::ALL.to_vec(),
            (false, []) => vec![Config { grid: 32, levels: 8 }],
            (false, chosen) => chosen.to_vec(),
        };
        let kinds = match &args.paths[..] {
            [] if files.is_empty() => PathKind::ALL.to_vec(),
            chosen => chosen.to_vec(),
        };
        let (world, base) = self.world(args.cell, args.cell)?;
        let [width, depth] = world.cells();
        self.say(format_args!("{width} x {depth} cells, repeated without end"));
        let files = files.into_iter().map(|path| {
            let placed = path.placed(|v| base.place(v));
            let placed = placed.map_err(|e| UsageError(format!("camera path: {e}")))?;
            if frames::fits(&world, &placed) {
                Ok(placed)
            } else {
                Err(UsageError("camera path: it leads too far from the data".to_owned()))
            }
        });
        let files = files.collect::<Result<Vec<_>, _>>()?;
        for config in configs {
            let mut thesis = self.thesis(config)?;
            let stage = frames::stage(&world, config);
            let built_in = kinds.iter().map(|kind| kind.path(&stage, args.seed));
            let paths = built_in.collect::<Result<Vec<_>, _>>()?;
            let paths: Vec<_> = paths.iter().chain(&files).collect();
            if let (Some(thesis), Some(path)) = (&mut thesis, paths.first()) {
                self.choose_strip(&world, config, path, thesis)?;
            }
            let mut pool_fits = true;
            for path in paths {
                self.fly(&world, config, path, &mut thesis, &mut pool_fits)?;
            }
        }
        Ok(())
    }

    /// One path under one configuration.
    fn fly(
        &mut self,
        world: &World,
        config: Config,
        path: &CameraPath,
        thesis: &mut Option<Thesis>,
        pool_fits: &mut bool,
    ) -> anyhow::Result<()> {
        let args = self.args;
        let Config { grid, levels } = config;
        let name = path.name().unwrap_or("path");
        let frames = args.frames.unwrap_or(path.frames()).min(path.frames());
        let options =
            FlightOptions { size: self.size, frames, rounds: frames::ROUNDS, quiet: args.quiet, stop: &STOP };
        let rays = u64::from(self.size[0]) * u64::from(self.size[1]);
        let strip = thesis.as_ref().map(Thesis::strip);
        let flight = frames::run(self.gpu, world, config, path, *pool_fits, thesis.as_mut(), &options)?;
        let mut rows = Vec::new();
        let mut differ = None;
        if let Some(run) = flight.thesis {
            differ = run.differ;
            rows.push(Row { strip, ..thesis_row(&run, config, name, rays) });
        }
        match flight.pool {
            Some(Ok(run)) => rows.push(Row { differ, ..pool_row(&run, config, name, rays) }),
            Some(Err(error)) if bench::is_too_large(&error) => {
                let reason = format!("{name}: {error}");
                self.say(format_args!("{grid}/{levels} pool: not run: {reason}"));
                self.report.skipped.push(Skipped { grid, levels, pipeline: Pipeline::Pool, reason });
                *pool_fits = false;
            }
            Some(Err(error)) => return Err(error),
            None => {}
        }
        let clock_wanders = self.gpu.info().kind != DeviceKind::Cpu;
        rows.iter_mut().for_each(|row| row.clock_wanders = clock_wanders);
        for row in &rows {
            let [prepare, copy, trace, ..] = row.means().map(|v| v.unwrap_or(f64::NAN));
            let who = row.pipeline.name();
            self.say(format_args!(
                "{grid}/{levels} {name:8} {who:6} prepare {prepare:.3} copy {copy:.3} trace {trace:.3} ms"
            ));
        }
        self.report.rows.extend(rows);
        Ok(())
    }
}
