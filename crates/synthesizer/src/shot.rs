//! Targets (a held-out view, a camera, or the frames of a path), and what each is rendered from: its views
//! and depth range, and their photos in memory.

use std::sync::Arc;

use crate::SynthesisError;
use liveview::Camera;
use liveview::warp::{SourceView, Texture};
use liveview_scene::cameras::{CameraPath, CameraPathError, interpolated_path};
use liveview_scene::{Scene, SceneError};

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
    pub(crate) fn photos(&self) -> impl Iterator<Item = usize> {
        self.views.iter().chain(&self.helpers).copied()
    }
}

/// A shot with its photos in memory: what a plan is found from, and rendered from.
#[derive(Debug, Clone)]
pub struct LoadedShot {
    pub(crate) shot: Shot,
    /// Of the shot's views, then of its helpers.
    pub(crate) photos: Vec<LoadedPhoto>,
}

/// The photo of a view, in memory.
#[derive(Debug, Clone)]
pub(crate) struct LoadedPhoto {
    /// Index of the view in the scene.
    pub(crate) view: usize,
    pub(crate) camera: Camera,
    pub(crate) texture: Arc<Texture>,
}

impl LoadedPhoto {
    /// The photo of a view, read from its file unless its texture is in memory.
    pub(crate) fn read(scene: &Scene, view: usize, texture: Option<&Arc<Texture>>) -> Result<Self, SceneError> {
        let texture = match texture {
            Some(texture) => Arc::clone(texture),
            None => Arc::new(Texture::new(&scene.load_image(view)?)),
        };
        Ok(Self { view, camera: scene.views[view].camera.clone(), texture })
    }

    /// The photo as warp and searches take it.
    pub(crate) fn source(&self) -> SourceView<'_> {
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
}

/// One target to render.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Target {
    /// A view of the scene, by name ([`Scene::view_index`]); it is rendered from the others.
    HeldOut(String),
    /// A camera.
    Camera(Camera),
}

impl Target {
    /// The view of that name, rendered from the others.
    pub fn held_out(name: impl Into<String>) -> Self {
        Self::HeldOut(name.into())
    }
}

/// A target's name and camera, and the view that is its ground truth, if there is one.
#[derive(Debug, Clone)]
pub struct TargetCamera {
    /// Its name.
    pub name: String,
    /// Its camera.
    pub camera: Camera,
    /// Index of the view that is its ground truth.
    pub truth: Option<usize>,
}

/// All targets of a job.
#[derive(Debug, Clone)]
pub struct Targets {
    /// In order.
    pub list: Vec<TargetCamera>,
    /// Indices of the views that no target is rendered from.
    pub held_out: Vec<usize>,
    /// Whether the targets are the frames of one path.
    pub moving: bool,
}

impl Targets {
    /// These views, each its own ground truth; all of them are held out.
    ///
    /// # Panics
    ///
    /// If there is no such view.
    pub fn held_out(scene: &Scene, views: Vec<usize>) -> Self {
        let target = |&view: &usize| {
            let found = &scene.views[view];
            TargetCamera { name: found.name.clone(), camera: found.camera.clone(), truth: Some(view) }
        };
        Self { list: views.iter().map(target).collect(), held_out: views, moving: false }
    }

    /// One camera, named `pose`, or several as the frames of a path, named `frame_0000` and so on.
    pub fn cameras(cameras: Vec<Camera>) -> Self {
        if cameras.len() > 1 { Self::frames(cameras) } else { Self::named(cameras, |_| "pose".to_owned(), false) }
    }

    /// The frames of a path around the views.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Path`] if the views' directions cancel each other out.
    ///
    /// # Panics
    ///
    /// If the scene has no views.
    pub fn path(scene: &Scene, path: CameraPath) -> Result<Self, SynthesisError> {
        let cameras: Vec<&Camera> = scene.views.iter().map(|view| &view.camera).collect();
        Ok(Self::frames(path.cameras(&cameras)?))
    }

    /// The frames of a path through these views in order ([`interpolated_path`]).
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Path`] if a frame's camera is not usable.
    ///
    /// # Panics
    ///
    /// If there are no views, or no such view.
    pub fn through(scene: &Scene, views: &[usize], frames: usize) -> Result<Self, SynthesisError> {
        let cameras: Vec<&Camera> = views.iter().map(|&view| &scene.views[view].camera).collect();
        Ok(Self::frames(interpolated_path(&cameras, frames).map_err(CameraPathError::from)?))
    }

    fn frames(cameras: Vec<Camera>) -> Self {
        Self::named(cameras, |index| format!("frame_{index:04}"), true)
    }

    fn named(cameras: Vec<Camera>, name: impl Fn(usize) -> String, moving: bool) -> Self {
        let target = |(index, camera)| TargetCamera { name: name(index), camera, truth: None };
        Self { list: cameras.into_iter().enumerate().map(target).collect(), held_out: Vec::new(), moving }
    }
}
