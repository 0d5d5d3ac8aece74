//! Attributes of a point record, how they are packed, and the colours they are drawn in.
//!
//! Colours here (points' RGB, ramps, palettes) are sRGB-encoded; light is computed and EXR written in
//! linear values: [`srgb_to_linear`] after the lookup, [`linear_to_srgb`] before an 8-bit file.

use crate::coords::{Grid, Height};
use crate::text::tidy;
use bytemuck::{Pod, Zeroable};
use clap::ValueEnum;
use std::collections::BTreeSet;

/// What a column keeps of the point that won it. The order of the fields is the order in which points
/// are compared: the larger wins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Attributes {
    /// Height on the lattice.
    pub height: Height,
    /// ASPRS class, the whole byte.
    pub class: u8,
    /// Pulse return magnitude, as stored.
    pub intensity: u16,
    /// sRGB, 8 bit a channel; black when the file has no colour.
    pub rgb: [u8; 3],
    /// Return number in the low nibble, number of returns in the high nibble.
    pub returns: u8,
    /// `source::FLAG_…`.
    pub flags: u8,
}

/// [`Attributes`] as three words, shared with the shaders. Comparing the words from first to last is
/// comparing the attributes, so a maximum over records picks the winner of a cell:
///
/// | word | bits 31-24 | 23-16 | 15-8 | 7-0 |
/// |---|---|---|---|---|
/// | 0 | height, biased by 2³¹; 0 = no point | | | |
/// | 1 | class | intensity, high | intensity, low | red |
/// | 2 | green | blue | returns | flags |
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct Record(pub [u32; 3]);

impl Record {
    /// No point: below every other record.
    pub const EMPTY: Record = Record([0; 3]);

    /// Packs `a`.
    #[inline]
    pub fn pack(a: Attributes) -> Record {
        let [r, g, b] = a.rgb;
        Record([
            bias(a.height),
            u32::from(a.class) << 24 | u32::from(a.intensity) << 8 | u32::from(r),
            u32::from_be_bytes([g, b, a.returns, a.flags]),
        ])
    }

    /// The attributes; `None` for an empty record.
    #[inline]
    pub fn unpack(self) -> Option<Attributes> {
        let height = self.height()?;
        let [w1, w2] = [self.0[1].to_be_bytes(), self.0[2].to_be_bytes()];
        Some(Attributes {
            height,
            class: w1[0],
            intensity: u16::from_be_bytes([w1[1], w1[2]]),
            rgb: [w1[3], w2[0], w2[1]],
            returns: w2[2],
            flags: w2[3],
        })
    }

    /// No point.
    #[inline]
    pub fn is_empty(self) -> bool {
        self.0[0] == 0
    }

    /// Height on the lattice; `None` for an empty record.
    #[inline]
    pub fn height(self) -> Option<Height> {
        (!self.is_empty()).then(|| unbias(self.0[0]))
    }

    /// ASPRS class.
    #[inline]
    pub fn class(self) -> u8 {
        (self.0[1] >> 24) as u8
    }

    /// Class flags, [`crate::source::FLAG_WITHHELD`] and its neighbours.
    #[inline]
    pub fn flags(self) -> u8 {
        self.0[2] as u8
    }
}

/// Height as an unsigned number of the same order; 0 is left free, since `Height` is never `i32::MIN`.
#[inline]
pub(crate) fn bias(height: Height) -> u32 {
    height.0 as u32 ^ 0x8000_0000
}

/// The height of [`bias`].
#[inline]
pub(crate) fn unbias(word: u32) -> Height {
    Height((word ^ 0x8000_0000) as i32)
}

/// Which of the 256 classes are shown; bit `class % 32` of word `class / 32`, as the shaders read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct ClassMask(pub [u32; 8]);

impl Default for ClassMask {
    /// All but low noise (7) and high noise (18).
    fn default() -> ClassMask {
        ClassMask::all().without(&[7, 18])
    }
}

impl ClassMask {
    /// Every class.
    pub const fn all() -> ClassMask {
        ClassMask([u32::MAX; 8])
    }

    /// These classes alone.
    pub fn only(classes: &[u8]) -> ClassMask {
        ClassMask([0; 8]).with(classes)
    }

    /// Shows `classes` too.
    pub fn with(mut self, classes: &[u8]) -> ClassMask {
        classes.iter().for_each(|&c| self.0[usize::from(c >> 5)] |= 1 << (c & 31));
        self
    }

    /// Hides `classes`.
    pub fn without(mut self, classes: &[u8]) -> ClassMask {
        classes.iter().for_each(|&c| self.0[usize::from(c >> 5)] &= !(1 << (c & 31)));
        self
    }

