use super::tile::RINGED;
use super::*;
use crate::coords::{Grid, HEIGHT_STEP};
use crate::source::{FLAG_WITHHELD, PointBlock};
use lows::Seen;
use std::collections::HashMap;

type Tiles = HashMap<TileKey, LowTile>;

/// Finest cells of `cell`, a metre in units.
fn grid_of(cell: f64, metre: f64) -> GroundGrid {
    let grid = Grid { base_cell: cell, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };
    GroundGrid::new(grid, metre).unwrap()
}

/// Ground cells of a metre.
fn metres() -> GroundGrid {
    grid_of(0.25, 1.0)
}

fn key(x: i32, y: i32) -> TileKey {
    TileKey { level: 2, x, y }
}

/// Numbers below `below`, the same each time.
fn random(seed: u64) -> impl FnMut(u32) -> u32 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move |below| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as u32) % below
    }
}

/// Tiles from (-1, -1) to (1, 1) of what `at` says of each cell: the height of its lowest point, CRS units. Cells are counted
/// from the south-western one of the middle tile.
fn nine(ground: &GroundGrid, at: impl Fn(i32, i32) -> Option<f64>) -> Tiles {
    let side = TILE_SIDE as i32;
    let mut tiles = Tiles::new();
    for (x, y) in (-side..2 * side).flat_map(|y| (-side..2 * side).map(move |x| (x, y))) {
        if let Some(up) = at(x, y) {
            let key = TileKey { level: ground.level, x: x.div_euclid(side), y: y.div_euclid(side) };
            let height = ground.grid.height(up).unwrap().0;
            let cell = (y.rem_euclid(side) * side + x.rem_euclid(side)) as usize;
            tiles.entry(key).or_default().see(cell, Seen { height, is_trusted: false, is_only: true });
        }
    }
    tiles
}

fn infer(ground: &GroundGrid, tiles: &Tiles, key: TileKey) -> GroundTile {
    GroundFilter::default().tile(ground, key.around().map(|key| tiles.get(&key)))
}

/// The middle one of such tiles.
fn middle(ground: &GroundGrid, at: impl Fn(i32, i32) -> Option<f64>) -> GroundTile {
    let middle = TileKey { level: ground.level, x: 0, y: 0 };
    infer(ground, &nine(ground, at), middle)
}

fn cells() -> impl Iterator<Item = [i32; 2]> {
    let side = TILE_SIDE as i32;
    (0..side).flat_map(move |y| (0..side).map(move |x| [x, y]))
}

/// Hills with houses, trees, pits, holes, and cells without points.
fn land(seed: u64) -> impl Fn(i32, i32) -> Option<f64> {
    let mut next = random(seed);
    let blocks: Vec<_> = (0..300)
        .map(|_| {
            let [x, y] = [0, 1].map(|_| next(768) as i32 - 256);
            let [w, h] = [0, 1].map(|_| 1 + next(64) as i32);
            (
                x..x + w,
                y..y + h,
                [Some(f64::from(next(20))), Some(-f64::from(next(9))), None][next(8).min(2) as usize],
            )
        })
        .collect();
    let slopes = [0, 1].map(|_| f64::from(next(60)) / 100.0);
    let share = 20 + next(80);
    move |x, y| {
        let mut noise = random(seed ^ (i64::from(x) * 7919 + i64::from(y) * 104_729) as u64);
        noise(9);
        if noise(100) >= share {
            return None;
        }
        let mut up = f64::from(x) * slopes[0]
            + (f64::from(y) * slopes[1] / 9.0).sin() * 9.0
            + f64::from(noise(300)) / 1000.0;
        for (columns, rows, rise) in &blocks {
            if columns.contains(&x) && rows.contains(&y) {
                up += (*rise)?;
            }
        }
        Some(if noise(400) == 0 { up - 30.0 } else { up })
    }
}

