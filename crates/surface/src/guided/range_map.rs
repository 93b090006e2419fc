//! The range of disparities of each cell, and the layers that divide it.

use ndarray::Array2;
use rayon::prelude::*;

use liveview::layers::Layers;
use liveview::layers::LayersError;

/// Nearest and farthest disparity (1/scene unit) per cell of the target, and the surface between
/// them, `[h, w]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeMap {
    pub(super) nearest: Array2<f32>,
    surface: Array2<f32>,
    farthest: Array2<f32>,
}

impl RangeMap {
    /// `count` layers that divide the range of each cell evenly, near → far; a single layer is the
    /// surface found.
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for none.
    pub fn layers(&self, count: usize) -> Result<Layers, LayersError> {
        Layers::maps(self.divided(count).collect())
    }

    /// Nearest disparity per cell: the larger number.
    pub fn nearest(&self) -> &Array2<f32> {
        &self.nearest
    }

    /// Disparity found per cell, median-filtered.
    pub fn surface(&self) -> &Array2<f32> {
        &self.surface
    }

    /// Farthest disparity per cell: the smaller number, at least 0.
    pub fn farthest(&self) -> &Array2<f32> {
        &self.farthest
    }

    /// `count` maps that divide the range of each cell evenly, near → far; a single map is the
    /// surface. Measured alternatives: docs/design-log/guided-layers.md.
    pub(super) fn divided(&self, count: usize) -> impl Iterator<Item = Array2<f32>> {
        (0..count).map(move |k| {
            if count == 1 {
                return self.surface.clone();
            }
            let step = k as f64 / (count - 1) as f64;
            let between = |&n: &f32, &f: &f32| (f64::from(n) + step * (f64::from(f) - f64::from(n))) as f32;
            ndarray::Zip::from(&self.nearest).and(&self.farthest).map_collect(between)
        })
    }
}

/// The range around a map of disparities (1/scene unit, `[h, w]`): a 3×3 median filter, then the
/// minimum and the maximum over 3×3 cells, `margin` wider on both sides, each smoothed by a 3×3
/// mean.
///
/// # Panics
///
/// If the map is not in standard layout (rows one after the other).
pub fn range_of(disparity: &Array2<f32>, margin: f32) -> RangeMap {
    let disparity = neighbourhood(disparity, |mut n| {
        n.sort_unstable_by(f32::total_cmp);
        n[4]
    });
    let mean = |n: [f32; 9]| (n.iter().map(|&x| f64::from(x)).sum::<f64>() / 9.0) as f32;
    let nearest = neighbourhood(&disparity, |n| n.into_iter().fold(f32::MIN, f32::max)) + margin;
    let farthest =
        (neighbourhood(&disparity, |n| n.into_iter().fold(f32::MAX, f32::min)) - margin).mapv(|d| d.max(0.0));
    RangeMap { nearest: neighbourhood(&nearest, mean), surface: disparity, farthest: neighbourhood(&farthest, mean) }
}

/// A function of each cell's 3×3 neighbourhood, clamped at the edges; rows in parallel.
pub(super) fn neighbourhood(map: &Array2<f32>, f: impl Fn([f32; 9]) -> f32 + Sync) -> Array2<f32> {
    let (height, width) = map.dim();
    let cells = map.as_slice().expect("standard order");
    let mut out = Array2::zeros((height, width));
    let rows = out.as_slice_mut().expect("standard order").par_chunks_mut(width).enumerate();
    rows.for_each(|(y, out)| {
        let row = |y: usize| &cells[y * width..(y + 1) * width];
        let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))];
        for (x, out) in out.iter_mut().enumerate() {
            let columns = [x.saturating_sub(1), x, (x + 1).min(width - 1)];
            *out = f(std::array::from_fn(|k| rows[k / 3][columns[k % 3]]));
        }
    });
    out
}
