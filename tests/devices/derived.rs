//! The derived parts of sections against the same rules, cell by cell on the host.

use crate::common::{self, LAVAPIPE};
use glam::{IVec2, ivec2};
use lasray::attribute::{Attributes, ClassMask, Flags, Record, tells_nothing};
use lasray::coords::{Grid, HEIGHT_STEP, Height, SECTION_COLUMNS, SECTION_SIDE, SectionKey};
use lasray::gpu::Order;
use lasray::resident::pool::Access;
use lasray::resident::scene::{ReadBack, Scene};
use lasray::resident::visibility::{ColumnData, Visibility};
use lasray::section::{Columns, Derived, Payload, Surface, column_at};
use lasray::shared::payload::{FLOAT_MEANS, LIST_COUNTS, STACK_LIST, STACK_SPANS};
use lasray::source::{FLAG_KEY_POINT, FLAG_OVERLAP, FLAG_SYNTHETIC, FLAG_WITHHELD};
use std::collections::BTreeMap;

const GRID: Grid = Grid { base_cell: 0.25, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };
const SIDE: i32 = SECTION_SIDE as i32;
/// An eighth of a cell, lattice steps.
const TIE: i32 = 32;

/// Holes of all sizes, chains, points of all flags, steep steps; every other section too high for 16 bits.
fn section(i: i32, j: i32) -> Payload {
    section_of(Columns::default(), [i, j])
}

fn section_of(mut columns: Columns, [i, j]: [i32; 2]) -> Payload {
    for at in 0..SECTION_SIDE * SECTION_SIDE {
        let (x, y) = (at % SECTION_SIDE, at / SECTION_SIDE);
        // Blocks that hold nothing.
        if (x / 8 + y / 8) % 11 == 3 {
            continue;
        }
        let hash = |k: u32| (at ^ k << 17 ^ ((i * 5 + j + 9) as u32) << 22).wrapping_mul(2_654_435_761) >> 12;
        let mut add = |height: u32, class: u8, flags: u8| {
            let height = Height(height as i32);
            let (rgb, returns) = ([8, 9, 10].map(|k| hash(k) as u8), hash(11) as u8);
            let intensity = hash(12) as u16;
            columns.add(x, y, Record::pack(Attributes { height, class, intensity, rgb, returns, flags }));
        };
        // From dense in the west to a few columns in the east.
        if hash(1) % 256 >= x.max(20) * 15 / 16 {
            let ground = 9000 + x * 3 + y * 5 + hash(2) % 300;
            add(ground, 2, if hash(16) % 4 == 0 { FLAG_OVERLAP } else { 0 });
            // About as high, of classes that tell nothing.
            if hash(13) % 3 == 0 {
                add(ground + hash(14) % 64, [0, 1, 12][hash(15) as usize % 3], 0);
            }
        }
        if hash(3) % 5 == 0 && hash(1) % 256 >= x {
            add(9000 + hash(4) % 9000, [5, 6, 200][hash(5) as usize % 3], 0);
        }
        if hash(6) % 19 == 0 {
            let flags = [FLAG_WITHHELD, FLAG_SYNTHETIC, FLAG_KEY_POINT, FLAG_OVERLAP | FLAG_WITHHELD];
            add(9000 + hash(7) % 15000, 6, flags[hash(17) as usize % 4]);
        }
    }
    // Long chains in the first and the second half of a block, the second with more than are kept.
    for k in 0..300 {
        let class = (k % 256) as u8;
        let (rgb, flags) = ([k as u8; 3], if k < 256 { 0 } else { FLAG_WITHHELD });
        let height = Height(9000 + k * 37 % 1009);
        let record = Record::pack(Attributes { height, class, intensity: 3, rgb, returns: 0x21, flags });
        if k < 200 {
            columns.add(17, 1, record);
        }
        columns.add(18, 6, record);
    }
    if (i + j) % 2 != 0 {
        let height = Height(300_000);
        let (rgb, returns) = ([1, 2, 3], 0x11);
        columns.add(
            0,
            90,
            Record::pack(Attributes { height, class: 2, intensity: 9, rgb, returns, flags: 0 }),
        );
    }
    columns.pack()
}

