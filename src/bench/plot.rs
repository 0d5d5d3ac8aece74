//! A report as a drawing: stacked bars, like Figure 4.6 of the thesis, as SVG.

use super::report::{Pipeline, Report, number};
use crate::output::SOFTWARE;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::error::Error;
use std::io;

/// Width of a drawing, pixels.
const WIDTH: i32 = 1000;
/// Left of the bars, pixels; there stand the numbers of the axis.
const LEFT: i32 = 64;
/// Right of the bars, pixels.
const RIGHT: i32 = 20;
/// Above the first panel, pixels: title and legend.
const HEAD: i32 = 84;
/// Below the bars of a panel, pixels: its labels.
const FOOT: i32 = 58;
/// Above the bars of a panel, pixels: its title and the highest bar's figure.
const CAP: i32 = 50;
/// Height of the bars of both pipelines and of the pool's alone, pixels.
const BARS: [i32; 2] = [300, 170];

const INK: RGBColor = RGBColor(34, 40, 49);
const FAINT: RGBColor = RGBColor(112, 120, 131);
const RULE: RGBColor = RGBColor(226, 230, 235);
/// Stages from the bottom up, as in [`super::report::Row::means`]; colours that the colour-blind tell apart.
const STAGES: [(&str, RGBColor); 3] =
    [("prepare", RGBColor(230, 159, 0)), ("copy", RGBColor(204, 88, 62)), ("trace", RGBColor(0, 114, 178))];

/// Prepare, copy and trace of a bar, ms; `None`: not run.
type Bar = Option<[f64; 3]>;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn = Result<(), Box<dyn Error + Send + Sync>>;

/// `report` as SVG: for each configuration the means over the paths, both pipelines beside each other, and, if
/// both are there, the pool again at a scale of its own.
///
/// Errors: no frame was measured.
pub fn svg(report: &Report) -> io::Result<String> {
    let configurations = report.configurations();
    let bars = |pipeline| -> Vec<Bar> {
        let means = |&c| report.mean_of_paths(pipeline, c);
        let bar = |means: [Option<f64>; 5]| means[2].map(|_| [0, 1, 2].map(|k| means[k].unwrap_or(0.0)));
        configurations.iter().map(means).map(bar).collect()
    };
    let all = Pipeline::ALL.map(|pipeline| (pipeline, bars(pipeline)));
    let there: Vec<_> = all.into_iter().filter(|(_, bars)| bars.iter().any(Option::is_some)).collect();
    if there.is_empty() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "nothing to plot: no frame was measured"));
    }
    let panels = if there.len() > 1 { 2 } else { 1 };
    let height = HEAD + BARS[..panels].iter().map(|bars| CAP + bars + FOOT).sum::<i32>();
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH as u32, height as u32)).into_drawing_area();
        let draw = || -> Drawn {
            head(&area, report)?;
            panel(&area, HEAD, BARS[0], &configurations, &there)?;
            if panels > 1 {
                panel(&area, HEAD + CAP + BARS[0] + FOOT, BARS[1], &configurations, &there[1..])?;
            }
            Ok(area.present()?)
        };
        draw().map_err(io::Error::other)?;
    }
    // Behind the first tag: a comment before it would not be SVG to everyone.
    let first = text.find('>').map_or(0, |at| at + 1);
    text.insert_str(first, &format!("\n<!-- {SOFTWARE} -->"));
    Ok(text)
}

fn write_at(area: &Area, text: &str, at: (i32, i32), size: i32, color: RGBColor, anchor: HPos) -> Drawn {
    // Plotters takes a size for that of a line.
    let style = ("Helvetica, Arial, sans-serif", f64::from(size) * 1.24)
        .into_font()
        .color(&color)
        .pos(Pos::new(anchor, VPos::Bottom));
    Ok(area.draw(&Text::new(text.to_owned(), at, style))?)
}

fn head(area: &Area, report: &Report) -> Drawn {
    area.fill(&WHITE)?;
    write_at(area, "Time a frame, ms, mean of the camera paths", (LEFT, 36), 20, INK, HPos::Left)?;
    let device = format!("{}, {}, commit {}", report.device, report.driver, report.commit);
    write_at(area, &device, (LEFT, 58), 12, FAINT, HPos::Left)?;
    let mut x = WIDTH - RIGHT;
    for (name, color) in STAGES.into_iter().rev() {
        x -= 8 * name.len() as i32;
        write_at(area, name, (x, 35), 14, INK, HPos::Left)?;
        area.draw(&Rectangle::new([(x - 19, 21), (x - 6, 34)], color.filled()))?;
        x -= 38;
    }
    Ok(())
}

