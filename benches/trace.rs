//! The laboratory of the traversal: variants of its passes over the same scene and cameras, timed in turn at steady
//! clocks, their steps and loads counted, and what the driver's compiler makes of them.
//!
//! `cargo bench --bench trace [-- --help]`; the binary runs anywhere, without the source tree. docs/performance.md says
//! what the columns are.

use anyhow::Context;
use clap::Parser;
use lasray::bench::frames::{self, differing};
use lasray::bench::log::Counts;
use lasray::bench::pool::{self, BUDGET, PoolPipeline};
use lasray::bench::report::COMMIT;
use lasray::bench::steady::{self, Repeats, WarmUp};
use lasray::bench::thesis::{Config, Kernel, STRIPS, Thesis, ThesisImage};
use lasray::bench::world::{self, TOWN_POINTS, World};
use lasray::coords::{LowSurface, Slab};
use lasray::gpu::{DeviceKind, Gpu, GpuOptions, PipelineDesc, QueueKind, Timestamps};
use lasray::ingest::bins::Budget;
use lasray::load::LoadOptions;
use lasray::problems::Problems;
use lasray::render::benchmark_path::PathKind;
use lasray::render::camera::Camera;
use lasray::render::frame::{Background, Logged, PassOptions, Renderer, Shade, Traversal, View, check_size};
use lasray::render::image::Image;
use lasray::resident::pool::Access;
use lasray::section::Surface;
use lasray::source::placement::PlacementOptions;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set once the program is asked to end.
static STOP: AtomicBool = AtomicBool::new(false);

/// Names of a picture's passes.
const PASS_NAMES: [&str; 4] = ["wide beams", "beams", "trace", "shade"];
/// Side of a cell, CRS units.
const CELL: f64 = 0.25;

/// Variants of the traversal, timed in turn
#[derive(Parser)]
struct Args {
    /// Windows GRID/LEVELS
    #[arg(long, value_delimiter = ',', default_value = "32/8", value_name = "G/L,…")]
    grid: Vec<String>,
    /// Camera paths [default: all]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "NAME,…")]
    paths: Vec<PathKind>,
    /// Pixels [default: 1920x1080, on a CPU driver 640x360]
    #[arg(long, value_name = "WxH")]
    size: Option<String>,
    /// Frames of each path, in the middle of as many equal parts
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), value_name = "N")]
    frames: u32,
    /// Times that each variant draws a frame, in turn with the others
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(2..), value_name = "N")]
    rounds: u32,
    /// Milliseconds for which the same passes run right before the timed ones [default: 50, on a CPU driver once]
    #[arg(long, value_name = "MS")]
    warm: Option<f64>,
    /// Variants whose names hold one of these words; the thesis' kernel always runs
    #[arg(long, value_delimiter = ',', value_name = "WORD,…")]
    variants: Vec<String>,
    /// Names the variants and ends
    #[arg(long)]
    list: bool,
    /// Writes all figures
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Points of the synthetic town, two a cell
    #[arg(long, default_value_t = TOWN_POINTS, value_name = "N")]
    points: u64,
    /// Which town, which random path
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A small town, three paths, two rounds
    #[arg(long)]
    quick: bool,
    /// Only what the driver's compiler says of the passes: nothing runs, so any device will do
    #[arg(long)]
    statistics: bool,
    /// Counts no steps and loads
    #[arg(long)]
    no_counts: bool,
    /// Device, by its number in `lasray info --devices`
    #[arg(long)]
    device: Option<usize>,
    /// What cargo says to every benchmark
    #[arg(long, hide = true)]
    bench: bool,
}

/// What makes a picture.
#[derive(Clone, Copy)]
enum Way {
    /// The thesis' kernel in strips of so many pixels.
    Thesis([u32; 2]),
    /// Our passes.
    Pool { access: Access, traversal: Traversal, shade: Shade, options: PassOptions },
}

#[derive(Clone)]
struct Variant {
    name: String,
    way: Way,
}

impl Variant {
    fn pipeline_descs(&self) -> Vec<PipelineDesc> {
        match self.way {
            Way::Thesis(strip) => vec![Kernel::desc(strip)],
            Way::Pool { access, traversal, shade, options } => {
                options.pipeline_descs(access, traversal, shade)
            }
        }
    }

    fn is_thesis(&self) -> bool {
        matches!(self.way, Way::Thesis(_))
    }

    fn is_lit(&self) -> bool {
        matches!(self.way, Way::Pool { shade: Shade::Lit, traversal: Traversal::Fast, .. })
    }

