//! The part of a photo that the sweep works on at a time, small enough to stay in the cache.

use super::grid::SEGMENT;
use crate::warp::{RUN, SamplePositions};

/// Rows that a thread takes at a time.
pub(super) const BAND: usize = 24;
/// Rows of a tile: those of a band, and the one below.
pub(super) const ROWS: usize = BAND + 1;
/// Columns from one tile to the next: the last of a run has no right neighbour.
pub(super) const STEP: usize = RUN - 1;
/// Neighbours whose costs count: those that match best, so that being hidden in the others does not matter.
pub(super) const KEPT: usize = 2;

/// A value at each column of a tile.
pub(super) type Run = [f32; RUN];

/// Part of a band: a run of columns, of which all but the last have a right neighbour.
pub(super) struct Tile {
    /// First row of the band, and how many there are.
    pub(super) first: usize,
    pub(super) rows: usize,
    /// First column.
    pub(super) column: usize,
    /// Whether no cell lies on the photo's right or lower edge.
    pub(super) inside: bool,
    /// First index of the segment at each cell.
    pub(super) index: [Run; ROWS],
    /// Sum of the channels' differences without and with their sign, and which cells are seen (1 or 0). One more column of the
    /// latter two, which stays 0.
    pub(super) colour: [Run; ROWS],
    pub(super) signed: [[f32; RUN + 1]; ROWS],
    pub(super) seen: [[f32; RUN + 1]; ROWS],
    /// The least costs of the neighbours so far, ascending.
    pub(super) kept: [[Run; BAND]; KEPT],
    pub(super) found: [[[u16; RUN]; BAND]; SEGMENT],
    pub(super) taps: SamplePositions,
}

impl Tile {
    pub(super) const NEW: Self = Self {
        first: 0,
        rows: 0,
        column: 0,
        inside: false,
        index: [[0.0; RUN]; ROWS],
        colour: [[0.0; RUN]; ROWS],
        signed: [[0.0; RUN + 1]; ROWS],
        seen: [[0.0; RUN + 1]; ROWS],
        kept: [[[0.0; RUN]; BAND]; KEPT],
        found: [[[0; RUN]; BAND]; SEGMENT],
        taps: SamplePositions::NONE,
    };

    /// Its rows and the one below, as far as the photo goes.
    #[inline(always)]
    pub(super) fn sampled(&self, height: usize) -> std::ops::Range<usize> {
        self.first..(self.first + self.rows + 1).min(height)
    }
}
