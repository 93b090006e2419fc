//! The stages of [`photo_depth`](super::photo_depth()) and [`surface`](super::surface()) one by one, on plain arrays: what the
//! parity tests hold against the reference. Nothing else needs them.
//!
//! Maps are `[h, w]`, disparities 1/scene unit, indices those of a grid of disparities from 1/near (0) to 1/far.

use ndarray::{Array2, Array3};

use super::fusion::photo_variance::{self, Views};
use super::fusion::{ConfirmedDepth, splat, visible};
use super::neighbourhood;
use super::search::aggregate::aggregate;
use super::search::grid::{Candidates, Grid};
use super::search::penalties::Penalties;
use super::search::photo_depth;
use super::search::photo_sweep::costs;
use super::search::planes::Planes;
use super::settings::Settings;
use crate::geometry::{Camera, PlaneSweep, Size};
use crate::render::{SharpenedPhotos, Visibility, hide};
use crate::warp::{
    RunCoverage, SourceView, Texture, WarpSource, WarpedLayers, run_coverage_len, warp_layers_into, warp_sources,
};

/// An even grid of disparities on cells of some pixels, and the part of it that each cell is searched at.
#[derive(Debug, Clone, Copy)]
pub struct Search<'a> {
    /// Nearest and farthest depth, scene units.
    pub range: (f64, f64),
    /// Disparities from one to the other.
    pub count: usize,
    /// Into how many each step between them is divided.
    pub parts: usize,
    /// Pixels per side of a cell: the photos are shrunk by as much.
    pub cell: usize,
    /// First index of the two segments of 8 at each 2×2 cells, `[h/2, w/2, 2]`, u16::MAX where there is no second; none: all
    /// indices are searched at every cell, their number rounded up to a multiple of 16.
    pub starts: Option<&'a Array3<u16>>,
}

impl Search<'_> {
    fn grid(&self) -> Grid {
        Grid::new(self.range.0, self.range.1, self.count).divided(self.parts)
    }

    /// `found` with the candidates, whose starts are pairs in a list.
    fn with_candidates<T>(&self, found: impl FnOnce(Candidates<'_>) -> T) -> T {
        let Some(starts) = self.starts else { return found(Candidates::All) };
        let (_, columns, _) = starts.dim();
        let values: Vec<u16> = starts.iter().copied().collect();
        found(Candidates::Two { starts: values.as_chunks().0, columns, share: 2 })
    }
}

/// Matching costs `[h, w, n]` of the n candidates of each cell of `photo`, in units of 1/32768; those of a second segment that
/// a cell does not have are anything.
pub fn matching_costs(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], search: &Search<'_>) -> Array3<u16> {
    let reference = Planes::new(&photo.texture.shrunk(search.cell));
    let textures: Vec<Texture> = neighbours.iter().map(|n| n.texture.shrunk(search.cell)).collect();
    let sweep = |n: &SourceView<'_>| PlaneSweep::new(n.camera, photo.camera).shrunk(search.cell as f64);
    let sources: Vec<_> =
        textures.iter().zip(neighbours).map(|(texture, n)| WarpSource::new(texture, sweep(n))).collect();
    let grid = search.grid();
    let volume = search.with_candidates(|candidates| costs(&reference, &sources, &grid, candidates));
    let count = volume.len() / (reference.height * reference.width);
    Array3::from_shape_vec((reference.height, reference.width, count), volume).expect("n per cell")
}

/// The index that semi-global aggregation of the costs `[h, w, n]` finds at each cell, before the median.
///
/// # Panics
/// If the costs are not in standard order.
pub fn aggregated(costs: &Array3<u16>, photo: &Texture, search: &Search<'_>, settings: &Settings) -> Array2<f32> {
    let reference = Planes::new(&photo.shrunk(search.cell));
    let penalties = Penalties { step: settings.step, jump: settings.jump, edge: settings.edge };
    let (grid, costs) = (search.grid(), costs.as_slice().expect("standard order"));
    let found = search.with_candidates(|candidates| aggregate(costs, &reference, &grid, candidates, &penalties));
    map(found, reference.width)
}

/// 3×3 median.
pub fn median3(values: &Array2<f32>) -> Array2<f32> {
    map(neighbourhood::median3(flat(values), values.ncols()), values.ncols())
}

