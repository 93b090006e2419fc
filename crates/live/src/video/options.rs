//! Options of `liveview video`.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use liveview::LayerSpec;
use liveview::live::Policy;
use liveview_common::args::frame_rate::{FrameRate, frame_rate};
use liveview_common::args::layers::Quality;
use liveview_common::args::model::ModelArgs;
use liveview_common::args::scene::SceneArgs;

use super::viewpoint::ViewpointArgs;

const EXAMPLES: &str = "\
A rig is a folder with a folder of frames or a video file for each camera (cam00/0000.jpg … or cam00.mp4 …), and poses:
transforms.json, poses_bounds.npy (cameras in order of their names), models.json or a COLMAP model. Frames are matched by the
last number in their names, or if these differ, as time stamps do, by time; videos of different frame rates by time.

Examples:
  A held-out camera, from the others, each frame scored:
    liveview video rig --camera cam05 -o view.mp4
  A camera path around the rig, played while it is rendered:
    liveview video rig --path circle:120 -o - | ffplay -
  Live: 30 frames per second, none older than a tenth of a second, with less work per frame if the machine is too slow:
    liveview video rig --camera cam05 --fps 30 --latency 100ms --engine openvino --precision int8 -o view.mp4";

/// Options of `liveview video`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct VideoArgs {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    pub(super) viewpoint: ViewpointArgs,
    /// Which layers each frame is rendered on: surface:L, guided:L, planes:D, select:K/D (D planes on the first frame, K of them
    /// from then on, as the paper's video) or list:… [default: what the model recommends]
    #[arg(long, value_name = "SPEC", group = "which_layers")]
    pub(super) layers: Option<LayerSpec>,
    /// A choice of layers that was measured (README, "Error against run time")
    #[arg(long, value_enum, group = "which_layers")]
    pub(super) quality: Option<Quality>,
    /// Surface layers: leave photos of different exposure or white balance as they are; by default they are balanced, by what their
    /// confirmed depths show to be the same point
    #[arg(long)]
    pub(super) keep_exposure: bool,
    /// When the layers are found anew: propagate (surface layers: the photos' own depth, searched anew where a photo has changed; guided
    /// layers: the last frame's surface, searched anew where the photos no longer agree with it), each (every frame), every:N (one
    /// every N frames), once (the first frame alone) [default: propagate for surface and guided layers, once for
    /// selected planes]
    #[arg(long)]
    pub(super) policy: Option<Policy>,
    /// Time steps A to B, without B: A.., ..B or A..B, counted from 0
    #[arg(long, value_name = "A..B", value_parser = range)]
    pub(super) frames: Option<Range<usize>>,
    /// Frames per second: 30, 29.97 or 30000/1001
    #[arg(long, value_name = "N", default_value = "30", value_parser = frame_rate)]
    pub(super) fps: FrameRate,
    /// Live: frames are due at the cameras' times, and none older than this is used. Where the machine is too slow (three frames over
    /// the budget, or one of more than twice that), surface layers become guided ones, then these fewer, then the size
    /// smaller, as far as it takes to fit, and raised
    /// again step by step. A camera that is late by half of this is left out, unless all are read that slowly. Such as 100ms
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub(super) latency: Option<Duration>,
    /// Where the video goes: .mp4 or .gif through ffmpeg, a folder for its frames, or - for raw y4m on standard output
    #[arg(short, long, value_name = "PATH")]
    pub(super) output: PathBuf,
    /// A line of JSON for each frame: where its layers came from, its times, its scores, the memory in use
    #[arg(long, value_name = "FILE")]
    pub(super) log: Option<PathBuf>,
    #[command(flatten)]
    pub(super) model: ModelArgs,
}

impl VideoArgs {
    /// Whether the video itself goes to standard output.
    pub fn takes_stdout(&self) -> bool {
        self.output == Path::new("-")
    }
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let parse = || {
        let (start, end) = text.split_once("..")?;
        let side = |text: &str, open| if text.is_empty() { Some(open) } else { text.parse().ok() };
        let range = side(start, 0)?..side(end, usize::MAX)?;
        (!range.is_empty()).then_some(range)
    };
    parse().ok_or_else(|| "expected A..B with A below B, or one of the two left out".to_owned())
}

fn duration(text: &str) -> Result<Duration, String> {
    let (number, unit) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (text.strip_suffix('s').unwrap_or(""), 1.0),
    };
    let seconds = number.parse::<f64>().ok().map(|number| number * unit).filter(|s| (1e-3..=60.0).contains(s));
    seconds.map(Duration::from_secs_f64).ok_or_else(|| "expected a time such as 100ms or 0.2s, at most 60s".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_times_are_read() {
        assert_eq!(range("3..9"), Ok(3..9));
        assert_eq!(range("..9"), Ok(0..9));
        assert_eq!(range("3.."), Ok(3..usize::MAX));
        assert!(range("9..3").is_err() && range("7").is_err() && range("-1..2").is_err());
        assert_eq!(duration("100ms"), Ok(Duration::from_millis(100)));
        assert_eq!(duration("0.25s"), Ok(Duration::from_millis(250)));
        assert!(["100", "0ms", "nans", "-1s", "1h"].iter().all(|text| duration(text).is_err()));
    }
}
