//! Layers: disparity per target pixel, near → far.
//!
//! A layer is a plane (constant disparity δ = 1/z, in 1/scene unit: the paper's case) or a smooth map given on a grid of
//! [`CELL`]×[`CELL`] target pixels and interpolated bilinearly. Layers are ordered near → far *at every pixel*, so that
//! compositing along a target ray stays exact.

pub mod guided;
mod histogram;
mod kmeans;
mod spec;

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

pub use histogram::{plane_histogram, select_planes};
pub use kmeans::kmeans_planes;
pub use spec::{LayerSpec, LayerSpecError, MAX_LAYERS};

use crate::geometry::Size;

/// The network halves its input three times: it takes heights and widths that are multiples of this.
pub const STRIDE: usize = 8;

/// Target pixels per side of a cell of a map.
pub const CELL: usize = 2;

/// Why a list of layers was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LayersError {
    /// No layer at all.
    #[error("the list of disparities is empty: expected at least one")]
    Empty,
    /// A disparity that is negative or not finite.
    #[error("disparity {index} is {value}: expected a number of ordinary size, 0 (infinity) or more")]
    NotADisparity {
        /// Its place in the list.
        index: usize,
        /// What it is.
        value: f64,
    },
    /// Not sorted near → far.
    #[error(
        "disparity {index} ({value}) is nearer than the one before it ({before}): expected descending disparities, near to far"
    )]
    Unsorted {
        /// Its place in the list.
        index: usize,
        /// What it is.
        value: f64,
        /// The one before it.
        before: f64,
    },
    /// near and far do not span a range.
    #[error(
        "near is {near:?} and far is {far:?}: expected 0 < near < far, in scene units, and a 1 / near that f32 holds"
    )]
    Range {
        /// Nearest depth asked for.
        near: f64,
        /// Farthest depth asked for.
        far: f64,
    },
    /// Maps of different shapes.
    #[error("the map of layer {index} has {found:?} cells: expected {expected:?}, like the first")]
    Shape {
        /// Which layer.
        index: usize,
        /// Its shape.
        found: (usize, usize),
        /// The shape of the first.
        expected: (usize, usize),
    },
}

/// One layer of the target: its disparity at each pixel, in 1/scene unit.
#[derive(Debug, Clone)]
pub enum Layer {
    /// The same disparity everywhere.
    Plane(f64),
    /// Disparity per cell of [`CELL`]×[`CELL`] pixels of the padded target, `[h, w]`.
    Map(Array2<f32>),
}

/// A validated list of layers, near → far. Never empty.
#[derive(Debug, Clone)]
pub struct Layers(Vec<Layer>);

impl Layers {
    /// Planes at the given disparities (1/scene unit), in any spacing; descending, 0 is the plane at infinity.
    pub fn planes(disparities: &[f64]) -> Result<Self, LayersError> {
        if disparities.is_empty() {
            return Err(LayersError::Empty);
        }
        for (index, &value) in disparities.iter().enumerate() {
            // As f32, which the pixels are computed in.
            if !(value as f32).is_finite() || value < 0.0 {
                return Err(LayersError::NotADisparity { index, value });
            }
            if index > 0 && value > disparities[index - 1] {
                return Err(LayersError::Unsorted { index, value, before: disparities[index - 1] });
            }
        }
        Ok(Self(disparities.iter().map(|&d| Layer::Plane(d)).collect()))
    }

    /// `count` planes evenly spaced in disparity from 1/near to 1/far (the paper's choice); see [`uniform_disparities`].
    pub fn uniform(near: f64, far: f64, count: usize) -> Result<Self, LayersError> {
        Self::planes(&uniform_disparities(near, far, count)?)
    }

    /// Layers given as maps on the grid of cells, `[h, w]` each; descending at every cell.
    pub fn maps(maps: Vec<Array2<f32>>) -> Result<Self, LayersError> {
        let expected = maps.first().ok_or(LayersError::Empty)?.dim();
        for (index, map) in maps.iter().enumerate() {
            if map.dim() != expected {
                return Err(LayersError::Shape { index, found: map.dim(), expected });
            }
            if let Some(&value) = map.iter().find(|v| !v.is_finite() || **v < 0.0) {
                return Err(LayersError::NotADisparity { index, value: value.into() });
            }
            if index > 0 {
                let pair = map.iter().zip(&maps[index - 1]).find(|(value, before)| value > before);
                if let Some((&value, &before)) = pair {
                    return Err(LayersError::Unsorted { index, value: value.into(), before: before.into() });
                }
            }
        }
        Ok(Self(maps.into_iter().map(Layer::Map).collect()))
    }

