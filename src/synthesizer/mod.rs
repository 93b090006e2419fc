//! From posed photos to a picture: scene, views, depth range, layers and network in one.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use liveview::{Options, Synthesizer, Target};
//!
//! let mut synthesizer = Synthesizer::open("scene", &Options::default())?;
//! let frame = synthesizer.render(&Target::held_out("IMG_7.jpg"))?;
//! frame.inpainted().save("new.png")?;
//! # Ok(()) }
//! ```
//!
//! The same step by step: [`Synthesizer::shots`] chooses the views and the depth range of each
//! target, [`Synthesizer::load`] loads their photos, [`Synthesizer::plan`] finds the layers,
//! [`Synthesizer::render_plan`] renders them.

#[cfg(feature = "surface")]
mod depth;
mod error;
mod memory;
mod options;
mod photo_store;
mod plan;
mod planning;
mod retention;
mod scene_photos;
mod scene_synthesizer;
mod scene_views;
mod shot;
mod target;

#[cfg(feature = "surface")]
pub use crate::surface::{PhotoCorrection, TargetSurface};
#[cfg(feature = "surface")]
pub use depth::depth_search::{DepthSearch, FoundDepth};
#[cfg(feature = "surface")]
pub use depth::scene_depth::{DepthProgress, DepthSource, ViewDepth};
pub use error::SynthesisError;
pub use options::{DEFAULT_VIEWS, Model, ModelOptions, Options};
pub use plan::Plan;
pub use scene_photos::ScenePhotos;
pub use scene_synthesizer::Synthesizer;
pub use scene_views::SceneViews;
pub use shot::{LoadedShot, Shot};
pub use target::{Target, TargetCamera, Targets};
