//! The depth that a search finds for a photo.

use ndarray::Array2;

use crate::geometry::Size;

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
    /// That of a photo without neighbours: −1 everywhere, which nothing confirms.
    pub(crate) fn unknown(size: Size) -> Self {
        Self { disparity: Array2::from_elem((size.height, size.width), -1.0), disparity_per_pixel: 1.0 }
    }
}
