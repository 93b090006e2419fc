//! The part of a photo that the plane sweep processes at a time, small enough to stay in the cache,
//! and whether a neighbour sees it: tiles that it does not see cost what an unseen cell costs, without
//! samples.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::grid::SEGMENT;
use liveview::geometry::PlaneSweep;
use liveview::warp::{RUN, SamplePositions, WarpSource};

/// Rows that one task processes at a time.
pub(super) const BAND_ROWS: usize = 24;
/// Rows of a tile: those of a band and the one below, for vertical gradients.
pub(super) const TILE_ROWS: usize = BAND_ROWS + 1;
/// Columns from one tile to the next: the last column of a run has no right neighbour.
pub(super) const TILE_COLUMNS: usize = RUN - 1;
/// Number of neighbours whose costs are averaged: those that match best, so that occlusion in the
/// others does not matter.
pub(super) const BEST_NEIGHBOURS: usize = 2;

/// Distance from the neighbour's photo from which on a position is outside, pixels: a sample half a
/// pixel outside has a share of the photo, and positions are rounded by some millionths.
const MARGIN: f64 = 1.0;

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
    pub(super) fn sampled_rows(&self, height: usize) -> Range<usize> {
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

/// Whether the neighbour sees none of these columns and rows at any disparity from one to the
/// other (1/scene unit). The corners lie in front of it and beyond the same side of its photo; so
/// do all points between them. May be false where it sees none.
#[inline(always)]
pub(super) fn is_unseen(
    neighbour: &WarpSource<'_>,
    columns: &Range<usize>,
    rows: &Range<usize>,
    disparities: [f32; 2],
) -> bool {
    let PlaneSweep { homography_at_infinity: homography, epipole } = neighbour.sweep;
    let (mut least, mut most) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for column in [columns.start, columns.end] {
        for row in [rows.start, rows.end] {
            let corner = homography * DVec3::new(column as f64, row as f64, 1.0);
            for disparity in disparities {
                let at = corner + epipole * f64::from(disparity);
                if at.z <= 0.0 || at.z.is_nan() {
                    return false;
                }
                let at = DVec2::new(at.x / at.z, at.y / at.z);
                (least, most) = (least.min(at), most.max(at));
            }
        }
    }
    let (width, height) = (neighbour.texture.width() as f64, neighbour.texture.height() as f64);
    most.x < -MARGIN || most.y < -MARGIN || least.x > width + MARGIN || least.y > height + MARGIN
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use liveview::image::ImageRgb;
    use liveview::warp::Texture;

    #[test]
    fn only_what_lies_beyond_one_side_at_all_disparities_is_unseen() {
        let texture = Texture::new(&ImageRgb::new(40, 30, vec![0.5; 3 * 40 * 30]).unwrap());
        let sweep = |homography, epipole| PlaneSweep { homography_at_infinity: homography, epipole };
        let unseen = |homography, epipole, disparities| {
            is_unseen(&WarpSource::new(&texture, sweep(homography, epipole)), &(0..20), &(0..10), disparities)
        };
        for (x, y) in [(100.0, 0.0), (-100.0, 0.0), (0.0, 100.0), (0.0, -100.0)] {
            let epipole = DVec3::new(x, y, 0.0);
            assert!(unseen(DMat3::IDENTITY, epipole, [0.5, 0.5]), "{x} {y}");
            assert!(!unseen(DMat3::IDENTITY, epipole, [0.01, 0.5]), "{x} {y}: seen at one end");
        }
        // Beyond the left side at one end and the right side at the other: seen between.
        let shifted = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -60.0, 0.0, 1.0]);
        assert!(!unseen(shifted, DVec3::X, [0.0, 200.0]));
        assert!(unseen(shifted, DVec3::X, [0.0, 10.0]));
        // Half a pixel outside is in reach of a sample.
        assert!(!unseen(DMat3::IDENTITY, DVec3::X, [40.5, 40.5]));
        assert!(unseen(DMat3::IDENTITY, DVec3::X, [41.5, 41.5]));
        // Behind the neighbour, or partly so.
        let behind = DMat3::from_cols_array(&[1.0, 0.0, 0.1, 0.0, 1.0, 0.0, -60.0, 0.0, -1.0]);
        assert!(!unseen(behind, DVec3::ZERO, [0.0, 0.0]));
        assert!(!unseen(DMat3::IDENTITY, DVec3::NAN, [1.0, 1.0]));
    }
}
