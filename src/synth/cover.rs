//! What the ground looks like from the air, and how strongly it reflects.

use super::object::Rgb;
use super::random::{Topic, grain, mix, unit};
use super::terrain::{RIVER_HALF, Site};
use super::town::{Crop, PAVEMENT, Street, Streets, Town};

/// The look of one place on the ground.
#[derive(Clone, Copy, Debug)]
pub struct Cover {
    pub color: Rgb,
    /// Reflected intensity before noise.
    pub intensity: u16,
    /// Spread of measured heights, m: grass is rougher than asphalt.
    pub spread: f64,
}

fn blend(a: Rgb, b: Rgb, t: f64) -> Rgb {
    let t = t.clamp(0.0, 1.0) as f32;
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
}

fn lit(color: Rgb, by: f64) -> Rgb {
    let by = 1.0 + by as f32;
    color.map(|c| c * by)
}

const LAWN: Rgb = [0.37, 0.47, 0.24];
const DRY_LAWN: Rgb = [0.58, 0.57, 0.37];
const MEADOW: Rgb = [0.46, 0.53, 0.30];
const SOIL: Rgb = [0.52, 0.42, 0.31];
const ASPHALT: Rgb = [0.45, 0.45, 0.46];
const SLABS: Rgb = [0.61, 0.59, 0.56];
const PAINT: Rgb = [0.85, 0.85, 0.83];
const GRAVEL: Rgb = [0.66, 0.61, 0.52];

impl Town {
    /// The ground's look at (x, y); `height` is the built ground there.
    pub(crate) fn cover(&self, site: &Site, streets: &Streets, x: f64, y: f64) -> Cover {
        let fine = grain(1, x * 1.7, y * 1.7);
        let coarse = grain(2, x * 0.21, y * 0.21);
        if let Some(cover) = road_cover(site, streets, fine, coarse) {
            return cover;
        }
        let grass = |color: Rgb, spread: f64| Cover {
            color: lit(color, 0.06 * fine + 0.07 * coarse),
            intensity: 26_000,
            spread,
        };
        let bank = (site.river.abs() - RIVER_HALF) / 6.0;
        if bank < 1.0 {
            let reeds = blend([0.40, 0.42, 0.26], MEADOW, bank + 0.3 * coarse);
            return Cover { color: lit(reeds, 0.1 * fine), intensity: 20_000, spread: 0.05 };
        }
        // A gravel path along the northern bank.
        if (site.river - RIVER_HALF - 12.0).abs() < 1.3 && site.town > -0.35 {
            return Cover { color: lit(GRAVEL, 0.05 * fine), intensity: 17_000, spread: 0.02 };
        }
        if site.town > 0.0 && site.forest < 0.0 {
            let dry = self.garden_tint(site, streets.block);
            let lawn = blend(LAWN, DRY_LAWN, 0.95 * dry * dry + 0.2 * coarse);
            return grass(lawn, 0.03);
        }
        if site.forest > -0.015 {
            let litter = blend([0.43, 0.43, 0.27], [0.36, 0.43, 0.24], 0.5 + 0.5 * coarse);
            return Cover { color: lit(litter, 0.12 * fine), intensity: 15_000, spread: 0.06 };
        }
        if site.town > -0.035 || site.forest > -0.05 || site.river.abs() < RIVER_HALF + 16.0 {
            return grass(blend(MEADOW, DRY_LAWN, 0.4 + 0.4 * site.tint), 0.05);
        }
        self.field(site, fine, coarse)
    }

