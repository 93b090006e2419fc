//! Guided layers: a coarse-to-fine search finds a range of disparities for each pixel, which a few
//! layers divide.
//!
//! The first search, at 1/4 resolution, sweeps the views through planes that are one cell of
//! parallax apart. The matching cost is the variance of the colours of the views over a window
//! (`matching`); it is aggregated along rows and columns (`semi_global`), and the
//! disparity of least cost is taken (`winner_takes_all`). The range of a neighbourhood is its
//! least to its largest disparity, half a plane step wider at both ends (`range_of`). The second
//! search, at 1/2 resolution, evaluates a few layers that divide this range cell by cell
//! (`fine_layers`), without aggregation. The extremes of the disparities that it finds are the
//! final range. Multi-view stereo knows this as adaptive thin volumes (UCS-Net, Cheng et al.,
//! 2020).
//!
//! Measured alternatives: docs/design-log/guided-layers.md.

use std::cell::OnceCell;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use crate::matching::{Penalties, Shrunk, semi_global, winner_takes_all};
use crate::neighbourhood::{extremes3, median3};
use crate::parallax::widest_parallax;
use liveview::geometry::{Camera, PlaneSweep};
use liveview::layers::{CELL, Layers, LayersError, enlarge, padded, uniform_disparities};
use liveview::warp::SourceView;

pub use crate::carried_surface::{CarriedSurface, guided_range};

/// Target pixels per cell of the first search.
pub(crate) const COARSE: usize = 4;
/// Limits of the number of planes of the first search, if the parallax determines it.
const COARSE_PLANES: std::ops::RangeInclusive<usize> = 8..=128;
/// Layers of the second search.
const FINE_LAYERS: usize = 6;
/// Side of the window over which the variance is averaged, cells: in the first search, in the
/// second.
pub(crate) const WINDOWS: [usize; 2] = [3, 7];
/// Penalties of the first search.
const PENALTIES: Penalties = Penalties { step: 0.004, jump: 0.1 };

/// Settings of the guided search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuidedSearch {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Planes of the first search; `None`: 8 to 128, one cell of parallax apart.
    pub planes: Option<usize>,
}

/// The stages of the guided search.
#[derive(Debug, Clone)]
pub struct SearchStages {
    /// Disparities of the planes of the first search (1/scene unit), near → far, `[D]`.
    pub disparities: Vec<f64>,
    /// Their matching costs per cell of 4 pixels, `[D, h, w]`.
    pub costs: Array3<f32>,
    /// The costs after semi-global matching.
    pub aggregated_costs: Array3<f32>,
    /// Disparity of least aggregated cost (1/scene unit), `[h, w]`.
    pub coarse_disparity: Array2<f32>,
    /// Layers of the second search (1/scene unit), `[D, h, w]` in cells of [`CELL`] pixels.
    pub fine_layers: Array3<f32>,
    /// Their matching costs, `[D, h, w]`.
    pub fine_costs: Array3<f32>,
    /// Disparity of least cost (1/scene unit), `[h, w]`.
    pub fine_disparity: Array2<f32>,
    /// The range of each cell of [`CELL`]×[`CELL`] pixels.
    pub range: RangeMap,
}

impl GuidedSearch {
    /// Searches a target, padded ([`liveview::layers::padded`]), for which these are the views.
    ///
    /// # Errors
    ///
    /// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for no planes.
    pub fn search(&self, views: &[SourceView<'_>], target: &Camera) -> Result<SearchStages, LayersError> {
        self.search_part(&TargetViews::new(views, target), target)
    }

    /// As [`Self::search`], of the target of these views or of a part of it.
    pub(crate) fn search_part(&self, views: &TargetViews<'_>, part: &Camera) -> Result<SearchStages, LayersError> {
        let (sweeps, size) = (&views.sweeps(part), padded(part.size()));
        let from_parallax = || (widest_parallax(sweeps, size, self.near, self.far) / COARSE as f64).ceil() as usize;
        let count = self.planes.unwrap_or_else(|| from_parallax().clamp(*COARSE_PLANES.start(), *COARSE_PLANES.end()));
        let disparities = uniform_disparities(self.near, self.far, count)?;
        let shape = (count, size.height / COARSE, size.width / COARSE);
        let maps = Array3::from_shape_fn(shape, |(plane, _, _)| disparities[plane] as f32);
        let costs = views.coarse().costs(sweeps, maps.view(), WINDOWS[0]);
        let aggregated_costs = semi_global(costs.view(), PENALTIES);
        let coarse_disparity = winner_takes_all(aggregated_costs.view(), maps.view());
        let step = disparities.get(1).map_or(0.0, |second| disparities[0] - second);
        let range = range_of(&coarse_disparity, (step / 2.0) as f32);
        let fine_layers = fine_layers(&range);
        let fine_costs = views.fine().costs(sweeps, fine_layers.view(), WINDOWS[1]);
        let fine_disparity = winner_takes_all(fine_costs.view(), fine_layers.view());
        let range = range_of(&fine_disparity, 0.0);
        Ok(SearchStages {
            disparities,
            costs,
            aggregated_costs,
            coarse_disparity,
            fine_layers,
            fine_costs,
            fine_disparity,
            range,
        })
    }
}

/// The views of a target, at the resolutions of the two searches, shrunk when first used.
pub(crate) struct TargetViews<'a> {
    views: &'a [SourceView<'a>],
    pub(crate) target: &'a Camera,
    coarse: OnceCell<Shrunk>,
    fine: OnceCell<Shrunk>,
}

