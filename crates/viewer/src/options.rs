//! Options of `liveview view`.

use std::net::IpAddr;

use anyhow::Result;
use clap::Args;
use liveview::Scene;
use liveview_common::args::frame_rate::{FrameRate, frame_rate};
use liveview_common::args::layers::LayerArgs;
use liveview_common::args::model::ModelArgs;
use liveview_common::args::numbers;
use liveview_common::args::scene::SceneArgs;
use liveview_common::args::targets::held_out;

const EXAMPLES: &str = "\
Examples:
  liveview view scene --open
  liveview view scene --engine openvino --precision int8
  liveview view scene --target IMG_7.jpg,IMG_9.jpg
  liveview view scene --bind 192.168.1.2 --port 9000
  liveview view rig --fps 25

On the page: drag to move the viewpoint, scroll or pinch to go forward and back, shift-drag to turn;
or use the arrow keys, with shift to turn. The space bar starts and stops the video of a rig (see
`liveview video --help`).";

/// Options of `liveview view`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ViewArgs {
    /// Port of the link; 0 for any free port
    #[arg(long, value_name = "N", default_value = "8090", value_parser = numbers::port)]
    pub(crate) port: u16,
    /// Network address of this machine, to give others access by a token in the link
    ///
    /// Such as 192.168.1.2. By default only this machine has access.
    #[arg(long, value_name = "ADDRESS")]
    pub(crate) bind: Option<IpAddr>,
    /// Open the link in the browser
    #[arg(long)]
    pub(crate) open: bool,
    /// Time steps per second of a rig [default: its videos' frame rate, else 30]
    #[arg(long, value_name = "N", value_parser = frame_rate)]
    pub(crate) fps: Option<FrameRate>,
    /// Photos to hold out, by name; a picture at the pose of one is scored against it
    #[arg(long, value_name = "NAME", value_delimiter = ',', conflicts_with = "heldout")]
    target: Vec<String>,
    /// Hold out every Nth photo
    #[arg(long, value_name = "N", value_parser = numbers::count)]
    heldout: Option<usize>,
    #[command(flatten)]
    pub(crate) layers: LayerArgs,
    #[command(flatten)]
    pub(crate) model: ModelArgs,
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
}

impl ViewArgs {
    /// Indices of the photos to hold out.
    pub(crate) fn held_out(&self, scene: &Scene) -> Result<Vec<usize>> {
        held_out(scene, self.heldout, &self.target)
    }
}
