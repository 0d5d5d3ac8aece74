//! Frames while files stream in, beside the same frames with everything there.

use super::args::TownKind;
use super::harness::{Harness, STOP};
use crate::bench::stream;
use crate::bench::towns::Set;
use crate::command::UsageError;
use crate::command::outcome::usage_of_load;
use crate::load::LoadOptions;
use crate::render::path::CameraPath;
use crate::synth;
use std::path::Path;

/// Points of each town that is streamed.
const STREAM_POINTS: u64 = 20_000_000;

/// Frames of a path that is streamed.
const STREAM_FRAMES: u32 = 120;

impl Harness<'_> {
    /// Frames while files stream in, and with everything there.
    pub(super) fn stream(&mut self, files: Vec<CameraPath>) -> anyhow::Result<()> {
        let args = self.args;
        let options = stream::StreamOptions {
            size: self.size,
            frames: args.frames.unwrap_or(STREAM_FRAMES),
            runs: args.runs,
            shade: args.shade,
            device_bytes: self.gpu.bytes_for_sections(args.device_memory),
            host_bytes: args.host_memory,
            load: LoadOptions { surface: args.surface(), quiet: true, ..args.load_options() },
            quiet: args.quiet,
            stop: &STOP,
        };
        let kinds = match &args.paths[..] {
            [] if files.is_empty() => &stream::PATHS[..],
            chosen => chosen,
        };
        let mut towns = self.towns();
        let mut data = Vec::new();
        match &args.inputs[..] {
            [] => {
                let points = args.points.unwrap_or(STREAM_POINTS);
                let set = |kind: &TownKind| Set {
                    name: "town",
                    format: synth::Format::Seven,
                    compress: *kind == TownKind::Laz,
                    is_tiled: true,
                    seed: args.seed,
                    points,
                };
                let sets: Vec<_> = args.format.iter().map(set).collect();
                let files = towns.files(&sets, &mut |what| self.say(format_args!("{what}")))?;
                data.extend(args.format.iter().map(|kind| kind.name().to_owned()).zip(files));
            }
            inputs => {
                let name = Path::new(&inputs[0]).file_stem().unwrap_or_default();
                data.push((name.to_string_lossy().into_owned(), self.files()?));
            }
        }
        for (name, inputs) in data {
            let case = stream::StreamCase::open(self.gpu, name, inputs, &options, self.problems);
            let _ = self.problems.finish(!args.quiet, &mut std::io::stderr().lock());
            let mut case = case.map_err(|error| match error.downcast() {
                Ok(error) => usage_of_load(error),
                Err(error) => error,
            })?;
            let mut paths = Vec::new();
            for &kind in kinds {
                paths.push(case.path(kind, args.seed)?);
            }
            for path in &files {
                let placed = path.placed(|v| case.base().place(v));
                paths.push(placed.map_err(|e| UsageError(format!("camera path: {e}")))?);
            }
            self.say(format_args!("{} points, compiling", case.points()));
            let first = paths[0].camera(0)?;
            case.warm_up(&first)?;
            for path in &paths {
                let row = case.fly(path, &mut |what| self.say(format_args!("{what}")))?;
                self.say(format_args!(
                    "{} {}: p95 {:.1} ms streaming, {:.1} ms resident; {} waits",
                    row.data, row.path, row.streaming.frame_ms.p95, row.resident.frame_ms.p95, row.waits
                ));
                self.report.stream.push(row);
                self.check()?;
            }
            let row = case.switch(&paths[0], &mut |what| self.say(format_args!("{what}")))?;
            self.say(format_args!(
                "{}: other classes in {:.0} ms; frames p95 {:.2} x meanwhile",
                row.data, row.took_ms.median, row.ratios.p95
            ));
            self.report.layers.push(row);
            self.check()?;
            case.take_errors().iter().for_each(|error| self.problems.error(error));
        }
        Ok(())
    }
}