impl<'a> TargetViews<'a> {
    pub(crate) fn new(views: &'a [SourceView<'a>], target: &'a Camera) -> Self {
        Self { views, target, coarse: OnceCell::new(), fine: OnceCell::new() }
    }

    pub(crate) fn coarse(&self) -> &Shrunk {
        self.coarse.get_or_init(|| Shrunk::new(self.views, COARSE))
    }

    fn fine(&self) -> &Shrunk {
        self.fine.get_or_init(|| Shrunk::new(self.views, CELL))
    }

    /// Plane sweeps for the target, or for a part of it.
    pub(crate) fn sweeps(&self, part: &Camera) -> Vec<PlaneSweep> {
        self.views.iter().map(|view| PlaneSweep::new(view.camera, part)).collect()
    }
}

/// The layers of the second search (1/scene unit, `[D, h, w]` in cells of [`CELL`] pixels), which
/// divide the ranges found by the first.
fn fine_layers(range: &RangeMap) -> Array3<f32> {
    let factor = COARSE / CELL;
    let (height, width) = range.nearest.dim();
    let mut layers = Array3::zeros((FINE_LAYERS, factor * height, factor * width));
    for (map, mut layer) in range.divided(FINE_LAYERS).zip(layers.outer_iter_mut()) {
        enlarge(map.view(), factor, factor * width, layer.as_slice_mut().expect("standard order"));
    }
    layers
}

/// The range of disparities (1/scene unit) of each cell of a target, `[h, w]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeMap {
    /// Nearest disparity: the larger number.
    pub nearest: Array2<f32>,
    /// Disparity found, median-filtered.
    pub surface: Array2<f32>,
    /// Farthest disparity: the smaller number, at least 0.
    pub farthest: Array2<f32>,
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

    /// `count` maps that divide the range of each cell evenly, near → far; a single map is the
    /// surface. Measured alternatives: docs/design-log/guided-layers.md.
    fn divided(&self, count: usize) -> impl Iterator<Item = Array2<f32>> {
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
pub(crate) fn range_of(disparity: &Array2<f32>, margin: f32) -> RangeMap {
    let (height, width) = disparity.dim();
    let map = |cells| Array2::from_shape_vec((height, width), cells).expect("one per cell");
    let surface = median3(disparity.as_slice().expect("standard order"), width);
    let (nearest, farthest) = extremes3(&surface, width);
    let (nearest, farthest) = (map(nearest) + margin, (map(farthest) - margin).mapv(|d| d.max(0.0)));
    RangeMap { nearest: mean3(&nearest), surface: map(surface), farthest: mean3(&farthest) }
}

/// Mean of each cell's 3×3 neighbourhood, clamped at the edges.
fn mean3(map: &Array2<f32>) -> Array2<f32> {
    let (height, width) = map.dim();
    let cells = map.as_slice().expect("standard order");
    let mut out = Array2::zeros((height, width));
    let rows = out.as_slice_mut().expect("standard order").par_chunks_mut(width).enumerate();
    rows.for_each(|(y, out)| {
        let row = |y: usize| &cells[y * width..(y + 1) * width];
        let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))];
        for (x, out) in out.iter_mut().enumerate() {
            let columns = [x.saturating_sub(1), x, (x + 1).min(width - 1)];
            let sum: f64 = (0..9).map(|k| f64::from(rows[k / 3][columns[k % 3]])).sum();
            *out = (sum / 9.0) as f32;
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_ends_at_infinity() {
        let range = range_of(&Array2::from_elem((3, 3), 0.25), 0.5);
        assert_eq!((range.nearest[(1, 1)], range.surface[(1, 1)], range.farthest[(1, 1)]), (0.75, 0.25, 0.0));
        let range = range_of(&Array2::from_elem((3, 3), 0.75), 0.5);
        assert_eq!(range.farthest[(1, 1)], 0.25);
    }
}
