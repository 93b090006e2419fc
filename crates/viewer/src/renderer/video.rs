//! The video of a rig: at rest as `liveview video` renders a time step by itself.

use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::live::{LiveFrame, LiveSession, LiveSettings, Policy};
use liveview::network::RunEnd;
use liveview::{Camera, ImageRgb, LayerSpec, Scene};
use liveview_common::args::layers::{LayerArgs, given_or_recommended};
use liveview_common::args::model::ModelArgs;
use liveview_common::args::model_info::ModelInfo;
use liveview_live::governor::Governor;
use liveview_live::rig::{Rig, SPARE};

use super::frames::{Frames, Step};
use super::shared::Networks;
use super::source::{BUDGET, Rendered, Source};
use crate::wish::Moment;

/// A session for what moves, and one for each time step that a picture rests on: what the first carries over is not as good.
pub(crate) struct Video {
    rig: Rig,
    frames: Frames,
    /// Cameras that are not held out.
    free: Vec<usize>,
    /// Nearest and farthest depth of these, scene units.
    range: (f64, f64),
    networks: Networks,
    layers: LayerSpec,
    keep_exposure: bool,
    moving: LiveSession,
    governor: Governor,
    /// Whether a frame of the governor's level has been rendered: the first takes longer.
    settled: bool,
    still: Option<Still>,
    unprepared: usize,
}

/// A session of one time step.
struct Still {
    step: usize,
    /// The cameras read: of each the depth is found with the others.
    read: Vec<usize>,
    session: LiveSession,
}

impl Video {
    pub(crate) fn open(
        rig: Rig,
        free: Vec<usize>,
        layers: &LayerArgs,
        model: &ModelArgs,
    ) -> Result<(Self, ModelInfo, Vec<RunEnd>)> {
        let given = layers.given();
        let (renderer, info) = model.open_for(given.as_ref())?;
        let views = renderer.network().views();
        let spec = given_or_recommended(given.as_ref(), None, renderer.network())?;
        let governor = Governor::new(BUDGET, &spec, renderer.network().predicts_opacity());
        let mut renderers = model.open_smaller(views, given.as_ref())?;
        renderers.push(renderer);
        let runs = renderers.iter().filter_map(|renderer| renderer.network().run_end()).collect();
        let networks = Networks::new(renderers, model.batch);
        let range = rig.photos.depth_range(&free)?;
        let moving = session(&rig, &free, &networks, &spec, layers.keep_exposure)?;
        let video = Self {
            frames: Frames::new(rig.photos.scene().clone(), &rig.feeds),
            rig,
            free,
            range,
            networks,
            layers: spec,
            keep_exposure: layers.keep_exposure,
            moving,
            governor,
            settled: false,
            still: None,
            unprepared: 2,
        };
        Ok((video, info, runs))
    }

    /// The nearest depth of the rig, scene units.
    pub(crate) fn near(&self) -> f64 {
        self.range.0
    }

    /// The cameras to read for a target.
    ///
    /// # Errors
    /// Too few look its way.
    pub(crate) fn cameras_for(&self, target: &Camera) -> Result<Vec<usize>> {
        let (fewest, views) = self.networks.views();
        self.rig.cameras_for(std::slice::from_ref(target), &self.free, (fewest, views + SPARE))
    }

    /// What is read for a picture in motion: no more than it takes, as far as that delivers.
    fn step_in_motion(&mut self, at: &Moment) -> Result<Step> {
        if !matches!(self.governor.level().layers, LayerSpec::Surface(_)) {
            let nearest = self.rig.cameras_for(std::slice::from_ref(&at.camera), &self.free, self.networks.views())?;
            let step = self.frames.at(at.step, &nearest);
            if step.left_out.is_empty() {
                return Ok(step);
            }
        }
        let cameras = self.cameras_for(&at.camera)?;
        Ok(self.frames.at(at.step, &cameras))
    }
}

fn rendered(frame: LiveFrame, layers: LayerSpec, read: Duration, step: Step, range: (f64, f64)) -> Rendered {
    Rendered {
        range,
        layers,
        views: frame.views,
        helpers: Vec::new(),
        before: [read + frame.times.photos, frame.times.layers, Duration::ZERO],
        left_out: step.left_out,
        frame: frame.frame,
    }
}

/// A session for all cameras, the depth range that of some.
fn session(
    rig: &Rig,
    read: &[usize],
    networks: &Networks,
    layers: &LayerSpec,
    keep_exposure: bool,
) -> Result<LiveSession> {
    let (near, far) = rig.photos.depth_range(read)?;
    let mut settings = LiveSettings::new(near, far);
    settings.policy = Policy::default_for(layers);
    (settings.layers, settings.keep_exposure) = (layers.clone(), keep_exposure);
    let cameras = rig.photos.scene().views.iter().map(|view| view.camera.clone()).collect();
    Ok(LiveSession::new(cameras, networks.renderers(), settings)?)
}

impl Source for Video {
    fn scene(&self) -> &Scene {
        self.rig.photos.scene()
    }

    fn scale(&self, _: usize) -> f64 {
        self.governor.level().scale
    }

    fn in_motion(&mut self, at: &Moment) -> Result<Rendered> {
        let started = Instant::now();
        let step = self.step_in_motion(at)?;
        let read = started.elapsed();
        let frame = self.moving.render(&step.photos(), &at.camera).map_err(|error| step.blamed(error))?;
        Ok(rendered(frame, self.governor.level().layers.clone(), read, step, self.range))
    }

    fn note(&mut self, rendered: &Rendered, took: Duration) {
        // Reading takes its time whatever the level: of the budget there is so much less.
        let read = rendered.before[0].min(BUDGET.mul_f64(0.75));
        let share = took.saturating_sub(read).div_duration_f64(BUDGET - read);
        if std::mem::replace(&mut self.settled, true)
            && let Some(level) = self.governor.note(BUDGET.mul_f64(share))
        {
            self.moving.set_layers(level.layers.clone());
            self.settled = false;
        }
    }

    fn at_rest(&mut self, at: &Moment) -> Result<Rendered> {
        let started = Instant::now();
        let cameras = self.cameras_for(&at.camera)?;
        let step = self.frames.at(at.step, &cameras);
        let read = started.elapsed();
        // The depth of photos that stay the same does not depend on the target; what else is found does.
        let kept = self.still.take().filter(|still| still.step == at.step && still.read == cameras);
        let mut still = match kept.filter(|_| matches!(self.layers, LayerSpec::Surface(_))) {
            Some(still) => still,
            None => {
                let session = session(&self.rig, &cameras, &self.networks, &self.layers, self.keep_exposure)?;
                Still { step: at.step, read: cameras, session }
            }
        };
        let frame = still.session.render(&step.photos(), &at.camera).map_err(|error| step.blamed(error))?;
        let range = self.rig.photos.depth_range(&still.read)?;
        self.still = Some(still);
        Ok(rendered(frame, self.layers.clone(), read, step, range))
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
    fn prepare(&mut self, at: &Camera) -> Result<()> {
        let at = Moment { camera: at.clone(), step: 0 };
        self.unprepared = self.unprepared.saturating_sub(1);
        if self.unprepared > 0 {
            self.at_rest(&at)?;
        } else {
            self.in_motion(&at)?;
        }
        Ok(())
    }
}
