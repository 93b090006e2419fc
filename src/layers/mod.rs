//! Layers: disparity per target pixel, near → far; and the paper's selection among planes.
//!
//! A layer is a plane (constant disparity δ = 1/z, in 1/scene unit: the paper's case), or a map of
//! disparity: on cells of [`CELL`]×[`CELL`] target pixels, interpolated bilinearly, or on single
//! pixels. Layers are ordered near → far *at every pixel*, so that compositing along a target ray
//! is exact.

mod layer;

use ndarray::ArrayView2;
use rayon::prelude::*;

pub use layer::{Layer, Layers, LayersError, uniform_disparities};

use crate::geometry::Size;

/// Pixels that the height and the width of the network's input are multiples of: it halves them
/// three times.
pub const STRIDE: usize = 8;

/// Target pixels per side of a cell of a map.
pub const CELL: usize = 2;

/// Size of the padded target: each side rounded up to a multiple of [`STRIDE`].
pub fn padded(size: Size) -> Size {
    Size::new(size.width.next_multiple_of(STRIDE), size.height.next_multiple_of(STRIDE))
}

/// Enlarges a map bilinearly by `factor` into `out`, `width` pixels wide: half-pixel centres,
/// clamped at the edges, as torch's `interpolate(mode="bilinear", align_corners=False)`. In f64,
/// where the weights (multiples of 1/(2 factor)) are exact: the result is rounded once, to f32.
pub fn enlarge(map: ArrayView2<'_, f32>, factor: usize, width: usize, out: &mut [f32]) {
    let columns: Vec<_> = (0..width).map(|x| neighbours(x, factor, map.ncols())).collect();
    out.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
        let (above, below, down) = neighbours(row, factor, map.nrows());
        let mix = |(&a, &b): (&f32, &f32)| (1.0 - down) * f64::from(a) + down * f64::from(b);
        let cells: Vec<f64> = map.row(above).iter().zip(map.row(below)).map(mix).collect();
        for (value, &(left, right, across)) in out.iter_mut().zip(&columns) {
            *value = ((1.0 - across) * cells[left] + across * cells[right]) as f32;
        }
    });
}

/// The two cells around a pixel, and the weight of the second.
fn neighbours(pixel: usize, factor: usize, cells: usize) -> (usize, usize, f64) {
    let position = ((pixel as f64 + 0.5) / factor as f64 - 0.5).max(0.0);
    let first = (position as usize).min(cells - 1);
    (first, (first + 1).min(cells - 1), position - first as f64)
}

/// For each plane, the number of pixels of which it is the best (paper, section "Plane selection"). `best`
/// holds for each pixel the index of the plane with the largest α; `None`, where all α are 0, is not counted.
///
/// # Panics
///
/// If an index is not below `planes`.
pub fn plane_histogram(best: impl IntoIterator<Item = Option<usize>>, planes: usize) -> Vec<u64> {
    let mut bins = vec![0; planes];
    for plane in best.into_iter().flatten() {
        bins[plane] += 1;
    }
    bins
}

/// The paper's selection: indices of the `count` fullest bins (ties: the nearer), near → far; all planes if there are no
/// more than that.
pub fn select_planes(histogram: &[u64], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..histogram.len()).collect();
    order.sort_by_key(|&k| (std::cmp::Reverse(histogram[k]), k));
    order.truncate(count);
    order.sort_unstable();
    order
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;

    #[test]
    fn enlarged_ramp_is_a_ramp_clamped_at_the_edges() {
        let map = Array2::from_shape_fn((2, 3), |(_, x)| x as f32);
        let mut enlarged = [0.0; 12 * 8];
        enlarge(map.view(), 4, 12, &mut enlarged);
        let row = &enlarged[12 * 5..12 * 6];
        assert_eq!(row[..3], [0.0, 0.0, 0.125]);
        assert_eq!(row[9..], [1.875, 2.0, 2.0]);
    }

    #[test]
    fn fullest_bins_are_selected_and_ties_go_to_the_nearer() {
        let bins = plane_histogram([Some(3), Some(1), Some(2), Some(3), None], 5);
        assert_eq!(bins, [0, 1, 1, 2, 0]);
        assert_eq!(select_planes(&bins, 2), [1, 3]);
        assert_eq!(select_planes(&bins, 9), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn padded_sides_are_multiples_of_eight() {
        assert_eq!(padded(Size::new(1, 8)), Size::new(8, 8));
        assert_eq!(padded(Size::new(17, 31)), Size::new(24, 32));
    }

    #[test]
    fn enlarged_maps_are_interpolated_in_both_directions() {
        let map = ndarray::arr2(&[[0.0, 4.0], [8.0, 20.0]]);
        let mut enlarged = [0.0; 4 * 4];
        enlarge(map.view(), 2, 4, &mut enlarged);
        assert_eq!(enlarged[..4], [0.0, 1.0, 3.0, 4.0]);
        assert_eq!(enlarged[4..8], [2.0, 3.5, 6.5, 8.0]);
        assert_eq!(enlarged[12..], [8.0, 11.0, 17.0, 20.0]);
    }

    #[test]
    fn pixels_beyond_the_last_cell_have_its_value() {
        let mut enlarged = [0.0; 8];
        enlarge(ndarray::arr2(&[[2.0, 4.0]]).view(), 2, 8, &mut enlarged);
        assert_eq!(enlarged, [2.0, 2.5, 3.5, 4.0, 4.0, 4.0, 4.0, 4.0]);
    }
}