    /// Whether `class` is shown.
    #[inline]
    pub fn shows(&self, class: u8) -> bool {
        self.0[usize::from(class >> 5)] >> (class & 31) & 1 != 0
    }
}

/// Kinds of points, by what shows or hides them: class, and whether they are withheld.
pub type Kinds = BTreeSet<(u8, bool)>;

/// Name of a class: LAS 1.4 R15, table 17; 8 and 12 as LAS 1.0 to 1.3 used them; 40 to 45 from the
/// topo-bathymetric domain profile.
pub fn class_name(class: u8) -> &'static str {
    match class {
        0 => "created, never classified",
        1 => "unclassified",
        2 => "ground",
        3 => "low vegetation",
        4 => "medium vegetation",
        5 => "high vegetation",
        6 => "building",
        7 => "low point (noise)",
        8 => "model key-point (legacy)",
        9 => "water",
        10 => "rail",
        11 => "road surface",
        12 => "overlap (legacy)",
        13 => "wire, guard (shield)",
        14 => "wire, conductor (phase)",
        15 => "transmission tower",
        16 => "wire-structure connector",
        17 => "bridge deck",
        18 => "high noise",
        19 => "overhead structure",
        20 => "ignored ground",
        21 => "snow",
        22 => "temporal exclusion",
        40 => "bathymetric point",
        41 => "water surface",
        42 => "derived water surface",
        43 => "submerged object",
        44 => "IHO S-57 object",
        45 => "no bottom found",
        23..64 => "reserved",
        64.. => "user-defined",
    }
}

/// Colours of classes 0 to 22, sRGB.
const CLASS_COLORS: [[u8; 3]; 23] = [
    [158, 158, 162], // created
    [196, 194, 188], // unclassified
    [168, 126, 84],  // ground
    [178, 214, 106], // low vegetation
    [104, 176, 72],  // medium vegetation
    [38, 124, 56],   // high vegetation
    [224, 96, 62],   // building
    [255, 0, 255],   // low noise
    [206, 160, 60],  // model key-point
    [62, 134, 214],  // water
    [116, 92, 148],  // rail
    [112, 118, 128], // road
    [214, 208, 154], // overlap
    [250, 226, 74],  // guard wire
    [255, 184, 0],   // conductor
    [64, 68, 150],   // tower
    [160, 116, 228], // connector
    [236, 164, 148], // bridge
    [255, 64, 148],  // high noise
    [0, 168, 168],   // overhead structure
    [116, 82, 62],   // ignored ground
    [236, 243, 252], // snow
    [146, 54, 70],   // temporal exclusion
];

/// sRGB colour of a class: fixed for 0 to 22; above, the hue turns by the golden angle from class to
/// class, so that neighbours differ and the colour never depends on what else is in the data.
pub fn class_color(class: u8) -> [u8; 3] {
    let k = f64::from(class);
    CLASS_COLORS.get(usize::from(class)).copied().unwrap_or_else(|| {
        let hue = (k * 137.507_764_05).to_radians();
        let (lightness, chroma) = (0.58 + 0.08 * (k % 4.0), 0.11);
        let lab = [lightness, chroma * hue.cos(), chroma * hue.sin()];
        oklab_to_srgb(lab).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
    })
}

/// Place of a return in its pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReturnKind {
    /// Number or count is 0: the file does not say.
    Unknown,
    /// The only one.
    Single,
    /// The first of several.
    First,
    /// Neither first nor last.
    Intermediate,
    /// The last of several.
    Last,
}

impl ReturnKind {
    /// Reads a `returns` byte: number in the low nibble, count in the high one.
    pub fn of(returns: u8) -> ReturnKind {
        match (returns & 15, returns >> 4) {
            (0, _) | (_, 0) => ReturnKind::Unknown,
            (_, 1) => ReturnKind::Single,
            (1, _) => ReturnKind::First,
            (number, count) if number < count => ReturnKind::Intermediate,
            _ => ReturnKind::Last,
        }
    }

    /// For a legend.
    pub fn name(self) -> &'static str {
        match self {
            ReturnKind::Unknown => "unknown",
            ReturnKind::Single => "single",
            ReturnKind::First => "first of several",
            ReturnKind::Intermediate => "intermediate",
            ReturnKind::Last => "last of several",
        }
    }

    /// sRGB.
    pub fn color(self) -> [u8; 3] {
        match self {
            ReturnKind::Unknown => [150, 150, 150],
            ReturnKind::Single => [222, 208, 178],
            ReturnKind::First => [86, 164, 84],
            ReturnKind::Intermediate => [238, 154, 52],
            ReturnKind::Last => [78, 116, 190],
        }
    }
}

