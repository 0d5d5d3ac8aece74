//! From points to resident sections: binning workers, the pool, transfers, the section table.

pub mod bins;
pub mod pool;
pub mod scene;
pub mod table;
pub mod workers;
