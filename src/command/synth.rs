//! `lasray synth`: writes the scan of a town that does not exist, with known geometry, as LAS or LAZ.

use super::values::count;
use crate::synth::{Format, ORIGIN, SynthError, Tile, Town, is_made_here, write_tile};
use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Arguments of `lasray synth`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// File to write (.las or .laz), or a folder for tiles (tile_E_N.laz)
    out: PathBuf,
    /// Points in all; 500k and 2M are understood
    #[arg(long, default_value = "2M", value_parser = count)]
    points: u64,
    /// Columns and rows of tiles
    #[arg(long, default_value = "1x1", value_name = "CxR", value_parser = grid)]
    tiles: [u32; 2],
    /// Points per square metre; sets the size of a tile
    #[arg(long, default_value_t = 8.0, value_name = "PER_M2")]
    density: f64,
    /// Side of a tile in metres, instead of a density
    #[arg(long, value_name = "METRES", conflicts_with = "density")]
    size: Option<u32>,
    /// Which town
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Point format: 3 (LAS 1.2) or 7 (LAS 1.4)
    #[arg(long, default_value = "7", value_parser = format)]
    format: Format,
    /// Write tiles as .las, not .laz
    #[arg(long)]
    las: bool,
    /// Write over files that lasray synth has made, and over nothing else
    #[arg(long)]
    force: bool,
    /// Tiles written at a time [default: one a core]
    #[arg(long)]
    threads: Option<usize>,
    /// No progress, no summary
    #[arg(short, long)]
    quiet: bool,
}

/// Arguments that do not go together.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Several tiles, one file.
    #[error("{}: {tiles} tiles need a folder, not a file", out.display())]
    NotAFolder {
        /// The output that was asked for.
        out: PathBuf,
        /// Tiles that were asked for.
        tiles: u64,
    },
    /// `--las` for a .laz file.
    #[error("{}: --las contradicts the file's name", out.display())]
    Contradiction {
        /// The output that was asked for.
        out: PathBuf,
    },
    /// Fewer points than tiles.
    #[error("{points} points are too few for {tiles} tiles")]
    TooFewPoints {
        /// Points that were asked for.
        points: u64,
        /// Tiles that were asked for.
        tiles: u64,
    },
    /// Files of those names are there.
    #[error(
        "{}{}: refused: {}: give another name{}",
        path.display(),
        if *others > 0 { format!(" (and {others} more)") } else { String::new() },
        if *ours { "a file of that name is there" } else { "the file there was not made by `lasray synth`" },
        if *ours { ", or --force to make it anew" } else { "" }
    )]
    Taken {
        /// The first of them.
        path: PathBuf,
        /// How many others.
        others: usize,
        /// It was made by this command before.
        ours: bool,
    },
    /// Not a density.
    #[error("a density of {0} points per square metre: expected a number from 0.001 to 100000")]
    Density(f64),
    /// A tile has no area, or they reach beyond what coordinates in millimetres can say.
    #[error("tiles of {side} m: expected 1 m or more, and less than 4000 km in all")]
    Size {
        /// Side of a tile, m.
        side: f64,
    },
}

/// `4x3`: columns and rows, each 1 to 1000.
fn grid(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once(['x', 'X']).and_then(|(columns, rows)| {
        let side = |s: &str| s.parse().ok().filter(|n| (1..=1000).contains(n));
        Some([side(columns)?, side(rows)?])
    });
    parsed.ok_or_else(|| format!("'{text}' is not columns x rows such as 4x3, each 1 to 1000"))
}

fn format(text: &str) -> Result<Format, String> {
    match text {
        "3" => Ok(Format::Three),
        "7" => Ok(Format::Seven),
        _ => Err(format!("format '{text}': only 3 (LAS 1.2) and 7 (LAS 1.4) can be written")),
    }
}

/// The tiles to write, and where each goes.
#[derive(Debug, PartialEq)]
struct Plan {
    tiles: Vec<(Tile, PathBuf)>,
    compress: bool,
    /// A folder to make first.
    folder: Option<PathBuf>,
}

