//! Views as a format's files declare them.

use std::path::PathBuf;

use glam::{DMat3, DVec3};

use super::photos::source::Photo;
use super::undistort::Distortion;
use crate::geometry::{Camera, Intrinsics, Size};

/// The size a format's intrinsics are for, in pixels.
#[derive(Clone, Copy)]
pub(super) enum DeclaredSize {
    /// The photo's own size.
    Actual,
    /// A declared size that the photo must have.
    Exactly(Size),
    /// A declared size; if the photo was resampled to another size, K is scaled accordingly.
    Scaled(Size),
}

/// One view as its format declares it. The pose is `cam_from_world`, OpenCV axes; intrinsics are in
/// pixels of `size`.
pub(super) struct DeclaredView {
    pub(super) photo: Photo,
    pub(super) intrinsics: Intrinsics,
    pub(super) size: DeclaredSize,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) distortion: Distortion,
    /// Near and far depth in scene units; an invalid range is ignored with a note.
    pub(super) depth_range: Option<(f64, f64)>,
}

impl DeclaredView {
    /// The view of a photo of that size in memory.
    pub(super) fn of_photo(name: &str, size: Size, camera: &Camera) -> Self {
        Self {
            photo: Photo { name: name.to_owned(), path: name.into(), size, ignored: Vec::new() },
            intrinsics: camera.intrinsics(),
            size: DeclaredSize::Exactly(camera.size()),
            rotation: camera.rotation(),
            translation: camera.translation(),
            distortion: Distortion::default(),
            depth_range: None,
        }
    }
}

/// The result of a format's reader.
pub(super) struct DeclaredViews {
    /// The file that holds the cameras, for messages.
    pub(super) cameras: PathBuf,
    pub(super) views: Vec<DeclaredView>,
    pub(super) notes: Vec<String>,
}
