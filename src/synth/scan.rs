//! An airborne scanner over the town: flight lines, scan lines, pulses, returns.

use super::patch::{Hit, Leaves, PATCH, Patch, Section, class};
use super::random::{Topic, mix};
use super::terrain::RIVER_HALF;
use super::town::{Blocks, Town};
use crate::source::{BLOCK_RECORDS, FLAG_OVERLAP, PointBlock};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// E, N of the main square in the CRS (ETRS89 / UTM zone 32N), m; also the offset of stored coordinates.
pub const ORIGIN: [f64; 2] = [512_000.0, 5_403_000.0];
/// Size of a step of stored coordinates, m.
pub const SCALE: f64 = 0.001;

/// Distance between flight lines, and half the width of a swath, m: neighbours overlap by 100 m.
const LINE_SPACING: f64 = 400.0;
const SWATH_HALF: f64 = 250.0;
/// Height of the aircraft above the town, m, and its speed, m/s.
const FLYING_HEIGHT: f64 = 720.0;
const SPEED: f64 = 62.0;
/// Adjusted standard GPS time when flight line 0 passes the square, s; each line takes a while.
const TIME_ZERO: f64 = 431_000_000.0;
const TIME_A_LINE: f64 = 420.0;
/// Most returns of a pulse.
const RETURNS: usize = 5;
/// Chance that a pulse meets a bird or a multipath echo instead.
const NOISE_CHANCE: f64 = 2e-5;

/// A rectangle of the survey and how many points it holds. Its points are a pure function of the town's seed
/// and these numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tile {
    /// South-western corner, m from [`ORIGIN`].
    pub corner: [f64; 2],
    /// Extent to the east and north, m.
    pub size: [f64; 2],
    /// Exact number of points.
    pub points: u64,
}

/// Points with all that a LAS record stores of them, as columns of equal length.
#[derive(Debug, Default)]
pub struct ScanBlock {
    /// Coordinates at [`SCALE`] and [`ORIGIN`] (heights from 0), class, flags, intensity, returns, RGB.
    pub points: PointBlock,
    /// Adjusted standard GPS time, s.
    pub gps_time: Vec<f64>,
    /// Degrees from the nadir, positive to the east.
    pub scan_angle: Vec<f32>,
    /// Flight line: 1 west, 2 east of the square, 3 and on farther out.
    pub source_id: Vec<u16>,
    /// The pulse is the first or last of its scan line.
    pub edge_of_line: Vec<bool>,
}

impl ScanBlock {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.x.len()
    }

    /// No points.
    pub fn is_empty(&self) -> bool {
        self.points.x.is_empty()
    }

    fn clear(&mut self) {
        let p = &mut self.points;
        p.first_record += p.x.len() as u64;
        p.x.clear();
        p.y.clear();
        p.z.clear();
        p.class.clear();
        p.flags.clear();
        p.intensity.clear();
        p.returns.clear();
        p.rgb.clear();
        self.gps_time.clear();
        self.scan_angle.clear();
        self.source_id.clear();
        self.edge_of_line.clear();
    }
}

/// The part of one flight line's swath that lies in a tile.
struct Strip {
    /// Index of the flight line; line k flies at x = (k - ½) · 400 m, north when k is even.
    line: i64,
    west: f64,
    east: f64,
    /// Returns a pulse may bring, by share of the way through the tile.
    yields: Vec<f64>,
}

impl Strip {
    fn middle(line: i64) -> f64 {
        (line as f64 - 0.5) * LINE_SPACING
    }

    fn all(town: &Town, tile: &Tile) -> Vec<Strip> {
        let [low, high] = [tile.corner[0], tile.corner[0] + tile.size[0]];
        let first = ((low - SWATH_HALF) / LINE_SPACING + 0.5).ceil() as i64;
        let last = ((high + SWATH_HALF) / LINE_SPACING + 0.5).floor() as i64;
        (first..=last)
            .map(|line| {
                let middle = Strip::middle(line);
                (line, low.max(middle - SWATH_HALF), high.min(middle + SWATH_HALF))
            })
            .filter(|(_, west, east)| west < east)
            .map(|(line, west, east)| Strip {
                line,
                west,
                east,
                yields: expected_yields(town, tile, west, east),
            })
            .collect()
    }

    fn yield_at(&self, share: f64) -> f64 {
        self.yields[((share * self.yields.len() as f64) as usize).min(self.yields.len() - 1)]
    }
}

