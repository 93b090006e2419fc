//! A session: the photos of a time step and a target camera in, a frame out.

use std::fmt;
use std::time::Instant;

use rayon::prelude::*;

use super::error::LiveError;
use super::frame::{LiveFrame, LiveTimes};
use super::history::History;
use super::policy::LayerSource;
use super::propagate::TargetViews;
use super::settings::LiveSettings;
use crate::geometry::{Camera, choose_views};
use crate::image::ImageRgb;
use crate::layers::guided::Levels;
use crate::layers::{LayerSpec, Layers, select_disparities, uniform_disparities};
use crate::network::PlaneNetwork;
use crate::render::Renderer;
use crate::warp::{NO_GAINS, SourceView, Texture};

/// Renders the time steps of a rig, one after the other.
pub struct LiveSession<N> {
    cameras: Vec<Camera>,
    /// Largest V first.
    renderers: Vec<Renderer<N>>,
    settings: LiveSettings,
    history: History,
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
    /// A session for the cameras of a rig. Of several networks the one with the most views renders; the next only a time step for
    /// which fewer photos were delivered than that takes.
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
        let (network, views) = self.choose(photos, target)?;
        let started = Instant::now();
        let chosen: Vec<&ImageRgb> = views.iter().filter_map(|&view| photos[view]).collect();
        let textures: Vec<Texture> = chosen.into_par_iter().map(Texture::new).collect();
        let ready = Instant::now();
        let cameras: Vec<&Camera> = views.iter().map(|&view| &self.cameras[view]).collect();
        let sources: Vec<SourceView<'_>> =
            cameras.iter().zip(&textures).map(|(&camera, texture)| SourceView { camera, texture }).collect();
        let target_views = TargetViews {
            levels: Levels::new(textures.iter().map(|texture| (texture, NO_GAINS)).collect()),
            cameras,
            target,
        };
        let (layers, layer_source) = self.history.layers(&self.settings, &target_views)?;
        let found = Instant::now();
        let frame = self.renderers[network].render(&sources, target, &layers)?;
        if let (LayerSpec::Select { keep, from }, LayerSource::Dense) = (&self.settings.layers, layer_source) {
            let disparities = uniform_disparities(self.settings.near, self.settings.far, *from)?;
            let kept = select_disparities(&disparities, &frame.plane_histogram(*from), *keep);
            self.history.keep_planes(Layers::planes(&kept)?);
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

    /// Index of the network, and of the cameras that it renders from.
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
