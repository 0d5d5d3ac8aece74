//! Colour tables: the value of a field to a colour, as the shaders read it.

use super::channel::Channel;
use super::class::{class_color, class_name};
use super::mode::ColorMode;
use super::oklab::{even_path, oklab_to_srgb};
use super::ramp::Ramp;
use super::range::ColorRange;
use super::record::{Record, bias};
use super::returns::ReturnKind;
use super::summary::{AttributeSummary, Spread};
use crate::coords::{Grid, Height};
use crate::text::tidy;

/// What cannot be coloured as asked.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AttributeError {
    /// Percentiles of what the opening sample says nothing of.
    #[error(
        "colour range {asked}: no percentiles of {what} are known before all points are read; give values, such as {low}..{high}"
    )]
    Percentile {
        /// What was asked for.
        asked: ColorRange,
        /// Values of what.
        what: &'static str,
        /// Values that would do.
        low: f64,
        /// And the high one.
        high: f64,
    },
    /// Ends of a range in the wrong order, equal, or not finite, as they are in the data.
    #[error(
        "colour range {asked}: it is from {lo} to {hi} here, and both must be finite and the first lower than the second"
    )]
    Range {
        /// What was asked for.
        asked: ColorRange,
        /// Lower end in the data.
        lo: f64,
        /// Higher end in the data.
        hi: f64,
    },
}

/// Grey of what has no colour.
const UNKNOWN: f64 = 0.65;

/// A colour mode as the shaders read it: value of the field → index → table. RGB needs no table.
///
/// ```text
/// v     = word 0 | class | channel | returns            (u32, by mode)
/// grey  where v = 0                                     (densities and differences of lines)
/// v     = (v + 37 · ⌊v / 256⌋) mod 256                  (source ids alone)
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
    /// What values of records mean, where the mode colours by those of their channel.
    pub channel: Option<Channel>,
    /// Lowest and highest value of the ramp, for a legend: CRS units for heights; `None` without ramp.
    pub range: Option<(f64, f64)>,
    /// The field has one value everywhere, said in words, and how that is drawn: in the colour that it stands for
    /// anyway, or grey where there is none (heights, intensities, RGB that is black).
    pub constant: Option<String>,
}

impl ColorTable {
    /// The table of `mode` for the data that `sample` stands for. `ramp`: default relief for heights,
    /// grey for intensity. `range`: default percentiles 2 to 98, for the thesis
    /// ramp lowest to highest. `grid`: whose lattice heights are on.
    pub fn new(
        mode: ColorMode,
        sample: &AttributeSummary,
        grid: &Grid,
        ramp: Option<Ramp>,
        range: Option<ColorRange>,
    ) -> Result<ColorTable, AttributeError> {
        let channel = mode.channel(sample);
        let range = known_range(mode, sample, range)?;
        let direct = |color: fn(u8) -> [u8; 3]| ColorTable {
            mode,
            channel,
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
                channel,
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
            ColorMode::SourceId => Some(direct(source_color)),
            ColorMode::Height
            | ColorMode::Intensity
            | ColorMode::ScanAngle
            | ColorMode::GpsTime
            | ColorMode::HeightAboveGround
            | ColorMode::Density
            | ColorMode::LineDifference => None,
        };
        if let Some(words) = constant(mode, sample).filter(|_| range.is_none() || own.is_some()) {
            if let Some(own) = own.filter(|_| sample.points > 0) {
                return Ok(ColorTable { constant: Some(format!("{words}, drawn in that colour")), ..own });
            }
            let words = format!("{words}, drawn grey");
            let grey = table(|_| [UNKNOWN; 3]);
            // A grey table is read through a field, RGB too: class 0 to 255 all lead to grey.
            let mode = if mode == ColorMode::Rgb { ColorMode::Class } else { mode };
            return Ok(ColorTable {
                mode,
                channel,
                lo: 0,
                scale: 0.0,
                table: grey,
                range: None,
                constant: Some(words),
            });
        }
        Ok(match mode {
            ColorMode::Rgb | ColorMode::Class | ColorMode::Return | ColorMode::SourceId => {
                own.unwrap_or_else(|| direct(|_| [0; 3]))
            }
            ColorMode::Height => {
                let biased = |u: f64| biased_steps(u / grid.height_step);
                ramped(&sample.height, Ramp::Relief, &biased, grid.height_step.recip())
            }
            ColorMode::Intensity => {
                ramped(&sample.intensity, Ramp::Grey, &|v| v.clamp(0.0, 65535.0) as u32, 1.0)
            }
            ColorMode::ScanAngle => {
                // As far to both sides, so that the middle is the nadir.
                let Spread { min, max, .. } = sample.scan_angle;
                let most = min.abs().max(max.abs());
                let (lo, hi) = range.unwrap_or((-most, most));
                let codes = [lo, hi].map(|value| f64::from(Channel::ScanAngle.code(value)));
                let steps = (codes[1] - codes[0]).max(1.0);
                ColorTable {
                    mode,
                    channel,
                    lo: codes[0] as u32,
                    scale: (255.0 / steps) as f32,
                    table: table(|i| {
                        let t = f64::from(i) / 255.0;
                        ramp.map_or_else(|| diverging(t), |ramp| ramp.at(t))
                    }),
                    range: Some((lo, hi)),
                    constant: None,
                }
            }
            ColorMode::GpsTime => {
                let times = sample.times.unwrap_or_default();
                let (lo, hi) = range.unwrap_or((times.from, times.to));
                let codes = [lo, hi].map(|value| f64::from(Channel::GpsTime(times).code(value)));
                let ramp = ramp.unwrap_or(Ramp::Turbo);
                // The first entry is that of no time, and of what is before the range.
                let scale = 254.0 / (codes[1] - codes[0]).max(1.0);
                ColorTable {
                    mode,
                    channel,
                    lo: (codes[0] - scale.recip()).max(0.0).round() as u32,
                    scale: scale as f32,
                    table: table(|i| match i.checked_sub(1) {
                        None => [UNKNOWN; 3],
                        Some(i) => ramp.at(f64::from(i) / 254.0),
                    }),
                    range: Some((lo, hi)),
                    constant: None,
                }
            }
            ColorMode::HeightAboveGround | ColorMode::Density | ColorMode::LineDifference => {
                measured(mode, sample, ramp, range)
            }
        })
    }

