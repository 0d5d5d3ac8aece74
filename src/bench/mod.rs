//! What `lasray bench` measures.

mod cache;
pub mod ingest;