/// Bars of `BARS` pixels with everything around them, from `top` down.
fn panel(
    area: &Area,
    top: i32,
    bars: i32,
    configurations: &[[u32; 2]],
    pipelines: &[(Pipeline, Vec<Bar>)],
) -> Drawn {
    let title = match pipelines {
        [(only, _)] => only.name().to_owned(),
        _ => "thesis and pool, to one scale".to_owned(),
    };
    write_at(area, &title, (LEFT, top + 16), 14, INK, HPos::Left)?;
    let bottom = top + CAP + bars;
    let sums = pipelines.iter().flat_map(|(_, bars)| bars.iter().flatten()).map(|bar| bar.iter().sum());
    let highest: f64 = sums.fold(f64::MIN_POSITIVE, f64::max);
    let y = |ms: f64| bottom - (ms / highest * f64::from(bars)).round() as i32;
    let step = tick(highest, bars / 40);
    for k in 0..=(highest / step) as u32 {
        let ms = f64::from(k) * step;
        let line = [(LEFT, y(ms)), (WIDTH - RIGHT, y(ms))];
        area.draw(&PathElement::new(line, if k == 0 { FAINT } else { RULE }))?;
        write_at(area, &tick_text(ms, step), (LEFT - 8, y(ms) + 5), 12, FAINT, HPos::Right)?;
    }

    let groups = configurations.len() as i32;
    let pitch = (WIDTH - LEFT - RIGHT) / groups;
    let count = pipelines.len() as i32;
    let width = ((pitch - 20) / count - 4).clamp(6, 64);
    for (g, [grid, levels]) in (0..).zip(configurations) {
        let middle = LEFT + g * pitch + pitch / 2;
        for (k, (pipeline, bars)) in (0..).zip(pipelines) {
            let left = middle - (count * (width + 4) - 4) / 2 + k * (width + 4);
            let center = left + width / 2;
            if count > 1 {
                write_at(area, pipeline.name(), (center, bottom + 18), 12, FAINT, HPos::Center)?;
            }
            let Some(stages) = bars[g as usize] else {
                write_at(area, "not run", (center, bottom - 4), 12, FAINT, HPos::Center)?;
                continue;
            };
            let mut sum = 0.0;
            for (ms, (_, color)) in stages.into_iter().zip(STAGES) {
                let (low, high) = (y(sum), y(sum + ms));
                sum += ms;
                if low > high {
                    area.draw(&Rectangle::new([(left, high), (left + width, low)], color.filled()))?;
                }
            }
            write_at(area, &number(sum), (center, y(sum) - 4), 13, INK, HPos::Center)?;
        }
        let label = format!("{grid}x{grid}/{levels}");
        let below = if count > 1 { 37 } else { 20 };
        write_at(area, &label, (middle, bottom + below), 14, INK, HPos::Center)?;
    }
    Ok(())
}

/// A round step between the numbers of an axis that reaches to `highest`, for at most `most` steps.
fn tick(highest: f64, most: i32) -> f64 {
    let rough = highest / f64::from(most.max(1));
    let ten = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|f| f * ten).find(|step| *step >= rough).unwrap_or(10.0 * ten)
}

/// As many decimals as `step` has.
fn tick_text(ms: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    format!("{ms:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::report::tests::example;

    #[test]
    fn bars_are_drawn_for_what_was_measured() {
        let mut report = example();
        report.rows.retain(|row| [row.grid, row.levels] != [32, 9] || row.pipeline == Pipeline::Pool);
        let text = svg(&report).unwrap();
        assert!(text.starts_with("<svg ") && text.trim_end().ends_with("</svg>"));
        for word in ["16x16/8", "64x64/8", "prepare", "193.1", "to one scale", "not run", "llvmpipe"] {
            assert!(text.contains(word), "{word}");
        }
        // Six of the thesis, the pool's seven twice, and the legend; shares below half a pixel are left out.
        let bars =
            STAGES.map(|(_, RGBColor(r, g, b))| text.matches(&format!("#{r:02X}{g:02X}{b:02X}")).count());
        assert!(bars[2] == 21 && bars[..2].iter().all(|&n| n >= 7), "{bars:?}");
        report.rows.retain(|row| row.pipeline == Pipeline::Thesis);
        assert!(!svg(&report).unwrap().contains("scale"));
        report.rows.clear();
        assert_eq!(svg(&report).unwrap_err().to_string(), "nothing to plot: no frame was measured");
    }

    #[test]
    fn says_who_drew_it() {
        let text = svg(&example()).unwrap();
        assert!(crate::output::is_ours(text.as_bytes()), "{text:.200}");
        if let Some(wanted) = std::env::var_os("LASRAY_TEST_PLOT") {
            std::fs::write(wanted, text).unwrap();
        }
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!((tick(193.0, 7), tick(19.0, 4), tick(0.013, 4)), (50.0, 5.0, 0.005));
        assert_eq!(tick_text(0.005, 0.005), "0.005");
        assert_eq!(tick_text(150.0, 50.0), "150");
    }
}
