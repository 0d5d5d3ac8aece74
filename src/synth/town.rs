//! The plan: streets, blocks, lots, parcels, power lines, and what stands on them.

use super::object::{
    Decal, Frame, Habit, Object, PYLON_HALF, Pylon, Rgb, Roof, RoofShape, Slab, SlabKind, Tree, WIRES,
};
use super::random::{Topic, floor, mix, stream, unit};
use super::terrain::{RIVER_HALF, Site, Terrain, WATER_LEVEL};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::collections::HashMap;

/// Mean spacing of streets that run along constant u and constant v, m.
const BLOCK_U: f64 = 106.0;
const BLOCK_V: f64 = 60.0;
/// Every so many of them is a road that leaves town.
const MAIN_U: i64 = 5;
const MAIN_V: i64 = 7;
/// Half widths of carriageways, and the pavement beside them, m.
const MAIN_HALF: f64 = 3.7;
const LOCAL_HALF: f64 = 2.7;
pub const PAVEMENT: f64 = 1.7;
/// Streets are built where [`Site::town`] exceeds this.
const STREET_TOWN: f64 = 0.02;

/// Height of bridge decks, m.
pub const DECK: f64 = WATER_LEVEL + 5.0;
/// Half width of a deck with its railings, m.
pub const DECK_HALF: f64 = 5.4;
/// A deck ends this far from the river's middle, m.
pub const DECK_REACH: f64 = RIVER_HALF + 8.0;
/// Ramps meet the land this far from the river's middle, m.
const RAMP_REACH: f64 = RIVER_HALF + 62.0;

/// Direction of power lines (unit vector), their distance from the square and from each other, spacing of
/// pylons, and how deep a wire hangs in mid-span, m.
const LINE_AXIS: [f64; 2] = [0.766_044_443_118_978, 0.642_787_609_686_539_4];
const LINE_AWAY: f64 = 285.0;
const LINE_SPACING: f64 = 2600.0;
const SPAN: f64 = 172.0;
const SAG: f64 = 6.5;

/// The streets around a place.
#[derive(Clone, Copy, Debug)]
pub struct Streets {
    /// The block that the place lies in.
    pub block: [i64; 2],
    /// The nearest street of each direction, if one is built there.
    pub u: Option<Street>,
    pub v: Option<Street>,
}

/// A street near a place.
#[derive(Clone, Copy, Debug)]
pub struct Street {
    /// Distance from its middle, m, signed.
    pub away: f64,
    /// Half width of the carriageway, m.
    pub half: f64,
    /// It leaves the village.
    pub main: bool,
}

impl Streets {
    /// The street whose edge is nearest.
    pub fn nearest(&self) -> Option<Street> {
        let edge = |s: &Street| s.away.abs() - s.half;
        match (self.u, self.v) {
            (Some(a), Some(b)) => Some(if edge(&a) < edge(&b) { a } else { b }),
            (a, b) => a.or(b),
        }
    }
}

/// What grows on a parcel outside the villages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crop {
    Wheat,
    Stubble,
    Ploughed,
    Maize,
    Beet,
    Barley,
    Meadow,
    Orchard,
}

/// A parcel of farmland and a place in it.
#[derive(Clone, Copy, Debug)]
pub struct Parcel {
    pub row: i64,
    pub column: i64,
    pub crop: Crop,
    /// Coordinates along and across the parcel's rows, m from its south-western corner.
    pub along: f64,
    pub across: f64,
    /// Length and depth, m.
    pub size: [f64; 2],
}

impl Parcel {
    /// Distance from the nearest boundary, m.
    pub fn edge(&self) -> f64 {
        let [length, depth] = self.size;
        self.along.min(length - self.along).min(self.across.min(depth - self.across))
    }
}

/// The town and the country around it, defined everywhere on the plane as a pure function of the seed.
///
/// Coordinates are metres from the main square, x east, y north; heights are metres above the datum.
pub struct Town {
    pub(crate) terrain: Terrain,
}

const ROOF_TILES: [Rgb; 9] = [
    [0.61, 0.36, 0.27],
    [0.65, 0.40, 0.30],
    [0.57, 0.33, 0.26],
    [0.68, 0.45, 0.34],
    [0.48, 0.33, 0.27],
    [0.42, 0.29, 0.25],
    [0.38, 0.38, 0.41],
    [0.31, 0.31, 0.34],
    [0.55, 0.42, 0.35],
];
const CAR_PAINT: [Rgb; 7] = [
    [0.88, 0.88, 0.89],
    [0.62, 0.64, 0.66],
    [0.14, 0.14, 0.16],
    [0.33, 0.34, 0.36],
    [0.60, 0.12, 0.12],
    [0.17, 0.26, 0.48],
    [0.80, 0.80, 0.76],
];
const LEAVES: [Rgb; 7] = [
    [0.30, 0.42, 0.19],
    [0.35, 0.46, 0.21],
    [0.27, 0.38, 0.18],
    [0.40, 0.49, 0.24],
    [0.33, 0.41, 0.22],
    [0.38, 0.44, 0.20],
    [0.25, 0.36, 0.20],
];
const NEEDLES: [Rgb; 3] = [[0.18, 0.29, 0.18], [0.20, 0.31, 0.21], [0.23, 0.32, 0.19]];
const SLATE: Rgb = [0.33, 0.34, 0.38];
const PAVING: Rgb = [0.64, 0.60, 0.55];

/// The index i with line(i) <= value < line(i + 1), and those two; lines lie within half a `spacing` of
/// i · spacing.
#[inline]
fn between(value: f64, spacing: f64, line: impl Fn(i64) -> f64) -> (i64, f64, f64) {
    let guess = floor(value / spacing);
    let (low, high) = (line(guess), line(guess + 1));
    if value < low {
        (guess - 1, line(guess - 1), low)
    } else if value >= high {
        (guess + 1, high, line(guess + 2))
    } else {
        (guess, low, high)
    }
}

fn pick<T: Copy>(rng: &mut Pcg64Mcg, of: &[T]) -> T {
    of[rng.random_range(0..of.len())]
}

fn tint(color: Rgb, by: f32) -> Rgb {
    color.map(|c| c * (1.0 + by))
}

fn inside(range: [f64; 4], x: f64, y: f64, margin: f64) -> bool {
    x >= range[0] - margin && x <= range[2] + margin && y >= range[1] - margin && y <= range[3] + margin
}

/// A square of plan around a lot: where it is, which way the street runs, how the ground falls.
struct Lot {
    /// Middle of the front boundary; the axis runs along the street, the frame's left is the back.
    front: Frame,
    /// +1 when the back lies to the frame's left, else -1.
    back: f64,
    width: f64,
    depth: f64,
    ground: f64,
    /// Rise of the ground per metre along the street and towards the back.
    fall: [f64; 2],
}

impl Lot {
    /// A rectangle in the lot: middle `along` the street, `behind` the front boundary.
    fn frame(&self, along: f64, behind: f64, half: [f64; 2]) -> Frame {
        self.front.moved(along, self.back * behind, half)
    }

    fn at(&self, along: f64, behind: f64) -> [f64; 2] {
        self.front.world(along, self.back * behind)
    }

