//! Guided layers: a coarse-to-fine search gives each pixel its own range of disparities.
//!
//! At 1/4 resolution: sweep the views through planes a cell of parallax apart, take the variance of their colours over a
//! window ([`layer_costs`]), aggregate it along rows and columns ([`semi_global`]), keep the cheapest plane, refined between
//! planes by a parabola ([`winner_takes_all`]). The neighbourhood's largest and smallest disparity, half a plane step wider,
//! are what is searched at 1/2 resolution: the same over a few layers that divide that range, each cell for itself. The
//! extremes of what this finds are the range ([`range_of`]). Known in stereo as adaptive thin volumes (UCS-Net, 2020).
//!
//! What the settings gain, and what was tried and did not pay: `docs/experiments.md` in the repository.

mod matching_cost;
mod range_map;
mod semi_global;

use std::cell::OnceCell;

use glam::DVec3;
use ndarray::{Array2, Array3, ArrayView3, Axis};

use matching_cost::Shrunk;
pub use matching_cost::layer_costs;
pub(crate) use range_map::neighbourhood;
pub use range_map::{RangeMap, range_of};
pub use semi_global::semi_global;

use super::{CELL, LayersError, enlarge, uniform_disparities};
use crate::geometry::{PlaneSweep, Size};
use crate::warp::{Texture, WarpSource};

/// Target pixels per cell of the first search.
pub const COARSE: usize = 4;
/// Planes of the first search, where the parallax decides.
const PLANES: std::ops::RangeInclusive<usize> = 8..=128;
/// Layers of the second search.
const FINE: usize = 6;
/// Cells over which the variance is averaged in the first search and in the second.
pub const WINDOWS: [usize; 2] = [3, 7];

/// Settings of the coarse pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuidedSearch {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Planes of the first search; `None`: a cell of parallax apart, 8 to 128.
    pub planes: Option<usize>,
}

/// What the coarse pass found, step by step.
#[derive(Debug, Clone)]
pub struct SearchStages {
    /// Planes of the first search, near → far, `D`.
    pub disparities: Vec<f64>,
    /// Their costs per cell of [`COARSE`] pixels, `[D, h, w]`.
    pub costs: Array3<f32>,
    /// The costs after [`semi_global`].
    pub aggregated_costs: Array3<f32>,
    /// The disparity they point at, `[h, w]`.
    pub coarse_disparity: Array2<f32>,
    /// Layers of the second search, `[D, h, w]` in cells of [`CELL`] pixels.
    pub fine_layers: Array3<f32>,
    /// Their costs.
    pub fine_costs: Array3<f32>,
    /// The disparity those point at, `[h, w]`.
    pub fine_disparity: Array2<f32>,
    /// The range of each cell of [`CELL`]×[`CELL`] pixels.
    pub range: RangeMap,
}

