//! Renders the video of a moving viewpoint from the frames of a camera rig: cameras → time steps → frames → file. Each stage has its
//! own threads, with bounded channels between them.

mod gather;
mod player;
mod report;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::{Result, bail};
use liveview::render::Renderer;
use liveview::{Camera, ImageRgb};
use liveview_scene::cameras::CameraPath;
use liveview_synthesizer::{LayerSpec, SceneViews, check_video};
use serde_json::Value;

use crate::ffmpeg::FrameRate;
use crate::governor::Governor;
use crate::interrupt::{self, Interrupted};
use crate::rig::{Rig, SPARE_CAMERAS};
use crate::session::{LiveSession, LiveSettings, Policy};
use gather::{Clock, Faults, Gathering};
use player::Player;
pub use player::{FRAME_PREFIX, Progress, Sink, frame_file, scaled};
use report::{Scorer, Tally, summary};

/// Share of the time between two frames, or of the latency, for rendering; reading and writing need the rest.
const RENDER_SHARE: f64 = 0.9;

/// A rig, and how its pictures are rendered.
#[derive(Debug)]
pub struct RigSettings {
    /// The cameras.
    pub rig: Rig,
    /// The networks, those of fewer views first; the last is the one that is used while all cameras deliver.
    pub renderers: Vec<Renderer>,
    /// Whether these are models, which predict opacities.
    pub with_models: bool,
    /// The layers.
    pub layers: LayerSpec,
    /// Whether the exposure of the photos is not balanced.
    pub keep_exposure: bool,
}

impl RigSettings {
    /// A session of all cameras, with the depth range of those read.
    pub fn session(&self, renderers: Vec<Renderer>, read: &[usize], policy: Policy) -> Result<LiveSession> {
        let (near, far) = self.rig.views.depth_range(read, &[])?;
        let (layers, keep_exposure) = (self.layers.clone(), self.keep_exposure);
        let cameras = self.rig.views.scene().views.iter().map(|view| view.camera.clone()).collect();
        Ok(LiveSession::new(cameras, renderers, LiveSettings { near, far, layers, policy, keep_exposure })?)
    }
}

/// What is rendered, and how.
#[derive(Debug)]
pub struct VideoSettings {
    /// The rig.
    pub rig: RigSettings,
    /// The target camera of each frame.
    pub viewpoint: Viewpoint,
    /// When layers are searched again.
    pub policy: Policy,
    /// Time steps to render; `None`: all.
    pub frames: Option<Range<usize>>,
    /// Frames per second.
    pub fps: FrameRate,
    /// Live: the largest age of a frame.
    pub latency: Option<Duration>,
}

/// A video that can be rendered.
#[derive(Debug)]
pub struct Video {
    /// Without the networks, which the session has.
    settings: VideoSettings,
    session: LiveSession,
    /// Cameras to read, except that of the ground truth.
    read: Vec<usize>,
    /// Up to `usize::MAX` if their number is unknown.
    steps: Range<usize>,
}

/// A video that was rendered.
#[derive(Debug)]
pub struct Rendered {
    /// The report.
    pub text: String,
    /// The report as JSON.
    pub json: Value,
    /// The file or folder written; `None` for standard output.
    pub file: Option<PathBuf>,
    /// Number of frames written.
    pub frames: usize,
    /// Whether an interrupt ended it before the last frame.
    pub interrupted: bool,
}

impl Video {
    /// Checks the settings.
    pub fn new(mut settings: VideoSettings) -> Result<Self> {
        let (renderers, rig) = (std::mem::take(&mut settings.rig.renderers), &settings.rig.rig);
        let counts = || renderers.iter().map(|renderer| renderer.network().views());
        let (fewest, views) = (counts().min().unwrap_or(0), counts().max().unwrap_or(0));
        let truth = settings.viewpoint.truth;
        let free: Vec<usize> = (0..rig.feeds.len()).filter(|&camera| Some(camera) != truth).collect();
        let read = rig.cameras_for(&settings.viewpoint.cameras, &free, (fewest, views + SPARE_CAMERAS))?;
        let cameras: Vec<&Camera> = read.iter().map(|&camera| &rig.views.scene().views[camera].camera).collect();
        let target = settings.viewpoint.camera(0).size();
        // A thread reads each camera; others match them by time, render and write.
        if let Err(error) = check_video(&cameras, target, cameras.len() + 3) {
            let (count, size) = (cameras.len(), cameras[0].size());
            bail!("a video of {target} from {count} cameras such as {size} {error}; expected smaller photos");
        }
        let session = settings.rig.session(renderers, &read, settings.policy)?;
        let known = read.iter().map(|&camera| rig.feeds[camera].steps()).collect::<Option<Vec<_>>>();
        let all = known.and_then(|steps| steps.into_iter().max()).unwrap_or(usize::MAX);
        let steps = settings.frames.clone().map_or(0..all, |range| range.start..range.end.min(all));
        if steps.is_empty() {
            let first = steps.start;
            bail!("--frames {first}..: expected a range within the cameras' {all} time steps, which count from 0");
        }
        Ok(Self { settings, session, read, steps })
    }

