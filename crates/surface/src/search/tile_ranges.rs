//! Which planes of a grid of many each tile of a photo is searched at: those around what a search on
//! cells twice as large found there.
//!
//! For a tile of 24×63 cells: from the nearest to the farthest index that the coarser map has in the
//! tile and in its six cells around it, 8 planes more at either end, in whole segments of 8. Planes
//! outside cost what an unseen cell costs. Grids of at most 64 planes are searched at all: scenes of
//! little parallax would lose more than they gain. A picture of a scene of 256 planes takes 0.73 of the
//! processor time (docs/design-log/speed.md).

use std::ops::Range;

use ndarray::{Array2, Array3, s};

use super::grid::{Grid, SEGMENT};
use super::tile::{BAND_ROWS, TILE_COLUMNS};

/// Planes that are searched at everywhere.
const FEW_PLANES: usize = 64;
/// Cells a side of a cell of the coarser map.
const COARSER_CELL: usize = 2;
/// Cells of the coarser map around a tile that count.
const REACH: usize = 6;
/// Planes beyond those of the coarser map.
const MARGIN: f32 = 8.0;

/// Whether a grid is searched around what a coarser search found.
pub(crate) fn has_many_planes(grid: &Grid) -> bool {
    grid.count > FEW_PLANES
}

/// First plane and end, `[⌈h/24⌉, ⌈w/63⌉, 2]`, of each tile of `height` × `width` cells, whose disparity
/// a `coarser` search found; `None`: all planes everywhere.
pub(crate) fn tile_ranges(coarser: &Array2<f32>, grid: &Grid, (height, width): (usize, usize)) -> Option<Array3<u16>> {
    if !has_many_planes(grid) {
        return None;
    }
    let (rows, columns) = coarser.dim();
    let around = |tile: usize, side: usize, cells: usize, coarser: usize| -> Range<usize> {
        let end = ((tile + 1) * side).min(cells).div_ceil(COARSER_CELL);
        (tile * side / COARSER_CELL).saturating_sub(REACH)..(end + REACH).min(coarser)
    };
    let range = &|row: usize, column: usize| {
        let part = s![around(row, BAND_ROWS, height, rows), around(column, TILE_COLUMNS, width, columns)];
        let (mut near, mut far) = (f32::MAX, f32::MIN);
        for &disparity in coarser.slice(part) {
            let index = grid.index(disparity);
            (near, far) = (near.min(index), far.max(index));
        }
        let segments = [(near - MARGIN).max(0.0) as usize / SEGMENT, (far + MARGIN) as usize / SEGMENT + 1];
        segments.map(|segment| (segment * SEGMENT).min(grid.count.next_multiple_of(SEGMENT)) as u16)
    };
    let (down, across) = (height.div_ceil(BAND_ROWS), width.div_ceil(TILE_COLUMNS));
    let ranges = (0..down).flat_map(|row| (0..across).flat_map(move |column| range(row, column))).collect();
    Some(Array3::from_shape_vec((down, across, 2), ranges).expect("two per tile"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tile_ranges_hold_what_is_near_a_tile() {
        let grid = Grid::new(1.0, f64::INFINITY, 101);
        // Index 50 everywhere, but 80 at one cell, which only the first of the tiles is near to.
        let size = (24, 150);
        let mut coarser = Array2::from_elem((12, 75), grid.disparity(50.0));
        coarser[(3, 24)] = grid.disparity(80.0);
        let ranges = tile_ranges(&coarser, &grid, size).unwrap();
        assert_eq!(ranges, ndarray::arr3(&[[[40, 96], [40, 64], [40, 64]]]));
        coarser[(3, 24)] = 0.0;
        let ranges = tile_ranges(&coarser, &grid, size).unwrap();
        assert_eq!(ranges, ndarray::arr3(&[[[40, 104], [40, 64], [40, 64]]]), "up to the last plane");
        assert!(tile_ranges(&coarser, &Grid::new(1.0, 2.0, 64), size).is_none());
    }
}
