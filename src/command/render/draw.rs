//! Draws the images that the arguments ask for, and writes them with what stands beside them.

use super::args::Args;
use super::camera::{Asked, camera, cropped, framed};
use super::data::{Data, Filled};
use super::drawing::Drawing;
use super::film::{Film, draw_film};
use super::ground::absolute;
use super::report::{Drawn, Summary};
use crate::attribute::{ColorMode, ColorTable};
use crate::command::UsageError;
use crate::command::values::Ortho;
use crate::gpu::Gpu;
use crate::load::About;
use crate::output::Protected;
use crate::problems::Problems;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::{Background, Renderer, Shade, Traversal, View};
use crate::render::image::Format;
use crate::render::side_files::{SideFiles, WorldFile};
use crate::source::crs::Crs;
use anyhow::Context;
use std::path::Path;

/// Where images go, and what else they are made with.
pub(super) struct Work<'a> {
    pub(super) args: &'a Args,
    pub(super) output: &'a Path,
    pub(super) film: Option<&'a Film>,
    pub(super) protected: &'a Protected,
    /// What colours are chosen by, where it is not the data alone that is drawn.
    pub(super) legend: Option<&'a About>,
}

/// Notes on colours: that there is one, that an option changes nothing.
fn tell_of_colours(args: &Args, colors: &ColorTable, mode: ColorMode) {
    colors.constant.iter().for_each(|constant| eprintln!("note: {constant}"));
    let options = [("--ramp", args.ramp.is_some()), ("--range", args.range.is_some())];
    for (option, _) in options.iter().filter(|(_, is_given)| *is_given && !mode.has_ramp()) {
        eprintln!("note: {option} changes nothing: colours by {} have no ramp", mode.name());
    }
}

