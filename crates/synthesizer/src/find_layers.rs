//! From the text of a choice of layers to the layers of a frame, and what the next frame reuses.
//!
//! | layers | a first frame | a next frame |
//! |---|---|---|
//! | `planes:D`, `list:…` | the planes | has the same |
//! | `select:K/D` | all planes | has those that a frame on all of them selected |
//! | `guided:L` | searches the target | moves the surface with the camera, and searches where it does not fit |
//! | `surface:L` | the depth of the photos | searches the depth of photos that have changed |
//!
//! The layers of a still picture are those of a first frame.

use std::fmt;

use liveview::geometry::Camera;
use liveview::layers::{Layers, LayersError, uniform_disparities};
use liveview::network::Alpha;
use liveview::render::Frame;
use liveview::warp::SourceView;
use liveview_surface::guided::{CarriedSurface, GuidedSearch, RangeMap, guided_range};
use liveview_surface::{DepthMaps, PhotoCorrection, Reuse, TargetSurface};

use crate::layer_spec::LayerSpec;
use crate::select_planes::select_planes;

/// What the layers of a frame are found from: a target and photos, of a scene or of a rig's time step.
#[derive(Debug)]
pub struct FrameInput<'a> {
    /// The camera to render.
    pub target: &'a Camera,
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// The V views that the frame is rendered from, nearest first.
    pub sources: &'a [SourceView<'a>],
    /// Whether a next frame follows, which reuses what it can.
    pub is_followed: bool,
    /// Which differences between photos are corrected, for surface layers.
    pub photo_correction: PhotoCorrection,
    /// Whether holes of a surface are searched at the target.
    pub searches_holes: bool,
}

/// The photos that a frame is rendered from and some further ones near the target, with their depth.
#[derive(Debug)]
pub struct PhotosWithDepth<'a> {
    /// The depth of all photos of the scene or rig.
    pub maps: &'a mut DepthMaps,
    /// Indices among the maps, with camera and photo: those to render from first, nearest first.
    pub photos: Vec<(usize, SourceView<'a>)>,
    /// How many of them the frame is rendered from.
    pub rendered_from: usize,
    /// Mean share of a photo that was searched, 0 to 1.
    pub searched: f64,
}

/// The layers of a frame.
#[derive(Debug)]
pub struct FoundLayers {
    /// The layers, near → far.
    pub layers: Layers,
    /// Where they came from.
    pub source: LayerSource,
    /// How planes are selected from these once a frame is rendered on them.
    pub selection: Option<Selection>,
    /// The range of disparities of each cell, for guided layers.
    pub range: Option<RangeMap>,
    /// The surface and its per-view occlusion, for surface layers.
    pub surface: Option<TargetSurface>,
}

impl FoundLayers {
    fn new(layers: Layers, source: LayerSource) -> Self {
        Self { layers, source, selection: None, range: None, surface: None }
    }
}

/// What next frames reuse, by kind of layers; fixed planes leave nothing.
#[derive(Debug, Default)]
pub struct Carried {
    /// Planes that an earlier frame selected.
    pub selected: Option<Layers>,
    guided: Option<CarriedSurface>,
    /// Whether the depth of the photos is that of an earlier frame.
    has_depth: bool,
}

/// Finds the layers of a frame, and keeps what the next one reuses. `with_depth` returns the photos for
/// surface layers: their depth is searched where there is none yet and where `reuse` says (all of it,
/// none, or where a photo has changed since).
///
/// # Errors
///
/// Of the layers, and of the photos' depth.
pub fn find_layers<'a, E: From<LayersError>>(
    spec: &LayerSpec,
    carried: &mut Carried,
    frame: &FrameInput<'a>,
    reuse: Reuse,
    with_depth: impl FnOnce(Reuse) -> Result<PhotosWithDepth<'a>, E>,
) -> Result<FoundLayers, E> {
    let (near, far) = (frame.near, frame.far);
    Ok(match *spec {
        LayerSpec::Planes(count) => FoundLayers::new(Layers::uniform(near, far, count)?, LayerSource::Fixed),
        LayerSpec::List(ref list) => FoundLayers::new(Layers::planes(list)?, LayerSource::Fixed),
        LayerSpec::Select { keep, from } => {
            carried.selected = carried.selected.take().filter(|_| reuse != Reuse::Nothing);
            if let Some(planes) = &carried.selected {
                FoundLayers::new(planes.clone(), LayerSource::Selected)
            } else {
                let disparities = uniform_disparities(near, far, from)?;
                let all = FoundLayers::new(Layers::planes(&disparities)?, LayerSource::Dense);
                FoundLayers { selection: Some(Selection { keep, disparities }), ..all }
            }
        }
        LayerSpec::Guided { layers, coarse_planes } => {
            let search = GuidedSearch { near, far, planes: coarse_planes };
            let carried = &mut carried.guided;
            let (range, searched) =
                guided_range(&search, carried, frame.sources, frame.target, reuse, frame.is_followed)?;
            let found = FoundLayers::new(range.layers(layers)?, LayerSource::propagated(searched));
            FoundLayers { range: Some(range), ..found }
        }
        LayerSpec::Surface(count) => {
            let photos = with_depth(if carried.has_depth { reuse } else { Reuse::Nothing })?;
            carried.has_depth = true;
            let PhotosWithDepth { maps, photos, rendered_from, searched } = photos;
            let (correction, searches_holes) = (frame.photo_correction, frame.searches_holes);
            let surface = TargetSurface::find(maps, &photos, rendered_from, frame.target, correction, searches_holes);
            let found = FoundLayers::new(surface.layers(count)?, LayerSource::propagated(searched));
            FoundLayers { surface: Some(surface), ..found }
        }
    })
}

/// A selection of planes, made once a frame has been rendered on all of them.
#[derive(Debug, Clone)]
pub struct Selection {
    /// Planes kept.
    keep: usize,
    /// Of all planes, 1/scene unit, near → far.
    disparities: Vec<f64>,
}

impl Selection {
    /// The planes that a frame rendered on all of them selects, given how its layers share a pixel.
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] if no plane is kept.
    pub fn planes(&self, frame: &Frame, alpha: Alpha) -> Result<Layers, LayersError> {
        let kept = select_planes(alpha, &frame.plane_histogram(self.disparities.len()), self.keep);
        let kept: Vec<f64> = kept.into_iter().map(|plane| self.disparities[plane]).collect();
        Layers::planes(&kept)
    }
}

/// Where the layers of a frame came from.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum LayerSource {
    /// The same planes for every frame.
    Fixed,
    /// All planes, from which those of the next frames are selected.
    Dense,
    /// The planes that an earlier frame selected.
    Selected,
    /// A search over the whole target, or, for surface layers, over all photos used.
    Searched,
    /// The surface or the depth of an earlier frame, but for a share of the target (of the photos
    /// used, for surface layers) that was searched again.
    Propagated {
        /// That share, 0 to 1.
        refreshed: f64,
    },
}

impl LayerSource {
    /// Propagated but for this share, 0 to 1.
    fn propagated(refreshed: f64) -> Self {
        if refreshed < 1.0 { Self::Propagated { refreshed } } else { Self::Searched }
    }
}

impl fmt::Display for LayerSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fixed => "fixed",
            Self::Dense => "dense",
            Self::Selected => "selected",
            Self::Searched => "searched",
            Self::Propagated { refreshed: 0.0 } => "propagated",
            Self::Propagated { .. } => "refreshed",
        })
    }
}
