//! The viewpoint of a video: the target camera of each frame.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use liveview::geometry::CameraPath;
use liveview::{Camera, SceneViews};
use liveview_common::args::targets::cameras_of;

const HEADING: &str = "Viewpoint (one of these)";

/// Options that set the viewpoint; exactly one is given.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub(super) struct ViewpointArgs {
    /// Camera of the rig, by name: held out, and, without --latency, used to score the frames
    #[arg(long, value_name = "NAME", help_heading = HEADING)]
    camera: Option<String>,
    /// Path of N frames: line:N back and forth, circle:N or spiral:N repeated
    #[arg(long, value_name = "SHAPE:N", help_heading = HEADING)]
    path: Option<CameraPath>,
    /// JSON file with a camera for each frame, as for `render --pose`; the last one is repeated
    #[arg(long, value_name = "FILE", help_heading = HEADING)]
    poses: Option<PathBuf>,
}

/// The target camera of each frame.
pub(super) struct Viewpoint {
    cameras: Vec<Camera>,
    repeat: Repeat,
    /// Index of the held-out camera, the ground truth.
    pub(super) truth: Option<usize>,
}

/// What follows the last camera.
enum Repeat {
    /// The first one.
    Cycle,
    /// The path in reverse.
    Reverse,
    /// The last one again.
    Last,
}

impl Viewpoint {
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

impl ViewpointArgs {
    /// The file of `--poses`.
    pub(super) fn poses(&self) -> Option<&Path> {
        self.poses.as_deref()
    }

    /// The cameras of the frames.
    pub(super) fn resolve(&self, views: &SceneViews) -> Result<Viewpoint> {
        let Self { camera, path, poses } = self;
        let viewpoint = match (camera, path, poses) {
            (Some(name), ..) => {
                let view = views.scene().view_index(name)?;
                let camera = views.scene().views[view].camera.clone();
                Viewpoint { cameras: vec![camera], repeat: Repeat::Last, truth: Some(view) }
            }
            (_, Some(path), _) => {
                let repeat = if path.is_closed() { Repeat::Cycle } else { Repeat::Reverse };
                Viewpoint { cameras: path.cameras(&views.all_cameras())?, repeat, truth: None }
            }
            (.., Some(file)) => Viewpoint { cameras: cameras_of(file, views)?, repeat: Repeat::Last, truth: None },
            (None, None, None) => bail!("expected --camera, --path or --poses"),
        };
        let size = |camera: &Camera| (camera.width(), camera.height());
        if viewpoint.cameras.iter().any(|camera| size(camera) != size(&viewpoint.cameras[0])) {
            bail!("the cameras of the viewpoint have different sizes; expected one size for the whole video");
        }
        Ok(viewpoint)
    }
}
