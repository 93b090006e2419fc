//! What layers are found from: a target and photos, of a scene or of a rig's time step.

use crate::geometry::Camera;
#[cfg(feature = "surface")]
use crate::surface::{DepthMaps, PhotoCorrection};
use crate::warp::SourceView;

/// What the layers of a frame are found from.
pub(crate) struct FrameInput<'a> {
    /// The camera to render.
    pub(crate) target: &'a Camera,
    /// Nearest depth, scene units.
    pub(crate) near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub(crate) far: f64,
    /// The V views that the frame is rendered from, nearest first.
    pub(crate) sources: &'a [SourceView<'a>],
    /// Whether a next frame follows, which reuses what it can.
    pub(crate) is_followed: bool,
    /// Which differences between photos are corrected, for surface layers.
    #[cfg(feature = "surface")]
    pub(crate) photo_correction: PhotoCorrection,
    /// Whether holes of a surface are searched at the target.
    #[cfg(feature = "surface")]
    pub(crate) searches_holes: bool,
}

/// The photos that a frame is rendered from and some further ones near the target, with their depth.
#[cfg(feature = "surface")]
pub(crate) struct PhotosWithDepth<'a> {
    /// The depth of all photos of the scene or rig.
    pub(crate) maps: &'a mut DepthMaps,
    /// Indices among the maps, with camera and photo: those to render from first, nearest first.
    pub(crate) photos: Vec<(usize, SourceView<'a>)>,
    /// How many of them the frame is rendered from.
    pub(crate) rendered_from: usize,
    /// Mean share of a photo that was searched, 0 to 1.
    pub(crate) searched: f64,
}