#[test]
fn a_twin_written_apart_comes_to_the_same() {
    // At a corner of four tiles, in the middle of one, at a border with a wide void.
    let places = [[208, 208], [60, 60], [208, 0]];
    let grounds = [metres(), grid_of(0.3, 1.0), grid_of(4.0, 1.0)];
    let mut counts = [0; 5];
    for (seed, (ground, corner)) in (1..).zip(grounds.into_iter().zip(places)) {
        let up = land(seed);
        let is_void = |x: i32, y: i32| seed == 3 && (225..290).contains(&x) && (-30..60).contains(&y);
        let mut tiles = nine(&ground, |x, y| up(x, y).filter(|_| !is_void(x, y)));
        // Classes tell the ground here and there.
        let mut next = random(seed);
        for key in [[-1, 0], [0, 0], [1, 1]] {
            let key = TileKey { level: ground.level, x: key[0], y: key[1] };
            let tile = tiles.entry(key).or_default();
            for _ in 0..300 {
                let cell = next(TILE_CELLS as u32) as usize;
                let height = (next(20_000) as i32) - 5000;
                if is_void((cell % TILE_SIDE) as i32, (cell / TILE_SIDE) as i32) {
                    continue;
                }
                tile.see(cell, Seen { height, is_trusted: true, is_only: true });
            }
        }
        const SIDE: i32 = 48;
        let (around, side) = (corner.map(|at| at - MARGIN as i32), SIDE + 2 * MARGIN as i32);
        let twin = twin::ground(&ground, &tiles, around, [side; 2]);
        let tile = infer(&ground, &tiles, TileKey { x: 0, y: 0, level: ground.level });
        for k in 0..SIDE * SIDE {
            let [x, y] = [corner[0] + k % SIDE, corner[1] + k / SIDE];
            let same = twin[((y - around[1]) * side + x - around[0]) as usize];
            let flags = tile.flags([x, y]);
            let told = [flags & MEASURED, flags & OBJECT, flags & LOW].map(|flag| flag != 0);
            assert_eq!(told, [same.is_measured, same.is_object, same.is_low], "{seed}: {x}, {y}: {same:?}");
            let height = tile.height([x, y]);
            assert_eq!(height, Some(same.height as i32).filter(|_| !same.height.is_nan()), "{x}, {y}");
            assert_eq!(flags & FILLED != 0, height.is_some() && !same.is_measured);
            assert!((f64::from(tile.slope([x, y])) - same.slope).abs() <= 1e-6 * same.slope.max(1.0));
            let seen =
                [same.is_measured, same.is_object, same.is_low, height.is_none(), flags & CLASSIFIED != 0];
            counts.iter_mut().zip(seen).for_each(|(n, is)| *n += u32::from(is));
        }
    }
    println!("measured, objects, low, void, classified: {counts:?}");
    assert!(
        counts[0] > 2000 && counts[1] > 200 && counts[2] > 3 && counts[3] > 99 && counts[4] > 9,
        "{counts:?}"
    );
}

#[test]
fn neighbours_agree_bit_by_bit() {
    let ground = metres();
    let tiles = nine(&ground, land(7));
    let [west, east, north] = [key(0, 0), key(1, 0), key(0, 1)].map(|key| infer(&ground, &tiles, key));
    let row = |tile: &GroundTile, [x, y]: [i32; 2]| {
        (tile.height([x, y]), tile.slope([x, y]).to_bits(), tile.flags([x, y]))
    };
    let side = TILE_SIDE as i32;
    for k in 0..side {
        assert_eq!(row(&west, [side, k]), row(&east, [0, k]));
        assert_eq!(row(&west, [side - 1, k]), row(&east, [-1, k]));
        assert_eq!(row(&west, [k, side]), row(&north, [k, 0]));
        assert_eq!(row(&west, [k, side - 1]), row(&north, [k, -1]));
    }
}

#[test]
fn a_tile_depends_on_its_margin_alone() {
    let ground = metres();
    let here = land(5);
    let tiles = nine(&ground, &here);
    let tile = infer(&ground, &tiles, key(0, 0));
    let (reach, side) = (MARGIN as i32, TILE_SIDE as i32);
    let beyond = |x: i32, y: i32| [x, y].iter().any(|v| !(-reach..side + reach).contains(v));
    let far = land(6);
    let other = nine(&ground, |x, y| if beyond(x, y) { far(x, y) } else { here(x, y) });
    assert_ne!(tiles[&key(1, 1)], other[&key(1, 1)]);
    assert!(tile == infer(&ground, &other, key(0, 0)));
    // What is near its border changes it there, and memory of other tiles does not.
    let near = nine(&ground, |x, y| if x >= side { far(x, y) } else { here(x, y) });
    let mut filter = GroundFilter::default();
    let around = |tiles: &Tiles| key(0, 0).around().map(|key| tiles.get(&key).cloned());
    let mut of = |tiles: &Tiles| filter.tile(&ground, around(tiles).each_ref().map(Option::as_ref));
    let changed = of(&near);
    assert!(changed != tile && of(&tiles) == tile);
    let differs = |[x, y]: [i32; 2]| changed.height([x, y]) != tile.height([x, y]);
    assert!(cells().filter(|&at| differs(at)).all(|[x, _]| x >= side - reach));
}

