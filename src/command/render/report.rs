//! What is told of images that were drawn: the line for people, and the numbers for programs.

use super::args::Args;
use crate::attribute::{ColorMode, ColorTable};
use crate::coords::Grid;
use crate::output::{Protected, Signed};
use crate::resident::live::Status;
use crate::source::crs::Unit;
use crate::text::{harmless, tidy};
use anyhow::Context;
use std::path::Path;

/// An image that was drawn while data streams, and what that took.
#[derive(Debug, serde::Serialize)]
pub(super) struct Drawn {
    /// Its name.
    pub(super) picture: String,
    #[serde(flatten)]
    pub(super) status: Status,
}

/// Writes what each image took where `--json` says.
pub(super) fn write_json(args: &Args, all: Vec<Drawn>, protected: &Protected) -> anyhow::Result<()> {
    let Some(to) = &args.json else { return Ok(()) };
    let all: Vec<_> = all.into_iter().map(Signed::new).collect();
    let text = serde_json::to_string_pretty(&all).context("numbers as JSON")?;
    to.write(&(text + "\n"), protected)?;
    Ok(())
}

/// What the line for people says.
pub(super) struct Summary<'a> {
    pub(super) output: &'a Path,
    /// Images of a path.
    pub(super) images: Option<u64>,
    pub(super) size: [u32; 2],
    /// Points that were read, whether shown or not, and all.
    pub(super) points: [u64; 2],
    /// Of those that were read, the ones that take part, where not all do; estimated where that is said.
    pub(super) selected: Option<(u64, bool)>,
    pub(super) sections: u64,
    pub(super) grid: &'a Grid,
    pub(super) unit: Option<&'a Unit>,
    pub(super) mode: ColorMode,
    pub(super) colors: &'a ColorTable,
}

impl Summary<'_> {
    pub(super) fn line(&self) -> String {
        let cell = tidy(self.grid.cell());
        let unit = self.unit.map_or(if cell == "1" { "unit" } else { "units" }, |u| u.symbol());
        let plural = |n: u64, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let legend = self.colors.range.map_or(String::new(), |(lo, hi)| format!(" from {lo:.1} to {hi:.1}"));
        let images = self.images.map_or(String::new(), |count| plural(count, "picture") + " of ");
        let [width, height] = self.size;
        let [read, all] = self.points;
        let points = if read < all { format!("{read} of {all} points") } else { plural(all, "point") };
        let selected = self.selected.map_or(String::new(), |(selected, is_estimate)| {
            format!(", {}{selected} selected", if is_estimate { "about " } else { "" })
        });
        format!(
            "{}: {images}{width}x{height} pixels, {points} read{selected}, {}, cells of {cell} {unit}, coloured by {}{legend}",
            harmless(&self.output.to_string_lossy()),
            plural(self.sections, "section"),
            self.mode.name()
        )
    }
}
