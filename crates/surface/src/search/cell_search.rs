//! The first search of a photo's depth: all planes, on cells of several pixels.
//!
//! Cells of c×c pixels (area averages), n = ⌈parallax / (c/2) px⌉ + 1 planes, 32 to 256, from near to
//! far; the parallax is that between near and far in the neighbour where it is largest. Costs
//! ([`super::photo_sweep`]), of many planes only around what a search on larger cells found
//! ([`super::tile_ranges`]), aggregated ([`super::aggregate`]), 3×3 median of the (fractional) indices.

use rayon::prelude::*;

use super::aggregate::aggregate;
use super::anchors::Anchors;
use super::depth_map::PhotoDepth;
use super::grid::{Candidates, Grid};
use super::photo_sweep::costs;
use super::planes::Planes;
use super::tile_ranges::{has_many_planes, tile_ranges};
use crate::neighbourhood::median3;
use crate::parallax::widest_parallax;
use liveview::geometry::PlaneSweep;
use liveview::warp::{SourceView, Texture, WarpSource};

/// Number of planes, at least and at most.
const PLANE_COUNT: std::ops::RangeInclusive<usize> = 32..=256;
/// Distance between the planes, pixels of parallax per pixel of a cell's side.
pub(crate) const PLANE_SPACING: f64 = 0.5;

/// A search on cells, and what it found.
pub(crate) struct CellSearch {
    /// The photo by cells.
    pub(super) photo: Planes,
    pub(super) grid: Grid,
    /// `[h, w, n]`.
    costs: Vec<u16>,
    /// Of each cell, a fraction between two of the grid.
    pub(super) index: Vec<f32>,
    /// Disparity that moves a point by one pixel of the photo in the neighbour with the largest
    /// parallax, 1/scene unit.
    pub(crate) disparity_per_pixel: f32,
}

impl CellSearch {
    /// Searches the first of the photos among the others (at least one), from near to far (scene
    /// units). Their cameras are of the full size, their textures by cells of `cell` pixels a side;
    /// `coarser` returns what a search on cells twice as large finds, and is called if there are many
    /// planes.
    pub(crate) fn new(
        views: &[SourceView<'_>],
        cell: usize,
        (near, far): (f64, f64),
        coarser: impl FnOnce() -> Option<PhotoDepth>,
    ) -> Self {
        let (photo, neighbours) = views.split_first().expect("a photo");
        let sweeps: Vec<_> = neighbours.iter().map(|n| PlaneSweep::new(n.camera, photo.camera)).collect();
        // From the first to the last plane, in the neighbour where it is largest; pixels of the full
        // size.
        let parallax = widest_parallax(&sweeps, photo.camera.size(), near, far).max(1.0);
        let count = (parallax / (PLANE_SPACING * cell as f64)).ceil() as usize + 1;
        let grid = Grid::new(near, far, count.clamp(*PLANE_COUNT.start(), *PLANE_COUNT.end()));
        let coarser = if has_many_planes(&grid) { coarser() } else { None };
        let sources = neighbours.iter().zip(&sweeps);
        let sources: Vec<_> = sources.map(|(n, sweep)| WarpSource::new(n.texture, sweep.shrunk(cell as f64))).collect();
        let photo = Planes::new(photo.texture);
        let size = (photo.height, photo.width);
        let ranges = coarser.and_then(|coarser| tile_ranges(&coarser.disparity, &grid, size));
        let costs = costs(&photo, &sources, &grid, Candidates::All, ranges.as_ref());
        let index = smooth_index(&costs, &photo, &grid, Candidates::All);
        let disparity_per_pixel = ((1.0 / near - 1.0 / far) / parallax) as f32;
        Self { photo, grid, costs, index, disparity_per_pixel }
    }

    /// As [`Self::new`], of photos of the full size.
    pub(crate) fn of_full_size(
        views: &[SourceView<'_>],
        cell: usize,
        range: (f64, f64),
        coarser: impl FnOnce() -> Option<PhotoDepth>,
    ) -> Self {
        let textures: Vec<Texture> = views.par_iter().map(|view| view.texture.shrunk(cell)).collect();
        let by_cells = views.iter().zip(&textures).map(|(view, texture)| SourceView { texture, ..*view });
        Self::new(&by_cells.collect::<Vec<_>>(), cell, range, coarser)
    }

    /// Searches the cells that are not kept again, with these anchors. The costs are spent: once.
    pub(crate) fn search_again(&mut self, anchors: &Anchors) {
        if anchors.kept.iter().all(|&kept| kept) {
            return;
        }
        let mut costs = std::mem::take(&mut self.costs);
        anchors.add_to(&mut costs, &self.grid);
        let found = smooth_index(&costs, &self.photo, &self.grid, Candidates::All);
        let cells = self.index.iter_mut().zip(found).zip(&anchors.kept);
        cells.filter(|(_, kept)| !**kept).for_each(|((index, found), _)| *index = found);
    }

    /// The depth of each cell.
    pub(crate) fn depth(&self) -> PhotoDepth {
        PhotoDepth::at(&self.index, self.photo.width, &self.grid, self.disparity_per_pixel)
    }
}

/// The index of each cell by aggregation, smoothed by a 3×3 median.
pub(super) fn smooth_index(costs: &[u16], photo: &Planes, grid: &Grid, candidates: Candidates<'_>) -> Vec<f32> {
    median3(&aggregate(costs, photo, grid, candidates), photo.width)
}