/// Returns a pulse, roughly, in bands from south to north: what lets pulses be spread evenly though the number of
/// records is fixed.
fn expected_yields(town: &Town, tile: &Tile, west: f64, east: f64) -> Vec<f64> {
    const BANDS: usize = 48;
    const ACROSS: usize = 20;
    let returns = |x: f64, y: f64| {
        let site = town.terrain.site(x, y);
        match () {
            _ if site.forest > 0.0 => 1.95,
            _ if site.river.abs() < RIVER_HALF => 0.85,
            _ if site.town > 0.0 => 1.15,
            _ => 1.03,
        }
    };
    let sample = |k: usize, of: usize| (k as f64 + 0.5) / of as f64;
    (0..BANDS)
        .map(|band| {
            let y = tile.corner[1] + tile.size[1] * sample(band, BANDS);
            let sum: f64 = (0..ACROSS).map(|k| returns(west + (east - west) * sample(k, ACROSS), y)).sum();
            sum / ACROSS as f64
        })
        .collect()
}

/// The patches under the scanner: at most two rows of them, built when first met.
struct Patches<'a> {
    town: &'a Town,
    rows: Vec<(i64, i64, Vec<Option<Patch<'a>>>)>,
    blocks: Blocks,
}

impl<'a> Patches<'a> {
    fn at(&mut self, x: f64, y: f64, strip: &Strip) -> &Patch<'a> {
        let [i, j] = Patch::index(x, y);
        let row = match self.rows.iter().position(|row| row.0 == j) {
            Some(row) => row,
            None => {
                if self.rows.len() == 2 {
                    self.rows.remove(0);
                }
                let first = (strip.west / PATCH).floor() as i64;
                let last = (strip.east / PATCH).floor() as i64;
                self.rows.push((j, first, (first..=last).map(|_| None).collect()));
                self.rows.len() - 1
            }
        };
        let town = self.town;
        let (_, first, patches) = &mut self.rows[row];
        patches[(i - *first) as usize].get_or_insert_with(|| Patch::beside(town, i, j, &mut self.blocks))
    }
}

/// Scans `tile`: hands out its points in the order of time within each flight line, in blocks of at most
/// [`BLOCK_RECORDS`]; exactly `tile.points` in all. Memory does not grow with the number of points.
///
/// # Errors
/// The first error of `sink`, which ends the scan.
pub fn scan<E>(town: &Town, tile: &Tile, mut sink: impl FnMut(&ScanBlock) -> Result<(), E>) -> Result<(), E> {
    let strips = Strip::all(town, tile);
    let height = tile.size[1];
    // Records that one pulse a square metre would bring.
    let mut expected_left: f64 = strips
        .iter()
        .map(|s| (s.east - s.west) * height * s.yields.iter().sum::<f64>() / s.yields.len() as f64)
        .sum();
    let pulses_a_square_metre = tile.points as f64 / expected_left;
    let scan_lines = ((height * pulses_a_square_metre.sqrt()).round() as u64).max(1);
    let spacing = height / scan_lines as f64;

    let mut left = tile.points;
    let mut block = ScanBlock::default();
    // How far the yields were off so far, starting with some trust in them.
    let (mut seen, mut foreseen) = (200.0, 200.0);
    let last_strip = strips.len() - 1;
    for (strip_index, strip) in strips.iter().enumerate() {
        let seed = mix(
            town.seed() ^ (tile.corner[0].to_bits().rotate_left(17)) ^ tile.corner[1].to_bits(),
            Topic::Scan,
            strip.line,
            tile.points as i64,
        );
        let mut pulse = Pulse::new(Pcg64Mcg::seed_from_u64(seed), strip, spacing, tile);
        let mut patches = Patches { town, rows: Vec::with_capacity(2), blocks: Blocks::default() };
        let width = strip.east - strip.west;
        for k in 0..scan_lines {
            let line = if pulse.northward { k } else { scan_lines - 1 - k };
            let share = (line as f64 + 0.5) / scan_lines as f64;
            let foresight = width * spacing * strip.yield_at(share);
            let is_last = strip_index == last_strip && k == scan_lines - 1;
            let before = left;
            let density = left as f64 / (expected_left.max(foresight) * seen / foreseen);
            let pulses = (width * spacing * density).round() as u64;
            pulse.start_line(tile.corner[1] + height * share);
            if is_last {
                // Exact to the record: each takes its share of what is left of the line.
                let mut x = strip.west;
                while left > 0 {
                    let step = (strip.east - x) / left as f64;
                    let section = pulse.aim(x + 0.5 * step, step, &mut patches, strip);
                    let records = pulse.fire(&section, left, true, &mut block);
                    left -= records;
                    x += step * records as f64;
                    flush(&mut block, &mut sink, false)?;
                }
            } else {
                let step = width / pulses.max(1) as f64;
                for p in 0..pulses {
                    if left == 0 {
                        break;
                    }
                    let x = strip.west + step * (p as f64 + 0.5);
                    let section = pulse.aim(x, step, &mut patches, strip);
                    left -= pulse.fire(&section, left, false, &mut block);
                    flush(&mut block, &mut sink, false)?;
                }
            }
            expected_left -= foresight;
            // What this line's pulses were foreseen to bring, against what they brought.
            foreseen += pulses as f64 * strip.yield_at(share);
            seen += (before - left) as f64;
        }
    }
    flush(&mut block, &mut sink, true)
}

