//! Passes of a frame against their CPU twins, on a corner of the town.
//!
//! Lavapipe computes in f32 and GLSL leaves it room; the tolerances below say how much.

use super::common::{self, LAVAPIPE};
use super::scene::{self, Data, MEASURED};
use lasray::attribute::{ClassMask, ColorMode, ColorTable};
use lasray::coords::power_of_two_at_most;
#[cfg(feature = "view")]
use lasray::gpu::Order;
use lasray::gpu::{Buffer, BufferCopy, MemoryKind};
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Background, PassOptions, Renderer, Shade, View};
use lasray::render::image::{Image, MISS_CLASS};
use lasray::render::reference::beam::{Beam, beams};
use lasray::render::reference::shade::{is_seen, shade};
use lasray::render::reference::{ColumnMap, Hit, Point};
use lasray::resident::pool::Access;
use lasray::shared::passes::{TILE, WIDE_TILE};
use lasray::source::FLAG_WITHHELD;

/// Neither a multiple of a tile nor of a wide one, of which there are six.
const SIZE: [u32; 2] = [150, 100];

/// A few houses, in four sections.
fn houses() -> (Data, Vec<Point>) {
    let folder = tempfile::tempdir().unwrap();
    let path = scene::town(folder.path(), "town.las", [-40.0, -40.0], 80.0);
    let data = Data::load(std::slice::from_ref(&path), Some(0.5));
    let points = scene::points(&path, &data.placement);
    (data, points)
}

fn columns(data: &Data, points: &[Point]) -> ColumnMap {
    let steps = [data.grid.cell(), data.grid.height_step];
    ColumnMap::build(points.iter().copied(), steps, &ClassMask::default(), FLAG_WITHHELD)
}

/// From above, from among the houses, and parallel.
fn cameras(data: &Data) -> [Camera; 3] {
    let b = data.bounds;
    let wide = Projection::default();
    let parallel = Projection::Orthographic { units_per_pixel: 1.1 };
    let eye = b.center().with_z(b.min.z + 12.0);
    [
        Camera::frame(&b, [30.0, 35.0], wide, SIZE).unwrap(),
        Camera::look_at(eye, eye + glam::DVec3::new(-9.0, 31.0, -4.0), wide).unwrap(),
        Camera::frame(&b, [300.0, 50.0], parallel, SIZE).unwrap(),
    ]
}

