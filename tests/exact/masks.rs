//! A mask is a filter: the exact picture under a mask is, pixel by pixel and bit by bit, that of a file in which only the
//! points are that the mask shows. Where such a file's own bounds are other ones, rays start elsewhere, and distances are
//! the same but for their rounding.

use crate::common::{self, LAVAPIPE};
use crate::scene::{self, Data, MEASURED, real_files};
use glam::DVec3;
use las::point::Classification;
use lasray::attribute::{ClassMask, Flags, Kind};
use lasray::gpu::Gpu;
use lasray::load::LoadOptions;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::View;
use lasray::render::image::{Image, MISS_CLASS};
use lasray::render::reference::Face;
use lasray::resident::pool::Access;
use lasray::resident::visibility::Visibility;
use lasray::section::Surface;
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [192, 108];
/// Pixels that may differ where rays start elsewhere: on smooth surfaces some hit just on the border of two columns.
const ROUNDED: usize = (SIZE[0] * SIZE[1] / 1000) as usize;
const SURFACES: [Surface; 3] = [Surface::Columns, Surface::Stacks, Surface::Smooth];

/// Vegetation, wires and what holds them, bridges, what hangs overhead.
fn always_floats(class: u8) -> bool {
    matches!(class, 3..=5 | 13..=17 | 19)
}

/// What options ask for.
struct Mask {
    options: &'static str,
    classes: ClassMask,
    hidden_flags: Flags,
}

impl Mask {
    fn shows(&self, (class, flags): Kind) -> bool {
        self.classes.shows(class) && flags.and(self.hidden_flags).is_empty()
    }
}

fn masks() -> [Mask; 15] {
    let (usual, only) = (ClassMask::default(), ClassMask::only);
    let of_flags = |options, classes, hidden_flags| Mask { options, classes, hidden_flags };
    let mask = |options, classes| of_flags(options, classes, Flags::WITHHELD);
    let withheld = |options, classes| of_flags(options, classes, Flags::NONE);
    let [overlap, made] = [Flags::OVERLAP, Flags::SYNTHETIC.with(Flags::KEY_POINT)];
    [
        mask("", usual),
        withheld("--withheld", usual),
        withheld("--classes 0-255 --withheld", ClassMask::all()),
        mask("--hide ground", usual.without(&[2])),
        withheld("--hide ground,unclassified --withheld", usual.without(&[0, 1, 2])),
        mask("--hide vegetation,wires", usual.without(&[3, 4, 5, 13, 14])),
        mask("--hide building,water,26", usual.without(&[6, 9, 26, 41, 42])),
        mask("--classes ground,unclassified", only(&[0, 1, 2])),
        withheld("--classes ground,vegetation --withheld", only(&[2, 3, 4, 5])),
        mask("--classes unclassified,vegetation,wires,tower", only(&[0, 1, 3, 4, 5, 13, 14, 15])),
        of_flags("--hide-flags overlap", usual, overlap.with(Flags::WITHHELD)),
        of_flags("--withheld --hide-flags overlap --classes 0-255", ClassMask::all(), overlap),
        of_flags("--withheld --hide-flags synthetic,key-point", usual, made),
        of_flags("--withheld --hide-flags synthetic --hide ground", usual.without(&[2]), Flags::SYNTHETIC),
        of_flags("--hide-flags overlap,synthetic,key-point", usual, Flags::ALL),
    ]
}

/// Points of a file, and what else a file of some of them has.
pub struct Points {
    pub name: &'static str,
    header: las::Header,
    pub points: Vec<las::Point>,
    /// Of the whole file.
    pub cell: f64,
}

/// Class and flags, as the format of the file has them.
fn kind_of(header: &las::Header, point: &las::Point) -> Kind {
    // The crate makes a flag of the old overlap class.
    let is_old_overlap = point.is_overlap && !header.point_format().is_extended;
    let class = if is_old_overlap { 12 } else { point.classification.into() };
    let flags = [
        (point.is_withheld, Flags::WITHHELD),
        (point.is_synthetic, Flags::SYNTHETIC),
        (point.is_key_point, Flags::KEY_POINT),
        (point.is_overlap && !is_old_overlap, Flags::OVERLAP),
    ];
    (class, flags.iter().filter(|(is, _)| *is).fold(Flags::NONE, |all, (_, flag)| all.with(*flag)))
}