impl Plan {
    fn new(args: &Args) -> Result<Plan, PlanError> {
        let [columns, rows] = args.tiles.map(u64::from);
        let tiles = columns * rows;
        if args.points < tiles {
            return Err(PlanError::TooFewPoints { points: args.points, tiles });
        }
        let side = match args.size {
            Some(side) => f64::from(side),
            None if (1e-3..=1e5).contains(&args.density) => {
                // Whole metres, so that names say exactly where a tile is.
                (args.points as f64 / tiles as f64 / args.density).sqrt().round().max(1.0)
            }
            None => return Err(PlanError::Density(args.density)),
        };
        if side < 1.0 || side * columns.max(rows) as f64 > 4e6 {
            return Err(PlanError::Size { side });
        }
        let extension = args.out.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let (is_file, mut compress) = match extension.as_deref() {
            Some("las") => (!args.out.is_dir(), false),
            Some("laz") => (!args.out.is_dir(), true),
            _ => (false, !args.las),
        };
        if is_file && tiles > 1 {
            return Err(PlanError::NotAFolder { out: args.out.clone(), tiles });
        }
        if is_file && compress && args.las {
            return Err(PlanError::Contradiction { out: args.out.clone() });
        }
        if !is_file {
            compress = !args.las;
        }
        let suffix = if compress { "laz" } else { "las" };
        let west = -(columns as f64 * side / 2.0).floor();
        let south = -(rows as f64 * side / 2.0).floor();
        let tiles = (0..tiles).map(|index| {
            let (column, row) = (index % columns, index / columns);
            let corner = [west + column as f64 * side, south + row as f64 * side];
            // The first tiles take what does not divide evenly.
            let points = args.points / tiles + u64::from(index < args.points % tiles);
            let path = if is_file {
                args.out.clone()
            } else {
                let [e, n] = [corner[0] + ORIGIN[0], corner[1] + ORIGIN[1]];
                args.out.join(format!("tile_{e:.0}_{n:.0}.{suffix}"))
            };
            (Tile { corner, size: [side; 2], points }, path)
        });
        let tiles = tiles.collect();
        Ok(Plan { tiles, compress, folder: (!is_file).then(|| args.out.clone()) })
    }

    /// Whether nothing is in the way; with `force` what this command has made before is not.
    fn check(&self, force: bool) -> Result<(), PlanError> {
        let there = self.tiles.iter().filter_map(|(_, path)| Some((path, is_made_here(path)?)));
        let mut in_the_way: Vec<_> = there.filter(|(_, ours)| !(force && *ours)).collect();
        // What is never written over first.
        in_the_way.sort_by_key(|(_, ours)| *ours);
        match in_the_way.first() {
            None => Ok(()),
            Some(&(path, ours)) => {
                Err(PlanError::Taken { path: path.clone(), others: in_the_way.len() - 1, ours })
            }
        }
    }
}

/// Writes what `args` ask for, several tiles at a time.
///
/// # Errors
/// [`PlanError`] for arguments that do not go together, [`SynthError`] for a file that cannot be written; files that
/// were complete by then stay, nothing half-written does.
pub fn run(args: Args) -> anyhow::Result<()> {
    let plan = Plan::new(&args)?;
    plan.check(args.force)?;
    if let Some(folder) = &plan.folder {
        std::fs::create_dir_all(folder)
            .map_err(|e| anyhow::anyhow!("{}: cannot make the folder: {e}", folder.display()))?;
    }
    static STOP: AtomicBool = AtomicBool::new(false);
    crate::stop::on_request(|| STOP.store(true, Ordering::Relaxed))?;

    let bar = if args.quiet { ProgressBar::hidden() } else { ProgressBar::new(args.points) };
    let style = "{bar:30} {human_pos}/{human_len} points, {per_sec}, {eta} left";
    bar.set_style(ProgressStyle::with_template(style).context("progress bar")?);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.unwrap_or(cores).clamp(1, plan.tiles.len());
    write_all(&Town::new(args.seed), &plan, args.format, threads, &STOP, |points| bar.inc(points))?;
    bar.finish_and_clear();
    if !args.quiet {
        let bytes: u64 =
            plan.tiles.iter().filter_map(|(_, path)| path.metadata().ok()).map(|m| m.len()).sum();
        let files = if plan.tiles.len() == 1 { "file" } else { "files" };
        eprintln!(
            "{}: {} {files}, {} points, {:.1} MB",
            args.out.display(),
            plan.tiles.len(),
            args.points,
            bytes as f64 / 1e6
        );
    }
    Ok(())
}

