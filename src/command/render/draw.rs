//! Draws the images that the arguments ask for, and writes them with what stands beside them.

use super::args::Args;
use super::camera::{camera, framed};
use super::data::{Data, Filled, fill};
use super::film::{Film, draw_film};
use super::report::{Summary, write_json};
use crate::attribute::{ColorTable, Kinds};
use crate::command::UsageError;
use crate::coords::Grid;
use crate::gpu::Gpu;
use crate::output::{Output, Protected};
use crate::problems::Problems;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::{Background, FrameError, Renderer, Shade, Traversal, View, check_size};
use crate::render::image::{Format, Image, notes};
use crate::render::side_files::{SideFiles, WorldFile};
use crate::render::sight::sight;
use crate::resident::live::Status;
use crate::resident::table::Table;
use crate::resident::visibility::why_hidden;
use crate::source::crs::Crs;
use anyhow::Context;
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Draws the image that the arguments ask for, or all of `film`.
pub(super) fn draw(
    gpu: &Gpu,
    data: Data,
    args: &Args,
    output: &Path,
    film: Option<&Film>,
    protected: &Protected,
    problems: &mut Problems,
) -> anyhow::Result<()> {
    let (grid, about, content) = data.into_parts();
    let floor = about.floor(grid.cell());
    let (bounds, pivot, base) = (about.bounds, about.bounds.min.z, about.base);
    let place = |v: DVec3| base.place(v);
    let framed = framed(args, &bounds, floor, grid.cell());
    let (cameras, size) = match film {
        Some(film) => (film.cameras(place)?, args.size.unwrap_or([1280, 720])),
        None => camera(args, &framed, place).map(|(camera, size)| (vec![camera], size))?,
    };
    let filled = Filled::new(gpu, args, content, grid, film.is_some())?;

    let mode = args.color.0.unwrap_or(about.color);
    let colors = ColorTable::new(mode, &about.summary, &grid, args.ramp, args.range)
        .map_err(|e| UsageError(e.to_string()))?;
    if let Some(constant) = &colors.constant
        && !args.quiet
    {
        eprintln!("note: {constant}");
    }

    let exr = Format::of(output)? == Format::Exr;
    let exact = args.is_exact();
    let parallel = matches!(cameras[0].projection(), Projection::Orthographic { .. });
    let view = View {
        camera: &cameras[0],
        size,
        samples: if exr { 1 } else { args.samples.unwrap_or(if exact { 1 } else { 4 }) },
        z_scale: args.z_scale,
        pivot,
        bounds,
        floor,
        colors: &colors,
        shade: args.shade,
        background: args.background.unwrap_or(if parallel { Background::White } else { Background::Sky }),
        traversal: if args.plain { Traversal::Plain } else { Traversal::Fast },
        window: None,
    };
    let anchor = grid.height(bounds.center().z).context("heights are beyond what can be drawn")?;
    let renderer = Renderer::new(&filled.scene, grid, anchor)?;
    let side = film.is_none().then(|| {
        let world = args.ortho.and_then(|_| {
            // In the world's own coordinates, degrees among them, not in those that are drawn.
            let [east, north] = base.horizontal_scale()?;
            Some(WorldFile::of(&cameras[0].basis(size).ok()?)?.scaled([1.0 / east, 1.0 / north]))
        });
        SideFiles::new(output, world.as_ref(), about.crs.as_ref().and_then(Crs::prj).as_deref())
    });
    let mut drawing = Drawing {
        args,
        // Solid columns are seen from below, too.
        seen_down_to: if args.shade == Shade::Lit { floor } else { bounds.solid_down_to() },
        detail: args.detail.unwrap_or(if exact { 0.0 } else { 1.0 }),
        beside: side.as_ref().map_or(String::new(), SideFiles::note),
        sampled_kinds: &about.kinds,
        statuses: Vec::new(),
        filled,
        renderer,
        view,
        grid,
        protected,
        problems: &mut *problems,
    };
    match film {
        Some(film) => {
            draw_film(film, &cameras, args.quiet, |camera, output| drawing.image(camera, output))?;
        }
        None => drawing.image(&cameras[0], output)?,
    }
    let Drawing { statuses, filled, .. } = drawing;
    side.iter().flat_map(|side| side.write(protected)).for_each(|line| problems.warn(line));
    let resident = statuses.last().map_or(filled.sections, |status| status.resident);
    let read = statuses.last().map_or(filled.points, |status| status.progress.points_seen);
    write_json(args, statuses, protected)?;
    if !args.quiet {
        let summary = Summary {
            output,
            images: film.map(|film| film.frames.len() as u64),
            size,
            points: [read, filled.points],
            sections: resident as u64,
            grid: &grid,
            unit: about.unit.as_ref(),
            mode,
            colors: &colors,
        };
        eprintln!("{}", summary.line());
    }
    Ok(())
}

