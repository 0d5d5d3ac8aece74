//! A square of the town made ready for many queries: the smooth fields on a lattice, the objects in bins.

use super::cover::{carriageway, water};
use super::object::{Object, Pylon, Rgb, SlabKind, WIRES};
use super::random::grain;
use super::terrain::{Site, WATER_LEVEL};
use super::town::{Blocks, DECK, DECK_HALF, Streets, Town};

/// Side of a patch, m.
pub const PATCH: f64 = 64.0;
/// Spacing of its lattice of smooth fields, m.
const LATTICE: f64 = 4.0;
const NODES: usize = (PATCH / LATTICE) as usize + 1;
/// Side of its bins, m.
const BIN: f64 = 2.0;
const BINS: usize = (PATCH / BIN) as usize;
/// A wire is hit by pulses that pass within this distance, m: about half a footprint.
const WIRE_REACH: f64 = 0.17;

/// ASPRS classes (LAS 1.4 R15, table 17).
pub mod class {
    /// Processed, but none of the others.
    pub const UNCLASSIFIED: u8 = 1;
    /// Bare earth.
    pub const GROUND: u8 = 2;
    /// Below 2 m.
    pub const LOW_VEGETATION: u8 = 3;
    /// 2 to 5 m.
    pub const MEDIUM_VEGETATION: u8 = 4;
    /// Above 5 m.
    pub const HIGH_VEGETATION: u8 = 5;
    /// Roofs.
    pub const BUILDING: u8 = 6;
    /// Echoes from below the ground.
    pub const LOW_NOISE: u8 = 7;
    /// The river.
    pub const WATER: u8 = 9;
    /// Carriageways.
    pub const ROAD: u8 = 11;
    /// Conductors of the power line.
    pub const WIRE: u8 = 14;
    /// Pylons.
    pub const TOWER: u8 = 15;
    /// Bridge decks.
    pub const BRIDGE: u8 = 17;
    /// Birds.
    pub const HIGH_NOISE: u8 = 18;
}

/// What a pulse meets: one possible return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Absolute height, m, without measuring noise.
    pub height: f64,
    /// ASPRS class.
    pub class: u8,
    /// sRGB, 0 to 1.
    pub color: Rgb,
    /// Reflected intensity before noise.
    pub intensity: u16,
    /// Standard deviation of measured heights, m.
    pub spread: f64,
}

/// A crown above the solid surface.
#[derive(Clone, Copy, Debug)]
pub struct Leaves {
    /// Absolute height of the outer surface, m.
    pub top: f64,
    /// Absolute height of the crown's lower end, m.
    pub bottom: f64,
    /// Colour at the outer surface.
    pub color: Rgb,
    /// Dense enough that hardly a pulse comes through: hedges, bushes.
    pub dense: bool,
}

/// Everything above one place, from the ground up.
#[derive(Clone, Copy, Debug)]
pub struct Section {
    /// The topmost solid surface: ground, water, road, roof, deck, car.
    pub solid: Hit,
    /// The highest leaves above it.
    pub leaves: Option<Leaves>,
    /// Steel or wire above everything.
    pub wire: Option<Hit>,
    /// Height of the ground, m.
    pub ground: f64,
}

/// The square [i·64, (i+1)·64) × [j·64, (j+1)·64) of a town: a pure function of (seed, i, j).
pub struct Patch<'a> {
    town: &'a Town,
    corner: [f64; 2],
    sites: Vec<Site>,
    objects: Vec<Object>,
    /// Objects of bin `b` are `members[starts[b]..starts[b + 1]]`.
    starts: Vec<u32>,
    members: Vec<u16>,
    /// The power line that crosses, with its pylons: index, first pylon, their feet.
    spans: Option<(i64, i64, Vec<Pylon>)>,
}

