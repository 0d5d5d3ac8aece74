//! x
pub mod cell;
