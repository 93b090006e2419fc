//! Properties of the renderer: they hold for any photos, cameras and networks.

mod batches;
mod compositing;
mod culling;
mod symmetries;
mod synthetic;
