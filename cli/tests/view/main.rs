//! `liveview view`.

#[path = "../common/mod.rs"]
mod common;

mod limits;
mod rig;
mod scene;
