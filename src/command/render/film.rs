//! The frames of a camera path: which are drawn, and one after the other.

use super::args::Args;
use super::pattern::Pattern;
use crate::command::UsageError;
use crate::load;
use crate::render::camera::Camera;
use crate::render::path::CameraPath;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// The frames of a path that are to be drawn, and where they go.
pub(super) struct Film {
    pub(super) path: CameraPath,
    pub(super) frames: Vec<u32>,
    pub(super) pattern: Pattern,
}

impl Film {
    /// `output`: the pattern of their names, by how many they are.
    pub(super) fn new(
        file: &Path,
        args: &Args,
        output: impl FnOnce(u32) -> PathBuf,
    ) -> Result<Film, UsageError> {
        let usage = |e: &dyn std::fmt::Display| UsageError(e.to_string());
        let path = CameraPath::read(file).map_err(|e| usage(&e))?;
        let (all, count) = (path.frames(), args.frames.unwrap_or(path.frames()));
        if count > all {
            return Err(usage(&format!("--frames {count}: {} has {all}", file.display())));
        }
        let pattern = Pattern::new(&output(count), count).map_err(|e| usage(&e))?;
        Ok(Film { frames: path.spread(count).collect(), path, pattern })
    }

    /// One a picture. `place`: from the coordinates of the file to the world's.
    pub(super) fn cameras(&self, place: impl Fn(DVec3) -> DVec3) -> Result<Vec<Camera>, UsageError> {
        let path = self.path.placed(place).map_err(|e| UsageError(format!("camera path: {e}")))?;
        let camera = |&frame: &u32| {
            path.camera(frame).map_err(|e| UsageError(format!("camera path: frame {frame}: {e}")))
        };
        self.frames.iter().map(camera).collect()
    }
}

/// Draws one picture after the other. Ctrl-C ends it between two of them, a second one at once.
pub(super) fn draw_film(
    film: &Film,
    cameras: &[Camera],
    quiet: bool,
    mut picture: impl FnMut(&Camera, &Path) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    static STOP: AtomicBool = AtomicBool::new(false);
    let stop = || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    crate::stop::on_request(stop)?;
    let bar =
        load::bar(cameras.len() as u64, quiet, "drawing {wide_bar} {human_pos}/{human_len} pictures {eta}");
    for (number, camera) in (0..).zip(cameras) {
        if STOP.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            anyhow::bail!("stopped after {number} of {} pictures", cameras.len());
        }
        picture(camera, &film.pattern.file(number))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}