/// Points of the middle four tiles and of strays, as records of a file.
fn points(seed: u64, n: u32) -> PointBlock {
    let mut next = random(seed);
    let mut block = PointBlock::default();
    for _ in 0..n {
        block.x.push(next(40_000) as i32 - 20_000);
        block.y.push(if next(500) == 0 { 5_000_000 } else { next(40_000) as i32 - 20_000 });
        block.z.push(if next(900) == 0 { i32::MAX } else { next(9_000) as i32 });
        block.class.push([0, 1, 2, 2, 5, 6, 7, 9, 18][next(9) as usize]);
        block.flags.push(if next(9) == 0 { FLAG_WITHHELD } else { 0 });
        block.returns.push([0x11, 0x21, 0x22][next(3) as usize]);
    }
    block
}

fn piece(block: &PointBlock, of: impl Iterator<Item = usize> + Clone) -> PointBlock {
    let pick = |from: &[i32]| of.clone().map(|i| from[i]).collect();
    let bytes = |from: &[u8]| of.clone().map(|i| from[i]).collect();
    PointBlock {
        x: pick(&block.x),
        y: pick(&block.y),
        z: pick(&block.z),
        class: bytes(&block.class),
        flags: bytes(&block.flags),
        returns: bytes(&block.returns),
        ..PointBlock::default()
    }
}

const CORE: [std::ops::Range<i64>; 2] = [-4000..4000, -4000..4000];

fn gathered(ground: GroundGrid, parts: &[PointBlock], threads: usize) -> (Tiles, u64) {
    let tiles = LowTiles::new(ground, CORE);
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let tiles = &tiles;
            scope.spawn(move || {
                let mut own = Gatherer::default();
                for block in parts.iter().skip(thread).step_by(threads) {
                    tiles.add(&mut own, block, |first, axes| {
                        for (axis, raw) in axes.into_iter().zip([&block.x, &block.y, &block.z]) {
                            axis.iter_mut().zip(&raw[first..]).for_each(|(to, v)| *to = f64::from(*v) * 0.01);
                        }
                    });
                }
            });
        }
    });
    tiles.finish()
}

#[test]
fn order_threads_and_cuts_change_nothing() {
    let ground = metres();
    let all = points(3, 60_000);
    let whole = gathered(ground, std::slice::from_ref(&all), 1);
    // As one point after the other would have it.
    let mut one = HashMap::<(TileKey, usize), (i32, i32, bool)>::new();
    let mut outside = 0;
    for k in 0..all.len() {
        if !takes_part(all.class[k], all.flags[k]) {
            continue;
        }
        let [e, n, u] = [all.x[k], all.y[k], all.z[k]].map(|v| f64::from(v) * 0.01);
        let height = ground.grid.height(u);
        let Some((height, cell)) = height.zip(ground.grid.cell_of(e, n)).filter(|_| n < 1000.0) else {
            outside += 1;
            continue;
        };
        let (key, cell) = ground.place(cell);
        let seen = one.entry((key, cell)).or_insert((NONE, NONE, false));
        seen.0 = seen.0.min(height.0);
        seen.1 = if [2, 9, 41].contains(&all.class[k]) { seen.1.min(height.0) } else { seen.1 };
        seen.2 |= all.returns[k] == 0x11;
    }
    assert!(outside > 50 && whole.1 == outside);
    for (&key, tile) in &whole.0 {
        for cell in 0..TILE_CELLS {
            let told = (tile.lowest()[cell], tile.trusted().unwrap()[cell], tile.has_only_return(cell));
            assert_eq!(told, one.get(&(key, cell)).copied().unwrap_or((NONE, NONE, false)));
        }
    }
    let mut next = random(9);
    let mut order: Vec<usize> = (0..all.len()).collect();
    (1..order.len()).rev().for_each(|k| order.swap(k, next(k as u32 + 1) as usize));
    let shuffled = piece(&all, order.iter().copied());
    assert!(gathered(ground, &[shuffled], 1) == whole);
    let mut cuts = vec![0, 1, 130, all.len()];
    cuts.extend((0..20).map(|_| next(all.len() as u32) as usize));
    cuts.sort_unstable();
    let parts: Vec<_> =
        cuts.windows(2).map(|cut| piece(&all, order[cut[0]..cut[1]].iter().copied())).collect();
    for threads in [1, 2, 5] {
        assert!(gathered(ground, &parts, threads) == whole, "{threads}");
    }
    // Parts that were gathered apart.
    let (mut merged, _) = gathered(ground, &parts[..9], 1);
    for (key, tile) in gathered(ground, &parts[9..], 1).0 {
        merged.entry(key).or_default().merge(&tile);
    }
    assert!(merged == whole.0);
    let [a, b] = [&whole.0, &merged].map(|tiles| infer(&ground, tiles, key(0, 0)));
    assert!(a == b);
}

