//! The ground filter once more, written apart: one raster instead of tiles, f64, every neighbour looked at. Slow.

use super::grid::{GroundGrid, TILE_SIDE, TileKey};
use super::lows::{LowTile, NONE};
use std::collections::HashMap;

/// A raster of f64 in which NaN is nothing.
#[derive(Clone)]
struct Field {
    side: [i32; 2],
    values: Vec<f64>,
}

impl Field {
    fn of(side: [i32; 2], at: impl Fn(i32, i32) -> f64) -> Field {
        let values = (0..side[0] * side[1]).map(|k| at(k % side[0], k / side[0])).collect();
        Field { side, values }
    }

    fn at(&self, x: i32, y: i32) -> f64 {
        let inside = (0..self.side[0]).contains(&x) && (0..self.side[1]).contains(&y);
        if inside { self.values[(y * self.side[0] + x) as usize] } else { f64::NAN }
    }

    fn map(&self, of: impl Fn(i32, i32, f64) -> f64) -> Field {
        Field::of(self.side, |x, y| of(x, y, self.at(x, y)))
    }

    /// Over what is something within the element, of cells that are something.
    fn extreme(&self, element: &[[i32; 2]], pick: impl Fn(f64, f64) -> f64) -> Field {
        self.map(|x, y, here| {
            let near = element.iter().map(|[dx, dy]| self.at(x + dx, y + dy)).filter(|v| !v.is_nan());
            if here.is_nan() { here } else { near.reduce(&pick).unwrap() }
        })
    }

    fn opened(&self, element: &[[i32; 2]]) -> Field {
        self.extreme(element, f64::min).extreme(element, f64::max)
    }

    fn closed(&self, element: &[[i32; 2]]) -> Field {
        self.extreme(element, f64::max).extreme(element, f64::min)
    }

    /// What is nothing, from the nearest of each octant where at least so many have one.
    fn filled(&self, octants: usize) -> Field {
        let order = near_first();
        self.map(|x, y, here| {
            if !here.is_nan() {
                return here;
            }
            let mut nearest = [None; 8];
            for &[dx, dy] in &order {
                let (octant, value) = (octant(dx, dy), self.at(x + dx, y + dy));
                if !value.is_nan() && nearest[octant].is_none() {
                    // Weights are whole numbers.
                    let weight = (16_777_216.0 / f64::from(dx * dx + dy * dy)).floor();
                    nearest[octant] = Some((value, weight));
                }
            }
            let found: Vec<_> = nearest.into_iter().flatten().collect();
            if found.len() < octants {
                return f64::NAN;
            }
            let weights: f64 = found.iter().map(|(_, weight)| weight).sum();
            let mean = found.iter().map(|(value, weight)| value * weight).sum::<f64>() / weights;
            // So are heights.
            (mean + 0.5).floor()
        })
    }
}

/// Places within 20 cells, the nearest first; of those equally far the ones in the nearer row.
fn near_first() -> Vec<[i32; 2]> {
    let all = (-20..=20).flat_map(|dy| (-20..=20).map(move |dx| [dx, dy]));
    let mut near: Vec<_> = all.filter(|[dx, dy]| (1..=400).contains(&(dx * dx + dy * dy))).collect();
    near.sort_by_key(|[dx, dy]: &[i32; 2]| (dx * dx + dy * dy, dy.abs()));
    near
}

/// Counterclockwise from east: by the angle, in eighths of a turn.
fn octant(dx: i32, dy: i32) -> usize {
    let eighths = f64::from(dy).atan2(f64::from(dx)) / std::f64::consts::FRAC_PI_4;
    (eighths + 1e-9).floor().rem_euclid(8.0) as usize
}

fn disc(radius: i32) -> Vec<[i32; 2]> {
    let square = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| [dx, dy]));
    square.filter(|[dx, dy]| radius == 1 || dx * dx + dy * dy <= radius * radius).collect()
}

/// Whole cells in a length in m.
fn ground_cells(ground: &GroundGrid, length_m: f64) -> i32 {
    (length_m * ground.metre / ground.cell() + 1e-9).floor().max(1.0) as i32
}

