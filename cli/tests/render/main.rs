//! `liveview render`: its pictures, its outputs, `--cache` and `--network none`.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../tests/scene_common/mod.rs"]
mod scene_common;

mod cache;
mod frames;
mod no_network;
mod options;
mod outputs;
mod pictures;
