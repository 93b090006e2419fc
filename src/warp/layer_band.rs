//! A band of rows of a layer, and the output of one view warped by it: samples, and which of them the view
//! sees by its own depth, computed from the same positions.

use super::WarpSource;
use super::bilinear::sample;
use super::run::{ALL_SEEN, RUN, Run, RunCoverage};
use super::sample_positions::SamplePositions;

/// A band of rows of a layer, and the output of one view warped by it.
pub(crate) struct LayerBand<'a> {
    pub(super) disparity: &'a [f32],
    /// Red, green, blue and coverage.
    pub(crate) planes: [&'a mut [f32]; 4],
    pub(crate) run_coverage: &'a mut [RunCoverage],
    /// For each run a bit per pixel, set where the view is not occluded.
    pub(crate) seen: &'a mut [u64],
}

impl LayerBand<'_> {
    /// Whether a run has the disparities of the previous layer; then that layer's output is copied.
    #[inline(always)]
    pub(super) fn copy_if_same(&mut self, previous: &LayerBand<'_>, run: &Run) -> bool {
        let span = run.span();
        let same = self.disparity[span.clone()].iter().zip(&previous.disparity[span.clone()]);
        if !same.fold(true, |same, (a, b)| same & (a.to_bits() == b.to_bits())) {
            return false;
        }
        self.seen[run.index] = previous.seen[run.index];
        if self.set_coverage(run, previous.run_coverage[run.index]) {
            let written = if self.run_coverage[run.index] == RunCoverage::Partial { 4 } else { 3 };
            for (plane, previous) in self.planes.iter_mut().zip(&previous.planes).take(written) {
                plane[span.clone()].copy_from_slice(&previous[span.clone()]);
            }
        }
        true
    }

    /// Sets what is known about a run's coverage, and writes the coverage where it is 0 or 1
    /// throughout; returns whether colours remain to be written.
    #[inline(always)]
    pub(super) fn set_coverage(&mut self, run: &Run, coverage: RunCoverage) -> bool {
        let before = std::mem::replace(&mut self.run_coverage[run.index], coverage);
        match coverage {
            RunCoverage::None if before != RunCoverage::None => {
                self.planes.iter_mut().for_each(|plane| plane[run.span()].fill(0.0));
            }
            RunCoverage::All if before != RunCoverage::All => self.planes[3][run.span()].fill(1.0),
            _ => {}
        }
        coverage != RunCoverage::None
    }

    /// Samples a run. Complete runs are written to their planes directly; the end of a row, and
    /// coverage that is written already, go to `scratch`.
    #[inline(always)]
    pub(super) fn sample<S: pulp::Simd>(
        &mut self,
        simd: S,
        source: &WarpSource<'_>,
        positions: &SamplePositions,
        run: &Run,
        scratch: &mut [[f32; RUN]; 4],
    ) {
        let planes = self.planes.each_mut().map(|plane| &mut plane[run.span()]);
        let planes = planes.into_iter().take(if self.run_coverage[run.index] == RunCoverage::Partial { 4 } else { 3 });
        if run.len == RUN {
            let mut channels = scratch.each_mut();
            let complete = planes.map(|plane| plane.try_into().expect("a complete run"));
            channels.iter_mut().zip(complete).for_each(|(channel, plane)| *channel = plane);
            sample(simd, source.texture, positions, source.gains, channels);
        } else {
            sample(simd, source.texture, positions, source.gains, scratch.each_mut());
            planes.zip(scratch).for_each(|(plane, scratch)| plane.copy_from_slice(&scratch[..run.len]));
        }
    }
}

/// A view's own depth: the view sees a point unless this depth, at the pixel that the point projects to, is
/// nearer by a margin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OwnDisparity<'a> {
    /// Disparity of each pixel of its photo, 1/scene unit; below 0 where it is unknown.
    pub(crate) disparity: &'a [f32],
    /// How much nearer than a point it must be to hide the point, 1/scene unit.
    pub(crate) margin: f32,
}

impl OwnDisparity<'_> {
    /// Which points of a run the view sees, by bit; located with `PIXELS` ([`SamplePositions::locate`]).
    #[inline(always)]
    pub(super) fn seen(&self, points: &SamplePositions) -> u64 {
        let mut own = [-1.0; RUN];
        for (own, &pixel) in own.iter_mut().zip(&points.pixel) {
            *own = self.disparity.get(pixel as usize).copied().unwrap_or(-1.0);
        }
        let hidden = |i: usize| own[i] - points.disparity[i] >= self.margin;
        if !(0..RUN).fold(false, |any, i| any | hidden(i)) {
            return ALL_SEEN;
        }
        (0..RUN).fold(ALL_SEEN, |seen, i| seen & !(u64::from(hidden(i)) << i))
    }
}