/// What a point is coloured by. The numbers are what the shaders switch on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[repr(u32)]
pub enum ColorMode {
    /// The points' own colours.
    Rgb = 0,
    /// Height, by a ramp.
    Height = 1,
    /// ASPRS class, by a palette.
    Class = 2,
    /// Intensity, by a ramp.
    Intensity = 3,
    /// Single, first, intermediate or last return.
    Return = 4,
}

impl ColorMode {
    /// As typed.
    pub fn name(self) -> &'static str {
        match self {
            ColorMode::Rgb => "rgb",
            ColorMode::Height => "height",
            ColorMode::Class => "class",
            ColorMode::Intensity => "intensity",
            ColorMode::Return => "return",
        }
    }

    /// RGB if 5 % of the sample is not black (and not all of one colour), else class if classes beyond
    /// 0, 1, 2, 7, 12 and 18 exceed 10 %, else height.
    pub fn auto(sample: &AttributeSummary) -> ColorMode {
        let telling: u64 = (0..=255u8)
            .filter(|c| !matches!(c, 0..=2 | 7 | 12 | 18))
            .map(|c| sample.classes[usize::from(c)])
            .sum();
        if sample.points == 0 {
            ColorMode::Height
        } else if sample.colored * 20 >= sample.points && sample.rgb_constant.is_none() {
            ColorMode::Rgb
        } else if telling * 10 > sample.points {
            ColorMode::Class
        } else {
            ColorMode::Height
        }
    }
}

/// A colour ramp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Ramp {
    /// Blue-green lowland to pale heights: even steps to the eye, and never so dark that relief drowns.
    Relief,
    /// Dark violet, green, yellow; even steps to the eye.
    Viridis,
    /// Blue to yellow; the same with colour-blind eyes.
    Cividis,
    /// Black, red, pale yellow; even steps to the eye.
    Magma,
    /// Rainbow: many hues, uneven to the eye.
    Turbo,
    /// Dark to light grey.
    Grey,
    /// Blue, yellow, red, with a break at half the height: seed of the method, §3.3.4.
    Thesis,
}

/// Control colours of [`Ramp::Relief`], sRGB; lightness rises from each to the next.
const RELIEF: [[u8; 3]; 6] =
    [[44, 94, 122], [58, 128, 116], [112, 158, 88], [190, 184, 98], [232, 206, 148], [252, 242, 224]];

impl Ramp {
    /// sRGB colour at `t` in 0 to 1.
    pub fn at(self, t: f64) -> [f64; 3] {
        let t = t.clamp(0.0, 1.0);
        let published = |g: colorous::Gradient| {
            let c = g.eval_continuous(t);
            [c.r, c.g, c.b].map(|v| f64::from(v) / 255.0)
        };
        match self {
            Ramp::Relief => oklab_to_srgb(even_path(&RELIEF, t)).map(|v| v.clamp(0.0, 1.0)),
            Ramp::Viridis => published(colorous::VIRIDIS),
            Ramp::Cividis => published(colorous::CIVIDIS),
            Ramp::Magma => published(colorous::MAGMA),
            Ramp::Turbo => published(colorous::TURBO),
            Ramp::Grey => [0.12 + 0.86 * t; 3],
            Ramp::Thesis => {
                let h = 2.0 * t;
                if h >= 1.0 { [1.0, 2.0 - h, 0.0] } else { [h, h, 1.0 - h] }
            }
        }
    }

    /// Table index that stands for t = 1. The break of `Thesis` at t = ½ must fall on an entry for the
    /// interpolation between entries to be exact.
    fn last_index(self) -> f64 {
        if self == Ramp::Thesis { 254.0 } else { 255.0 }
    }
}

/// What cannot be coloured as asked.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AttributeError {
    /// Bounds of a range in the wrong order, equal, or not finite.
    #[error("colour range {lo},{hi}: both must be finite and the first lower than the second")]
    Range {
        /// Lower bound asked for.
        lo: f64,
        /// Upper bound asked for.
        hi: f64,
    },
}

/// A colour mode as the shaders read it: value of the field → index → table. RGB needs no table.
///
/// ```text
/// v     = word 0 | class | intensity | returns          (u32, by mode)
/// t     = v > lo ? min(float(v - lo) · scale, 255) : 0
/// color = mix(table[floor(t)], table[min(floor(t) + 1, 255)], fract(t))        sRGB; linearise after
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ColorTable {
    /// Which field, and whether a table is used at all.
    pub mode: ColorMode,
    /// Value of entry 0; heights biased as in [`Record`].
    pub lo: u32,
    /// Entries per step of the value.
    pub scale: f32,
    /// sRGB, alpha 1.
    pub table: Box<[[f32; 4]; 256]>,
    /// Lowest and highest value of the ramp, for a legend: CRS units for heights; `None` without ramp.
    pub range: Option<(f64, f64)>,
    /// The field has one value everywhere, said in words, and how that is drawn: in the colour that it stands for
    /// anyway, or grey where there is none (heights, intensities, RGB that is black).
    pub constant: Option<String>,
}

