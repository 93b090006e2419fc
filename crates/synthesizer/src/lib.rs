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

pub mod colormap;
mod depth;
mod error;
mod find_layers;
mod found_range;
mod layer_spec;
mod memory;
mod metrics;
mod model_file;
mod options;
mod photo_store;
mod plan;
mod retention;
mod scene_photos;
mod scene_views;
mod select_planes;
mod shot;
mod synthesizer;
mod target;
mod threads;
mod view_agreement;

pub use depth::depth_search::{DepthSearch, FoundDepth};
pub use depth::scene_depth::{DepthProgress, DepthSource, ViewDepth};
pub use error::SynthesisError;
pub use find_layers::{Carried, FoundLayers, FrameInput, LayerSource, PhotosWithDepth, Selection, find_layers};
pub use layer_spec::{LayerSpec, LayerSpecError, MAX_LAYERS};
// Targets are cameras, and paths of them; pictures come back.
pub use liveview::{Camera, Frame, ImageRgb};
pub use liveview_scene::{Scene, SceneOptions};
pub use liveview_surface::{PhotoCorrection, TargetSurface};
pub use metrics::{Score, psnr, ssim};
pub use model_file::{ModelNotFound, find_model, model_folders};
pub use options::{DEFAULT_VIEWS, Model, ModelOptions, OpenedRenderer, Options, recommended_layers};
pub use plan::Plan;
pub use scene_photos::ScenePhotos;
pub use scene_views::SceneViews;
pub use select_planes::{cover_planes, select_planes};
pub use shot::{LoadedShot, Shot};
pub use synthesizer::Synthesizer;
pub use target::{Target, TargetCamera, Targets};
pub use threads::{MAX_THREADS, ThreadsError, check_threads};
pub use view_agreement::ViewAgreement;
