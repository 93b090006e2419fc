//! The viewpoint of a video: the target camera of each frame.

use anyhow::{Result, bail};
use liveview::Camera;
use liveview_scene::cameras::CameraPath;
use liveview_synthesizer::SceneViews;

/// The target camera of each frame.
#[derive(Debug)]
pub struct Viewpoint {
    cameras: Vec<Camera>,
    repeat: Repeat,
    /// Index of the held-out camera, the ground truth.
    pub truth: Option<usize>,
}

/// What follows the last camera.
#[derive(Debug)]
enum Repeat {
    /// The first one.
    Cycle,
    /// The path in reverse.
    Reverse,
    /// The last one again.
    Last,
}

impl Viewpoint {
    /// That of a camera of the rig, which is held out.
    pub fn of_camera(views: &SceneViews, view: usize) -> Self {
        Self { cameras: vec![views.scene().views[view].camera.clone()], repeat: Repeat::Last, truth: Some(view) }
    }

    /// Along a path, repeated or back and forth.
    pub fn along(path: CameraPath, views: &SceneViews) -> Result<Self> {
        let repeat = if path.is_closed() { Repeat::Cycle } else { Repeat::Reverse };
        Self { cameras: path.cameras(&views.all_cameras())?, repeat, truth: None }.of_one_size()
    }

    /// Of a camera for each frame; the last one is repeated.
    pub fn through(cameras: Vec<Camera>) -> Result<Self> {
        Self { cameras, repeat: Repeat::Last, truth: None }.of_one_size()
    }

    fn of_one_size(self) -> Result<Self> {
        if self.cameras.iter().any(|camera| camera.size() != self.cameras[0].size()) {
            bail!("the cameras of the viewpoint have different sizes; expected one size for the whole video");
        }
        Ok(self)
    }

    /// The camera of a time step.
    pub(super) fn camera(&self, step: usize) -> &Camera {
        let count = self.cameras.len();
        &self.cameras[match self.repeat {
            Repeat::Cycle => step % count,
            Repeat::Last => step.min(count - 1),
            Repeat::Reverse => {
                let index = step % (2 * count - 2).max(1);
                if index < count { index } else { 2 * count - 2 - index }
            }
        }]
    }

    /// All target cameras.
    pub(super) fn cameras(&self) -> &[Camera] {
        &self.cameras
    }
}
