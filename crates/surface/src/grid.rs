//! An even grid of disparities, which of them each cell of a photo is searched at, and the photo's colours as
//! the search reads them.
//!
//! Index 0 is the nearest disparity, 1/near; index k is the disparity 1/near − k·step. A search
//! finds a fractional index between two of them. In f32: disparity(index) = nearest − index·step,
//! product and difference each rounded once.
//!
//! Of a grid of many planes, each tile of a photo is searched at those around what a search on cells twice
//! as large found there. For a tile of 24×63 cells: from the nearest to the farthest index that the coarser map has in the
//! tile and in its six cells around it, 8 planes more at either end, in whole segments of 8. Planes
//! outside cost what an unseen cell costs. Grids of at most 64 planes are searched at all: scenes of
//! little parallax would lose more than they gain (docs/design-log/speed.md)

use std::ops::Range;

use ndarray::{Array2, Array3, s};

use crate::photo_sweep::{BAND_ROWS, TILE_COLUMNS};
use liveview::warp::{RUN, Texture};

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
    /// A few of its own at each cell, fractional indices.
    Own(&'a [PerOwn]),
}

/// Number of its own candidates that a cell has.
pub(crate) const OWN: usize = 3;
/// One number per candidate of a cell.
pub(crate) type PerOwn = [f32; OWN];

impl Candidates<'_> {
    /// Takes the place of the start of a second segment where there is only one.
    pub(crate) const NO_SEGMENT: u16 = u16::MAX;

    /// Number of indices that a cell is searched at.
    pub(crate) fn count(&self, grid: &Grid) -> usize {
        match self {
            Self::All => grid.count.next_multiple_of(2 * SEGMENT),
            Self::Segments { .. } => 2 * SEGMENT,
            Self::Own(_) => OWN,
        }
    }

    /// Index of the `k`-th candidate of a cell.
    #[inline(always)]
    pub(crate) fn index(&self, (y, x): (usize, usize), k: usize) -> usize {
        match self {
            Self::All | Self::Own(_) => k,
            Self::Segments { starts, columns, cells_per_side } => {
                let starts = starts[y / cells_per_side * columns + x / cells_per_side];
                usize::from(starts[k / SEGMENT]) + k % SEGMENT
            }
        }
    }
}

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

/// Colour planes of a photo. Rows are padded so that a run of [`RUN`] may begin in any column.
pub(crate) struct Planes {
    pub(crate) width: usize,
    pub(crate) height: usize,
    stride: usize,
    rgb: [Vec<f32>; 3],
}

impl Planes {
    pub(crate) fn new(texture: &Texture) -> Self {
        let (width, height) = (texture.width(), texture.height());
        let (stride, texels) = (width + RUN, texture.upper_and_lower().0);
        let mut rgb = [(); 3].map(|()| vec![0.0; stride * height]);
        for y in 0..height {
            let row = &texels[(y + 1) * texture.stride() as usize + 1..][..width];
            for (channel, plane) in rgb.iter_mut().enumerate() {
                plane[y * stride..].iter_mut().zip(row).for_each(|(value, texel)| *value = texel[channel]);
            }
        }
        Self { width, height, stride, rgb }
    }

    /// Difference of colour of two pixels, given by their numbers row by row; summed over the channels.
    #[inline(always)]
    pub(crate) fn difference(&self, one: usize, other: usize) -> f32 {
        let [one, other] = [one, other].map(|at| at / self.width * self.stride + at % self.width);
        let [r, g, b] = [0, 1, 2].map(|channel| (self.rgb[channel][one] - self.rgb[channel][other]).abs());
        (r + g) + b
    }

    /// Row `y` of a channel, without its padding.
    pub(crate) fn row(&self, channel: usize, y: usize) -> &[f32] {
        &self.rgb[channel][y * self.stride..][..self.width]
    }

    /// Run of row `y` of a channel, from column `x` on.
    #[inline(always)]
    pub(crate) fn run(&self, channel: usize, y: usize, x: usize) -> &[f32; RUN] {
        self.rgb[channel][y * self.stride + x..][..RUN].try_into().expect("a run")
    }
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

    #[test]
    fn difference_is_that_of_the_two_pixels() {
        let value = |at: usize, channel: usize| ((at * 37 + channel * 11) % 101) as f32 / 101.0;
        let rgb = (0..12 * 3).map(|at| value(at / 3, at % 3)).collect();
        let picture = liveview::image::ImageRgb::new(4, 3, rgb).unwrap();
        let photo = Planes::new(&Texture::new(&picture));
        for (one, other) in (0..12).flat_map(|one| (0..12).map(move |other| (one, other))) {
            let expected: f32 = (0..3).map(|channel| (value(one, channel) - value(other, channel)).abs()).sum();
            assert!((photo.difference(one, other) - expected).abs() < 1e-6, "{one}, {other}");
        }
    }
}
