//! Files in, points out: headers, chunk index, decoding in blocks of columns.
//!
//! [`LidarFile::open`] reads the header, the index of variable length records and the index of chunks,
//! each checked against the file's length. A [`Decoder`] (one a worker thread) turns chunks into
//! [`PointBlock`]s. Nothing is printed here: what is wrong is a [`SourceError`], or a [`Warning`] in
//! [`LidarFile::warnings`] where points can be read all the same.

mod bytes;
mod chunks;
mod compatible;
pub(crate) mod contain;
mod copc;
pub mod crs;
mod decode;
mod error;
mod fields;
mod file;
mod header;
pub mod inputs;
mod kept_apart;
pub mod kinds;
pub mod known;
mod laszip;
pub mod lax;
mod layers;
pub mod learned;
pub mod length;
pub mod placement;
mod points;
mod reading;
pub mod reproject;
mod selection;
mod sequences;
mod stream;
pub mod system;
mod times;
mod vlr;
mod wkt;

pub use bytes::{FileBytes, OpenFile, time_reading};
pub use chunks::Chunk;
pub use copc::{Copc, VoxelKey};
pub use decode::{Decoder, LayerMemory};
pub use error::{SourceError, Warning};
pub use file::LidarFile;
pub use header::FileHeader;
pub use points::{
    BLOCK_RECORDS, FLAG_KEY_POINT, FLAG_OVERLAP, FLAG_SYNTHETIC, FLAG_WITHHELD, Fields, PointBlock,
};
pub use reading::Reading;
pub use selection::{Interval, Returns, Selection, SourceIds};
pub use vlr::VlrEntry;
