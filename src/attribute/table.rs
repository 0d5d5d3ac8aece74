//! Colour tables: the value of a field to a colour, as the shaders read it.

use super::channel::Channel;
use super::class::{class_color, class_name};
use super::mode::ColorMode;
use super::oklab::{even_path, oklab_to_srgb};
use super::palette::{self, SourcePalette};
use super::ramp::Ramp;
use super::range::ColorRange;
use super::record::Record;
use super::returns::ReturnKind;
use super::summary::{AttributeSummary, Spread};
use crate::coords::Grid;
use crate::shared::payload::HEIGHT_SIGN;
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
/// grey  where v = 0                                     (where 0 says that there is no value)
/// color = table[(v + lo · ⌊v / 256⌋) mod 256]           (source ids alone)
/// t     = clamp(float(v > lo ? v - lo : 0) · scale + offset, 0, 255)
/// color = mix(table[floor(t)], table[min(floor(t) + 1, 255)], fract(t))        sRGB; linearise after
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ColorTable {
    /// Which field, and whether a table is used at all.
    pub mode: ColorMode,
    /// The value below which there is but one colour; heights biased as in [`Record`]; of source ids what their high byte counts.
    pub lo: u32,
    /// Entries per step of the value.
    pub scale: f32,
    /// Entry of `lo`, which the range may begin before or after.
    pub offset: f32,
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
            offset: 0.0,
            table: table(|i| color(i as u8).map(|v| f64::from(v) / 255.0)),
            range: None,
            constant: None,
        };
        // Between two values that lie at two places among all that there are.
        let between =
            |(lo, hi): (f64, f64), [low, high]: [f64; 2], last: f64, color: &dyn Fn(f64) -> [f64; 3]| {
                let start = low.floor().clamp(0.0, u32::MAX.into());
                // Finite, so that nothing of it is not a number.
                let scale = (last / (high - low)).min(1e9);
                ColorTable {
                    mode,
                    channel,
                    lo: start as u32,
                    scale: scale as f32,
                    offset: ((start - low) * scale).clamp(-1e9, 1e9) as f32,
                    table: table(|i| color((f64::from(i) / last).min(1.0))),
                    range: Some((lo, hi)),
                    constant: None,
                }
            };
        let ramped = |spread: &Spread, default: Ramp, place: &dyn Fn(f64) -> f64| {
            let ramp = ramp.unwrap_or(default);
            let (lo, hi) = range.unwrap_or(match ramp {
                Ramp::Thesis => (spread.min, spread.max),
                _ => spread.middle(),
            });
            // What is the same everywhere is no range.
            let hi = if hi > lo { hi } else { lo + 1.0 };
            between((lo, hi), [lo, hi].map(place), ramp.last_index(), &|t| ramp.at(t))
        };
        let of_channel = |(lo, hi): (f64, f64), color: &dyn Fn(f64) -> [f64; 3]| {
            let places = [lo, hi].map(|value| channel.unwrap_or_default().place(value));
            between((lo, hi), places, 255.0, color)
        };
        let own = match mode {
            ColorMode::Rgb if sample.rgb_constant == Some([0; 3]) => None,
            ColorMode::Rgb => Some(direct(|_| [0; 3])),
            ColorMode::Class => Some(direct(class_color)),
            ColorMode::Return => Some(direct(|byte| ReturnKind::of(byte).color())),
            ColorMode::SourceId => {
                let SourcePalette { step, colors } = SourcePalette::of(&sample.scales.lines);
                let table = table(|i| colors[usize::from(i)].map(|v| f64::from(v) / 255.0));
                Some(ColorTable { lo: step, table, ..direct(|_| [0; 3]) })
            }
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
                let color = match mode {
                    ColorMode::Rgb => "that colour",
                    ColorMode::SourceId => "one colour",
                    _ => "its colour",
                };
                return Ok(ColorTable { constant: Some(format!("{words}, drawn in {color}")), ..own });
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
                offset: 0.0,
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
                let place = |u: f64| u / grid.height_step + f64::from(HEIGHT_SIGN);
                ramped(&sample.height, Ramp::Relief, &place)
            }
            ColorMode::Intensity => ramped(&sample.intensity, Ramp::Grey, &|value| value),
            ColorMode::ScanAngle => {
                // As far to both sides, so that the middle is the nadir.
                let Spread { min, max, .. } = sample.scan_angle;
                let most = min.abs().max(max.abs());
                let most = if most > 0.0 { most } else { 1.0 };
                of_channel(range.unwrap_or((-most, most)), &|t| {
                    ramp.map_or_else(|| diverging(t), |ramp| ramp.at(t))
                })
            }
            ColorMode::GpsTime => {
                let ramp = ramp.unwrap_or(Ramp::Turbo);
                let times = sample.scales.times.unwrap_or_default();
                of_channel(range.unwrap_or((times.from, times.to)), &|t| ramp.at(t))
            }
            ColorMode::HeightAboveGround | ColorMode::Density | ColorMode::LineDifference => {
                let color = |t| ramp.map_or_else(|| measure_color(mode, t), |ramp| ramp.at(t));
                let range = range.unwrap_or_else(|| usual_range(mode, sample));
                ColorTable { constant: only_line(mode, sample), ..of_channel(range, &color) }
            }
        })
    }

    /// Whether codes of 0 are values that are missing, which are grey.
    pub fn knows_none(&self) -> bool {
        self.channel.is_some_and(|channel| channel.knows_none())
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
            ColorMode::SourceId => {
                let [r, g, b, _] = self.table[palette::entry(w1 >> 8 & 0xffff, self.lo) as usize];
                return [r, g, b];
            }
            ColorMode::Intensity
            | ColorMode::ScanAngle
            | ColorMode::GpsTime
            | ColorMode::HeightAboveGround
            | ColorMode::Density
            | ColorMode::LineDifference => w1 >> 8 & 0xffff,
            ColorMode::Return => w2 >> 8 & 255,
        };
        if self.knows_none() && value == 0 {
            return [UNKNOWN as f32; 3];
        }
        let t = (value.saturating_sub(self.lo) as f32 * self.scale + self.offset).clamp(0.0, 255.0);
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

