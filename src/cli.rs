//! The command line.

use crate::command;
use clap::{Parser, Subcommand};

/// Opens raw airborne LiDAR (LAS, LAZ, COPC) and ray-traces it on any Vulkan GPU
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, max_term_width = 100, after_help = EXAMPLES)]
pub struct Cli {
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

const EXAMPLES: &str = "\
Examples:
  lasray render tiles/ -o city.png                    the whole folder, framed, in its own colours
  lasray render tiles/ -o map.png --ortho 0.25        a map from above, with world file
  lasray render a.laz --orbit 45,20 --hide 3,4,5 -o bare.png
  lasray info tiles/ --scan                           what is in the files
  lasray synth town/ --points 20M --tiles 2x2         a town to try things with
";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Draw a picture: PNG for people, EXR with distances, heights and classes for programs
    Render(Box<command::render::Args>),
    /// What is in the files, and how they would be drawn
    Info(command::info::Args),
    /// Time copy, prepare and trace beside the pipeline of the thesis
    Bench(Box<command::bench::Args>),
    /// Write the scan of a town that does not exist, with known geometry
    Synth(command::synth::Args),
}
