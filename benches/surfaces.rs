//! What air in columns costs: pictures of one input as columns and as stacks, same cells and cameras, in turn at steady clocks;
//! and the bytes that each takes.
//!
//! `cargo bench --bench surfaces -- [INPUT…] [--cell C] [--size WxH] [--rounds N]`; without inputs a synthetic town.

use anyhow::Context;
use clap::Parser;
use lasray::attribute::{ColorTable, Flags};
use lasray::bench::pool::{self, BUDGET};
use lasray::bench::steady::{Repeats, WarmUp};
use lasray::gpu::{Gpu, GpuOptions, QueueKind, Timestamps};
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions, Loaded};
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Background, Renderer, Shade, Traversal, View};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::{Layout, Surface, device_bytes};
use lasray::source::inputs;
use lasray::source::length::Length;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

const SURFACES: [Surface; 2] = [Surface::Columns, Surface::Stacks];
/// Azimuth and elevation of the cameras, and their distance in lengths of what is framed; 0: all of it.
const CAMERAS: [([f64; 2], f64); 3] = [([0.0, 35.0], 0.0), ([60.0, 12.0], 0.15), ([200.0, 60.0], 0.3)];

/// Columns beside stacks
#[derive(Parser)]
struct Args {
    /// Files and folders [default: a synthetic town]
    inputs: Vec<OsString>,
    /// Side of a cell [default: chosen from the data]
    #[arg(long)]
    cell: Option<f64>,
    /// Pixels
    #[arg(long, default_value = "640x360", value_name = "WxH")]
    size: String,
    /// Leaves out points of these classes, but for the first ones
    #[arg(long, value_delimiter = ',')]
    without: Vec<u8>,
    /// How many of those stay
    #[arg(long, default_value_t = 0)]
    keep: usize,
    /// Times that each picture is drawn, in turn
    #[arg(long, default_value_t = 5)]
    rounds: u32,
    /// What cargo says to every benchmark
    #[arg(long, hide = true)]
    bench: bool,
}

/// One surface of the input, ready to be drawn.
struct Drawn {
    about: load::About,
    colors: ColorTable,
    scene: Scene,
    renderer: Renderer,
    /// Uploaded, derived, on the device.
    bytes: [u64; 3],
    /// Sections, and those in which anything may float.
    sections: [usize; 2],
}

fn drawn(gpu: &Gpu, args: &Args, files: &[PathBuf], surface: Surface) -> anyhow::Result<Drawn> {
    let budget = Budget { host_bytes: 8 << 30, device_bytes: BUDGET };
    let options = LoadOptions {
        cell: args.cell.map(Length::from),
        surface,
        budget,
        quiet: true,
        placement: Default::default(),
        rgb_bits: None,
        asked: Default::default(),
        cache: None,
    };
    let mut problems = Problems::default();
    let Loaded { grid, about, sections, .. } = load::paths(files, &options, &mut problems)?;
    let visibility =
        Visibility { classes: Default::default(), hidden_flags: Flags::WITHHELD, bridge: 4, near_ties: true };
    let budget = gpu.bytes_for_sections(BUDGET);
    let mut scene = Scene::new(gpu, |order| order, Access::best(gpu, budget / 2), budget, visibility, grid)?;
    let layouts: Vec<Layout> = sections.iter().map(|(_, columns)| columns.layout()).collect();
    for (key, columns) in &sections {
        anyhow::ensure!(scene.upload(*key, &columns.pack())?, "the sections do not fit the device's memory");
    }
    scene.settle()?;
    let anchor = grid.height(about.bounds.center().z).context("no height")?;
    let sum = |bytes: fn(&Layout) -> u64| layouts.iter().map(bytes).sum::<u64>();
    let floating = layouts.iter().filter(|layout| layout.floats.is_some_and(|floats| floats.spans > 0));
    Ok(Drawn {
        colors: ColorTable::new(about.color, &about.summary, &grid, None, None)?,
        renderer: Renderer::new(&scene, grid, anchor)?,
        bytes: [sum(Layout::uploaded_bytes), sum(Layout::derived_bytes), sum(device_bytes)],
        sections: [layouts.len(), floating.count()],
        about,
        scene,
    })
}

fn view<'a>(
    about: &load::About,
    colors: &'a ColorTable,
    camera: &'a Camera,
    size: [u32; 2],
    shade: Shade,
) -> View<'a> {
    View {
        camera,
        size,
        samples: 1,
        z_scale: 1.0,
        pivot: about.bounds.min.z,
        bounds: about.bounds,
        slab: (shade == Shade::Lit).then(|| about.slab(about.cell)),
        colors,
        shade,
        background: Background::Sky,
        traversal: Traversal::Fast,
        window: None,
    }
}

