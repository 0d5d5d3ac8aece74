//! What every part of the benchmark shares: arguments, device, report; data, and the pipeline of the thesis.

use super::args::{Args, Threads};
use crate::bench::frames;
use crate::bench::report::{Pipeline, Report, Skipped};
use crate::bench::thesis::{Config, STRIPS, Thesis};
use crate::bench::towns::Towns;
use crate::bench::world::{self, TOWN_POINTS, World};
use crate::bench::{self, Stopped};
use crate::command::outcome::usage_of_load;
use crate::gpu::Gpu;
use crate::load::{self, LoadOptions};
use crate::problems::Problems;
use crate::render::path::CameraPath;
use crate::source::inputs::Inputs;
use crate::source::placement::Fit;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

pub(super) static STOP: AtomicBool = AtomicBool::new(false);

/// What the inputs hold, or a town, in cells of `cell`.
fn world(
    args: &Args,
    found: &Inputs,
    [cell, widest]: [f64; 2],
    problems: &mut Problems,
) -> anyhow::Result<(World, Fit)> {
    let options = LoadOptions { cell: Some(cell.into()), ..args.load_options() };
    let loaded = if args.inputs.is_empty() {
        let points = args.points.unwrap_or(TOWN_POINTS);
        world::town(args.seed, points, [args.cell, widest], &options, problems)
    } else {
        load::paths(&found.files, &options, problems)
    };
    let _ = problems.finish(!args.quiet, &mut std::io::stderr().lock());
    let loaded = loaded.map_err(usage_of_load)?;
    let base = loaded.about.base;
    Ok((World::of(loaded)?, base))
}

/// What is run, and where it is written down.
pub(super) struct Harness<'a> {
    pub(super) args: &'a Args,
    pub(super) found: &'a Inputs,
    pub(super) size: [u32; 2],
    /// The user's cache folder, if it is to be used.
    pub(super) cache: Option<PathBuf>,
    pub(super) gpu: &'a Gpu,
    pub(super) report: &'a mut Report,
    pub(super) problems: &'a mut Problems,
}

impl Harness<'_> {
    pub(super) fn say(&self, what: std::fmt::Arguments) {
        if !self.args.quiet {
            eprintln!("{what}");
        }
    }

    /// An error once the program was asked to end.
    pub(super) fn check(&self) -> Result<(), Stopped> {
        if STOP.load(Ordering::Relaxed) { Err(Stopped) } else { Ok(()) }
    }

    pub(super) fn world(&mut self, cell: f64, widest: f64) -> anyhow::Result<(World, Fit)> {
        let world = world(self.args, self.found, [cell, widest], self.problems)?;
        self.check()?;
        Ok(world)
    }

    /// The pipeline of the thesis; `None`: too large, which is written down.
    pub(super) fn thesis(&mut self, config: Config) -> anyhow::Result<Option<Thesis>> {
        let Config { grid, levels } = config;
        // Sections, the mapped buffer, and, where the device's memory is the host's, what is copied from it.
        let need = Thesis::host_bytes(config) + 2 * config.bytes();
        let reason = match bench::free_bytes() {
            Some(free) if need > free => format!("it needs {need} bytes of host memory, {free} are free"),
            _ => match Thesis::new(self.gpu, config, self.size, self.args.strip.unwrap_or(STRIPS[0])) {
                Ok(thesis) => return Ok(Some(thesis)),
                Err(error) => {
                    let error = anyhow::Error::from(error);
                    if !bench::is_too_large(&error) {
                        return Err(error);
                    }
                    error.to_string()
                }
            },
        };
        self.say(format_args!("{grid}/{levels} thesis: not run: {reason}"));
        self.report.skipped.push(Skipped { grid, levels, pipeline: Pipeline::Thesis, reason });
        Ok(None)
    }

    /// Without `--strip`: the fastest one.
    pub(super) fn choose_strip(
        &self,
        world: &World,
        config: Config,
        path: &CameraPath,
        thesis: &mut Thesis,
    ) -> anyhow::Result<()> {
        if self.args.strip.is_some() {
            return Ok(());
        }
        let most = self.gpu.limits().workgroup_size;
        let strips: Vec<_> = STRIPS.into_iter().filter(|[x, y]| x * y <= most).collect();
        let best = frames::best_strip(self.gpu, world, config, path, thesis, self.size, &strips)?;
        if let Some([x, y]) = best {
            self.say(format_args!("{}/{} thesis: strips of {x}x{y}", config.grid, config.levels));
        }
        Ok(())
    }

    /// The inputs one by one.
    pub(super) fn files(&self) -> anyhow::Result<Vec<PathBuf>> {
        match self.found.failed.first() {
            Some(_) => anyhow::bail!("an input cannot be used: files are timed all or none"),
            None => Ok(self.found.files.clone()),
        }
    }

    /// Numbers of threads that were asked for, each once.
    pub(super) fn threads(&self) -> Vec<u32> {
        let mut threads = Vec::new();
        for &Threads(number) in &self.args.threads {
            if !threads.contains(&number) {
                threads.push(number);
            }
        }
        threads
    }

    /// Files that are made.
    pub(super) fn towns(&self) -> Towns<'static> {
        Towns::new(self.cache.as_deref(), self.args.quiet, &STOP)
    }
}
