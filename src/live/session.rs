//! A session: the photos of a time step and a target camera in, a frame out.

use std::fmt;
use std::time::Instant;

use rayon::prelude::*;

use super::error::LiveError;
use super::frame::{LiveFrame, LiveTimes};
use super::history::{Found, History};
use super::policy::LayerSource;
use super::settings::LiveSettings;
use super::step::Step;
use crate::geometry::{Camera, TooFewViews};
use crate::image::ImageRgb;
use crate::layers::{LayerSpec, Layers, uniform_disparities};
use crate::render::{RenderRequest, Renderer};
use crate::warp::SourceView;

/// Renders the time steps of a rig, one after the other.
pub struct LiveSession {
    cameras: Vec<Camera>,
    /// Largest V first.
    renderers: Vec<Renderer>,
    settings: LiveSettings,
    history: History,
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
    /// A session for the cameras of a rig. Of several networks the one with the most views renders; the next only a time step for
    /// which fewer photos were delivered than that takes.
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
        Ok(Self { cameras, renderers, settings, history: History::default() })
    }

    /// The cameras of the rig.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// Sets the layers of the frames to come.
    pub fn set_layers(&mut self, layers: LayerSpec) {
        self.settings.layers = layers;
    }

    /// Forgets the frames before: the next is rendered as the first.
    pub fn restart(&mut self) {
        self.history = History::default();
    }

    /// Renders `target` from the photos of one time step: one per camera, in their order; `None` where a camera has delivered
    /// nothing. The nearest V of the others are used.
    ///
    /// # Errors
    ///
    /// [`LiveError::Photos`] and [`LiveError::Size`] for photos that do not match the cameras; [`LiveError::Views`] where too few
    /// look the target's way (what to show instead is up to the caller); [`LiveError::Layers`] and [`LiveError::Render`].
    pub fn render(&mut self, photos: &[Option<&ImageRgb>], target: &Camera) -> Result<LiveFrame, LiveError> {
        self.check(photos)?;
        let step = Step::new(&self.cameras, photos);
        let (network, views) = self.choose(&step, target)?;
        let started = Instant::now();
        let sources: Vec<SourceView<'_>> = views.par_iter().map(|&view| step.source(view)).collect();
        let ready = Instant::now();
        let Found { layers, source, seen } = self.history.layers(&self.settings, &step, &views, target)?;
        let found = Instant::now();
        let visibility = seen.as_ref().map(|seen| seen.visibility());
        let request =
            RenderRequest { visibility: visibility.as_ref(), ..RenderRequest::new(&sources, target, &layers) };
        let frame = self.renderers[network].render(request)?;
        if let (LayerSpec::Select { keep, from }, LayerSource::Dense) = (&self.settings.layers, source) {
            let disparities = uniform_disparities(self.settings.near, self.settings.far, *from)?;
            let kept = self.renderers[network].alpha().select_planes(&frame.plane_histogram(*from), *keep);
            let kept: Vec<f64> = kept.into_iter().map(|plane| disparities[plane]).collect();
            self.history.keep_planes(Layers::planes(&kept)?);
        }
        let times = LiveTimes { photos: ready - started, layers: found - ready, stages: frame.times };
        Ok(LiveFrame { frame, layer_source: source, views, times })
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

    /// Index of the network, and of the cameras that it renders from.
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
