//! Pictures from the video of a rig: at rest the same as `liveview video` renders of a single time step.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use liveview::ndarray::{ArrayView4, ArrayViewMut4};
use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::Renderer;
use liveview::{Camera, ImageRgb};
use liveview_live::governor::Governor;
use liveview_live::interrupt;
use liveview_live::rig::{Delivered, Feed, Reader, SPARE_CAMERAS};
use liveview_live::session::{LiveError, LiveFrame, LiveSession, Policy};
use liveview_live::video::RigSettings;
use liveview_synthesizer::{LayerSpec, Scene};
use rayon::prelude::*;

use super::{MOTION_BUDGET, Rendered, Source};
use crate::requests::Viewpoint;

/// One session for pictures in motion, and a fresh one for each time step shown at rest: depth that the first propagates between
/// time steps is not as good.
pub(crate) struct Video {
    settings: RigSettings,
    frames: Frames,
    /// Indices of the cameras that are not held out.
    free: Vec<usize>,
    /// Nearest and farthest depth of these cameras, scene units.
    range: (f64, f64),
    networks: Networks,
    motion: LiveSession,
    governor: Governor,
    /// Whether a frame of the governor's level was rendered: the first takes longer and is not recorded.
    settled: bool,
    still: Option<Still>,
    unprepared: usize,
}

/// A session for one time step.
struct Still {
    step: usize,
    /// The cameras read: the depth of each is searched with the others.
    cameras: Vec<usize>,
    session: LiveSession,
}

impl Video {
    /// `free`: the cameras that are not held out; `batch`: layers per run of the network.
    pub(crate) fn open(mut settings: RigSettings, free: Vec<usize>, batch: usize) -> Result<Self> {
        let governor = Governor::new(MOTION_BUDGET, &settings.layers, settings.with_models);
        let networks = Networks::new(std::mem::take(&mut settings.renderers), batch);
        let range = settings.rig.views.depth_range(&free, &[])?;
        let motion = session(&settings, &networks, &free, Policy::default_for(&settings.layers))?;
        Ok(Self {
            frames: Frames::new(settings.rig.views.scene().clone(), &settings.rig.feeds),
            settings,
            free,
            range,
            networks,
            motion,
            governor,
            settled: false,
            still: None,
            unprepared: 2,
        })
    }

    /// The nearest depth of the rig, scene units.
    pub(crate) fn near(&self) -> f64 {
        self.range.0
    }

    /// The cameras to read for a target.
    ///
    /// # Errors
    /// Too few cameras see what the target sees.
    pub(crate) fn cameras_for(&self, target: &Camera) -> Result<Vec<usize>> {
        let (fewest, views) = self.networks.views();
        self.settings.rig.cameras_for(std::slice::from_ref(target), &self.free, (fewest, views + SPARE_CAMERAS))
    }

    /// The photos for a picture in motion: of no more cameras than it needs, unless one of these has no photo.
    fn step_in_motion(&mut self, viewpoint: &Viewpoint) -> Result<Step> {
        if !matches!(self.governor.level().layers, LayerSpec::Surface(_)) {
            let nearest = self.settings.rig.cameras_for(
                std::slice::from_ref(&viewpoint.camera),
                &self.free,
                self.networks.views(),
            )?;
            let step = self.frames.at(viewpoint.step, &nearest);
            if step.left_out.is_empty() {
                return Ok(step);
            }
        }
        let cameras = self.cameras_for(&viewpoint.camera)?;
        Ok(self.frames.at(viewpoint.step, &cameras))
    }
}

fn rendered(frame: LiveFrame, layers: LayerSpec, read: Duration, step: Step, range: (f64, f64)) -> Rendered {
    Rendered {
        range,
        layers,
        views: frame.views,
        helpers: Vec::new(),
        planning: [read + frame.times.photos, frame.times.layers, Duration::ZERO],
        agreeing_share: None,
        left_out: step.left_out,
        frame: frame.frame,
    }
}

/// A session of all cameras, with the depth range of those read.
fn session(settings: &RigSettings, networks: &Networks, read: &[usize], policy: Policy) -> Result<LiveSession> {
    settings.session(networks.renderers(), read, policy)
}

impl Source for Video {
    fn scene(&self) -> &Scene {
        self.settings.rig.views.scene()
    }

    fn motion_scale(&self, _: usize) -> f64 {
        self.governor.level().scale
    }

