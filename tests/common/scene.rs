//! Scenes as the program makes them, and the same points read apart from it.
#![allow(dead_code)] // each test file uses its part

use lasray::attribute::{AttributeSummary, ClassMask, ColorMode, ColorTable, Flags};
use lasray::coords::{Bounds, Grid, Height, LowSurface, SectionKey, Slab};
use lasray::gpu::{Gpu, Order};
use lasray::ingest::bins::Budget;
use lasray::load::{self, About, LoadOptions, Loaded};
use lasray::problems::Problems;
use lasray::render::camera::Camera;
use lasray::render::frame::{Background, Renderer, Shade, Traversal, View};
use lasray::render::image::Image;
use lasray::render::reference::Point;
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::sample;
use lasray::section::{Payload, Surface};
use lasray::source::placement::{Placement, PlacementOptions};
use lasray::synth::{Format, Tile, Town, write_tile};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Everything shown but noise, measured cells only.
pub const MEASURED: fn() -> Visibility = || Visibility {
    classes: ClassMask::default(),
    hidden_flags: Flags::WITHHELD,
    bridge: 0,
    near_ties: false,
};
/// As pictures are made by default.
pub const BRIDGED: fn() -> Visibility = || Visibility { bridge: 4, ..MEASURED() };

/// Real files, which are no part of the repository.
pub fn real_files() -> Option<PathBuf> {
    let folder = std::env::var_os("LASRAY_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no real files at {} (LASRAY_DATA names another folder)", folder.display());
    None
}

/// A corner of the synthetic town, `side` metres wide, about 8 points a square metre, as a file.
pub fn town(folder: &Path, name: &str, corner: [f64; 2], side: f64) -> PathBuf {
    let path = folder.join(name);
    let tile = Tile { corner, size: [side; 2], points: (8.0 * side * side) as u64 };
    let compress = name.ends_with(".laz");
    write_tile(&Town::new(1), &tile, &path, Format::Seven, compress, &AtomicBool::new(false), |_| {})
        .unwrap();
    path
}

fn options(cell: Option<f64>) -> LoadOptions {
    LoadOptions {
        surface: Surface::Columns,
        cell: cell.map(Into::into),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        asked: sample::Asked::default(),
        budget: Budget { host_bytes: 1 << 31, device_bytes: 1 << 30 },
        cache: None,
        quiet: true,
    }
}

/// Files ready to be put on a device.
pub struct Data {
    pub sections: Vec<(SectionKey, Payload)>,
    pub grid: Grid,
    pub bounds: Bounds,
    pub low: Arc<LowSurface>,
    pub anchor: Height,
    pub colors: ColorTable,
    pub summary: AttributeSummary,
    /// Of the first file.
    pub placement: Placement,
}

impl Data {
    /// Reads `paths` into cells of `cell` units (`None`: as chosen).
    pub fn load(paths: &[PathBuf], cell: Option<f64>) -> Data {
        Data::load_with(paths, cell, |options| options)
    }

    /// The same in colours of a mode, with what that needs of the points; and other options.
    pub fn load_colored(
        paths: &[PathBuf],
        cell: Option<f64>,
        mode: ColorMode,
        change: impl FnOnce(LoadOptions) -> LoadOptions,
    ) -> Data {
        let options = change(options(cell));
        let mut problems = Problems::default();
        let opening = load::open(paths, &options, &mut problems).unwrap();
        let summary = opening.about.summary.clone();
        let opening = opening.colored(mode, &summary, &mut problems);
        let loaded = load::read(opening, &options, &mut problems).unwrap();
        assert!(!problems.failed, "{problems:?}");
        let data = Data::of(paths, loaded);
        let colors = ColorTable::new(mode, &summary, &data.grid, None, None).unwrap();
        Data { colors, ..data }
    }

    /// The same with other options.
    pub fn load_with(
        paths: &[PathBuf],
        cell: Option<f64>,
        change: impl FnOnce(LoadOptions) -> LoadOptions,
    ) -> Data {
        let mut problems = Problems::default();
        let loaded = load::paths(paths, &change(options(cell)), &mut problems).unwrap();
        assert!(!problems.failed, "{problems:?}");
        Data::of(paths, loaded)
    }

    fn of(paths: &[PathBuf], loaded: Loaded) -> Data {
        let Loaded { grid, sections, about, .. } = loaded;
        let About { bounds, outline, summary, color, .. } = about;
        Data {
            sections: sections.into_iter().map(|(key, columns)| (key, columns.pack())).collect(),
            grid,
            bounds,
            low: outline.low,
            anchor: grid.height(bounds.center().z).unwrap(),
            colors: ColorTable::new(color, &summary, &grid, None, None).unwrap(),
            summary,
            placement: placement(paths),
        }
    }

