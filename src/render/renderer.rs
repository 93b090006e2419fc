//! Views, target and layers → frame, a batch of layers at a time: warp, network, blend, composite.

use std::fmt;
use std::time::Instant;

use rayon::prelude::*;

use super::blend::{Blended, DistanceWeights, LayerSamples, VISIBLE_POWER};
use super::buffers::{Batch, Buffers};
use super::composite::Accumulated;
use super::composite_competing::Competing;
use super::composite_row::{CompositeRow, LayerRow};
use super::culling::{Culled, Culling};
use super::error::RenderError;
use super::frame::{Frame, StageTimes};
use super::sharpened::SharpenedPhotos;
use super::spacing::spacing;
use super::visibility::Visibility;
use crate::geometry::{Camera, Size, distance};
use crate::layers::{Layers, padded};
use crate::network::{Alpha, NetworkError, PlaneNetwork};
use crate::warp::{RunCoverage, SourceView, WarpSource, warp_sources};

/// Layers that are warped, and then composited, together, however few the network takes at once: photos and sums then go through
/// memory once for all of them. Measured alternatives: docs/experiments.md.
const LAYERS_TOGETHER: usize = 4;

/// Rows of a layer that are blended before the same rows of the next: colours and logits of four views are read ahead from memory as
/// long as they are no more than that. 1 takes a seventh longer (5.8 against 5.0 ms for two layers); 16 as long.
const ROWS_TOGETHER: usize = 8;

/// A frame stands if for each logit that is NaN or infinite there are this many in all.
const FINITE_PER_STRAY: usize = 10_000;

/// Runs a network over layers. Keeps its buffers from frame to frame; their size depends on `batch` (four layers at least) and the
/// target, not on the number of layers.
pub struct Renderer {
    network: Box<dyn PlaneNetwork>,
    batch: usize,
    alpha: Alpha,
    culling: Culling,
    buffers: Buffers,
    /// Photos of the views that are sharpened.
    sharpened: SharpenedPhotos,
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("batch", &self.batch).field("culling", &self.culling).finish_non_exhaustive()
    }
}

impl Renderer {
    /// A renderer that runs the network on `batch` layers at once (at least one).
    pub fn new(network: Box<dyn PlaneNetwork>, batch: usize) -> Self {
        let (alpha, culling) = (Alpha::default(), Culling::default());
        Self {
            network,
            batch: batch.max(1),
            alpha,
            culling,
            buffers: Buffers::default(),
            sharpened: SharpenedPhotos::default(),
        }
    }

    /// The network it runs.
    pub fn network(&self) -> &dyn PlaneNetwork {
        self.network.as_ref()
    }

    /// The network, without the buffers.
    pub fn into_network(self) -> Box<dyn PlaneNetwork> {
        self.network
    }

    /// How the layers of a pixel share it.
    pub fn alpha(&self) -> Alpha {
        self.alpha
    }

    /// Sets how the layers of a pixel share it in the next renders: by default independently, as in the paper. A model's card says
    /// what it was trained for ([`crate::network::ModelCard::alpha`]).
    pub fn set_alpha(&mut self, alpha: Alpha) {
        self.alpha = alpha;
    }

    /// Sets which layers the next renders may leave out: by default those that no view covers.
    pub fn set_culling(&mut self, culling: Culling) {
        self.culling = culling;
    }

    /// Bytes of the buffers for a target of that size on so many layers.
    pub(crate) fn buffer_bytes(&self, target: Size, layers: usize) -> usize {
        Buffers::bytes(self.together().min(layers), self.network.views(), padded(target))
    }

    /// Layers that are warped and composited together. They can be hidden only behind layers that are composited already.
    fn together(&self) -> usize {
        if self.culling.transmittance > 0.0 { self.batch } else { LAYERS_TOGETHER.next_multiple_of(self.batch) }
    }

