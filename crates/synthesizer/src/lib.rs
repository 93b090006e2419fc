//! From posed photos to a picture: scene, views, depth range, layers and network in one.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use liveview_synthesizer::{Options, Synthesizer, Target};
//!
//! let mut synthesizer = Synthesizer::open("scene", &Options::default())?;
//! let frame = synthesizer.render(&Target::held_out("IMG_7.jpg"))?;
//! frame.picture().save("new.png")?;
//! # Ok(()) }
//! ```
//!
//! The same step by step: [`Synthesizer::shots`] chooses the views and the depth range of each
//! target, [`Synthesizer::load`] loads their photos, [`Synthesizer::plan`] finds the layers,
//! [`Synthesizer::render_plan`] renders them.

pub mod agreement;
pub mod colormap;
mod error;
mod find_layers;
pub mod guessed;
mod layer_spec;
mod memory;
mod metrics;
mod model;
mod photo_depths;
mod scene_photos;
mod scene_views;
mod shot;
mod synthesizer;

pub use agreement::ViewAgreement;
pub use error::SynthesisError;
pub use find_layers::{
    Carried, FrameInput, LayerSource, PhotosWithDepth, Plan, Selection, cover_planes, find_layers, select_planes,
};
pub use layer_spec::{LayerSpec, MAX_LAYERS};
// Targets are cameras, and paths of them; pictures come back.
pub use liveview::{Camera, Frame, ImageRgb};
pub use liveview_scene::{Scene, SceneOptions};
pub use liveview_surface::{PhotoCorrection, TargetSurface};
pub use memory::check_video;
pub use metrics::{Score, psnr, ssim};
pub use model::{MAX_THREADS, Model, ModelOptions, OpenedRenderer, Options, check_threads, recommended_layers};
pub use photo_depths::{DepthProgress, DepthSource, ViewDepth};
pub use scene_photos::ScenePhotos;
pub use scene_views::SceneViews;
pub use shot::{LoadedShot, Shot, Target, TargetCamera, Targets};
pub use synthesizer::Synthesizer;