    /// A scene without sections, whose pool has `budget_bytes`.
    pub fn empty(
        &self,
        gpu: &Gpu,
        access: Access,
        order: impl FnOnce(Order) -> Order,
        visibility: Visibility,
        budget_bytes: u64,
    ) -> Scene {
        Scene::new(gpu, order, access, budget_bytes, visibility, self.grid).unwrap()
    }

    /// All sections, live.
    pub fn scene(&self, gpu: &Gpu, access: Access, visibility: Visibility) -> Scene {
        let mut scene = self.empty(gpu, access, |order| order, visibility, 1 << 30);
        for (key, packed) in &self.sections {
            assert!(scene.upload(*key, packed).unwrap(), "the pool is full");
        }
        scene.settle().unwrap();
        scene
    }

    pub fn renderer(&self, scene: &Scene) -> Renderer {
        Renderer::new(scene, self.grid, self.anchor).unwrap()
    }

    /// A picture of measured cells, pixel centres only, as `--shade none` makes it.
    pub fn exact<'a>(&'a self, camera: &'a Camera, size: [u32; 2]) -> View<'a> {
        View {
            camera,
            size,
            samples: 1,
            z_scale: 1.0,
            pivot: self.bounds.min.z,
            bounds: self.bounds,
            slab: None,
            colors: &self.colors,
            shade: Shade::None,
            background: Background::None,
            traversal: Traversal::Fast,
            window: None,
        }
    }

    /// A picture as it is made by default.
    pub fn lit<'a>(&'a self, camera: &'a Camera, size: [u32; 2]) -> View<'a> {
        let width = (self.bounds.max - self.bounds.min).truncate().max_element();
        View {
            samples: 4,
            slab: Some(Slab { low: Arc::clone(&self.low), thickness: 0.03 * width }),
            shade: Shade::Lit,
            background: Background::Sky,
            ..self.exact(camera, size)
        }
    }
}

/// How the first of `paths` gets into the world of all of them.
pub fn placement(paths: &[PathBuf]) -> Placement {
    let opened: Vec<_> = sample::open_all(paths).into_iter().filter_map(Result::ok).collect();
    let sample = sample::take(
        &opened,
        &PlacementOptions::default(),
        &sample::Asked::default(),
        &sample::SampleBudget::default(),
    );
    sample.world.placements.into_iter().flatten().next().expect("a file that is drawn")
}

/// The points of a file as the `las` crate reads them, in world coordinates; colours are taken for 16-bit ones.
pub fn points(path: &Path, placement: &Placement) -> Vec<Point> {
    let mut reader = las::Reader::from_path(path).unwrap();
    let legacy = !reader.header().point_format().is_extended;
    let count = reader.header().number_of_points();
    let mut points = Vec::with_capacity(count as usize);
    for p in reader.read_points(count).unwrap().points() {
        let p = p.unwrap();
        let at = placement.place(p.x, p.y, p.z);
        let class = u8::from(p.classification);
        points.push(Point {
            e: at.x,
            n: at.y,
            u: at.z,
            // The crate makes a flag of the old overlap class.
            class: if legacy && p.is_overlap { 12 } else { class },
            intensity: p.intensity,
            rgb: p.color.map_or([0; 3], |c| [c.red, c.green, c.blue].map(|v| (v >> 8) as u8)),
            returns: p.return_number | p.number_of_returns << 4,
            flags: u8::from(p.is_synthetic)
                | u8::from(p.is_key_point) << 1
                | u8::from(p.is_withheld) << 2
                | u8::from(p.is_overlap && !legacy) << 3,
        });
    }
    points
}

/// Pixels of which a channel differs by more than 1/255 as they are written to a PNG.
pub fn pixels_that_differ(a: &Image, b: &Image) -> usize {
    let code = |v: f32| lasray::attribute::linear_to_srgb(v.clamp(0.0, 1.0)) * 255.0;
    let channels = |a: &[f32; 4], b: &[f32; 4]| {
        (0..4).any(|k| {
            let (x, y) = if k == 3 { (a[k] * 255.0, b[k] * 255.0) } else { (code(a[k]), code(b[k])) };
            (x - y).abs() > 1.0
        })
    };
    assert_eq!(a.color.len(), b.color.len());
    a.color.iter().zip(&b.color).filter(|(a, b)| channels(a, b)).count()
}

/// Pixels that hit in one and miss in the other.
pub fn hits_that_differ(a: &Image, b: &Image) -> usize {
    a.distance.iter().zip(&b.distance).filter(|(a, b)| a.is_finite() != b.is_finite()).count()
}