/// Every column measured.
fn full() -> Payload {
    let mut columns = Columns::default();
    for at in 0..SECTION_SIDE * SECTION_SIDE {
        let height = Height(20_000 + (at % 99) as i32);
        let (rgb, returns) = ([5; 3], 0x11);
        let attributes = Attributes { height, class: 5, intensity: 9, rgb, returns, flags: 0 };
        columns.add(at % SECTION_SIDE, at / SECTION_SIDE, Record::pack(attributes));
    }
    columns.pack()
}

/// What a cell shows and its lattice height.
type Tops = BTreeMap<(i32, i32), (u32, i32)>;

fn tops(key: SectionKey, packed: &Payload, shown: &Visibility, column_data: ColumnData, tops: &mut Tops) {
    packed.columns(|column, runs| {
        let mut seen = runs.iter().filter(|r| shown.shows(r.kind()));
        if let Some(top) = seen.next() {
            let height = top.unpack().expect("a run").height;
            let as_high = |r: &&Record| height.0 - r.unpack().expect("a run").height.0 <= TIE;
            let tells = |r: &&Record| !tells_nothing(r.class());
            let settled = shown.near_ties && !tells(&top);
            let record = if settled { seen.take_while(as_high).find(tells).unwrap_or(top) } else { top };
            let Attributes { class, rgb: [r, g, b], intensity, returns, .. } =
                record.unpack().expect("a run");
            let shows = match column_data {
                ColumnData::Colors => [r, g, b],
                ColumnData::Values => [intensity as u8, (intensity >> 8) as u8, returns],
            };
            let shows = u32::from_le_bytes([shows[0], shows[1], shows[2], class]);
            let [x, y] = column_at(column).map(|v| v as i32);
            tops.insert((key.i * SIDE + x, key.j * SIDE + y), (shows, height.0));
        }
    });
}

/// Height and source of a hole, of the heights of measured columns.
pub(crate) fn bridge(
    measured: impl Fn(IVec2) -> Option<i32>,
    at: IVec2,
    reach: i32,
    level: u8,
) -> Option<(i32, IVec2)> {
    let steep = GRID.cell_steps(level) as i64;
    let nearest =
        |step: IVec2| (1..=4).find_map(|s| measured(at + step * s).map(|height| (s, i64::from(height))));
    let mut best: Option<([i64; 2], (i32, IVec2))> = None;
    for axis in [ivec2(1, 0), ivec2(0, 1), ivec2(1, 1), ivec2(1, -1)] {
        let (Some((back, low)), Some((on, high))) = (nearest(-axis), nearest(axis)) else { continue };
        let (span, drop) = (i64::from(back + on), (low - high).abs());
        let gap = if axis.x * axis.y == 0 { span - 1 } else { span * 3 / 2 - 1 };
        if gap > reach.into() || best.is_some_and(|(rank, _)| rank <= [span, drop]) {
            continue;
        }
        let even = drop <= steep * span;
        let height = if even { low + (high - low) * i64::from(back) / span } else { low.min(high) };
        let back_wins = if even { back < on || back == on && low <= high } else { low <= high };
        best = Some(([span, drop], (height as i32, if back_wins { -axis * back } else { axis * on })));
    }
    best.map(|(_, found)| found)
}

