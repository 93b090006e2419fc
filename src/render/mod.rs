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
mod corrected_photos;
mod frame;
mod renderer;
mod visibility;

use std::fmt;

pub use blend::{Blended, DistanceWeights, LayerSamples};
pub use buffers::Batch;
pub use composite::Accumulated;
pub use composite_competing::Competing;
pub use corrected_photos::ViewCorrection;
pub use frame::{Frame, StageTimes};
pub use renderer::Renderer;
pub use visibility::{Visibility, occluded};

use crate::geometry::Camera;
use crate::layers::Layers;
use crate::network::NetworkError;
use crate::warp::SourceView;

/// Is shown the stages of the rendered layers, batch by batch, near → far.
pub type Observer<'a> = &'a mut dyn FnMut(&Batch<'_>);

/// What to render: a target, the views that it is made from, and the layers between them.
pub struct RenderRequest<'a> {
    /// As many views as the network takes, nearest first ([`crate::geometry::choose_views`]).
    pub views: &'a [SourceView<'a>],
    /// The camera to render.
    pub target: &'a Camera,
    /// The layers; maps among them are on the cells of the padded target
    /// ([`crate::layers::padded`]).
    pub layers: &'a Layers,
    /// How the photos of the views are corrected, in the order of the views; empty: not at all.
    pub corrections: &'a [ViewCorrection],
    /// Occlusion of the views, in the same order; `None`: no view is ever occluded.
    pub visibility: Option<&'a Visibility<'a>>,
    /// Is shown the stages of the rendered layers.
    pub observer: Option<Observer<'a>>,
}

impl<'a> RenderRequest<'a> {
    /// A request without photo correction, per-view occlusion and observer.
    pub fn new(views: &'a [SourceView<'a>], target: &'a Camera, layers: &'a Layers) -> Self {
        Self { views, target, layers, corrections: &[], visibility: None, observer: None }
    }
}

impl fmt::Debug for RenderRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RenderRequest")
            .field("views", &self.views.len())
            .field("target", &self.target)
            .field("layers", &self.layers.len())
            .field("corrections", &self.corrections)
            .field("visibility", &self.visibility.is_some())
            .finish_non_exhaustive()
    }
}

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The views are more or fewer than the network takes.
    #[error("the network takes {expected} views, but {found} were given")]
    Views {
        /// V of the network.
        expected: usize,
        /// The number of views given.
        found: usize,
    },
    /// The buffers of the layers cannot be allocated.
    #[error("rendering takes about {} MB of memory, which cannot be had; expected a smaller target or fewer layers at once", bytes / 1_000_000)]
    Memory {
        /// Bytes of the buffers.
        bytes: usize,
    },
    /// The network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
}
