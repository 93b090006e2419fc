//! Targets: a held-out view, a camera, or the frames of a path.

use liveview::Camera;
use liveview_scene::Scene;
use liveview_scene::cameras::{CameraPath, CameraPathError, interpolated_path};

use crate::error::SynthesisError;

/// One target to render.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Target {
    /// A view of the scene, by name; it is rendered from the others.
    HeldOut(String),
    /// A camera.
    Camera(Camera),
}

impl Target {
    /// The view of that name ([`Scene::view_index`]), rendered from the others.
    pub fn held_out(name: impl Into<String>) -> Self {
        Self::HeldOut(name.into())
    }

    /// Any camera.
    pub fn camera(camera: Camera) -> Self {
        Self::Camera(camera)
    }

    pub(super) fn resolve(&self, scene: &Scene) -> Result<Targets, SynthesisError> {
        Ok(match self {
            Self::HeldOut(name) => Targets::held_out(scene, vec![scene.view_index(name)?]),
            Self::Camera(camera) => Targets::cameras(vec![camera.clone()]),
        })
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