    /// Whether codes of 0 are values that are missing, which are grey.
    pub fn knows_none(&self) -> bool {
        matches!(self.mode, ColorMode::Density | ColorMode::LineDifference)
    }

    /// sRGB of what the channel of a record holds, where the mode colours by that.
    pub fn of_channel(&self, code: u16) -> [u8; 3] {
        let record = Record([0, u32::from(code) << 8, 0]);
        self.color(record).map(|v| (v * 255.0).round() as u8)
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
            ColorMode::Density | ColorMode::LineDifference if w1 >> 8 & 0xffff == 0 => {
                return [UNKNOWN as f32; 3];
            }
            ColorMode::Intensity
            | ColorMode::ScanAngle
            | ColorMode::GpsTime
            | ColorMode::HeightAboveGround
            | ColorMode::Density
            | ColorMode::LineDifference => w1 >> 8 & 0xffff,
            ColorMode::SourceId => source_entry(w1 >> 8 & 0xffff),
            ColorMode::Return => w2 >> 8 & 255,
        };
        let t = (value.saturating_sub(self.lo) as f32 * self.scale).min(255.0);
        let (a, b) = (self.table[t as usize], self.table[(t as usize + 1).min(255)]);
        [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t.fract())
    }
}

/// The range that is asked for in the data that `sample` stands for. Errors: there is none.
fn known_range(
    mode: ColorMode,
    sample: &AttributeSummary,
    asked: Option<ColorRange>,
) -> Result<Option<(f64, f64)>, AttributeError> {
    let (Some(asked), spread) = (asked, mode.spread(sample)) else { return Ok(None) };
    let is_constant = spread.is_none_or(|spread| spread.min >= spread.max);
    match (spread, mode.channel(sample)) {
        (None, Some(channel)) if asked.has_percentiles() && mode != ColorMode::SourceId => {
            let (low, high) = usual_range(mode, sample);
            Err(AttributeError::Percentile { asked, what: channel.name(), low, high })
        }
        // Of what is the same everywhere all percentiles are, and palettes have no ranges.
        (Some(_), _) if is_constant && asked.is_relative() => Ok(None),
        (None, _) if asked.has_percentiles() => Ok(None),
        _ => in_data(asked, spread.unwrap_or(&Spread::default())).map(Some),
    }
}

/// The table of what is measured of columns.
fn measured(
    mode: ColorMode,
    sample: &AttributeSummary,
    ramp: Option<Ramp>,
    range: Option<(f64, f64)>,
) -> ColorTable {
    let (lo, hi) = range.unwrap_or_else(|| usual_range(mode, sample));
    let channel = mode.channel(sample).unwrap_or_default();
    let [low, high] = [lo, hi].map(|value| f64::from(channel.code(value)));
    let color = |t| ramp.map_or_else(|| measure_color(mode, t), |ramp| ramp.at(t));
    ColorTable {
        mode,
        lo: low as u32,
        scale: (255.0 / (high - low).max(1.0)) as f32,
        table: table(|i| color(f64::from(i) / 255.0)),
        channel: Some(channel),
        range: Some((lo, hi)),
        constant: None,
    }
}

/// Values at the ends of the ramp of what is measured of columns, where none are asked for.
fn usual_range(mode: ColorMode, sample: &AttributeSummary) -> (f64, f64) {
    match mode {
        ColorMode::Density => {
            let density = if sample.density > 0.0 { sample.density } else { 1.0 };
            // In round numbers: the middle is what there is, roughly.
            let step = (density / 4.0).log10().floor().max(-6.0);
            let step = 10.0_f64.powi(step as i32);
            (0.0, (2.0 * density / step).ceil() * step)
        }
        ColorMode::LineDifference => (0.0, USUAL_DIFFERENCE * sample.metre),
        _ => {
            let highest = [sample.above.percentile(98.0), sample.above.max, sample.metre];
            (0.0, highest.into_iter().find(|height| *height > 0.0).unwrap_or(1.0))
        }
    }
}