impl Points {
    /// The `most` points of a file that are nearest to the middle of what floats, in a square; some of them are made withheld,
    /// synthetic, key-points or overlap, and some of another class, where there are none (or, of overlap, no others). One is noise, so high that its section counts heights
    /// in wide codes, which those beside it and the same without it do not.
    pub fn read(name: &'static str, path: &Path, cell: f64, most: usize) -> Points {
        let mut reader = las::Reader::from_path(path).unwrap();
        let header = reader.header().clone();
        let count = header.number_of_points();
        let mut points: Vec<_> =
            reader.read_points(count).unwrap().points().collect::<Result<_, _>>().unwrap();
        let middle = |of: &dyn Fn(&las::Point) -> bool| {
            let mut some: Vec<_> = points.iter().filter(|point| of(point)).map(|p| (p.x, p.y)).collect();
            let at = some.len() / 2;
            some.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            some.get(at).copied()
        };
        let (x, y) = middle(&|point| always_floats(point.classification.into()))
            .or_else(|| middle(&|_| true))
            .expect("there are points");
        let off = |point: &las::Point| (point.x - x).abs().max((point.y - y).abs());
        points.sort_by(|a, b| off(a).total_cmp(&off(b)));
        points.truncate(most);
        let is_withheld = points.iter().any(|point| point.is_withheld);
        // Formats without the flag have a class instead.
        let is_alike = points.iter().all(|point| point.is_overlap == points[0].is_overlap);
        let mixes_overlap = is_alike && header.point_format().is_extended;
        let floats = points.iter().any(|point| always_floats(point.classification.into()));
        for (k, point) in points.iter_mut().enumerate() {
            point.is_withheld |= !is_withheld && k % 5 == 0;
            point.is_synthetic |= k % 7 == 0;
            point.is_key_point |= k % 11 == 0;
            if mixes_overlap {
                point.is_overlap = k % 4 == 1;
            }
            if !floats && point.classification == Classification::Unclassified && k % 3 == 0 {
                let class = if k % 9 == 0 { 14 } else { 5 };
                point.classification = Classification::new(class).unwrap();
            }
        }
        let bird = &mut points[11];
        bird.z += 150.0;
        bird.classification = Classification::HighNoise;
        Points { name, header, points, cell }
    }

    /// A file of those that `is_shown`; how many they are.
    fn write(&self, path: &Path, is_shown: impl Fn(Kind) -> bool) -> usize {
        self.write_those(path, |point| is_shown(kind_of(&self.header, point)))
    }

    /// The same of those that are `kept`.
    pub fn write_those(&self, path: &Path, kept: impl Fn(&las::Point) -> bool) -> usize {
        let mut builder = las::Builder::from(self.header.clone());
        builder.point_format.is_compressed = false;
        let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
        let mut written = 0;
        for point in self.points.iter().filter(|point| kept(point)) {
            writer.write_point(point.clone()).unwrap();
            written += 1;
        }
        writer.close().unwrap();
        written
    }

    fn load(&self, path: PathBuf, surface: Surface) -> Data {
        Data::load_with(&[path], Some(self.cell), |options| LoadOptions {
            surface,
            rgb_bits: Some(16),
            ..options
        })
    }
}

/// From outside, and up through what hangs highest over the ground: places as they are typed.
pub fn cameras(points: &Points, data: &Data) -> [Camera; 2] {
    let (b, center) = (data.bounds, data.bounds.center());
    let (wide, high) = ((b.max - b.min).truncate().max_element(), b.max.z - b.min.z);
    let typed = |v: DVec3| (v * 100.0).round() / 100.0;
    let camera = |eye: DVec3, target: DVec3, fov: f64| {
        Camera::look_at(typed(eye), typed(target), Projection::Perspective { fov }).unwrap()
    };
    let outside = center + DVec3::new(-0.62 * wide, -0.81 * wide, 0.41 * wide);
    let of = |is: fn(u8) -> bool| {
        let points = points.points.iter().filter(move |point| is(point.classification.into()));
        points.map(|point| DVec3::new(point.x, point.y, point.z))
    };
    let reach = 2.0 * points.cell;
    let clearance = |at: DVec3| {
        let ground = of(|class| class == 2).filter(|p| p.truncate().distance(at.truncate()) < reach);
        at.z - ground.map(|p| p.z).reduce(f64::max).unwrap_or(f64::INFINITY)
    };
    let hanging = of(always_floats).step_by(7).map(|at| (clearance(at), at));
    let (air, at) = hanging.max_by(|a, b| a.0.total_cmp(&b.0)).expect("something floats");
    assert!(air > 2.0 * points.cell, "{}: it hangs {air} over the ground", points.name);
    let eye = at - DVec3::Z * 0.7 * air;
    [
        camera(outside, center.with_z(b.min.z + 0.3 * high), 50.0),
        camera(eye, eye + DVec3::new(3.0, 5.0, 9.0) * points.cell, 80.0),
    ]
}

/// Pixels of which anything differs.
pub fn differ(a: &Image, b: &Image) -> usize {
    let same = |k: usize| {
        a.class[k] == b.class[k]
            && a.face[k] == b.face[k]
            && a.origin[k] == b.origin[k]
            && a.distance[k].to_bits() == b.distance[k].to_bits()
            && a.hit_height[k].to_bits() == b.hit_height[k].to_bits()
            && a.color[k].map(f32::to_bits) == b.color[k].map(f32::to_bits)
    };
    assert_eq!(a.class.len(), b.class.len());
    (0..a.class.len()).filter(|&k| !same(k)).count()
}