    /// Invocations of its largest group.
    fn group_size(&self) -> u32 {
        let area = |[x, y]: [u32; 2]| x * y;
        match self.way {
            Way::Thesis(strip) => area(strip),
            Way::Pool { options, .. } => area(options.group).max(area(options.beam_group)),
        }
    }
}

fn access_name(access: Access) -> &'static str {
    match access {
        Access::Address => "address",
        Access::Texels => "texels",
        Access::StorageBuffer => "storage buffer",
    }
}

/// All variants; `usual`: how the pool is reached where the name does not say it.
fn variants(usual: Access) -> Vec<Variant> {
    let mut list: Vec<_> = STRIPS
        .map(|strip| Variant { name: format!("thesis {}x{}", strip[0], strip[1]), way: Way::Thesis(strip) })
        .into();
    let base = PassOptions::default();
    let mut add = |name: String, access, traversal, shade, options| {
        list.push(Variant { name, way: Way::Pool { access, traversal, shade, options } });
    };
    for group in [[8, 8], [8, 32]] {
        let name = format!("plain {}x{}", group[0], group[1]);
        add(name, usual, Traversal::Plain, Shade::None, PassOptions { group, ..base });
    }
    let shapes = [[8, 4], [32, 1], [16, 16]]
        .map(|group| (format!(", trace {}x{}", group[0], group[1]), PassOptions { group, ..base }));
    let beam_shapes = [[8, 4], [8, 8]].map(|beam_group| {
        (format!(", beams {}x{}", beam_group[0], beam_group[1]), PassOptions { beam_group, ..base })
    });
    let others = [Access::Address, Access::Texels, Access::StorageBuffer].into_iter().filter(|&a| a != usual);
    for (name, shade) in [("fast", Shade::None), ("lit", Shade::Lit)] {
        add(name.into(), usual, Traversal::Fast, shade, base);
        let no_beams = PassOptions { beams: false, ..base };
        add(format!("{name}, no beams"), usual, Traversal::Fast, shade, no_beams);
        let of_card = PassOptions::of(DeviceKind::Discrete);
        add(format!("{name}, as on a card"), usual, Traversal::Fast, shade, of_card);
        for (what, options) in shapes.iter().chain(&beam_shapes) {
            add(format!("{name}{what}"), usual, Traversal::Fast, shade, *options);
        }
        let in_order = PassOptions { dealt: false, ..base };
        add(format!("{name}, groups in order"), usual, Traversal::Fast, shade, in_order);
        for access in others.clone() {
            add(format!("{name}, {}", access_name(access)), access, Traversal::Fast, shade, base);
        }
    }
    list
}

/// Times of one variant in one frame.
#[derive(Clone, Default)]
struct Times {
    passes: [Repeats; PASS_NAMES.len()],
    all: Repeats,
    /// Share of the pixels that are not as they should be, if that was looked at.
    differ: Option<f64>,
}

impl Times {
    /// The first `rounds`.
    fn truncate(&mut self, rounds: usize) {
        self.passes.iter_mut().chain([&mut self.all]).for_each(|repeats| repeats.ms.truncate(rounds));
    }

    fn sum<'a>(frames: impl Iterator<Item = &'a Times> + Clone) -> Times {
        Times {
            passes: std::array::from_fn(|pass| Repeats::sum(frames.clone().map(|times| &times.passes[pass]))),
            all: Repeats::sum(frames.clone().map(|times| &times.all)),
            differ: frames.filter_map(|times| times.differ).reduce(f64::max),
        }
    }
}

/// A camera and the window around it.
struct Shot {
    path: &'static str,
    frame: u32,
    camera: Camera,
    window: [[i32; 2]; 2],
}

/// What a variant draws with.
enum Drawer {
    Thesis(Kernel),
    Pool(Access, Box<Renderer>),
}

struct Laboratory<'a> {
    gpu: &'a Gpu,
    world: &'a World,
    size: [u32; 2],
    variants: Vec<Variant>,
    drawers: Vec<Drawer>,
    warm_ups: Vec<WarmUp>,
    thesis: Thesis,
    pools: HashMap<&'static str, PoolPipeline>,
    clock: Timestamps,
    notes: Vec<String>,
}

