//! A scene, a model and layers in one: renders targets.

use std::path::Path;

use super::error::SynthesisError;
use super::memory;
use super::options::Options;
use super::plan::Plan;
use super::scene_photos::ScenePhotos;
use super::scene_views::SceneViews;
use super::shot::{LoadedShot, Shot};
use super::target::{Target, Targets};
use crate::layers::LayerSpec;
use crate::render::{Frame, Observer, RenderRequest, Renderer};
use crate::scene::Scene;
#[cfg(feature = "surface")]
use crate::surface::{EXTRA_PHOTOS, PhotoCorrection, TargetSurface};

/// Renders new views of a scene: [`Self::render`], or step by step [`Self::shots`], [`Self::load`],
/// [`Self::plan`] and [`Self::render_plan`].
#[derive(Debug)]
pub struct Synthesizer {
    pub(super) photos: ScenePhotos,
    pub(super) renderer: Renderer,
    pub(super) layers: LayerSpec,
    #[cfg(feature = "surface")]
    pub(super) photo_correction: PhotoCorrection,
    #[cfg(feature = "surface")]
    pub(super) searches_holes: bool,
}

impl Synthesizer {
    /// Opens a folder of posed photos, a model, and ONNX Runtime.
    ///
    /// # Errors
    ///
    /// [`SynthesisError`] for a folder that is not a scene, or a model or a library that is missing
    /// or does not fit.
    pub fn open(folder: impl AsRef<Path>, options: &Options) -> Result<Self, SynthesisError> {
        Self::with_scene(Scene::open(folder.as_ref(), &options.scene)?, options)
    }