#[test]
fn classes_can_be_left_aside() {
    let tiles = LowTiles::new(metres(), CORE).with_classes_erased();
    tiles.add(&mut Gatherer::default(), &points(1, 5000), |_, axes| {
        axes.into_iter().for_each(|axis| axis.fill(1.0));
    });
    let (tiles, _) = tiles.finish();
    assert!(tiles.len() == 1 && tiles.values().all(|tile| tile.trusted().is_none()));
}

#[test]
fn a_plane_is_ground_as_it_is() {
    let ground = metres();
    for slope in [0.0, 0.14, 1.0] {
        let tile = middle(&ground, |x, y| Some(100.0 + f64::from(x) * slope - f64::from(y) * slope / 2.0));
        for [x, y] in cells() {
            assert_eq!(tile.flags([x, y]), MEASURED);
            let up = 100.0 + f64::from(x) * slope - f64::from(y) * slope / 2.0;
            assert_eq!(tile.height([x, y]), Some(ground.grid.height(up).unwrap().0));
            assert!((f64::from(tile.slope([x, y])) - slope * 1.25f64.sqrt()).abs() < 0.002);
        }
        // Bilinear between the middles of cells, to a step.
        let at = tile.at([100.25, 200.5]).unwrap();
        assert!((at.height * HEIGHT_STEP - 100.0 - slope * (100.25 - 100.25)).abs() < 0.002, "{at:?}");
        assert!(at.holds(&ground, 100.0 + 0.49) && !at.holds(&ground, 100.0 - 0.52 - 1.4 * slope));
    }
}

#[test]
fn houses_on_a_slope_of_60_degrees_are_no_ground() {
    let ground = metres();
    let rise = 60f64.to_radians().tan();
    let is_house = |x: i32, y: i32| x.rem_euclid(40) < 10 && y.rem_euclid(40) < 10;
    let tile = middle(&ground, |x, y| Some(f64::from(x) * rise + if is_house(x, y) { 7.0 } else { 0.0 }));
    let (mut houses, mut lost) = (0, 0);
    for [x, y] in cells() {
        let at = tile.at([f64::from(x), f64::from(y)]).unwrap();
        let up = f64::from(x) * rise;
        // Below a house the land is filled in, as flat as a mean by distance is: by what two cells rise at most.
        let off = (at.height * HEIGHT_STEP - up).abs();
        assert!(off < 2.0 * rise, "{x}, {y}: {at:?} for {up}");
        houses += u32::from(is_house(x, y));
        assert!(
            !is_house(x, y)
                || tile.flags([x, y]) & (OBJECT | MEASURED) == OBJECT && !at.holds(&ground, up + 7.0)
        );
        lost += u32::from(!is_house(x, y) && !at.holds(&ground, up));
    }
    assert!(houses > 4000 && lost == 0, "{lost} of the ground");
}

#[test]
fn a_terrace_stays() {
    let ground = metres();
    // Walls of 4 m, one every 50 m.
    let up = |x: i32| f64::from(x.div_euclid(50)) * 4.0;
    let tile = middle(&ground, |x, _| Some(up(x)));
    for [x, y] in cells() {
        assert_eq!((tile.flags([x, y]), tile.height([x, y])), (MEASURED, Some((up(x) * 1024.0) as i32)));
    }
}

#[test]
fn a_pit_is_filled() {
    let ground = metres();
    for depth in [6.0, 30.0] {
        let tile = middle(&ground, |x, y| Some(if x % 30 == 7 && y % 30 == 7 { -depth } else { 0.0 }));
        for [x, y] in cells() {
            let is_pit = x % 30 == 7 && y % 30 == 7;
            assert_eq!(tile.flags([x, y]), if is_pit { LOW | FILLED } else { MEASURED });
            assert_eq!(tile.height([x, y]), Some(0));
        }
    }
    // Likewise between scattered points.
    let tile = middle(&ground, |x, y| {
        let is_pit = x.rem_euclid(60) == 33 && y.rem_euclid(60) == 33;
        (x.rem_euclid(3) == 0 && y.rem_euclid(3) == 0).then_some(if is_pit { -30.0 } else { 0.0 })
    });
    assert!(cells().all(|at| tile.height(at) == Some(0)));
    assert_eq!(tile.flags([33, 33]), LOW | FILLED);
}