    fn ground(&self, along: f64, behind: f64) -> f64 {
        self.ground + self.fall[0] * along + self.fall[1] * behind
    }
}

/// Blocks that were worked out lately: neighbouring patches share most of them.
#[derive(Default)]
pub struct Blocks(HashMap<[i64; 2], Vec<Object>>);

impl Blocks {
    /// Most blocks kept; some 10 MB.
    const KEPT: usize = 1024;

    fn get(&mut self, town: &Town, i: i64, j: i64) -> &[Object] {
        if self.0.len() >= Blocks::KEPT && !self.0.contains_key(&[i, j]) {
            self.0.clear();
        }
        self.0.entry([i, j]).or_insert_with(|| {
            let mut objects = Vec::new();
            town.block(i, j, &mut objects);
            objects
        })
    }
}

impl Town {
    /// The town of `seed`.
    pub fn new(seed: u64) -> Town {
        Town { terrain: Terrain::new(seed) }
    }

    pub(crate) fn seed(&self) -> u64 {
        self.terrain.seed
    }

    fn hash(&self, topic: Topic, i: i64, j: i64) -> f64 {
        unit(mix(self.seed(), topic, i, j))
    }

    fn u_line(&self, i: i64) -> f64 {
        BLOCK_U * i as f64 + 24.0 * (self.hash(Topic::UStreet, i, 0) - 0.5)
    }

    fn v_line(&self, j: i64) -> f64 {
        BLOCK_V * j as f64 + 9.0 * (self.hash(Topic::VStreet, j, 0) - 0.5)
    }

    /// The block that holds (u, v).
    pub(crate) fn block_of(&self, u: f64, v: f64) -> [i64; 2] {
        [between(u, BLOCK_U, |i| self.u_line(i)).0, between(v, BLOCK_V, |j| self.v_line(j)).0]
    }

    /// The cross street `i` is missing beside block row `j`: two blocks have grown together.
    fn cross_street_missing(&self, i: i64, j: i64) -> bool {
        i.rem_euclid(MAIN_U) != 0 && self.hash(Topic::CrossStreet, i, j) < 0.3
    }

    /// The streets around `site`.
    #[inline]
    pub fn streets(&self, site: &Site) -> Streets {
        let (i, west, east) = between(site.u, BLOCK_U, |i| self.u_line(i));
        let (j, south, north) = between(site.v, BLOCK_V, |j| self.v_line(j));
        let built = site.town > STREET_TOWN && site.river.abs() > RIVER_HALF + 5.0;
        let (west, east) = (site.u - west, site.u - east);
        let (line, away) = if west < -east { (i, west) } else { (i + 1, east) };
        let main = line.rem_euclid(MAIN_U) == 0;
        let u = (main || built && !self.cross_street_missing(line, j)).then(|| Street {
            away: away / site.grad_u,
            half: if main { MAIN_HALF } else { LOCAL_HALF },
            main,
        });
        let (south, north) = (site.v - south, site.v - north);
        let (line, away) = if south < -north { (j, south) } else { (j + 1, north) };
        let main = line.rem_euclid(MAIN_V) == 0;
        let v = (main && site.river.abs() > RIVER_HALF + 5.0 || built).then(|| Street {
            away: away / site.grad_v,
            half: if main { MAIN_HALF } else { LOCAL_HALF },
            main,
        });
        Streets { block: [i, j], u, v }
    }

    /// Height of the built ground, m: the terrain, and the ramps that lead onto bridges.
    pub(crate) fn built_ground(&self, site: &Site, streets: &Streets) -> f64 {
        let river = site.river.abs();
        match streets.u {
            Some(road) if road.main && river < RAMP_REACH && river > RIVER_HALF + 2.0 => {
                let t = ((river - DECK_REACH) / (RAMP_REACH - DECK_REACH)).clamp(0.0, 1.0);
                let blend = t * t * (3.0 - 2.0 * t);
                let road_height = DECK + (site.height - DECK) * blend;
                let shoulder = (road.away.abs() - DECK_HALF).max(0.0) * 0.6;
                site.height.max(road_height - shoulder)
            }
            _ => site.height,
        }
    }

    /// Across-deck distance where a bridge lies over `site`.
    pub(crate) fn deck(&self, site: &Site, streets: &Streets) -> Option<f64> {
        let road = streets.u?;
        (road.main && road.away.abs() <= DECK_HALF && site.river.abs() <= DECK_REACH).then_some(road.away)
    }

    /// The parcel of farmland at (u, v).
    pub(crate) fn parcel(&self, u: f64, v: f64) -> Parcel {
        // Fields follow the land's bend too, but turned against the streets by 23°.
        let [along, across] = field_frame(u, v);
        const DEPTH: f64 = 78.0;
        let line = |row: i64| DEPTH * row as f64 + 26.0 * (self.hash(Topic::ParcelRow, row, 0) - 0.5);
        let (row, south, north) = between(across, DEPTH, line);
        let length = 70.0 + 130.0 * self.hash(Topic::ParcelRow, row, 1);
        let shifted = along + 200.0 * self.hash(Topic::ParcelRow, row, 2);
        let column = floor(shifted / length);
        const CROPS: [Crop; 11] = [
            Crop::Wheat,
            Crop::Wheat,
            Crop::Stubble,
            Crop::Ploughed,
            Crop::Maize,
            Crop::Beet,
            Crop::Barley,
            Crop::Meadow,
            Crop::Meadow,
            Crop::Orchard,
            Crop::Orchard,
        ];
        let choice = self.hash(Topic::Parcel, row, column);
        Parcel {
            row,
            column,
            crop: CROPS[((choice * CROPS.len() as f64) as usize).min(CROPS.len() - 1)],
            along: shifted - column as f64 * length,
            across: across - south,
            size: [length, north - south],
        }
    }

    /// Nearest power line's index, distance across it (positive to the north-west) and along it.
    pub(crate) fn power_line(x: f64, y: f64) -> (i64, f64, f64) {
        let across = -LINE_AXIS[1] * x + LINE_AXIS[0] * y - LINE_AWAY;
        let along = LINE_AXIS[0] * x + LINE_AXIS[1] * y;
        let line = (across / LINE_SPACING).round();
        (line as i64, across - line * LINE_SPACING, along)
    }

    /// The pylon with index `k` on power line `line`.
    pub(crate) fn pylon(&self, line: i64, k: i64) -> Pylon {
        let along = SPAN * (k as f64 + 0.36);
        let across = LINE_AWAY + LINE_SPACING * line as f64;
        let centre =
            [LINE_AXIS[0] * along - LINE_AXIS[1] * across, LINE_AXIS[1] * along + LINE_AXIS[0] * across];
        let reach = WIRES.iter().map(|wire| wire[0]).fold(PYLON_HALF, f64::max);
        Pylon {
            frame: Frame { centre, axis: [-LINE_AXIS[1], LINE_AXIS[0]], half: [reach + 0.2, PYLON_HALF] },
            foot: self.terrain.site(centre[0], centre[1]).height,
        }
    }

    /// The span of a power line at distance `along` it: index of its first pylon and the share of the way.
    pub(crate) fn span(along: f64) -> (i64, f64) {
        let t = along / SPAN - 0.36;
        (floor(t), t - floor(t) as f64)
    }

