//! A scene, a model and layers, opened by the options of a command that renders.

use std::ops::ControlFlow;
use std::time::Duration;

use anyhow::{Context, Result};
use indicatif::ProgressBar;
use liveview::render::{Batch, Frame, Renderer, StageTimes};
use liveview_live::rig::{Rig, RigSettings};
use liveview_synthesizer::agreement;
use liveview_synthesizer::{LayerSpec, LoadedShot, Plan, ScenePhotos, SceneViews, Synthesizer};
use ndarray::Axis;

use crate::args::{LayerArgs, LayerChoice, ModelArgs, ModelInfo};
use crate::console::{print_message, print_notes, progress};
use crate::outputs::OutputPlan;

/// A synthesizer, with the model's description and a progress bar.
#[derive(Debug)]
pub(crate) struct Job {
    /// The scene, the model and the layers.
    pub(crate) synthesizer: Synthesizer,
    /// The model, for the summary.
    pub(crate) model: ModelInfo,
    /// Counts photos whose depth is searched, then layers, or pictures if there are several.
    pub(crate) progress: ProgressBar,
    /// Number of pictures to render, if the progress counts them.
    pictures: Option<u64>,
    /// Pictures rendered.
    rendered: u64,
    /// The share of the pixels of the last picture on which its photos agree ([`liveview_synthesizer::agreement`]); `None` with a network and
    /// for layers that are not along the surface.
    pub(crate) agreeing_share: Option<f64>,
}

impl Job {
    /// Opens a job by the options of a command.
    pub(crate) fn open(views: SceneViews, layers: &LayerArgs, model: &ModelArgs) -> Result<Self> {
        let output_plan = OutputPlan::new(views.scene());
        layers.cache.iter().try_for_each(|folder| output_plan.cache("--cache", folder))?;
        let mut photos = ScenePhotos::new(views);
        layers.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder)).context("--cache")?;
        let given = layers.choice.given();
        let mut job = Self::of(photos, model.with_alpha(layers.choice.alpha()).open_for(given.as_ref())?);
        job.synthesizer.photo_correction = layers.photo_correction();
        if let (Some(folder), false) = (&layers.cache, job.synthesizer.uses_depth()) {
            let (folder, layers) = (folder.display(), job.synthesizer.layers());
            print_message("note", format!("--cache {folder}: has no effect, {layers} does not use the photos' depth"));
        }
        Ok(job)
    }

    /// Opens a job with these layers, or those that the model recommends.
    pub(crate) fn with_layers(views: SceneViews, model: &ModelArgs, layers: Option<&LayerSpec>) -> Result<Self> {
        Ok(Self::of(views.into(), model.open_for(layers)?))
    }

    fn of(photos: ScenePhotos, (renderer, layers, model): (Renderer, LayerSpec, ModelInfo)) -> Self {
        let synthesizer = Synthesizer::new(photos, renderer, layers);
        Self { synthesizer, model, progress: ProgressBar::hidden(), pictures: None, rendered: 0, agreeing_share: None }
    }

    /// Shows the progress of so many pictures, on a terminal.
    pub(crate) fn show_progress(&mut self, pictures: usize) -> Result<()> {
        self.progress = progress()?;
        self.pictures = (pictures > 1).then_some(pictures as u64);
        let bar = self.progress.clone();
        self.synthesizer.photos_mut().on_depth_search(move |next| {
            count(&bar, "photos' depth", next.done as u64, next.count as u64);
            ControlFlow::Continue(())
        });
        Ok(())
    }

    /// Computes the layers of a shot.
    pub(crate) fn plan(&mut self, shot: &LoadedShot) -> Result<Plan> {
        let plan = self.synthesizer.plan(shot)?;
        let notes = self.synthesizer.photos_mut().take_notes();
        self.progress.suspend(|| print_notes(&notes));
        Ok(plan)
    }

    /// Renders a shot on the layers of its plan.
    pub(crate) fn render(&mut self, shot: &LoadedShot, plan: &Plan) -> Result<Frame> {
        let progress = &self.progress;
        match self.pictures {
            Some(pictures) => count(progress, "pictures", self.rendered, pictures),
            None => count(progress, "layers", 0, plan.layers.len() as u64),
        }
        let counts_layers = self.pictures.is_none();
        let mut observe = |batch: &Batch<'_>| {
            if counts_layers {
                progress.inc(batch.disparity.len_of(Axis(0)) as u64);
            }
        };
        let without_network = self.model.model.is_none();
        let (frame, agreeing) = agreement::render(&mut self.synthesizer, shot, plan, without_network, &mut observe)?;
        self.agreeing_share = agreeing;
        self.rendered += 1;
        Ok(frame)
    }
}

/// Shows that so many of so many are done.
fn count(bar: &ProgressBar, what: &'static str, done: u64, of: u64) {
    if bar.prefix() != what {
        bar.set_prefix(what);
        bar.reset_eta();
    }
    bar.set_length(of);
    bar.set_position(done);
}

/// Opens the models for a rig, also those for fewer views.
pub(crate) fn open_rig(
    rig: Rig,
    model: &ModelArgs,
    layers: &LayerChoice,
    keep_exposure: bool,
) -> Result<(RigSettings, ModelInfo)> {
    let given = layers.given();
    let (renderer, layers, info) = model.with_alpha(layers.alpha()).open_for(given.as_ref())?;
    let mut renderers = model.open_smaller(renderer.network().views(), given.as_ref())?;
    renderers.push(renderer);
    Ok((RigSettings { rig, renderers, with_models: info.model.is_some(), layers, keep_exposure }, info))
}

/// Wall time of each stage of one picture.
#[derive(Debug)]
pub(crate) struct Times {
    /// Reading and decoding the photos that were not in memory.
    pub(crate) photos: Duration,
    /// Searching depth: the guided search, or the depth of the photos.
    pub(crate) depth: Duration,
    /// The render that planes were selected from.
    pub(crate) select: Duration,
    /// The name of the stage that computes opacities and view weights: `network`, or `blend`
    /// without one.
    pub(crate) weighting: &'static str,
    /// Warp, weighting and composite.
    pub(crate) stages: StageTimes,
}

impl Times {
    /// The name and time of each stage.
    pub(crate) fn stages(&self) -> [(&'static str, Duration); 6] {
        let Self { photos, depth, select, weighting, stages } = *self;
        [
            ("photos", photos),
            ("depth", depth),
            ("select", select),
            ("warp", stages.warp),
            (weighting, stages.network),
            ("composite", stages.composite),
        ]
    }

    /// The sum of all stages.
    pub(crate) fn total(&self) -> Duration {
        self.stages().iter().map(|(_, time)| *time).sum()
    }
}

/// A duration as text.
pub(crate) fn time_text(time: Duration) -> String {
    match time.as_secs_f64() {
        seconds if seconds >= 10.0 => format!("{seconds:.1} s"),
        seconds if seconds >= 0.01 => format!("{:.0} ms", 1e3 * seconds),
        seconds => format!("{:.1} ms", 1e3 * seconds),
    }
}