impl<'a> Patch<'a> {
    /// Builds the patch with index (i, j).
    pub fn new(town: &'a Town, i: i64, j: i64) -> Patch<'a> {
        Patch::beside(town, i, j, &mut Blocks::default())
    }

    /// The same, faster where a patch nearby was built with the same `blocks`.
    pub(crate) fn beside(town: &'a Town, i: i64, j: i64, blocks: &mut Blocks) -> Patch<'a> {
        let corner = [i as f64 * PATCH, j as f64 * PATCH];
        let sites = (0..NODES * NODES)
            .map(|k| {
                town.terrain
                    .site(corner[0] + (k % NODES) as f64 * LATTICE, corner[1] + (k / NODES) as f64 * LATTICE)
            })
            .collect();
        let range = [corner[0], corner[1], corner[0] + PATCH, corner[1] + PATCH];
        let objects = town.objects(range, blocks);
        assert!(objects.len() <= usize::from(u16::MAX), "a patch of 64 m holds some hundred objects");
        let bins = |object: &Object| {
            let [west, south, east, north] = object.bounds();
            let cell =
                |value: f64, low: f64| ((value - low) / BIN).floor().clamp(0.0, (BINS - 1) as f64) as usize;
            let (i0, i1) = (cell(west, corner[0]), cell(east, corner[0]));
            let (j0, j1) = (cell(south, corner[1]), cell(north, corner[1]));
            (j0..=j1).flat_map(move |j| (i0..=i1).map(move |i| j * BINS + i))
        };
        let mut starts = vec![0u32; BINS * BINS + 1];
        for object in &objects {
            bins(object).for_each(|bin| starts[bin + 1] += 1);
        }
        for bin in 0..BINS * BINS {
            starts[bin + 1] += starts[bin];
        }
        let mut next = starts.clone();
        let mut members = vec![0u16; starts[BINS * BINS] as usize];
        for (index, object) in objects.iter().enumerate() {
            for bin in bins(object) {
                members[next[bin] as usize] = index as u16;
                next[bin] += 1;
            }
        }
        let (line, across, along) = Town::power_line(corner[0] + PATCH / 2.0, corner[1] + PATCH / 2.0);
        let spans = (across.abs() < PATCH).then(|| {
            let (first, _) = Town::span(along - PATCH);
            (line, first, (first..first + 4).map(|k| town.pylon(line, k)).collect())
        });
        Patch { town, corner, sites, objects, starts, members, spans }
    }

    /// Index of the patch that holds (x, y).
    pub fn index(x: f64, y: f64) -> [i64; 2] {
        [(x / PATCH).floor() as i64, (y / PATCH).floor() as i64]
    }

    /// The smooth fields at (x, y) inside this patch: bilinear on the 4 m lattice, which is their definition.
    #[inline]
    pub fn site(&self, x: f64, y: f64) -> Site {
        let (tx, ty) = ((x - self.corner[0]) / LATTICE, (y - self.corner[1]) / LATTICE);
        let (i, j) = ((tx as usize).min(NODES - 2), (ty as usize).min(NODES - 2));
        let (tx, ty) = (tx - i as f64, ty - j as f64);
        let node = &self.sites[j * NODES + i..];
        Site::between([&node[0], &node[1], &node[NODES], &node[NODES + 1]], tx, ty)
    }

    /// Height of the ground (water's surface on the river) at (x, y), m.
    pub fn ground(&self, x: f64, y: f64) -> f64 {
        let site = self.site(x, y);
        self.town.built_ground(&site, &self.town.streets(&site)).max(WATER_LEVEL)
    }

    fn objects_at(&self, x: f64, y: f64) -> impl Iterator<Item = &Object> {
        let cell = |value: f64, low: f64| (((value - low) / BIN) as usize).min(BINS - 1);
        let bin = cell(y, self.corner[1]) * BINS + cell(x, self.corner[0]);
        let members = &self.members[self.starts[bin] as usize..self.starts[bin + 1] as usize];
        members.iter().map(|&index| &self.objects[usize::from(index)])
    }

    /// Height of the highest roof above (x, y), m.
    pub fn roof(&self, x: f64, y: f64) -> Option<f64> {
        let roofs = self.objects_at(x, y).filter_map(|object| match object {
            Object::Roof(roof) => roof.height(x, y),
            _ => None,
        });
        roofs.reduce(f64::max)
    }

    /// Height of the power line's wires at (x, y), within reach of a pulse, m; highest first.
    pub fn wire(&self, x: f64, y: f64) -> Option<f64> {
        let (line, first, pylons) = self.spans.as_ref()?;
        let (nearest, across, along) = Town::power_line(x, y);
        if nearest != *line || across.abs() > 8.0 {
            return None;
        }
        let (k, t) = Town::span(along);
        let at = usize::try_from(k - first).ok()?;
        let (a, b) = (pylons.get(at)?.foot, pylons.get(at + 1)?.foot);
        // The pylon's axis points the same way as `across`.
        let hit = (0..WIRES.len()).filter(|&w| (across - WIRES[w][0]).abs() < WIRE_REACH);
        hit.map(|w| Town::wire_height(w, t, a, b)).reduce(f64::max)
    }

    /// What stands above (x, y) inside this patch.
    pub fn section(&self, x: f64, y: f64) -> Section {
        let site = self.site(x, y);
        let streets = self.town.streets(&site);
        let ground = self.town.built_ground(&site, &streets);
        let mut solid = self.bare(&site, &streets, ground, x, y);
        let ground = solid.height;
        if let Some(away) = self.town.deck(&site, &streets) {
            solid = deck(&site, &streets, away, x, y);
        }
        let mut leaves: Option<Leaves> = None;
        let mut steel: Option<f64> = None;
        let mut shaded = 0.0_f32;
        for object in self.objects_at(x, y) {
            match object {
                Object::Roof(roof) => {
                    if let Some(height) = roof.height(x, y).filter(|&h| h > solid.height) {
                        let intensity = if roof.color[0] > roof.color[2] * 1.3 { 21_000 } else { 13_000 };
                        let color = roof.shade(x, y);
                        solid = Hit { height, class: class::BUILDING, color, intensity, spread: 0.02 };
                    }
                }
                Object::Tree(tree) => {
                    let Some(crown) = tree.crown(x, y) else { continue };
                    shaded = 0.3;
                    if leaves.is_none_or(|other| crown.top > other.top) {
                        let light = 0.62 + 0.56 * crown.light as f32;
                        leaves = Some(Leaves {
                            top: crown.top,
                            bottom: crown.bottom,
                            color: tree.color.map(|c| c * light),
                            dense: tree.habit == super::object::Habit::Shrub,
                        });
                    }
                }
                Object::Slab(slab) => {
                    let Some(height) = slab.top(x, y) else { continue };
                    if slab.kind == SlabKind::Car {
                        if height > solid.height {
                            let glass = height < slab.foot + 1.4 || grain(41, x * 3.0, y * 3.0) < 0.75;
                            let color = if glass { slab.color } else { [0.16, 0.18, 0.2] };
                            solid = Hit {
                                height,
                                class: class::UNCLASSIFIED,
                                color,
                                intensity: 19_000,
                                spread: 0.02,
                            };
                        }
                    } else if leaves.is_none_or(|other| height > other.top) {
                        let light = 1.0 + 0.16 * grain(42, x * 2.4, y * 2.4) as f32;
                        let color = slab.color.map(|c| c * light);
                        leaves = Some(Leaves { top: height, bottom: slab.foot, color, dense: true });
                    }
                }
                Object::Decal(decal) => {
                    if solid.class == class::GROUND && decal.frame.inside(x, y).is_some() {
                        let light = 1.0 + 0.05 * grain(43, x * 1.3, y * 1.3) as f32;
                        solid.color = decal.color.map(|c| c * light);
                        solid.intensity = decal.intensity;
                        solid.spread = 0.015;
                    }
                }
                Object::Pylon(pylon) => steel = pylon.steel(x, y),
            }
        }
        if solid.class == class::GROUND {
            solid.color = solid.color.map(|c| c * (1.0 - shaded));
        }
        let leaves = leaves.filter(|leaves| leaves.top > solid.height + 0.15);
        let metal = |height, class, shade: f32| Hit {
            height,
            class,
            color: [shade, shade, shade * 1.03],
            intensity: 6_000,
            spread: 0.02,
        };
        let tower = steel.map(|height| metal(height, class::TOWER, 0.56));
        let wire = tower.or_else(|| self.wire(x, y).map(|height| metal(height, class::WIRE, 0.24)));
        Section { solid, leaves, wire, ground }
    }

    fn bare(&self, site: &Site, streets: &Streets, ground: f64, x: f64, y: f64) -> Hit {
        if ground < WATER_LEVEL {
            let color = water(site, x, y);
            return Hit { height: WATER_LEVEL, class: class::WATER, color, intensity: 1_500, spread: 0.015 };
        }
        let cover = self.town.cover(site, streets, x, y);
        let on_road = streets.nearest().is_some_and(|road| road.away.abs() < road.half);
        Hit {
            height: ground,
            class: if on_road { class::ROAD } else { class::GROUND },
            color: cover.color,
            intensity: cover.intensity,
            spread: cover.spread,
        }
    }
}

/// The top of a bridge: carriageway, pavements, railings.
fn deck(site: &Site, streets: &Streets, away: f64, x: f64, y: f64) -> Hit {
    let (fine, coarse) = (grain(1, x * 1.7, y * 1.7), grain(2, x * 0.21, y * 0.21));
    let hit =
        |height, color, intensity| Hit { height, class: class::BRIDGE, color, intensity, spread: 0.015 };
    match (streets.u, away.abs()) {
        (Some(road), from) if from < road.half => {
            let cover = carriageway(road, streets, site, fine, coarse);
            hit(DECK, cover.color, cover.intensity)
        }
        (_, from) if from > DECK_HALF - 0.35 => hit(DECK + 1.0, [0.50, 0.47, 0.43], 12_000),
        _ => hit(DECK + 0.15, [0.62_f32, 0.59, 0.55].map(|c| c * (1.0 + 0.04 * fine as f32)), 16_000),
    }
}