fn check(scene: &mut Scene, sections: &[(SectionKey, Payload)], shown: Visibility, column_data: ColumnData) {
    let mut all = Tops::new();
    sections.iter().for_each(|(key, packed)| tops(*key, packed, &shown, column_data, &mut all));
    let mut bridged = 0;
    for (key, _) in sections {
        let ReadBack { layout, derived: words, .. } = scene.read_back(*key).unwrap().expect("live");
        let derived = layout.derived();
        let code = |first: u32, k: usize| match derived.wide {
            true => words[first as usize + k],
            false => words[first as usize + k / 2] >> (16 * (k % 2)) & 0xFFFF,
        };
        let block = |x: u32, y: u32| (y / 4 * Derived::SIDE + x / 4) * derived.block_words();
        let mut level = vec![0; SECTION_COLUMNS];
        for (x, y) in (0..SECTION_SIDE).flat_map(|y| (0..SECTION_SIDE).map(move |x| (x, y))) {
            let at = ivec2(key.i * SIDE + x as i32, key.j * SIDE + y as i32);
            let top = all.get(&at.into());
            let what = format!("{shown:?}, {key:?}, column {x}, {y}");
            let bits = words[(block(x & !7, y) + derived.measured()) as usize] >> (y % 4 * 8 + x % 8);
            assert_eq!(bits & 1 != 0, top.is_some(), "measured: {what}");
            let height_at = |at: IVec2| all.get(&at.into()).map(|(_, height)| *height);
            let bridge = if top.is_none() { bridge(height_at, at, shown.bridge as i32, 0) } else { None };
            let source = top.or_else(|| bridge.map(|(_, s)| &all[&(at + s).into()]));
            let shows = words[(block(x, y) + derived.shown() + y % 4 * 4 + x % 4) as usize];
            assert_eq!(shows, source.map_or(0, |t| t.0), "shown: {what}");
            bridged += usize::from(bridge.is_some());
            let most = if layout.code.wide { u32::MAX } else { 0xFFFF };
            let above_base = |height: i32| i64::from(height) - i64::from(layout.code.base);
            let encode = |height: i32| above_base(height).clamp(1, most.into()) as u32;
            level[(y * SECTION_SIDE + x) as usize] =
                top.map(|t| t.1).or(bridge.map(|b| b.0)).map_or(0, encode);
        }
        let mut side = SECTION_SIDE as usize;
        loop {
            let node = |k: usize| {
                let (x, y) = ((k % side) as u32, (k / side) as u32);
                match side {
                    256 => code(block(x, y), (y % 4 * 4 + x % 4) as usize),
                    128 => code(block(2 * x, 2 * y), (16 + y % 2 * 2 + x % 2) as usize),
                    _ => code(derived.upper_levels(), (0x4000 - 4 * side * side) / 3 + k),
                }
            };
            let wrong = (0..side * side).find(|&k| node(k) != level[k]);
            assert_eq!(wrong, None, "{shown:?}, {key:?}, nodes of {} columns", SECTION_SIDE as usize / side);
            if side == 1 {
                break;
            }
            let half = side / 2;
            level = (0..half * half)
                .map(|k| k / half * 2 * side + k % half * 2)
                .map(|k| level[k].max(level[k + 1]).max(level[k + side]).max(level[k + side + 1]))
                .collect();
            side = half;
        }
    }
    assert_eq!(bridged > 100 * sections.len(), shown.bridge > 0);
}