impl ColorTable {
    /// The table of `mode` for the data that `sample` stands for. `ramp`: default relief for heights,
    /// grey for intensity. `range` (CRS units for heights): default percentiles 2 to 98, for the thesis
    /// ramp lowest to highest. `grid`: whose lattice heights are on.
    pub fn new(
        mode: ColorMode,
        sample: &AttributeSummary,
        grid: &Grid,
        ramp: Option<Ramp>,
        range: Option<(f64, f64)>,
    ) -> Result<ColorTable, AttributeError> {
        if let Some((lo, hi)) = range
            && !(lo < hi && lo.is_finite() && hi.is_finite())
        {
            return Err(AttributeError::Range { lo, hi });
        }
        let direct = |color: fn(u8) -> [u8; 3]| ColorTable {
            mode,
            lo: 0,
            scale: 1.0,
            table: table(|i| color(i as u8).map(|v| f64::from(v) / 255.0)),
            range: None,
            constant: None,
        };
        let ramped = |spread: &Spread, default: Ramp, bias: &dyn Fn(f64) -> u32, steps: f64| {
            let ramp = ramp.unwrap_or(default);
            let (lo, hi) = range.unwrap_or(match ramp {
                Ramp::Thesis => (spread.min, spread.max),
                _ => spread.middle(),
            });
            ColorTable {
                mode,
                lo: bias(lo),
                scale: (ramp.last_index() / ((hi - lo) * steps)) as f32,
                table: table(|i| ramp.at(f64::from(i) / ramp.last_index())),
                range: Some((lo, hi)),
                constant: None,
            }
        };
        let own = match mode {
            ColorMode::Rgb if sample.rgb_constant == Some([0; 3]) => None,
            ColorMode::Rgb => Some(direct(|_| [0; 3])),
            ColorMode::Class => Some(direct(class_color)),
            ColorMode::Return => Some(direct(|byte| ReturnKind::of(byte).color())),
            ColorMode::Height | ColorMode::Intensity => None,
        };
        if let Some(words) = constant(mode, sample).filter(|_| range.is_none() || own.is_some()) {
            if let Some(own) = own.filter(|_| sample.points > 0) {
                return Ok(ColorTable { constant: Some(format!("{words}, drawn in that colour")), ..own });
            }
            let words = format!("{words}, drawn grey");
            let grey = table(|_| [0.65; 3]);
            // A grey table is read through a field, RGB too: class 0 to 255 all lead to grey.
            let mode = if mode == ColorMode::Rgb { ColorMode::Class } else { mode };
            return Ok(ColorTable {
                mode,
                lo: 0,
                scale: 0.0,
                table: grey,
                range: None,
                constant: Some(words),
            });
        }
        Ok(match mode {
            ColorMode::Rgb | ColorMode::Class | ColorMode::Return => {
                own.unwrap_or_else(|| direct(|_| [0; 3]))
            }
            ColorMode::Height => {
                let biased = |u: f64| biased_steps(u / grid.height_step);
                ramped(&sample.height, Ramp::Relief, &biased, grid.height_step.recip())
            }
            ColorMode::Intensity => {
                ramped(&sample.intensity, Ramp::Grey, &|v| v.clamp(0.0, 65535.0) as u32, 1.0)
            }
        })
    }

    /// What the shaders compute: sRGB of `record`.
    pub fn color(&self, record: Record) -> [f32; 3] {
        let [w0, w1, w2] = record.0;
        let value = match self.mode {
            ColorMode::Rgb => {
                return [w1 & 255, w2 >> 24, w2 >> 16 & 255].map(|v| v as f32 / 255.0);
            }
            ColorMode::Height => w0,
            ColorMode::Class => w1 >> 24,
            ColorMode::Intensity => w1 >> 8 & 0xffff,
            ColorMode::Return => w2 >> 8 & 255,
        };
        let t = (value.saturating_sub(self.lo) as f32 * self.scale).min(255.0);
        let (a, b) = (self.table[t as usize], self.table[(t as usize + 1).min(255)]);
        [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t.fract())
    }
}

/// Height in lattice steps → biased lattice height, held inside the lattice.
fn biased_steps(steps: f64) -> u32 {
    bias(Height((steps.ceil() as i32).max(i32::MIN + 1)))
}

fn table(color: impl Fn(u16) -> [f64; 3]) -> Box<[[f32; 4]; 256]> {
    Box::new(std::array::from_fn(|i| {
        let [r, g, b] = color(i as u16).map(|v| v as f32);
        [r, g, b, 1.0]
    }))
}