/// Pixels that show other things, or the same farther or nearer than rounding tells.
pub fn differ_beyond_rounding(a: &Image, b: &Image) -> usize {
    let same = |k: usize| {
        let (far, other) = (a.distance[k], b.distance[k]);
        let is_as_far = far == other || (far - other).abs() <= 4.0 * f32::EPSILON * far;
        a.class[k] == b.class[k] && a.face[k] == b.face[k] && a.color[k] == b.color[k] && is_as_far
    };
    (0..a.class.len()).filter(|&k| !same(k)).count()
}

/// Compares the pictures of `points` under all masks with those of the points that they show. Returns what is wrong.
fn check(gpu: &Gpu, points: &Points) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(format!("{name}.las"));
    points.write(&path("all"), |_| true);
    let shown: Vec<_> = masks()
        .into_iter()
        .enumerate()
        .map(|(k, mask)| {
            let file = path(&k.to_string());
            let count = points.write(&file, |kind| mask.shows(kind));
            (mask, file, count)
        })
        .collect();
    let mut wrong = Vec::new();
    for surface in SURFACES {
        let data = points.load(path("all"), surface);
        let mut scene = data.scene(gpu, Access::Address, MEASURED());
        let mut renderer = data.renderer(&scene);
        assert!(data.sections.iter().any(|(_, section)| section.layout.code.wide), "{}", points.name);
        let cameras = cameras(points, &data);
        let (mut bottoms, mut hits) = (0, 0);
        let uploaded = scene.counters().section_bytes;
        for (mask, file, count) in &shown {
            let what = format!("{}, {}, {count} points by '{}'", points.name, surface.name(), mask.options);
            assert!(*count > 50, "{what}");
            let Mask { classes, hidden_flags, .. } = *mask;
            scene.set_visibility(Visibility { classes, hidden_flags, ..MEASURED() }).unwrap();
            let filtered = points.load(file.clone(), surface);
            assert_eq!(filtered.grid, data.grid, "{what}");
            let all = Visibility { classes: ClassMask::all(), hidden_flags: Flags::NONE, ..MEASURED() };
            let mut filtered_scene = filtered.scene(gpu, Access::Address, all);
            let mut filtered_renderer = filtered.renderer(&filtered_scene);
            let mut differing = Vec::new();
            for camera in &cameras {
                let masked = renderer.draw(&mut scene, &data.exact(camera, SIZE)).unwrap();
                let own = || View { colors: &data.colors, ..filtered.exact(camera, SIZE) };
                let mut draw = |view| filtered_renderer.draw(&mut filtered_scene, &view).unwrap();
                differing.push(differ(&masked, &draw(View { bounds: data.bounds, ..own() })));
                differing.push(differ_beyond_rounding(&masked, &draw(own())));
                bottoms += masked.face.iter().filter(|face| **face == Face::Bottom as u8).count();
                hits += masked.class.iter().filter(|class| **class != MISS_CLASS).count();
            }
            let near = if surface == Surface::Smooth { ROUNDED } else { 0 };
            let most = [0, near, 0, near];
            if differing.iter().zip(most).any(|(pixels, most)| *pixels > most) {
                wrong.push(format!("{what}: {differing:?} pixels differ"));
            }
        }
        assert_eq!(scene.counters().section_bytes, uploaded, "masks copy nothing");
        let said = format!("{}, {}: {hits} hits, {bottoms} bottoms", points.name, surface.name());
        println!("{said}");
        assert!(hits > 50_000 && (surface == Surface::Columns || bottoms > 500), "{said}");
    }
    wrong
}

#[test]
fn masks_are_filters_of_real_files() {
    let Some(folder) = real_files() else { return };
    common::run("masks::masks_are_filters_of_real_files", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let files = [
            ("powerline/12BZ1_21.laz", 0.5),
            ("urban/multitile_delft/ahn3_cropped_2.laz", 0.25),
            ("urban/fusa.laz", 0.5),
            ("forest/MixedConifer.laz", 0.5),
            ("autzen/autzen_trim.laz", 4.0),
            // Key-points.
            ("urban/multitile_ign/test_data_77055_627755_LA93_IGN69.laz", 0.5),
        ];
        let wrong: Vec<_> = files
            .into_iter()
            .flat_map(|(name, cell)| check(&gpu, &Points::read(name, &folder.join(name), cell, 30_000)))
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn masks_are_filters_of_the_town() {
    common::run("masks::masks_are_filters_of_the_town", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let path = scene::town(folder.path(), "town.las", [-80.0, -80.0], 160.0);
        let wrong = check(&gpu, &Points::read("town", &path, 0.5, 60_000));
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