    /// The layers, near → far.
    pub fn as_slice(&self) -> &[Layer] {
        &self.0
    }

    /// How many there are; at least one.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// `count` disparities evenly spaced from 1/near to 1/far, near → far; `far` may be infinite. One lies in the middle.
pub fn uniform_disparities(near: f64, far: f64, count: usize) -> Result<Vec<f64>, LayersError> {
    if !(near > 0.0 && near < far && near.is_finite() && ((1.0 / near) as f32).is_finite()) {
        return Err(LayersError::Range { near, far });
    }
    let (nearest, farthest) = (1.0 / near, 1.0 / far);
    Ok(match count {
        0 => return Err(LayersError::Empty),
        1 => vec![0.5 / near + 0.5 / far],
        _ => (0..count).map(|k| nearest + k as f64 / (count - 1) as f64 * (farthest - nearest)).collect(),
    })
}

/// A target's size, each side rounded up to a multiple of [`STRIDE`].
pub fn padded(size: Size) -> Size {
    Size::new(size.width.next_multiple_of(STRIDE), size.height.next_multiple_of(STRIDE))
}

impl Layer {
    /// Disparity of each pixel of a padded target of rows `width` wide, into `out` `[height, width]`; in parallel.
    pub fn fill(&self, width: usize, out: &mut [f32]) {
        match self {
            Self::Plane(disparity) => out.fill(*disparity as f32),
            Self::Map(map) => enlarge(map.view(), CELL, width, out),
        }
    }
}

/// Bilinear enlargement by `factor`: half-pixel centres, edges held, as torch's
/// `interpolate(mode="bilinear", align_corners=False)`. In f64, where the weights (halves of 1/factor) are exact: one rounding.
pub(crate) fn enlarge(map: ArrayView2<'_, f32>, factor: usize, width: usize, out: &mut [f32]) {
    let columns: Vec<_> = (0..width).map(|x| taps(x, factor, map.ncols())).collect();
    out.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
        let (above, below, down) = taps(row, factor, map.nrows());
        let mix = |(&a, &b): (&f32, &f32)| (1.0 - down) * f64::from(a) + down * f64::from(b);
        let cells: Vec<f64> = map.row(above).iter().zip(map.row(below)).map(mix).collect();
        for (value, &(left, right, across)) in out.iter_mut().zip(&columns) {
            *value = ((1.0 - across) * cells[left] + across * cells[right]) as f32;
        }
    });
}

/// The two cells around pixel `at` and the weight of the second.
fn taps(at: usize, factor: usize, cells: usize) -> (usize, usize, f64) {
    let position = ((at as f64 + 0.5) / factor as f64 - 0.5).max(0.0);
    let first = (position as usize).min(cells - 1);
    (first, (first + 1).min(cells - 1), position - first as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_planes_run_from_near_to_far_and_reach_infinity() {
        assert_eq!(uniform_disparities(0.5, f64::INFINITY, 3).unwrap(), [2.0, 1.0, 0.0]);
        assert_eq!(uniform_disparities(1.0, 2.0, 1).unwrap(), [0.75]);
    }

    #[test]
    fn bad_lists_are_refused_by_name() {
        assert_eq!(Layers::planes(&[]).unwrap_err(), LayersError::Empty);
        assert!(matches!(Layers::planes(&[0.1, 0.2]), Err(LayersError::Unsorted { index: 1, .. })));
        assert!(matches!(Layers::planes(&[f64::NAN]), Err(LayersError::NotADisparity { index: 0, .. })));
        assert!(matches!(Layers::uniform(2.0, 1.0, 4), Err(LayersError::Range { .. })));
        assert!(matches!(Layers::uniform(0.0, 1.0, 4), Err(LayersError::Range { .. })));
        assert!(matches!(Layers::uniform(f64::NAN, 1.0, 4), Err(LayersError::Range { .. })));
    }

    #[test]
    fn a_ramp_is_enlarged_to_a_ramp_with_held_edges() {
        let map = Array2::from_shape_fn((2, 3), |(_, x)| x as f32);
        let mut enlarged = [0.0; 12 * 8];
        enlarge(map.view(), 4, 12, &mut enlarged);
        let row = &enlarged[12 * 5..12 * 6];
        assert_eq!(row[..3], [0.0, 0.0, 0.125]);
        assert_eq!(row[9..], [1.875, 2.0, 2.0]);
    }
}