    /// As [`Self::open`], of a scene that is open already, such as one in memory
    /// ([`Scene::in_memory`]); [`Options::scene`] is not used.
    ///
    /// # Errors
    ///
    /// [`SynthesisError`] for a model or a library that is missing or does not fit.
    pub fn with_scene(scene: Scene, options: &Options) -> Result<Self, SynthesisError> {
        let views = SceneViews::new(scene, options.near, options.far);
        #[cfg_attr(not(feature = "surface"), expect(unused_mut))]
        let mut photos = ScenePhotos::new(views);
        #[cfg(feature = "surface")]
        options.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder))?;
        let (renderer, layers) = options.model.open_renderer(options.layers.as_ref())?;
        Ok(Self {
            #[cfg(feature = "surface")]
            photo_correction: options.photo_correction,
            ..Self::new(photos, renderer, layers)
        })
    }

    /// A synthesizer of parts that are already open; any [`PlaneNetwork`](crate::network::PlaneNetwork) can be its network.
    /// `photos` are the [`SceneViews`] of a scene, or [`ScenePhotos`] that settings were changed
    /// of.
    pub fn new(photos: impl Into<ScenePhotos>, renderer: Renderer, layers: LayerSpec) -> Self {
        Self {
            photos: photos.into(),
            renderer,
            layers,
            #[cfg(feature = "surface")]
            photo_correction: PhotoCorrection::default(),
            #[cfg(feature = "surface")]
            searches_holes: true,
        }
    }

    /// Sets which differences between photos are corrected, for surface layers and for planes. With
    /// [`PhotoCorrection::NONE`] planes do without the photos' depth, and lie from near to far.
    #[cfg(feature = "surface")]
    pub fn set_photo_correction(&mut self, photo_correction: PhotoCorrection) {
        self.photo_correction = photo_correction;
    }

    /// Sets whether the holes of surfaces, where they are more than 5 %, are searched at the target, as
    /// they are by default. Pictures in motion may do without: a frame of 270×480 pixels takes 60 ms in
    /// place of 180 (two threads).
    #[cfg(feature = "surface")]
    pub fn set_hole_search(&mut self, searches_holes: bool) {
        self.searches_holes = searches_holes;
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        self.views().scene()
    }

    /// The views of the scene, and the depth range given for it.
    pub fn views(&self) -> &SceneViews {
        self.photos.views()
    }

    /// The photos of the scene, to set where their depth is kept.
    pub fn photos_mut(&mut self) -> &mut ScenePhotos {
        &mut self.photos
    }

    /// The renderer, with the network.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// As [`Self::renderer`], to change its settings.
    pub fn renderer_mut(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// The renderer, for another synthesizer.
    pub fn into_renderer(self) -> Renderer {
        self.renderer
    }

    /// Sets which layers it renders on; photos and their depth stay in memory.
    pub fn set_layers(&mut self, layers: LayerSpec) {
        self.layers = layers;
    }

    /// Which layers it renders on.
    pub fn layers(&self) -> &LayerSpec {
        &self.layers
    }

    /// Renders one target from the nearest V views; a held-out view is never one of these.
    ///
    /// # Errors
    ///
    /// [`SynthesisError`]: no such view, too few views that face the target's direction, an unknown
    /// depth range, a damaged photo, or a network that failed.
    pub fn render(&mut self, target: &Target) -> Result<Frame, SynthesisError> {
        let mut frame = None;
        self.render_all(target.resolve(self.scene())?, |_, rendered| frame = Some(rendered))?;
        Ok(frame.expect("one target"))
    }

    /// Renders targets one after the other, and passes each frame to `take`. Photos that no later
    /// target needs are dropped.
    ///
    /// # Errors
    ///
    /// As [`Self::render`].
    pub fn render_all(&mut self, targets: Targets, mut take: impl FnMut(&Shot, Frame)) -> Result<(), SynthesisError> {
        let shots = self.shots(targets)?;
        for (index, shot) in shots.iter().enumerate() {
            let loaded = self.load(shot, &shots[index + 1..])?;
            let plan = self.plan(&loaded)?;
            take(shot, self.render_plan(&loaded, &plan, None)?);
        }
        Ok(())
    }

    /// Chooses the views and the depth range of each target. The frames of a path share one range,
    /// so that their planes do not jump.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Views`], [`SynthesisError::UnknownDepth`], and [`SynthesisError::Memory`]
    /// for a target that needs more memory than is available.
    pub fn shots(&self, targets: Targets) -> Result<Vec<Shot>, SynthesisError> {
        let given = match &self.layers {
            LayerSpec::List(list) => Some((1.0 / list[0], 1.0 / list[list.len() - 1])),
            _ => None,
        };
        #[cfg(feature = "surface")]
        let helpers = if self.uses_depth() { EXTRA_PHOTOS } else { 0 };
        #[cfg(not(feature = "surface"))]
        let helpers = 0;
        let shots = self.views().shots(targets, self.renderer.network().views(), helpers, given)?;
        memory::check(self.scene(), &self.renderer, (&self.layers, self.uses_depth()), &shots)?;
        Ok(shots)
    }

    /// Loads the photos of a shot ([`ScenePhotos::load`]); `later` are the shots that follow, in
    /// order.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] for a photo that cannot be read.
    pub fn load(&mut self, shot: &Shot, later: &[Shot]) -> Result<LoadedShot, SynthesisError> {
        self.photos.load(shot, later)
    }

    /// Renders a shot on the layers of its plan; `observer` is shown its stages
    /// ([`RenderRequest::observer`]).
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Render`].
    pub fn render_plan(
        &mut self,
        shot: &LoadedShot,
        plan: &Plan,
        observer: Option<Observer<'_>>,
    ) -> Result<Frame, SynthesisError> {
        #[cfg(feature = "surface")]
        let visibility = plan.surface.as_ref().map(TargetSurface::visibility);
        #[cfg(not(feature = "surface"))]
        let visibility = None;
        let sources = shot.sources();
        let mut request = RenderRequest::new(&sources, &shot.shot().target, &plan.layers);
        request.corrections = &plan.corrections;
        request.visibility = visibility.as_ref();
        request.observer = observer.map(|observer| observer as Observer<'_>);
        Ok(self.renderer.render(request)?)
    }
}