#[test]
fn low_outliers_do_not_take_the_land_between_them() {
    let ground = metres();
    for (every, group, depth) in [(20, 1, 6.0), (20, 2, 6.0), (20, 2, 40.0), (7, 1, 12.0)] {
        let is_low = |x: i32, y: i32| [x, y].iter().all(|v| v.rem_euclid(every) < group);
        let tile = middle(&ground, |x, y| Some(if is_low(x, y) { -depth } else { 0.0 }));
        for [x, y] in cells() {
            let flags = if is_low(x, y) { LOW | FILLED } else { MEASURED };
            assert_eq!((tile.flags([x, y]), tile.height([x, y])), (flags, Some(0)), "{every}: {x}, {y}");
        }
    }
}

/// One cell in eight was reached on the ground, and here and there one far below it.
#[test]
fn ground_in_a_dense_forest_is_ground() {
    let ground = metres();
    let rise = |x: i32| f64::from(x) * 0.1;
    let of = |x: i32, y: i32| random((i64::from(x) * 7919 + i64::from(y) * 104_729) as u64);
    let is_low = |x: i32, y: i32| x.rem_euclid(20) == 3 && y.rem_euclid(20) == 7;
    let is_ground = |x: i32, y: i32| {
        let mut next = of(x, y);
        next(9);
        next(8) == 0 && !is_low(x, y)
    };
    for depth in [0.0, 15.0] {
        let up = |x: i32, y: i32| match (is_ground(x, y), is_low(x, y)) {
            (true, _) => rise(x),
            (_, true) => rise(x) - depth,
            _ => rise(x) + 12.0 + f64::from(of(x + 1, y)(800)) / 100.0,
        };
        let tile = middle(&ground, |x, y| Some(up(x, y)));
        let (mut reached, mut lost, mut low, mut missed, mut off) = (0, 0, 0, 0, 0);
        for [x, y] in cells() {
            let flags = tile.flags([x, y]);
            if is_low(x, y) && depth > 0.0 {
                low += 1;
                missed += u32::from(flags != LOW | FILLED);
            } else if is_ground(x, y) {
                reached += 1;
                lost += u32::from(flags != MEASURED);
            }
            let height = f64::from(tile.height([x, y]).unwrap()) * HEIGHT_STEP;
            off += u32::from((height - rise(x)).abs() > 0.5);
        }
        println!("{reached} reached on the ground, {lost} lost; {low} far below, {missed} missed; {off} off");
        // Around some, crowns are wider than openings take away.
        assert!(reached > 7000 && lost * 500 < reached && missed * 20 <= low && off < 650);
    }
}

#[test]
fn halls_are_removed_up_to_twice_the_largest_window() {
    let ground = metres();
    let hall = |side: i32| move |x: i32, y: i32| (60..60 + side).contains(&x) && (60..60 + side).contains(&y);
    for side in [5, 20, 30] {
        let tile = middle(&ground, |x, y| Some(if hall(side)(x, y) { 12.0 } else { 0.0 }));
        for [x, y] in cells() {
            let flags = if hall(side)(x, y) { OBJECT | FILLED } else { MEASURED };
            assert_eq!((tile.flags([x, y]), tile.height([x, y])), (flags, Some(0)), "{side}: {x}, {y}");
        }
    }
    // A disc of 18 cells fits in: the limit.
    let tile = middle(&ground, |x, y| Some(if hall(60)(x, y) { 12.0 } else { 0.0 }));
    assert_eq!((tile.flags([90, 90]), tile.height([90, 90])), (MEASURED, Some(12 * 1024)));
}

#[test]
fn a_wide_void_stays_open() {
    let ground = metres();
    let side = 70;
    let is_water = |x: i32, y: i32| (100..100 + side).contains(&x) && (100..100 + side).contains(&y);
    let tile = middle(&ground, |x, y| (!is_water(x, y)).then_some(3.0));
    for [x, y] in cells() {
        let near = [x - 99, y - 99, 100 + side - x, 100 + side - y].into_iter().min().unwrap();
        let flags = match is_water(x, y) {
            false => MEASURED,
            true if near <= 20 => FILLED,
            true => 0,
        };
        assert_eq!(tile.flags([x, y]), flags, "{x}, {y}");
        assert_eq!(tile.height([x, y]), (flags != 0).then_some(3 * 1024));
        assert_eq!(tile.at([f64::from(x), f64::from(y)]).is_some(), flags != 0);
    }
}

