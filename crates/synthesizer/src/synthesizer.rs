//! A scene, a model and layers in one: renders targets.

use std::path::Path;
use std::time::{Duration, Instant};

use ndarray::s;

use crate::{
    Carried, FrameInput, LayerSource, LayerSpec, LoadedShot, OpenedRenderer, Options, PhotosWithDepth, Plan,
    ScenePhotos, SceneViews, Shot, SynthesisError, Target, Targets, find_layers, memory,
};
use liveview::layers::Layers;
use liveview::network::RunEnd;
use liveview::render::{Frame, Observer, RenderRequest, Renderer, ViewCorrection};
use liveview_scene::Scene;
use liveview_surface::{EXTRA_PHOTOS, PhotoCorrection, Reuse, TargetSurface, photo_corrections};

/// Renders new views of a scene: [`Self::render`], or step by step [`Self::shots`], [`Self::load`],
/// [`Self::plan`] and [`Self::render_plan`].
#[derive(Debug)]
pub struct Synthesizer {
    photos: ScenePhotos,
    renderer: Renderer,
    layers: LayerSpec,
    /// Which differences between photos are corrected, for surface layers and for planes. With
    /// [`PhotoCorrection::NONE`] planes do without the photos' depth, and lie from near to far.
    pub photo_correction: PhotoCorrection,
    run_end: Option<RunEnd>,
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
        let mut photos = ScenePhotos::new(SceneViews::new(scene, options.near, options.far));
        options.cache.iter().try_for_each(|folder| photos.keep_depths_in(folder))?;
        let OpenedRenderer { renderer, layers, model } = options.model.open_renderer(options.layers.as_ref())?;
        let photo_correction = options.photo_correction;
        let run_end = model.map(|model| model.run_end);
        Ok(Self { photo_correction, run_end, ..Self::new(photos, renderer, layers) })
    }

    /// A synthesizer of parts that are already open; any [`PlaneNetwork`](liveview::network::PlaneNetwork) can be its network.
    /// `photos` are the [`SceneViews`] of a scene, or [`ScenePhotos`] that settings were changed
    /// of.
    pub fn new(photos: impl Into<ScenePhotos>, renderer: Renderer, layers: LayerSpec) -> Self {
        Self { photos: photos.into(), renderer, layers, photo_correction: PhotoCorrection::default(), run_end: None }
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

    /// Ends the runs of the model that [`Self::open`] opened from another thread; `None` without one.
    pub fn run_end(&self) -> Option<RunEnd> {
        self.run_end.clone()
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
        let targets = match target {
            Target::HeldOut(name) => Targets::held_out(self.scene(), vec![self.scene().view_index(name)?]),
            Target::Camera(camera) => Targets::cameras(vec![camera.clone()]),
        };
        Ok(self.frames(targets)?.next().expect("one target")?.1)
    }

    /// The frames of targets, each rendered when it is asked for, with its shot. Photos that no later target
    /// needs are dropped.
    ///
    /// # Errors
    ///
    /// As [`Self::shots`] before the first frame; then as [`Self::render`].
    pub fn frames(
        &mut self,
        targets: Targets,
    ) -> Result<impl Iterator<Item = Result<(Shot, Frame), SynthesisError>>, SynthesisError> {
        let shots = self.shots(targets)?;
        Ok((0..shots.len()).map(move |index| {
            let loaded = self.load(&shots[index], &shots[index + 1..])?;
            let plan = self.plan(&loaded)?;
            Ok((shots[index].clone(), self.render_plan(&loaded, &plan, None)?))
        }))
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
        let helpers = if self.uses_depth() { EXTRA_PHOTOS } else { 0 };
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

    /// Whether it needs the depth of the photos: for surface layers, and for planes unless photos stay
    /// as they are ([`Self::photo_correction`]); guided layers do without.
    pub fn uses_depth(&self) -> bool {
        match &self.layers {
            LayerSpec::Guided { .. } => false,
            LayerSpec::Surface(_) => true,
            LayerSpec::Planes(_) | LayerSpec::List(_) | LayerSpec::Select { .. } => {
                self.photo_correction != PhotoCorrection::NONE
            }
        }
    }

    /// Finds the layers of a shot.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Layers`]; [`SynthesisError::Render`] where planes are selected from a
    /// render; [`SynthesisError::Scene`] where a photo is needed for its depth and cannot be read.
    pub fn plan(&mut self, shot: &LoadedShot) -> Result<Plan, SynthesisError> {
        let started = Instant::now();
        let (corrections, (near, far)) = self.for_planes(shot)?;
        let input = FrameInput {
            target: &shot.shot().target,
            near,
            far,
            sources: &shot.sources(),
            is_followed: false,
            photo_correction: self.photo_correction,
        };
        let mut plan = find_layers::<SynthesisError>(
            &self.layers,
            &mut Carried::default(),
            &input,
            Reuse::Nothing,
            // The photos of a scene do not change, nor does their depth.
            |_| self.photos.with_depth(shot),
        )?;
        if !corrections.is_empty() {
            plan.corrections = corrections;
        }
        if plan.source != LayerSource::Fixed || !plan.corrections.is_empty() {
            plan.search = started.elapsed();
        }
        let Some(selection) = plan.selects.take() else { return Ok(plan) };
        let started = Instant::now();
        let frame = self.render_plan(shot, &plan, None)?;
        let layers = selection.planes(&frame, self.renderer.alpha())?;
        Ok(Plan { layers, selection: started.elapsed(), ..plan })
    }

    /// A plan of planes that are known already, such as those that an earlier frame selected.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Scene`] where a photo is needed for its depth and cannot be read.
    pub fn plan_on(&mut self, shot: &LoadedShot, planes: Layers) -> Result<Plan, SynthesisError> {
        let started = Instant::now();
        let (corrections, _) = self.for_planes(shot)?;
        let search = if corrections.is_empty() { Duration::ZERO } else { started.elapsed() };
        Ok(Plan { corrections, search, ..Plan::known(planes) })
    }

    /// What the photos' depth says for planes: how their photos are corrected, and between which depths
    /// (near, far; scene units) they lie.
    fn for_planes(&mut self, shot: &LoadedShot) -> Result<(Vec<ViewCorrection>, (f64, f64)), SynthesisError> {
        let (range, correction) = ((shot.shot().near, shot.shot().far), self.photo_correction);
        if !self.uses_depth() || matches!(self.layers, LayerSpec::Surface(_)) {
            return Ok((Vec::new(), range));
        }
        let PhotosWithDepth { maps, photos, rendered_from, .. } = self.photos.with_depth(shot)?;
        let target = &shot.shot().target;
        if !shot.shot().refines_range {
            return Ok((photo_corrections(maps, &photos, rendered_from, target, correction), range));
        }
        let surface = TargetSurface::find(maps, &photos, rendered_from, target, correction);
        let seen = surface.seen_range(range);
        Ok((surface.corrections, seen))
    }

    /// How many pixels of a shot have each of these planes (1/scene unit, near → far) as their best
    /// one: the paper's histogram, of the photos as they are.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Layers`] and [`SynthesisError::Render`].
    pub fn histogram(&mut self, shot: &LoadedShot, disparities: &[f64]) -> Result<Vec<u64>, SynthesisError> {
        let plan = Plan::known(Layers::planes(disparities)?);
        Ok(self.render_plan(shot, &plan, None)?.plane_histogram(disparities.len()))
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
        let visibility = plan.surface.as_ref().map(TargetSurface::visibility);
        let sources = shot.sources();
        let mut request = RenderRequest::new(&sources, &shot.shot().target, &plan.layers);
        request.corrections = &plan.corrections;
        request.visibility = visibility.as_ref();
        request.observer = observer.map(|observer| observer as Observer<'_>);
        let mut frame = self.renderer.render(request)?;
        let (target, surface) = (&shot.shot().target, plan.surface.as_ref());
        let padded = surface.and_then(|found| found.surface.confidence());
        frame.confidence = padded.map(|map| map.slice_move(s![..target.height(), ..target.width()]));
        Ok(frame)
    }
}