fn view<'a>(world: &'a World, shot: &'a Shot, size: [u32; 2], way: Way) -> View<'a> {
    let view = frames::view(world, &shot.camera, size, shot.window);
    let Way::Pool { traversal, shade, .. } = way else { return view };
    if shade == Shade::Lit {
        let low = Arc::new(LowSurface::of(&world.bounds, &[]));
        let slab = Some(Slab { low, thickness: 0.0 });
        return View { traversal, shade, slab, background: Background::Sky, ..view };
    }
    View { traversal, ..view }
}

impl<'a> Laboratory<'a> {
    fn new(
        gpu: &'a Gpu,
        world: &'a World,
        config: Config,
        size: [u32; 2],
        warm_up: WarmUp,
        wanted: &[Variant],
    ) -> anyhow::Result<Laboratory<'a>> {
        let clock = Timestamps::new(gpu, "laboratory", QueueKind::Compute, WarmUp::STAGES)?
            .context("the device has no timestamps")?;
        let (mut notes, mut pools, mut refused) = (Vec::new(), HashMap::new(), HashMap::new());
        let (mut variants, mut drawers) = (Vec::new(), Vec::new());
        for variant in wanted {
            let most = gpu.limits().workgroup_size;
            if variant.group_size() > most {
                notes.push(format!(
                    "{}: the device's workgroups have at most {most} invocations",
                    variant.name
                ));
                continue;
            }
            let drawer = match variant.way {
                Way::Thesis(strip) => Drawer::Thesis(Kernel::new(gpu, strip)?),
                Way::Pool { access, options, .. } => {
                    let name = access_name(access);
                    if refused.contains_key(name) {
                        continue;
                    }
                    if !pools.contains_key(name) {
                        match filled(gpu, world, config, access) {
                            Ok(pool) => drop(pools.insert(name, pool)),
                            Err(error) => {
                                notes.push(format!("no {name}: {error:#}"));
                                refused.insert(name, ());
                                continue;
                            }
                        }
                    }
                    let scene = pools.get_mut(name).expect("made above").scene();
                    let renderer = Renderer::with_options(scene, world.grid, world.anchor, options)?;
                    Drawer::Pool(access, Box::new(renderer))
                }
            };
            variants.push(variant.clone());
            drawers.push(drawer);
        }
        let warm_ups = vec![warm_up; variants.len()];
        let thesis = Thesis::new(gpu, config, size, STRIPS[0])?;
        Ok(Laboratory { gpu, world, size, variants, drawers, warm_ups, thesis, pools, clock, notes })
    }

    /// Makes what `shot` sees resident.
    fn place(&mut self, shot: &Shot) -> anyhow::Result<()> {
        if self.variants.iter().any(Variant::is_thesis) {
            self.thesis.load(self.world, shot.window);
            self.thesis.place(shot.window)?;
        }
        for pool in self.pools.values_mut() {
            pool.place(self.world, shot.window)?;
        }
        Ok(())
    }

    /// Draws `shot` by variant `k`, and adds its times.
    fn time(&mut self, k: usize, shot: &Shot, times: &mut Times) -> anyhow::Result<()> {
        let view = view(self.world, shot, self.size, self.variants[k].way);
        let (clock, thesis, world) = (&mut self.clock, &mut self.thesis, self.world);
        let timing = match &mut self.drawers[k] {
            Drawer::Thesis(kernel) => {
                thesis.use_kernel(kernel);
                thesis.time(&view, world, &mut self.warm_ups[k], clock)?
            }
            Drawer::Pool(access, renderer) => {
                let scene = self.pools.get_mut(access_name(*access)).expect("its pool").scene();
                pool::time(scene, renderer, &view, &mut self.warm_ups[k], clock)?
            }
        };
        for (repeats, name) in times.passes.iter_mut().zip(PASS_NAMES) {
            if let Some((_, ms)) = timing.passes.iter().find(|(pass, _)| *pass == name) {
                repeats.push(*ms, timing.is_warm);
            }
        }
        times.all.push(timing.all_ms, timing.is_warm);
        Ok(())
    }

    /// Compares every variant's picture with the thesis', lit ones with the first lit one.
    fn compare(&mut self, shot: &Shot, times: &mut [Vec<Times>], at: usize) -> anyhow::Result<()> {
        let mut theirs: Option<ThesisImage> = None;
        let mut lit: Option<Image> = None;
        let pixels = f64::from(self.size[0]) * f64::from(self.size[1]);
        for (k, times) in times.iter_mut().enumerate() {
            let view = view(self.world, shot, self.size, self.variants[k].way);
            let (access, renderer) = match &mut self.drawers[k] {
                Drawer::Thesis(kernel) => {
                    if theirs.is_none() {
                        self.thesis.use_kernel(kernel);
                        theirs = Some(self.thesis.picture(&view, self.world)?);
                    }
                    continue;
                }
                Drawer::Pool(access, renderer) => (*access, renderer),
            };
            let scene = self.pools.get_mut(access_name(access)).expect("its pool").scene();
            let image = renderer.draw(scene, &view)?;
            let differ = if self.variants[k].is_lit() {
                let share = lit.as_ref().map(|first| unlike(first, &image));
                lit.get_or_insert(image);
                share
            } else {
                theirs.as_ref().map(|theirs| differing(&image, theirs))
            };
            times[at].differ = differ.map(|n| n as f64 / pixels);
        }
        Ok(())
    }

    /// What the threads of each pass do for `shot`.
    fn count(&mut self, shot: &Shot, counts: &mut Vec<(&'static str, Counts)>) -> anyhow::Result<()> {
        let mut put = |name, new| match counts.iter_mut().find(|(known, _)| *known == name) {
            Some((_, sum)) => *sum += new,
            None => counts.push((name, new)),
        };
        let pool_view = |traversal| {
            let (access, shade, options) = (Access::Address, Shade::None, PassOptions::default());
            view(self.world, shot, self.size, Way::Pool { access, traversal, shade, options })
        };
        let mut counted = Counts::default();
        let each = |across: usize, words: &[u32]| counted.add(across, words);
        self.thesis.log(self.gpu, &pool_view(Traversal::Plain), self.world, each)?;
        put("thesis", counted);
        let Some(pool) = self.pools.get_mut(access_name(Access::Address)) else { return Ok(()) };
        for (name, traversal, beams, logged) in [
            ("plain", Traversal::Plain, true, Logged::Trace),
            ("fast, no beams", Traversal::Fast, false, Logged::Trace),
            ("fast", Traversal::Fast, true, Logged::Trace),
            ("beams", Traversal::Fast, true, Logged::Beams),
            ("wide beams", Traversal::Fast, true, Logged::WideBeams),
        ] {
            let options = PassOptions { beams, logged: Some(logged), ..PassOptions::default() };
            let scene = pool.scene();
            let mut renderer = Renderer::with_options(scene, self.world.grid, self.world.anchor, options)?;
            let mut counted = Counts::default();
            renderer.log(scene, &pool_view(traversal), |across, words| counted.add(across, words))?;
            put(name, counted);
        }
        Ok(())
    }
}