impl GuidedSearch {
    /// Searches a padded target (sides that are multiples of 8).
    ///
    /// # Errors
    /// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for no planes.
    pub fn search(&self, sources: &[WarpSource<'_>], size: Size) -> Result<SearchStages, LayersError> {
        let levels = Levels::new(sources.iter().map(|source| source.texture).collect());
        let sweeps: Vec<PlaneSweep> = sources.iter().map(|source| source.sweep).collect();
        self.search_levels(&levels, &sweeps, size)
    }

    /// As [`Self::search`], of a target or of a window of one.
    pub(crate) fn search_levels(
        &self,
        levels: &Levels<'_>,
        sweeps: &[PlaneSweep],
        size: Size,
    ) -> Result<SearchStages, LayersError> {
        let wanted = || (parallax(sweeps, size, self.near, self.far) / COARSE as f64).ceil() as usize;
        let count = self.planes.unwrap_or_else(|| wanted().clamp(*PLANES.start(), *PLANES.end()));
        let disparities = uniform_disparities(self.near, self.far, count)?;
        let shape = (count, size.height / COARSE, size.width / COARSE);
        let maps = Array3::from_shape_fn(shape, |(plane, _, _)| disparities[plane] as f32);
        let costs = levels.coarse().costs(sweeps, maps.view(), WINDOWS[0]);
        let aggregated_costs = semi_global(costs.view());
        let coarse_disparity = winner_takes_all(aggregated_costs.view(), maps.view());
        let step = disparities.get(1).map_or(0.0, |second| disparities[0] - second);
        let range = range_of(&coarse_disparity, (step / 2.0) as f32);
        let fine_layers = fine_layers(&range);
        let fine_costs = levels.fine().costs(sweeps, fine_layers.view(), WINDOWS[1]);
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

/// The views at the sizes of the two searches, shrunk when first asked for.
pub(crate) struct Levels<'a> {
    textures: Vec<&'a Texture>,
    coarse: OnceCell<Shrunk>,
    fine: OnceCell<Shrunk>,
}

impl<'a> Levels<'a> {
    pub(crate) fn new(textures: Vec<&'a Texture>) -> Self {
        Self { textures, coarse: OnceCell::new(), fine: OnceCell::new() }
    }

    pub(crate) fn coarse(&self) -> &Shrunk {
        self.coarse.get_or_init(|| Shrunk::new(&self.textures, COARSE))
    }

    fn fine(&self) -> &Shrunk {
        self.fine.get_or_init(|| Shrunk::new(&self.textures, CELL))
    }
}

/// Pixels between near and far in the view that sees most of it: the median over the target's corners and centre.
fn parallax(sweeps: &[PlaneSweep], size: Size, near: f64, far: f64) -> f64 {
    let points = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)];
    let of_view = |sweep: &PlaneSweep| {
        let seen = |disparity: f64, (x, y): (f64, f64)| {
            let uvw =
                sweep.source_from_target(disparity) * DVec3::new(x * size.width as f64, y * size.height as f64, 1.0);
            (uvw.z > 0.0).then(|| uvw.truncate() / uvw.z)
        };
        let apart = |&point: &_| Some(seen(1.0 / near, point)?.distance(seen(1.0 / far, point)?));
        let mut apart: Vec<f64> = points.iter().filter_map(apart).collect();
        apart.sort_by(f64::total_cmp);
        apart.get(apart.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
    };
    sweeps.iter().map(of_view).fold(0.0, f64::max)
}

/// The layers of the second search: the first one's ranges divided, on cells of [`CELL`] pixels.
pub fn fine_layers(range: &RangeMap) -> Array3<f32> {
    let factor = COARSE / CELL;
    let (height, width) = range.nearest.dim();
    let mut layers = Array3::zeros((FINE, factor * height, factor * width));
    for (map, mut layer) in range.divided(FINE).zip(layers.outer_iter_mut()) {
        enlarge(map.view(), factor, factor * width, layer.as_slice_mut().expect("standard order"));
    }
    layers
}

/// Disparity `[h, w]` of the cheapest of the layers `[D, h, w]`, moved to the vertex of a parabola through its cost and its
/// neighbours' (ties: the nearer layer; the first and the last stay where they are).
pub fn winner_takes_all(costs: ArrayView3<'_, f32>, maps: ArrayView3<'_, f32>) -> Array2<f32> {
    let (layers, height, width) = costs.dim();
    let mut best = Array2::<u32>::zeros((height, width));
    let mut least = costs.index_axis(Axis(0), 0).to_owned();
    for (layer, cost) in costs.outer_iter().enumerate().skip(1) {
        ndarray::Zip::from(&mut best).and(&mut least).and(cost).for_each(|best, least, &cost| {
            if cost < *least {
                (*best, *least) = (layer as u32, cost);
            }
        });
    }
    Array2::from_shape_fn((height, width), |(y, x)| {
        let k = best[(y, x)] as usize;
        if k == 0 || k + 1 == layers {
            return maps[(k, y, x)];
        }
        let [nearer, here, farther] = [k - 1, k, k + 1].map(|k| f64::from(costs[(k, y, x)]));
        let curvature = nearer - 2.0 * here + farther;
        let shift = if curvature > 0.0 { 0.5 * (nearer - farther) / curvature } else { 0.0 };
        let towards = if shift > 0.0 { k + 1 } else { k - 1 };
        let [own, towards] = [k, towards].map(|k| f64::from(maps[(k, y, x)]));
        (own + shift.abs() * (towards - own)) as f32
    })
}
