//! The layers of a shot, found as its [`LayerSpec`] says.

use std::time::{Duration, Instant};

use super::{Shot, SynthesisError, Synthesizer};
use crate::layers::guided::RangeMap;
use crate::layers::{LayerSpec, Layers, kmeans_planes, plane_histogram, select_planes, uniform_disparities};
use crate::network::PlaneNetwork;

/// The layers of a shot, and what finding them took.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Plan {
    /// The layers, near → far.
    pub layers: Layers,
    /// Wall time of the guided search, for guided layers and k-means planes.
    pub search: Duration,
    /// Wall time of the render that planes were selected from.
    pub selection: Duration,
    /// What guided layers divide.
    pub range: Option<RangeMap>,
}

impl Plan {
    /// Layers that are known already.
    pub fn known(layers: Layers) -> Self {
        Self { layers, search: Duration::ZERO, selection: Duration::ZERO, range: None }
    }
}

impl<N: PlaneNetwork> Synthesizer<N> {
    /// The layers of a shot whose photos are loaded. A new kind of layers has its arm here.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Layers`], and [`SynthesisError::Render`] where planes are selected from a render.
    pub fn plan(&mut self, shot: &Shot) -> Result<Plan, SynthesisError> {
        let started = Instant::now();
        let known = Plan::known;
        Ok(match self.layers {
            LayerSpec::Planes(count) => known(Layers::uniform(shot.near, shot.far, count)?),
            LayerSpec::List(ref disparities) => known(Layers::planes(disparities)?),
            LayerSpec::Guided { layers, coarse_planes } => {
                let range = self.photos.search(shot, coarse_planes)?.range;
                let layers = range.layers(layers)?;
                Plan { search: started.elapsed(), range: Some(range), ..known(layers) }
            }
            LayerSpec::KMeans { planes, coarse_planes } => {
                let found = self.photos.search(shot, coarse_planes)?.fine_disparity;
                let planes = kmeans_planes(found.as_slice().expect("standard order"), planes);
                Plan { search: started.elapsed(), ..known(Layers::planes(&planes)?) }
            }
            LayerSpec::Select { keep, from } => {
                let disparities = uniform_disparities(shot.near, shot.far, from)?;
                let histogram = self.histogram(shot, &disparities)?;
                let kept: Vec<f64> = select_planes(&histogram, keep).into_iter().map(|k| disparities[k]).collect();
                Plan { selection: started.elapsed(), ..known(Layers::planes(&kept)?) }
            }
        })
    }

    /// How many pixels of a shot whose photos are loaded choose each of these planes (1/scene unit, near → far): the paper's
    /// histogram.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Layers`] and [`SynthesisError::Render`].
    pub fn histogram(&mut self, shot: &Shot, disparities: &[f64]) -> Result<Vec<u64>, SynthesisError> {
        let frame = self.render_layers(shot, &Layers::planes(disparities)?, |_| ())?;
        let best = frame.best_layer.iter().map(|best| best.map(|plane| plane as usize));
        Ok(plane_histogram(best, disparities.len()))
    }
}