fn write_all(
    town: &Town,
    plan: &Plan,
    format: Format,
    threads: usize,
    stop: &AtomicBool,
    progress: impl Fn(u64) + Sync,
) -> Result<(), SynthError> {
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((tile, path)) = plan.tiles.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let written = write_tile(town, tile, path, format, plan.compress, stop, &progress);
                    if let Err(error) = written {
                        // The others stop too; what they say of it is of no interest.
                        stop.store(true, Ordering::Relaxed);
                        failure.lock().unwrap_or_else(|e| e.into_inner()).get_or_insert(error);
                        return;
                    }
                }
            });
        }
    });
    failure.into_inner().unwrap_or_else(|e| e.into_inner()).map_or(Ok(()), Err)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;

    fn name(path: &std::path::Path) -> String {
        path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    #[derive(clap::Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    fn plan(line: &str) -> Result<Plan, PlanError> {
        Plan::new(&Cli::try_parse_from(line.split(' ')).expect("arguments parse").args)
    }

    #[test]
    fn grids_have_columns_and_rows() {
        assert_eq!(grid("4x3"), Ok([4, 3]));
        for wrong in ["", "4", "0x1", "4x", "x", "1001x1", "2x2x2"] {
            assert!(grid(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn tiles_share_the_points_and_borders() {
        let plan = plan("synth town --points 1000003 --tiles 4x3 --density 10").unwrap();
        assert_eq!(plan.tiles.len(), 12);
        assert_eq!(plan.tiles.iter().map(|(tile, _)| tile.points).sum::<u64>(), 1_000_003);
        // √(1000003 / 12 / 10) = 91.3
        assert!(plan.tiles.iter().all(|(tile, _)| tile.size == [91.0, 91.0]));
        assert_eq!(plan.tiles[1].0.corner[0], plan.tiles[0].0.corner[0] + 91.0);
        assert_eq!(plan.tiles[4].0.corner[1], plan.tiles[0].0.corner[1] + 91.0);
        assert_eq!(name(&plan.tiles[0].1), "tile_511818_5402864.laz");
        assert!(plan.compress && plan.folder.is_some());
    }

    #[test]
    fn the_name_decides_on_compression() {
        assert!(!plan("synth a.las").unwrap().compress);
        assert!(plan("synth a.LAZ").unwrap().compress);
        assert!(!plan("synth folder --las --tiles 2x1").unwrap().compress);
        assert!(matches!(plan("synth a.laz --tiles 2x1"), Err(PlanError::NotAFolder { tiles: 2, .. })));
        assert!(matches!(plan("synth a.laz --las"), Err(PlanError::Contradiction { .. })));
        assert!(matches!(plan("synth a.laz --density NaN"), Err(PlanError::Density(_))));
        assert!(matches!(plan("synth a.laz --size 0"), Err(PlanError::Size { .. })));
        assert!(matches!(plan("synth a --tiles 9x9 --points 80"), Err(PlanError::TooFewPoints { .. })));
    }

    #[test]
    fn only_what_was_made_here_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let line = |name: &str| format!("synth {} --points 100", at(name).display());
        let write =
            |plan: &Plan| write_all(&Town::new(1), plan, Format::Seven, 1, &AtomicBool::new(false), |_| ());
        let made = plan(&line("a.laz")).unwrap();
        assert_eq!(made.check(false), Ok(()));
        write(&made).unwrap();
        let taken = made.check(false).unwrap_err();
        assert!(taken.to_string().ends_with("give another name, or --force to make it anew"), "{taken}");
        assert_eq!(made.check(true), Ok(()));
        write(&made).unwrap();
        // The scan of someone else, and something else of that name.
        let mut scan = std::fs::read(at("a.laz")).unwrap();
        scan[58..65].copy_from_slice(b"TerraSc");
        for (name, bytes) in [("b.laz", &scan[..]), ("c.las", b"notes"), ("d.laz", b"")] {
            std::fs::write(at(name), bytes).unwrap();
            let foreign = plan(&line(name)).unwrap();
            for force in [false, true] {
                let refused = foreign.check(force).unwrap_err().to_string();
                assert!(refused.contains("was not made by `lasray synth`") && !refused.contains("--force"));
            }
            assert!(matches!(write(&foreign), Err(SynthError::Foreign { .. })));
            assert_eq!(std::fs::read(at(name)).unwrap(), bytes);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4, "nothing is left behind");
    }

    #[test]
    fn an_unwritable_tile_stops_all_and_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut plan = plan("synth x --points 4k --tiles 2x2").unwrap();
        for (k, (_, path)) in plan.tiles.iter_mut().enumerate() {
            *path = folder.path().join(if k == 1 { "missing/b.laz".into() } else { format!("{k}.laz") });
        }
        let error = write_all(&Town::new(1), &plan, Format::Seven, 2, &AtomicBool::new(false), |_| ());
        assert!(error.unwrap_err().to_string().contains("b.laz"));
        let left = std::fs::read_dir(folder.path()).unwrap().map(|f| name(&f.unwrap().path()));
        assert!(left.into_iter().all(|name| name.ends_with(".laz")), "no half-written file remains");
    }
}
