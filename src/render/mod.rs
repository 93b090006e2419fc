//! The whole pipeline: views, target and layers → target image, a batch of layers at a time.

mod blend;
mod buffers;
mod composite;
mod culling;
mod exp;

use std::fmt;
use std::time::{Duration, Instant};

use ndarray::Array2;
use rayon::prelude::*;

pub use blend::{Blended, DistanceWeights, LayerSamples};
pub use buffers::Batch;
use buffers::Buffers;
pub use composite::Accumulated;
pub use culling::{Culled, Culling};

use crate::geometry::{Camera, distance};
use crate::image::ImageRgb;
use crate::layers::{Layers, padded};
use crate::network::{NetworkError, PlaneNetwork};
use crate::warp::{RunCoverage, SourceView, warp_sources};

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// Not as many views as the network takes.
    #[error("the network takes {expected} views, but {found} were given")]
    Views {
        /// V of the network.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// The network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
}

/// A rendered target.
#[derive(Debug, Clone)]
pub struct Frame {
    /// RGB in [0, 1], sRGB.
    pub picture: ImageRgb,
    /// Σ T α δ per pixel, 1/scene unit, `[height, width]`.
    pub disparity: Array2<f32>,
    /// What no layer covered, `[height, width]`: 0 where any view sees the background.
    pub transmittance: Array2<f32>,
    /// Index of the layer of largest α as the network gave it, `None` where no layer is covered, `[height, width]`.
    pub best_layer: Array2<Option<u32>>,
    /// Which layers were not rendered.
    pub culled: Culled,
    /// Where the time went.
    pub times: StageTimes,
}

/// Wall time per stage of one render.
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTimes {
    /// Sampling the views.
    pub warp: Duration,
    /// Running the network.
    pub network: Duration,
    /// Blending and compositing.
    pub composite: Duration,
}

/// Layers that are warped, and then composited, together, however few the network takes at once: photos and sums go through
/// memory once for all of them, and memory makes these stages 1.5 times as slow as the cache. At 504×352 each layer takes 18 MB
/// (V = 5). One, three and four at a time, they take 9.9, 7.5 and 7.0 % of the network's time at V = 4 on 24 planes; 10.1, 8.3
/// and 7.4 % at V = 5.
const TOGETHER: usize = 4;

/// Runs a network over layers. Keeps its buffers from frame to frame; their size is set by `batch` (four layers at least) and the
/// target, never by the number of layers.
pub struct Renderer<N> {
    network: N,
    batch: usize,
    culling: Culling,
    buffers: Buffers,
}

impl<N> fmt::Debug for Renderer<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("batch", &self.batch).field("culling", &self.culling).finish_non_exhaustive()
    }
}

impl<N: PlaneNetwork> Renderer<N> {
    /// `batch` layers go through the network at once (at least one).
    pub fn new(network: N, batch: usize) -> Self {
        Self { network, batch: batch.max(1), culling: Culling::default(), buffers: Buffers::default() }
    }

    /// The network it runs.
    pub fn network(&self) -> &N {
        &self.network
    }

    /// The network alone.
    pub fn into_network(self) -> N {
        self.network
    }

    /// Which layers the next renders may leave out: by default those that no view covers.
    pub fn set_culling(&mut self, culling: Culling) {
        self.culling = culling;
    }