    /// Height of wire `wire` (of [`WIRES`]) at share `t` of a span between pylons with feet `a` and `b`.
    pub(crate) fn wire_height(wire: usize, t: f64, a: f64, b: f64) -> f64 {
        // A parabola: within a few centimetres of the catenary at this sag.
        a + (b - a) * t + WIRES[wire][1] - 4.0 * SAG * t * (1.0 - t)
    }

    /// Every object whose bounds meet the rectangle (west, south, east, north).
    pub(crate) fn objects(&self, range: [f64; 4], blocks: &mut Blocks) -> Vec<Object> {
        let mut found = Vec::new();
        let meets = |object: &Object| {
            let [west, south, east, north] = object.bounds();
            west <= range[2] && east >= range[0] && south <= range[3] && north >= range[1]
        };
        let [x0, y0, x1, y1] = range;
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for k in 0..25 {
            let (s, t) = (f64::from(k % 5) / 4.0, f64::from(k / 5) / 4.0);
            let bent = self.terrain.bend(x0 + (x1 - x0) * s, y0 + (y1 - y0) * t);
            for axis in 0..2 {
                low[axis] = low[axis].min(bent[axis]);
                high[axis] = high[axis].max(bent[axis]);
            }
        }
        // No object reaches farther out of its block, parcel or road than this.
        const MARGIN: f64 = 12.0;
        let (low, high) = (low.map(|v| v - MARGIN), high.map(|v| v + MARGIN));
        let first = self.block_of(low[0], low[1]);
        let last = self.block_of(high[0], high[1]);
        for j in first[1]..=last[1] {
            for i in first[0]..=last[0] {
                found.extend(blocks.get(self, i, j).iter().filter(|object| meets(object)));
            }
        }
        self.orchards_and_hedgerows(low, high, &mut found);
        self.forest(range, &mut found);
        self.riverside(range, &mut found);
        let (line, across, along) = Town::power_line((x0 + x1) / 2.0, (y0 + y1) / 2.0);
        if across.abs() < (x1 - x0) + (y1 - y0) {
            let (k, _) = Town::span(along);
            found.extend((k - 1..=k + 2).map(|k| Object::Pylon(self.pylon(line, k))));
        }
        found.retain(meets);
        found
    }

    /// Nothing tall may stand here: river, road or wires.
    fn kept_clear(&self, site: &Site, x: f64, y: f64, margin: f64) -> bool {
        let streets = self.streets(site);
        let road = |s: Option<Street>| s.is_some_and(|s| s.away.abs() < s.half + margin);
        road(streets.u)
            || road(streets.v)
            || site.river.abs() < RIVER_HALF + 2.5
            || (site.river.abs() < RAMP_REACH
                && streets.u.is_some_and(|s| s.main && s.away.abs() < 10.0 + margin))
            || Town::power_line(x, y).1.abs() < 15.0
    }

    fn tree(&self, rng: &mut Pcg64Mcg, centre: [f64; 2], foot: f64, habit: Habit, scale: f64) -> Object {
        let (height, radius) = match habit {
            Habit::Broad => {
                let radius = rng.random_range(2.1..4.3);
                (radius * rng.random_range(2.3..3.0), radius)
            }
            Habit::Conifer => {
                let radius = rng.random_range(1.9..3.0);
                (radius * rng.random_range(4.4..6.0), radius)
            }
            Habit::Poplar => (rng.random_range(15.0..22.0), rng.random_range(1.6..2.3)),
            Habit::Shrub => {
                let radius = rng.random_range(0.8..1.7);
                (radius * rng.random_range(1.1..1.7), radius)
            }
        };
        let green = if habit == Habit::Conifer { pick(rng, &NEEDLES) } else { pick(rng, &LEAVES) };
        Object::Tree(Tree {
            centre,
            foot,
            height: height * scale,
            radius: radius * scale,
            habit,
            color: tint(green, rng.random_range(-0.1..0.1)),
            salt: rng.random(),
        })
    }

    fn forest(&self, range: [f64; 4], found: &mut Vec<Object>) {
        const STEP: f64 = 5.3;
        let cells =
            |low: f64, high: f64| ((low - 8.0) / STEP).floor() as i64..=((high + 8.0) / STEP).floor() as i64;
        for j in cells(range[1], range[3]) {
            for i in cells(range[0], range[2]) {
                let mut rng = stream(self.seed(), Topic::ForestTree, i, j);
                let x = (i as f64 + rng.random_range(0.1..0.9)) * STEP;
                let y = (j as f64 + rng.random_range(0.1..0.9)) * STEP;
                if !inside(range, x, y, 8.0) {
                    continue;
                }
                let site = self.terrain.site(x, y);
                let at_edge = site.forest < 0.05;
                if site.forest < 0.0 || rng.random_bool(0.05) || self.kept_clear(&site, x, y, 4.0) {
                    continue;
                }
                // Stands of one kind, mixed where they meet.
                let needles = site.tint + rng.random_range(-0.35..0.35) > 0.12;
                let habit = match needles {
                    _ if at_edge && rng.random_bool(0.5) => Habit::Shrub,
                    true => Habit::Conifer,
                    false => Habit::Broad,
                };
                let scale = match habit {
                    Habit::Broad => rng.random_range(1.15..1.55),
                    Habit::Conifer => rng.random_range(1.15..1.7),
                    _ => rng.random_range(1.2..1.8),
                };
                found.push(self.tree(&mut rng, [x, y], site.height, habit, scale));
            }
        }
    }

    fn riverside(&self, range: [f64; 4], found: &mut Vec<Object>) {
        let row = Terrain::river_row((range[1] + range[3]) / 2.0);
        const STEP: f64 = 6.0;
        let first = ((range[0] - 8.0) / STEP).floor() as i64;
        let last = ((range[2] + 8.0) / STEP).floor() as i64;
        for i in first..=last {
            for bank in [-1.0, 1.0] {
                let mut rng =
                    stream(self.seed(), Topic::RiverTree, i * 2 + i64::from(bank > 0.0), row as i64);
                let x = (i as f64 + rng.random_range(0.0..1.0)) * STEP;
                let away = RIVER_HALF + rng.random_range(3.0..9.0);
                let y = self.terrain.river_middle(row, x) + bank * away;
                if rng.random_bool(0.25) || !inside(range, x, y, 8.0) {
                    continue;
                }
                let site = self.terrain.site(x, y);
                if self.kept_clear(&site, x, y, 2.5) || site.height < WATER_LEVEL + 0.3 {
                    continue;
                }
                let habit = match rng.random_range(0..10) {
                    0..=5 => Habit::Broad,
                    6..=7 => Habit::Poplar,
                    _ => Habit::Shrub,
                };
                found.push(self.tree(&mut rng, [x, y], site.height, habit, 1.1));
            }
        }
    }

