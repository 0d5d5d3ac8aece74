//! What is read: files of every kind, made, real and broken ones. One program, since each links everything.

mod coordinate_systems;
mod ground;
mod hostile;
mod info;
mod known_bounds;
#[path = "../common/lax.rs"]
mod lax_writer;
#[path = "../made/mod.rs"]
mod made;
mod made_files;
mod opening_sample;
mod real_files;
#[path = "../common/scene.rs"]
mod scene;