/// Says so, in words, when the field behind `mode` has one value in the whole sample.
fn constant(mode: ColorMode, sample: &AttributeSummary) -> Option<String> {
    let spread = |name, s: &Spread| (s.min >= s.max).then(|| format!("{name} is {} everywhere", tidy(s.min)));
    if sample.points == 0 {
        return Some("no points".to_owned());
    }
    match mode {
        ColorMode::Rgb if !sample.has_rgb => Some("there is no RGB in this data".to_owned()),
        ColorMode::Rgb => sample.rgb_constant.map(|[r, g, b]| format!("colour is {r},{g},{b} everywhere")),
        ColorMode::Height => spread("height", &sample.height),
        ColorMode::Intensity => spread("intensity", &sample.intensity),
        ColorMode::Class => {
            let mut classes = (0..=255u8).filter(|&class| sample.classes[usize::from(class)] > 0);
            let class = classes.next().filter(|_| classes.next().is_none())?;
            Some(format!("class is {class} ({}) everywhere", class_name(class)))
        }
        ColorMode::Return => {
            let mut kinds = (0..=255).filter(|&b| sample.returns[usize::from(b)] > 0).map(ReturnKind::of);
            let first = kinds.next()?;
            kinds.all(|k| k == first).then(|| format!("return is {} everywhere", first.name()))
        }
    }
}

/// How a value is spread over a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Lowest value, strays left out (more than ten spans of percentiles 1-99 away).
    pub min: f64,
    /// Highest value, strays left out.
    pub max: f64,
    /// Percentile 2.
    pub p2: f64,
    /// Percentile 98.
    pub p98: f64,
}

impl Spread {
    /// Of `values` in any order; zeros when there are none.
    fn of(mut values: Vec<f64>) -> Spread {
        values.sort_unstable_by(f64::total_cmp);
        let Some(last) = values.len().checked_sub(1) else { return Spread::default() };
        let percentile = |p: f64| values[(p / 100.0 * last as f64).round() as usize];
        let (p1, p99) = (percentile(1.0), percentile(99.0));
        // With p1 = p99 nothing tells a stray from a roof: all values count.
        let reach = if p99 > p1 { 10.0 * (p99 - p1) } else { f64::INFINITY };
        let near: Vec<f64> =
            values.iter().copied().filter(|&v| v >= p1 - reach && v <= p99 + reach).collect();
        Spread { min: near[0], max: near[near.len() - 1], p2: percentile(2.0), p98: percentile(98.0) }
    }

    /// Percentiles 2 to 98, or lowest to highest where those are equal.
    fn middle(&self) -> (f64, f64) {
        if self.p2 < self.p98 { (self.p2, self.p98) } else { (self.min, self.max) }
    }
}

/// Collects the opening sample; feed it the points that are shown.
#[derive(Debug, Default)]
pub struct AttributeSample {
    points: Vec<Attributes>,
}

impl AttributeSample {
    /// Adds one point.
    pub fn push(&mut self, point: Attributes) {
        self.points.push(point);
    }

    /// What the colours are chosen by; the same for any order of points. `grid`: whose lattice heights are on.
    pub fn summary(&self, grid: &Grid) -> AttributeSummary {
        let p = &self.points;
        let (mut classes, mut returns) = (Box::new([0; 256]), Box::new([0; 256]));
        for a in p {
            classes[usize::from(a.class)] += 1;
            returns[usize::from(a.returns)] += 1;
        }
        let first = p.first().map_or([0; 3], |a| a.rgb);
        AttributeSummary {
            points: p.len() as u64,
            height: Spread::of(p.iter().map(|a| grid.units(a.height)).collect()),
            intensity: Spread::of(p.iter().map(|a| f64::from(a.intensity)).collect()),
            classes,
            returns,
            has_rgb: true,
            colored: p.iter().filter(|a| a.rgb != [0; 3]).count() as u64,
            rgb_constant: p.iter().all(|a| a.rgb == first).then_some(first),
        }
    }
}

/// The opening sample in short.
#[derive(Clone, Debug, PartialEq)]
pub struct AttributeSummary {
    /// Points sampled.
    pub points: u64,
    /// CRS units.
    pub height: Spread,
    /// As stored.
    pub intensity: Spread,
    /// Points of each class.
    pub classes: Box<[u64; 256]>,
    /// Points of each `returns` byte.
    pub returns: Box<[u64; 256]>,
    /// Whether there is a field for RGB at all.
    pub has_rgb: bool,
    /// Points whose RGB is not black.
    pub colored: u64,
    /// The one RGB of all points, if there is one.
    pub rgb_constant: Option<[u8; 3]>,
}