    fn orchards_and_hedgerows(&self, low: [f64; 2], high: [f64; 2], found: &mut Vec<Object>) {
        let corners = [[low[0], low[1]], [high[0], low[1]], [low[0], high[1]], [high[0], high[1]]]
            .map(|[u, v]| field_frame(u, v));
        let bound =
            |axis: usize, pick: fn(f64, f64) -> f64| corners.map(|c| c[axis]).into_iter().reduce(pick);
        let (Some(p0), Some(p1)) = (bound(0, f64::min), bound(0, f64::max)) else { return };
        let (Some(q0), Some(q1)) = (bound(1, f64::min), bound(1, f64::max)) else { return };
        // A fixed lattice in the fields' frame; a place plants what its parcel asks for.
        const ALONG: f64 = 3.1;
        const ACROSS: f64 = 7.6;
        for row in (q0 / ACROSS).floor() as i64..=(q1 / ACROSS).ceil() as i64 {
            for k in (p0 / ALONG).floor() as i64..=(p1 / ALONG).ceil() as i64 {
                let (along, across) = (k as f64 * ALONG, row as f64 * ACROSS);
                let [u, v] = field_frame_inverse(along, across);
                if u < low[0] || u > high[0] || v < low[1] || v > high[1] {
                    continue;
                }
                let parcel = self.parcel(u, v);
                let orchard = parcel.crop == Crop::Orchard && k % 2 == 0 && parcel.edge() > 3.0;
                let hedged =
                    parcel.across < ACROSS && self.hash(Topic::HedgeRow, parcel.row, parcel.column) < 0.33;
                if !orchard && !hedged {
                    continue;
                }
                let mut rng = stream(self.seed(), Topic::OrchardTree, k, row);
                let (u, v) = if orchard {
                    (u + rng.random_range(-0.3..0.3), v + rng.random_range(-0.3..0.3))
                } else {
                    field_frame_inverse(along + rng.random_range(-1.0..1.0), across - parcel.across).into()
                };
                let [x, y] = self.terrain.unbend(u, v);
                let site = self.terrain.site(x, y);
                if site.town > -0.03 || site.forest > -0.04 || self.kept_clear(&site, x, y, 3.0) {
                    continue;
                }
                if orchard {
                    if rng.random_bool(0.94) {
                        found.push(self.tree(&mut rng, [x, y], site.height, Habit::Broad, 0.66));
                    }
                } else if rng.random_bool(0.85) {
                    let (habit, scale) =
                        if rng.random_bool(0.22) { (Habit::Broad, 1.0) } else { (Habit::Shrub, 1.35) };
                    found.push(self.tree(&mut rng, [x, y], site.height, habit, scale));
                }
            }
        }
    }

    /// What stands on block (i, j): between streets i and i + 1, j and j + 1; with the trees and cars of its
    /// southern and western street.
    fn block(&self, i: i64, j: i64, found: &mut Vec<Object>) {
        let (u0, u1, v0, v1) = (self.u_line(i), self.u_line(i + 1), self.v_line(j), self.v_line(j + 1));
        let [x, y] = self.terrain.unbend((u0 + u1) / 2.0, (v0 + v1) / 2.0);
        let centre = self.terrain.site(x, y);
        self.along_streets(i, j, [u0, u1, v0, v1], &centre, found);
        if centre.town < -0.45 {
            return;
        }
        let half_u = |line: i64| if line.rem_euclid(MAIN_U) == 0 { MAIN_HALF } else { LOCAL_HALF };
        let half_v = |line: i64| if line.rem_euclid(MAIN_V) == 0 { MAIN_HALF } else { LOCAL_HALF };
        let (west, east) = (u0 + half_u(i) + PAVEMENT, u1 - half_u(i + 1) - PAVEMENT);
        let (south, north) = (v0 + half_v(j) + PAVEMENT, v1 - half_v(j + 1) - PAVEMENT);
        let is_square = self.terrain.villages_near(x, y).any(|village| {
            let [u, v] = self.terrain.bend(village.centre[0], village.centre[1]);
            self.block_of(u, v) == [i, j]
        });
        if is_square {
            self.square(i, j, [west, east, south, north], found);
            return;
        }
        let green = (0.05..0.55).contains(&centre.town) && centre.river.abs() > 45.0;
        if green && self.hash(Topic::Block, i, j) < 0.09 {
            self.playing_field(i, j, [west, east, south, north], found);
            return;
        }
        for (side, front) in [(1.0, south), (-1.0, north)] {
            let depth = (north - south) / 2.0 - 0.3;
            self.row_of_lots(i, j, side, front, [west, east], depth, found);
        }
    }

    /// Parked cars, avenue trees.
    fn along_streets(&self, i: i64, j: i64, lines: [f64; 4], centre: &Site, found: &mut Vec<Object>) {
        let [u0, u1, v0, v1] = lines;
        let mut rng = stream(self.seed(), Topic::AvenueTree, i, j);
        let main = [i.rem_euclid(MAIN_U) == 0, j.rem_euclid(MAIN_V) == 0];
        let avenue =
            [self.hash(Topic::AvenueTree, i, -77) < 0.75, self.hash(Topic::AvenueTree, j, -78) < 0.75];
        // (street's fixed coordinate, from, to, runs along u, is main, has trees)
        let streets = [(v0, u0, u1, true, main[1], avenue[1]), (u0, v0, v1, false, main[0], avenue[0])];
        for (fixed, from, to, along_u, is_main, avenue) in streets {
            if !is_main && centre.town < -0.3 {
                continue;
            }
            let half = if is_main { MAIN_HALF } else { LOCAL_HALF };
            let place = |along: f64, away: f64| {
                let [u, v] = if along_u { [along, fixed + away] } else { [fixed + away, along] };
                self.terrain.unbend(u, v)
            };
            if is_main && avenue {
                let count = ((to - from) / 12.5).round() as i64;
                for k in 1..count {
                    for side in [-1.0, 1.0] {
                        let along =
                            from + (to - from) * (k as f64 + rng.random_range(-0.1..0.1)) / count as f64;
                        let chance = rng.random_range(0.0..1.0);
                        let mut own = stream(rng.random(), Topic::AvenueTree, k, i);
                        let [x, y] = place(along, side * (half + 2.2));
                        let site = self.terrain.site(x, y);
                        let wanted = if site.town > 0.0 { 0.55 } else { 0.85 };
                        if chance < wanted && !self.kept_clear(&site, x, y, 0.6) {
                            found.push(self.tree(&mut own, [x, y], site.height, Habit::Broad, 0.8));
                        }
                    }
                }
            }
            let count = ((to - from) / 6.4).floor() as i64;
            for k in 2..count - 1 {
                for side in [-1.0, 1.0] {
                    let (chance, paint) = (rng.random_range(0.0..1.0), pick(&mut rng, &CAR_PAINT));
                    let wanted = if is_main { 0.05 } else { 0.05 + 0.28 * centre.town.max(0.0) };
                    if chance >= wanted {
                        continue;
                    }
                    let along = from + (k as f64 + 0.5) * 6.4;
                    let away = side * if is_main { 1.8 } else { LOCAL_HALF - 1.0 };
                    let ([x, y], ahead) = (place(along, away), place(along + 1.0, away));
                    let site = self.terrain.site(x, y);
                    let streets = self.streets(&site);
                    let on = if along_u { streets.v } else { streets.u };
                    // Not where the street was not built, and not under a bridge's deck.
                    if on.is_some_and(|s| s.away.abs() < s.half) && site.river.abs() > RAMP_REACH {
                        found.push(car([x, y], [ahead[0] - x, ahead[1] - y], site.height, paint));
                    }
                }
            }
        }
    }

