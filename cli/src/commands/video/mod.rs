//! `liveview video`: renders the video of a moving viewpoint from the frames of a camera rig.

mod gather;
mod governor;
mod player;
mod report;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use clap::Args;
use liveview::Camera;
use liveview_live::FrameRate;
use liveview_live::ffmpeg::{end_reading, is_address};
use liveview_live::rig::{Rig, RigSettings, SPARE_CAMERAS, SourceClock, Sources};
use liveview_live::session::{LiveSession, LiveSettings, Policy};
use liveview_scene::cameras::CameraPath;
use liveview_synthesizer::{SceneViews, check_video};
use serde_json::Value;

use crate::args::numbers::{frame_range, frame_rate};
use crate::args::{ADVANCED, LayerChoice, MORE_HELP, ModelArgs, SceneArgs, cameras_of, source, write_atomically};
use crate::console::{Output, print_message, print_notes, progress};
use crate::interrupt::{self, Shortened};
use crate::job;
use crate::outputs::OutputPlan;
use gather::{Clock, Faults, Gathering};
use governor::Governor;
use player::{FRAME_PREFIX, Player, Sink, frame_file};
use report::{Scorer, Tally, markdown, summary};

/// Share of the time between two frames, or of the latency, for rendering; reading and writing need the rest.
const RENDER_SHARE: f64 = 0.9;
/// Largest age of a frame of running cameras, unless another is given.
const LATENCY: Duration = Duration::from_millis(200);

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
        --precision int8 -o view.mp4
  Cameras that run, by the poses of the rig, played and measured:
    liveview video rig --path circle:120 --source cam00=rtsp://10.0.0.5/1 \\
        --source cam01=/dev/video0 --fps 25 --measure out -o - | ffplay -";

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
    /// Video (.mp4, .gif; needs ffmpeg), folder of frames, rtsp:// or udp://, or - for raw y4m on standard output
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Frames per second, 1 to 1000, such as 29.97 or 30000/1001 [default: its videos' rate, else 30]
    #[arg(long, value_name = "N", value_parser = frame_rate)]
    fps: Option<FrameRate>,
    /// Time steps to render: A:, :B or A:B, counted from 0, without B
    #[arg(long, value_name = "A:B", value_parser = frame_range)]
    frames: Option<Range<usize>>,
    /// Live: largest age of a frame, such as 100ms; quality is reduced to meet it
    ///
    /// Frames are due at the rate of --fps. Once frames are together more than a
    /// period late, the number of layers is reduced (surface layers first to one,
    /// then to coarse depth and to guided layers), then the size, until it fits; quality is raised again step by step. A camera that is late by half of the latency is skipped, unless all are that slow.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    latency: Option<Duration>,
    /// Camera of the rig that runs, and what ffmpeg opens: rtsp://…, udp://…, /dev/video0, a file that grows; repeatable
    ///
    /// Or as "source" of its frame in transforms.json. A camera that ends or fails is started again.
    /// The video is live, with a --latency of 200ms unless it is given.
    #[arg(long, value_name = "NAME=URL", value_parser = source)]
    source: Vec<(String, PathBuf)>,
    /// What matches the frames of sources: their arrival, the time stamps of the stream, or frame numbers
    ///
    /// stream: of cameras that share a clock. frame: every frame, one after the other, as from files: not live.
    #[arg(long, value_name = "CLOCK", default_value = "arrival", help_heading = ADVANCED, hide_short_help = true)]
    clock: SourceClock,
    /// Folder for a report: a table (.md), the same as JSON, and a line of JSON for each frame
    #[arg(long, value_name = "FOLDER", help_heading = ADVANCED, hide_short_help = true)]
    measure: Option<PathBuf>,
    #[command(flatten)]
    layers: LayerChoice,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// Surface layers: do not balance the exposure and white balance of the photos
    #[arg(long, help_heading = ADVANCED, hide_short_help = true)]
    keep_exposure: bool,
    /// When layers are searched again: propagate, each or once
    ///
    /// propagate: where the photos have changed (surface layers), or where they no longer agree
    /// with the last frame's surface (guided layers). each: every frame. once: the first frame only. [default: propagate for surface and guided layers, once for
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
    let output = play(args);
    end_reading();
    output
}