    fn render_in_motion(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        let started = Instant::now();
        let step = self.step_in_motion(viewpoint)?;
        let read = started.elapsed();
        let frame = self.motion.render(&step.photos(), &viewpoint.camera).map_err(|error| step.with_left_out(error))?;
        Ok(rendered(frame, self.governor.level().layers.clone(), read, step, self.range))
    }

    fn record_motion_time(&mut self, rendered: &Rendered, took: Duration) {
        // The time to read does not depend on the level: it is taken off the budget.
        let read = rendered.planning[0].min(MOTION_BUDGET.mul_f64(0.75));
        let share = took.saturating_sub(read).div_duration_f64(MOTION_BUDGET - read);
        if std::mem::replace(&mut self.settled, true)
            && let Some(level) = self.governor.record(MOTION_BUDGET.mul_f64(share))
        {
            self.motion.set_layers(level.layers.clone());
            self.settled = false;
        }
    }

    fn render_at_rest(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        let started = Instant::now();
        let cameras = self.cameras_for(&viewpoint.camera)?;
        let step = self.frames.at(viewpoint.step, &cameras);
        let read = started.elapsed();
        // The depth of photos does not depend on the target: the session of the same photos is used again. Other layers do depend on it.
        let kept = self.still.take().filter(|still| still.step == viewpoint.step && still.cameras == cameras);
        let mut still = match kept.filter(|_| matches!(self.settings.layers, LayerSpec::Surface(_))) {
            Some(still) => still,
            None => {
                let session = session(&self.settings, &self.networks, &cameras, Policy::Once)?;
                Still { step: viewpoint.step, cameras, session }
            }
        };
        let frame =
            still.session.render(&step.photos(), &viewpoint.camera).map_err(|error| step.with_left_out(error))?;
        let range = self.settings.rig.views.depth_range(&still.cameras, &[])?;
        self.still = Some(still);
        Ok(rendered(frame, self.settings.layers.clone(), read, step, range))
    }

    fn photo(&mut self, view: usize, step: usize) -> Result<ImageRgb> {
        self.frames.photo(view, step)
    }

    fn unprepared(&self) -> usize {
        self.unprepared
    }

    fn needed_first(&self) -> usize {
        self.unprepared
    }

    /// Renders the first time step, at rest and then in motion.
    fn prepare(&mut self, near: &Camera) -> Result<()> {
        let viewpoint = Viewpoint { camera: near.clone(), step: 0 };
        self.unprepared = self.unprepared.saturating_sub(1);
        if self.unprepared > 0 {
            self.render_at_rest(&viewpoint)?;
        } else {
            self.render_in_motion(&viewpoint)?;
        }
        Ok(())
    }
}

/// A network that several renderers use, one at a time.
#[derive(Clone)]
struct Shared(Arc<Mutex<Box<dyn PlaneNetwork>>>);

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Box<dyn PlaneNetwork>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PlaneNetwork for Shared {
    fn views(&self) -> usize {
        self.lock().views()
    }

    fn name(&self) -> String {
        self.lock().name()
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        coverage: ArrayView4<'_, f32>,
        logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        self.lock().infer(hwv, coverage, logits)
    }
}

/// A network for each number of views, with its compositing.
pub(super) struct Networks {
    networks: Vec<(Shared, Alpha)>,
    batch: usize,
}

impl Networks {
    pub(super) fn new(renderers: Vec<Renderer>, batch: usize) -> Self {
        let share = |renderer: Renderer| {
            let alpha = renderer.alpha();
            (Shared(Arc::new(Mutex::new(renderer.into_network()))), alpha)
        };
        Self { networks: renderers.into_iter().map(share).collect(), batch }
    }

    /// The smallest and the largest number of views that one of them takes.
    pub(super) fn views(&self) -> (usize, usize) {
        let views = || self.networks.iter().map(|(network, _)| network.views());
        (views().min().unwrap_or(0), views().max().unwrap_or(0))
    }

    /// Renderers for a session.
    pub(super) fn renderers(&self) -> Vec<Renderer> {
        let renderer =
            |(network, alpha): &(Shared, Alpha)| Renderer::new(Box::new(network.clone()), *alpha, self.batch);
        self.networks.iter().map(renderer).collect()
    }
}

/// Memory for recent frames; the last one of each camera is kept in any case.
const KEPT_BYTES: usize = 128 << 20;
/// Memory of a frame.
const BYTES_PER_PIXEL: usize = 12;

/// The frames of all cameras; recent ones stay in memory.
pub(super) struct Frames {
    scene: Scene,
    cameras: Vec<CameraFrames>,
}