    /// A straight frame on the ground at (u, v) whose axis follows the street.
    fn street_frame(&self, u: f64, v: f64) -> Frame {
        let (centre, ahead) = (self.terrain.unbend(u, v), self.terrain.unbend(u + 2.0, v));
        let (dx, dy) = (ahead[0] - centre[0], ahead[1] - centre[1]);
        let length = dx.hypot(dy).max(1e-9);
        Frame { centre, axis: [dx / length, dy / length], half: [0.0, 0.0] }
    }

    #[allow(clippy::too_many_arguments)] // the plan of one row; a struct would live for one call
    fn row_of_lots(
        &self,
        i: i64,
        j: i64,
        side: f64,
        front: f64,
        [west, east]: [f64; 2],
        depth: f64,
        found: &mut Vec<Object>,
    ) {
        let mut rng = stream(self.seed(), Topic::Lots, i, 2 * j + i64::from(side > 0.0));
        let middle = self.street_frame((west + east) / 2.0, front);
        let town = self.terrain.site(middle.centre[0], middle.centre[1]).town;
        if town < -0.25 {
            return;
        }
        let kind = rng.random_range(0.0..1.0);
        let (terrace, flats, hall) =
            (town > 0.6, town < 0.58 && kind < 0.07, town < 0.3 && (0.07..0.12).contains(&kind));
        let wanted_width = match () {
            _ if terrace => rng.random_range(8.5..12.5),
            _ if flats => 34.0,
            _ if hall => 46.0,
            _ => rng.random_range(14.5..19.5),
        };
        let count = ((east - west) / wanted_width).floor().max(1.0);
        let setback = if terrace { rng.random_range(0.8..2.2) } else { rng.random_range(2.5..5.5) };
        let palette: [Rgb; 2] = [pick(&mut rng, &ROOF_TILES), pick(&mut rng, &ROOF_TILES)];
        for k in 0..count as i64 {
            let mut rng = stream(rng.random(), Topic::Lots, k, i ^ j);
            let u = west + (east - west) * (k as f64 + 0.5) / count;
            let front_frame = self.street_frame(u, front);
            let site = self.terrain.site(front_frame.centre[0], front_frame.centre[1]);
            let depth = depth / site.grad_v;
            let back = front_frame.world(0.0, side * depth);
            let beside = front_frame.world(8.0, side * 10.0);
            let (behind, aside) =
                (self.terrain.site(back[0], back[1]), self.terrain.site(beside[0], beside[1]));
            let slope_back = (behind.height - site.height) / depth;
            let lot = Lot {
                front: front_frame,
                back: side,
                width: (east - west) / count / site.grad_u,
                depth,
                ground: site.height,
                fall: [(aside.height - site.height - 10.0 * slope_back) / 8.0, slope_back],
            };
            let middle = lot.at(0.0, 11.0);
            let clear = |s: &Site| s.river.abs() > RIVER_HALF + 7.0 && s.forest < 0.1;
            let ramp = self.streets(&site).u.is_some_and(|s| s.main && s.away.abs() < 16.0)
                && site.river.abs() < RAMP_REACH;
            let wires = Town::power_line(middle[0], middle[1]).1.abs() < 24.0;
            if site.town < 0.05 || !clear(&site) || !clear(&behind) || ramp || wires {
                continue;
            }
            match () {
                _ if terrace => self.terrace(&lot, setback, &mut rng, found),
                _ if flats => self.flats(&lot, &mut rng, found),
                _ if hall => self.hall(&lot, &mut rng, found),
                _ => self.detached(&lot, setback, palette, &mut rng, found),
            }
        }
    }

    fn detached(
        &self,
        lot: &Lot,
        setback: f64,
        palette: [Rgb; 2],
        rng: &mut Pcg64Mcg,
        found: &mut Vec<Object>,
    ) {
        let first = found.len();
        if rng.random_bool(0.95) {
            house(lot, setback, palette, rng, found);
        }
        furnish_garden(lot, rng, found);
        self.garden_hedges(lot, rng, found);
        self.garden_trees(lot, first, rng, found);
    }

    /// Trees and shrubs of a lot, clear of its houses and of each other; its objects are those from `first` on.
    fn garden_trees(&self, lot: &Lot, first: usize, rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
        for _ in 0..rng.random_range(2..8) {
            let along = rng.random_range(-0.47..0.47) * lot.width;
            let behind = if rng.random_bool(0.75) {
                rng.random_range(0.55..0.97) * lot.depth
            } else {
                rng.random_range(0.8..3.0)
            };
            let (habit, scale) = match rng.random_range(0..12) {
                0..=5 => (Habit::Broad, 0.72),
                6 => (Habit::Broad, 1.05),
                7..=8 => (Habit::Conifer, 0.75),
                _ => (Habit::Shrub, 1.1),
            };
            let at = lot.at(along, behind);
            let crowded = found[first..].iter().any(|object| match object {
                Object::Roof(roof) => {
                    let [a, b] = roof.frame.local(at[0], at[1]);
                    a.abs() < roof.frame.half[0] + 1.6 && b.abs() < roof.frame.half[1] + 1.6
                }
                Object::Tree(tree) => {
                    (tree.centre[0] - at[0]).hypot(tree.centre[1] - at[1]) < tree.radius + 1.0
                }
                _ => false,
            });
            if !crowded {
                let tree = self.tree(rng, at, lot.ground(along, behind), habit, scale);
                found.push(tree);
            }
        }
    }

    fn garden_hedges(&self, lot: &Lot, rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
        let half_width = 0.5 * lot.width;
        let mut hedge = |rng: &mut Pcg64Mcg, along: f64, behind: f64, half: [f64; 2]| {
            let frame = lot.frame(along, behind, half);
            let height = rng.random_range(1.1..1.9);
            let color = tint(pick(rng, &LEAVES), -0.08);
            let foot = lot.ground(along, behind);
            found.push(Object::Slab(Slab { frame, foot, height, color, kind: SlabKind::Hedge }));
        };
        if rng.random_bool(0.6) {
            // In pieces, so that each stands on the ground as it falls.
            for piece in 0..3 {
                let length = (lot.depth - 2.0) / 3.0;
                hedge(rng, half_width, 1.0 + length * (f64::from(piece) + 0.5), [0.45, length / 2.0]);
            }
        }
        if rng.random_bool(0.45) {
            hedge(rng, 0.0, 0.6, [half_width - 4.2, 0.42]);
        }
        if rng.random_bool(0.5) {
            hedge(rng, 0.0, lot.depth - 0.4, [half_width - 0.3, 0.45]);
        }
    }

