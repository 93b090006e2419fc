//! An even grid of disparities, and which of them each cell of a photo is searched at.
//!
//! Index 0 is the nearest disparity, 1/near; index k is the disparity 1/near − k·step. A search
//! finds a fractional index between two of them. In f32: disparity(index) = nearest − index·step,
//! product and difference each rounded once.

/// Consecutive disparities that a cell is searched at together: one vector of 16-bit costs.
pub(crate) const SEGMENT: usize = 8;

/// `count` disparities, near → far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    nearest: f32,
    step: f32,
    pub(crate) count: usize,
}

impl Grid {
    /// From 1/near to 1/far in `count` disparities (at least two).
    pub(crate) fn new(near: f64, far: f64, count: usize) -> Self {
        let (nearest, farthest) = (1.0 / near, 1.0 / far);
        Self { nearest: nearest as f32, step: ((nearest - farthest) / (count - 1) as f64) as f32, count }
    }

    /// The same range, each step divided by `parts`.
    pub(crate) fn divided(&self, parts: usize) -> Self {
        Self { step: self.step / parts as f32, count: (self.count - 1) * parts + 1, ..*self }
    }

    /// Index of a disparity, a fraction between two of the grid.
    pub(crate) fn index(&self, disparity: f32) -> f32 {
        (self.nearest - disparity) / self.step
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
    /// All of them at every cell; their number is rounded up to whole segments, beyond the end of
    /// the grid.
    All,
    /// One or two segments of consecutive indices at each cell.
    Segments {
        /// First index of each segment, row by row. The second segment does not begin before the
        /// end of the first; [`Candidates::NO_SEGMENT`] where there is none.
        starts: &'a [[u16; 2]],
        /// Entries of `starts` per row.
        columns: usize,
        /// Each entry applies to this many cells across and down.
        cells_per_side: usize,
    },
}

impl Candidates<'_> {
    /// Takes the place of the start of a second segment where there is only one.
    pub(crate) const NO_SEGMENT: u16 = u16::MAX;

    /// Number of indices that a cell is searched at.
    pub(crate) fn count(&self, grid: &Grid) -> usize {
        match self {
            Self::All => grid.count.next_multiple_of(2 * SEGMENT),
            Self::Segments { .. } => 2 * SEGMENT,
        }
    }

    /// Index of the `k`-th candidate of a cell.
    #[inline(always)]
    pub(crate) fn index(&self, (y, x): (usize, usize), k: usize) -> usize {
        match self {
            Self::All => k,
            Self::Segments { starts, columns, cells_per_side } => {
                let starts = starts[y / cells_per_side * columns + x / cells_per_side];
                usize::from(starts[k / SEGMENT]) + k % SEGMENT
            }
        }
    }
}
