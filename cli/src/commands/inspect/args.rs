//! The options of `liveview inspect`.

use std::path::PathBuf;

use clap::Args;
use liveview_synthesizer::LayerSpec;

use crate::args::model::ModelArgs;
use crate::args::scene::SceneArgs;

const EXAMPLES: &str = "\
Examples:
  liveview inspect scene
  liveview inspect scene --target IMG_7.jpg --views 5 --layers planes:128
  liveview inspect scene --near 1.5 --far 40 --json
  liveview inspect scene --target IMG_7.jpg --exposure
  The histogram over 64 planes, and the 16 that are selected:
    liveview inspect scene --target IMG_7.jpg --planes -o planes.png
  Another number of planes:
    liveview inspect scene --target IMG_7.jpg --planes --layers select:8/128
  A model's card, or those of all models in a folder:
    liveview inspect models/liveview_v4.onnx
    liveview inspect models";

/// Help of the first argument.
const PATH: &str = "Scene folder as for `render`, a model (.onnx), or a folder of models";

/// Options of `liveview inspect`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, mut_arg("scene", |scene| scene.help(PATH)))]
pub(crate) struct InspectArgs {
    /// View to use as the target, held out [default: the middle one]
    #[arg(long, value_name = "NAME")]
    pub(super) target: Option<String>,
    /// Planes whose spacing to check: planes:D or list:… [default: planes:64]; with --planes
    /// select:K/D, the histogram over D planes and the K selected [default: select:16/64]
    #[arg(long, value_name = "SPEC")]
    pub(super) layers: Option<LayerSpec>,
    /// Print the exposure gains of these views; slow, since it searches the depth of the photos
    ///
    /// The factors by which surface layers multiply each colour channel of each photo; 1 also if
    /// two photos have too few points in common.
    #[arg(long)]
    pub(super) exposure: bool,
    /// Print which planes the target needs instead, by the network
    #[arg(long, conflicts_with = "exposure")]
    pub(super) planes: bool,
    /// With --planes: picture of the histogram, one bar per plane, near to far, selected planes in colour
    #[arg(short, long, value_name = "PNG", requires = "planes")]
    pub(super) output: Option<PathBuf>,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    #[command(flatten)]
    pub(super) scene: SceneArgs,
}
