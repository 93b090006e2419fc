//! Rendering: views, target and layers → target image (paper, section "Rendering the MPI").
//!
//! Layers are rendered near → far, a few at a time: the warp samples the views ([`crate::warp`]),
//! occluded samples are removed, the network gives opacity and view weights, the blend makes one
//! colour of those of the views, and the composite adds the layer behind those before it, or lets
//! the layers of a pixel compete.

mod blend;
mod buffers;
mod composite;
mod composite_competing;
mod composite_row;
mod corrected_photos;
mod error;
mod exp;
mod frame;
mod renderer;
mod request;
mod spacing;
mod visibility;

pub use blend::{Blended, DistanceWeights, LayerSamples};
pub use buffers::Batch;
pub use composite::Accumulated;
pub use composite_competing::Competing;
pub use corrected_photos::ViewCorrection;
#[cfg(feature = "surface")]
pub(crate) use corrected_photos::{SharpenedPhotos, correct_photos};
pub use error::RenderError;
pub use frame::{Frame, StageTimes};
pub use renderer::Renderer;
pub use request::{Observer, RenderRequest};
pub use visibility::Visibility;
#[cfg(feature = "surface")]
pub(crate) use visibility::hide_occluded;