/// Pixels of which one picture has a hit and the other none, or colours more than 1/255 apart.
fn unlike(a: &Image, b: &Image) -> usize {
    let code = |v: f32| lasray::attribute::linear_to_srgb(v.clamp(0.0, 1.0)) * 255.0;
    let colors = a.color.iter().zip(&b.color);
    let apart = colors.map(|(a, b)| (0..3).any(|k| (code(a[k]) - code(b[k])).abs() > 1.0));
    apart.zip(a.class.iter().zip(&b.class)).filter(|(apart, (a, b))| *apart || a != b).count()
}

/// A pool that holds windows of `config`, with one of them resident.
fn filled(gpu: &Gpu, world: &World, config: Config, access: Access) -> anyhow::Result<PoolPipeline> {
    let most = BUDGET.min(gpu.info().memory_bytes / 8 * 7);
    let mut pool = PoolPipeline::with_access(gpu, world, access, most)?;
    let half = (config.side() / 2) as i32;
    let corner = world.corner();
    pool.place(world, config.window(corner.map(|c| c + half)))?;
    Ok(pool)
}

fn parse_config(text: &str) -> anyhow::Result<Config> {
    let pair = text.split_once('/').and_then(|(g, l)| Some((g.parse().ok()?, l.parse().ok()?)));
    let (grid, levels): (u32, u32) = pair.with_context(|| format!("--grid: '{text}' is not GRID/LEVELS"))?;
    anyhow::ensure!(
        grid.is_power_of_two() && (2..=256).contains(&grid) && (1..=9).contains(&levels),
        "--grid {text}: expected a power of two from 2 to 256, and 1 to 9 levels"
    );
    Ok(Config { grid, levels })
}

fn parse_size(text: &str) -> anyhow::Result<[u32; 2]> {
    let pair = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let size: [u32; 2] = pair.with_context(|| format!("--size: '{text}' is not WIDTHxHEIGHT"))?;
    anyhow::ensure!(
        size.iter().all(|&n| n > 0) && u64::from(size[0]) * u64::from(size[1]) <= 1 << 21,
        "--size {text}: expected 1 to 2,097,152 pixels"
    );
    Ok(size)
}

