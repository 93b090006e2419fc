//! An even grid of disparities, and which of them each cell of a photo is searched at.
//!
//! Index 0 is the nearest disparity, 1/near; index k lies at 1/near − k·step. A fractional index is what a search finds between
//! two of them. As f32, disparity(index) = nearest − index·step, product and difference each rounded once.

/// Disparities a cell is searched at side by side: one vector of 16-bit costs.
pub(crate) const SEGMENT: usize = 8;

/// `count` disparities, near → far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    nearest: f32,
    step: f32,
    count: usize,
}

impl Grid {
    /// From 1/near to 1/far in `count` disparities (two at least).
    pub(crate) fn new(near: f64, far: f64, count: usize) -> Self {
        let (nearest, farthest) = (1.0 / near, 1.0 / far);
        Self { nearest: nearest as f32, step: ((nearest - farthest) / (count - 1) as f64) as f32, count }
    }

    /// The same range, each step divided by `parts`.
    pub(crate) fn divided(&self, parts: usize) -> Self {
        Self { step: self.step / parts as f32, count: (self.count - 1) * parts + 1, ..*self }
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Disparity at an index, at least 0.
    #[inline(always)]
    pub(crate) fn disparity(&self, index: f32) -> f32 {
        let disparity = self.nearest - index * self.step;
        if disparity > 0.0 { disparity } else { 0.0 }
    }
}

/// Which indices of a grid are searched.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Candidates<'a> {
    /// All of them (their number rounded up to whole segments, beyond the end of the grid), at every cell.
    All,
    /// One or two segments of consecutive indices, which begin at `starts[cell]`; the second not before the end of the first,
    /// or [`Candidates::NONE`]. One pair serves `share`×`share` cells of a map that is `columns` wide.
    Two {
        /// First index of each segment, row by row.
        starts: &'a [[u16; 2]],
        /// Pairs in a row.
        columns: usize,
        /// Cells per side that a pair serves.
        share: usize,
    },
}

impl Candidates<'_> {
    /// In place of the start of a second segment: there is only one.
    pub(crate) const NONE: u16 = u16::MAX;

    /// How many indices a cell is searched at.
    pub(crate) fn count(&self, grid: &Grid) -> usize {
        match self {
            Self::All => grid.count().next_multiple_of(2 * SEGMENT),
            Self::Two { .. } => 2 * SEGMENT,
        }
    }

    /// Index of the `k`-th candidate of a cell.
    #[inline(always)]
    pub(crate) fn index(&self, (y, x): (usize, usize), k: usize) -> usize {
        match self {
            Self::All => k,
            Self::Two { starts, columns, share } => {
                usize::from(starts[y / share * columns + x / share][k / SEGMENT]) + k % SEGMENT
            }
        }
    }
}
