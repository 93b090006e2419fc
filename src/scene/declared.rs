//! Views as a format's files declare them.

use std::path::PathBuf;

use glam::{DMat3, DVec3};

use super::photo_source::Photo;
use super::undistort::Distortion;
use crate::geometry::{Intrinsics, Size};

/// The size a format's intrinsics are for, in pixels.
#[derive(Clone, Copy)]
pub(super) enum DeclaredSize {
    /// The photo's own.
    Actual,
    /// Declared; the photo must have it.
    Exactly(Size),
    /// Declared; a photo resampled to another size is fine, K follows it.
    Scaled(Size),
}

/// One view as its format declares it. The pose is `cam_from_world`, OpenCV axes; intrinsics in pixels of `size`.
pub(super) struct DeclaredView {
    pub(super) photo: Photo,
    pub(super) intrinsics: Intrinsics,
    pub(super) size: DeclaredSize,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) distortion: Distortion,
    /// Near and far, in scene units; an unusable range becomes a note.
    pub(super) depth_range: Option<(f64, f64)>,
}

/// What a format's reader hands back.
pub(super) struct DeclaredViews {
    /// The file the cameras stand in, for messages.
    pub(super) cameras: PathBuf,
    pub(super) views: Vec<DeclaredView>,
    pub(super) notes: Vec<String>,
}
