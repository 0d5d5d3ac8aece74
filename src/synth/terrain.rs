//! The land: hills, a river, where town and forest stand, and the bent frame that streets follow.

use super::random::{Topic, mix, unit};
use noise::{NoiseFn, Perlin};

/// Height of the river's surface, m.
pub const WATER_LEVEL: f64 = 214.0;
/// Half of the river's width at the water line, m (distances to the river are scaled to it).
pub const RIVER_HALF: f64 = 13.0;
/// A river crosses the plane every so many metres of northing.
const RIVER_SPACING: f64 = 4032.0;
/// Northing of the first river's mean line, m from the town's square.
const RIVER_NORTH: f64 = -148.0;
/// Mean distance between villages, m.
const VILLAGE_SPACING: f64 = 1300.0;

/// The smooth quantities at one place.
#[derive(Clone, Copy, Debug, Default)]
pub struct Site {
    /// Bare earth before roads are built, m.
    pub height: f64,
    /// Bent coordinates (m): streets are lines of constant `u` or `v`.
    pub u: f64,
    pub v: f64,
    /// |∇u| and |∇v|: a distance on the ground is a difference in u or v divided by this.
    pub grad_u: f64,
    pub grad_v: f64,
    /// Distance from the river's middle, m, positive to the north, scaled so that the water ends near
    /// `RIVER_HALF`.
    pub river: f64,
    /// 1 in the middle of a village, 0 at its edge, negative outside.
    pub town: f64,
    /// Positive where forest grows.
    pub forest: f64,
    /// A slow variation in [-1, 1] for colours.
    pub tint: f64,
}

impl Site {
    const FIELDS: usize = 9;

    fn pack(&self) -> [f64; Site::FIELDS] {
        let s = self;
        [s.height, s.u, s.v, s.grad_u, s.grad_v, s.river, s.town, s.forest, s.tint]
    }

    fn unpack(f: [f64; Site::FIELDS]) -> Site {
        let [height, u, v, grad_u, grad_v, river, town, forest, tint] = f;
        Site { height, u, v, grad_u, grad_v, river, town, forest, tint }
    }

    /// Bilinear between the corners (00, 10, 01, 11) of a lattice square.
    #[inline]
    pub fn between(corners: [&Site; 4], tx: f64, ty: f64) -> Site {
        let weights = [(1.0 - tx) * (1.0 - ty), tx * (1.0 - ty), (1.0 - tx) * ty, tx * ty];
        let mut out = [0.0; Site::FIELDS];
        for (corner, weight) in corners.into_iter().zip(weights) {
            for (o, c) in out.iter_mut().zip(corner.pack()) {
                *o += weight * c;
            }
        }
        Site::unpack(out)
    }
}

/// A village: where, how large.
#[derive(Clone, Copy, Debug)]
pub struct Village {
    /// Centre, m from the main square.
    pub centre: [f64; 2],
    /// Radius, m.
    pub radius: f64,
    /// Direction of the wooded hill beside it, radians from north to east.
    hill: f64,
}

impl Village {
    fn hill(&self) -> [f64; 2] {
        let away = self.radius + 80.0;
        [self.centre[0] + away * self.hill.sin(), self.centre[1] + away * self.hill.cos()]
    }
}

/// The terrain's noise fields; a pure function of the seed.
pub struct Terrain {
    pub seed: u64,
    hills: Perlin,
    bend_u: Perlin,
    bend_v: Perlin,
    meander: Perlin,
    cover: Perlin,
}

fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Terrain {
    pub fn new(seed: u64) -> Terrain {
        let perlin = |k: u64| Perlin::new(mix(seed, Topic::Village, k as i64, -1) as u32);
        Terrain {
            seed,
            hills: perlin(1),
            bend_u: perlin(2),
            bend_v: perlin(3),
            meander: perlin(4),
            cover: perlin(5),
        }
    }

    /// Bent coordinates of (x, y): near the identity, slopes under 0.5.
    pub fn bend(&self, x: f64, y: f64) -> [f64; 2] {
        let wave = |noise: &Perlin| {
            62.0 * noise.get([x / 430.0 + 0.31, y / 430.0 + 0.77])
                + 8.0 * noise.get([x / 150.0, y / 150.0 + 0.4])
        };
        [x + wave(&self.bend_u), y + wave(&self.bend_v)]
    }

    /// The place whose bent coordinates are (u, v), to a millimetre.
    pub fn unbend(&self, u: f64, v: f64) -> [f64; 2] {
        let (mut x, mut y) = (u, v);
        // A contraction: each round shrinks the error by the bend's slope (< 0.5).
        for _ in 0..16 {
            let [bu, bv] = self.bend(x, y);
            let (du, dv) = (u - bu, v - bv);
            x += du;
            y += dv;
            if du.abs() + dv.abs() < 1e-4 {
                break;
            }
        }
        [x, y]
    }

    /// Northing of the middle of the river with index `row` at easting `x`.
    pub fn river_middle(&self, row: f64, x: f64) -> f64 {
        let row_offset = row * 17.3 + 0.5;
        RIVER_NORTH
            + row * RIVER_SPACING
            + 52.0 * self.meander.get([x / 360.0 + 0.15, row_offset])
            + 16.0 * self.meander.get([x / 130.0 + 0.6, row_offset + 5.5])
    }

    /// Index of the river nearest to northing `y`.
    pub fn river_row(y: f64) -> f64 {
        ((y - RIVER_NORTH) / RIVER_SPACING).round()
    }

    /// Distance from the middle of the river, positive to the north: as [`Site::river`] says, and plainly along y.
    fn river_distance(&self, x: f64, y: f64) -> [f64; 2] {
        let row = Terrain::river_row(y);
        let middle = self.river_middle(row, x);
        let slope = (self.river_middle(row, x + 2.0) - middle) / 2.0;
        let width = 1.0 + 0.16 * self.meander.get([x / 75.0, row * 3.1 + 9.2]);
        [(y - middle) / ((1.0 + slope * slope).sqrt() * width), y - middle]
    }

    /// The village with lattice index (i, j), if one stands there; (0, 0) is the town itself.
    pub fn village(&self, i: i64, j: i64) -> Option<Village> {
        let draw = |k: i64| unit(mix(self.seed, Topic::Village, i * 8 + k, j));
        let (centre, radius) = if (i, j) == (0, 0) {
            ([0.0, 0.0], 246.0)
        } else {
            if draw(0) < 0.3 {
                return None;
            }
            let x = (i as f64 + 0.5 * (draw(1) - 0.5)) * VILLAGE_SPACING;
            let y = (j as f64 + 0.5 * (draw(2) - 0.5)) * VILLAGE_SPACING;
            ([x, y], 110.0 + 170.0 * draw(3))
        };
        // North-east, give or take: beyond the roofs in the usual view from the south.
        let hill = (30.0 + 35.0 * draw(4)).to_radians();
        Some(Village { centre, radius, hill })
    }

    /// Villages that may matter at (x, y).
    pub fn villages_near(&self, x: f64, y: f64) -> impl Iterator<Item = Village> + '_ {
        let i = (x / VILLAGE_SPACING).round() as i64;
        let j = (y / VILLAGE_SPACING).round() as i64;
        (-1..=1).flat_map(move |dj| (-1..=1).filter_map(move |di| self.village(i + di, j + dj)))
    }

    /// Everything smooth at (x, y), metres from the main square.
    pub fn site(&self, x: f64, y: f64) -> Site {
        let [u, v] = self.bend(x, y);
        let [ue, ve] = self.bend(x + 1.0, y);
        let [un, vn] = self.bend(x, y + 1.0);
        let [river, north_of_river] = self.river_distance(x, y);

        let mut town = -1.0_f64;
        let mut knoll = 0.0_f64;
        let ragged = 1.0 + 0.3 * self.cover.get([x / 170.0 + 0.2, y / 170.0]);
        for village in self.villages_near(x, y) {
            let square = |p: [f64; 2]| (x - p[0]).powi(2) + (y - p[1]).powi(2);
            let away = square(village.centre).sqrt();
            town = town.max(1.0 - away / (village.radius * ragged));
            // Beyond this a hill is less than a millimetre high.
            if away < village.radius + 500.0 {
                knoll = knoll.max((-square(village.hill()) / (115.0 * 115.0)).exp());
            }
        }

        // The plain distance: far away the scaled one would fold the land along every bend of the river.
        let beyond = (north_of_river.abs() - 20.0).max(0.0);
        let octaves = |scale: f64, x0: f64| self.hills.get([x / scale + x0, y / scale + 0.43]);
        let rolling =
            0.5 + 0.55 * octaves(560.0, 0.13) + 0.24 * octaves(250.0, 0.71) + 0.09 * octaves(95.0, 0.37);
        let rise = 1.0 - (-beyond / 240.0).exp();
        let calm = 1.0 - 0.6 * smoothstep(-0.1, 0.5, town);
        let natural = WATER_LEVEL
            + 2.4
            + rise * calm * 40.0 * rolling.max(0.0)
            + 0.01 * beyond.min(900.0)
            + 42.0 * knoll * rise;
        let bed = WATER_LEVEL - 1.6;
        let height = bed + (natural - bed) * smoothstep(RIVER_HALF - 3.5, RIVER_HALF + 5.5, river.abs());

        let cover = |scale: f64, x0: f64| self.cover.get([x / scale + x0, y / scale + 0.61]);
        let forest = 0.75 * cover(300.0, 0.2) + 0.25 * cover(70.0, 0.8) + 1.15 * knoll
            - 2.4 * (town + 0.02).max(0.0)
            - (-(river / 55.0).powi(2)).exp()
            - 0.3;
        Site {
            height,
            u,
            v,
            grad_u: ((ue - u).powi(2) + (un - u).powi(2)).sqrt(),
            grad_v: ((ve - v).powi(2) + (vn - v).powi(2)).sqrt(),
            river,
            town,
            forest,
            tint: (0.7 * cover(120.0, 0.5) + 0.5 * cover(31.0, 0.1)).clamp(-1.0, 1.0),
        }
    }
}
