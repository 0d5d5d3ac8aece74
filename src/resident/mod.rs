//! Sections on the device: which are wanted, how they get there and go, and the table by which frames find them.

pub mod cut;
mod demand;
mod derive;
mod host_cache;
pub mod live;
mod motion;
mod payloads;
mod policy;
pub mod pool;
#[cfg(test)]
pub(crate) mod readers;
pub mod scene;
pub mod switch;
pub mod table;
mod transfer;
pub mod visibility;
mod work;

#[cfg(feature = "view")]
pub use derive::pipeline_descs as derived_pipeline_descs;
pub use work::Work;