    fn terrace(&self, lot: &Lot, setback: f64, rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
        let wide = rng.random_range(4.9..6.3);
        let behind = setback + wide;
        let ground = lot.ground(0.0, behind);
        let pitch = rng.random_range(40.0..50.0_f64).to_radians().tan();
        let eaves = ground + rng.random_range(5.8..9.0);
        let color = tint(pick(rng, &ROOF_TILES), rng.random_range(-0.08..0.08));
        let frame = lot.frame(0.0, behind, [0.5 * lot.width + 0.1, wide]);
        found.push(Object::Roof(Roof {
            frame,
            shape: RoofShape::Gable,
            eaves,
            rise: pitch * wide,
            color,
            panels: rng.random_bool(0.08),
        }));
        if rng.random_bool(0.4) {
            let half = rng.random_range(2.0..3.0_f64).min(0.4 * lot.width);
            let out = wide + rng.random_range(3.0..8.0);
            let side = rng.random_range(-0.3..0.3) * lot.width;
            let wing = frame.turned(side, lot.back * out / 2.0, [out / 2.0, half]);
            found.push(Object::Roof(Roof {
                frame: wing,
                shape: RoofShape::Gable,
                eaves: eaves - 1.0,
                rise: pitch * half,
                color: tint(color, 0.04),
                panels: false,
            }));
        }
        if rng.random_bool(0.45) {
            let dormer = frame.turned(0.0, -lot.back * 0.55 * wide, [0.3 * wide, 1.2]);
            found.push(Object::Roof(Roof {
                frame: dormer,
                shape: RoofShape::Gable,
                eaves: eaves + 0.45 * pitch * wide,
                rise: 0.9,
                color,
                panels: false,
            }));
        }
        if rng.random_bool(0.8) {
            let chimney = frame.moved(rng.random_range(-0.3..0.3) * lot.width, 0.4, [0.45, 0.4]);
            found.push(Object::Roof(Roof {
                frame: chimney,
                shape: RoofShape::Flat,
                eaves: eaves + pitch * wide + 0.4,
                rise: 0.0,
                color: [0.42, 0.30, 0.26],
                panels: false,
            }));
        }
        // Yard: paved, or a tree.
        let yard = 0.5 * (lot.depth + behind + wide);
        if rng.random_bool(0.45) {
            let half = [0.5 * lot.width - 0.4, 0.3 * (lot.depth - behind - wide).max(1.0)];
            found.push(Object::Decal(Decal {
                frame: lot.frame(0.0, yard, half),
                color: tint(PAVING, rng.random_range(-0.2..0.0)),
                intensity: 15_000,
            }));
        } else {
            let (habit, scale) =
                if rng.random_bool(0.6) { (Habit::Broad, 0.75) } else { (Habit::Shrub, 1.3) };
            let along = rng.random_range(-0.3..0.3) * lot.width;
            let tree = self.tree(rng, lot.at(along, yard + 2.0), lot.ground(along, yard + 2.0), habit, scale);
            found.push(tree);
        }
        if rng.random_bool(0.3) {
            let behind = lot.depth - 1.8;
            found.push(Object::Roof(Roof {
                frame: lot.frame(0.0, behind, [0.4 * lot.width, 1.6]),
                shape: RoofShape::Shed,
                eaves: lot.ground(0.0, behind) + 2.4,
                rise: 0.7,
                color: tint(color, -0.12),
                panels: false,
            }));
        }
    }

    fn flats(&self, lot: &Lot, rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
        let half = [(0.5 * lot.width - 3.0).min(15.0), rng.random_range(5.2..6.4)];
        let behind = 8.0 + half[1];
        let eaves = lot.ground(0.0, behind) + pick(rng, &[9.2, 12.0, 14.8]);
        let color =
            pick(rng, &[[0.60, 0.60, 0.58], [0.47, 0.47, 0.48], [0.66, 0.64, 0.60], [0.47, 0.52, 0.40]]);
        let frame = lot.frame(0.0, behind, half);
        found.push(Object::Roof(Roof {
            frame,
            shape: RoofShape::Flat,
            eaves,
            rise: 0.0,
            color,
            panels: false,
        }));
        for side in [-0.5, 0.45] {
            let lift = frame.moved(side * half[0], 0.8, [2.2, 1.7]);
            found.push(Object::Roof(Roof {
                frame: lift,
                shape: RoofShape::Flat,
                eaves: eaves + 2.6,
                rise: 0.0,
                color: tint(color, 0.12),
                panels: false,
            }));
        }
        self.parking(lot, [-0.5 * lot.width + 2.0, 0.5 * lot.width - 2.0], 3.2, rng, found);
        for _ in 0..7 {
            let along = rng.random_range(-0.47..0.47) * lot.width;
            let behind = rng.random_range(behind + half[1] + 3.0..lot.depth.max(behind + half[1] + 4.0));
            let habit = if rng.random_bool(0.7) { Habit::Broad } else { Habit::Shrub };
            let tree = self.tree(rng, lot.at(along, behind), lot.ground(along, behind), habit, 1.0);
            found.push(tree);
        }
    }

    fn hall(&self, lot: &Lot, rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
        let half = [0.5 * lot.width - 3.0, (0.5 * (lot.depth - 10.0)).clamp(5.0, 11.0)];
        let behind = lot.depth - half[1] - 1.5;
        let eaves = lot.ground(0.0, behind) + rng.random_range(5.5..8.0);
        let color = pick(rng, &[[0.70, 0.71, 0.72], [0.55, 0.57, 0.60], [0.62, 0.60, 0.56]]);
        let low = rng.random_bool(0.5);
        let shape = if low { RoofShape::Flat } else { RoofShape::Gable };
        found.push(Object::Roof(Roof {
            frame: lot.frame(0.0, behind, half),
            shape,
            eaves,
            rise: 2.2,
            color,
            panels: rng.random_bool(0.4),
        }));
        self.parking(lot, [-0.5 * lot.width + 1.0, 0.5 * lot.width - 1.0], 3.2, rng, found);
    }

    /// A row of parking places across the front of `lot`, from one distance along it to another.
    fn parking(
        &self,
        lot: &Lot,
        [from, to]: [f64; 2],
        behind: f64,
        rng: &mut Pcg64Mcg,
        found: &mut Vec<Object>,
    ) {
        let asphalt = [0.42, 0.42, 0.43];
        let frame = lot.frame((from + to) / 2.0, behind, [(to - from) / 2.0, 3.0]);
        found.push(Object::Decal(Decal { frame, color: asphalt, intensity: 9_000 }));
        let axis = lot.front.turned(0.0, 0.0, [1.0, 1.0]).axis;
        for k in 0..((to - from) / 2.7) as i64 {
            let along = from + 2.7 * (k as f64 + 0.5);
            let paint = pick(rng, &CAR_PAINT);
            if rng.random_bool(0.5) {
                found.push(car(lot.at(along, behind), axis, lot.ground(along, behind), paint));
            }
        }
    }