fn main() -> anyhow::Result<()> {
    let mut args = Args::parse();
    if args.quick {
        args.points = args.points.min(1 << 21);
        args.rounds = 2;
        if args.paths.is_empty() {
            args.paths = vec![PathKind::Turn, PathKind::Slow, PathKind::Grazing];
        }
    }
    if args.paths.is_empty() {
        args.paths = PathKind::ALL.to_vec();
    }
    let open =
        |statistics| Gpu::new(&GpuOptions { device: args.device, statistics, ..GpuOptions::default() });
    let configs = args.grid.iter().map(|text| parse_config(text)).collect::<anyhow::Result<Vec<_>>>()?;
    let named = |variant: &Variant| {
        args.variants.is_empty()
            || variant.is_thesis()
            || args.variants.iter().any(|word| variant.name.contains(word.trim()))
    };
    let wanted = |usual| variants(usual).into_iter().filter(named).collect::<Vec<_>>();

    if args.list {
        variants(Access::Address).iter().for_each(|variant| println!("{}", variant.name));
        return Ok(());
    }
    if args.statistics {
        // Never closed: the process ends soon, and closing a device of Mesa's null hardware crashes.
        let gpu = std::mem::ManuallyDrop::new(open(true)?);
        println!("{}", gpu.info());
        let rows = compiled(&gpu, &wanted(Access::Address))?;
        anyhow::ensure!(!rows.is_empty(), "the driver tells nothing of what it compiles");
        print_compiled(&rows);
        let info = gpu.info();
        let report = json!({
            "device": info.name, "driver": info.driver, "commit": COMMIT, "statistics": rows,
        });
        return write(&args, report);
    }

    lasray::stop::on_request(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })?;
    let gpu = open(false)?;
    let is_cpu = gpu.info().kind == DeviceKind::Cpu;
    let size = match &args.size {
        Some(text) => parse_size(text)?,
        None if is_cpu => [640, 360],
        None => [1920, 1080],
    };
    check_size(&gpu, size)?;
    println!("{}; commit {COMMIT}", gpu.info());
    let mut problems = Problems::default();
    let options = LoadOptions {
        surface: Surface::Columns,
        cell: Some(CELL.into()),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        asked: lasray::sample::Asked::default(),
        budget: Budget { host_bytes: u64::MAX, device_bytes: u64::MAX },
        cache: None,
        quiet: true,
    };
    eprintln!("a town of {} points", args.points);
    let loaded = world::town(args.seed, args.points, [CELL; 2], &options, &mut problems)?;
    let world = World::of(loaded)?;
    let mut report = Vec::new();
    for config in configs {
        if !is_stopped() {
            report.push(run(&args, &gpu, &world, config, size, &wanted)?);
        }
    }
    let rows = if is_stopped() {
        Vec::new()
    } else {
        // On a device of its own, so that what is timed is what the program makes.
        compiled(&open(true)?, &wanted(Access::best(&gpu, 0)))?
    };
    if is_stopped() {
        println!("Stopped: not everything was measured.");
    } else if rows.is_empty() {
        println!("The driver tells nothing of what it compiles.");
    } else {
        print_compiled(&rows);
    }
    write(
        &args,
        json!({
            "device": gpu.info().name, "driver": gpu.info().driver, "commit": COMMIT, "size": size,
            "points": args.points, "seed": args.seed, "rounds": args.rounds,
            "configurations": report, "statistics": rows, "stopped": is_stopped(),
        }),
    )?;
    anyhow::ensure!(!is_stopped(), "stopped");
    Ok(())
}

fn is_stopped() -> bool {
    STOP.load(Ordering::Relaxed)
}

fn write(args: &Args, report: Value) -> anyhow::Result<()> {
    let Some(file) = &args.json else { return Ok(()) };
    let text = serde_json::to_string_pretty(&report)?;
    std::fs::write(file, text).with_context(|| file.display().to_string())
}

