//! Options of `liveview video`.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use liveview::live::Policy;
use liveview_common::args::frame_rate::{FrameRate, frame_rate};
use liveview_common::args::help::ADVANCED;
use liveview_common::args::layers::LayerChoice;
use liveview_common::args::model::ModelArgs;
use liveview_common::args::scene::SceneArgs;

use super::viewpoint::ViewpointArgs;

const SHORT_EXAMPLES: &str = "\
Examples:
  A held-out camera, rendered from the others, each frame scored:
    liveview video rig --camera cam05 -o view.mp4
  A camera path around the rig, played while it is rendered:
    liveview video rig --path circle:120 -o - | ffplay -

--help also lists the advanced options.";

const EXAMPLES: &str = "\
A rig is a folder with a folder of frames or a video file for each camera (cam00/0000.jpg … or
cam00.mp4 …), and poses: transforms.json, poses_bounds.npy (cameras in order of their names),
models.json or a COLMAP model. Frames are matched by the last number in their names; if these
numbers differ between cameras, as time stamps do, and in videos of different frame rates, by time.

Examples:
  A held-out camera, rendered from the others, each frame scored:
    liveview video rig --camera cam05 -o view.mp4
  A camera path around the rig, played while it is rendered:
    liveview video rig --path circle:120 -o - | ffplay -
  Live: 30 frames per second with a latency of at most 0.1 seconds, in less quality if necessary:
    liveview video rig --camera cam05 --fps 30 --latency 100ms --engine openvino \\
        --precision int8 -o view.mp4";

/// Options of `liveview video`.
#[derive(Debug, Args)]
#[command(after_help = SHORT_EXAMPLES, after_long_help = EXAMPLES)]
pub struct VideoArgs {
    #[command(flatten)]
    pub(super) viewpoint: ViewpointArgs,
    /// Video (.mp4, .gif; needs ffmpeg), folder of frames, or - for raw y4m on standard output
    #[arg(short, long, value_name = "PATH")]
    pub(super) output: PathBuf,
    /// Frames per second, 1 to 1000, such as 29.97 or 30000/1001 [default: its videos' rate, else 30]
    #[arg(long, value_name = "N", value_parser = frame_rate)]
    pub(super) fps: Option<FrameRate>,
    /// Time steps to render: A.., ..B or A..B, counted from 0, without B
    #[arg(long, value_name = "A..B", value_parser = range)]
    pub(super) frames: Option<Range<usize>>,
    /// Live: largest age of a frame, such as 100ms; quality is reduced to meet it
    ///
    /// Frames are due at the rate of --fps. If three frames in a row exceed the budget, or one
    /// takes more than twice as long, the number of layers is reduced (surface layers first to one,
    /// then to guided layers), then the size, until it fits; quality is raised again step by step. A camera that is late by half of the latency is skipped, unless all are that slow.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub(super) latency: Option<Duration>,
    #[command(flatten)]
    pub(super) layers: LayerChoice,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    /// Surface layers: do not balance the exposure and white balance of the photos
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    pub(super) keep_exposure: bool,
    /// When layers are searched again: propagate, each, every:N or once
    ///
    /// propagate: where the photos have changed (surface layers), or where they no longer agree
    /// with the last frame's surface (guided layers). each: every frame. every:N: every Nth frame.
    /// once: the first frame only. [default: propagate for surface and guided layers, once for
    /// selected planes]
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    pub(super) policy: Option<Policy>,
    /// Write a line of JSON for each frame: source of its layers, times, scores, memory
    #[arg(long, value_name = "FILE", help_heading = ADVANCED, hide_short_help = true)]
    pub(super) log: Option<PathBuf>,
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
    parse().ok_or_else(|| "expected A.., ..B or A..B with A below B".to_owned())
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
