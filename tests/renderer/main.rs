//! Properties of the renderer: they hold for any photos, cameras and networks.

mod compositing;
mod culling;
mod determinism;
mod symmetries;
mod synthetic;
#[path = "../wheel/mod.rs"]
mod wheel;
