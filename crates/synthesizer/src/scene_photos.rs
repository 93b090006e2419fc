//! The photos of a scene that are needed in memory, and their depth.

use std::fmt;

use super::depth::depth_store::DepthStore;
use super::error::SynthesisError;
use super::photo_store::PhotoStore;
use super::retention::{self, Retention};
use super::scene_views::SceneViews;
use super::shot::{LoadedShot, Shot};

/// The photos of a scene and their depth: what a shot needs is loaded, and dropped when no later
/// shot needs it.
pub struct ScenePhotos {
    pub(super) views: SceneViews,
    pub(super) photos: PhotoStore,
    pub(super) depths: DepthStore,
    pub(super) retention: Retention,
}

impl From<SceneViews> for ScenePhotos {
    fn from(views: SceneViews) -> Self {
        Self::new(views)
    }
}

impl fmt::Debug for ScenePhotos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let loaded = self.photos.loaded().count();
        f.debug_struct("ScenePhotos")
            .field("scene", &self.views.scene().root)
            .field("loaded", &loaded)
            .finish_non_exhaustive()
    }
}

impl ScenePhotos {
    /// Bytes of photos and depths that [`Self::load`] keeps beyond what the target and the next one
    /// need.
    pub const KEPT_BYTES: usize = retention::KEPT_BYTES;

    /// The photos of these views, of which none is loaded yet.
    pub fn new(views: SceneViews) -> Self {
        let photos = PhotoStore::new(views.scene().views.len());
        Self { views, photos, depths: DepthStore::default(), retention: Retention::new() }
    }

    /// The views, to choose among them.
    pub fn views(&self) -> &SceneViews {
        &self.views
    }

    /// Loads the photos of a shot of this scene. `later` are the shots that follow, in order: of
    /// the photos and depths in memory, those that the first of them needs stay, others within 128
    /// MiB, those needed sooner first; photos that no later shot needs are dropped.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read.
    pub fn load(&mut self, shot: &Shot, later: &[Shot]) -> Result<LoadedShot, SynthesisError> {
        let scene = self.views.scene();
        self.retention.drop_unneeded(shot, later, &mut self.photos, &mut self.depths);
        let views: Vec<usize> = shot.photos().collect();
        let photos = self.photos.load(scene, &views)?;
        Ok(LoadedShot { shot: shot.clone(), photos })
    }
}