/// Draws the image that the arguments ask for, or all of its film; gives what those took that were drawn while data streams.
pub(super) fn draw(
    gpu: &Gpu,
    data: Data,
    work: &Work,
    problems: &mut Problems,
) -> anyhow::Result<Vec<Drawn>> {
    let Work { args, output, film, protected, legend } = *work;
    let (grid, about, content) = data.into_parts();
    let floor = about.floor(grid.cell());
    let (bounds, pivot, base) = (about.bounds, about.bounds.min.z, about.base);
    let framed = framed(args, &about, &grid);
    let units = match args.ortho {
        None => None,
        Some(Ortho(None)) => Some(grid.cell()),
        Some(Ortho(Some(length))) => {
            let units = length.in_units(about.unit.as_ref());
            Some(units.map_err(|e| UsageError(format!("--ortho {e}")))?)
        }
    };
    let typed = [("--eye", args.eye), ("--target", args.target)];
    let [eye, target] = typed.map(|(_, place)| place.map(|place| absolute(place, &base)));
    // What is wrong with cameras is found before the work, but where they stand on what is drawn.
    let cameras = match (film, eye, target) {
        (Some(film), ..) => Some((film.cameras(|v| base.place(v))?, args.size.unwrap_or([1280, 720]))),
        (None, Some(None), _) | (None, _, Some(None)) => None,
        (None, eye, target) => {
            let asked = Asked { units, eye: eye.flatten(), target: target.flatten() };
            let (camera, size) = camera(args, &framed, &asked)?;
            Some((vec![camera], size))
        }
    };
    let exact = args.is_exact(output);
    let keeps_copies = film.is_some() || cameras.is_none();
    let filled = Filled::new(gpu, args, content, grid, [exact, keeps_copies])?;

    let legend = legend.unwrap_or(&about);
    let mode = args.color.0.unwrap_or(legend.color);
    let colors = ColorTable::new(mode, &legend.summary, &grid, args.ramp, args.range)
        .map_err(|e| UsageError(e.to_string()))?;
    if !args.quiet {
        tell_of_colours(args, &colors, mode);
    }

    let exr = Format::of(output)? == Format::Exr;
    let anywhere = Camera::looking(bounds.center(), [0.0, 90.0], Projection::default())?;
    let anchor = grid.height(bounds.center().z).context("heights are beyond what can be drawn")?;
    let mut drawing = Drawing {
        args,
        // Solid columns are seen from below, too.
        seen_down_to: if args.shade == Shade::Lit { floor } else { bounds.solid_down_to() },
        detail: args.detail.unwrap_or(if exact { 0.0 } else { 1.0 }),
        beside: String::new(),
        about: &about,
        drawn: Vec::new(),
        renderer: Renderer::new(&filled.scene, grid, anchor)?,
        filled,
        view: View {
            camera: &anywhere,
            size: [1, 1],
            samples: if exr { 1 } else { args.samples.unwrap_or(if exact { 1 } else { 4 }) },
            z_scale: args.z_scale,
            pivot,
            bounds,
            slab: Some(about.slab(grid.cell())),
            colors: &colors,
            shade: args.shade,
            background: Background::Sky,
            traversal: if args.plain { Traversal::Plain } else { Traversal::Fast },
            window: None,
        },
        grid,
        protected,
        problems: &mut *problems,
    };
    let (cameras, size) = match cameras {
        Some(cameras) => cameras,
        None => {
            let mut placed = [None; 2];
            for ((option, place), placed) in typed.into_iter().zip(&mut placed) {
                *placed = place.map(|place| drawing.place(option, place, &base)).transpose()?;
            }
            let [eye, target] = placed;
            let (camera, size) = camera(args, &framed, &Asked { units, eye, target })?;
            (vec![camera], size)
        }
    };
    check_sides(size, output)?;
    if let Some(note) = cropped(args, &framed, &cameras[0], size) {
        drawing.problems.note(format!("{}: {note}", output.display()));
    }
    let parallel = matches!(cameras[0].projection(), Projection::Orthographic { .. });
    let usual = if parallel { Background::White } else { Background::Sky };
    drawing.view = View { size, background: args.background.unwrap_or(usual), ..drawing.view };
    let side = film.is_none().then(|| {
        let world = units.and_then(|_| {
            // In the world's own coordinates, degrees among them, not in those that are drawn.
            let [east, north] = base.horizontal_scale()?;
            Some(WorldFile::of(&cameras[0].basis(size).ok()?)?.scaled([1.0 / east, 1.0 / north]))
        });
        SideFiles::new(output, world.as_ref(), about.crs.as_ref().and_then(Crs::prj).as_deref())
    });
    drawing.beside = side.as_ref().map_or(String::new(), SideFiles::note);
    match film {
        Some(film) => {
            draw_film(film, &cameras, args.quiet, |camera, output| drawing.image(camera, output))?;
        }
        None => drawing.image(&cameras[0], output)?,
    }
    let Drawing { drawn, filled, .. } = drawing;
    side.iter().flat_map(|side| side.write(protected)).for_each(|line| problems.warn(line));
    let last = drawn.last().map(|drawn| &drawn.status);
    let resident = last.map_or(filled.sections, |status| status.resident);
    let read = last.map_or(filled.points, |status| status.progress.points_seen);
    if !args.quiet {
        let summary = Summary {
            output,
            images: film.map(|film| film.frames.len() as u64),
            size,
            points: [read, filled.points],
            selected: (!args.selection.selection().is_all()).then(|| filled.taking_part()),
            sections: resident as u64,
            grid: &grid,
            unit: about.unit.as_ref(),
            mode,
            colors: &colors,
        };
        eprintln!("{}", summary.line());
    }
    Ok(drawn)
}

/// A picture that its format cannot hold is a wrong argument.
fn check_sides(size: [u32; 2], output: &Path) -> anyhow::Result<()> {
    let format = Format::of(output)?;
    if size.iter().any(|&side| side > format.most_pixels()) {
        return Err(UsageError(format.too_large(output).to_string()).into());
    }
    Ok(())
}