/// One configuration: times and their tables, then counts and theirs, and what of them goes into the report. Once asked to
/// end, tables of the frames that were timed in two rounds or more.
fn run(
    args: &Args,
    gpu: &Gpu,
    world: &World,
    config: Config,
    size: [u32; 2],
    wanted: &dyn Fn(Access) -> Vec<Variant>,
) -> anyhow::Result<Value> {
    let window = u64::from(config.side()).div_ceil(256).pow(2);
    let usual = Access::best(gpu, (window + 64) * world.mean_derived_bytes());
    let variants = wanted(usual);
    let warm_up = args.warm.map_or(WarmUp::new(gpu.info().kind), WarmUp::of);
    let mut lab = Laboratory::new(gpu, world, config, size, warm_up, &variants)?;
    if !args.no_counts && !lab.pools.contains_key(access_name(Access::Address)) {
        lab.pools.insert(access_name(Access::Address), filled(gpu, world, config, Access::Address)?);
    }
    let mut shots = shots(args, world, config)?;
    let mut times = vec![vec![Times::default(); shots.len()]; lab.variants.len()];
    let is_first = |shots: &[Shot], at: usize| at == 0 || shots[at - 1].path != shots[at].path;
    let mut whole = 0;
    'frames: for (at, shot) in shots.iter().enumerate() {
        eprintln!("{}/{} {}, frame {}", config.grid, config.levels, shot.path, shot.frame);
        lab.place(shot)?;
        for round in 0..args.rounds as usize {
            for k in 0..times.len() {
                if is_stopped() {
                    // Rounds of all variants count, if there are enough to tell how alike they are.
                    if round >= 2 {
                        times.iter_mut().for_each(|times| times[at].truncate(round));
                        whole = at + 1;
                    }
                    break 'frames;
                }
                lab.time(k, shot, &mut times[k][at])?;
            }
        }
        if is_first(&shots, at) {
            lab.compare(shot, &mut times, at)?;
        }
        whole = at + 1;
    }
    shots.truncate(whole);
    times.iter_mut().for_each(|times| times.truncate(whole));
    let rows = tables_of_times(args, &lab, config, usual, &shots, &times);
    let mut counted = Vec::new();
    for at in (0..whole).filter(|&at| !args.no_counts && is_first(&shots, at)) {
        if is_stopped() {
            break;
        }
        let mut of_path = Vec::new();
        lab.place(&shots[at])?;
        lab.count(&shots[at], &mut of_path)?;
        print_counts(shots[at].path, &of_path, &mut counted);
    }
    println!();
    lab.notes.iter().for_each(|note| println!("not run: {note}"));
    let Config { grid, levels } = config;
    Ok(json!({ "grid": grid, "levels": levels, "access": access_name(usual), "rows": rows, "counts": counted,
        "notes": lab.notes }))
}

/// The frames that are drawn, path by path.
fn shots(args: &Args, world: &World, config: Config) -> anyhow::Result<Vec<Shot>> {
    let stage = frames::stage(world, config);
    let mut shots = Vec::new();
    for kind in &args.paths {
        let path = kind.path(&stage, args.seed)?;
        for k in 0..args.frames {
            let share = (f64::from(k) + 0.5) / f64::from(args.frames);
            let frame = (share * f64::from(path.frames())) as u32;
            let camera = path.camera(frame)?;
            let window = frames::window(config, world, camera.eye());
            shots.push(Shot { path: kind.name(), frame, camera, window });
        }
    }
    Ok(shots)
}

/// Microseconds of one frame of `frames`.
fn micros(repeats: &Repeats, frames: usize) -> Option<f64> {
    repeats.median().map(|ms| 1e3 * ms / frames as f64)
}

fn shown(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |v| format!("{v:.digits$}"))
}

/// Of `times`, one for each variant: which strip others are compared with, and each variant's ratio to it. Lit pictures
/// are others than the thesis' and have none.
fn ratios(variants: &[Variant], times: &[Times]) -> (Option<usize>, Vec<Option<f64>>) {
    let strips: Vec<_> = (0..variants.len()).filter(|&k| variants[k].is_thesis()).collect();
    let base = steady::best(strips.iter().map(|&k| &times[k].all)).map(|index| strips[index]);
    let ratio = |(variant, times): (&Variant, &Times), base: &Repeats| {
        base.ratio_to(&times.all).filter(|_| !variant.is_lit())
    };
    let all = variants.iter().zip(times);
    (base, all.map(|both| base.and_then(|base| ratio(both, &times[base].all))).collect())
}