    /// Render `target` from `views` (V of them, nearest first: see [`crate::geometry::choose_views`]) on `layers`.
    pub fn render(&mut self, views: &[SourceView<'_>], target: &Camera, layers: &Layers) -> Result<Frame, RenderError> {
        self.render_observed(views, target, layers, |_| ())
    }

    /// As [`Self::render`], and show the layers, without those left out, some at a time, to `observe` once the network has run.
    pub fn render_observed(
        &mut self,
        views: &[SourceView<'_>],
        target: &Camera,
        layers: &Layers,
        mut observe: impl FnMut(&Batch<'_>),
    ) -> Result<Frame, RenderError> {
        let count = self.network.views();
        if views.len() != count {
            return Err(RenderError::Views { expected: count, found: views.len() });
        }
        let sources = warp_sources(views, target);
        let distances: Vec<f64> = views.iter().map(|v| distance(v.camera, target)).collect();
        let weights = DistanceWeights::new(&distances);
        // Layers can be hidden only behind those that are composited.
        let together =
            if self.culling.transmittance > 0.0 { self.batch } else { TOGETHER.next_multiple_of(self.batch) };
        let size = padded(target.size());
        self.buffers.make_room(together.min(layers.len()), count, size);

        let mut gathered = vec![Accumulated::new(target.width()); target.height()];
        let (mut times, mut culled) = (StageTimes::default(), Culled::default());
        let mut waiting = layers.as_slice().iter().enumerate();
        let mut indices = Vec::new();
        while waiting.len() > 0 {
            if let Some(transmittance) = self.culling.hide_rest(&gathered) {
                culled.add_hidden(waiting.len(), transmittance);
                break;
            }
            let started = Instant::now();
            self.buffers.warp(&mut waiting, &sources, &mut indices);
            let mut n = 0;
            for slot in 0..indices.len() {
                match self.culling.hide(self.buffers.coverage(slot), size, &gathered) {
                    Some(0.0) => culled.uncovered += 1,
                    Some(transmittance) => culled.add_hidden(1, transmittance),
                    None => {
                        self.buffers.move_layer(slot, n);
                        indices[n] = indices[slot];
                        n += 1;
                    }
                }
            }
            indices.truncate(n);
            let warped = Instant::now();
            times.warp += warped - started;
            if n == 0 {
                continue;
            }
            self.buffers.infer(&mut self.network, n, self.batch)?;
            let inferred = Instant::now();
            let (shown, seen) = self.buffers.batch(n, &weights);
            composite_batch(&shown, seen, &indices, layers.len(), &mut gathered);
            times.composite += inferred.elapsed();
            times.network += inferred - warped;
            observe(&shown);
        }
        Ok(Frame { culled, times, ..frame(&gathered, target) })
    }
}

/// Blend each layer of the batch, of the given indices among `total`, and add it behind what was gathered.
fn composite_batch(
    batch: &Batch<'_>,
    seen: &[RunCoverage],
    indices: &[usize],
    total: usize,
    gathered: &mut [Accumulated],
) {
    let (n, views, height, width) = batch.logits.dim();
    let (hwv, coverage, logits) = match (batch.hwv.to_slice(), batch.coverage.to_slice(), batch.logits.to_slice()) {
        (Some(hwv), Some(coverage), Some(logits)) => (hwv, coverage, logits),
        _ => unreachable!("views of the renderer's own buffers"),
    };
    let (size, runs) = (logits.len() / n, seen.len() / n);
    let per_row = runs / views / height;
    let target_width = gathered.first().map_or(0, |row| row.transmittance.len());
    gathered.par_iter_mut().enumerate().for_each_init(
        || Blended::new(target_width),
        |blended, (row, gathered)| {
            for ((k, disparity), &index) in batch.disparity.outer_iter().enumerate().zip(indices) {
                let samples = LayerSamples {
                    logits: &logits[k * size..(k + 1) * size],
                    colour: &hwv[3 * k * size..3 * (k + 1) * size],
                    coverage: &coverage[k * size..(k + 1) * size],
                };
                let seen = seen[k * runs..(k + 1) * runs].chunks_exact(runs / views);
                let seen: Vec<_> = seen.map(|view| &view[row * per_row..(row + 1) * per_row]).collect();
                batch.weights.blend_row(&samples, row * width, &seen, blended);
                let disparity = disparity.row(row).to_slice().expect("rows of the renderer's own buffer");
                gathered.add(index as u32, blended, disparity, index + 1 == total);
            }
        },
    );
}

fn frame(gathered: &[Accumulated], target: &Camera) -> Frame {
    let shape = (target.height(), target.width());
    let map = |f: fn(&Accumulated) -> &Vec<f64>| {
        let values = gathered.iter().flat_map(|row| f(row).iter().map(|&value| value as f32)).collect();
        Array2::from_shape_vec(shape, values).expect("one value per pixel")
    };
    let pixel = |row: &Accumulated, x: usize| std::array::from_fn::<_, 3, _>(|c| row.rgb[c][x] as f32);
    let rgb = gathered.iter().flat_map(|row| (0..shape.1).flat_map(move |x| pixel(row, x))).collect();
    let best = gathered.iter().flat_map(|row| row.best_layer.iter().map(|&best| (best != u32::MAX).then_some(best)));
    Frame {
        picture: ImageRgb::new(target.width(), target.height(), rgb).expect("three values per pixel"),
        disparity: map(|row| &row.disparity),
        transmittance: map(|row| &row.transmittance),
        best_layer: Array2::from_shape_vec(shape, best.collect()).expect("one value per pixel"),
        culled: Culled::default(),
        times: StageTimes::default(),
    }
}