/// Hits are found by f32 on the device and by f64 here: rays through the very edge of a column may differ, a few in a
/// thousand, which end elsewhere. Of all others the colour is within 1/255: divisions and square roots are good to 2.5 and 3 ulp, the powers of
/// sRGB to some 2⁻¹⁸, and sums over 24 and 40 neighbours lose a few ulp, all of it a hundredth of 1/255.
#[test]
fn shade_is_as_its_twin() {
    common::run("twins::shade_is_as_its_twin", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let (data, points) = houses();
        let map = columns(&data, &points);
        let mut scene = data.scene(&gpu, Access::Address, MEASURED());
        let mut renderer = data.renderer(&scene);
        let colors = |mode| ColorTable::new(mode, &data.summary, &data.grid, None, None).unwrap();
        let [rgb, height, class] = [ColorMode::Rgb, ColorMode::Height, ColorMode::Class].map(colors);
        let [intensity, returns] = [ColorMode::Intensity, ColorMode::Return].map(colors);
        let [above, density, apart] =
            [ColorMode::HeightAboveGround, ColorMode::Density, ColorMode::LineDifference].map(colors);
        let looks = [
            (&above, Shade::Lit, Background::White, 1.0),
            (&density, Shade::None, Background::White, 1.0),
            (&apart, Shade::Lit, Background::White, 1.0),
            (&rgb, Shade::Lit, Background::Sky, 1.0),
            (&height, Shade::Lit, Background::White, 1.0),
            (&class, Shade::Lit, Background::None, 2.5),
            (&height, Shade::None, Background::Sky, 1.0),
            (&class, Shade::None, Background::White, 1.0),
            (&rgb, Shade::None, Background::White, 1.0),
            (&intensity, Shade::Lit, Background::White, 1.0),
            (&returns, Shade::None, Background::White, 1.0),
        ];
        for (k, camera) in cameras(&data).iter().enumerate() {
            for (colors, shading, background, z_scale) in looks {
                let view = View {
                    samples: 1,
                    colors,
                    shade: shading,
                    background,
                    z_scale,
                    ..data.lit(camera, SIZE)
                };
                let image = renderer.draw(&mut scene, &view).unwrap();
                let rays = camera.basis(SIZE).unwrap().exaggerated(z_scale, view.pivot).unwrap();
                // Two images of the rays that end at the same place in the same class.
                let (mut ours, mut twin) =
                    (Image::new([SIZE[0] * SIZE[1], 1]), Image::new([SIZE[0] * SIZE[1], 1]));
                let mut elsewhere = 0;
                for (at, hit) in map.render(&rays, SIZE).into_iter().enumerate() {
                    // Below the slab a lit image ends.
                    let shown = |hit: &&Hit| shading == Shade::None || is_seen(&map, &view, hit);
                    let seen = hit.as_ref().filter(shown);
                    let distance = seen.map_or(f64::INFINITY, |hit| hit.distance);
                    let class = seen.map_or(MISS_CLASS, |hit| hit.class.into());
                    let off = (f64::from(image.distance[at]) - distance).abs();
                    let is_same =
                        image.class[at] == class && (distance.is_infinite() || off < 2e-4 * distance);
                    if !is_same {
                        elsewhere += 1;
                        continue;
                    }
                    let pixel = [at as u32 % SIZE[0], at as u32 / SIZE[0]].map(f64::from);
                    twin.color[at] = shade(&map, &view, &rays, pixel, hit).map(|v| v as f32);
                    ours.color[at] = image.color[at];
                }
                let differ = scene::pixels_that_differ(&ours, &twin);
                let what = format!("camera {k}, {:?}, {shading:?}, {background:?}", colors.mode);
                println!("{what}: {differ} differ, {elsewhere} end elsewhere");
                assert!(elsewhere <= image.color.len() / 250, "{what}: {elsewhere} rays end elsewhere");
                assert_eq!(differ, 0, "{what}");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// What no beam may do is exact: no ray of its tile has met anything where it ends. How far it comes is the twin's, word
/// for word but the last of its 18 bits, as long as every decision falls as there: `fma` may round once or twice and a
/// division is good to 2.5 ulp, which moves a stretch's end by a few ulp of 24 bits, and where it lies on a border of nodes
/// or a box just fits, the level. Lavapipe rounds as Rust does, so that hardly a tile differs.
#[test]
fn beams_are_as_their_twins() {
    common::run("twins::beams_are_as_their_twins", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let (data, points) = houses();
        let map = columns(&data, &points);
        let mut scene = data.scene(&gpu, Access::Address, MEASURED());
        let options = PassOptions { beams: true, ..PassOptions::default() };
        let mut renderer = Renderer::with_options(&scene, data.grid, data.anchor, options).unwrap();
        let unit = power_of_two_at_most(data.grid.cell());
        let tiles = |side: u32| SIZE.map(|pixels| pixels.div_ceil(side) as usize);
        let (mut hits, mut near) = (0, 0);
        for (k, camera) in cameras(&data).iter().enumerate() {
            let view = data.exact(camera, SIZE);
            let table = renderer.table(&scene);
            renderer.draw_table(&mut scene, &view, &table).unwrap();
            let [narrow, wide] = [TILE, WIDE_TILE].map(tiles).map(|[x, y]| x * y);
            let (mut commands, _) = scene.order.begin_frame("beams read back").unwrap();
            let back = [narrow, wide].map(|tiles| {
                Buffer::new(&gpu, "beams read back", MemoryKind::Readback, 4 * tiles as u64).unwrap()
            });
            let from = renderer.beams().expect("a frame was drawn");
            let whole = |buffer: &Buffer| BufferCopy { from: 0, to: 0, size: buffer.size() };
            let copies = [0, 1].map(|k| (from[k], &back[k], whole(&back[k])));
            scene.order.readback(&mut commands, &copies);
            let point = scene.order.submit(commands).unwrap();
            let [mut narrow, mut wide] = [narrow, wide].map(|tiles| vec![0u32; tiles]);
            scene.order.read(point, &back[0], 0, bytemuck::cast_slice_mut(&mut narrow)).unwrap();
            scene.order.read(point, &back[1], 0, bytemuck::cast_slice_mut(&mut wide)).unwrap();

            let what = (&view, &data.grid, data.anchor);
            let twin_wide = beams(what, (&map, &table), WIDE_TILE, None).unwrap();
            let twin = beams(what, (&map, &table), TILE, Some((WIDE_TILE, &wide))).unwrap();
            assert!(same(&wide, &twin_wide) >= wide.len(), "camera {k}: {wide:x?}, twin {twin_wide:x?}");
            let agree = same(&narrow, &twin);
            println!("camera {k}: {agree} of {} beams agree", narrow.len());
            assert!(agree * 50 >= narrow.len() * 49, "camera {k}: {agree} of {} beams agree", narrow.len());

            let rays = camera.basis(SIZE).unwrap();
            for (at, hit) in map.render(&rays, SIZE).into_iter().enumerate() {
                let Some(hit) = hit else { continue };
                hits += 1;
                let [x, y] = [at as u32 % SIZE[0], at as u32 / SIZE[0]];
                let length = rays.length(x.into(), y.into());
                for (words, side) in [(&narrow, TILE), (&wide, WIDE_TILE)] {
                    let tile = (y / side) as usize * tiles(side)[0] + (x / side) as usize;
                    let reached = f64::from(Beam::of(words[tile]).depth) * unit * length;
                    assert!(reached <= hit.distance, "camera {k}, {x}, {y}: {reached} of {}", hit.distance);
                    near += usize::from(side == TILE && reached > 0.8 * hit.distance);
                }
            }
        }
        // Beams that reach nothing would pass.
        println!("{near} of {hits} rays start near their hits");
        assert!(near * 4 > hits, "{near} of {hits} rays start near their hits");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// Words of the same level whose reach differs by no more than the last of its bits.
fn same(words: &[u32], twins: &[u32]) -> usize {
    let alike = |a: u32, b: u32| a & 31 == b & 31 && (a >> 5).abs_diff(b >> 5) <= 1;
    assert_eq!(words.len(), twins.len());
    words.iter().zip(twins).filter(|(a, b)| alike(**a, **b)).count()
}

/// A byte is the twin's code rounded. GLSL's `pow` is `exp2(y · log2(x))`, `log2` good to 3 ulp and `exp2` to 3 + 2 |x|: of
/// values from 0.0031 to 1 that is 2 · 10⁻⁶ or 5 · 10⁻⁴ of a code, which counts where the code lies between two bytes.
#[cfg(feature = "view")]
#[test]
fn screen_is_as_its_twin() {
    use lasray::render::reference::screen::codes;
    use lasray::shared::passes::SCREEN_THREADS;
    common::run("twins::screen_is_as_its_twin", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let pixels = SIZE[0] * SIZE[1];
        let scale = 1.0 / 0.75f32;
        let sums: Vec<[f32; 4]> = (0..pixels)
            .map(|k| {
                // All values, the dark ones, and what is out of range.
                let v = k as f32 / pixels as f32;
                [0.75 * v, 0.006 * v, 2.0 * v - 0.5, v]
            })
            .collect();
        let bytes = 16 * u64::from(pixels);
        let from = Buffer::new(&gpu, "sums", MemoryKind::Upload, bytes).unwrap();
        let to = Buffer::new(&gpu, "bytes", MemoryKind::Device, bytes / 4).unwrap();
        let back = Buffer::new(&gpu, "bytes read back", MemoryKind::Readback, bytes / 4).unwrap();
        from.write(0, bytemuck::cast_slice(&sums));
        let pipeline = lasray::render::screen::desc().make(&gpu).unwrap();
        let mut order = Order::new(&gpu, 1).unwrap();
        let (mut commands, _) = order.begin_frame("screen").unwrap();
        [&from, &to].iter().for_each(|&buffer| commands.keep(buffer.clone()));
        commands.bind(&pipeline);
        let halves = |address: u64| [address as u32, (address >> 32) as u32];
        let [[from_low, from_high], [to_low, to_high]] = [from.address(), to.address()].map(halves);
        let push = [from_low, from_high, to_low, to_high, SIZE[0], scale.to_bits()];
        commands.push(bytemuck::cast_slice(&push));
        commands.dispatch([SIZE[0].div_ceil(SCREEN_THREADS), SIZE[1], 1]);
        order.readback(&mut commands, &[(&to, &back, BufferCopy { from: 0, to: 0, size: bytes / 4 })]);
        let point = order.submit(commands).unwrap();
        let mut words = vec![[0u8; 4]; pixels as usize];
        order.read(point, &back, 0, bytemuck::cast_slice_mut(&mut words)).unwrap();
        for (sum, word) in sums.iter().zip(words) {
            let codes = codes(*sum, scale);
            let off = (0..3).map(|k| (f64::from(word[k]) - codes[k]).abs()).fold(0.0, f64::max);
            assert!(off <= 0.5 + 5e-4 && word[3] == 255, "{sum:?}: {word:?} for {codes:?}");
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