fn play(args: &VideoArgs) -> Result<Output> {
    let sources = Sources { given: args.source.clone(), clock: args.clock };
    let rig = Rig::open(args.scene.folder(), &args.scene.options(), args.scene.depth(), Some(&sources))?;
    let is_running = rig.is_running();
    let fps = args.fps.map_or_else(|| rig.rate(), Ok)?;
    let sink = Sink::new(&args.output, fps)?;
    print_notes(&rig.views.scene().notes);
    let viewpoint = args.viewpoint.resolve(&rig.views)?;
    let (settings, model) = job::open_rig(rig, &args.model, &args.layers, args.keep_exposure)?;
    let RigSettings { rig, renderers, with_models, mut layers, keep_exposure } = settings;
    let policy = Policy::for_layers(args.policy, &layers).map_err(|error| anyhow!("--policy {error}"))?;
    if args.layers.given().is_none() {
        layers = policy.layers_by_default(layers);
    }
    let counts = || renderers.iter().map(|renderer| renderer.network().views());
    let (fewest, views) = (counts().min().unwrap_or(0), counts().max().unwrap_or(0));
    let free: Vec<usize> = (0..rig.feeds.len()).filter(|&camera| Some(camera) != viewpoint.truth).collect();
    if free.len() < views {
        print_message("note", format_args!("a frame is made from {views} views, but there are only {}", free.len()));
    }
    let scene = rig.views.scene();
    let read = rig.cameras_for(&viewpoint.cameras, &free, (fewest, views + SPARE_CAMERAS))?;
    let of_read: Vec<&Camera> = rig.views.cameras(&read).collect();
    // A thread reads each camera; others match them by time, render and write.
    let (target, count, size) = (viewpoint.camera(0).size(), read.len(), of_read[0].size());
    if let Err(error) = check_video(&of_read, target, count + 3) {
        bail!("a video of {target} from {count} cameras such as {size} {error}; expected smaller photos");
    }
    let (near, far) = rig.views.depth_range(&read, &[])?;
    let live_settings = LiveSettings { near, far, layers: layers.clone(), policy, keep_exposure, coarse_depth: false };
    let cameras = scene.views.iter().map(|view| view.camera.clone()).collect();
    let session = LiveSession::new(cameras, renderers, live_settings)?;
    let known = read.iter().map(|&camera| rig.feeds[camera].steps()).collect::<Option<Vec<_>>>();
    let all = known.and_then(|steps| steps.into_iter().max()).unwrap_or(usize::MAX);
    let steps = args.frames.clone().map_or(0..all, |range| range.start..range.end.min(all));
    let first = steps.start;
    if steps.is_empty() {
        bail!("--frames {first}:: expected a range within the cameras' {all} time steps, which count from 0");
    }
    let mut output_plan = OutputPlan::new(scene);
    output_plan.protect("--poses", args.viewpoint.poses.as_deref());
    args.source.iter().for_each(|(_, source)| output_plan.protect("--source", Some(source)));
    args.model.protect(&mut output_plan, model.path());
    plan_sink(&sink, &mut output_plan)?;
    let measured = |name: &str| args.measure.as_ref().map(|folder| folder.join(name));
    let (log, report) = (args.log.clone().or(measured("frames.jsonl")), ["measure.md", "measure.json"].map(measured));
    log.iter().try_for_each(|log| output_plan.file("--log", log))?;
    report.iter().flatten().try_for_each(|file| output_plan.named_file("--measure", file))?;
    output_plan.prepare()?;
    let stop = interrupt::watch()?;
    let tally = Tally::new(log.as_deref(), model.weighting_stage())?;
    let bar = progress()?.with_prefix("frames");
    if steps.end < usize::MAX {
        bar.set_length(steps.len() as u64);
    }
    let mut live = None;
    if let Some(latency) = args.latency.or(is_running.then_some(LATENCY)) {
        let budget = Duration::from_secs_f64(1.0 / fps.per_second()).min(latency).mul_f64(RENDER_SHARE);
        let governor = Governor::new(budget, &layers, with_models);
        live = Some((governor, Clock::new((first, steps.end), fps.per_second(), latency)));
    }
    // A live video is not scored: that would take too long.
    let truth = viewpoint.truth.filter(|_| live.is_none());
    let gathering = Arc::new(Gathering {
        scene: scene.clone(),
        feeds: rig.feeds.clone(),
        read: read.iter().copied().chain(truth).collect(),
        truth,
        steps,
        clock: live.as_ref().map(|(_, clock)| *clock),
        stop,
        faults: Mutex::new(Faults { cameras: rig.feeds.iter().map(|_| (0, None)).collect() }),
        wanted: AtomicUsize::new(first),
    });
    let player = Player {
        session,
        settled: false,
        was_searched: false,
        viewpoint: &viewpoint,
        truth,
        live,
        scorer: Scorer::default(),
        tally,
        changes: Vec::new(),
        bar: &bar,
    };
    let played = player.play(&gathering, sink);
    bar.finish_and_clear();
    let (played, file) = played?;
    let frames = played.written.frames;
    let (text, mut json) = summary(&rig, &viewpoint, &played, file.as_deref(), (&layers, policy));
    if let (Value::Object(json), Value::Object(model)) = (&mut json, model.json()) {
        json.extend(model);
    }
    let output = Output { text: text + &model.text(), json };
    if let [Some(table), Some(json)] = &report {
        write_atomically(table, markdown(&output.text).as_bytes())?;
        write_atomically(json, format!("{:#}\n", output.json).as_bytes())?;
    }
    if played.interrupted {
        let video = file.map_or_else(|| "the video".to_owned(), |file| file.display().to_string());
        return Err(Shortened { what: format!("{video} is short, it has {frames} frames"), output }.into());
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
        Sink::Video(video) if is_address(video.path()) => Ok(()),
        Sink::Video(video) => output_plan.file("-o", video.path()),
        Sink::Y4m { .. } => Ok(()),
    }
}

