//! From points to resident sections: binning workers, the pool, transfers, the section table.

pub mod bins;
pub mod budget;
pub mod builds;
pub mod feed;
pub mod hidden;
pub mod live;
mod motion;
pub mod pool;
pub mod residency;
pub mod scene;
pub mod sparse;
pub mod table;
pub mod workers;