fn tables_of_times(
    args: &Args,
    lab: &Laboratory,
    config: Config,
    usual: Access,
    shots: &[Shot],
    times: &[Vec<Times>],
) -> Vec<Value> {
    if shots.is_empty() {
        return Vec::new();
    }
    let Config { grid, levels } = config;
    let [width, height] = lab.size;
    let rays = f64::from(width) * f64::from(height);
    let mut names: Vec<&str> = shots.iter().map(|shot| shot.path).collect();
    names.dedup();
    println!(
        "\n{grid}/{levels}, {width} x {height}, {} frames of {} paths, {} rounds, by {} where not said",
        shots.len(),
        names.len(),
        args.rounds,
        access_name(usual)
    );
    println!("microseconds a frame, mean of the frames; ratio: best strip of the thesis over the variant\n");
    println!(
        "{:<26}{:>7}{:>8}{:>9}{:>9}{:>9}{:>9}{:>8}{:>8}{:>9}",
        "variant", "wide", "beams", "trace", "shade", "all", "G rays/s", "ratio", "spread", "differ"
    );
    let sums: Vec<_> = times.iter().map(|frames| Times::sum(frames.iter())).collect();
    let (base, of_all) = ratios(&lab.variants, &sums);
    let mut rows = Vec::new();
    for (k, (variant, sum)) in lab.variants.iter().zip(&sums).enumerate() {
        let all = micros(&sum.all, shots.len());
        let passes = sum.passes.each_ref().map(|pass| micros(pass, shots.len()).filter(|&us| us > 0.0));
        let percent = |share: Option<f64>| share.map_or("-".into(), |s| format!("{:.1} %", 100.0 * s));
        println!(
            "{:<26}{:>7}{:>8}{:>9}{:>9}{:>9}{:>9}{:>8}{:>8}{:>9}{}",
            variant.name,
            shown(passes[0], 0),
            shown(passes[1], 0),
            shown(passes[2], 0),
            shown(passes[3], 0),
            shown(all, 0),
            shown(all.map(|us| rays / us / 1e3), 3),
            shown(of_all[k], 2),
            percent(sum.all.spread()),
            sum.differ.map_or("-".into(), |d| format!("{:.3} %", 100.0 * d)),
            match sum.all {
                Repeats { is_cold: true, .. } => "  not warm",
                _ if !sum.all.is_steady() => "  not steady",
                _ if Some(k) == base => "  best strip",
                _ => "",
            }
        );
        let of_passes: serde_json::Map<_, _> = PASS_NAMES
            .iter()
            .zip(passes)
            .filter_map(|(name, us)| Some(((*name).to_owned(), json!(us?))))
            .collect();
        rows.push(json!({
            "variant": variant.name, "us": all, "passes_us": of_passes, "grays_s": all.map(|us| rays / us / 1e3),
            "ratio": of_all[k], "spread": sum.all.spread(), "steady": sum.all.is_steady(), "differ": sum.differ,
            "frames": times[k].iter().zip(shots).map(|(times, shot)| json!({
                "path": shot.path, "frame": shot.frame, "all_ms": times.all, "steady": times.all.is_steady(),
                "passes_ms": PASS_NAMES.iter().zip(&times.passes).filter(|(_, p)| p.median() > Some(0.0))
                    .map(|(name, pass)| ((*name).to_owned(), json!(pass.ms))).collect::<serde_json::Map<_, _>>(),
            })).collect::<Vec<_>>(),
        }));
    }

    println!("\nmicroseconds a frame, and the ratio, path by path (~: not steady)\n");
    println!("{:<26}{}", "variant", names.iter().map(|name| format!("{name:>15}")).collect::<String>());
    let mut columns = Vec::new();
    for name in &names {
        let of_path = |frames: &Vec<Times>| {
            let some = frames.iter().zip(shots).filter(|(_, shot)| shot.path == *name);
            Times::sum(some.map(|(times, _)| times))
        };
        let sums: Vec<_> = times.iter().map(of_path).collect();
        let (_, ratios) = ratios(&lab.variants, &sums);
        let count = shots.iter().filter(|shot| shot.path == *name).count();
        columns.push((sums, ratios, count));
    }
    for (k, variant) in lab.variants.iter().enumerate() {
        let cells = columns.iter().map(|(sums, ratios, count)| {
            let mark = if sums[k].all.is_steady() { "" } else { "~" };
            let us = micros(&sums[k].all, *count);
            format!("{:>15}", format!("{mark}{} {:>5}", shown(us, 0), shown(ratios[k], 2)))
        });
        println!("{:<26}{}", variant.name, cells.collect::<String>());
    }
    rows
}

