//! A handful of posed photos becomes a new view: dynamic target-centred multiplane images (LiveView, CVPR 2021), the
//! network run by ONNX Runtime, everything else native.

pub mod fs;
#[cfg(fuzzing)]
pub mod fuzz;
pub mod geometry;
pub mod image;
pub mod layers;
pub mod live;
pub mod network;
pub mod render;
pub mod scene;
mod synthesizer;
pub mod warp;

pub use geometry::{Camera, CameraPath, Intrinsics};
pub use image::ImageRgb;
pub use layers::{LayerSpec, Layers};
pub use render::Frame;
pub use scene::{Scene, SceneOptions};
pub use synthesizer::*;
pub use {glam, ndarray};
