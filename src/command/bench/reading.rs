//! Time until all is loaded, and reading and binning beside decoding alone.

use super::harness::{Harness, STOP};
use crate::bench::ground::{self, GroundOptions};
use crate::bench::ingest::{self, IngestOptions};
use crate::bench::load as loading;
use crate::bench::towns::{Set, Towns};
use crate::command::outcome::usage_of_load;
use crate::load::{self, LoadOptions};
use crate::synth;
use std::path::PathBuf;

/// Points of a file that is read.
pub(super) const INGEST_POINTS: u64 = 20_000_000;

/// Points of a file that is loaded.
const LOAD_POINTS: u64 = 4_000_000;

/// Runs that figures of loading and of scaling are medians of.
pub(super) const LOAD_RUNS: u32 = 3;

impl Harness<'_> {
    /// The files that were named; without any one of the town, kept as long as `towns` is.
    fn files_or_town(&self, towns: &mut Towns) -> anyhow::Result<Vec<PathBuf>> {
        let files = self.files()?;
        if !files.is_empty() {
            return Ok(files);
        }
        let set = self.town(self.args.points.unwrap_or(LOAD_POINTS));
        let made = towns.files(&[set], &mut |what| self.say(format_args!("{what}")))?;
        Ok(made.into_iter().flatten().collect())
    }

    /// The thesis' loading and ours.
    pub(super) fn load(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let mut towns = self.towns();
        let files = self.files_or_town(&mut towns)?;
        let threads = if args.threads.is_empty() { vec![load::threads() as u32] } else { self.threads() };
        for file in files {
            let mut say = |what: &str| self.say(format_args!("{what}"));
            let rows = loading::run(self.gpu, &file, args.cell, LOAD_RUNS, &threads, &mut say, &STOP)?;
            self.report.load.extend(rows);
            self.check()?;
        }
        Ok(())
    }

    /// The ground of unclassified points.
    pub(super) fn complete(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let mut towns = self.towns();
        let files = self.files_or_town(&mut towns)?;
        let options = LoadOptions { cell: Some(args.cell.into()), ..args.load_options() };
        let opening = load::open(&files, &options, self.problems).map_err(usage_of_load)?;
        let options = GroundOptions { truth: args.truth, threads: load::threads() as u32, runs: LOAD_RUNS };
        let row = ground::run(opening, &options, &mut |what| self.say(format_args!("{what}")), &STOP)?;
        self.report.ground.push(row);
        Ok(())
    }

    /// A town in one file.
    fn town(&self, points: u64) -> Set {
        Set {
            name: "town",
            format: synth::Format::Three,
            compress: false,
            is_tiled: false,
            seed: self.args.seed,
            points,
        }
    }

    pub(super) fn ingest_options(&self) -> anyhow::Result<IngestOptions> {
        let args = self.args;
        Ok(IngestOptions {
            seed: args.seed,
            points: args.points.unwrap_or(INGEST_POINTS),
            kept: self.cache.clone(),
            quiet: args.quiet,
            files: self.files()?,
            surface: args.surface(),
            cell: Some(args.cell),
            ..IngestOptions::default()
        })
    }

    /// Reading and binning.
    pub(super) fn ingest(&mut self) -> anyhow::Result<()> {
        let mut options = self.ingest_options()?;
        if !self.args.threads.is_empty() {
            options.threads = self.threads();
        }
        let mut rows = Vec::new();
        let result = ingest::run(&options, &mut |what| self.say(format_args!("{what}")), &STOP, &mut rows);
        self.report.ingest = rows;
        result
    }
}