#[test]
fn derived_parts_are_as_specified() {
    common::run("derived::derived_parts_are_as_specified", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        // One of nine is missing.
        let places = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))).filter(|at| *at != (1, 0));
        let sections: Vec<_> = places.map(|(i, j)| (SectionKey { level: 0, i, j }, section(i, j))).collect();
        let shown = Visibility {
            classes: ClassMask::only(&[2, 5, 6, 200]),
            hidden_flags: Flags::NONE,
            bridge: 0,
            near_ties: false,
        };
        for access in [Access::Address, Access::Texels, Access::StorageBuffer] {
            let mut scene = Scene::new(&gpu, |o: Order| o, access, 100 << 20, shown, GRID).unwrap();
            let (one_by_one, together) = sections.split_at(4);
            // Slots that were used before.
            let full = full();
            let keys: Vec<_> = sections.iter().map(|(key, _)| *key).collect();
            for key in &keys {
                assert!(scene.upload(*key, &full).unwrap());
            }
            scene.settle().unwrap();
            scene.evict(&keys).unwrap();
            scene.settle().unwrap();
            for (key, packed) in one_by_one {
                assert!(scene.upload(*key, packed).unwrap());
                scene.settle().unwrap();
            }
            for (key, packed) in together {
                assert!(scene.upload(*key, packed).unwrap());
            }
            scene.settle().unwrap();
            check(&mut scene, &sections, shown, ColumnData::Colors);
            scene.set_column_data(ColumnData::Values).unwrap();
            check(&mut scene, &sections, shown, ColumnData::Values);
            for (classes, hidden_flags, bridge, near_ties) in [
                (ClassMask::only(&[2, 5, 6, 200]), Flags::NONE, 4, false),
                (ClassMask::only(&[5, 200]), Flags::WITHHELD, 4, true),
                (ClassMask::only(&[2]), Flags::WITHHELD, 2, true),
                (ClassMask::only(&[6]), Flags::NONE, 0, false),
                (ClassMask::all(), Flags::WITHHELD, 4, false),
                (ClassMask::all(), Flags::WITHHELD, 4, true),
                (ClassMask::only(&[0, 1, 2, 12]), Flags::WITHHELD, 0, true),
                (ClassMask::all(), Flags::OVERLAP, 4, true),
                (ClassMask::only(&[2, 5, 6]), Flags::ALL, 0, false),
                (ClassMask::all(), Flags::SYNTHETIC.with(Flags::KEY_POINT), 4, false),
            ] {
                let shown = Visibility { classes, hidden_flags, bridge, near_ties };
                scene.set_visibility(shown).unwrap();
                scene.set_column_data(ColumnData::Colors).unwrap();
                check(&mut scene, &sections, shown, ColumnData::Colors);
                scene.set_column_data(ColumnData::Values).unwrap();
                check(&mut scene, &sections, shown, ColumnData::Values);
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// Codes, and bridges to where a neighbour is, 2³¹ steps and more above the lowest point of a section.
#[test]
fn codes_span_all_heights() {
    common::run("derived::codes_span_all_heights", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let (low, high) = (-1_200_000_000, 1_200_000_000);
        let holed = |surface: Surface, height: i32, lowest: i32| {
            let mut columns = Columns::new(surface, GRID.stacking(0));
            for (x, y) in (0..SECTION_SIDE).flat_map(|y| (0..SECTION_SIDE).map(move |x| (x, y))) {
                // Holes everywhere, and one in the corner that neighbours alone bridge.
                if (x * 7 + y * 5) % 3 == 0 || x.max(y) == 255 && x.min(y) > 249 {
                    continue;
                }
                let height = Height(if (x, y) == (41, 40) { lowest } else { height + (x % 9) as i32 });
                let (rgb, returns) = ([x as u8, y as u8, 3], 0x11);
                let attributes = Attributes { height, class: 2, intensity: 9, rgb, returns, flags: 0 };
                columns.add(x, y, Record::pack(attributes));
            }
            columns.pack()
        };
        let shown =
            Visibility { classes: ClassMask::all(), hidden_flags: Flags::NONE, bridge: 4, near_ties: false };
        for surface in [Surface::Columns, Surface::Smooth] {
            // Of narrow codes, with two neighbours that lie high above and reach as low.
            let sections: Vec<_> = [([0, 0], low), ([1, 0], high), ([0, 1], high)]
                .map(|([i, j], height)| (SectionKey { level: 0, i, j }, holed(surface, height, low)))
                .into();
            let mut scene = Scene::new(&gpu, |o: Order| o, Access::Address, 100 << 20, shown, GRID).unwrap();
            for (key, packed) in &sections {
                assert!(scene.upload(*key, packed).unwrap());
            }
            scene.settle().unwrap();
            assert_eq!([0, 1, 2].map(|k: usize| sections[k].1.layout.code.wide), [false, true, true]);
            if surface == Surface::Columns {
                check(&mut scene, &sections, shown, ColumnData::Colors);
            } else {
                // Nothing else is near the plateau: all corners of a column lie within its steps.
                let ReadBack { layout, derived: words, .. } =
                    scene.read_back(sections[1].0).unwrap().expect("live");
                let corners = layout.corners().expect("smooth") as usize;
                let lowest = (i64::from(high) - i64::from(layout.code.base)) as u32;
                assert!(lowest > 1 << 31);
                let of_plateau = words[corners..].iter().filter(|code| (lowest..lowest + 9).contains(code));
                let (found, all) = (of_plateau.count(), words[corners..].len());
                assert!(found > all - 100, "{found} of {all} corners are as high as the plateau");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// What is derived of a section of stacks, as far as passes under `shown` write it, and how many spans float.
fn written(scene: &mut Scene, key: SectionKey, shown: &Visibility) -> (Vec<u32>, u32) {
    let ReadBack { layout, derived: mut words, .. } = scene.read_back(key).unwrap().expect("live");
    let derived = layout.derived();
    let floats = layout.floats.expect("stacks");
    // Means are for bridges.
    if shown.bridge == 0 {
        words[(derived.floats() + FLOAT_MEANS) as usize..derived.lists() as usize].fill(0);
    }
    // Of the room for a half block's spans, what they take.
    let (lists, spans) = (derived.lists() as usize, derived.spans(floats) as usize);
    let rest = words.split_off(spans);
    let (mut of_spans, mut counted) = (Vec::<u32>::new(), 0);
    for block in words[..derived.upper_levels() as usize].chunks_exact(derived.block_words() as usize) {
        let [list, from] = [STACK_LIST, STACK_SPANS].map(|word| block[word as usize] as usize);
        if list == 0 {
            continue;
        }
        assert!(list >= lists && from >= spans, "every list is written");
        let (list, from) = (&words[list..], from - spans);
        let counts = &list[LIST_COUNTS as usize..LIST_COUNTS as usize + 4];
        let count: u32 = counts.iter().flat_map(|word| word.to_le_bytes()).map(u32::from).sum();
        of_spans.extend(&rest[from..from + (count * derived.span_words()) as usize]);
        counted += count;
    }
    words.extend(of_spans);
    (words, counted)
}

/// A mask shows and hides without a copy, and what it showed before comes back word for word, whatever was shown between.
#[test]
fn masks_of_stacks_copy_nothing_and_come_back_word_for_word() {
    common::run("derived::masks_of_stacks_copy_nothing_and_come_back_word_for_word", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let stacks = |at| section_of(Columns::new(Surface::Stacks, GRID.stacking(0)), at);
        // Of both widths of codes.
        let keys = [[0, 0], [1, 0], [0, 1]].map(|[i, j]| SectionKey { level: 0, i, j });
        let masks: Vec<_> = [
            (ClassMask::default(), Flags::WITHHELD, 4, true),
            (ClassMask::all(), Flags::NONE, 0, false),
            (ClassMask::only(&[5, 200]), Flags::WITHHELD, 4, true),
            (ClassMask::default().without(&[2]), Flags::NONE, 4, false),
            (ClassMask::only(&[2, 6]), Flags::WITHHELD, 2, true),
            (ClassMask::default().without(&[5, 6]), Flags::WITHHELD, 0, false),
            (ClassMask::only(&[1, 12, 200]), Flags::NONE, 0, true),
            (ClassMask::only(&[99]), Flags::WITHHELD, 4, false),
            (ClassMask::all(), Flags::OVERLAP, 4, true),
            (ClassMask::default(), Flags::ALL, 0, true),
        ]
        .into_iter()
        .map(|(classes, hidden_flags, bridge, near_ties)| Visibility {
            classes,
            hidden_flags,
            bridge,
            near_ties,
        })
        .collect();
        for access in [Access::Address, Access::Texels, Access::StorageBuffer] {
            let mut scene = Scene::new(&gpu, |o: Order| o, access, 100 << 20, masks[0], GRID).unwrap();
            for key in keys {
                assert!(scene.upload(key, &stacks([key.i, key.j])).unwrap());
            }
            scene.settle().unwrap();
            let uploaded = scene.counters();
            let mut show = |mask: &Visibility| {
                scene.set_visibility(*mask).unwrap();
                keys.map(|key| written(&mut scene, key, mask))
            };
            let first: Vec<_> = masks.iter().map(&mut show).collect();
            let floating: Vec<u32> =
                first.iter().map(|sections| sections.iter().map(|(_, spans)| spans).sum()).collect();
            println!("{access:?}: spans that float: {floating:?}");
            assert!(floating[..4].iter().all(|spans| *spans > 5000) && floating[7] == 0, "{floating:?}");
            for (k, mask) in masks.iter().enumerate().rev().chain(masks.iter().enumerate().step_by(3)) {
                for ((words, _), (before, _)) in show(mask).iter().zip(&first[k]) {
                    let wrong = (0..before.len()).find(|&at| words.get(at) != before.get(at));
                    assert!(wrong.is_none() && words.len() == before.len(), "{mask:?}: word {wrong:?}");
                }
            }
            let now = scene.counters();
            assert_eq!([now.section_bytes, now.sections], [uploaded.section_bytes, uploaded.sections]);
            // 9 other masks, 9 on the way back, 3 on the way there again.
            assert_eq!(now.builds, uploaded.builds + 3 * (9 + 9 + 3));
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// High columns of many spans of four keys, one between the others, many columns beside each other: drivers let loops turn only so often.
#[test]
fn all_of_many_spans_float() {
    common::run("derived::all_of_many_spans_float", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let mut columns = Columns::new(Surface::Stacks, GRID.stacking(0));
        let mut add = |x: u32, y: u32, height: i32, class: u8, flags: u8| {
            let height = Height(height);
            let attributes = Attributes { height, class, intensity: 9, rgb: [5; 3], returns: 0x11, flags };
            columns.add(x, y, Record::pack(attributes));
        };
        let (rows, spans) = (64..72, 240);
        for (x, y) in (0..SECTION_SIDE).flat_map(|x| (56..80).map(move |y| (x, y))) {
            add(x, y, 9000, 2, 0);
            if rows.contains(&y) {
                // Those of a key are farther apart than a gap.
                (0..spans).for_each(|k| {
                    add(x, y, 12_300 + k * 200, (k % 2) as u8, (k / 2 % 2) as u8 * FLAG_OVERLAP)
                });
            }
        }
        let shown = Visibility {
            classes: ClassMask::all(),
            hidden_flags: Flags::WITHHELD,
            bridge: 0,
            near_ties: false,
        };
        let mut scene = Scene::new(&gpu, |o: Order| o, Access::Address, 100 << 20, shown, GRID).unwrap();
        let key = SectionKey { level: 0, i: 0, j: 0 };
        assert!(scene.upload(key, &columns.pack()).unwrap());
        scene.settle().unwrap();
        let (_, floating) = written(&mut scene, key, &shown);
        assert_eq!(floating, SECTION_SIDE * rows.len() as u32 * spans as u32);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// A roof whose class tells nothing stands on every level alike: it floats along its rim at most, under which the ground was seen.
#[test]
fn a_roof_that_is_not_classified_stands_on_every_level() {
    common::run("derived::a_roof_that_is_not_classified_stands_on_every_level", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let grid = Grid { base_cell: 0.5, ..GRID };
        let shown = Visibility {
            classes: ClassMask::all(),
            hidden_flags: Flags::WITHHELD,
            bridge: 0,
            near_ties: false,
        };
        let mut scene = Scene::new(&gpu, |o: Order| o, Access::Address, 100 << 20, shown, grid).unwrap();
        // 45 m wide and 30 m high, from where no coarser cell begins.
        let (roof, height) = (37..127u32, grid.height(30.0).unwrap());
        for level in 0..5u8 {
            let mut columns = Columns::new(Surface::Stacks, grid.stacking(level));
            for (x, y) in (0..200u32).flat_map(|x| (0..200u32).map(move |y| (x, y))) {
                let is_roof = roof.contains(&x) && roof.contains(&y);
                let (height, class) = if is_roof { (height, 1) } else { (Height(0), 2) };
                let attributes =
                    Attributes { height, class, intensity: 9, rgb: [5; 3], returns: 0x11, flags: 0 };
                columns.add(x >> level, y >> level, Record::pack(attributes));
            }
            let key = SectionKey { level, i: 0, j: 0 };
            assert!(scene.upload(key, &columns.pack()).unwrap());
            scene.settle().unwrap();
            let (_, floating) = written(&mut scene, key, &shown);
            let cell = grid.base_cell * f64::from(1 << level);
            let (area, rim) = (f64::from(floating) * cell * cell, 4.0 * 45.0 * (cell + 1.0));
            println!("level {level}: {area} of {} square metres float", 45.0 * 45.0);
            assert!(area <= rim, "level {level}: {area} square metres float");
            assert!(level > 2 || area > 0.0, "level {level}: nothing floats");
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// With bridges over the borders, what has come, changed or gone changes what is derived of its neighbours, and that alone
/// is derived again.
#[test]
fn neighbours_follow_what_comes_changes_and_goes() {
    common::run("derived::neighbours_follow_what_comes_changes_and_goes", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let shown = Visibility {
            classes: ClassMask::only(&[2, 5, 6, 200]),
            hidden_flags: Flags::NONE,
            bridge: 4,
            near_ties: false,
        };
        let key = |i: i32, j: i32| SectionKey { level: 0, i, j };
        for access in [Access::Address, Access::StorageBuffer] {
            let mut scene = Scene::new(&gpu, |o: Order| o, access, 100 << 20, shown, GRID).unwrap();
            let mut there: Vec<(SectionKey, Payload)> = Vec::new();
            let put = |scene: &mut Scene, there: &mut Vec<(SectionKey, Payload)>, at, of: (i32, i32)| {
                let payload = section(of.0, of.1);
                assert!(scene.upload(at, &payload).unwrap());
                there.retain(|(key, _)| *key != at);
                there.push((at, payload));
            };
            let settled = |scene: &mut Scene, there: &[(SectionKey, Payload)]| {
                scene.settle().unwrap();
                check(scene, there, shown, ColumnData::Colors);
            };
            // The middle, then its neighbours: a corner alone, edges, the other corners beside those.
            for (i, j) in [(0, 0), (1, 1), (-1, 0), (0, 1), (0, -1), (1, 0), (-1, -1), (1, -1), (-1, 1)] {
                put(&mut scene, &mut there, key(i, j), (i, j));
                settled(&mut scene, &there);
            }
            // Other versions of the middle and of an edge, the second while the first is on its way; then of that again.
            put(&mut scene, &mut there, key(0, 0), (7, 3));
            scene.advance().unwrap();
            put(&mut scene, &mut there, key(0, 1), (4, -5));
            scene.advance().unwrap();
            put(&mut scene, &mut there, key(0, 1), (9, 9));
            settled(&mut scene, &there);
            // A corner and an edge go, one after the other and together, and come back.
            for gone in [&[key(1, 1)][..], &[key(-1, 0)], &[key(0, -1), key(-1, 1)]] {
                scene.evict(gone).unwrap();
                there.retain(|(key, _)| !gone.contains(key));
                settled(&mut scene, &there);
            }
            for (i, j) in [(1, 1), (-1, 0), (0, -1)] {
                put(&mut scene, &mut there, key(i, j), (i, j));
            }
            settled(&mut scene, &there);
            // What passes read lies in buffers that serve again.
            let made = scene.counters().buffers;
            for _ in 0..30 {
                put(&mut scene, &mut there, key(1, 0), (1, 0));
                scene.settle().unwrap();
            }
            assert!(scene.counters().buffers <= made + 8, "{} after {made}", scene.counters().buffers);
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