fn flush<E>(
    block: &mut ScanBlock,
    sink: &mut impl FnMut(&ScanBlock) -> Result<(), E>,
    rest: bool,
) -> Result<(), E> {
    if block.len() + RETURNS > BLOCK_RECORDS || (rest && !block.is_empty()) {
        sink(block)?;
        block.clear();
    }
    Ok(())
}

/// A coordinate as it is stored: rounded to [`SCALE`] (without the library call of `f64::round`).
#[inline]
fn stored(value: f64) -> i32 {
    let steps = value * (1.0 / SCALE);
    (steps + 0.5_f64.copysign(steps)) as i32
}

/// The pulse that is under way, and its randomness.
struct Pulse {
    rng: Pcg64Mcg,
    middle: f64,
    line: i64,
    source_id: u16,
    northward: bool,
    spacing: f64,
    low: [f64; 2],
    high: [f64; 2],
    line_y: f64,
    /// How the scan line lies askew, spacings at the swath's edge.
    skew: f64,
    x: f64,
    y: f64,
    /// Degrees from the nadir.
    angle: f32,
    at_edge: bool,
}

impl Pulse {
    fn new(rng: Pcg64Mcg, strip: &Strip, spacing: f64, tile: &Tile) -> Pulse {
        // 0, 1, -1, 2, -2 … become 1, 2, 3, 4, 5 …
        let order = if strip.line > 0 { 2 * strip.line } else { 1 - 2 * strip.line };
        Pulse {
            rng,
            middle: Strip::middle(strip.line),
            line: strip.line,
            source_id: ((order - 1).rem_euclid(65_535) + 1) as u16,
            northward: strip.line.rem_euclid(2) == 0,
            spacing,
            low: [strip.west, tile.corner[1]],
            high: [strip.east, tile.corner[1] + tile.size[1]],
            line_y: 0.0,
            skew: 0.0,
            x: 0.0,
            y: 0.0,
            angle: 0.0,
            at_edge: false,
        }
    }

    fn start_line(&mut self, y: f64) {
        self.line_y = y;
        self.skew = 0.35 * (y * 0.05).sin();
    }

    /// Four numbers in [0, 1), 16 bits each.
    #[inline]
    fn four(&mut self) -> [f64; 4] {
        let bits = self.rng.next_u64();
        [0, 16, 32, 48].map(|shift| ((bits >> shift) & 0xffff) as f64 * (1.0 / 65_536.0))
    }

