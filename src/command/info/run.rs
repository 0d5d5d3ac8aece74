//! Runs `lasray info`.

use super::args::Args;
use super::devices::DeviceReport;
use super::gather::gather;
use super::text;
use crate::command::Outcome;
use crate::command::targets::check_targets;
use crate::gpu::list_devices;
use crate::output::{Protected, Signed, Target, print};
use crate::problems::Problems;
use crate::source::inputs;
use crate::text::harmless_lines;
use anyhow::Context;
use serde::Serialize;
use std::io::IsTerminal;

/// The page for people on standard output, and all of it where `--json` says, which may take its place.
fn tell(args: &Args, page: &str, all: &impl Serialize, protected: &Protected) -> anyhow::Result<()> {
    if let Some(to) = &args.json {
        let text = serde_json::to_string_pretty(all).context("cannot write JSON")? + "\n";
        to.write(&text, protected)?;
    }
    match args.json {
        Some(Target::Stdout) => Ok(()),
        // Nothing that a terminal obeys, wherever it came from.
        _ => print(&harmless_lines(page)).context("cannot write to standard output"),
    }
}

/// Columns of the terminal, or as many as `COLUMNS` says; for a file or a program that reads it, nothing is shortened.
fn width() -> Option<usize> {
    /// Of a terminal that does not tell.
    const USUAL: usize = 80;
    let out = std::io::stdout();
    let told = terminal_size::terminal_size_of(&out).map(|(width, _)| width.0.into());
    let said = || std::env::var("COLUMNS").ok()?.trim().parse().ok();
    told.or_else(said).filter(|&width| width > 0).or(out.is_terminal().then_some(USUAL))
}

/// Runs `lasray info`. [`Outcome::Incomplete`] where nothing could be read, or an input failed with
/// `--strict`.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    let found = inputs::expand(&args.inputs);
    let protected = Protected::of(&found);
    check_targets(&protected, [], args.json.iter().map(|to| ("--json", to)))?;
    if args.devices {
        let devices = list_devices()?;
        let page: String = devices.iter().map(|device| format!("{device}\n")).collect();
        let all: Vec<_> = devices.iter().map(DeviceReport::of).map(Signed::new).collect();
        tell(&args, &page, &all, &protected)?;
        return Ok(Outcome::Done);
    }
    let report = gather(&args, &found, problems);
    // A closed stderr is nothing to stop for.
    let _ = problems.finish(false, &mut std::io::stderr().lock());
    tell(&args, &text::page(&report, width()), &Signed::new(&report), &protected)?;
    let failed = args.strict && problems.failed;
    Ok(if failed || report.files.is_empty() { Outcome::Incomplete } else { Outcome::Done })
}
