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
mod error;
mod exp;
mod frame;
mod renderer;
mod request;
mod sharpened;
mod spacing;
mod visibility;

pub use blend::{Blended, DistanceWeights, LayerSamples};
pub use buffers::Batch;
pub use composite::Accumulated;
pub use composite_competing::Competing;
pub use error::RenderError;
pub use frame::{Frame, StageTimes};
pub use renderer::Renderer;
pub use request::{Observer, RenderRequest};
#[cfg(feature = "surface")]
pub(crate) use sharpened::SharpenedPhotos;
#[cfg(feature = "surface")]
pub(crate) use visibility::hide_occluded;
pub use visibility::{Visibility, VisibleView};