    fn field(&self, site: &Site, fine: f64, coarse: f64) -> Cover {
        let parcel = self.parcel(site.u, site.v);
        if parcel.edge() < 1.0 {
            let verge = lit(blend(MEADOW, DRY_LAWN, 0.5), 0.08 * fine);
            return Cover { color: verge, intensity: 24_000, spread: 0.05 };
        }
        // Every third row of fields has a farm track in front.
        if parcel.row.rem_euclid(3) == 0 && parcel.across < 4.2 {
            let wheel = (parcel.across - 2.6).abs();
            let color = if wheel > 0.35 { lit(GRAVEL, 0.06 * fine) } else { lit(MEADOW, 0.1 * fine) };
            return Cover { color, intensity: 18_000, spread: 0.02 };
        }
        let own = unit(mix(self.seed(), Topic::Traffic, parcel.row * 31, parcel.column));
        let (color, row_spacing, contrast) = match parcel.crop {
            Crop::Wheat => ([0.74, 0.66, 0.43], 0.0, 0.0),
            Crop::Stubble => ([0.72, 0.63, 0.45], 3.0, 0.035),
            Crop::Ploughed => (SOIL, 1.8, 0.05),
            Crop::Maize => ([0.33, 0.45, 0.22], 1.5, 0.07),
            Crop::Beet => ([0.36, 0.49, 0.25], 2.2, 0.04),
            Crop::Barley => ([0.66, 0.62, 0.42], 0.0, 0.0),
            Crop::Meadow => ([0.44, 0.54, 0.27], 5.0, 0.03),
            Crop::Orchard => ([0.43, 0.52, 0.27], 0.0, 0.0),
        };
        let mut shade = 0.05 * fine + 0.05 * coarse + 0.05 * site.tint + 0.14 * (own - 0.5);
        if row_spacing > 0.0 {
            let phase = (parcel.across / row_spacing).rem_euclid(1.0);
            shade += if phase < 0.5 { contrast } else { -contrast };
        } else if parcel.crop != Crop::Orchard {
            // Tramlines of the sprayer, 18 m apart, and headlands.
            let lane = (parcel.across + 4.0).rem_euclid(18.0);
            if lane < 0.6 || (1.9..2.5).contains(&lane) {
                shade -= 0.12;
            }
        }
        let (intensity, spread) = if parcel.crop == Crop::Ploughed { (13_000, 0.05) } else { (24_000, 0.05) };
        Cover { color: lit(color, shade), intensity, spread }
    }
}

fn road_cover(site: &Site, streets: &Streets, fine: f64, coarse: f64) -> Option<Cover> {
    let road = streets.nearest()?;
    let edge = road.away.abs() - road.half;
    let in_town = site.town > 0.0;
    if edge < 0.0 {
        return Some(carriageway(road, streets, site, fine, coarse));
    }
    if in_town && edge < PAVEMENT {
        let kerb = if edge < 0.18 { 0.12 } else { 0.0 };
        return Some(Cover {
            color: lit(SLABS, kerb + 0.04 * fine + 0.04 * coarse),
            intensity: 16_000,
            spread: 0.015,
        });
    }
    if !in_town && edge < 1.4 {
        let verge = blend(GRAVEL, MEADOW, edge);
        return Some(Cover { color: lit(verge, 0.08 * fine), intensity: 21_000, spread: 0.04 });
    }
    None
}

/// Asphalt with its lane paint; also the top of a bridge.
pub(crate) fn carriageway(road: Street, streets: &Streets, site: &Site, fine: f64, coarse: f64) -> Cover {
    let away = road.away.abs();
    let crossing = [streets.u, streets.v].into_iter().flatten().all(|s| s.away.abs() < s.half + 3.0)
        && streets.u.is_some()
        && streets.v.is_some();
    let follows_u = streets.v.is_some_and(|s| s.away == road.away);
    let along = if follows_u { site.u } else { site.v };
    let middle = away < 0.14 && along.rem_euclid(9.0) < 4.5;
    let border = (away - road.half + 0.35).abs() < 0.11;
    if road.main && !crossing && (middle || border) {
        return Cover { color: PAINT, intensity: 34_000, spread: 0.012 };
    }
    // Wheel paths are polished darker; local streets are older and paler.
    let worn = if (away - 1.6).abs() < 0.5 { -0.03 } else { 0.0 };
    let age = if road.main { -0.04 } else { 0.07 };
    Cover { color: lit(ASPHALT, age + worn + 0.035 * fine + 0.04 * coarse), intensity: 9_000, spread: 0.012 }
}

/// The river's colour.
pub(crate) fn water(site: &Site, x: f64, y: f64) -> Rgb {
    let depth = 1.0 - (site.river / RIVER_HALF).powi(2);
    let ripple = 0.05 * grain(5, x * 0.8, y * 0.8) + 0.06 * grain(6, x * 0.07, y * 0.16);
    lit(blend([0.40, 0.43, 0.34], [0.25, 0.36, 0.35], 1.6 * depth), ripple)
}
