//! A session: the photos of a time step and a target camera in, a frame out.

use std::fmt;
use std::time::Instant;

use rayon::prelude::*;

use super::camera_depths::CameraDepths;
use super::error::LiveError;
use super::frame::{LiveFrame, LiveTimes};
use super::policy::Policy;
use super::settings::LiveSettings;
use super::step::Step;
use liveview::geometry::{Camera, TooFewViews};
use liveview::image::ImageRgb;
use liveview::layers::uniform_disparities;
use liveview::render::{RenderRequest, Renderer};
use liveview_surface::{PhotoCorrection, Reuse, TargetSurface};
use liveview_synthesizer::{Carried, FrameInput, LayerSource, LayerSpec, find_layers};

/// Renders the time steps of a rig, one after the other.
pub struct LiveSession {
    cameras: Vec<Camera>,
    /// Largest V first.
    renderers: Vec<Renderer>,
    settings: LiveSettings,
    /// The depth of the cameras' photos, for surface layers.
    depths: CameraDepths,
    /// What the layers of the next frame reuse.
    carried: Carried,
    /// Frames since the last search or selection.
    age: usize,
}

impl fmt::Debug for LiveSession {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LiveSession")
            .field("cameras", &self.cameras.len())
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}

impl LiveSession {
    /// A session for the cameras of a rig. Of several networks the one with the most views renders;
    /// one with fewer only a time step for which too few photos were delivered.
    ///
    /// # Errors
    ///
    /// [`LiveError::NoNetwork`], or [`LiveError::Layers`] unless 0 < near < far.
    pub fn new(cameras: Vec<Camera>, mut renderers: Vec<Renderer>, settings: LiveSettings) -> Result<Self, LiveError> {
        uniform_disparities(settings.near, settings.far, 2)?;
        renderers.sort_by_key(|renderer| std::cmp::Reverse(renderer.network().views()));
        if renderers.is_empty() {
            return Err(LiveError::NoNetwork);
        }
        let depths = CameraDepths::new(&cameras, settings.near, settings.far);
        Ok(Self { cameras, renderers, settings, depths, carried: Carried::default(), age: 0 })
    }

    /// The cameras of the rig.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// Sets the layers of the next frames.
    pub fn set_layers(&mut self, layers: LayerSpec) {
        self.settings.layers = layers;
    }

    /// Drops what is reused of earlier frames: the next is rendered like the first.
    pub fn restart(&mut self) {
        (self.carried, self.age) = (Carried::default(), 0);
    }

    /// Renders `target` from the photos of one time step: one per camera, in the cameras' order;
    /// `None` where a camera has delivered nothing. The nearest V of the others are used.
    ///
    /// # Errors
    ///
    /// [`LiveError::Photos`] and [`LiveError::Size`] for photos that do not match the cameras;
    /// [`LiveError::Views`] where too few face the target's direction (what to show instead is up
    /// to the caller); [`LiveError::Layers`] and [`LiveError::Render`].
    pub fn render(&mut self, photos: &[Option<&ImageRgb>], target: &Camera) -> Result<LiveFrame, LiveError> {
        self.check(photos)?;
        let step = Step::new(&self.cameras, photos);
        let (network, views) = self.choose(&step, target)?;
        let started = Instant::now();
        let sources: Vec<_> = views.par_iter().map(|&view| step.source(view)).collect();
        let ready = Instant::now();
        let reuse = match self.settings.policy {
            Policy::Every(frames) if self.age + 1 >= frames => Reuse::Nothing,
            Policy::Every(_) | Policy::Once => Reuse::All,
            Policy::Propagate => Reuse::Refreshed,
        };
        let input = FrameInput {
            target,
            near: self.settings.near,
            far: self.settings.far,
            sources: &sources,
            is_followed: true,
            photo_correction: PhotoCorrection { exposure: !self.settings.keep_exposure, ..PhotoCorrection::default() },
            searches_holes: true,
        };
        let plan = find_layers::<LiveError>(&self.settings.layers, &mut self.carried, &input, reuse, |reuse| {
            Ok(self.depths.photos(&step, target, views.len(), reuse))
        })?;
        self.age = if matches!(plan.source, LayerSource::Searched | LayerSource::Dense) { 0 } else { self.age + 1 };
        let found = Instant::now();
        let renderer = &mut self.renderers[network];
        let visibility = plan.surface.as_ref().map(TargetSurface::visibility);
        let request = RenderRequest {
            corrections: &plan.corrections,
            visibility: visibility.as_ref(),
            ..RenderRequest::new(&sources, target, &plan.layers)
        };
        let frame = renderer.render(request)?;
        if let Some(selection) = plan.selects {
            self.carried.selected = Some(selection.planes(&frame, renderer.alpha())?);
        }
        let times = LiveTimes { photos: ready - started, layers: found - ready, stages: frame.times };
        Ok(LiveFrame { frame, layer_source: plan.source, views, times })
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

    /// Index of the network, and indices of the cameras that it renders from.
    fn choose(&self, step: &Step<'_>, target: &Camera) -> Result<(usize, Vec<usize>), LiveError> {
        let mut nearest = step.nearest(target);
        let views = |renderer: &Renderer| renderer.network().views();
        let fits = self.renderers.iter().position(|renderer| views(renderer) <= nearest.len());
        let Some(network) = fits else {
            let wanted = self.renderers.iter().map(views).min().unwrap_or(0);
            return Err(TooFewViews { wanted, found: nearest.len(), of: step.delivered() }.into());
        };
        nearest.truncate(views(&self.renderers[network]));
        Ok((network, nearest))
    }
}
