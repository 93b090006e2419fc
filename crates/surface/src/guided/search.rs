//! The guided search: two searches for the disparity of least matching cost, the second at twice
//! the resolution.

use std::cell::OnceCell;

use ndarray::{Array2, Array3};

use super::matching_cost::Shrunk;
use super::range_map::{RangeMap, range_of};
use super::semi_global::{Penalties, semi_global};
use super::winner_takes_all::winner_takes_all;
use crate::parallax::widest_parallax;
use liveview::geometry::{PlaneSweep, Size};
use liveview::layers::LayersError;
use liveview::layers::uniform_disparities;
use liveview::layers::{CELL, enlarge};
use liveview::warp::{Texture, WarpSource};

/// Target pixels per cell of the first search.
pub const COARSE: usize = 4;
/// Limits of the number of planes of the first search, if the parallax determines it.
const COARSE_PLANES: std::ops::RangeInclusive<usize> = 8..=128;
/// Layers of the second search.
const FINE_LAYERS: usize = 6;
/// Side of the window over which the variance is averaged, cells: in the first search, in the
/// second.
pub const WINDOWS: [usize; 2] = [3, 7];
/// Penalties of the first search.
pub const PENALTIES: Penalties = Penalties { step: 0.004, jump: 0.1 };

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
    /// Their matching costs per cell of [`COARSE`] pixels, `[D, h, w]`.
    pub costs: Array3<f32>,
    /// The costs after [`semi_global`].
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
    /// A search from `near` to `far`, scene units; the parallax determines the planes of the first
    /// search.
    pub fn new(near: f64, far: f64) -> Self {
        Self { near, far, planes: None }
    }

    /// Searches a padded target ([`liveview::layers::padded`]) of that size in pixels.
    ///
    /// # Errors
    ///
    /// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for no planes.
    pub fn search(&self, sources: &[WarpSource<'_>], size: Size) -> Result<SearchStages, LayersError> {
        let levels = Levels::new(sources.iter().map(|source| (source.texture, source.gains)).collect());
        let sweeps: Vec<PlaneSweep> = sources.iter().map(|source| source.sweep).collect();
        self.search_levels(&levels, &sweeps, size)
    }

    /// As [`Self::search`], on views that are already shrunk, of a target or of a part of one.
    pub(super) fn search_levels(
        &self,
        levels: &Levels<'_>,
        sweeps: &[PlaneSweep],
        size: Size,
    ) -> Result<SearchStages, LayersError> {
        let from_parallax = || (widest_parallax(sweeps, size, self.near, self.far) / COARSE as f64).ceil() as usize;
        let count = self.planes.unwrap_or_else(|| from_parallax().clamp(*COARSE_PLANES.start(), *COARSE_PLANES.end()));
        let disparities = uniform_disparities(self.near, self.far, count)?;
        let shape = (count, size.height / COARSE, size.width / COARSE);
        let maps = Array3::from_shape_fn(shape, |(plane, _, _)| disparities[plane] as f32);
        let costs = levels.coarse().costs(sweeps, maps.view(), WINDOWS[0]);
        let aggregated_costs = semi_global(costs.view(), PENALTIES);
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

/// The views at the resolutions of the two searches, shrunk when first used.
pub(super) struct Levels<'a> {
    /// Photos with their gains per channel.
    photos: Vec<(&'a Texture, [f32; 3])>,
    coarse: OnceCell<Shrunk>,
    fine: OnceCell<Shrunk>,
}

impl<'a> Levels<'a> {
    pub(super) fn new(photos: Vec<(&'a Texture, [f32; 3])>) -> Self {
        Self { photos, coarse: OnceCell::new(), fine: OnceCell::new() }
    }

    pub(super) fn coarse(&self) -> &Shrunk {
        self.coarse.get_or_init(|| Shrunk::new(&self.photos, COARSE))
    }

    fn fine(&self) -> &Shrunk {
        self.fine.get_or_init(|| Shrunk::new(&self.photos, CELL))
    }
}

/// The layers of the second search (1/scene unit, `[D, h, w]` in cells of [`CELL`] pixels), which
/// divide the ranges found by the first.
pub fn fine_layers(range: &RangeMap) -> Array3<f32> {
    let factor = COARSE / CELL;
    let (height, width) = range.nearest.dim();
    let mut layers = Array3::zeros((FINE_LAYERS, factor * height, factor * width));
    for (map, mut layer) in range.divided(FINE_LAYERS).zip(layers.outer_iter_mut()) {
        enlarge(map.view(), factor, factor * width, layer.as_slice_mut().expect("standard order"));
    }
    layers
}