/// Values at the ends of the ramp of what is measured of columns, where none are asked for.
fn usual_range(mode: ColorMode, sample: &AttributeSummary) -> (f64, f64) {
    match mode {
        ColorMode::Density => {
            let density = if sample.scales.density > 0.0 { sample.scales.density } else { 1.0 };
            // In round numbers: the middle is what there is, roughly.
            let step = (density / 4.0).log10().floor().max(-6.0);
            let step = 10.0_f64.powi(step as i32);
            (0.0, (2.0 * density / step).ceil() * step)
        }
        ColorMode::LineDifference => (0.0, USUAL_DIFFERENCE * sample.scales.metre),
        _ => {
            let highest = [sample.above.percentile(98.0), sample.above.max, sample.scales.metre];
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
    if !sample.is_of_shown {
        // What is shown may be anything.
        return None;
    }
    match mode {
        ColorMode::Rgb if !sample.has_rgb => Some("there is no RGB in this data".to_owned()),
        ColorMode::Rgb => sample.rgb_constant.map(|[r, g, b]| format!("colour is {r},{g},{b} everywhere")),
        ColorMode::Height => spread("height", &sample.height),
        ColorMode::Intensity => spread("intensity", &sample.intensity),
        ColorMode::ScanAngle => spread("scan angle", &sample.scan_angle),
        ColorMode::HeightAboveGround | ColorMode::Density | ColorMode::LineDifference => None,
        ColorMode::GpsTime => match sample.scales.times {
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

/// Says so, in words, where lines cannot differ.
fn only_line(mode: ColorMode, sample: &AttributeSummary) -> Option<String> {
    match &sample.scales.lines[..] {
        [id] if mode == ColorMode::LineDifference => {
            Some(format!("all points that were seen are of one flight line (source id {id}), drawn grey"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::channel::TimeScale;
    use super::super::record::Attributes;
    use super::super::summary::tests::{GRID, point, summary};
    use super::*;
    use crate::coords::Height;

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

    /// What the same values come to by plain arithmetic.
    fn shade_of(value: f64, (lo, hi): (f64, f64)) -> f32 {
        Ramp::Grey.at((value - lo) / (hi - lo))[0] as f32
    }

    #[test]
    fn ranges_beyond_what_codes_hold_are_what_legends_say() {
        let times = TimeScale { from: 245_379.0, to: 245_386.0 };
        let mut data = summary((0..=100).map(|k| point(k * 1024, 2, k as u16, [0; 3])));
        data.scales.times = Some(times);
        let (far, none) = (f64::from(f32::MAX), 0.0);
        for (mode, range, values) in [
            (ColorMode::Intensity, (-1000.0, 300.0), [none, 150.0, 300.0, 60_000.0]),
            (ColorMode::Intensity, (-far, 300.0), [none, 150.0, 300.0, 60_000.0]),
            (ColorMode::Intensity, (60_000.0, 1e6), [none, 60_000.0, 65_000.0, 65_535.0]),
            (ColorMode::Intensity, (1e6, 2e6), [none, 1.0, 2.0, 65_535.0]),
            (ColorMode::Intensity, (10.25, 10.75), [none, 10.0, 11.0, 12.0]),
            (ColorMode::GpsTime, (200_000.0, 400_000.0), [245_379.0, 245_380.0, 245_385.0, 245_386.0]),
            (ColorMode::GpsTime, (245_380.0, 1e9), [245_379.0, 245_380.0, 245_385.0, 245_386.0]),
            (ColorMode::GpsTime, (245_380.0, 245_380.001), [245_379.0, 245_380.0, 245_385.0, 245_386.0]),
            (ColorMode::HeightAboveGround, (-10.0, 10.0), [none, 5.0, 10.0, 20.0]),
            (ColorMode::LineDifference, (-1.0, 0.5), [none, 0.25, 0.5, 2.0]),
            (ColorMode::Density, (-3.0, 9.0), [0.5, 2.0, 9.0, 12.0]),
            (ColorMode::ScanAngle, (-1000.0, 100.0), [-90.0, none, 90.0, 100.0]),
            (ColorMode::Height, (-1e7, 100.0), [none, 50.0, 100.0, 200.0]),
            (ColorMode::Height, (50.0, 1e8), [none, 50.0, 100.0, 2e6]),
        ] {
            let table =
                ColorTable::new(mode, &data, &GRID, Some(Ramp::Grey), Some(ColorRange::of(range.0, range.1)));
            let table = table.unwrap();
            assert_eq!(table.range, Some(range));
            for value in values {
                let height = Height((value * 1024.0) as i32);
                let (record, told) = match table.channel {
                    None => (Record::pack(Attributes { height, ..point(0, 2, 0, [0; 3]) }), value),
                    Some(channel) => {
                        let code = channel.code(value);
                        (Record::pack(point(0, 2, code, [0; 3])), channel.value(code).unwrap())
                    }
                };
                let (got, want) = (table.color(record)[0], shade_of(told, range));
                assert!((got - want).abs() < 2e-3, "{mode:?} {range:?}: {value} is {got}, not {want}");
            }
        }
    }

    #[test]
    fn what_has_no_value_is_grey_and_nothing_else() {
        let mut data = summary((0..=100).map(|k| point(k * 1024, 2, k as u16, [0; 3])));
        data.scales.times = Some(TimeScale { from: 0.0, to: 65_532.0 });
        // As narrow as a code, and narrower.
        for width in [0.25, 1.0, 100.0, 60_000.0] {
            let range = Some(ColorRange::of(1000.0, 1000.0 + width));
            let table = ColorTable::new(ColorMode::GpsTime, &data, &GRID, Some(Ramp::Magma), range).unwrap();
            let byte = |t: f64| Ramp::Magma.at(t).map(|v| (v * 255.0).round() as u8);
            let channel = table.channel.unwrap();
            let of = |time: f64| table.of_channel(channel.code(time));
            assert_eq!([of(1000.0), of(-5.0), of(3.0)], [byte(0.0); 3], "{width}");
            assert_eq!([of(1000.0 + width.ceil()), of(1e9)], [byte(1.0); 2], "{width}");
            assert_eq!(of(f64::NAN), [166; 3]);
        }
        for mode in [ColorMode::HeightAboveGround, ColorMode::Density, ColorMode::LineDifference] {
            let table = ColorTable::new(mode, &data, &GRID, None, None).unwrap();
            assert_eq!(table.of_channel(0), [166; 3]);
            assert!(table.knows_none() && table.of_channel(1) != [166; 3]);
        }
    }

    #[test]
    fn what_the_sample_has_not_seen_is_said_to_be_nothing() {
        // One value, but of other points than are shown.
        let mut data = summary((0..50).map(|_| point(1024, 6, 100, [9; 3])));
        data.is_of_shown = false;
        for mode in [ColorMode::Rgb, ColorMode::Height, ColorMode::Class, ColorMode::Intensity] {
            let table = ColorTable::new(mode, &data, &GRID, None, None).unwrap();
            assert_eq!(table.constant, None, "{mode:?}");
            assert!(table.scale.is_finite() && table.offset.is_finite(), "{table:?}");
        }
        data.is_of_shown = true;
        data.scales.lines = vec![17];
        let words = |range| {
            ColorTable::new(ColorMode::LineDifference, &data, &GRID, None, range).unwrap().constant.unwrap()
        };
        let one = "all points that were seen are of one flight line (source id 17), drawn grey";
        assert_eq!([words(None), words(Some(ColorRange::of(0.0, 1.0)))], [one; 2]);
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
            (ColorMode::Class, "class is 6 (building) everywhere, drawn in its colour", byte(class_color(6))),
            (ColorMode::Intensity, "intensity is 9 everywhere, drawn grey", grey),
            (
                ColorMode::Return,
                "return is single everywhere, drawn in its colour",
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