/// A copy of `file` without the points of some classes but for the first `keep` of them: open land, with so many points of a
/// tree.
fn without(file: &Path, classes: &[u8], keep: usize, to: &Path) -> anyhow::Result<()> {
    let mut reader = las::Reader::from_path(file)?;
    let mut writer = las::Writer::from_path(to, reader.header().clone())?;
    let count = reader.header().number_of_points();
    let mut kept = 0;
    for point in reader.read_points(count)?.points() {
        let point = point?;
        let is_left_out = classes.contains(&u8::from(point.classification));
        kept += usize::from(is_left_out);
        if !is_left_out || kept <= keep {
            writer.write_point(point)?;
        }
    }
    writer.close()?;
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let (width, height) = args.size.split_once('x').context("--size is WIDTHxHEIGHT")?;
    let size = [width.parse()?, height.parse()?];
    let gpu = Gpu::new(&GpuOptions::default())?;
    println!("{}", gpu.info());
    let folder = tempfile::tempdir()?;
    let mut files = inputs::expand(&args.inputs).files;
    if files.is_empty() {
        let file = folder.path().join("town.las");
        let run = std::process::Command::new(env!("CARGO_BIN_EXE_lasray"))
            .args(["synth", file.to_str().context("a path")?, "--points", "3M"])
            .status()?;
        anyhow::ensure!(run.success(), "synth failed");
        files = vec![file];
    }
    if !args.without.is_empty() {
        let open = folder.path().join("open.las");
        without(&files[0], &args.without, args.keep, &open)?;
        files = vec![open];
    }
    let mut both = Vec::new();
    for surface in SURFACES {
        let drawn = drawn(&gpu, &args, &files, surface)?;
        let [uploaded, derived, device] = drawn.bytes.map(|bytes| bytes as f64 / f64::from(1 << 20));
        let [sections, floating] = drawn.sections;
        println!(
            "{:8} cells of {}: {sections} sections, in {floating} something may float; {uploaded:.1} MiB uploaded, \
             {derived:.1} derived, {device:.1} on the device",
            surface.name(),
            drawn.about.cell,
        );
        both.push(drawn);
    }
    let share = |k: usize| both[1].bytes[k] as f64 / both[0].bytes[k] as f64;
    println!("stacks / columns: uploaded {:.2}, derived {:.2}, device {:.2}", share(0), share(1), share(2));
    let mut warm_up = WarmUp::new(gpu.info().kind);
    let mut clock = Timestamps::new(&gpu, "surfaces", QueueKind::Compute, WarmUp::STAGES)?
        .context("the device has no timestamps")?;
    let length = both[0].about.bounds.size().truncate().max_element();
    for shade in [Shade::None, Shade::Lit] {
        for (angles, distance) in CAMERAS {
            let projection = Projection::Perspective { fov: 45.0 };
            let camera = match distance {
                0.0 => Camera::frame_hull(&both[0].about.outline.hull, angles, projection, size)?,
                _ => Camera::orbit(both[0].about.bounds.center(), angles, distance * length, projection)?,
            };
            let mut times = [(); SURFACES.len()].map(|()| Vec::<(&str, Repeats)>::new());
            for _ in 0..args.rounds {
                for (drawn, times) in both.iter_mut().zip(&mut times) {
                    let (about, colors) = (drawn.about.clone(), drawn.colors.clone());
                    let view = view(&about, &colors, &camera, size, shade);
                    let timing =
                        pool::time(&mut drawn.scene, &mut drawn.renderer, &view, &mut warm_up, &mut clock)?;
                    for (name, ms) in timing.passes.into_iter().chain([("all", timing.all_ms)]) {
                        match times.iter_mut().find(|(known, _)| *known == name) {
                            Some((_, repeats)) => repeats.push(ms, timing.is_warm),
                            None => times.push((name, Repeats { ms: vec![ms], is_cold: !timing.is_warm })),
                        }
                    }
                }
            }
            let words = |times: &[(&str, Repeats)]| {
                let each = times
                    .iter()
                    .map(|(name, repeats)| format!("{name} {:.2}", repeats.median().unwrap_or_default()));
                each.collect::<Vec<_>>().join(", ")
            };
            let all = |k: usize| times[k].last().map(|(_, repeats)| repeats).context("no pass");
            let (columns, stacks) = (all(0)?, all(1)?);
            let ratio = stacks.ratio_to(columns).map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
            println!(
                "{shade:?} {angles:?} {distance}: stacks / columns {ratio}; ms: {} | {}",
                words(&times[0]),
                words(&times[1])
            );
        }
    }
    Ok(())
}