/// A house at the border of the data, and the data's border itself.
#[test]
fn what_stands_at_the_border_of_the_data_is_not_drawn_out() {
    let ground = metres();
    let is_house = |x: i32, y: i32| (0..16).contains(&x) && (50..80).contains(&y);
    let tile = middle(&ground, |x, y| (x >= 0).then_some(if is_house(x, y) { 9.0 } else { 0.0 }));
    for [x, y] in cells() {
        assert_eq!(tile.flags([x, y]) & OBJECT != 0, is_house(x, y), "{x}, {y}");
        assert_eq!(tile.height([x, y]), Some(0));
    }
}

#[test]
fn classes_are_trusted() {
    let ground = metres();
    let mut tiles = nine(&ground, |_, _| Some(0.0));
    // A bank that the filter would take for an object, and a pit.
    let trusted = |height: i32| Seen { height, is_trusted: true, is_only: false };
    let tile = tiles.get_mut(&key(0, 0)).unwrap();
    *tile = LowTile::default();
    for [x, y] in cells() {
        let cell = (y * 256 + x) as usize;
        let is_bank = (100..104).contains(&x);
        tile.see(cell, if is_bank { trusted(5 * 1024) } else { trusted(0) });
    }
    tile.see(200 * 256 + 200, trusted(-20 * 1024));
    let tile = infer(&ground, &tiles, key(0, 0));
    assert_eq!((tile.flags([102, 9]), tile.height([102, 9])), (MEASURED | CLASSIFIED, Some(5 * 1024)));
    assert_eq!((tile.flags([200, 200]), tile.height([200, 200])), (MEASURED | CLASSIFIED, Some(-20 * 1024)));
    // What is lower than ground in the same cell does not count.
    let mut low = LowTile::default();
    low.see(5, trusted(7));
    low.see(5, Seen { height: -9, is_trusted: false, is_only: false });
    let tile = GroundFilter::default().tile(&ground, std::array::from_fn(|k| (k == 4).then_some(&low)));
    assert_eq!((tile.height([5, 0]), tile.flags([5, 0])), (Some(7), MEASURED | CLASSIFIED));
}

#[test]
fn feet_are_metres_of_another_size() {
    let foot = 0.3048;
    let ground = grid_of(0.25, 1.0 / foot);
    assert_eq!((ground.cell(), ground.windows()), (4.0, 14));
    let is_house = |x: i32, y: i32| (50..58).contains(&x) && (50..60).contains(&y);
    // A step of 10 feet up, and one of a third of a metre.
    let tile = middle(&ground, |x, y| {
        Some(if is_house(x, y) {
            10.0
        } else if is_house(x, y - 50) {
            0.6
        } else {
            0.0
        })
    });
    for [x, y] in cells() {
        let flags = if is_house(x, y) { OBJECT | FILLED } else { MEASURED };
        assert!(is_house(x, y - 50) || tile.flags([x, y]) == flags, "{x}, {y}");
    }
    let at = tile.at([10.0, 10.0]).unwrap();
    assert!(at.holds(&ground, 1.63) && !at.holds(&ground, 1.65));
    // A pit of 15 feet is none, one of 22 is.
    for (depth, flags) in [(15.0, MEASURED), (22.0, LOW | FILLED)] {
        let tile = middle(&ground, |x, y| Some(if [x, y] == [9, 9] { -depth } else { 0.0 }));
        assert_eq!(tile.flags([9, 9]), flags, "{depth}");
    }
}

#[test]
fn nothing_is_void() {
    let ground = metres();
    let none = GroundFilter::default().tile(&ground, [None; 9]);
    let empty = LowTile::default();
    assert!(none == GroundFilter::default().tile(&ground, [Some(&empty); 9]));
    assert!(cells().all(|at| none.flags(at) == 0 && none.height(at).is_none()));
    assert_eq!(none.at([3.5, 7.5]), None);
    // One point fills what is near.
    let mut low = LowTile::default();
    low.see(0, Seen { height: 5, is_trusted: false, is_only: false });
    let tile = GroundFilter::default().tile(&ground, std::array::from_fn(|k| (k == 4).then_some(&low)));
    assert_eq!((tile.flags([0, 0]), tile.flags([20, 0]), tile.flags([21, 0])), (MEASURED, FILLED, 0));
    assert_eq!((tile.height([12, 16]), tile.height([12, 17])), (Some(5), None));
}

