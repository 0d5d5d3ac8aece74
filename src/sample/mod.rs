//! The opening sample, and what is decided from it once for all files: placement, cell size, framing,
//! how RGB is stored, what colours are chosen by. Nothing here depends on the order of reading, on
//! threads, or on how the files were named.
//!
//! Sets of up to 250,000 points are read whole, and of up to 2,000,000 where certain classes or points are asked for. Of larger ones it reads the first point of (at most 65,536) chunks, the
//! first 1,024 points of 64 chunks, and whole chunks at four places of the set, about 50,000 points each; of a COPC
//! file the nodes over a few small windows instead. Where flight lines overlap, chunks of the other lines are read
//! around each place, at most six. Files with RGB that this leaves with few points are read 256 points further.

mod absence;
mod budget;
mod cell;
mod centre;
mod decide;
mod facts;
mod frame;
mod ground;
mod open;
mod parallel;
mod places;
mod present;
mod quantile;
mod read;
mod rgb;
mod seen;
mod shape;
mod shapes;
mod summary;
mod weighted;

pub use budget::SampleBudget;
pub use cell::{CellChoice, GroundPatch, choose as choose_cell};
pub use decide::{FileSample, Sample, SampledKinds, take};
pub use frame::FrameNote;
pub use open::{Opened, open_all};
pub(crate) use parallel::parallel;
pub use present::Present;
pub use rgb::{RgbDepth, has_rgb};
pub use seen::{Asked, hidden_by_default};