/// 1 where openings by discs of up to `widest` cells take something away.
fn objects(ground: &GroundGrid, surface: &Field, widest: i32) -> Field {
    let mut is_object = surface.map(|_, _, _| 0.0);
    let mut before = surface.clone();
    for radius in 1..=widest {
        let opened = surface.opened(&disc(radius));
        let most = (0.15 * f64::from(radius) * ground.cell() / ground.grid.height_step).round();
        is_object = is_object
            .map(|x, y, is| f64::max(is, f64::from(u8::from(before.at(x, y) - opened.at(x, y) > most))));
        before = opened;
    }
    is_object
}

/// What the twin says of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Lattice steps; NaN: void.
    pub height: f64,
    pub slope: f64,
    pub is_measured: bool,
    pub is_object: bool,
    pub is_low: bool,
}

/// Of `side` cells each way from ground cell `first` on, counted from tile (0, 0), row by row from the south-west.
pub fn ground(
    ground: &GroundGrid,
    tiles: &HashMap<TileKey, LowTile>,
    first: [i32; 2],
    side: [i32; 2],
) -> Vec<Cell> {
    let read = |of: &dyn Fn(&LowTile, usize) -> i32| {
        Field::of(side, |x, y| {
            let (x, y, n) = (first[0] + x, first[1] + y, TILE_SIDE as i32);
            let key = TileKey { level: ground.level, x: x.div_euclid(n), y: y.div_euclid(n) };
            let cell = (y.rem_euclid(n) * n + x.rem_euclid(n)) as usize;
            let height = tiles.get(&key).map_or(NONE, |tile| of(tile, cell));
            if height == NONE { f64::NAN } else { f64::from(height) }
        })
    };
    let trusted = read(&|tile, cell| tile.trusted().map_or(NONE, |trusted| trusted[cell]));
    let lowest = read(&|tile, cell| tile.lowest()[cell]);
    let lows = lowest.map(|x, y, low| if trusted.at(x, y).is_nan() { low } else { trusted.at(x, y) });
    let step = ground.grid.height_step;
    let steps = |units: f64| (units / step).round();

    let surface = lows.filled(5);
    let closed = surface.closed(&disc(1));
    let deepest = steps(5.0 * ground.cell());
    let is_surrounded = lows
        .map(|x, y, low| f64::from(u8::from(closed.at(x, y) - low > deepest && trusted.at(x, y).is_nan())));
    // Without crowns.
    let crowns = objects(ground, &surface, ground_cells(ground, 4.0));
    let bare = lows.map(
        |x, y, low| {
            if crowns.at(x, y) == 1.0 && trusted.at(x, y).is_nan() { f64::NAN } else { low }
        },
    );
    let closed = bare.filled(5).closed(&disc(1));
    let is_low = lows.map(|x, y, low| {
        f64::from(u8::from(is_surrounded.at(x, y) == 1.0 && closed.at(x, y) - low > deepest))
    });
    let known = lows.map(|x, y, low| if is_low.at(x, y) == 1.0 { f64::NAN } else { low });
    let surface = known.filled(5);
    let is_object = objects(ground, &surface, ground_cells(ground, 18.0));
    let is_object = known.map(|x, y, low| {
        f64::from(u8::from(is_object.at(x, y) == 1.0 && !low.is_nan() && trusted.at(x, y).is_nan()))
    });
    let bare = known.map(|x, y, low| if is_object.at(x, y) == 1.0 { f64::NAN } else { low });
    let heights = bare.filled(1);
    let rise = |x: i32, y: i32, [dx, dy]: [i32; 2]| {
        let here = heights.at(x, y);
        let (back, ahead) = (heights.at(x - dx, y - dy), heights.at(x + dx, y + dy));
        let cells = f64::from(u8::from(!back.is_nan()) + u8::from(!ahead.is_nan())).max(1.0);
        let end = |v: f64| if v.is_nan() { here } else { v };
        (end(ahead) - end(back)) * step / (cells * ground.cell())
    };
    let cell = |k: i32| {
        let (x, y) = (k % side[0], k / side[0]);
        let height = heights.at(x, y);
        let slope = rise(x, y, [1, 0]).hypot(rise(x, y, [0, 1]));
        Cell {
            height,
            slope: if height.is_nan() { 0.0 } else { slope },
            is_measured: !bare.at(x, y).is_nan(),
            is_object: is_object.at(x, y) == 1.0,
            is_low: is_low.at(x, y) == 1.0,
        }
    };
    (0..side[0] * side[1]).map(cell).collect()
}