    #[inline]
    fn one(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Points the next pulse near easting `x` and looks at what stands there.
    #[inline]
    fn aim(&mut self, x: f64, step: f64, patches: &mut Patches<'_>, strip: &Strip) -> Section {
        let [a, b, ..] = self.four();
        // Scan lines turn with the aircraft's nose, a little.
        let sway = self.skew * (x - self.middle) / SWATH_HALF;
        let place = |value: f64, axis: usize| {
            // Mirrored at the tile's border, and a hair inside so that rounding stays inside.
            let (low, high) = (self.low[axis] + SCALE, self.high[axis] - SCALE);
            let mirrored = if value < low { 2.0 * low - value } else { value };
            let mirrored = if mirrored > high { 2.0 * high - mirrored } else { mirrored };
            f64::from(stored(mirrored.clamp(low, high))) * SCALE
        };
        let (px, py) = (
            place(x + (a - 0.5) * 0.25 * step, 0),
            place(self.line_y + self.spacing * (sway + (b - 0.5) * 0.2), 1),
        );
        (self.x, self.y) = (px, py);
        self.angle = ((px - self.middle) / FLYING_HEIGHT).atan().to_degrees() as f32;
        self.at_edge = SWATH_HALF - (px - self.middle).abs() < step;
        patches.at(px, py, strip).section(px, py)
    }

    /// Records the returns of the pulse, at most `limit`; how many they were. `sure` rules out none.
    fn fire(&mut self, section: &Section, limit: u64, sure: bool, block: &mut ScanBlock) -> u64 {
        let limit = limit.min(RETURNS as u64) as usize;
        let chance = self.one();
        if chance < NOISE_CHANCE {
            let high = chance < 0.5 * NOISE_CHANCE;
            let [a, ..] = self.four();
            let (height, class) = if high {
                (section.ground + 60.0 + 90.0 * a, class::HIGH_NOISE)
            } else {
                (section.ground - 3.0 - 22.0 * a, class::LOW_NOISE)
            };
            let hit = Hit { height, class, intensity: 900, spread: 0.0, ..section.solid };
            self.record(&[hit], block);
            return 1;
        }
        if section.solid.class == class::WATER && section.leaves.is_none() && section.wire.is_none() && !sure
        {
            // Still water mirrors slanted pulses away.
            let slant = (self.x - self.middle).abs() / SWATH_HALF;
            if self.one() < 0.03 + 0.22 * slant * slant {
                return 0;
            }
        }
        let mut hits = [section.solid; RETURNS];
        let mut count = 0;
        let mut blocked = false;
        if let Some(wire) = section.wire {
            hits[count] = wire;
            count += 1;
            blocked = self.one() < if wire.class == class::TOWER { 0.6 } else { 0.25 };
        }
        if let Some(leaves) = section.leaves.filter(|_| !blocked && count < limit) {
            let got = self.through_leaves(&leaves, section, &mut hits[count..limit]);
            blocked = got.1;
            count += got.0;
        }
        if !blocked && count < limit {
            hits[count] = section.solid;
            count += 1;
        }
        self.record(&hits[..count], block);
        count as u64
    }

    /// Returns from leaves, from the top down: how many, and whether the pulse ended in them.
    fn through_leaves(&mut self, leaves: &Leaves, section: &Section, hits: &mut [Hit]) -> (usize, bool) {
        let [gap, depth, more, through] = self.four();
        if gap < if leaves.dense { 0.03 } else { 0.07 } {
            return (0, false);
        }
        let leaf = |height: f64, shade: f32| {
            let above = height - section.ground;
            let class = match above {
                a if a < 2.0 => class::LOW_VEGETATION,
                a if a < 5.0 => class::MEDIUM_VEGETATION,
                _ => class::HIGH_VEGETATION,
            };
            let color = leaves.color.map(|c| c * shade);
            Hit { height, class, color, intensity: 19_000, spread: 0.05 }
        };
        let thickness = leaves.top - leaves.bottom;
        let first = leaves.top - 0.12 * depth * depth * thickness.min(4.0);
        hits[0] = leaf(first, 1.0);
        let mut count = 1;
        let mut height = first;
        let further = if leaves.dense { 0.12 } else { 0.48 };
        let mut going = more;
        while count + 1 < hits.len() && count < 4 && going < further {
            let [step, next, ..] = self.four();
            let lower = height - 0.7 - step * step * thickness;
            if lower < leaves.bottom.max(section.solid.height + 0.4) {
                break;
            }
            height = lower;
            hits[count] = leaf(height, 0.78);
            count += 1;
            going = next;
        }
        let ends = through > if leaves.dense { 0.1 } else { 0.34 };
        (count, ends)
    }

    fn record(&mut self, hits: &[Hit], block: &mut ScanBlock) {
        let across = self.x - self.middle;
        let direction = if self.northward { 1.0 } else { -1.0 };
        let along = (direction * self.line_y + 0.45 * self.spacing * across / SWATH_HALF) / SPEED;
        let time = TIME_ZERO + TIME_A_LINE * self.line as f64 + along;
        let angle = self.angle;
        let overlap = across.abs() > LINE_SPACING - SWATH_HALF;
        let (x, y) = (stored(self.x), stored(self.y));
        let total = hits.len() as u8;
        for (number, hit) in hits.iter().enumerate() {
            let [a, b, c, d] = self.four();
            // The sum of four uniform numbers, scaled to a deviation of 1, is close to a normal one.
            let error = (a + b + c + d - 2.0) * 1.732;
            let points = &mut block.points;
            points.x.push(x);
            points.y.push(y);
            points.z.push(stored(hit.height + hit.spread * error));
            points.class.push(hit.class);
            points.flags.push(if overlap { FLAG_OVERLAP } else { 0 });
            points.returns.push((number as u8 + 1) | (total << 4));
            let strength = 0.9 + 0.2 * a;
            points.intensity.push((f64::from(hit.intensity) * strength / f64::from(total).sqrt()) as u16);
            let grain = 65_535.0 * (0.98 + 0.04 * b as f32);
            points.rgb.push(hit.color.map(|c| (c * grain) as u16));
            block.gps_time.push(time);
            block.scan_angle.push(angle);
            block.source_id.push(self.source_id);
            block.edge_of_line.push(self.at_edge);
        }
    }
}

impl Tile {
    /// Whether (x, y), metres from [`ORIGIN`], lies in it.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        (0..2).all(|k| {
            let from_corner = [x, y][k] - self.corner[k];
            from_corner >= 0.0 && from_corner < self.size[k]
        })
    }
}