/// What the passes did in the first frame of `path`; a heading goes before the first.
fn print_counts(path: &str, passes: &[(&'static str, Counts)], counted: &mut Vec<Value>) {
    if counted.is_empty() {
        println!("\ncounted in the first frame of each path, by address\n");
        println!(
            "{:<16}{:<11}{:>8}{:>9}{:>8}{:>8}{:>11}{:>13}{:>6}",
            "pass", "path", "steps", "longest", "8x4", "32x1", "loads/step", "lines/group", "cut"
        );
    }
    for (pass, counts) in passes {
        let [block, row] = counts.efficiency().map(|share| format!("{:.0} %", 100.0 * share));
        println!(
            "{pass:<16}{path:<11}{:>8.1}{:>9}{block:>8}{row:>8}{:>11.2}{:>13.2}{:>6}",
            counts.steps_per_thread(),
            counts.most_steps,
            counts.loads_per_step(),
            counts.lines_per_step(),
            counts.cut
        );
        counted.push(json!({
            "pass": pass, "path": path, "steps": counts.steps_per_thread(), "sums": counts,
            "efficiency": counts.efficiency(), "loads_per_step": counts.loads_per_step(),
            "lines_per_step": counts.lines_per_step(),
        }));
    }
}

/// What the driver's compiler says of each program of `variants`; nothing where it does not tell.
fn compiled(gpu: &Gpu, variants: &[Variant]) -> anyhow::Result<Vec<Value>> {
    if !gpu.has_statistics() {
        return Ok(Vec::new());
    }
    let mut pipeline_descs: Vec<(String, PipelineDesc)> = Vec::new();
    #[cfg(feature = "view")]
    let derived =
        lasray::resident::derived_pipeline_descs(Access::Address, Surface::Columns, true)[0].clone();
    #[cfg(not(feature = "view"))]
    let derived = Vec::new();
    let passes = variants
        .iter()
        .filter(|variant| variant.group_size() <= gpu.limits().workgroup_size)
        .flat_map(|variant| variant.pipeline_descs().into_iter().map(|desc| (variant.name.clone(), desc)));
    for (name, desc) in passes.chain(derived.into_iter().map(|desc| ("derived".to_owned(), desc))) {
        let same = |(_, known): &(String, PipelineDesc)| {
            (known.name, known.words.as_ptr(), &known.constants)
                == (desc.name, desc.words.as_ptr(), &desc.constants)
        };
        if !pipeline_descs.iter().any(same) {
            pipeline_descs.push((name, desc));
        }
    }
    let mut rows = Vec::new();
    for (variant, desc) in pipeline_descs {
        for executable in desc.make(gpu)?.statistics()? {
            let all: serde_json::Map<_, _> =
                executable.statistics.into_iter().map(|(name, value)| (name, json!(value))).collect();
            rows.push(json!({
                "pass": desc.name, "variant": variant, "subgroup_size": executable.subgroup_size,
                "constants": desc.constants, "statistics": all,
            }));
        }
    }
    Ok(rows)
}

/// The columns that drivers have different words for; all words are in the JSON file.
fn print_compiled(rows: &[Value]) {
    println!(
        "{:<12}{:<28}{:>9}{:>11}{:>8}{:>9}{:>14}{:>10}{:>10}",
        "pass",
        "first variant",
        "subgroup",
        "registers",
        "spills",
        "groups",
        "instructions",
        "branches",
        "bytes"
    );
    for row in rows {
        let of = |names: &[&str]| {
            let all = row["statistics"].as_object()?;
            let found = all.iter().filter(|(name, _)| names.iter().any(|n| name.eq_ignore_ascii_case(n)));
            let values: Vec<_> = found.filter_map(|(_, value)| value.as_f64()).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>())
        };
        println!(
            "{:<12}{:<28}{:>9}{:>11}{:>8}{:>9}{:>14}{:>10}{:>10}",
            row["pass"].as_str().unwrap_or_default(),
            row["variant"].as_str().unwrap_or_default(),
            row["subgroup_size"],
            shown(of(&["VGPRs", "Register Count", "Registers"]), 0),
            shown(of(&["Spilled VGPRs", "Spilled SGPRs", "Local Memory Size", "Spill Count"]), 0),
            shown(of(&["Subgroups per SIMD", "Max Waves", "Occupancy"]), 0),
            shown(of(&["Instructions", "Instruction Count"]), 0),
            shown(of(&["Branches"]), 0),
            shown(of(&["Code size", "Binary Size"]), 0),
        );
    }
    let words = rows.first().and_then(|row| row["statistics"].as_object());
    let words: Vec<_> = words.into_iter().flatten().map(|(name, _)| name.as_str()).collect();
    println!("what the driver tells, all of it in the JSON file: {}", words.join(", "));
}