impl ViewpointArgs {
    /// The cameras of the frames.
    fn resolve(&self, views: &SceneViews) -> Result<Viewpoint> {
        let Self { camera, path, poses } = self;
        let (cameras, repeat, truth) = match (camera, path, poses) {
            (Some(name), ..) => {
                let view = views.scene().view_index(name)?;
                (vec![views.scene().views[view].camera.clone()], Repeat::Last, Some(view))
            }
            (_, Some(path), _) => {
                let repeat = if path.is_closed() { Repeat::Cycle } else { Repeat::Reverse };
                (path.cameras(&views.all_cameras())?, repeat, None)
            }
            (.., Some(file)) => (cameras_of(file, views)?, Repeat::Last, None),
            (None, None, None) => bail!("expected --camera, --path or --poses"),
        };
        if cameras.iter().any(|camera| camera.size() != cameras[0].size()) {
            bail!("the cameras of the viewpoint have different sizes; expected one size for the whole video");
        }
        Ok(Viewpoint { cameras, repeat, truth })
    }
}

/// The target camera of each frame.
#[derive(Debug)]
struct Viewpoint {
    cameras: Vec<Camera>,
    repeat: Repeat,
    /// Index of the held-out camera, the ground truth.
    truth: Option<usize>,
}

/// What follows the last camera.
#[derive(Debug)]
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
    fn camera(&self, step: usize) -> &Camera {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read() {
        assert_eq!(duration("100ms"), Ok(Duration::from_millis(100)));
        assert_eq!(duration("0.25s"), Ok(Duration::from_millis(250)));
        assert!(["100", "0ms", "nans", "-1s", "1h"].iter().all(|text| duration(text).is_err()));
    }
}
