//! Some rows of a layer, and what becomes of their runs as one view is warped by it.

use std::ops::Range;

use super::bilinear::sample;
use super::own_depth::ALL_SEEN;
use super::sample_positions::{RUN, RunCoverage, SamplePositions};
use super::source::WarpSource;

/// Some rows of a layer, as one view is warped by it.
pub(super) struct LayerBand<'a> {
    pub(super) disparity: &'a [f32],
    /// Red, green, blue and coverage.
    pub(super) planes: [&'a mut [f32]; 4],
    pub(super) run_coverage: &'a mut [RunCoverage],
    pub(super) seen: &'a mut [u64],
}

/// A run of pixels of a [`LayerBand`].
pub(super) struct Run {
    pub(super) index: usize,
    pub(super) first: usize,
    pub(super) len: usize,
}

impl Run {
    pub(super) fn span(&self) -> Range<usize> {
        self.first..self.first + self.len
    }

    /// A bit for each of its pixels.
    pub(super) fn bits(&self) -> u64 {
        ALL_SEEN >> (RUN - self.len)
    }
}

impl LayerBand<'_> {
    /// Whether a run lies where it does on the layer before; then it becomes that layer's.
    #[inline(always)]
    pub(super) fn repeats(&mut self, before: &LayerBand<'_>, at: &Run) -> bool {
        let span = at.span();
        let same = self.disparity[span.clone()].iter().zip(&before.disparity[span.clone()]);
        if !same.fold(true, |same, (a, b)| same & (a.to_bits() == b.to_bits())) {
            return false;
        }
        self.seen[at.index] = before.seen[at.index];
        if self.wants(at, before.run_coverage[at.index]) {
            let written = if self.run_coverage[at.index] == RunCoverage::Partly { 4 } else { 3 };
            for (plane, before) in self.planes.iter_mut().zip(&before.planes).take(written) {
                plane[span.clone()].copy_from_slice(&before[span.clone()]);
            }
        }
        true
    }

    /// Whether a run of such a coverage has colours to be written. Where its coverage is known, that is written.
    #[inline(always)]
    pub(super) fn wants(&mut self, at: &Run, coverage: RunCoverage) -> bool {
        let before = std::mem::replace(&mut self.run_coverage[at.index], coverage);
        match coverage {
            RunCoverage::None if before != RunCoverage::None => {
                self.planes.iter_mut().for_each(|plane| plane[at.span()].fill(0.0));
            }
            RunCoverage::All if before != RunCoverage::All => self.planes[3][at.span()].fill(1.0),
            _ => {}
        }
        coverage != RunCoverage::None
    }

    /// Whole runs are written to their planes; a row's end, and coverage that is known, by way of `spare`.
    #[inline(always)]
    pub(super) fn sample<S: pulp::Simd>(
        &mut self,
        simd: S,
        source: &WarpSource<'_>,
        positions: &SamplePositions,
        at: &Run,
        spare: &mut [[f32; RUN]; 4],
    ) {
        let planes = self.planes.each_mut().map(|plane| &mut plane[at.span()]);
        let planes = planes.into_iter().take(if self.run_coverage[at.index] == RunCoverage::Partly { 4 } else { 3 });
        if at.len == RUN {
            let mut channels = spare.each_mut();
            let whole = planes.map(|plane| plane.try_into().expect("a whole run"));
            channels.iter_mut().zip(whole).for_each(|(channel, plane)| *channel = plane);
            sample(simd, source.texture, positions, source.gains, channels);
        } else {
            sample(simd, source.texture, positions, source.gains, spare.each_mut());
            planes.zip(spare).for_each(|(plane, spare)| plane.copy_from_slice(&spare[..at.len]));
        }
    }
}
