//! What is derived of a smooth surface: corners of columns, over the borders of sections, and a pyramid above them.

use crate::common::{self, LAVAPIPE};
use crate::scene::{self, BRIDGED, Data, MEASURED};
use crate::{SIZE, cameras};
use lasray::coords::{SECTION_SIDE, SectionKey};
use lasray::gpu::Gpu;
use lasray::load::LoadOptions;
use lasray::render::frame::View;
use lasray::render::image::Image;
use lasray::resident::pool::Access;
use lasray::resident::scene::{ReadBack, Scene};
use lasray::resident::visibility::Visibility;
use lasray::section::{Derived, Surface};
use lasray::shared::payload::{
    END_STEP, JOINED_ABOVE, LIST_COUNTS, LIST_SOLID, SPAN_CORNER_STEP, STACK_LEVEL_1, STACK_LIST,
    STACK_SPANS, UPRIGHT,
};
use std::collections::HashMap;

/// Columns beside each other are of one surface if they differ by no more cells.
const JUMP: f64 = 2.5;
const SIDE: i32 = SECTION_SIDE as i32;

/// Several sections each way, some of them full.
fn town() -> Data {
    let folder = tempfile::tempdir().unwrap();
    let path = scene::town(folder.path(), "town.laz", [-80.0, -80.0], 160.0);
    Data::load_with(&[path], Some(0.25), |options| LoadOptions { surface: Surface::Smooth, ..options })
}

/// A section that was read back.
struct Words {
    words: Vec<u32>,
    derived: Derived,
    base: i32,
    corners: u32,
    /// Something may float.
    /// Words from a span to what it is joined with.
    joins: u32,
}

/// Lattice steps.
#[derive(Clone, Copy)]
struct Steps {
    jump: i32,
    cell: i32,
    slice_log2: u32,
}

impl Words {
    fn of(scene: &mut Scene, key: SectionKey) -> Words {
        let ReadBack { layout, derived: words, .. } = scene.read_back(key).unwrap().expect("live");
        let derived = layout.derived();
        let corners = layout.corners().expect("smooth");
        let joins = layout.joins().unwrap_or(0);
        Words { words, derived, base: layout.code.base, corners, joins }
    }

    fn code(&self, first: u32, k: u32) -> u32 {
        match self.derived.wide {
            true => self.words[(first + k) as usize],
            false => self.words[(first + k / 2) as usize] >> (16 * (k % 2)) & 0xFFFF,
        }
    }

    /// Of a node of a level of the pyramid.
    fn node(&self, level: u32, [x, y]: [u32; 2]) -> u32 {
        let block = |x: u32, y: u32| (y / 4 * Derived::SIDE + x / 4) * self.derived.block_words();
        if self.derived.floats && level < 2 {
            let (block, inner) = match level {
                0 => (block(x, y), y % 4 * 4 + x % 4),
                _ => (block(2 * x, 2 * y), STACK_LEVEL_1 + y % 2 * 2 + x % 2),
            };
            let word = self.words[(block + inner) as usize];
            return if self.derived.wide { word } else { word & 0xFFFF };
        }
        match level {
            0 => self.code(block(x, y), y % 4 * 4 + x % 4),
            1 => self.code(block(2 * x, 2 * y), 16 + y % 2 * 2 + x % 2),
            _ => {
                let side = SECTION_SIDE >> level;
                self.code(self.derived.upper_levels(), (0x4000 - 4 * side * side) / 3 + y * side + x)
            }
        }
    }

    /// A word of a column's block, where something may float; 0 elsewhere.
    fn in_block(&self, [x, y]: [u32; 2], word: u32) -> u32 {
        let block = (y / 4 * Derived::SIDE + x / 4) * self.derived.block_words();
        if self.derived.floats { self.words[(block + word) as usize] } else { 0 }
    }

    /// Of what is solid of a column: in its block's list, where there is one.
    fn solid(&self, [x, y]: [u32; 2]) -> u32 {
        match self.in_block([x, y], STACK_LIST) {
            0 => self.node(0, [x, y]),
            list => self.code(list + LIST_SOLID, y % 4 * 4 + x % 4),
        }
    }

