//! What to render.

use std::fmt;

use super::buffers::Batch;
use super::corrected_photos::ViewCorrection;
use super::visibility::Visibility;
use crate::geometry::Camera;
use crate::layers::Layers;
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
