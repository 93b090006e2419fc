//! What to render: held-out views, poses from a file, or a path.

use std::fmt;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use liveview::geometry::Camera;

use super::path::CameraPath;
use super::pose;
use super::setup::Photos;

/// Options that say what to render; exactly one.
#[derive(Debug, Args)]
#[command(next_help_heading = "What to render (one of these)")]
#[group(required = true, multiple = false)]
pub(super) struct TargetArgs {
    /// A view of the scene, by name; it is held out: never rendered from. Several are held out together
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    target: Vec<String>,
    /// Every Nth view in name order, from the first on, each rendered from those not held out (the LLFF protocol)
    #[arg(long, value_name = "N", value_parser = super::count)]
    heldout: Option<usize>,
    /// Camera in a JSON file: {"transform_matrix": 4x4 world from camera, OpenGL axes} or {"cam_from_world": 3x4 or 4x4,
    /// OpenCV axes}, with fl_x, fl_y, cx, cy, w, h if they differ from those of the nearest view; or a list of such, one
    /// per frame
    #[arg(long, value_name = "FILE")]
    pose: Option<PathBuf>,
    /// A path of N frames: line:N between the two outermost views, circle:N or spiral:N around the middle of the rig, turning as
    /// the views do
    #[arg(long, value_name = "SHAPE:N")]
    path: Option<CameraPath>,
}

/// A camera to render, and the view that shows the truth, if there is one.
pub(super) struct Target {
    pub(super) name: String,
    pub(super) camera: Camera,
    pub(super) truth: Option<usize>,
}

/// What to render.
pub(super) struct Targets {
    pub(super) list: Vec<Target>,
    /// Views that must not be rendered from.
    pub(super) held_out: Vec<usize>,
    /// Whether they are the frames of one path.
    pub(super) moving: bool,
}

/// As on the command line.
impl fmt::Display for TargetArgs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self { heldout: Some(step), .. } => write!(f, "--heldout {step}"),
            Self { pose: Some(file), .. } => write!(f, "--pose {}", file.display()),
            Self { path: Some(path), .. } => write!(f, "--path {path}"),
            Self { target, .. } => write!(f, "--target {}", target.join(",")),
        }
    }
}

impl TargetArgs {
    /// Whether there will be photos to compare with.
    pub(super) fn have_truth(&self) -> bool {
        self.pose.is_none() && self.path.is_none()
    }

    /// The targets.
    pub(super) fn resolve(&self, photos: &Photos) -> Result<Targets> {
        let frames = |cameras: Vec<Camera>, name: &str, moving| {
            let named = |index| if moving { format!("{name}_{index:04}") } else { name.to_owned() };
            let target = |(index, camera)| Target { name: named(index), camera, truth: None };
            Targets { list: cameras.into_iter().enumerate().map(target).collect(), held_out: Vec::new(), moving }
        };
        if let Some(file) = &self.pose {
            let cameras = pose::read(file, photos)?;
            let moving = cameras.len() > 1;
            return Ok(frames(cameras, if moving { "frame" } else { "pose" }, moving));
        }
        if let Some(path) = &self.path {
            return Ok(frames(path.cameras(photos)?, "frame", true));
        }
        let views = match self.heldout {
            Some(1) => bail!("--heldout 1 holds out every view and leaves none to render from; expected 2 or more"),
            Some(step) => (0..photos.scene.views.len()).step_by(step).collect(),
            None => named(photos, &self.target)?,
        };
        if let Some(twice) = (1..views.len()).find(|&i| views[..i].contains(&views[i])) {
            bail!("--target names \"{}\" twice; expected each view once", photos.scene.views[views[twice]].name);
        }
        Ok(held_out(photos, views))
    }
}

/// The views of these names.
pub(super) fn named(photos: &Photos, names: &[String]) -> Result<Vec<usize>> {
    names.iter().map(|name| Ok(photos.scene.view_index(name)?)).collect()
}

/// These views as targets, each with the truth.
pub(super) fn held_out(photos: &Photos, views: Vec<usize>) -> Targets {
    let target = |&view: &usize| {
        let found = &photos.scene.views[view];
        Target { name: found.name.clone(), camera: found.camera.clone(), truth: Some(view) }
    };
    Targets { list: views.iter().map(target).collect(), held_out: views, moving: false }
}
