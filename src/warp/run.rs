//! Runs: the pixels of a row that the warp computes together.

use std::ops::Range;

/// Pixels of a run: enough that the compiler keeps loops over them as loops, and vectorises them.
pub(crate) const RUN: usize = 64;

/// All pixels of a run, as bits.
pub(crate) const ALL_SEEN: u64 = u64::MAX;

/// What is known about the coverage of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) enum RunCoverage {
    /// Nothing: any values in [0, 1].
    #[default]
    Partial,
    /// 0 throughout: every sample lies outside the photo.
    None,
    /// 1 throughout: every sample lies between the centres of four pixels.
    All,
}

/// A run of some rows of a layer.
pub(super) struct Run {
    /// Index among the runs of these rows.
    pub(super) index: usize,
    /// Index of its first pixel among those of these rows.
    pub(super) first: usize,
    /// Number of pixels, at most [`RUN`].
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