    /// The square with its church and town hall.
    fn square(&self, i: i64, j: i64, [west, east, south, north]: [f64; 4], found: &mut Vec<Object>) {
        let mut rng = stream(self.seed(), Topic::Block, i, j);
        let frame = self.street_frame((west + east) / 2.0, (south + north) / 2.0);
        let site = self.terrain.site(frame.centre[0], frame.centre[1]);
        let half = [(east - west) / 2.0 / site.grad_u - 0.5, (north - south) / 2.0 / site.grad_v - 0.5];
        let ground = site.height;
        let tiles = tint(pick(&mut rng, &ROOF_TILES[..4]), 0.0);
        let mut roof = |frame: Frame, shape: RoofShape, eaves: f64, rise: f64, color: Rgb| {
            found.push(Object::Roof(Roof {
                frame,
                shape,
                eaves: ground + eaves,
                rise,
                color,
                panels: false,
            }));
        };
        // The church: nave, transept, choir, aisles, tower with a steep helm.
        let church = frame.moved(-0.18 * half[0], 2.0, [0.0, 0.0]);
        roof(church.moved(0.0, 0.0, [14.0, 6.0]), RoofShape::Gable, 11.0, 8.5, tiles);
        for aisle in [-1.0, 1.0] {
            let (out, turn) = (aisle * 7.6, -aisle);
            let lean_to =
                Frame { axis: church.axis.map(|a| a * turn), ..church.moved(-1.0, out, [11.5, 2.0]) };
            roof(lean_to, RoofShape::Shed, 5.6, 3.0, tint(tiles, -0.05));
        }
        roof(church.turned(6.5, 0.0, [10.0, 4.4]), RoofShape::Gable, 11.0, 6.8, tiles);
        roof(church.moved(18.0, 0.0, [4.6, 4.5]), RoofShape::Hip, 10.0, 6.2, tiles);
        roof(church.moved(-16.6, 0.0, [3.7, 3.7]), RoofShape::Flat, 27.0, 0.0, [0.60, 0.56, 0.50]);
        roof(church.moved(-16.6, 0.0, [3.3, 3.3]), RoofShape::Pyramid, 27.5, 18.0, SLATE);
        // The town hall faces the church.
        let hall = frame.turned(half[0] - 9.0, -1.0, [12.0, 6.5]);
        roof(hall, RoofShape::Hip, 10.0, 7.5, [0.40, 0.36, 0.36]);
        roof(hall.moved(0.0, 0.0, [1.6, 1.6]), RoofShape::Pyramid, 18.0, 5.0, [0.45, 0.60, 0.52]);
        // A fountain, lime trees in rows, market cars.
        found.push(Object::Decal(Decal {
            frame: frame.moved(0.42 * half[0], -0.35 * half[1], [2.4, 2.4]),
            color: [0.40, 0.55, 0.58],
            intensity: 3_000,
        }));
        for side in [-1.0, 1.0] {
            let count = (2.0 * half[0] / 8.5) as i64;
            for k in 0..count {
                let along = -half[0] + 5.0 + 8.5 * k as f64;
                let at = frame.world(along, side * (half[1] - 3.0));
                let tree = self.tree(&mut rng, at, ground, Habit::Broad, 0.85);
                if along < half[0] - 20.0 {
                    found.push(tree);
                }
            }
        }
        for k in 0..12 {
            let at = frame.world(-half[0] + 4.0, -half[1] + 7.5 + 2.8 * f64::from(k));
            let paint = pick(&mut rng, &CAR_PAINT);
            if rng.random_bool(0.7) && 7.5 + 2.8 * f64::from(k) < 2.0 * half[1] - 7.0 {
                found.push(car(at, frame.axis, ground, paint));
            }
        }
        found.insert(
            0,
            Object::Decal(Decal {
                frame: Frame { half, ..frame },
                color: [0.66, 0.62, 0.56],
                intensity: 17_000,
            }),
        );
    }

    /// A pitch with its lines, and trees around it.
    fn playing_field(&self, i: i64, j: i64, [west, east, south, north]: [f64; 4], found: &mut Vec<Object>) {
        let mut rng = stream(self.seed(), Topic::Block, i, j);
        let frame = self.street_frame((west + east) / 2.0, (south + north) / 2.0);
        let site = self.terrain.site(frame.centre[0], frame.centre[1]);
        let block = [(east - west) / 2.0 / site.grad_u, (north - south) / 2.0 / site.grad_v];
        let half = [(block[0] - 7.0).min(48.0), (block[1] - 5.0).min(30.0)];
        let mut paint = |along: f64, across: f64, half: [f64; 2], color: Rgb| {
            let frame = frame.moved(along, across, half);
            found.push(Object::Decal(Decal { frame, color, intensity: 25_000 }));
        };
        for stripe in 0..10 {
            let width = half[0] / 10.0;
            let color = if stripe % 2 == 0 { [0.33, 0.48, 0.23] } else { [0.38, 0.53, 0.26] };
            paint(-half[0] + width * (2.0 * f64::from(stripe) + 1.0), 0.0, [width, half[1]], color);
        }
        const CHALK: Rgb = [0.86, 0.88, 0.84];
        for side in [-1.0, 1.0] {
            paint(0.0, side * (half[1] - 1.5), [half[0] - 1.5, 0.2], CHALK);
            paint(side * (half[0] - 1.5), 0.0, [0.2, half[1] - 1.5], CHALK);
            paint(side * (half[0] - 15.0), 0.0, [0.2, 12.0], CHALK);
            for end in [-12.0, 12.0] {
                paint(side * (half[0] - 8.3), end, [6.8, 0.2], CHALK);
            }
        }
        paint(0.0, 0.0, [0.2, half[1] - 1.5], CHALK);
        for k in 0..((half[0] / 3.5) as i64) {
            for side in [-1.0, 1.0] {
                let along = -half[0] + 3.5 + 7.0 * k as f64 + rng.random_range(-1.5..1.5);
                let [x, y] = frame.world(along, side * (half[1] + 2.0));
                let foot = self.terrain.site(x, y).height;
                let tree = self.tree(&mut rng, [x, y], foot, Habit::Broad, 0.7);
                if rng.random_bool(0.75) {
                    found.push(tree);
                }
            }
        }
    }

    /// A number that is the same all over one garden, for the colour of its lawn.
    pub(crate) fn garden_tint(&self, site: &Site, block: [i64; 2]) -> f64 {
        let middle = (self.v_line(block[1]) + self.v_line(block[1] + 1)) / 2.0;
        let lot = floor(site.u / 19.0);
        self.hash(Topic::Traffic, lot, 2 * block[1] + i64::from(site.v < middle))
    }
}

fn car(centre: [f64; 2], ahead: [f64; 2], ground: f64, color: Rgb) -> Object {
    let length = ahead[0].hypot(ahead[1]).max(1e-9);
    let axis = [ahead[0] / length, ahead[1] / length];
    let frame = Frame { centre, axis, half: [2.2, 0.9] };
    Object::Slab(Slab { frame, foot: ground, height: 1.48, color, kind: SlabKind::Car })
}

const FIELD_TURN: [f64; 2] = [0.920_504_853_452_440_4, 0.390_731_128_489_273_77];

fn field_frame(u: f64, v: f64) -> [f64; 2] {
    [u * FIELD_TURN[0] + v * FIELD_TURN[1], v * FIELD_TURN[0] - u * FIELD_TURN[1]]
}

fn field_frame_inverse(along: f64, across: f64) -> [f64; 2] {
    [along * FIELD_TURN[0] - across * FIELD_TURN[1], across * FIELD_TURN[0] + along * FIELD_TURN[1]]
}

