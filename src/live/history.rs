//! What a session keeps from the frames before, and the layers of the next frame.

use super::camera_depths::CameraDepths;
use super::error::LiveError;
use super::policy::{LayerSource, Policy};
use super::propagate::Surface;
use super::settings::LiveSettings;
use super::step::{Step, TargetViews};
use crate::geometry::Camera;
use crate::layers::guided::GuidedSearch;
use crate::layers::{LayerSpec, Layers, LayersError};
use crate::surface::TargetSurface;

/// The layers of a frame.
pub(super) struct Found {
    pub(super) layers: Layers,
    /// Where they came from.
    pub(super) source: LayerSource,
    /// Who sees them, for surface layers.
    pub(super) seen: Option<TargetSurface>,
}

/// What a session keeps from the frames before.
#[derive(Default)]
pub(super) struct History {
    /// The last frame's surface, for guided layers.
    surface: Option<Surface>,
    /// The depth of the cameras' photos, for surface layers.
    depths: Option<CameraDepths>,
    /// Planes that an earlier frame selected.
    planes: Option<Layers>,
    /// Frames since the last search or selection.
    age: usize,
}

impl History {
    /// Renders the next frames on these planes.
    pub(super) fn keep_planes(&mut self, planes: Layers) {
        self.planes = Some(planes);
    }

    /// The layers of the next frame, rendered from these views.
    pub(super) fn layers(
        &mut self,
        settings: &LiveSettings,
        step: &Step<'_>,
        views: &[usize],
        target: &Camera,
    ) -> Result<Found, LiveError> {
        let (near, far) = (settings.near, settings.far);
        let search = |coarse_planes| GuidedSearch { near, far, planes: coarse_planes };
        let due = match settings.policy {
            Policy::Every(frames) => self.age + 1 >= frames,
            Policy::Once | Policy::Propagate => false,
        };
        let target_views = || TargetViews::new(step, views, target);
        let mut seen = None;
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
            LayerSpec::Surface(count) => {
                let depths = self.depths.get_or_insert_with(|| CameraDepths::new(step.cameras, near, far));
                if due {
                    depths.forget();
                }
                let (found, searched) = depths.surface(step, target, views.len(), settings);
                let layers = found.layers(count)?;
                seen = Some(found);
                (layers, LayerSource::propagated(searched))
            }
            LayerSpec::Guided { layers, coarse_planes } => {
                let search = search(coarse_planes);
                let (surface, source) = self.surface(&search, settings.policy, due, &target_views())?;
                let layers = surface.range().layers(layers)?;
                self.surface = Some(surface);
                (layers, source)
            }
        };
        self.age = if matches!(source, LayerSource::Searched | LayerSource::Dense) { 0 } else { self.age + 1 };
        Ok(Found { layers, source, seen })
    }

    /// The surface of the next frame: searched, or propagated from the last one's.
    fn surface(
        &mut self,
        search: &GuidedSearch,
        policy: Policy,
        due: bool,
        views: &TargetViews<'_>,
    ) -> Result<(Surface, LayerSource), LayersError> {
        let before = self.surface.take().filter(|surface| !due && surface.has_size_of(views.target));
        let Some(before) = before else { return Ok((Surface::search(search, views)?, LayerSource::Searched)) };
        let mut moved = before.moved(views.target);
        let refreshed = if policy == Policy::Propagate { moved.refresh(search, views)? } else { 0.0 };
        Ok((moved, LayerSource::propagated(refreshed)))
    }
}