/// sRGB-encoded channel in 0 to 1 → linear light (IEC 61966-2-1).
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Linear light in 0 to 1 → sRGB-encoded channel (IEC 61966-2-1).
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Oklab of an sRGB colour, in which equal distances look alike. Source: B. Ottosson, 2020.
fn srgb_to_oklab(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(|v| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) });
    let l = (0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b).cbrt();
    let m = (0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b).cbrt();
    let s = (0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b).cbrt();
    [
        0.2104542553 * l + 0.7936177850 * m - 0.0040720468 * s,
        1.9779984951 * l - 2.4285922050 * m + 0.4505937099 * s,
        0.0259040371 * l + 0.7827717662 * m - 0.8086757660 * s,
    ]
}

/// Inverse of [`srgb_to_oklab`]; outside 0 to 1 where sRGB has no such colour.
fn oklab_to_srgb([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let l = (lightness + 0.3963377774 * a + 0.2158037573 * b).powi(3);
    let m = (lightness - 0.1055613458 * a - 0.0638541728 * b).powi(3);
    let s = (lightness - 0.0894841775 * a - 1.2914855480 * b).powi(3);
    [
        4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
        -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
        -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s,
    ]
    .map(|v| if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 })
}

/// Oklab colour at the share `t` of the way along straight lines between `stops`.
fn even_path(stops: &[[u8; 3]], t: f64) -> [f64; 3] {
    let labs: Vec<_> = stops.iter().map(|c| srgb_to_oklab(c.map(|v| f64::from(v) / 255.0))).collect();
    let lengths: Vec<f64> = labs.windows(2).map(|w| oklab_distance(w[0], w[1])).collect();
    let mut left = t * lengths.iter().sum::<f64>();
    for (k, &length) in lengths.iter().enumerate() {
        if left <= length || k + 1 == lengths.len() {
            let f = (left / length).min(1.0);
            return [0, 1, 2].map(|c| labs[k][c] + (labs[k + 1][c] - labs[k][c]) * f);
        }
        left -= length;
    }
    unreachable!("a ramp has at least two stops")
}

