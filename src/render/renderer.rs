//! Views, target and layers → frame, a few layers at a time: warp, network, blend, composite.

use std::fmt;
use std::time::Instant;

use ndarray::Array2;
use rayon::prelude::*;

use super::blend::{CORRECTED_DISTANCE_POWER, DistanceWeights};
use super::buffers::Buffers;
use super::composite::{Accumulated, CompositeRow, composite_batch};
use super::composite_competing::Competing;
use super::corrected_photos::{SharpenedPhotos, correct_photos};
use super::frame::{Frame, StageTimes};
use super::visibility::Visibility;
use super::{RenderError, RenderRequest};
use crate::geometry::{Size, distance};
use crate::layers::padded;
use crate::network::{Alpha, NetworkError, PlaneNetwork};
use crate::warp::warp_sources;

/// Layers that are warped together and then composited together, however few the network takes at
/// once: photos and sums are then read from memory once for all of them. Measured alternatives:
/// docs/design-log/speed.md.
const LAYERS_TOGETHER: usize = 4;

/// A frame is refused if more than one logit in this many is NaN or infinite.
const LOGITS_PER_NOT_FINITE: usize = 10_000;

/// Runs a network over layers. Keeps its buffers from frame to frame; their size depends on `batch`
/// (at least four layers are buffered) and the target, not on the number of layers.
pub struct Renderer {
    network: Box<dyn PlaneNetwork>,
    batch: usize,
    alpha: Alpha,
    skip_uncovered: bool,
    buffers: Buffers,
    sharpened: SharpenedPhotos,
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("batch", &self.batch).field("alpha", &self.alpha).finish_non_exhaustive()
    }
}

impl Renderer {
    /// A renderer that runs the network on `batch` layers at once (at least one); `alpha`: how the layers of a
    /// pixel share it, such as [`crate::network::ModelCard::alpha`].
    pub fn new(network: Box<dyn PlaneNetwork>, alpha: Alpha, batch: usize) -> Self {
        Self {
            alpha,
            network,
            batch: batch.max(1),
            skip_uncovered: true,
            buffers: Buffers::default(),
            sharpened: SharpenedPhotos::default(),
        }
    }

    /// The network it runs.
    pub fn network(&self) -> &dyn PlaneNetwork {
        self.network.as_ref()
    }

    /// How the layers of a pixel share it.
    pub fn alpha(&self) -> Alpha {
        self.alpha
    }

    /// Sets whether layers that no view covers at any pixel of the target are skipped (the
    /// default). The frame is the same to the bit, since their α is 0; an observer is not shown the
    /// layers that are skipped.
    pub fn set_skip_uncovered(&mut self, skip_uncovered: bool) {
        self.skip_uncovered = skip_uncovered;
    }

    /// Bytes of the buffers for that many layers on a target of that size.
    pub fn buffer_bytes(&self, target: Size, layers: usize) -> usize {
        Buffers::bytes(self.layers_together().min(layers), self.network.views(), padded(target))
    }

    /// Layers that are warped and composited together.
    fn layers_together(&self) -> usize {
        LAYERS_TOGETHER.next_multiple_of(self.batch)
    }

    /// Renders the target of a request.
    ///
    /// # Errors
    ///
    /// [`RenderError::Views`] unless there are as many views as the network takes;
    /// [`RenderError::Memory`] if the buffers cannot be allocated; [`RenderError::Network`] if the network fails.
    pub fn render(&mut self, request: RenderRequest<'_>) -> Result<Frame, RenderError> {
        match self.alpha {
            Alpha::Independent => self.render_rows(request, Accumulated::new),
            Alpha::Competing { scale } => self.render_rows(request, |pixels| Competing::new(pixels, scale)),
        }
    }

