//! From files to sections: chunks are decoded, their points binned into columns, columns packed.

pub mod bins;
pub mod budget;
pub mod builds;
pub mod changes;
pub mod counts;
pub mod feed;
pub mod ground;
pub mod input;
pub mod meaning;
pub mod selecting;
pub mod sparse;
pub mod workers;
