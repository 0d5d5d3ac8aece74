//! `lasray info`: what is in the files, and how they would be drawn.

mod args;
mod classes;
mod devices;
mod gather;
mod numbers;
mod ranges;
mod report;
mod run;
mod scan;
mod table;
mod text;

pub use args::Args;
pub use run::run;