fn oklab_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coords::HEIGHT_STEP;
    use proptest::prelude::*;

    const GRID: Grid = Grid { base_cell: 1.0, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };

    fn point(h: i32, class: u8, intensity: u16, rgb: [u8; 3]) -> Attributes {
        Attributes { height: Height(h), class, intensity, rgb, returns: 0x11, flags: 0 }
    }

    fn summary(points: impl IntoIterator<Item = Attributes>) -> AttributeSummary {
        AttributeSample { points: points.into_iter().collect() }.summary(&GRID)
    }

    fn attributes() -> impl Strategy<Value = Attributes> {
        // Few values a field, so that ties reach the last one.
        let byte = || prop_oneof![Just(0u8), Just(1), Just(127), Just(128), Just(255)];
        let height =
            prop_oneof![Just(i32::MIN + 1), Just(-1), Just(0), Just(1), Just(i32::MAX), any::<i32>()];
        let intensity = prop_oneof![Just(0u16), Just(255), Just(256), Just(u16::MAX)];
        (height, byte(), intensity, [byte(), byte(), byte()], byte(), byte()).prop_map(
            |(h, class, intensity, rgb, returns, flags)| Attributes {
                height: Height(h.max(i32::MIN + 1)),
                class,
                intensity,
                rgb,
                returns,
                flags,
            },
        )
    }

    proptest! {
        #[test]
        fn order_of_words_is_order_of_attributes(a in attributes(), b in attributes()) {
            prop_assert_eq!(Record::pack(a).cmp(&Record::pack(b)), a.cmp(&b));
            prop_assert_eq!(Record::pack(a).unpack(), Some(a));
            prop_assert_eq!(Record::pack(a).height(), Some(a.height));
            prop_assert_eq!(Record::pack(a).class(), a.class);
            prop_assert!(Record::pack(a) > Record::EMPTY);
        }
    }

    #[test]
    fn words_are_laid_out_as_documented() {
        let a = Attributes {
            height: Height(5),
            class: 6,
            intensity: 0x1234,
            rgb: [0xaa, 0xbb, 0xcc],
            returns: 0x21,
            flags: 4,
        };
        assert_eq!(Record::pack(a).0, [0x8000_0005, 0x0612_34aa, 0xbbcc_2104]);
        assert_eq!(Record::EMPTY.unpack(), None);
    }

    #[test]
    fn masks_show_and_hide_each_class() {
        let default = ClassMask::default();
        let hidden: Vec<u8> = (0..=255).filter(|&c| !default.shows(c)).collect();
        assert_eq!(hidden, [7, 18]);
        let only = ClassMask::only(&[2, 64, 255]);
        assert_eq!((0..=255).filter(|&c| only.shows(c)).collect::<Vec<u8>>(), [2, 64, 255]);
        assert_eq!(only.without(&[64]).0, [4, 0, 0, 0, 0, 0, 0, 0x8000_0000]);
    }

    #[test]
    fn class_colors_are_distinct() {
        let lab = |c: u8| srgb_to_oklab(class_color(c).map(|v| f64::from(v) / 255.0));
        for a in 0..=255u8 {
            for b in 0..a {
                let least = if a < 23 { 0.03 } else { 1e-3 };
                assert!(oklab_distance(lab(a), lab(b)) > least, "{a} looks like {b}");
            }
        }
        let greenest = |c: u8| class_color(c)[1] == *class_color(c).iter().max().unwrap();
        assert!(greenest(3) && greenest(4) && greenest(5));
    }

    #[test]
    fn relief_rises_in_even_steps() {
        let path: Vec<_> = (0..=255).map(|i| srgb_to_oklab(Ramp::Relief.at(f64::from(i) / 255.0))).collect();
        let steps: Vec<f64> = path.windows(2).map(|w| oklab_distance(w[0], w[1])).collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        for (w, step) in path.windows(2).zip(&steps) {
            assert!(w[1][0] > w[0][0], "lightness falls: {w:?}");
            // A step over a corner between two stops is a little shorter.
            assert!((0.7..1.1).contains(&(step / mean)), "uneven: {step} of {mean}");
        }
        assert!(path[0][0] > 0.4, "relief would drown in the dark");
    }

    #[test]
    fn thesis_ramp_is_the_published_formula() {
        let data = summary([point(-2048, 2, 0, [0; 3]), point(10_000, 2, 0, [0; 3])]);
        let table = ColorTable::new(ColorMode::Height, &data, &GRID, Some(Ramp::Thesis), None).unwrap();
        for h in (-2048..=10_000).step_by(7).chain([3976, 9_999, 10_000, 20_000, -9_000]) {
            let ht = 2.0 * f64::from(h.clamp(-2048, 10_000) + 2048) / 12_048.0;
            let (r, g, b) = if ht >= 1.0 {
                (255.0, 255.0 - (ht - 1.0) * 255.0, 0.0)
            } else {
                (255.0 * ht, 255.0 * ht, 255.0 - ht * 255.0)
            };
            let got = table.color(Record::pack(point(h, 2, 0, [0; 3])));
            for (got, want) in got.into_iter().zip([r, g, b]) {
                assert!((f64::from(got) * 255.0 - want).abs() < 0.01, "height {h}: {got} for {want}");
            }
        }
    }

    #[test]
    fn tables_hit_palette_and_rgb_exactly() {
        let data = summary((0..200).map(|k| point(k, k as u8, k as u16, [k as u8, 7, 9])));
        let class = ColorTable::new(ColorMode::Class, &data, &GRID, None, None).unwrap();
        let own = ColorTable::new(ColorMode::Rgb, &data, &GRID, None, None).unwrap();
        for c in 0..=255u8 {
            let record = Record::pack(point(0, c, 0, [c, 100, 255 - c]));
            assert_eq!(class.color(record), class_color(c).map(|v| (f64::from(v) / 255.0) as f32));
            assert_eq!(own.color(record), [c, 100, 255 - c].map(|v| f32::from(v) / 255.0));
        }
    }

    #[test]
    fn range_is_percentiles_unless_given() {
        let data = summary((0..=100).map(|k| point(k * 1024, 2, k as u16, [0; 3])));
        let table = |range| ColorTable::new(ColorMode::Height, &data, &GRID, Some(Ramp::Grey), range);
        assert_eq!(table(None).unwrap().range, Some((2.0, 98.0)));
        let given = table(Some((10.0, 20.0))).unwrap();
        let grey = |u: i32| given.color(Record::pack(point(u * 1024, 2, 0, [0; 3])))[0];
        assert!((grey(15) - 0.55).abs() < 1e-4 && grey(9) == 0.12 && (grey(21) - 0.98).abs() < 1e-6);
        for bad in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert!(matches!(table(Some(bad)), Err(AttributeError::Range { .. })));
        }
    }

    #[test]
    fn a_stray_point_changes_no_range() {
        let clean: Vec<_> = (0..1000).map(|k| point(k * 10, 2, 5, [0; 3])).collect();
        let stray = point(180_000 * 1024, 2, 5, [0; 3]);
        let (a, b) = (summary(clean.clone()), summary(clean.into_iter().chain([stray])));
        assert_eq!((a.height.min, a.height.max), (b.height.min, b.height.max));
        assert!((a.height.p98 - b.height.p98).abs() < 0.02);
    }

    #[test]
    fn constant_fields_are_named_and_drawn_as_what_they_are() {
        let grey = [0.65; 3].map(|v: f64| v as f32);
        let byte = |color: [u8; 3]| color.map(|v| f32::from(v) / 255.0);
        let rgb = [255, 128, 0];
        let data = summary((0..50).map(|_| point(1024, 6, 9, rgb)));
        let table = |mode, data| ColorTable::new(mode, data, &GRID, None, None).unwrap();
        for (mode, words, color) in [
            (ColorMode::Rgb, "colour is 255,128,0 everywhere, drawn in that colour", byte(rgb)),
            (ColorMode::Height, "height is 1 everywhere, drawn grey", grey),
            (
                ColorMode::Class,
                "class is 6 (building) everywhere, drawn in that colour",
                byte(class_color(6)),
            ),
            (ColorMode::Intensity, "intensity is 9 everywhere, drawn grey", grey),
            (
                ColorMode::Return,
                "return is single everywhere, drawn in that colour",
                byte(ReturnKind::Single.color()),
            ),
        ] {
            let table = table(mode, &data);
            assert_eq!(table.constant.as_deref(), Some(words));
            let drawn = table.color(Record::pack(point(1024, 6, 9, rgb)));
            assert!(drawn.iter().zip(color).all(|(a, b)| (a - b).abs() < 1e-6), "{drawn:?}, not {color:?}");
        }
        // Black is no colour; nor is what is not there.
        let black = summary((0..50).map(|_| point(1024, 6, 9, [0; 3])));
        let words = table(ColorMode::Rgb, &black).constant.unwrap();
        assert_eq!(words, "colour is 0,0,0 everywhere, drawn grey");
        let absent = AttributeSummary { has_rgb: false, ..black.clone() };
        let words = table(ColorMode::Rgb, &absent).constant.unwrap();
        assert_eq!(words, "there is no RGB in this data, drawn grey");
        // A class of which an estimate leaves next to nothing is there all the same.
        let mut two = data.clone();
        two.classes[2] = 1;
        assert_eq!(table(ColorMode::Class, &two).constant, None);
        let flat_but_one = summary((0..500).map(|k| point(if k == 0 { 4096 } else { 0 }, 2, 0, [0; 3])));
        let table = ColorTable::new(ColorMode::Height, &flat_but_one, &GRID, None, None).unwrap();
        assert_eq!(table.range, Some((0.0, 4.0)));
    }

    #[test]
    fn auto_mode_follows_what_the_data_has() {
        let mode = |rgb: fn(i32) -> [u8; 3], class: fn(i32) -> u8| {
            ColorMode::auto(&summary((0..100).map(|k| point(k, class(k), 0, rgb(k)))))
        };
        let black = |_| [0; 3];
        let ground = |_| 2;
        assert_eq!(mode(|k| if k < 5 { [9; 3] } else { [0; 3] }, ground), ColorMode::Rgb);
        assert_eq!(mode(|k| if k < 4 { [9; 3] } else { [0; 3] }, ground), ColorMode::Height);
        assert_eq!(mode(|_| [255; 3], ground), ColorMode::Height);
        assert_eq!(mode(black, |k| if k < 11 { 6 } else { 1 }), ColorMode::Class);
        assert_eq!(mode(black, |k| if k < 10 { 6 } else { 1 }), ColorMode::Height);
        assert_eq!(mode(black, |k| if k < 50 { 12 } else { 18 }), ColorMode::Height);
        assert_eq!(ColorMode::auto(&summary([])), ColorMode::Height);
    }

    #[test]
    fn returns_fall_into_four_kinds() {
        use ReturnKind::*;
        for (byte, kind) in [
            (0, Unknown),
            (0x01, Unknown),
            (0x11, Single),
            (0x21, First),
            (0x32, Intermediate),
            (0x33, Last),
            (0x25, Last),
        ] {
            assert_eq!(ReturnKind::of(byte), kind, "{byte:#x}");
        }
    }

    #[test]
    fn srgb_and_linear_are_inverse() {
        for k in 0..=255u8 {
            let v = f32::from(k) / 255.0;
            assert!((linear_to_srgb(srgb_to_linear(v)) - v).abs() < 1e-6);
            let lab = oklab_to_srgb(srgb_to_oklab([f64::from(v), 0.5, 1.0 - f64::from(v)]));
            assert!((lab[0] - f64::from(v)).abs() < 1e-5 && (lab[1] - 0.5).abs() < 1e-5);
        }
        assert!((srgb_to_linear(0.5) - 0.214_041).abs() < 1e-5);
    }
}
