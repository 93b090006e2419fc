//! The part of a photo that the plane sweep processes at a time, small enough to stay in the cache.

use super::grid::SEGMENT;
use crate::warp::{RUN, SamplePositions};

/// Rows that one task processes at a time.
pub(super) const BAND_ROWS: usize = 24;
/// Rows of a tile: those of a band and the one below, for vertical gradients.
pub(super) const TILE_ROWS: usize = BAND_ROWS + 1;
/// Columns from one tile to the next: the last column of a run has no right neighbour.
pub(super) const TILE_COLUMNS: usize = RUN - 1;
/// Number of neighbours whose costs are averaged: those that match best, so that occlusion in the
/// others does not matter.
pub(super) const BEST_NEIGHBOURS: usize = 2;

/// A value at each column of a tile.
pub(super) type TileRow = [f32; RUN];

/// Part of a band: a run of columns, of which all but the last have a right neighbour.
pub(super) struct Tile {
    /// First row of the band.
    pub(super) first: usize,
    /// Rows of the band.
    pub(super) rows: usize,
    /// First column.
    pub(super) column: usize,
    /// Whether no cell lies on the photo's right or lower edge.
    pub(super) inside: bool,
    /// First index of the segment at each cell.
    pub(super) index: [TileRow; TILE_ROWS],
    /// The smallest and the largest of them.
    pub(super) index_range: [f32; 2],
    /// Sum over the channels of the absolute difference of colour.
    pub(super) colour: [TileRow; TILE_ROWS],
    /// Sum over the channels of the signed difference; one more column, which stays 0.
    pub(super) signed: [[f32; RUN + 1]; TILE_ROWS],
    /// 1 where the neighbour sees the cell, else 0; one more column, which stays 0.
    pub(super) seen: [[f32; RUN + 1]; TILE_ROWS],
    /// Lowest costs over the neighbours so far, ascending.
    pub(super) lowest: [[TileRow; BAND_ROWS]; BEST_NEIGHBOURS],
    /// Costs of a segment's candidates, in units of the volume.
    pub(super) costs: [[[u16; RUN]; BAND_ROWS]; SEGMENT],
    pub(super) positions: SamplePositions,
}

impl Tile {
    pub(super) const NEW: Self = Self {
        first: 0,
        rows: 0,
        column: 0,
        inside: false,
        index: [[0.0; RUN]; TILE_ROWS],
        index_range: [0.0; 2],
        colour: [[0.0; RUN]; TILE_ROWS],
        signed: [[0.0; RUN + 1]; TILE_ROWS],
        seen: [[0.0; RUN + 1]; TILE_ROWS],
        lowest: [[[0.0; RUN]; BAND_ROWS]; BEST_NEIGHBOURS],
        costs: [[[0; RUN]; BAND_ROWS]; SEGMENT],
        positions: SamplePositions::NEW,
    };

    /// Its rows and the one below, without rows below a photo of that height.
    #[inline(always)]
    pub(super) fn sampled_rows(&self, height: usize) -> std::ops::Range<usize> {
        self.first..(self.first + self.rows + 1).min(height)
    }

    /// Merges a row's costs in one neighbour (`first`: in the first one) into its lists of the
    /// `averaged` lowest.
    #[inline(always)]
    pub(super) fn merge(&mut self, row: usize, mut cost: TileRow, averaged: usize, first: bool) {
        for (index, list) in self.lowest.iter_mut().take(averaged).enumerate() {
            let list = &mut list[row];
            if first {
                *list = if index == 0 { cost } else { [f32::MAX; RUN] };
                continue;
            }
            for i in 0..RUN {
                let (held, new) = (list[i], cost[i]);
                (list[i], cost[i]) = if new < held { (new, held) } else { (held, new) };
            }
        }
    }
}
