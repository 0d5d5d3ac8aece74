//! The command line of `lasray info`.

use crate::command::placement::PlacementArgs;
use crate::output::Target;
use std::path::PathBuf;

/// Arguments of `lasray info`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Files, folders, @list.txt, patterns
    #[arg(required_unless_present = "devices", value_name = "INPUT")]
    pub(super) inputs: Vec<PathBuf>,
    /// List the Vulkan devices, with what each lacks
    #[arg(long, conflicts_with = "inputs")]
    pub(super) devices: bool,
    /// Read every point: classes, ranges of all attributes, true bounds
    #[arg(long)]
    pub(super) scan: bool,
    /// Write all of it there, for programs; -: to standard output, in the place of the page for people
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<Target>,
    #[command(flatten)]
    pub(super) placement: PlacementArgs,
    /// Exit code 1 if any input fails
    #[arg(long)]
    pub(super) strict: bool,
    /// No progress
    #[arg(short, long)]
    pub(super) quiet: bool,
}