    /// Renders it. `log`: a file with a line of JSON for each frame; `weighting`: the name of the stage that computes opacities and
    /// view weights; `stop` ends it early.
    pub fn play(
        self,
        sink: Sink,
        log: Option<&Path>,
        weighting: &'static str,
        stop: &Arc<AtomicBool>,
        report: &mut dyn FnMut(Progress<'_>),
    ) -> Result<Rendered> {
        let Self { settings, mut session, read, steps } = self;
        let VideoSettings { rig, viewpoint, policy, fps, .. } = settings;
        let RigSettings { rig, with_models, layers, .. } = rig;
        let (first, last) = (steps.start, steps.end);
        let tally = Tally::new(log, weighting)?;
        report(Progress::Begin((last < usize::MAX).then_some(last - first)));
        let mut live = None;
        if let Some(latency) = settings.latency {
            let budget = Duration::from_secs_f64(1.0 / fps.per_second()).min(latency).mul_f64(RENDER_SHARE);
            let governor = Governor::new(budget, &layers, with_models);
            let warm = warm_up(&mut session, &read, viewpoint.camera(first), &governor);
            warm.map_err(|error| if interrupt::requested() { Interrupted.into() } else { error })?;
            live = Some((governor, Clock::new((first, last), fps.per_second(), latency)));
        }
        // A live video is not scored: that would take too long.
        let truth = viewpoint.truth.filter(|_| live.is_none());
        let gathering = Arc::new(Gathering {
            scene: rig.views.scene().clone(),
            feeds: rig.feeds.clone(),
            read: read.iter().copied().chain(truth).collect(),
            truth,
            steps,
            clock: live.as_ref().map(|(_, clock)| *clock),
            stop: Arc::clone(stop),
            faults: Mutex::new(Faults { cameras: rig.feeds.iter().map(|_| (0, None)).collect() }),
            wanted: AtomicUsize::new(first),
            decoders: Mutex::default(),
        });
        let player = Player {
            session,
            settled: false,
            viewpoint: &viewpoint,
            truth,
            live,
            scorer: Scorer::default(),
            tally,
            changes: Vec::new(),
            report,
        };
        let (played, file) = player.play(&gathering, sink)?;
        let (text, json) = summary(&rig, &viewpoint, &played, file.as_deref(), (&layers, policy));
        Ok(Rendered { text, json, file, frames: played.written.frames, interrupted: played.interrupted })
    }
}

/// Renders a picture of each size that the video may have: the first of a size takes longer than later ones.
fn warm_up(session: &mut LiveSession, read: &[usize], target: &Camera, governor: &Governor) -> Result<()> {
    let grey = |camera: &Camera| {
        let (width, height) = (camera.width(), camera.height());
        ImageRgb::new(width, height, vec![0.5; 3 * width * height])
    };
    let cameras = session.cameras().iter().enumerate();
    let photos = cameras
        .map(|(index, camera)| read.contains(&index).then(|| grey(camera)).transpose())
        .collect::<Result<Vec<_>, _>>()?;
    let photos: Vec<Option<&ImageRgb>> = photos.iter().map(Option::as_ref).collect();
    for scale in governor.scales() {
        session.render(&photos, &scaled(target, scale)?)?;
        session.restart();
    }
    Ok(())
}

/// The target camera of each frame.
#[derive(Debug)]
pub struct Viewpoint {
    cameras: Vec<Camera>,
    repeat: Repeat,
    /// Index of the held-out camera, the ground truth.
    pub truth: Option<usize>,
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
    /// That of a camera of the rig, which is held out.
    pub fn of_camera(views: &SceneViews, view: usize) -> Self {
        Self { cameras: vec![views.scene().views[view].camera.clone()], repeat: Repeat::Last, truth: Some(view) }
    }

    /// Along a path, repeated or back and forth.
    pub fn along(path: CameraPath, views: &SceneViews) -> Result<Self> {
        let repeat = if path.is_closed() { Repeat::Cycle } else { Repeat::Reverse };
        Self { cameras: path.cameras(&views.all_cameras())?, repeat, truth: None }.of_one_size()
    }

    /// Of a camera for each frame; the last one is repeated.
    pub fn through(cameras: Vec<Camera>) -> Result<Self> {
        Self { cameras, repeat: Repeat::Last, truth: None }.of_one_size()
    }

    fn of_one_size(self) -> Result<Self> {
        if self.cameras.iter().any(|camera| camera.size() != self.cameras[0].size()) {
            bail!("the cameras of the viewpoint have different sizes; expected one size for the whole video");
        }
        Ok(self)
    }

    /// The camera of a time step.
    pub(super) fn camera(&self, step: usize) -> &Camera {
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
