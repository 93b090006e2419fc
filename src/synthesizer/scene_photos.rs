//! The photos of a scene that are needed in memory, and their depth.

use std::fmt;
#[cfg(feature = "surface")]
use std::ops::ControlFlow;
#[cfg(feature = "surface")]
use std::path::Path;

#[cfg(feature = "surface")]
use super::depth::depth_search::{DepthSearch, FoundDepth};
#[cfg(feature = "surface")]
use super::depth::depth_store::DepthStore;
#[cfg(feature = "surface")]
use super::depth::scene_depth::{DepthProgress, ViewDepth};
use super::error::SynthesisError;
use super::photo_store::PhotoStore;
use super::retention::{KEPT_BYTES, Retention};
use super::scene_views::SceneViews;
use super::shot::{LoadedPhoto, LoadedShot, Shot};
#[cfg(feature = "surface")]
use crate::kinds::PhotosWithDepth;

/// The photos of a scene and their depth: what a shot needs is loaded, and dropped when no later
/// shot needs it.
pub struct ScenePhotos {
    pub(super) views: SceneViews,
    pub(super) photos: PhotoStore,
    #[cfg(feature = "surface")]
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
    pub const KEPT_BYTES: usize = KEPT_BYTES;

    /// The photos of these views, of which none is loaded yet.
    pub fn new(views: SceneViews) -> Self {
        let photos = PhotoStore::new(views.scene().views.len());
        Self {
            views,
            photos,
            #[cfg(feature = "surface")]
            depths: DepthStore::default(),
            retention: Retention::new(),
        }
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
        self.retention.drop_unneeded(
            scene.views.len(),
            shot,
            later,
            &mut self.photos,
            #[cfg(feature = "surface")]
            &mut self.depths,
        );
        let views: Vec<usize> = shot.photos().collect();
        let photo = |(&view, texture)| LoadedPhoto { view, camera: scene.views[view].camera.clone(), texture };
        let photos = views.iter().zip(self.photos.load(scene, &views)?).map(photo).collect();
        Ok(LoadedShot::new(shot.clone(), photos))
    }
}

#[cfg(feature = "surface")]
impl ScenePhotos {
    /// Keeps the depth of photos in a folder, one file each, and reads from there what an earlier
    /// run has kept; pictures stay the same, bit for bit. The folder is created if there is none.
    ///
    /// A file `<digest>.npz` holds the arrays `disparity` (float32 `[h, w]`, 1/scene unit), `pixel`
    /// (float32, the disparity that is worth a pixel of parallax) and `key` (uint8 `[32]`): the
    /// SHA-256 of the photo's and its neighbours' pixels and cameras, the depth range and the
    /// settings. Any file may be deleted; a damaged one is reported by [`Self::take_notes`] and
    /// written again.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Cache`] if files cannot be written there.
    pub fn keep_depths_in(&mut self, folder: &Path) -> Result<(), SynthesisError> {
        self.depths.keep_in(folder, self.views.scene().views.len())
    }

    /// Calls `progress` before each search for the depth of a photo, which takes a second or so of a
    /// large one. Where it returns [`ControlFlow::Break`], there are no more searches, and what
    /// needed the depth returns [`SynthesisError::Cancelled`]; depths found so far are kept.
    pub fn on_depth_search(&mut self, progress: impl FnMut(DepthProgress<'_>) -> ControlFlow<()> + Send + 'static) {
        self.depths.set_progress(Box::new(progress));
    }

    /// What went wrong with files of the folder of depths since the last call, a line each; nothing
    /// else depends on it.
    pub fn take_notes(&mut self) -> Vec<String> {
        self.depths.take_notes()
    }

    /// The views of a shot whose photos' depth is not known: rendering it along the surface searches
    /// them.
    pub fn unknown_depths(&self, shot: &Shot) -> Vec<usize> {
        self.depths.unknown(&shot.photos().collect::<Vec<_>>(), &shot.held_out)
    }

    /// The search for the depth of a view's photo, to be run on another thread while pictures are
    /// rendered, and given to [`Self::insert_depth`]; `None` if the depth is known. The result is
    /// the same as where it is searched when it is needed. With the views of the shot held out; what is
    /// found is compared with the depths that are known of the shot's photos, so that its plan takes less
    /// time.
    ///
    /// # Errors
    ///
    /// Those of [`SceneViews::depth_range`].
    ///
    /// # Panics
    ///
    /// If there is no such view, or it is held out.
    pub fn depth_search(&mut self, view: usize, shot: &Shot) -> Result<Option<DepthSearch>, SynthesisError> {
        self.depths.search(&self.views, &self.photos, view, shot)
    }

    /// Takes what a search found, unless other views are held out now.
    pub fn insert_depth(&mut self, found: FoundDepth) {
        self.depths.insert(&mut self.photos, found);
    }

    /// The photos of a shot with their depth. The depth of a photo is searched when it is first
    /// needed, over the depth range of all views that are not held out, and kept.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; those of
    /// [`SceneViews::depth_range`].
    pub(super) fn with_depth<'a>(&'a mut self, shot: &'a LoadedShot) -> Result<PhotosWithDepth<'a>, SynthesisError> {
        self.depths.with_depth(&self.views, &mut self.photos, shot)
    }

    /// The depth of a view's photo, and what its neighbours confirm of it. A depth that is known is
    /// not searched again as long as the same views are held out. Photos that none of the `later`
    /// views needs are dropped, and so are depths, of which [`Self::KEPT_BYTES`] stay.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read; those of
    /// [`SceneViews::depth_range`]; [`SynthesisError::Cancelled`].
    ///
    /// # Panics
    ///
    /// If there is no such view, or it is held out.
    pub fn view_depth(
        &mut self,
        view: usize,
        held_out: &[usize],
        later: &[usize],
    ) -> Result<ViewDepth, SynthesisError> {
        let kept = (later, self.retention.bytes);
        self.depths.view_depth(&self.views, &mut self.photos, view, held_out, kept)
    }
}
