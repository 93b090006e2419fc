//! The depth that a search finds for a photo.

use ndarray::Array2;

use super::grid::Grid;
use liveview::geometry::Size;

/// Result of a photo's search, before other photos confirm it.
#[derive(Debug, Clone)]
pub struct PhotoDepth {
    /// Disparity of each pixel, `[h, w]`, 1/scene unit.
    pub disparity: Array2<f32>,
    /// Disparity that moves a point by one pixel in the neighbour with the largest parallax,
    /// 1/scene unit; by one pixel of the size that it was searched at, where that is smaller.
    pub disparity_per_pixel: f32,
}

impl PhotoDepth {
    /// From the index found at each cell, rows `width` wide, a fraction between two of the grid.
    pub(super) fn at(index: &[f32], width: usize, grid: &Grid, disparity_per_pixel: f32) -> Self {
        let disparity = index.iter().map(|&index| grid.disparity(index)).collect();
        let shape = (index.len() / width, width);
        Self { disparity: Array2::from_shape_vec(shape, disparity).expect("complete rows"), disparity_per_pixel }
    }

    /// That of a photo without neighbours: −1 everywhere, which nothing confirms.
    pub fn unknown(size: Size) -> Self {
        Self { disparity: Array2::from_elem((size.height, size.width), -1.0), disparity_per_pixel: 1.0 }
    }
}
