//! Draws the images that the arguments ask for, and writes them with what stands beside them.

use super::args::Args;
use super::camera::camera;
use super::data::{Content, Data, fill, upload};
use super::film::{Film, draw_film};
use crate::attribute::{ColorTable, Kinds};
use crate::command::UsageError;
use crate::coords::{Bounds, Grid};
use crate::gpu::{Gpu, Order};
use crate::load::{self, About, Loaded, Opening};
use crate::output::{Output, Protected, Signed};
use crate::problems::Problems;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::{Background, FrameError, Renderer, Shade, Traversal, View, check_size};
use crate::render::image::{Format, Image, SideFiles, WorldFile, notes};
use crate::render::sight::sight;
use crate::resident::live::{Live, Status};
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::visibility::why_hidden;
use crate::section::slot::slot_bytes;
use crate::source::crs::Crs;
use crate::text::{harmless, tidy};
use anyhow::Context;
use glam::DVec3;
use std::path::Path;

/// Draws the picture that the arguments ask for, or all of `film`.
pub(super) fn draw(
    gpu: &Gpu,
    data: Data,
    args: &Args,
    output: &Path,
    film: Option<&Film>,
    protected: &Protected,
    problems: &mut Problems,
) -> anyhow::Result<()> {
    let (grid, about, content) = match data {
        Data::Whole(Loaded { grid, about, sections, points }) => {
            (grid, about, Content::Whole(sections, points))
        }
        Data::Live(Opening { inputs, grid, core, about }) => (grid, about, Content::Live(inputs, core)),
    };
    let floor = about.floor(grid.cell());
    let About { bounds, summary, color, crs, unit, base, .. } = about;
    let pivot = bounds.min.z;
    let shown = bounds.exaggerated(args.z_scale, pivot);
    let place = |v: DVec3| base.place(v);
    let slab = Bounds { min: bounds.min.with_z(floor), ..bounds };
    let framed = if args.shade == Shade::Lit { slab.exaggerated(args.z_scale, pivot) } else { shown };
    // A map is of the points' extent; in a view, the cells of a few points reach far beyond it.
    let framed =
        if args.ortho.is_none() { framed.of_cells(grid.cell()) } else { framed.at_least(grid.cell()) };
    let (cameras, size) = match film {
        Some(film) => (film.cameras(place)?, args.size.unwrap_or([1280, 720])),
        None => camera(args, &framed, place).map(|(camera, size)| (vec![camera], size))?,
    };

    let pool_bytes = args.device_budget(gpu);
    let access = Access::best(
        gpu,
        match &content {
            Content::Whole(sections, _) => {
                sections.iter().map(|(_, columns)| slot_bytes(columns.layout().derived_bytes())).sum()
            }
            // Derived parts are less than half of what sections take.
            Content::Live(..) => pool_bytes / 2,
        },
    );
    let mut scene = Scene::new(gpu, |order: Order| order, access, pool_bytes, args.visibility(), grid)?;
    let (mut live, points, sections) = match content {
        Content::Whole(sections, points) => {
            let count = sections.len();
            upload(&mut scene, sections)?;
            if let Some(why) = why_hidden(&scene.kinds(), &scene.visibility()) {
                anyhow::bail!("nothing to draw: {why}");
            }
            (None, points, count)
        }
        Content::Live(inputs, core) => {
            let points = inputs.iter().map(|input| input.input.file.points()).sum();
            let host_bytes = args.host_memory;
            let mut live = Live::new(inputs, grid, core, host_bytes, load::threads(), || ());
            if film.is_none() {
                live.keep_no_copies();
            }
            if let Some(cache) = args.cache() {
                live.keep_learned(cache);
            }
            (Some(live), points, 0)
        }
    };

    let mode = args.color.0.unwrap_or(color);
    let colors = ColorTable::new(mode, &summary, &grid, args.ramp, args.range)
        .map_err(|e| UsageError(e.to_string()))?;
    if let Some(constant) = &colors.constant
        && !args.quiet
    {
        eprintln!("note: {constant}");
    }

    let exr = Format::of(output)? == Format::Exr;
    let exact = args.is_exact();
    let detail = args.detail.unwrap_or(if exact { 0.0 } else { 1.0 });
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
    let mut renderer = Renderer::new(&scene, grid, anchor)?;
    // Solid columns are seen from below, too.
    let seen_down_to = if args.shade == Shade::Lit { floor } else { bounds.solid_down_to() };
    let side = film.is_none().then(|| {
        let world = args.ortho.and_then(|_| {
            // In the world's own coordinates, degrees among them, not in those that are drawn.
            let [east, north] = base.horizontal_scale()?;
            Some(WorldFile::of(&cameras[0].basis(size).ok()?)?.scaled([1.0 / east, 1.0 / north]))
        });
        SideFiles::new(output, world.as_ref(), crs.as_ref().and_then(Crs::prj).as_deref())
    });
    let beside = side.as_ref().map_or(String::new(), SideFiles::note);
    let mut status = None;
    let mut all = Vec::new();
    let mut picture = |camera: &Camera, output: &Path| -> anyhow::Result<()> {
        let view = View { camera, ..view.clone() };
        let usage = |error: FrameError| match error {
            FrameError::Size { .. } | FrameError::Camera(_) => UsageError(error.to_string()).into(),
            error => anyhow::Error::from(error),
        };
        let table = match &mut live {
            None => renderer.table(&scene),
            Some(live) => {
                check_size(scene.gpu(), size).map_err(usage)?;
                let sight = sight(camera, size, [args.z_scale, pivot], seen_down_to, detail)
                    .map_err(|error| usage(error.into()))?;
                live.pause(false);
                live.restore_detail();
                let filled = fill(live, &mut scene, &sight, args);
                live.pause(true);
                // What was wrong with files is told even where the picture fails for another reason.
                live.take_errors().iter().for_each(|error| problems.error(error));
                live.take_warnings().iter().for_each(|warning| problems.warn(warning));
                let now = filled?;
                if now.coarser > 1.0 && status.is_none_or(|before: Status| before.coarser < now.coarser) {
                    problems.warn(format!(
                        "detail is reduced: cells may cover {:.1} times as many pixels, for lack of device memory (--device-memory)",
                        now.coarser
                    ));
                }
                status = Some(now);
                all.push(now);
                renderer.table_of_live(&scene, live)
            }
        };
        // Where nothing is in sight, the sample tells what there is elsewhere.
        let seen: Kinds = scene.kinds().union(&about.kinds).copied().collect();
        if let Some(why) = why_hidden(&seen, &scene.visibility()) {
            anyhow::bail!("nothing to draw: {why}");
        }
        let image = renderer.draw_table(&mut scene, &view, &table).map_err(usage)?;
        write(&image, &view, &grid, Output::over(output, protected), &beside)
    };
    match film {
        Some(film) => draw_film(film, &cameras, args.quiet, picture)?,
        None => picture(&cameras[0], output)?,
    }
    side.iter().flat_map(|side| side.write(protected)).for_each(|line| problems.warn(line));
    if let Some(to) = &args.json {
        let all: Vec<_> = all.into_iter().map(Signed::new).collect();
        let text = serde_json::to_string_pretty(&all).context("numbers as JSON")?;
        to.write(&(text + "\n"), protected)?;
    }
    if !args.quiet {
        let cell = tidy(grid.cell());
        let unit = unit.as_ref().map_or(if cell == "1" { "unit" } else { "units" }, |u| u.symbol());
        let plural = |n: u64, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let legend = colors.range.map_or(String::new(), |(lo, hi)| format!(" from {lo:.1} to {hi:.1}"));
        let pictures = film.map_or(String::new(), |f| plural(f.frames.len() as u64, "picture") + " of ");
        eprintln!(
            "{}: {pictures}{}x{} pixels, {} in {}, cells of {cell} {unit}, coloured by {}{legend}",
            harmless(&output.to_string_lossy()),
            size[0],
            size[1],
            plural(points, "point"),
            plural(status.map_or(sections, |status: Status| status.resident) as u64, "section"),
            mode.name()
        );
    }
    Ok(())
}

/// Writes a picture; `beside`: what it says of its side files.
fn write(image: &Image, view: &View, grid: &Grid, output: Output, beside: &str) -> anyhow::Result<()> {
    let of_view = notes(view.camera, grid);
    let mut notes: Vec<_> = of_view.iter().map(|(key, value)| (*key, value.as_str())).collect();
    if !beside.is_empty() {
        notes.push(("Beside", beside));
    }
    image.write(output, view.background == Background::None, &notes)?;
    Ok(())
}
