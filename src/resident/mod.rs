//! Sections on the device: which are wanted, how they get there and go, and the table by which frames find them.

pub mod cut;
pub mod live;
mod motion;
pub mod pool;
pub mod scene;
pub mod table;
pub mod visibility;