    /// Renders `target` from `views` (V of them, nearest first: see [`crate::geometry::choose_views`]) on `layers`; maps among these
    /// are on the cells of the padded target ([`padded`]).
    ///
    /// # Errors
    ///
    /// [`RenderError::Views`] unless there are as many views as the network takes; [`RenderError::NotPlanes`] where
    /// [`Alpha::PerPixel`] needs planes; [`RenderError::Network`] if the network fails.
    pub fn render(&mut self, views: &[SourceView<'_>], target: &Camera, layers: &Layers) -> Result<Frame, RenderError> {
        self.render_observed(views, target, layers, |_| ())
    }

    /// As [`Self::render`]; `observe` is shown the stages of the layers that are not left out, batch by batch, near → far.
    ///
    /// # Errors
    ///
    /// As [`Self::render`].
    pub fn render_observed(
        &mut self,
        views: &[SourceView<'_>],
        target: &Camera,
        layers: &Layers,
        observe: impl FnMut(&Batch<'_>),
    ) -> Result<Frame, RenderError> {
        self.render_visible(views, None, target, layers, observe)
    }

    /// As [`Self::render_observed`]; with `visibility`, of the same views, each of them counts only where it sees the layer, its
    /// photo balanced.
    ///
    /// # Errors
    ///
    /// As [`Self::render`].
    pub fn render_visible(
        &mut self,
        views: &[SourceView<'_>],
        visibility: Option<&Visibility<'_>>,
        target: &Camera,
        layers: &Layers,
        observe: impl FnMut(&Batch<'_>),
    ) -> Result<Frame, RenderError> {
        match self.alpha {
            Alpha::Independent | Alpha::PerPixel { .. } => {
                self.render_rows(views, visibility, target, layers, observe, Accumulated::new)
            }
            Alpha::Competing { scale } => {
                self.render_rows(views, visibility, target, layers, observe, |pixels| Competing::new(pixels, scale))
            }
        }
    }

    /// What is added to logit 0 of each layer.
    fn logit_shifts(&self, sources: &[WarpSource<'_>], size: Size, layers: &Layers) -> Result<Vec<f64>, RenderError> {
        let Alpha::PerPixel { most } = self.alpha else { return Ok(vec![0.0; layers.len()]) };
        let sweeps: Vec<_> = sources.iter().map(|source| source.sweep).collect();
        let found = spacing(&sweeps, size, layers, most);
        let found = found.ok_or_else(|| RenderError::NotPlanes { network: self.network.name() })?;
        Ok(found.into_iter().map(f64::ln).collect())
    }

    /// Renders with the composite whose rows of so many pixels `new_row` makes.
    fn render_rows<R: CompositeRow>(
        &mut self,
        views: &[SourceView<'_>],
        visibility: Option<&Visibility<'_>>,
        target: &Camera,
        layers: &Layers,
        mut observe: impl FnMut(&Batch<'_>),
        new_row: impl Fn(usize) -> R + Sync,
    ) -> Result<Frame, RenderError> {
        let count = self.network.views();
        if views.len() != count {
            return Err(RenderError::Views { expected: count, found: views.len() });
        }
        let begun = Instant::now();
        let size = padded(target.size());
        self.buffers.make_room(self.together().min(layers.len()), count, size)?;
        let mut sources = warp_sources(views, target);
        let shifts = self.logit_shifts(&sources, size, layers)?;
        if let Some(visibility) = visibility {
            visibility.balance(&mut sources, &mut self.sharpened);
        }
        let own = visibility.map(Visibility::own_depth).unwrap_or_default();
        let distances: Vec<f64> = views.iter().map(|v| distance(v.camera, target)).collect();
        let power = if visibility.is_some() { VISIBLE_POWER } else { 1.0 };
        let weights = DistanceWeights::with_power(&distances, power);

        let mut seen_any = vec![visibility.is_none(); size.pixels()];
        let mut gathered: Vec<R> = (0..target.height()).into_par_iter().map(|_| new_row(target.width())).collect();
        let mut times = StageTimes { warp: begun.elapsed(), ..StageTimes::default() };
        let mut culled = Culled::default();
        let mut waiting = layers.as_slice().iter().enumerate();
        let mut indices = Vec::new();
        let (mut logits, mut strays) = (0, 0);
        while waiting.len() > 0 {
            if let Some(transmittance) = self.culling.hide_rest(&gathered) {
                culled.add_hidden(waiting.len(), transmittance);
                break;
            }
            let started = Instant::now();
            self.buffers.warp(&mut waiting, &sources, &own, &mut indices);
            if visibility.is_some() {
                self.buffers.hide(indices.len(), &mut seen_any);
            }
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
            let counted = self.buffers.infer(self.network.as_mut(), n, self.batch)?;
            (logits, strays) = (logits + counted[0], strays + counted[1]);
            let inferred = Instant::now();
            let shifts: Vec<f64> = indices.iter().map(|&index| shifts[index]).collect();
            let (shown, run_coverage) = self.buffers.batch(&shifts, &weights);
            composite_batch(&shown, run_coverage, &indices, layers.len(), &mut gathered);
            times.composite += inferred.elapsed();
            times.network += inferred - warped;
            observe(&shown);
        }
        if strays.saturating_mul(FINITE_PER_STRAY) > logits {
            let network = self.network.name();
            return Err(NetworkError::NotFinite { network, count: strays, of: logits }.into());
        }
        let started = Instant::now();
        let rows = seen_any.chunks_exact(size.width).take(target.height());
        let unseen = rows.map(|row| row[..target.width()].iter().filter(|seen| !**seen).count()).sum();
        let gathered: Vec<_> = gathered.into_iter().map(R::finish).collect();
        let mut frame = Frame { unseen, logits_not_finite: strays, ..Frame::new(&gathered, target, culled, times) };
        frame.times.composite += started.elapsed();
        Ok(frame)
    }
}

/// Blends each layer of the batch, of the given indices among `total`, and adds it to `gathered`, the rows of the target.
fn composite_batch(
    batch: &Batch<'_>,
    run_coverage: &[RunCoverage],
    indices: &[usize],
    total: usize,
    gathered: &mut [impl CompositeRow],
) {
    let (n, views, height, width) = batch.logits.dim();
    let (hwv, coverage, logits) = match (batch.hwv.to_slice(), batch.coverage.to_slice(), batch.logits.to_slice()) {
        (Some(hwv), Some(coverage), Some(logits)) => (hwv, coverage, logits),
        _ => unreachable!("views of the renderer's own buffers"),
    };
    let (size, runs) = (logits.len() / n, run_coverage.len() / n);
    let per_row = runs / views / height;
    let target_width = gathered.first().map_or(0, |row| row.transmittance().len());
    gathered.par_chunks_mut(ROWS_TOGETHER).enumerate().for_each_init(
        || Blended::new(target_width),
        |blended, (chunk, gathered)| {
            let first = chunk * ROWS_TOGETHER;
            for ((k, disparity), &index) in batch.disparity.outer_iter().enumerate().zip(indices) {
                let samples = LayerSamples {
                    logits: &logits[k * size..(k + 1) * size],
                    colour: &hwv[3 * k * size..3 * (k + 1) * size],
                    coverage: &coverage[k * size..(k + 1) * size],
                    logit_shift: batch.logit_shifts[k],
                };
                for (row, gathered) in (first..).zip(&mut *gathered) {
                    let known = run_coverage[k * runs..(k + 1) * runs].chunks_exact(runs / views);
                    let known: Vec<_> = known.map(|view| &view[row * per_row..(row + 1) * per_row]).collect();
                    batch.weights.blend_row(&samples, row * width, &known, blended);
                    let disparity = disparity.row(row).to_slice().expect("rows of the renderer's own buffer");
                    let logits = &samples.logits[row * width..];
                    gathered.add_layer(&LayerRow { index, last: index + 1 == total, logits, blended, disparity });
                }
            }
        },
    );
}
