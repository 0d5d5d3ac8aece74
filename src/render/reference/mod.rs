//! What the image must be: a CPU twin for each pass of a frame, named as the shaders.
//!
//! The exact image contract, of columns: a column is solid from its highest shown point down without end; a cell
//! without points is empty; cells are half-open, `[i, i + 1) · c`; a ray hits where it first is at or
//! below a column's top inside that cell. Written apart from the sections, pyramids and shaders that it
//! checks: `columns` bins points, `stacks` does so where things float, `smooth` makes a surface of what is solid, `joined` tubes and slabs of what floats (both between
//! `corners`), `trace` finds hits by brute force over the finest
//! cells, `compare` says how an image differs from them, `shade` gives hits their colour, `screen` packs colours. They share
//! with the device the rays, the class mask and the colour tables alone. `beam` goes as the shader goes, since what a beam
//! reaches is a choice of the shader.

pub mod beam;
mod columns;
mod compare;
mod corners;
mod joined;
#[cfg(test)]
mod joined_tests;
pub mod screen;
pub mod shade;
mod smooth;
mod stacks;
#[cfg(test)]
mod stacks_tests;
#[cfg(test)]
mod tests;
mod trace;

pub use columns::{Column, ColumnMap, Point};
pub use compare::{Comparison, Difference, Tolerance, compare};
pub use smooth::SmoothMap;
pub use stacks::{Floating, Spacing, Stack, StackMap};
pub use trace::{Face, Hit};
