//! `lasray render`: pictures without a window.

mod args;
mod camera;
mod data;
mod draw;
mod drawing;
mod film;
mod ground;
mod names;
mod pattern;
mod report;
mod run;

pub use args::Args;
pub use run::run;
