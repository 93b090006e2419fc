//! Kinds of layers: how the layers of a first frame are found, and how each next frame reuses them.
//!
//! | file | layers | a next frame |
//! |---|---|---|
//! | `fixed` | `planes:D`, `list:…` | has the same |
//! | `selected` | `select:K/D` | has the planes that a frame on all of them selected |
//! | `guided` | `guided:L` | moves the surface with the camera, and refreshes it |
//! | `surface` | `surface:L` | refreshes the depth of the photos |
//!
//! The layers of a still picture are those of a first frame. A new kind implements [`LayerKind`] in
//! a file of its own and has an arm in [`find_layers`].

// Only `live`, which needs that feature, renders next frames of all kinds.
#![cfg_attr(not(feature = "surface"), allow(dead_code))]

mod carried_surface;
mod dirty_tiles;
mod fixed;
mod frame_input;
mod guided;
mod layer_kind;
mod layer_source;
mod selected;
mod selection;
#[cfg(feature = "surface")]
mod surface;
mod target_views;

#[cfg(feature = "surface")]
pub(crate) use dirty_tiles::{Region, dirty_regions};
#[cfg(feature = "surface")]
pub(crate) use frame_input::{DepthUpdate, PhotosWithDepth};
pub(crate) use frame_input::{FrameInput, FramePhotos};
pub(crate) use layer_kind::{FoundLayers, Reuse};
pub use layer_source::LayerSource;

use carried_surface::CarriedSurface;
use fixed::Fixed;
use guided::Guided;
use layer_kind::LayerKind;
use selected::Selected;
#[cfg(feature = "surface")]
use surface::AlongSurface;

use crate::layers::{LayerSpec, Layers, LayersError};

/// What next frames reuse, by kind of layers; fixed planes leave nothing.
#[derive(Default)]
pub(crate) struct Carried {
    selected: Option<Layers>,
    guided: Option<CarriedSurface>,
    #[cfg(feature = "surface")]
    surface: Option<()>,
}

impl Carried {
    /// Renders the next frames on these planes, selected from those of a frame.
    pub(crate) fn keep_selected(&mut self, planes: Layers) {
        self.selected = Some(planes);
    }
}

/// Finds the layers of a frame, and keeps what the next one reuses.
///
/// # Errors
///
/// Of the layers, and of the photos' depth.
pub(crate) fn find_layers<E: From<LayersError>>(
    spec: &LayerSpec,
    carried: &mut Carried,
    frame: &mut FrameInput<'_, E>,
    reuse: Reuse,
) -> Result<FoundLayers, E> {
    let (near, far) = (frame.near, frame.far);
    match *spec {
        LayerSpec::Planes(count) => Fixed(Layers::uniform(near, far, count)?).find(&mut None, frame, reuse),
        LayerSpec::List(ref list) => Fixed(Layers::planes(list)?).find(&mut None, frame, reuse),
        LayerSpec::Select { keep, from } => Selected { keep, from }.find(&mut carried.selected, frame, reuse),
        LayerSpec::Guided { layers, coarse_planes } => {
            Guided { layers, coarse_planes }.find(&mut carried.guided, frame, reuse)
        }
        #[cfg(feature = "surface")]
        LayerSpec::Surface(count) => AlongSurface { count }.find(&mut carried.surface, frame, reuse),
    }
}