/// A house with what is on and beside it: wing, dormers, chimney, garage, terrace.
fn house(lot: &Lot, setback: f64, palette: [Rgb; 2], rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
    let color = match rng.random_range(0.0..1.0) {
        c if c < 0.35 => palette[0],
        c if c < 0.55 => palette[1],
        _ => pick(rng, &ROOF_TILES),
    };
    let color = tint(color, rng.random_range(-0.08..0.08));
    let along_street = rng.random_bool(0.74);
    let mut long = rng.random_range(5.2..7.4_f64);
    let mut wide = rng.random_range(4.3..5.6_f64);
    if !along_street {
        (long, wide) = (long.min(6.2), wide.min(0.33 * lot.width));
    }
    long = long.min(0.5 * lot.width - 1.6).max(wide);
    let reach = if along_street { wide } else { long };
    let behind = setback + rng.random_range(-0.8..1.6) + reach;
    let shift = rng.random_range(-1.0..1.0)
        * (0.5 * lot.width - if along_street { long } else { wide } - 1.2).max(0.0);
    let plain = lot.frame(shift, behind, [long, wide]);
    let mut frame = if along_street { plain } else { plain.turned(0.0, 0.0, [long, wide]) };
    let (sin, cos) = rng.random_range(-0.035..0.035_f64).sin_cos();
    frame.axis = [frame.axis[0] * cos - frame.axis[1] * sin, frame.axis[1] * cos + frame.axis[0] * sin];

    let ground = lot.ground(shift, behind);
    let pitch = rng.random_range(33.0..47.0_f64).to_radians().tan();
    let eaves = ground + rng.random_range(3.0..5.9);
    let shape = match rng.random_range(0.0..1.0) {
        s if s < 0.07 => RoofShape::Flat,
        s if s < 0.27 => RoofShape::Hip,
        _ => RoofShape::Gable,
    };
    let rise = pitch * wide;
    let color = if shape == RoofShape::Flat { [0.56, 0.56, 0.54] } else { color };
    let panels = rng.random_bool(0.17);
    found.push(Object::Roof(Roof { frame, shape, eaves, rise, color, panels }));

    // A wing towards the garden.
    let garden = if along_street { lot.back } else { -1.0 };
    if shape != RoofShape::Flat && rng.random_bool(0.3) {
        let half = rng.random_range(2.4..3.4_f64).min(wide - 0.4);
        let out = wide + rng.random_range(2.5..5.0);
        let side = long - half - rng.random_range(0.0..1.0);
        let side = if rng.random_bool(0.5) { side } else { -side };
        let wing = frame.turned(side, garden * out / 2.0, [out / 2.0, half]);
        found.push(Object::Roof(Roof {
            frame: wing,
            shape: RoofShape::Gable,
            eaves,
            rise: pitch * half,
            color,
            panels: false,
        }));
    }
    if shape == RoofShape::Gable && rise > 3.0 && rng.random_bool(0.35) {
        for side in [-1.0, 1.0] {
            let dormer = frame.turned(side * 0.42 * long, -garden * 0.5 * wide, [0.34 * wide, 1.15]);
            let eaves = eaves + 0.52 * rise;
            found.push(Object::Roof(Roof {
                frame: dormer,
                shape: RoofShape::Gable,
                eaves,
                rise: 0.8,
                color: tint(color, -0.06),
                panels: false,
            }));
        }
    }
    if shape != RoofShape::Flat && rng.random_bool(0.65) {
        let chimney = frame.moved(rng.random_range(-0.45..0.45) * long, 0.5, [0.42, 0.36]);
        let top = eaves + rise + 0.35;
        found.push(Object::Roof(Roof {
            frame: chimney,
            shape: RoofShape::Flat,
            eaves: top,
            rise: 0.0,
            color: [0.42, 0.30, 0.26],
            panels: false,
        }));
    }
    let house = [shift, behind, if along_street { long } else { wide }];
    driveway(lot, house, ground, color, rng, found);
    let terrace = lot.frame(shift + 0.3 * long, behind + reach + 1.6, [2.6, 1.8]);
    found.push(Object::Decal(Decal {
        frame: terrace,
        color: tint(PAVING, rng.random_range(-0.15..0.1)),
        intensity: 15_000,
    }));
}

/// The way to a garage beside the house, often with the garage, sometimes with a car. `[shift, behind, half]`: where along
/// and behind the front the middle of the house is, and half its width there.
fn driveway(
    lot: &Lot,
    [shift, behind, half]: [f64; 3],
    ground: f64,
    color: Rgb,
    rng: &mut Pcg64Mcg,
    found: &mut Vec<Object>,
) {
    let hand = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let drive = hand * (0.5 * lot.width - 2.0);
    if rng.random_bool(0.55) {
        let garage = lot.frame(drive, behind + 1.0, [1.7, 3.1]);
        let free = (drive - shift).abs() > 1.6 + half;
        if free {
            let flat = rng.random_bool(0.7);
            found.push(Object::Roof(Roof {
                frame: garage.turned(0.0, 0.0, [3.1, 1.7]),
                shape: if flat { RoofShape::Flat } else { RoofShape::Gable },
                eaves: ground + 2.4,
                rise: 1.4,
                color: if flat { [0.50, 0.50, 0.49] } else { color },
                panels: false,
            }));
        }
        let length = behind - if free { 2.1 } else { 0.0 };
        let shade = pick(rng, &[PAVING, [0.52, 0.50, 0.49], [0.62, 0.54, 0.48]]);
        found.push(Object::Decal(Decal {
            frame: lot.frame(drive, length / 2.0, [1.6, length / 2.0]),
            color: shade,
            intensity: 15_000,
        }));
        if rng.random_bool(0.4) && length > 5.5 {
            let at = lot.at(drive, length - 3.2);
            let along = lot.front.turned(0.0, 0.0, [1.0, 1.0]).axis;
            found.push(car(at, along, lot.ground(drive, length - 3.2), pick(rng, &CAR_PAINT)));
        }
    }
}

/// A pool or a bed, and a shed, in what of the lot is far enough from the front.
fn furnish_garden(lot: &Lot, rng: &mut Pcg64Mcg, found: &mut Vec<Object>) {
    let room = lot.depth - 15.0;
    if room > 6.0 {
        if rng.random_bool(0.06) {
            let pool = lot.frame(rng.random_range(-3.0..3.0), 18.0 + 0.5 * (room - 6.0), [3.6, 1.8]);
            found.push(Object::Decal(Decal { frame: pool, color: [0.33, 0.66, 0.74], intensity: 3_000 }));
        } else if rng.random_bool(0.18) {
            let bed = lot.frame(rng.random_range(-4.0..4.0), lot.depth - 4.5, [2.8, 1.9]);
            found.push(Object::Decal(Decal { frame: bed, color: [0.40, 0.31, 0.23], intensity: 14_000 }));
        }
        if rng.random_bool(0.4) {
            let hand = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            let (along, behind) = (hand * (0.5 * lot.width - 2.8), lot.depth - 2.2);
            found.push(Object::Roof(Roof {
                frame: lot.frame(along, behind, [1.7, 1.3]),
                shape: RoofShape::Shed,
                eaves: lot.ground(along, behind) + 2.0,
                rise: 0.6,
                color: [0.45, 0.37, 0.30],
                panels: false,
            }));
        }
    }
}
