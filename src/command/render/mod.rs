//! `lasray render`: pictures without a window.

mod args;
mod camera;
mod data;
mod draw;
mod film;
mod pattern;
mod run;

pub use args::Args;
pub use data::upload;
pub use run::run;