/// The photos of one time step.
pub(super) struct Step {
    /// By camera; `None` for a camera without a photo, or that was not read.
    photos: Vec<Option<Arc<ImageRgb>>>,
    /// Cameras that were read and have no photo, and why.
    pub(super) left_out: Vec<String>,
}

impl Step {
    pub(super) fn photos(&self) -> Vec<Option<&ImageRgb>> {
        self.photos.iter().map(Option::as_deref).collect()
    }

    /// Adds to an error the cameras that may have caused it.
    pub(super) fn with_left_out(&self, error: LiveError) -> anyhow::Error {
        match (&error, &self.left_out[..]) {
            (LiveError::Views(_), [_, ..]) => anyhow!("{error}; {}", self.left_out.join("; ")),
            _ => error.into(),
        }
    }
}

impl Frames {
    pub(super) fn new(scene: Scene, feeds: &[Feed]) -> Self {
        let pixels: usize = scene.views.iter().map(|view| view.camera.size().pixels()).sum();
        let capacity = (KEPT_BYTES / (BYTES_PER_PIXEL * pixels.max(1))).max(1);
        let camera = |feed: &Feed| CameraFrames { feed: feed.clone(), reader: None, kept: VecDeque::new(), capacity };
        Self { scene, cameras: feeds.iter().map(camera).collect() }
    }

    /// The photos of these cameras at a time step.
    pub(super) fn at(&mut self, step: usize, cameras: &[usize]) -> Step {
        let Self { scene, cameras: all } = self;
        let read = |(index, camera): (usize, &mut CameraFrames)| {
            cameras.contains(&index).then(|| camera.at(step, |photo| Ok(scene.fit(index, photo)?)))
        };
        let read: Vec<_> = all.par_iter_mut().enumerate().map(read).collect();
        let names = scene.views.iter().map(|view| &view.name);
        let left_out = names.zip(&read).filter_map(|(name, read)| Some((name, read.as_ref()?.as_ref().err()?)));
        let left_out = left_out.map(|(name, why)| format!("{name}: {why}")).collect();
        Step { photos: read.into_iter().map(|read| read?.ok()).collect(), left_out }
    }

    /// The photo of a camera at a time step.
    ///
    /// # Errors
    /// It has none, and why.
    pub(super) fn photo(&mut self, camera: usize, step: usize) -> Result<ImageRgb> {
        let mut read = self.at(step, &[camera]);
        let photo = read.photos.swap_remove(camera);
        photo.map(|photo| (*photo).clone()).ok_or_else(|| anyhow!("{}", read.left_out.join("; ")))
    }
}

/// The frames of a camera.
struct CameraFrames {
    feed: Feed,
    /// A reader, and the time step that it reads next.
    reader: Option<(Reader, usize)>,
    /// The last frames with their time steps, or why they could not be read; the newest first.
    kept: VecDeque<(usize, Result<Arc<ImageRgb>, String>)>,
    capacity: usize,
}

impl CameraFrames {
    fn at(&mut self, step: usize, fit: impl FnOnce(ImageRgb) -> Result<ImageRgb>) -> Result<Arc<ImageRgb>, String> {
        if let Some((_, kept)) = self.kept.iter().find(|(kept, _)| *kept == step) {
            return kept.clone();
        }
        let photo = match self.read(step) {
            Ok(Delivered::Photo(photo)) => fit(photo).map(Arc::new),
            Ok(Delivered::Missing) => Err(anyhow!("frame {step} is missing")),
            Ok(Delivered::Ended) => Err(anyhow!("no frames from {step} on")),
            Err(error) => {
                self.reader = None;
                Err(error)
            }
        };
        let photo = photo.map_err(|error| format!("{error:#}"));
        // After an error the reader is gone: the next request tries again.
        if self.reader.is_some() {
            self.kept.truncate(self.capacity - 1);
            self.kept.push_front((step, photo.clone()));
        }
        photo
    }

    /// Reads a frame. A video is only read forwards: for an earlier step it is opened again.
    fn read(&mut self, step: usize) -> Result<Delivered> {
        let (reader, next) = match self.reader.take().filter(|(_, next)| *next <= step) {
            Some(reader) => self.reader.insert(reader),
            None => self.reader.insert((self.feed.open()?, 0)),
        };
        while *next < step {
            if interrupt::requested() {
                bail!("interrupted");
            }
            if !reader.skip(*next)? {
                return Ok(Delivered::Ended);
            }
            *next += 1;
        }
        *next += 1;
        reader.read(step)
    }
}
