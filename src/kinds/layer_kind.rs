//! The trait of a kind of layers.

use super::frame_input::FrameInput;
use super::layer_source::LayerSource;
use super::selection::Selection;
use crate::layers::guided::RangeMap;
use crate::layers::{Layers, LayersError};
#[cfg(feature = "surface")]
use crate::surface::TargetSurface;

/// What a frame reuses of the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reuse {
    /// Nothing: its layers are searched again.
    Nothing,
    /// All, whatever the photos show.
    All,
    /// All but what the photos contradict, which is searched again.
    Refreshed,
}

/// The layers of a frame.
pub(crate) struct FoundLayers {
    /// The layers, near → far.
    pub(crate) layers: Layers,
    /// Where they came from.
    pub(crate) source: LayerSource,
    /// How planes are selected from these once a frame is rendered on them.
    pub(crate) selection: Option<Selection>,
    /// The range of disparities of each cell, for guided layers.
    pub(crate) range: Option<RangeMap>,
    /// The surface and its per-view occlusion, for surface layers.
    #[cfg(feature = "surface")]
    pub(crate) surface: Option<TargetSurface>,
}

impl FoundLayers {
    /// Layers without anything else.
    pub(super) fn new(layers: Layers, source: LayerSource) -> Self {
        Self {
            layers,
            source,
            selection: None,
            range: None,
            #[cfg(feature = "surface")]
            surface: None,
        }
    }
}

/// The layers of a frame, and what the next one reuses of it.
pub(super) type Found<C, E> = Result<(FoundLayers, Option<C>), E>;

/// A kind of layers.
pub(super) trait LayerKind: Sized {
    /// What a next frame reuses.
    type Carried;

    /// The layers of a frame that reuses nothing, and what the next one reuses of it.
    fn first<E: From<LayersError>>(self, frame: &mut FrameInput<'_, E>) -> Found<Self::Carried, E>;

    /// The layers of the frame after one that left `carried`; with `refresh`, what the photos
    /// contradict of it is searched again.
    fn next<E: From<LayersError>>(
        self,
        carried: Self::Carried,
        frame: &mut FrameInput<'_, E>,
        refresh: bool,
    ) -> Found<Self::Carried, E>;

    /// The layers of a frame: of a next one where there is something to reuse, else of a first one.
    fn find<E: From<LayersError>>(
        self,
        carried: &mut Option<Self::Carried>,
        frame: &mut FrameInput<'_, E>,
        reuse: Reuse,
    ) -> Result<FoundLayers, E> {
        let (found, left) = match carried.take().filter(|_| reuse != Reuse::Nothing) {
            Some(carried) => self.next(carried, frame, reuse == Reuse::Refreshed)?,
            None => self.first(frame)?,
        };
        *carried = left;
        Ok(found)
    }
}
