//! `lasray bench`: the timing harness.

use super::Outcome;
use crate::attribute::{ClassMask, ColorMode, ColorTable};
use crate::bench::frames::{self, Options};
use crate::bench::thesis::{Config, Thesis};
use crate::bench::world::World;
use crate::gpu::{Gpu, GpuOptions};
use crate::load::{self, LoadOptions};
use crate::problems::Problems;
use crate::render::path::PathKind;
use crate::source::placement::PlacementOptions;
use crate::stream::bins::Budget;
use crate::stream::scene::Visibility;
use std::ffi::OsString;

/// Arguments of `lasray bench`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Files, folders, @lists and patterns; none: a synthetic town
    #[arg(value_name = "INPUT")]
    inputs: Vec<OsString>,
    /// Configurations GRID/LEVELS
    #[arg(long, default_value = "32/8", value_delimiter = ',')]
    grid: Vec<String>,
    /// Frames of each path
    #[arg(long, default_value_t = 12)]
    frames: u32,
    /// Paths
    #[arg(long, value_delimiter = ',')]
    paths: Vec<PathKind>,
    /// Strip
    #[arg(long, default_value = "1x64")]
    strip: String,
    /// Pixels
    #[arg(long, default_value = "640x360")]
    size: String,
    /// Cell
    #[arg(long, default_value_t = 0.25)]
    cell: f64,
}

/// Runs it.
pub fn run(args: Args) -> anyhow::Result<Outcome> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let pair = |s: &str, by: char| {
        let (a, b) = s.split_once(by).expect("a pair");
        [a.parse::<u32>().expect("a number"), b.parse().expect("a number")]
    };
    let options = LoadOptions {
        cell: Some(args.cell),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        budget: Budget { host_bytes: 16 << 30, device_bytes: 64 << 30 },
        quiet: false,
    };
    let mut problems = Problems::default();
    let loaded = if args.inputs.is_empty() {
        load::demo(&options, &mut problems)?
    } else {
        load::files(&args.inputs, &options, &mut problems)?
    };
    let colors = ColorTable::new(ColorMode::auto(&loaded.summary), &loaded.summary, None, None)?;
    let world =
        World::new(loaded, Visibility { classes: ClassMask::default(), withheld: false, bridge: 0 }, colors);
    eprintln!("world {:?} cells", world.cells());
    let size = pair(&args.size, 'x');
    for grid in &args.grid {
        let [grid, levels] = pair(grid, '/');
        let config = Config { grid, levels };
        let mut thesis = Thesis::new(&gpu, config, size, pair(&args.strip, 'x'))?;
        for kind in PathKind::ALL {
            if !args.paths.is_empty() && !args.paths.contains(&kind) {
                continue;
            }
            let options = Options { size, frames: args.frames, seed: 1 };
            let run = frames::run(&gpu, &world, config, kind, &mut thesis, &options)?;
            let median = |v: &[crate::bench::FrameTimes], f: fn(&crate::bench::FrameTimes) -> f64| {
                let mut v: Vec<_> = v.iter().map(f).collect();
                v.sort_by(f64::total_cmp);
                v[v.len() / 2]
            };
            let mean = |v: &[crate::bench::FrameTimes], f: fn(&crate::bench::FrameTimes) -> f64| {
                v.iter().map(f).sum::<f64>() / v.len() as f64
            };
            println!(
                "{grid}/{levels} {:8} thesis prep {:6.2} copy {:6.2} trace {:6.2} | pool prep {:6.3} copy {:6.3} trace {:6.2} wall {:6.2} table {:.3} wait {:.3} | ratio {:.2} bytes 1/{:.0} missing {} differ {:.5}",
                kind.name(),
                mean(&run.thesis, |t| t.prepare_ms),
                mean(&run.thesis, |t| t.copy_ms),
                median(&run.thesis, |t| t.trace_ms),
                mean(&run.stream, |t| t.prepare_ms),
                mean(&run.stream, |t| t.copy_ms),
                median(&run.pool, |t| t.trace_ms),
                median(&run.pool, |t| t.trace_wall_ms),
                mean(&run.pool, |t| t.table_ms),
                mean(&run.stream, |t| t.wait_ms),
                median(&run.thesis, |t| t.trace_ms) / median(&run.pool, |t| t.trace_ms),
                mean(&run.thesis, |t| t.copy_bytes as f64) / mean(&run.stream, |t| t.copy_bytes as f64),
                run.missing,
                run.differ,
            );
        }
    }
    Ok(Outcome::Done)
}
