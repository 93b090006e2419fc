//! From a folder of posed photos to a picture: scene, views, depth range, layers and network in one.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use liveview::{Options, Synthesizer, Target};
//!
//! let mut synthesizer = Synthesizer::open("scene", &Options::default())?;
//! let frame = synthesizer.render(&Target::held_out("IMG_7.jpg"))?;
//! frame.picture.save("new.png")?;
//! # Ok(()) }
//! ```
//!
//! What it does by itself can be done step by step: [`Synthesizer::shots`] chooses the views and the depth range of each target,
//! [`Synthesizer::plan`] finds its layers, [`Synthesizer::render_layers`] renders them.

mod error;
mod model;
mod photo_cache;
mod plan;
mod target;

use std::fmt;
use std::path::Path;

pub use error::SynthesisError;
pub use model::{DEFAULT_VIEWS, Model, ModelOptions};
pub use photo_cache::PhotoCache;
pub use plan::Plan;
pub use target::{Shot, Target, TargetView, Targets};

use crate::layers::{LayerSpec, Layers};
use crate::network::{OrtNetwork, PlaneNetwork};
use crate::render::{Batch, Frame, Renderer};
use crate::scene::{Scene, SceneOptions};

/// How a [`Synthesizer`] is opened.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Options {
    /// How the scene is read.
    pub scene: SceneOptions,
    /// Nearest depth, scene units; `None`: the smallest that the scene tells of the views chosen.
    pub near: Option<f64>,
    /// Farthest depth, scene units, may be infinite; `None`: the largest that the scene tells of the views chosen.
    pub far: Option<f64>,
    /// Which model, and what runs it.
    pub model: ModelOptions,
    /// Which layers; `None`: those that the model recommends.
    pub layers: Option<LayerSpec>,
}

/// Renders new views of a scene.
pub struct Synthesizer<N = OrtNetwork> {
    photos: PhotoCache,
    renderer: Renderer<N>,
    layers: LayerSpec,
}

impl<N> fmt::Debug for Synthesizer<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { photos, renderer, layers } = self;
        f.debug_struct("Synthesizer")
            .field("photos", photos)
            .field("renderer", renderer)
            .field("layers", layers)
            .finish()
    }
}

impl Synthesizer {
    /// Opens a folder of posed photos, a model, and ONNX Runtime.
    ///
    /// # Errors
    ///
    /// [`SynthesisError`] for a folder that is no scene, a model or a library that is not found or does not fit.
    pub fn open(folder: impl AsRef<Path>, options: &Options) -> Result<Self, SynthesisError> {
        let photos = PhotoCache::new(Scene::open(folder.as_ref(), &options.scene)?, options.near, options.far);
        let model = Model::open(&options.model)?;
        let layers = match &options.layers {
            Some(layers) => layers.clone(),
            None => model.renderer.network().recommended_layers()?,
        };
        Ok(Self::new(photos, model.renderer, layers))
    }
}

impl<N: PlaneNetwork> Synthesizer<N> {
    /// Of parts that are there already.
    pub fn new(photos: PhotoCache, renderer: Renderer<N>, layers: LayerSpec) -> Self {
        Self { photos, renderer, layers }
    }

    /// The scene, with those of its photos that are in memory.
    pub fn photos(&self) -> &PhotoCache {
        &self.photos
    }

    /// As [`Self::photos`], to load or to forget some.
    pub fn photos_mut(&mut self) -> &mut PhotoCache {
        &mut self.photos
    }

    /// What runs the network.
    pub fn renderer(&self) -> &Renderer<N> {
        &self.renderer
    }

    /// As [`Self::renderer`], to change what it may leave out.
    pub fn renderer_mut(&mut self) -> &mut Renderer<N> {
        &mut self.renderer
    }

    /// Which layers it renders on.
    pub fn layers(&self) -> &LayerSpec {
        &self.layers
    }

    /// Renders one target from the nearest V views, never from one that is held out.
    ///
    /// # Errors
    ///
    /// [`SynthesisError`]: no such view, too few views that look the target's way, a depth range that nobody tells, a photo
    /// that is damaged, or a network that failed.
    pub fn render(&mut self, target: &Target) -> Result<Frame, SynthesisError> {
        let mut frame = None;
        self.render_all(target.resolve(self.photos.scene())?, |_, rendered| frame = Some(rendered))?;
        Ok(frame.expect("one target"))
    }

    /// Renders targets one after the other, and hands each frame to `take`; photos that no later one needs are let go.
    ///
    /// # Errors
    ///
    /// As [`Self::render`].
    pub fn render_all(&mut self, targets: Targets, mut take: impl FnMut(&Shot, Frame)) -> Result<(), SynthesisError> {
        let shots = self.shots(targets)?;
        for (index, shot) in shots.iter().enumerate() {
            self.photos.load_for(shot, &shots[index + 1..])?;
            let plan = self.plan(shot)?;
            take(shot, self.render_layers(shot, &plan.layers, |_| ())?);
        }
        Ok(())
    }

    /// The views and the depth range of each target. The frames of a path share one range, lest their planes jump.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Views`] and [`SynthesisError::UnknownDepth`].
    pub fn shots(&self, targets: Targets) -> Result<Vec<Shot>, SynthesisError> {
        let given = match &self.layers {
            LayerSpec::List(list) => Some((1.0 / list[0], 1.0 / list[list.len() - 1])),
            _ => None,
        };
        self.photos.shots(targets, self.renderer.network().views(), given)
    }

    /// Renders a shot whose photos are loaded on these layers, and shows its stages to `observe`
    /// ([`Renderer::render_observed`]).
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Render`].
    pub fn render_layers(
        &mut self,
        shot: &Shot,
        layers: &Layers,
        observe: impl FnMut(&Batch<'_>),
    ) -> Result<Frame, SynthesisError> {
        let sources = self.photos.sources(&shot.views);
        Ok(self.renderer.render_observed(&sources, &shot.target, layers, observe)?)
    }
}
