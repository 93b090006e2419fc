//! What a target is rendered from: its views and depth range, and their photos in memory.

use std::sync::Arc;

use liveview::geometry::Camera;
use liveview::layers::{LayersError, padded};
use liveview::warp::{SourceView, Texture, warp_sources};
use liveview_scene::{Scene, SceneError};
use liveview_surface::guided::{GuidedSearch, SearchStages};

/// A target with its views and its depth range.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Its name.
    pub name: String,
    /// Its camera.
    pub target: Camera,
    /// Index of the view that is its ground truth.
    pub truth: Option<usize>,
    /// Indices of the views to render from, nearest first.
    pub views: Vec<usize>,
    /// Indices of further views whose depth its surface is fused from, nearest first; none where the
    /// photos' depth is not used.
    pub helpers: Vec<usize>,
    /// Indices of the views that must not be used, not even for depth.
    pub held_out: Vec<usize>,
    /// Whether planes lie only where the target sees something of the range, if the photos' depth is
    /// known.
    pub refines_range: bool,
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
}

impl Shot {
    /// Indices of the views whose photos it needs: those to render from, then the helpers.
    pub(super) fn photos(&self) -> impl Iterator<Item = usize> {
        self.views.iter().chain(&self.helpers).copied()
    }
}

/// A shot with its photos in memory: what a plan is found from, and rendered from.
#[derive(Debug, Clone)]
pub struct LoadedShot {
    pub(super) shot: Shot,
    /// Of the shot's views, then of its helpers.
    pub(super) photos: Vec<LoadedPhoto>,
}

/// The photo of a view, in memory.
#[derive(Debug, Clone)]
pub(super) struct LoadedPhoto {
    /// Index of the view in the scene.
    pub(super) view: usize,
    pub(super) camera: Camera,
    pub(super) texture: Arc<Texture>,
}

impl LoadedPhoto {
    /// The photo of a view, read from its file unless its texture is in memory.
    pub(super) fn read(scene: &Scene, view: usize, texture: Option<&Arc<Texture>>) -> Result<Self, SceneError> {
        let texture = match texture {
            Some(texture) => Arc::clone(texture),
            None => Arc::new(Texture::new(&scene.load_image(view)?)),
        };
        Ok(Self { view, camera: scene.views[view].camera.clone(), texture })
    }

    /// The photo as warp and searches take it.
    pub(super) fn source(&self) -> SourceView<'_> {
        SourceView { camera: &self.camera, texture: &self.texture }
    }
}

impl LoadedShot {
    /// The shot.
    pub fn shot(&self) -> &Shot {
        &self.shot
    }

    /// The views to render from, nearest first.
    pub fn sources(&self) -> Vec<SourceView<'_>> {
        self.photos.iter().take(self.shot.views.len()).map(LoadedPhoto::source).collect()
    }

    /// The guided search, with a number of planes in the first search or by the parallax.
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for no planes; [`LayersError::Range`] unless 0 < near < far.
    pub fn search(&self, coarse_planes: Option<usize>) -> Result<SearchStages, LayersError> {
        let Shot { target, near, far, .. } = &self.shot;
        let search = GuidedSearch { near: *near, far: *far, planes: coarse_planes };
        search.search(&warp_sources(&self.sources(), target), padded(target.size()))
    }
}