    /// First words of the spans of a column.
    fn spans(&self, [x, y]: [u32; 2]) -> Vec<u32> {
        let list = self.in_block([x, y], STACK_LIST);
        if list == 0 {
            return Vec::new();
        }
        let count = |k: u32| self.words[(list + LIST_COUNTS + k / 4) as usize] >> (8 * (k % 4)) & 0xFF;
        let inner = y % 4 * 4 + x % 4;
        let first: u32 = (0..inner).map(count).sum();
        let at = |k: u32| self.in_block([x, y], STACK_SPANS) + k * self.derived.span_words();
        (first..first + count(inner)).map(at).collect()
    }

    fn joined(&self, span: u32) -> [u32; 2] {
        [0, 1].map(|word| self.words[(span + self.joins + word) as usize])
    }

    /// What all spans are joined with.
    fn all_joined(&self) -> Vec<[u32; 2]> {
        let columns = (0..SECTION_SIDE).flat_map(|y| (0..SECTION_SIDE).map(move |x| [x, y]));
        columns.flat_map(|column| self.spans(column)).map(|span| self.joined(span)).collect()
    }

    /// Code that no span of a column leads above.
    fn highest_join(&self, column: [u32; 2], steps: Steps) -> u32 {
        let led = |span: u32| {
            let [top, bottom] = [0, 1].map(|k| self.code(span, k) as i32);
            let joined = self.joined(span);
            let bytes = joined.map(|word| word.to_le_bytes().map(|byte| i32::from(byte as i8)));
            let all = bytes.concat();
            let led = if [JOINED_ABOVE, UPRIGHT].contains(&joined[0]) || all.iter().all(|&byte| byte < -126) {
                top
            } else if all.contains(&-128) {
                // A tube, from its middle.
                let step = steps.slice_log2.saturating_sub(END_STEP);
                let end = all.iter().max().expect("eight") + 1;
                bottom + (top - bottom) / 2 + (end << step) + (steps.cell + 1) / 2
            } else {
                let step = steps.slice_log2.saturating_sub(SPAN_CORNER_STEP);
                let corner = bytes[0].iter().max().expect("four") + 1;
                (top >> step << step) + (corner << step)
            };
            led.max(top)
        };
        self.spans(column).into_iter().map(led).max().unwrap_or(0) as u32
    }

    /// South-west, south-east, north-west, north-east.
    fn corners(&self, [x, y]: [u32; 2]) -> [u32; 4] {
        let column = (y / 4 * Derived::SIDE + x / 4) * 16 + y % 4 * 4 + x % 4;
        [0, 1, 2, 3].map(|k| self.code(self.corners, column * 4 + k))
    }
}

/// Height of a corner of the column `around[0]`, of those that meet there in a circle: the mean of those that hang together.
fn corner(around: [Option<i32>; 4], jump: i32) -> i32 {
    let joined = |a: usize, b: usize| around[a].zip(around[b]).is_some_and(|(a, b)| (a - b).abs() <= jump);
    let mut part = vec![0];
    while let Some(next) =
        (1..4).find(|k| !part.contains(k) && part.iter().any(|&p| (p + k) % 2 == 1 && joined(p, *k)))
    {
        part.push(next);
    }
    let sum: i64 = part.iter().map(|&k| i64::from(around[k].expect("joined"))).sum();
    sum.div_euclid(part.len() as i64) as i32
}