    /// Renders with the composite that `new_row` makes for a number of pixels.
    fn render_rows<R: CompositeRow>(
        &mut self,
        request: RenderRequest<'_>,
        new_row: impl Fn(usize) -> R + Sync,
    ) -> Result<Frame, RenderError> {
        let RenderRequest { views, target, layers, corrections, visibility, mut observer } = request;
        let count = self.network.views();
        if views.len() != count {
            return Err(RenderError::Views { expected: count, found: views.len() });
        }
        let begun = Instant::now();
        let size = padded(target.size());
        self.buffers.make_room(self.layers_together().min(layers.len()), count, size)?;
        let mut sources = warp_sources(views, target);
        correct_photos(corrections, &mut sources, &mut self.sharpened);
        let own_depth = visibility.map(Visibility::own_depth).unwrap_or_default();
        let distances: Vec<f64> = views.iter().map(|v| distance(v.camera, target)).collect();
        let power = if corrections.is_empty() { 1.0 } else { CORRECTED_DISTANCE_POWER };
        let weights = DistanceWeights::with_power(&distances, power);

        let is_seen = visibility.is_none_or(|visibility| visibility.is_seen);
        let mut visible = vec![visibility.is_none() || !is_seen; size.pixels()];
        let mut rows: Vec<R> = (0..target.height()).into_par_iter().map(|_| new_row(target.width())).collect();
        let mut times = StageTimes { warp: begun.elapsed(), ..StageTimes::default() };
        let covered = if is_seen { layers.as_slice() } else { &[] };
        let mut remaining = covered.iter().enumerate();
        let mut indices = Vec::new();
        let (mut logits, mut logits_not_finite, mut uncovered_layers) = (0, 0, layers.len() - covered.len());
        while remaining.len() > 0 {
            let started = Instant::now();
            self.buffers.warp(&mut remaining, &sources, &own_depth, &mut indices);
            if visibility.is_some() {
                self.buffers.hide_occluded(indices.len(), &mut visible);
            }
            if self.skip_uncovered {
                uncovered_layers += self.buffers.drop_uncovered(&mut indices, target.size());
            }
            let warped = Instant::now();
            times.warp += warped - started;
            if indices.is_empty() {
                continue;
            }
            let (count, not_finite) = self.buffers.infer(self.network.as_mut(), indices.len(), self.batch)?;
            (logits, logits_not_finite) = (logits + count, logits_not_finite + not_finite);
            let inferred = Instant::now();
            let (batch, run_coverage) = self.buffers.batch(indices.len(), &weights);
            composite_batch(&batch, run_coverage, &indices, layers.len(), target.width(), &mut rows);
            times.composite += inferred.elapsed();
            times.network += inferred - warped;
            if let Some(observer) = &mut observer {
                observer(&batch);
            }
        }
        // A few are left out; of more there is no picture.
        if logits_not_finite.saturating_mul(LOGITS_PER_NOT_FINITE) > logits {
            let (network, count) = (self.network.name(), logits_not_finite);
            return Err(NetworkError::NotFinite { network, count, of: logits }.into());
        }
        let started = Instant::now();
        let rows: Vec<_> = rows.into_par_iter().map(R::finish).collect();
        let frame = Frame::new(&rows, target);
        let occluded_pixels = count_occluded(&visible, size.width, &frame.transmittance);
        times.composite += started.elapsed();
        Ok(Frame { occluded_pixels, uncovered_layers, logits_not_finite, times, ..frame })
    }
}

/// Pixels of the target, the upper left part of a padded one of this width, that are not visible but
/// covered.
fn count_occluded(visible: &[bool], padded_width: usize, transmittance: &Array2<f32>) -> usize {
    let rows = visible.chunks_exact(padded_width).zip(transmittance.rows());
    rows.map(|(row, behind)| row.iter().zip(behind).filter(|&(&visible, &t)| !visible && t < 1.0).count()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uncovered_pixels_and_the_padding_do_not_count_as_occluded() {
        let visible = [false, true, false, false, false, false];
        assert_eq!(count_occluded(&visible, 3, &ndarray::arr2(&[[0.0, 0.0], [1.0, 0.5]])), 2);
    }
}