/// The two segments `[h, w, 2]` of each cell, of a grid of `count` indices that has `parts` for one of the coarser, where the
/// index was found.
pub fn bands(index: &Array2<f32>, parts: usize, count: usize) -> Array3<u16> {
    let starts = photo_depth::bands(flat(index), index.ncols(), parts, count);
    Array3::from_shape_vec((index.nrows(), index.ncols(), 2), starts.into_flattened()).expect("two per cell")
}

/// Confirmed depths carried to the padded target of this size; −1 where nothing falls. Two within `agree` are one surface; those within
/// `fuse` of it are averaged.
pub fn splatted(
    maps: &[(&Camera, &ConfirmedDepth)],
    target: &Camera,
    size: Size,
    (agree, fuse): (f32, f32),
) -> Array2<f32> {
    map(splat::splat(maps, target, size, (agree, fuse)), size.width)
}

/// Holes (below 0) filled with the farthest neighbour, growing.
pub fn fill_holes(values: &Array2<f32>) -> Array2<f32> {
    map(neighbourhood::fill_holes(flat(values), values.ncols()), values.ncols())
}

/// 1 where the view sees the point of each pixel of the target at `disparity`, else 0.
pub fn visible(view: (&Camera, &ConfirmedDepth), target: &Camera, disparity: &Array2<f32>, margin: f32) -> Array2<f32> {
    map(visible::visible(view, target, flat(disparity), disparity.ncols(), margin), disparity.ncols())
}

/// A photo with `amount` of its detail added, `[h, w, 3]`.
pub fn sharpened(photo: &Texture, amount: f32) -> Array3<f32> {
    let mut found = Texture::default();
    photo.sharpen(amount, &mut found);
    Array3::from_shape_fn((photo.height(), photo.width(), 3), |(y, x, c)| found.pixel(x, y)[c])
}

/// A layer warped by `views`, in their balanced colours, with what they do not see taken away: colour `[3V, h, w]`, coverage `[V, h, w]`, and where any photo
/// sees it `[h, w]`.
pub fn hidden(
    visibility: &Visibility<'_>,
    views: &[SourceView<'_>],
    target: &Camera,
    layer: &Array2<f32>,
) -> (Array3<f32>, Array3<f32>, Array2<bool>) {
    let (height, width) = layer.dim();
    let size = Size::new(width, height);
    let mut colour = vec![0.0; 3 * views.len() * size.pixels()];
    let mut coverage = vec![0.0; views.len() * size.pixels()];
    let mut seen = vec![false; size.pixels()];
    let mut run_coverage = vec![RunCoverage::Partly; views.len() * run_coverage_len(size)];
    let mut sources = warp_sources(views, target);
    let mut sharpened = SharpenedPhotos::default();
    visibility.balance(&mut sources, &mut sharpened);
    let mut seen_runs = vec![0; run_coverage.len()];
    let mut warped = WarpedLayers {
        disparity: flat(layer),
        colour: &mut colour,
        coverage: &mut coverage,
        run_coverage: &mut run_coverage,
        seen: &mut seen_runs,
    };
    warp_layers_into(&sources, &visibility.own_depth(), size, &mut warped);
    hide(views.len(), size, &mut warped, &mut seen);
    let volume = |values: Vec<f32>| {
        Array3::from_shape_vec((values.len() / size.pixels(), height, width), values).expect("whole maps")
    };
    (volume(colour), volume(coverage), Array2::from_shape_vec((height, width), seen).expect("one per pixel"))
}

/// Disagreement `[h, w]` of the views on a surface; `visible` is 1 or 0 per view and pixel.
pub fn photo_variances(sources: &[WarpSource<'_>], visible: &[Vec<f32>], surface: &Array2<f32>) -> Array2<f32> {
    let everywhere = vec![-1.0; surface.len()];
    let views = Views { sources, visible };
    map(photo_variance::photo_variance(&views, flat(surface), surface.ncols(), &everywhere), surface.ncols())
}

fn flat(values: &Array2<f32>) -> &[f32] {
    values.as_slice().expect("standard order")
}

fn map(values: Vec<f32>, width: usize) -> Array2<f32> {
    Array2::from_shape_vec((values.len() / width, width), values).expect("whole rows")
}
