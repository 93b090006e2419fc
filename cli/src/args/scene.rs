//! Options for the scene.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use liveview::{Scene, SceneOptions, SceneViews};

use super::ADVANCED;
use super::numbers;

/// Options for the scene and its depth range.
#[derive(Debug, Args)]
pub(crate) struct SceneArgs {
    /// Scene folder (transforms.json, Blender, COLMAP, LLFF, RealEstate10K or Spaces), or a transforms.json
    scene: PathBuf,
    /// Scale wider photos down to this width
    #[arg(long, value_name = "PIXELS", value_parser = numbers::count)]
    width: Option<usize>,
    /// Nearest depth, in scene units [default: from the scene, else found from the photos]
    #[arg(long, value_name = "DEPTH", allow_negative_numbers = true, value_parser = numbers::depth)]
    near: Option<f64>,
    /// Farthest depth, in scene units, or inf [default: as the nearest]
    #[arg(long, value_name = "DEPTH", allow_negative_numbers = true, value_parser = numbers::depth)]
    far: Option<f64>,
    /// Photo folder of a scene, such as images_4 [default: the format's usual ones]
    #[arg(long, value_name = "NAME", help_heading = ADVANCED, hide_short_help = true)]
    images: Option<String>,
    /// Rig position of a Spaces scene
    #[arg(long, value_name = "INDEX", default_value_t = 0, help_heading = ADVANCED, hide_short_help = true)]
    rig_position: usize,
}

impl SceneArgs {
    /// The scene folder.
    pub(crate) fn folder(&self) -> &Path {
        &self.scene
    }

    /// Options for opening the scene.
    pub(crate) fn options(&self) -> SceneOptions {
        let mut options = SceneOptions::default();
        options.width = self.width;
        options.images.clone_from(&self.images);
        options.rig_position = self.rig_position;
        options
    }

    /// The nearest and farthest depth given.
    pub(crate) fn depth(&self) -> (Option<f64>, Option<f64>) {
        (self.near, self.far)
    }

    /// Opens the scene.
    pub(crate) fn open(&self) -> Result<SceneViews> {
        Ok(self.with_depth(Scene::open(&self.scene, &self.options())?))
    }

    /// Opens the scene at this width, unless `--width` is given.
    pub(crate) fn open_at(&self, width: usize) -> Result<SceneViews> {
        let mut options = self.options();
        options.width = options.width.or(Some(width));
        Ok(self.with_depth(Scene::open(&self.scene, &options)?))
    }

    fn with_depth(&self, scene: Scene) -> SceneViews {
        SceneViews::new(scene, self.near, self.far)
    }
}
