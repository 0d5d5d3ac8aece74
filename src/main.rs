//! `lasray`: parse, run, exit code.

#[cfg(feature = "view")]
use clap::CommandFactory;
use lasray::cli::{self, Cli, Command};
use lasray::command::{self, Outcome, UsageError};
use lasray::problems::Problems;
use lasray::text::harmless_lines;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

/// Nothing could be drawn, or an input failed and `--strict` was given.
const FAILED: u8 = 1;
/// Wrong arguments.
const USAGE: u8 = 2;

fn main() -> ExitCode {
    // Ends the process where the words are wrong, with code 2, or where help was asked for, with 0.
    let cli = match Cli::of(cli::words(std::env::args_os())) {
        Ok(cli) => cli,
        Err(error) => {
            eprintln!("lasray: {}", harmless_lines(&error.to_string()));
            return ExitCode::from(USAGE);
        }
    };
    let filter = EnvFilter::try_from_env("LASRAY_LOG").unwrap_or_else(|_| EnvFilter::new("error"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time().init();
    let problems = &mut Problems::default();
    let mut has_strict = true;
    let result = match cli.command {
        #[cfg(feature = "view")]
        Command::View(args) => {
            has_strict = false;
            command::view::run(*args, problems)
        }
        Command::Render(args) => command::render::run(*args, problems),
        Command::Bench(args) => {
            has_strict = false;
            command::bench::run(*args, problems)
        }
        Command::Info(args) => command::info::run(*args, problems),
        Command::Synth(args) => command::synth::run(args).map(|()| Outcome::Done),
    };
    let (code, is_error) = match result {
        Ok(Outcome::Done) => (0, false),
        Ok(Outcome::Incomplete) => (FAILED, true),
        #[cfg(feature = "view")]
        Err(error) if std::env::args_os().len() < 2 && error.is::<lasray::view::NoWindow>() => {
            // Where no window can be opened, the name alone asks how to go on.
            eprint!("{}", Cli::command().render_help());
            (USAGE, true)
        }
        Err(error) => {
            // Messages hold their causes already.
            eprintln!("lasray: {}", harmless_lines(&error.to_string()));
            let usage = error.is::<UsageError>() || error.is::<command::synth::PlanError>();
            (if usage { USAGE } else { FAILED }, true)
        }
    };
    if let Some(count) = problems.count() {
        let strict = if has_strict && !is_error { ", --strict fails on that" } else { "" };
        eprintln!("{count}{strict}");
    }
    ExitCode::from(code)
}
