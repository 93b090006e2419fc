//! A session: photos of a time step and a target camera in, a frame out.

use std::fmt;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::policy::{LayerSource, Policy};
use super::propagate::{Surface, TargetViews};
use crate::geometry::Camera;
use crate::geometry::{Size, TooFewViews, choose_views};
use crate::image::ImageRgb;
use crate::layers::guided::{GuidedSearch, Levels};
use crate::layers::{
    LayerSpec, Layers, LayersError, kmeans_planes, plane_histogram, select_planes, uniform_disparities,
};
use crate::network::PlaneNetwork;
use crate::render::{Frame, RenderError, Renderer, StageTimes};
use crate::warp::{SourceView, Texture};

/// How a session renders.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LiveSettings {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Which layers each frame is rendered on.
    pub layers: LayerSpec,
    /// When they are found anew.
    pub policy: Policy,
}

impl LiveSettings {
    /// Two guided layers, the surface propagated from frame to frame.
    pub fn new(near: f64, far: f64) -> Self {
        let layers = LayerSpec::guided(2);
        Self { near, far, policy: Policy::default_for(&layers), layers }
    }
}

/// Why a time step gave no frame. The session can go on with the next.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// A session without a network.
    #[error("a session needs a network: expected at least one")]
    NoNetwork,
    /// Not one entry per camera.
    #[error("{found} photos were given for {expected} cameras; expected one for each, or none in its place")]
    Photos {
        /// Cameras of the rig.
        expected: usize,
        /// Entries given.
        found: usize,
    },
    /// A photo of another size than its camera's.
    #[error("the photo of camera {camera} is {found}; expected {expected}")]
    Size {
        /// Index of the camera.
        camera: usize,
        /// Of the photo.
        found: Size,
        /// Of the camera.
        expected: Size,
    },
    /// Fewer photos than the smallest network takes.
    #[error(transparent)]
    Views(#[from] TooFewViews),
    /// No layers between near and far.
    #[error(transparent)]
    Layers(#[from] LayersError),
    /// The network failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// A rendered time step.
#[derive(Debug, Clone)]
pub struct LiveFrame {
    /// The picture, with its depth.
    pub frame: Frame,
    /// Where its layers came from.
    pub layer_source: LayerSource,
    /// Indices of the cameras it was rendered from, nearest first.
    pub views: Vec<usize>,
    /// Where the time went.
    pub times: LiveTimes,
}

/// Wall time per stage of one time step.
#[derive(Debug, Clone, Copy, Default)]
pub struct LiveTimes {
    /// Making the photos ready for sampling.
    pub photos: Duration,
    /// Finding the layers.
    pub layers: Duration,
    /// Rendering them.
    pub stages: StageTimes,
}

impl LiveTimes {
    /// All of it.
    pub fn total(&self) -> Duration {
        self.photos + self.layers + self.stages.warp + self.stages.network + self.stages.composite
    }
}

/// Renders the time steps of a rig, one after the other.
pub struct LiveSession<N> {
    cameras: Vec<Camera>,
    /// Largest V first.
    renderers: Vec<Renderer<N>>,
    settings: LiveSettings,
    history: History,
}

/// What a session knows from the frames before.
#[derive(Default)]
struct History {
    /// Of the last frame, for guided layers.
    surface: Option<Surface>,
    /// Planes that an earlier frame found.
    planes: Option<Layers>,
    /// Frames since these were found.
    age: usize,
}

impl<N> fmt::Debug for LiveSession<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LiveSession")
            .field("cameras", &self.cameras.len())
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}

impl<N: PlaneNetwork> LiveSession<N> {
    /// A session for the cameras of a rig. Of several networks the one with the most views serves, another only while
    /// fewer photos are at hand than that takes.
    ///
    /// # Errors
    ///
    /// [`LiveError::NoNetwork`], or [`LiveError::Layers`] unless 0 < near < far.
    pub fn new(
        cameras: Vec<Camera>,
        mut renderers: Vec<Renderer<N>>,
        settings: LiveSettings,
    ) -> Result<Self, LiveError> {
        uniform_disparities(settings.near, settings.far, 2)?;
        renderers.sort_by_key(|renderer| std::cmp::Reverse(renderer.network().views()));
        if renderers.is_empty() {
            return Err(LiveError::NoNetwork);
        }
        Ok(Self { cameras, renderers, settings, history: History::default() })
    }

    /// The cameras of the rig.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// Layers of the frames to come.
    pub fn set_layers(&mut self, layers: LayerSpec) {
        self.settings.layers = layers;
    }

    /// Forgets the frames before, so that the next is a first one.
    pub fn restart(&mut self) {
        self.history = History::default();
    }

    /// Renders `target` from the photos of one time step, one per camera in their order; `None` where a camera has
    /// delivered nothing. From the nearest V of those that have.
    ///
    /// # Errors
    ///
    /// [`LiveError::Photos`] and [`LiveError::Size`] for photos that are not the cameras'; [`LiveError::Views`] where too
    /// few look the target's way: what to show instead is the caller's choice.
    pub fn render(&mut self, photos: &[Option<&ImageRgb>], target: &Camera) -> Result<LiveFrame, LiveError> {
        self.check(photos)?;
        let (network, views) = self.choose(photos, target)?;
        let started = Instant::now();
        let chosen: Vec<&ImageRgb> = views.iter().filter_map(|&view| photos[view]).collect();
        let textures: Vec<Texture> = chosen.into_par_iter().map(Texture::new).collect();
        let ready = Instant::now();
        let cameras: Vec<&Camera> = views.iter().map(|&view| &self.cameras[view]).collect();
        let sources: Vec<SourceView<'_>> =
            cameras.iter().zip(&textures).map(|(&camera, texture)| SourceView { camera, texture }).collect();
        let seen = TargetViews { levels: Levels::new(textures.iter().collect()), cameras, target };
        let (layers, layer_source) = self.history.layers(&self.settings, &seen)?;
        let found = Instant::now();
        let frame = self.renderers[network].render(&sources, target, &layers)?;
        if let (LayerSpec::Select { keep, from }, LayerSource::Dense) = (&self.settings.layers, layer_source) {
            let best = frame.best_layer.iter().map(|best| best.map(|plane| plane as usize));
            let kept = select_planes(&plane_histogram(best, *from), *keep);
            let disparities = uniform_disparities(self.settings.near, self.settings.far, *from)?;
            let kept: Vec<f64> = kept.into_iter().map(|plane| disparities[plane]).collect();
            self.history.planes = Some(Layers::planes(&kept)?);
        }
        let times = LiveTimes { photos: ready - started, layers: found - ready, stages: frame.times };
        Ok(LiveFrame { frame, layer_source, views, times })
    }

    fn check(&self, photos: &[Option<&ImageRgb>]) -> Result<(), LiveError> {
        if photos.len() != self.cameras.len() {
            return Err(LiveError::Photos { expected: self.cameras.len(), found: photos.len() });
        }
        for (index, (photo, camera)) in photos.iter().zip(&self.cameras).enumerate() {
            let expected = camera.size();
            let found = photo.map_or(expected, ImageRgb::size);
            if found != expected {
                return Err(LiveError::Size { camera: index, found, expected });
            }
        }
        Ok(())
    }

    /// The network, and the cameras it renders from.
    fn choose(&self, photos: &[Option<&ImageRgb>], target: &Camera) -> Result<(usize, Vec<usize>), LiveError> {
        let usable: Vec<usize> = (0..photos.len()).filter(|&view| photos[view].is_some()).collect();
        let cameras: Vec<&Camera> = usable.iter().map(|&view| &self.cameras[view]).collect();
        let mut refused = None;
        for (index, renderer) in self.renderers.iter().enumerate() {
            match choose_views(&cameras, target, renderer.network().views()) {
                Ok(chosen) => return Ok((index, chosen.into_iter().map(|i| usable[i]).collect())),
                Err(error) => refused = Some(error),
            }
        }
        Err(refused.map_or(LiveError::NoNetwork, LiveError::Views))
    }
}

impl History {
    /// The layers of a frame, and where they came from.
    fn layers(&mut self, settings: &LiveSettings, seen: &TargetViews<'_>) -> Result<(Layers, LayerSource), LiveError> {
        let (near, far) = (settings.near, settings.far);
        let search = |coarse_planes| GuidedSearch { near, far, planes: coarse_planes };
        let due = match settings.policy {
            Policy::Every(frames) => self.age + 1 >= frames,
            Policy::Once | Policy::Propagate => false,
        };
        let (layers, source) = match settings.layers {
            LayerSpec::Planes(count) => (Layers::uniform(near, far, count)?, LayerSource::Fixed),
            LayerSpec::List(ref disparities) => (Layers::planes(disparities)?, LayerSource::Fixed),
            LayerSpec::Select { from, .. } => match self.planes.take().filter(|_| !due) {
                Some(planes) => {
                    self.planes = Some(planes.clone());
                    (planes, LayerSource::Selected)
                }
                None => (Layers::uniform(near, far, from)?, LayerSource::Dense),
            },
            LayerSpec::KMeans { planes: count, coarse_planes } => match self.planes.take().filter(|_| !due) {
                Some(planes) => {
                    self.planes = Some(planes.clone());
                    (planes, LayerSource::Propagated { refreshed: 0.0 })
                }
                None => {
                    let surface = Surface::search(&search(coarse_planes), seen)?;
                    let planes = Layers::planes(&kmeans_planes(surface.disparities(), count))?;
                    self.planes = Some(planes.clone());
                    (planes, LayerSource::Searched)
                }
            },
            LayerSpec::Guided { layers, coarse_planes } => {
                let pass = search(coarse_planes);
                let (surface, source) = self.surface(&pass, settings.policy, due, seen)?;
                let layers = surface.range().layers(layers)?;
                self.surface = Some(surface);
                (layers, source)
            }
        };
        self.age = if matches!(source, LayerSource::Searched | LayerSource::Dense) { 0 } else { self.age + 1 };
        Ok((layers, source))
    }

    /// The surface of a frame.
    fn surface(
        &mut self,
        pass: &GuidedSearch,
        policy: Policy,
        due: bool,
        seen: &TargetViews<'_>,
    ) -> Result<(Surface, LayerSource), LiveError> {
        let before = self.surface.take().filter(|surface| !due && surface.suits(seen.target));
        let Some(before) = before else { return Ok((Surface::search(pass, seen)?, LayerSource::Searched)) };
        let mut moved = before.moved(seen.target);
        let refreshed = if policy == Policy::Propagate { moved.refresh(pass, seen)? } else { 0.0 };
        let source = if refreshed < 1.0 { LayerSource::Propagated { refreshed } } else { LayerSource::Searched };
        Ok((moved, source))
    }
}