#[test]
fn heights_at_the_ends_of_the_lattice_do_not_overflow() {
    let ground = metres();
    let ends = [-2_147_483_647, 2_147_483_646];
    let mut next = random(4);
    let mut tiles = Tiles::new();
    for near in key(0, 0).around() {
        let tile = tiles.entry(near).or_default();
        for cell in (0..TILE_CELLS).filter(|cell| cell % 3 != 0) {
            let height = ends[next(2) as usize];
            tile.see(cell, Seen { height, is_trusted: next(50) == 0, is_only: false });
        }
    }
    let tile = infer(&ground, &tiles, key(0, 0));
    let heights: Vec<_> = cells().filter_map(|at| tile.height(at)).collect();
    assert!(heights.len() > 60_000 && *heights.iter().min().unwrap() >= ends[0]);
    assert_eq!(tile.slopes.len(), RINGED * RINGED);
    assert!(tile.slopes.iter().all(|slope| slope.is_finite()));
    for end in ends {
        let tile = middle_of(&ground, end);
        assert!(cells().all(|at| tile.height(at) == Some(end) && tile.slope(at) == 0.0));
    }
}

fn middle_of(ground: &GroundGrid, height: i32) -> GroundTile {
    let mut tile = LowTile::default();
    (0..TILE_CELLS)
        .step_by(2)
        .for_each(|cell| tile.see(cell, Seen { height, is_trusted: false, is_only: false }));
    GroundFilter::default().tile(ground, [Some(&tile); 9])
}

/// Ground points of the nine tiles on a slope with noise, in cells from the south-west of the middle one, and their height in steps.
fn noisy_slope(density: u32) -> Vec<([f64; 2], f64)> {
    let mut next = random(11);
    let n = density * 300 * 300;
    let mut place = || f64::from(next(300_000)) / 1000.0 - 22.5;
    let places: Vec<_> = (0..n).map(|_| [place(), place()]).collect();
    let mut next = random(12);
    let noise = move |_: &[f64; 2]| f64::from(next(201)) - 100.0;
    let noise: Vec<_> = places.iter().map(noise).collect();
    places.iter().zip(noise).map(|(&[x, y], noise)| ([x, y], (0.3 * x - 0.1 * y) * 1024.0 + noise)).collect()
}

#[test]
fn completed_ground_is_the_mean_of_its_points() {
    let ground = metres();
    let points = noisy_slope(4);
    let mut tiles = Tiles::new();
    let mut see = |[x, y]: [f64; 2], height: f64| {
        let [i, j] = [x, y].map(|v| (v + 0.5).floor() as i32);
        let tile = tiles.entry(key(i.div_euclid(256), j.div_euclid(256))).or_default();
        let cell = (j.rem_euclid(256) * 256 + i.rem_euclid(256)) as usize;
        tile.see(cell, Seen { height: height.ceil() as i32, is_trusted: false, is_only: false });
    };
    points.iter().for_each(|&(at, height)| see(at, height));
    let tile = infer(&ground, &tiles, key(0, 0));
    let complete = |points: &mut dyn Iterator<Item = &([f64; 2], f64)>| {
        let mut completion = Completion::new(&ground, 4.0);
        assert!((completion.radius() - 1.128).abs() < 0.001);
        for &([x, y], height) in points {
            // Those beyond the ring are another tile's.
            if let Some(surface) = [x, y].iter().all(|v| (-1.0..255.9).contains(v)).then(|| tile.at([x, y])) {
                completion.add([x, y], height - surface.unwrap().height);
            }
        }
        completion.heights(&tile)
    };
    let completed = complete(&mut points.iter());
    assert_eq!(completed, complete(&mut points.iter().rev()));
    let spread = |of: &dyn Fn([i32; 2]) -> i32| {
        let inside = cells().filter(|at| at.iter().all(|v| (8..248).contains(v)));
        let off =
            |[x, y]: [i32; 2]| f64::from(of([x, y])) - (0.3 * f64::from(x) - 0.1 * f64::from(y)) * 1024.0;
        let off: Vec<_> = inside.map(off).collect();
        let mean = |of: &dyn Fn(f64) -> f64| off.iter().map(|v| of(*v)).sum::<f64>() / off.len() as f64;
        [mean(&|v| v), mean(&|v| v * v).sqrt()]
    };
    let lowest = spread(&|at| tile.height(at).unwrap());
    let mean = spread(&|at| completed[GroundTile::index(at)]);
    println!("off by {lowest:.1?} steps, completed by {mean:.1?}");
    assert!(mean[0].abs() < -lowest[0] / 20.0 && mean[1] < lowest[1] / 2.0, "{mean:?} of {lowest:?}");
    // A void stays one, and so does what no point is near.
    let empty = GroundTile::void();
    assert!(complete(&mut std::iter::empty()) == tile.heights);
    let mut completion = Completion::new(&ground, f64::NAN);
    completion.add([5.0, 5.0], 1e300);
    assert!(completion.radius() == 20.0 && completion.heights(&empty) == empty.heights);
    assert!(
        completion.heights(&middle_of(&ground, -2_147_483_647))[GroundTile::index([5, 5])] > -2_147_483_647
    );
    completion.add([5.0, 5.0], f64::NEG_INFINITY);
    completion.add([5.0, 6.0], f64::NEG_INFINITY);
    let lowest = completion.heights(&middle_of(&ground, -2_147_483_647))[GroundTile::index([5, 5])];
    assert!(lowest < -2_130_000_000, "{lowest}");
}

