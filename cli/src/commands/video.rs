//! `liveview video`: renders the video of a moving viewpoint from the frames of a camera rig.

use std::collections::HashSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use liveview_live::FrameRate;
use liveview_live::rig::Rig;
use liveview_live::session::Policy;
use liveview_live::video::{FRAME_PREFIX, Progress, Sink, Video, VideoSettings, Viewpoint, frame_file};
use liveview_scene::cameras::CameraPath;
use liveview_synthesizer::{LayerSpec, SceneViews};
use serde_json::Value;

use crate::args::numbers::frame_rate;
use crate::args::{ADVANCED, LayerChoice, MORE_HELP, ModelArgs, SceneArgs, cameras_of};
use crate::console::{Output, print_message, print_note, print_notes, progress};
use crate::interrupt::{self, Shortened};
use crate::job;
use crate::outputs::{OutputPlan, note_other_pictures};

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

const HEADING: &str = "Viewpoint (one of these)";

/// Options that set the viewpoint; exactly one is given.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct ViewpointArgs {
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

/// Options of `liveview video`.
#[derive(Debug, Args)]
#[command(after_help = MORE_HELP, after_long_help = EXAMPLES)]
pub(crate) struct VideoArgs {
    #[command(flatten)]
    viewpoint: ViewpointArgs,
    /// Video (.mp4, .gif; needs ffmpeg), folder of frames, or - for raw y4m on standard output
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Frames per second, 1 to 1000, such as 29.97 or 30000/1001 [default: its videos' rate, else 30]
    #[arg(long, value_name = "N", value_parser = frame_rate)]
    fps: Option<FrameRate>,
    /// Time steps to render: A.., ..B or A..B, counted from 0, without B
    #[arg(long, value_name = "A..B", value_parser = range)]
    frames: Option<Range<usize>>,
    /// Live: largest age of a frame, such as 100ms; quality is reduced to meet it
    ///
    /// Frames are due at the rate of --fps. If three frames in a row exceed the budget, or one
    /// takes more than twice as long, the number of layers is reduced (surface layers first to one,
    /// then to guided layers), then the size, until it fits; quality is raised again step by step. A camera that is late by half of the latency is skipped, unless all are that slow.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    latency: Option<Duration>,
    #[command(flatten)]
    layers: LayerChoice,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// Surface layers: do not balance the exposure and white balance of the photos
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    keep_exposure: bool,
    /// When layers are searched again: propagate, each, every:N or once
    ///
    /// propagate: where the photos have changed (surface layers), or where they no longer agree
    /// with the last frame's surface (guided layers). each: every frame. every:N: every Nth frame.
    /// once: the first frame only. [default: propagate for surface and guided layers, once for
    /// selected planes]
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    policy: Option<Policy>,
    /// Write a line of JSON for each frame: source of its layers, times, scores, memory
    #[arg(long, value_name = "FILE", help_heading = ADVANCED, hide_short_help = true)]
    log: Option<PathBuf>,
}

impl VideoArgs {
    /// Whether the video itself goes to standard output.
    pub(crate) fn takes_stdout(&self) -> bool {
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

/// Runs `liveview video`.
pub(crate) fn run(args: &VideoArgs) -> Result<Output> {
    let rig = Rig::open(args.scene.folder(), &args.scene.options(), args.scene.depth())?;
    let fps = args.fps.map_or_else(|| rig.rate(), Ok)?;
    let sink = Sink::new(&args.output, fps, print_note)?;
    print_notes(&rig.views.scene().notes);
    let viewpoint = args.viewpoint.resolve(&rig.views)?;
    let (mut rig, model) = job::open_rig(rig, &args.model, &args.layers, args.keep_exposure)?;
    let policy = policy(args.policy, &rig.layers)?;
    if args.layers.given().is_none() {
        rig.layers = policy.layers_by_default(rig.layers);
    }
    let views = rig.renderers.last().map_or(0, |renderer| renderer.network().views());
    let free = rig.rig.feeds.len() - usize::from(viewpoint.truth.is_some());
    if free < views {
        print_message("note", format_args!("a frame is made from {views} views, but there are only {free}"));
    }
    let mut output_plan = OutputPlan::new(rig.rig.views.scene());
    let (frames, latency) = (args.frames.clone(), args.latency);
    let video = Video::new(VideoSettings { rig, viewpoint, policy, frames, fps, latency })?;
    output_plan.protect("--poses", args.viewpoint.poses.as_deref());
    args.model.protect(&mut output_plan, model.path());
    plan_sink(&sink, &mut output_plan)?;
    args.log.iter().try_for_each(|log| output_plan.file("--log", log))?;
    output_plan.prepare()?;
    let stop = interrupt::watch()?;
    let bar = progress()?.with_prefix("frames");
    let mut report = |what: Progress<'_>| match what {
        Progress::Begin(steps) => steps.into_iter().for_each(|steps| bar.set_length(steps as u64)),
        Progress::Done(steps) => bar.set_position(steps as u64),
        Progress::Note(note) => bar.suspend(|| print_note(note)),
    };
    let is_folder = matches!(sink, Sink::Folder { .. });
    let played = video.play(sink, args.log.as_deref(), model.weighting_stage(), &stop, &mut report);
    bar.finish_and_clear();
    let mut played = played?;
    if is_folder {
        let written: HashSet<PathBuf> = (0..played.frames).map(|index| frame_file(&args.output, index)).collect();
        note_other_pictures(&args.output, |other| written.contains(other));
    }
    if let (Value::Object(json), Value::Object(model)) = (&mut played.json, model.json()) {
        json.extend(model);
    }
    let output = Output { text: played.text + &model.text(), json: played.json };
    if played.interrupted {
        let video = played.file.map_or_else(|| "the video".to_owned(), |file| file.display().to_string());
        let what = format!("{video} is short, it has {} frames", played.frames);
        return Err(Shortened { what, output }.into());
    }
    Ok(output)
}

/// Adds the output to the plan. A folder inside the rig's is refused.
fn plan_sink(sink: &Sink, output_plan: &mut OutputPlan) -> Result<()> {
    match sink {
        Sink::Folder { path, .. } => {
            if output_plan.in_scene(path) {
                bail!("-o {}: lies in the rig's own folder; expected another place", path.display());
            }
            output_plan.frames("-o", path, FRAME_PREFIX, &frame_file(path, 0))
        }
        Sink::Video(video) => output_plan.file("-o", video.path()),
        Sink::Y4m { .. } => Ok(()),
    }
}

/// The policy given, checked against the layers, or the default for these.
fn policy(given: Option<Policy>, layers: &LayerSpec) -> Result<Policy> {
    match given {
        Some(Policy::Propagate) if Policy::default_for(layers) != Policy::Propagate => {
            bail!(
                "--policy propagate: only guided and surface layers have depth to propagate; expected each, every:N or once for {layers}"
            )
        }
        Some(policy) => Ok(policy),
        None => Ok(Policy::default_for(layers)),
    }
}

impl ViewpointArgs {
    /// The cameras of the frames.
    fn resolve(&self, views: &SceneViews) -> Result<Viewpoint> {
        let Self { camera, path, poses } = self;
        match (camera, path, poses) {
            (Some(name), ..) => Ok(Viewpoint::of_camera(views, views.scene().view_index(name)?)),
            (_, Some(path), _) => Viewpoint::along(*path, views),
            (.., Some(file)) => Viewpoint::through(cameras_of(file, views)?),
            (None, None, None) => bail!("expected --camera, --path or --poses"),
        }
    }
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
