//! The options of `liveview render`.

use clap::Args;

use super::explain::ExplainArgs;
use super::outputs::OutputArgs;
use super::summary::ScoreArgs;
use crate::args::help::ADVANCED;
use crate::args::layers::LayerArgs;
use crate::args::model::ModelArgs;
use crate::args::numbers::{self, FrameRange};
use crate::args::scene::{HoldoutArgs, SceneArgs, TargetArgs};

const SHORT_EXAMPLES: &str = "\
Examples:
  liveview render scene --target IMG_7.jpg -o new.png
  liveview render scene --path circle:120 -o flight.mp4

--help also lists the advanced options.";

const EXAMPLES: &str = "\
Examples:
  liveview render scene --target IMG_7.jpg -o new.png --compare compare.png
  liveview render scene --heldout 8 --layers guided:4 --compare compared/ --scores scores.csv
  liveview render scene --target IMG_7.jpg --layers planes:64 -o new.png --depth disparity.png
  liveview render scene --target IMG_7.jpg -o new.png --explain why.png
  liveview render scene --pose camera.json --near 1.5 --far 40 -o new.jpg
  liveview render scene --path circle:120 --layers select:16/64 --width 640 -o flight.mp4
  liveview render scene --path interpolate:300:a.jpg,b.jpg,c.jpg --fov 50 -o flight.mp4
  liveview render scene --path spiral:900 -o frames/
  liveview render scene --path spiral:900 -o frames/ --resume
  liveview render scene --path spiral:900 -o frames/ --frames 100:200";

/// Options of `liveview render`, in the order of the help.
#[derive(Debug, Args)]
#[command(after_help = SHORT_EXAMPLES, after_long_help = EXAMPLES)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    pub(super) targets: TargetArgs,
    /// Horizontal field of view of the pictures of --pose and --path [default: the photos']
    #[arg(long, value_name = "DEGREES", value_parser = numbers::field_of_view, conflicts_with_all = ["target", "heldout"])]
    pub(super) fov: Option<f64>,
    #[command(flatten)]
    pub(super) holdout: HoldoutArgs,
    #[command(flatten)]
    pub(super) output: OutputArgs,
    #[command(flatten)]
    pub(super) scores: ScoreArgs,
    #[command(flatten)]
    pub(super) layers: LayerArgs,
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    /// Render only the frames A up to but without B of the path, counted from 0: the share of one machine
    ///
    /// They are the same as in the whole path, and have the same names. Into a folder, they are
    /// recorded in liveview_A_B.json, so that several runs can write to one folder.
    #[arg(long, value_name = "A:B", value_parser = numbers::frame_range, conflicts_with_all = ["target", "heldout", "pose"])]
    #[arg(help_heading = ADVANCED, hide_short_help = true)]
    pub(super) frames: Option<FrameRange>,
    #[command(flatten)]
    pub(super) explain: ExplainArgs,
}
