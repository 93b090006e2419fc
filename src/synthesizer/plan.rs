//! The layers of a shot, found as its [`LayerSpec`] says.

use std::time::{Duration, Instant};

use super::error::SynthesisError;
use super::loaded_shot::LoadedShot;
#[cfg(feature = "surface")]
use super::scene_photos::ScenePhotos;
use crate::layers::guided::RangeMap;
use crate::layers::{LayerSpec, Layers, uniform_disparities};
use crate::render::{RenderRequest, Renderer};
#[cfg(feature = "surface")]
use crate::surface::{PhotoCorrection, TargetSurface};

/// The layers of a shot, and the time that finding them took.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Plan {
    /// The layers, near → far.
    pub layers: Layers,
    /// Wall time of the guided search, for guided layers; of the surface, with the depth of photos that was not known
    /// yet, for surface layers.
    pub search: Duration,
    /// Wall time of the render that planes were selected from, for selected planes.
    pub selection: Duration,
    /// The range of disparities of each cell, for guided layers.
    pub range: Option<RangeMap>,
    /// The surface and who sees it, for surface layers.
    #[cfg(feature = "surface")]
    pub surface: Option<TargetSurface>,
}

impl Plan {
    /// A plan of layers that are known already.
    pub fn known(layers: Layers) -> Self {
        Self {
            layers,
            search: Duration::ZERO,
            selection: Duration::ZERO,
            range: None,
            #[cfg(feature = "surface")]
            surface: None,
        }
    }
}

/// Finds the layers of a shot whose photos are loaded. A new kind of layers has its arm here.
pub(super) fn plan(spec: &LayerSpec, renderer: &mut Renderer, loaded: &LoadedShot) -> Result<Plan, SynthesisError> {
    let started = Instant::now();
    let shot = loaded.shot();
    let known = Plan::known;
    Ok(match *spec {
        LayerSpec::Planes(count) => known(Layers::uniform(shot.near, shot.far, count)?),
        LayerSpec::List(ref disparities) => known(Layers::planes(disparities)?),
        LayerSpec::Guided { layers, coarse_planes } => {
            let range = loaded.search(coarse_planes)?.range;
            let layers = range.layers(layers)?;
            Plan { search: started.elapsed(), range: Some(range), ..known(layers) }
        }
        #[cfg(feature = "surface")]
        LayerSpec::Surface(_) => unreachable!("see plan_surface"),
        LayerSpec::Select { keep, from } => {
            let disparities = uniform_disparities(shot.near, shot.far, from)?;
            let histogram = histogram(renderer, loaded, &disparities)?;
            let kept = renderer.alpha().select_planes(&histogram, keep);
            let kept: Vec<f64> = kept.into_iter().map(|plane| disparities[plane]).collect();
            Plan { selection: started.elapsed(), ..known(Layers::planes(&kept)?) }
        }
    })
}

/// Finds `count` layers along the surface of a shot whose photos are loaded.
#[cfg(feature = "surface")]
pub(super) fn plan_surface(
    count: usize,
    photos: &mut ScenePhotos,
    shot: &LoadedShot,
    photo_correction: PhotoCorrection,
) -> Result<Plan, SynthesisError> {
    let started = Instant::now();
    let surface = photos.surface(shot, photo_correction)?;
    let layers = surface.layers(count)?;
    Ok(Plan { search: started.elapsed(), surface: Some(surface), ..Plan::known(layers) })
}

/// How many pixels of a shot have each of these planes (1/scene unit, near → far) as their best one.
pub(super) fn histogram(
    renderer: &mut Renderer,
    loaded: &LoadedShot,
    disparities: &[f64],
) -> Result<Vec<u64>, SynthesisError> {
    let (sources, layers) = (loaded.sources(), Layers::planes(disparities)?);
    let frame = renderer.render(RenderRequest::new(&sources, &loaded.shot().target, &layers))?;
    Ok(frame.plane_histogram(disparities.len()))
}