fn roofs_of(ground: &GroundGrid, tiles: &Tiles) -> Vec<bool> {
    let around = TileKey { x: 0, y: 0, level: ground.level }.around();
    let bare: HashMap<_, _> = around.iter().map(|&key| (key, infer(ground, tiles, key))).collect();
    roofs(ground, around.map(|key| tiles.get(&key)), around.map(|key| bare.get(&key)))
}

#[test]
fn roofs_are_high_planar_and_large() {
    let ground = metres();
    // South-western corner, side, and height of a cell above flat land by its place in it.
    type Thing = (i32, i32, i32, fn(i32, i32) -> f64);
    let things: [(Thing, bool); 8] = [
        ((20, 20, 12, |_, _| 6.0), true),
        // A gable of 45 degrees, across the border of the tile.
        ((-8, 60, 16, |x, _| 11.0 - f64::from((2 * x - 15).abs()) / 2.0), true),
        ((60, 20, 4, |_, _| 3.0), true),
        // 9 m2, 1.5 m, a crown, and a staircase of a metre a cell both ways.
        ((80, 20, 3, |_, _| 3.0), false),
        ((100, 20, 12, |_, _| 1.5), false),
        ((120, 20, 12, |x, y| 5.0 + f64::from((x * 7 + y * 13) % 5)), false),
        ((20, 100, 14, |x, y| 4.0 + f64::from((x + y) % 2)), false),
        // A crown as flat as a roof, through which pulses went on.
        ((60, 100, 12, |_, _| 6.0), false),
    ];
    let thing = |x: i32, y: i32| {
        let of = things.iter().position(|((west, south, side, _), _)| {
            (*west..west + side).contains(&x) && (*south..south + side).contains(&y)
        })?;
        let (west, south, _, height) = things[of].0;
        Some((of, height(x - west, y - south)))
    };
    let up = |x: i32, y: i32| thing(x, y).map_or(0.0, |(_, height)| height);
    let is_crown = |x: i32, y: i32| thing(x, y).is_some_and(|(of, _)| of == 7);
    let mut tiles = nine(&ground, |x, y| Some(up(x, y)).filter(|_| !is_crown(x, y)));
    for [x, y] in cells().filter(|[x, y]| is_crown(*x, *y)) {
        let height = (up(x, y) * 1024.0) as i32;
        let seen = Seen { height, is_trusted: false, is_only: false };
        tiles.get_mut(&key(0, 0)).unwrap().see((y * 256 + x) as usize, seen);
    }
    let told = roofs_of(&ground, &tiles);
    for [x, y] in cells() {
        let truth = thing(x, y).is_some_and(|(of, _)| things[of].1);
        assert_eq!(told[(y * 256 + x) as usize], truth, "{x}, {y}: {:?}", thing(x, y));
    }
}

#[test]
fn roofs_depend_on_what_is_near_alone() {
    let ground = metres();
    let block = |x: i32, y: i32| x.rem_euclid(23) < 9 && y.rem_euclid(17) < 12;
    let up = |x: i32, y: i32| Some(if block(x, y) { 7.0 } else { 0.0 });
    let all = roofs_of(&ground, &nine(&ground, up));
    assert!(all.iter().filter(|is| **is).count() > 10_000);
    // Of the ground nothing changes but beyond its margin.
    let (reach, side) = (MARGIN as i32 + 14, TILE_SIDE as i32);
    let near = |v: i32| (-reach..side + reach).contains(&v);
    let cut = nine(&ground, |x, y| up(x, y).filter(|_| near(x) && near(y)));
    assert!(all == roofs_of(&ground, &cut));
    assert!(roofs(&ground, [None; 9], [None; 9]) == vec![false; TILE_CELLS]);
}