/// Images of the same data, one after the other.
struct Drawing<'a> {
    args: &'a Args,
    filled: Filled,
    renderer: Renderer,
    /// The first image.
    view: View<'a>,
    grid: Grid,
    /// U down to which sections are wanted.
    seen_down_to: f64,
    /// Pixels that a cell may cover.
    detail: f64,
    /// What an image says of its side files.
    beside: String,
    /// Kinds of points that the opening sample has seen.
    sampled_kinds: &'a Kinds,
    /// Of each image that was drawn while data streams.
    statuses: Vec<Status>,
    protected: &'a Protected,
    problems: &'a mut Problems,
}

impl Drawing<'_> {
    /// Draws what `camera` sees, and writes it.
    fn image(&mut self, camera: &Camera, output: &Path) -> anyhow::Result<()> {
        let table = self.table(camera)?;
        let scene = &mut self.filled.scene;
        // Where nothing is in sight, the sample tells what there is elsewhere.
        let seen: Kinds = scene.kinds().union(self.sampled_kinds).copied().collect();
        if let Some(why) = why_hidden(&seen, &scene.visibility()) {
            anyhow::bail!("nothing to draw: {why}");
        }
        let view = View { camera, ..self.view.clone() };
        let image = self.renderer.draw_table(scene, &view, &table).map_err(usage)?;
        write(&image, &view, &self.grid, Output::over(output, self.protected), &self.beside)
    }

    /// The table of what `camera` sees, which is read and uploaded first where it is not there.
    fn table(&mut self, camera: &Camera) -> anyhow::Result<Arc<Table>> {
        let scene = &mut self.filled.scene;
        let Some(live) = &mut self.filled.live else { return Ok(self.renderer.table(scene)) };
        let View { size, z_scale, pivot, .. } = self.view;
        check_size(scene.gpu(), size).map_err(usage)?;
        let sight = sight(camera, size, [z_scale, pivot], self.seen_down_to, self.detail)
            .map_err(|error| usage(error.into()))?;
        live.pause(false);
        live.restore_detail();
        let filled = fill(live, scene, &sight, self.args);
        live.pause(true);
        // What was wrong with files is told even where the image fails for another reason.
        live.take_errors().iter().for_each(|error| self.problems.error(error));
        live.take_warnings().iter().for_each(|warning| self.problems.warn(warning));
        let now = filled?;
        if now.coarser > 1.0 && self.statuses.last().is_none_or(|before| before.coarser < now.coarser) {
            self.problems.warn(format!(
                "detail is reduced: cells may cover {:.1} times as many pixels, for lack of device memory (--device-memory)",
                now.coarser
            ));
        }
        self.statuses.push(now);
        Ok(self.renderer.table_of_live(scene, live))
    }
}

/// A size or a camera that cannot be drawn is a wrong argument.
fn usage(error: FrameError) -> anyhow::Error {
    match error {
        FrameError::Size { .. } | FrameError::Camera(_) => UsageError(error.to_string()).into(),
        error => error.into(),
    }
}

/// Writes an image; `beside`: what it says of its side files.
fn write(image: &Image, view: &View, grid: &Grid, output: Output, beside: &str) -> anyhow::Result<()> {
    let of_view = notes(view.camera, grid);
    let mut notes: Vec<_> = of_view.iter().map(|(key, value)| (*key, value.as_str())).collect();
    if !beside.is_empty() {
        notes.push(("Beside", beside));
    }
    image.write(output, view.background == Background::None, &notes)?;
    Ok(())
}
