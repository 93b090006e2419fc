//! Kinds of layers: how the layers of a first frame are found, and how each next frame reuses them.
//!
//! | file | layers | a next frame |
//! |---|---|---|
//! | | `planes:D`, `list:…` | has the same |
//! | `selected` | `select:K/D` | has the planes that a frame on all of them selected |
//! | `guided` | `guided:L` | moves the surface with the camera, and refreshes it |
//! | `surface` | `surface:L` | refreshes the depth of the photos |
//!
//! The layers of a still picture are those of a first frame. A new kind has an arm in
//! [`find_layers`], and a file of its own unless its planes are known beforehand.

// Only `live`, which needs that feature, renders next frames of all kinds.
#![cfg_attr(not(feature = "surface"), allow(dead_code))]

mod carried_surface;
mod dirty_tiles;
mod found_layers;
mod frame_input;
mod guided;
mod layer_source;
mod selected;
mod selection;
#[cfg(feature = "surface")]
mod surface;
mod target_views;

#[cfg(feature = "surface")]
pub(crate) use dirty_tiles::{Region, dirty_regions};
pub(crate) use found_layers::{FoundLayers, Reuse};
pub(crate) use frame_input::FrameInput;
#[cfg(feature = "surface")]
pub(crate) use frame_input::PhotosWithDepth;
pub use layer_source::LayerSource;

use crate::layers::{LayerSpec, Layers, LayersError};
use carried_surface::CarriedSurface;

/// What next frames reuse, by kind of layers; fixed planes leave nothing.
#[derive(Default)]
pub(crate) struct Carried {
    /// Planes that an earlier frame selected.
    pub(crate) selected: Option<Layers>,
    guided: Option<CarriedSurface>,
    /// Whether the depth of the photos is that of an earlier frame.
    #[cfg(feature = "surface")]
    has_depth: bool,
}

/// Finds the layers of a frame, and keeps what the next one reuses. `with_depth` returns the photos for
/// surface layers: their depth is searched where there is none yet and where `reuse` says (all of it,
/// none, or where a photo has changed since).
///
/// # Errors
///
/// Of the layers, and of the photos' depth.
pub(crate) fn find_layers<'a, E: From<LayersError>>(
    spec: &LayerSpec,
    carried: &mut Carried,
    frame: &FrameInput<'a>,
    reuse: Reuse,
    #[cfg(feature = "surface")] with_depth: impl FnOnce(Reuse) -> Result<PhotosWithDepth<'a>, E>,
) -> Result<FoundLayers, E> {
    let (near, far) = (frame.near, frame.far);
    Ok(match *spec {
        LayerSpec::Planes(count) => FoundLayers::new(Layers::uniform(near, far, count)?, LayerSource::Fixed),
        LayerSpec::List(ref list) => FoundLayers::new(Layers::planes(list)?, LayerSource::Fixed),
        LayerSpec::Select { keep, from } => {
            carried.selected = carried.selected.take().filter(|_| reuse != Reuse::Nothing);
            match &carried.selected {
                Some(planes) => FoundLayers::new(planes.clone(), LayerSource::Selected),
                None => selected::all_planes(near, far, from, keep)?,
            }
        }
        LayerSpec::Guided { layers, coarse_planes } => {
            guided::find((layers, coarse_planes), &mut carried.guided, frame, reuse)?
        }
        #[cfg(feature = "surface")]
        LayerSpec::Surface(count) => {
            let reuse = if carried.has_depth { reuse } else { Reuse::Nothing };
            let found = surface::find(count, frame, with_depth(reuse)?)?;
            carried.has_depth = true;
            found
        }
    })
}