/// Checks all corners of `keys`, which are all that is there, and the pyramid over them.
fn check(scene: &mut Scene, keys: &[SectionKey], steps: Steps, what: &str) {
    let jump = steps.jump;
    let sections: HashMap<SectionKey, Words> = keys.iter().map(|&key| (key, Words::of(scene, key))).collect();
    let top = |[i, j]: [i32; 2]| {
        let key = SectionKey { level: 0, i: i.div_euclid(SIDE), j: j.div_euclid(SIDE) };
        let section = sections.get(&key)?;
        let code = section.solid([i, j].map(|v| v.rem_euclid(SIDE) as u32));
        (code != 0).then(|| section.base + code as i32)
    };
    let mut shared = 0;
    for (key, section) in &sections {
        let mut bounds = vec![0; (SECTION_SIDE * SECTION_SIDE) as usize];
        for (x, y) in (0..SECTION_SIDE).flat_map(|y| (0..SECTION_SIDE).map(move |x| (x, y))) {
            let [i, j] = [key.i * SIDE + x as i32, key.j * SIDE + y as i32];
            let found = section.corners([x, y]);
            // What floats is in the pyramid, too.
            let bound = &mut bounds[(y * SECTION_SIDE + x) as usize];
            *bound = section.node(0, [x, y]).max(section.highest_join([x, y], steps));
            let Some(own) = top([i, j]) else {
                assert_eq!(found, [0; 4], "{what}, {key:?}, column {x}, {y}");
                continue;
            };
            let want = [[-1, -1], [1, -1], [-1, 1], [1, 1]].map(|[east, north]| {
                corner([[i, j], [i + east, j], [i + east, j + north], [i, j + north]].map(top), jump)
            });
            let most = if section.derived.wide { i32::MAX } else { 0xFFFF };
            let want = want.map(|height| (height - section.base).clamp(1, most) as u32);
            assert_eq!(found, want, "{what}, {key:?}, column {x}, {y}, {own}");
            *bound = want.into_iter().fold((*bound).max((own - section.base) as u32), u32::max);
            shared += u32::from(want != [want[0]; 4]);
        }
        for level in 1..=8 {
            let side = SECTION_SIDE >> level;
            bounds = (0..side * side)
                .map(|k| (k % side, k / side))
                .map(|(x, y)| {
                    let below = |dx: u32, dy: u32| bounds[((2 * y + dy) * 2 * side + 2 * x + dx) as usize];
                    below(0, 0).max(below(1, 0)).max(below(0, 1)).max(below(1, 1))
                })
                .collect();
            for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                let (want, found) = (bounds[(y * side + x) as usize], section.node(level, [x, y]));
                assert!(found == want, "{what}, {key:?}, level {level}: {x}, {y}: {found}, not {want}");
            }
        }
    }
    assert!(shared > 10_000, "{what}: next to nothing is uneven");
}

#[test]
fn corners_follow_what_comes_and_goes() {
    common::run("smooth::corners_follow_what_comes_and_goes", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let cell = data.grid.cell_steps(0);
        let slice_log2 = data.grid.stacking(0).slice_log2;
        let steps = Steps { jump: (JUMP * cell) as i32, cell: cell.ceil() as i32, slice_log2 };
        let keys: Vec<_> = data.sections.iter().map(|(key, _)| *key).collect();
        assert!(keys.len() >= 9, "{} sections", keys.len());
        for (access, shown) in
            [(Access::Address, BRIDGED()), (Access::StorageBuffer, BRIDGED()), (Access::Texels, MEASURED())]
        {
            let mut scene = data.scene(&gpu, access, shown);
            check(&mut scene, &keys, steps, "all at once");
            let joined = |scene: &mut Scene| -> Vec<_> {
                keys.iter().map(|key| Words::of(scene, *key).all_joined()).collect()
            };
            let all_joined = joined(&mut scene);
            let many = all_joined.iter().flatten().filter(|words| **words != [0x8080_8080; 2]).count();
            assert!(many > 1000, "next to nothing is joined");
            let (gone, left) = keys.split_at(3);
            scene.evict(gone).unwrap();
            scene.settle().unwrap();
            check(&mut scene, left, steps, "some gone");
            // One by one.
            for (k, (key, packed)) in data.sections[..3].iter().enumerate() {
                assert!(scene.upload(*key, packed).unwrap());
                scene.settle().unwrap();
                check(&mut scene, &[&keys[..=k], left].concat(), steps, "some come");
            }
            assert!(joined(&mut scene) == all_joined, "joined otherwise once all have come back");
            scene.set_visibility(Visibility { bridge: 4 - shown.bridge, ..shown }).unwrap();
            check(&mut scene, &keys, steps, "other bridges");
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

fn pictures(gpu: &Gpu, data: &Data, access: Access) -> Vec<Image> {
    let mut images = Vec::new();
    for visibility in [MEASURED(), BRIDGED()] {
        let mut scene = data.scene(gpu, access, visibility);
        let mut renderer = data.renderer(&scene);
        for camera in &cameras(&data.bounds) {
            let view: View =
                if visibility.bridge == 0 { data.exact(camera, SIZE) } else { data.lit(camera, SIZE) };
            images.push(renderer.draw(&mut scene, &view).unwrap());
        }
    }
    images
}

#[test]
fn all_ways_into_the_pool_give_the_same_pictures() {
    common::run("smooth::all_ways_into_the_pool_give_the_same_pictures", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let by_address = pictures(&gpu, &data, Access::Address);
        assert!(by_address == pictures(&gpu, &data, Access::StorageBuffer));
        assert!(by_address == pictures(&gpu, &data, Access::Texels));
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
