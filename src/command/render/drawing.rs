//! Images of the same data, and what they need of it.

use super::args::{Args, Wait};
use super::data::{Filled, fill};
use super::report::Drawn;
use crate::attribute::Kinds;
use crate::command::UsageError;
use crate::coords::Grid;
use crate::load::{About, LoadError};
use crate::output::{Output, Protected};
use crate::problems::Problems;
use crate::render::camera::Camera;
use crate::render::frame::{Background, FrameError, Renderer, Shade, View, check_size};
use crate::render::image::{Image, notes};
use crate::render::sight::sight;
use crate::resident::live::Status;
use crate::resident::table::Table;
use crate::resident::visibility::why_hidden;
use std::path::Path;
use std::sync::Arc;

/// Images of the same data, one after the other.
pub(super) struct Drawing<'a> {
    pub(super) args: &'a Args,
    pub(super) filled: Filled,
    pub(super) renderer: Renderer,
    /// What images have in common.
    pub(super) view: View<'a>,
    pub(super) grid: Grid,
    /// U down to which sections are wanted.
    pub(super) seen_down_to: f64,
    /// Pixels that a cell may cover.
    pub(super) detail: f64,
    /// What an image says of its side files.
    pub(super) beside: String,
    /// What is known of the data.
    pub(super) about: &'a About,
    /// Each image that was drawn while data streams.
    pub(super) drawn: Vec<Drawn>,
    pub(super) protected: &'a Protected,
    pub(super) problems: &'a mut Problems,
}

impl Drawing<'_> {
    /// Draws what `camera` sees, and writes it.
    pub(super) fn image(&mut self, camera: &Camera, output: &Path) -> anyhow::Result<()> {
        let view = View { camera, ..self.view.clone() };
        let (table, status) = self.table(&view, self.detail, self.args.wait)?;
        let scene = &mut self.filled.scene;
        // Where nothing is in sight, the sample tells what there is elsewhere.
        let seen: Kinds = scene.kinds().union(&self.about.kinds).copied().collect();
        // Where every point was read, there are no others.
        let is_read = |status: &Status| status.progress.points_seen == status.progress.points;
        let selection = self.args.selection.selection();
        if seen.is_empty() && !selection.is_all() && status.as_ref().is_some_and(is_read) {
            return Err(LoadError::none_selected(&selection, &self.about.present).into());
        }
        if let Some(why) = why_hidden(&seen, &scene.visibility()) {
            anyhow::bail!("nothing to draw: {why}");
        }
        let image = self.renderer.draw_table(scene, &view, &table).map_err(usage)?;
        if image.distance.iter().all(|distance| distance.is_infinite()) {
            let output = output.display();
            self.problems.warn(format!("{output}: nothing of the data is in sight: without --eye, --target, --path and a distance all of it is framed"));
        }
        let picture = output.display().to_string();
        self.drawn.extend(status.map(|status| Drawn { picture, status }));
        write(&image, &view, &self.grid, Output::over(output, self.protected), &self.beside)
    }

    /// What `camera` sees in one pixel: finest cells, no exaggeration, nothing written.
    pub(super) fn exact_pixel(&mut self, camera: &Camera) -> anyhow::Result<Image> {
        let view = View {
            camera,
            size: [1, 1],
            samples: 1,
            z_scale: 1.0,
            shade: Shade::None,
            background: Background::None,
            ..self.view.clone()
        };
        let (table, _) = self.table(&view, 0.0, Wait::Complete)?;
        self.renderer.draw_table(&mut self.filled.scene, &view, &table).map_err(usage)
    }

    /// The table of what is seen in `view`, which is read and uploaded first where it is not there, and how things stand where
    /// that was. `detail`: pixels that a cell may cover.
    fn table(
        &mut self,
        view: &View,
        detail: f64,
        wait: Wait,
    ) -> anyhow::Result<(Arc<Table>, Option<Status>)> {
        let scene = &mut self.filled.scene;
        let Some(live) = &mut self.filled.live else { return Ok((self.renderer.table(scene), None)) };
        let View { camera, size, z_scale, pivot, .. } = *view;
        check_size(scene.gpu(), size).map_err(usage)?;
        let sight = sight(camera, size, [z_scale, pivot], self.seen_down_to, detail)
            .map_err(|error| usage(error.into()))?;
        live.pause(false);
        live.restore_detail();
        let width = self.about.bounds.size().truncate().max_element() / self.grid.cell();
        let filled = fill(live, scene, &sight, self.args, (wait, width));
        live.pause(true);
        // What was wrong with files is told even where the image fails for another reason.
        live.take_errors().iter().for_each(|error| self.problems.error(error));
        live.take_warnings().iter().for_each(|warning| self.problems.warn(warning));
        let now = filled?;
        if now.coarser > 1.0 && self.drawn.last().is_none_or(|before| before.status.coarser < now.coarser) {
            self.problems.warn(format!(
                "detail is reduced: cells may cover {:.1} times as many pixels, for lack of device memory (--device-memory)",
                now.coarser
            ));
        }
        Ok((self.renderer.table_of_live(scene, live), Some(now)))
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
