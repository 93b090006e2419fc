//! Options of `liveview video`, and the viewpoint they name.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use liveview::geometry::Camera;
use liveview::live::Policy;

use super::rig::Rig;
use crate::cli::engine::ModelArgs;
use crate::cli::path::CameraPath;
use crate::cli::pose;
use crate::cli::setup::SceneArgs;

const EXAMPLES: &str = "\
A rig is a folder with a folder of frames or a video file for each camera (cam00/0000.jpg … or cam00.mp4 …), and poses:
transforms.json, poses_bounds.npy (cameras in order of their names), models.json or a COLMAP model. Frames belong together by
the last number in their names.

Examples:
  A held-out camera, from the others, each frame scored:
    liveview video rig --camera cam05 -o view.mp4
  A flight around the rig, played while it is made:
    liveview video rig --path circle:120 -o - | ffplay -
  Live: 30 frames per second, none older than a tenth of a second; layers and size give way where the machine is too slow:
    liveview video rig --camera cam05 --fps 30 --latency 100ms --engine openvino --precision int8 -o view.mp4";

/// Options of `liveview video`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct VideoArgs {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    viewpoint: ViewpointArgs,
    /// Where the layers of a frame come from: carried (the last frame's surface, searched anew where the photos no longer agree
    /// with it), each (a coarse pass per frame), every:N (one every N frames), paper (64 planes on the first frame, the 16
    /// that most pixels choose from then on), planes:D
    #[arg(long, default_value = "carried", value_parser = policy)]
    pub(super) policy: Policy,
    /// Guided layers per frame [default: what the model recommends]
    #[arg(long, value_name = "L", value_parser = crate::cli::count)]
    pub(super) guided: Option<usize>,
    /// Planes of the coarse pass [default: one per four pixels of parallax, 8 to 128]
    #[arg(long, value_name = "D", value_parser = crate::cli::two_or_more)]
    pub(super) coarse_planes: Option<usize>,
    /// Time steps A to B, without B: A.., ..B or A..B, counted from 0
    #[arg(long, value_name = "A..B", value_parser = range)]
    pub(super) frames: Option<Range<usize>>,
    /// Frames per second
    #[arg(long, value_name = "N", default_value = "30", value_parser = crate::cli::few)]
    pub(super) fps: usize,
    /// Live: frames are due at their times, none is used that is older, and layers, then size, give way where the machine is too
    /// slow: after three frames over the budget, or one of more than twice that, as far as it takes to fit; up again step by step. A
    /// camera that is half of this late is left out, unless all are read that slowly. Such as 100ms
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub(super) latency: Option<Duration>,
    /// Where the video goes: .mp4 or .gif through ffmpeg, a folder for its frames, or - for raw y4m on standard output
    #[arg(short, long, value_name = "PATH")]
    pub(super) output: PathBuf,
    /// A line of JSON for each frame: where its layers came from, its times, its scores, the memory in use
    #[arg(long, value_name = "FILE")]
    pub(super) log: Option<PathBuf>,
    #[command(flatten)]
    pub(super) engine: ModelArgs,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Viewpoint (one of these)")]
#[group(required = true, multiple = false)]
struct ViewpointArgs {
    /// A camera of the rig, by name; it is held out: never rendered from, and what it shows scores the frames
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// A path of N frames: line:N there and back, circle:N or spiral:N, over and over
    #[arg(long, value_name = "SHAPE:N")]
    path: Option<CameraPath>,
    /// A camera per frame, in a JSON file as `render --pose` takes; the last one stays
    #[arg(long, value_name = "FILE")]
    poses: Option<PathBuf>,
}

/// Where each frame is seen from.
pub(super) struct Viewpoint {
    cameras: Vec<Camera>,
    repeat: Repeat,
    /// The camera of the rig that is held out.
    pub(super) truth: Option<usize>,
}

enum Repeat {
    Over,
    Back,
    Last,
}

impl Viewpoint {
    /// The camera of a time step.
    pub(super) fn camera(&self, step: usize) -> &Camera {
        let count = self.cameras.len();
        &self.cameras[match self.repeat {
            Repeat::Over => step % count,
            Repeat::Last => step.min(count - 1),
            Repeat::Back => {
                let there = step % (2 * count - 2).max(1);
                if there < count { there } else { 2 * count - 2 - there }
            }
        }]
    }

    /// All of them.
    pub(super) fn cameras(&self) -> &[Camera] {
        &self.cameras
    }
}

impl VideoArgs {
    /// Whether the video itself goes to standard output.
    pub(crate) fn takes_stdout(&self) -> bool {
        self.output == Path::new("-")
    }

    pub(super) fn viewpoint(&self, rig: &Rig) -> Result<Viewpoint> {
        let ViewpointArgs { camera, path, poses } = &self.viewpoint;
        let seen = match (camera, path, poses) {
            (Some(name), ..) => {
                let view = rig.photos.scene.view_index(name)?;
                let camera = rig.photos.scene.views[view].camera.clone();
                Viewpoint { cameras: vec![camera], repeat: Repeat::Last, truth: Some(view) }
            }
            (_, Some(path), _) => {
                let repeat = if path.is_closed() { Repeat::Over } else { Repeat::Back };
                Viewpoint { cameras: path.cameras(&rig.photos)?, repeat, truth: None }
            }
            (.., Some(file)) => {
                Viewpoint { cameras: pose::read(file, &rig.photos)?, repeat: Repeat::Last, truth: None }
            }
            (None, None, None) => bail!("expected --camera, --path or --poses"),
        };
        let size = |camera: &Camera| (camera.width(), camera.height());
        if seen.cameras.iter().any(|camera| size(camera) != size(&seen.cameras[0])) {
            bail!("the cameras of the viewpoint have different sizes; expected one size for the whole video");
        }
        Ok(seen)
    }
}

fn policy(text: &str) -> Result<Policy, String> {
    let expected = || "expected carried, each, every:N, paper or planes:D".to_owned();
    let number = |text: &str| crate::cli::count(text).map_err(|error| format!("{}: {error}", expected()));
    match text.split_once(':') {
        None => match text {
            "carried" => Ok(Policy::Carried),
            "each" => Ok(Policy::Every(1)),
            "paper" => Ok(Policy::PAPER),
            _ => Err(expected()),
        },
        Some(("every", frames)) => Ok(Policy::Every(number(frames)?)),
        Some(("planes", count)) => Ok(Policy::Planes(number(count)?)),
        Some(_) => Err(expected()),
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
    fn policies_ranges_and_times_are_read() {
        assert_eq!(policy("each"), Ok(Policy::Every(1)));
        assert_eq!(policy("every:5"), Ok(Policy::Every(5)));
        assert_eq!(policy("planes:64"), Ok(Policy::Planes(64)));
        assert!(policy("every:0").unwrap_err().contains("whole number"));
        assert!(policy("sometimes").is_err() && policy("some:3").is_err());
        assert_eq!(range("3..9"), Ok(3..9));
        assert_eq!(range("..9"), Ok(0..9));
        assert_eq!(range("3.."), Ok(3..usize::MAX));
        assert!(range("9..3").is_err() && range("7").is_err() && range("-1..2").is_err());
        assert_eq!(duration("100ms"), Ok(Duration::from_millis(100)));
        assert_eq!(duration("0.25s"), Ok(Duration::from_millis(250)));
        assert!(["100", "0ms", "nans", "-1s", "1h"].iter().all(|text| duration(text).is_err()));
    }
}