/// What flight lines of a good survey differ by at most, metres: the dark end of the ramp.
const USUAL_DIFFERENCE: f64 = 0.3;

/// Ramps of what is measured of columns. Densities: red where points are few, blue where they are many; differences: pale, then
/// red; heights above the ground: pale land, green, blue.
fn measure_color(mode: ColorMode, t: f64) -> [f64; 3] {
    const ABOVE: [[u8; 3]; 5] =
        [[236, 230, 214], [178, 206, 132], [84, 160, 98], [34, 116, 132], [46, 64, 132]];
    const APART: [[u8; 3]; 4] = [[226, 234, 222], [246, 208, 120], [224, 116, 62], [142, 28, 44]];
    match mode {
        ColorMode::Density => diverging(1.0 - t),
        ColorMode::LineDifference => oklab_to_srgb(even_path(&APART, t)).map(|v| v.clamp(0.0, 1.0)),
        _ => oklab_to_srgb(even_path(&ABOVE, t)).map(|v| v.clamp(0.0, 1.0)),
    }
}

/// Entry of the palette of point source ids that an id has: ids that follow each other have different ones.
fn source_entry(id: u32) -> u32 {
    (id + 37 * (id >> 8)) & 255
}

/// sRGB of a point source id's entry: hues turn by the golden angle, so that neighbours differ.
fn source_color(entry: u8) -> [u8; 3] {
    let k = f64::from(entry);
    let hue = (40.0 + k * 137.507_764_05).to_radians();
    // Those that come close in hue differ in lightness.
    let (lightness, chroma) = (0.62 + 0.07 * (k % 3.0), 0.13);
    let lab = [lightness, chroma * hue.cos(), chroma * hue.sin()];
    oklab_to_srgb(lab).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// Blue, pale in the middle, red; as light to both sides.
fn diverging(t: f64) -> [f64; 3] {
    const STOPS: [[u8; 3]; 5] =
        [[44, 96, 160], [130, 172, 214], [242, 240, 236], [226, 150, 120], [172, 56, 48]];
    oklab_to_srgb(even_path(&STOPS, t)).map(|v| v.clamp(0.0, 1.0))
}

/// The values that `asked` stands for in data that are spread like that. Errors: not from a lower to a higher one.
fn in_data(asked: ColorRange, spread: &Spread) -> Result<(f64, f64), AttributeError> {
    let [lo, hi] = [asked.low, asked.high].map(|end| end.value(spread));
    match lo < hi && lo.is_finite() && hi.is_finite() {
        true => Ok((lo, hi)),
        // Most of the points have one value: what is beside it is told apart.
        false if lo == hi && asked.is_relative() => Ok((spread.min, spread.max)),
        false => Err(AttributeError::Range { asked, lo, hi }),
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
        ColorMode::ScanAngle => spread("scan angle", &sample.scan_angle),
        ColorMode::HeightAboveGround | ColorMode::Density | ColorMode::LineDifference => None,
        ColorMode::GpsTime => match sample.times {
            None => Some("there is no GPS time in this data".to_owned()),
            Some(times) => (times.from >= times.to).then(|| format!("GPS time is {} everywhere", times.from)),
        },
        ColorMode::SourceId => match &sample.source_ids[..] {
            [(id, _)] => Some(format!("source id is {id} everywhere")),
            _ => None,
        },
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

#[cfg(test)]
mod tests {
    use super::super::summary::tests::{GRID, point, summary};
    use super::*;

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
        assert_eq!(table(Some("10%..90%".parse().unwrap())).unwrap().range, Some((10.0, 90.0)));
        assert_eq!(table(Some("-5..100%".parse().unwrap())).unwrap().range, Some((-5.0, 100.0)));
        let given = table(Some(ColorRange::of(10.0, 20.0))).unwrap();
        let grey = |u: i32| given.color(Record::pack(point(u * 1024, 2, 0, [0; 3])))[0];
        assert!((grey(15) - 0.55).abs() < 1e-4 && grey(9) == 0.12 && (grey(21) - 0.98).abs() < 1e-6);
        for bad in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert!(matches!(table(Some(ColorRange::of(bad.0, bad.1))), Err(AttributeError::Range { .. })));
        }
        let above_all = table(Some("200..98%".parse().unwrap())).unwrap_err().to_string();
        assert!(above_all.starts_with("colour range 200..98%: it is from 200 to 98 here"), "{above_all}");
        // Of data that are the same nearly everywhere, and everywhere.
        let relative = || Some("2%..98%".parse().unwrap());
        let nearly = summary((0..500).map(|k| point(if k == 0 { 4096 } else { 0 }, 2, 0, [0; 3])));
        let table = |data| ColorTable::new(ColorMode::Height, data, &GRID, None, relative()).unwrap();
        assert_eq!(table(&nearly).range, Some((0.0, 4.0)));
        let flat = table(&summary((0..50).map(|_| point(1024, 2, 0, [0; 3]))));
        assert_eq!((flat.range, flat.constant.is_some()), (None, true));
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
}
