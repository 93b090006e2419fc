//! The stages of [`photo_depth`](crate::photo_depth()) and [`surface()`] one by
//! one, on plain arrays: for the parity tests, which compare them with the reference.
//!
//! Maps are `[h, w]`, disparities 1/scene unit, indices those of a grid of disparities from 1/near
//! (0) to 1/far.

use ndarray::{Array2, Array3};

use crate::aggregate::aggregate;
use crate::anchored_depth::{self, Group};
use crate::fusion::{OCCLUSION_MARGIN_PX, disparity_per_pixel, splat_confirmed, warp_sources};
use crate::grid::{Candidates, Grid, Planes};
use crate::photo_depth::Anchors;
use crate::photo_sweep::costs;
use crate::target_search::{self, SeenSurface, TargetSearch};
use crate::{ConfirmedDisparity, PhotoDisparity, SmallPhoto, consistency, grid, neighbourhood, photo_depth};
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::layers::padded;
use liveview::warp::{SourceView, Texture, WarpSource};

pub use crate::anchored_depth::anchored_depth;
pub use crate::consistency::confirmed;
pub use crate::correction::{exposure_gains, sharpening};
pub use crate::depth_range::range_of;
pub use crate::fusion::{SurfaceView, surface};
pub use crate::nearer_edges::nearer_edges;

/// An even grid of disparities on cells of pixels, and the part of it that each cell is searched
/// at.
#[derive(Debug, Clone, Copy)]
pub struct Search<'a> {
    /// Nearest and farthest depth, scene units.
    pub range: (f64, f64),
    /// Number of disparities from one to the other.
    pub count: usize,
    /// Each step between them is divided into this many.
    pub parts: usize,
    /// Pixels per side of a cell: the photos are shrunk by this factor.
    pub cell: usize,
    /// First index of the two segments of 8 at each 2×2 cells, `[h/2, w/2, 2]`, u16::MAX where
    /// there is no second; `None`: all indices are searched at every cell, their number rounded up
    /// to a multiple of 16.
    pub starts: Option<&'a Array3<u16>>,
    /// First plane and end, `[⌈h/24⌉, ⌈w/63⌉, 2]`, of each tile of 24×63 cells; `None`: all.
    pub ranges: Option<&'a Array3<u16>>,
}

impl Search<'_> {
    fn grid(&self) -> Grid {
        Grid::new(self.range.0, self.range.1, self.count).divided(self.parts)
    }

    /// The result of `search` with the candidates.
    fn with_candidates<T>(&self, search: impl FnOnce(Candidates<'_>) -> T) -> T {
        let Some(starts) = self.starts else { return search(Candidates::All) };
        let (_, columns, _) = starts.dim();
        let values: Vec<u16> = starts.iter().copied().collect();
        search(Candidates::Segments { starts: values.as_chunks().0, columns, cells_per_side: 2 })
    }
}

/// Matching costs `[h, w, n]` of the n candidates of each cell of `photo`, in units of 1/32768;
/// unspecified for the second segment of a cell that has one only.
pub fn matching_costs(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], search: &Search<'_>) -> Array3<u16> {
    let reference = Planes::new(&photo.texture.shrunk(search.cell));
    let textures: Vec<Texture> = neighbours.iter().map(|n| n.texture.shrunk(search.cell)).collect();
    let sweep = |n: &SourceView<'_>| PlaneSweep::new(n.camera, photo.camera).shrunk(search.cell as f64);
    let sources: Vec<_> =
        textures.iter().zip(neighbours).map(|(texture, n)| WarpSource::new(texture, sweep(n))).collect();
    let grid = search.grid();
    let volume = search.with_candidates(|candidates| costs(&reference, &sources, &grid, candidates, search.ranges));
    let count = volume.len() / (reference.height * reference.width);
    Array3::from_shape_vec((reference.height, reference.width, count), volume).expect("n per cell")
}

/// The planes that the tiles of a photo of `[h, w]` cells are searched at ([`Search::ranges`]), around
/// the disparity that a search on cells twice as large found.
pub fn tile_ranges(coarser: &Array2<f32>, search: &Search<'_>, size: (usize, usize)) -> Option<Array3<u16>> {
    grid::tile_ranges(coarser, &search.grid(), size)
}

/// Index of each cell by semi-global aggregation of the costs `[h, w, n]`, before the median.
///
/// # Panics
/// If the costs are not in standard order.
pub fn aggregated(costs: &Array3<u16>, photo: &Texture, search: &Search<'_>) -> Array2<f32> {
    let reference = Planes::new(&photo.shrunk(search.cell));
    let (grid, costs) = (search.grid(), costs.as_slice().expect("standard order"));
    let found = search.with_candidates(|candidates| aggregate(costs, &reference, &grid, candidates));
    map(found, reference.width)
}

/// 3×3 median.
pub fn median3(values: &Array2<f32>) -> Array2<f32> {
    map(neighbourhood::median3(flat(values), values.ncols()), values.ncols())
}

/// Disparity of each index of a search, 1/scene unit.
pub fn disparity(index: &Array2<f32>, search: &Search<'_>) -> Array2<f32> {
    index.mapv(|index| search.grid().disparity(index))
}

/// The depth `[h/4, w/4]` of the first of these photos at the small size, searched among the others (at
/// least one) from near to far (scene units).
pub fn small_map(views: &[SourceView<'_>], range: (f64, f64)) -> PhotoDisparity {
    let photos: Vec<SmallPhoto> = views.iter().map(|view| SmallPhoto::new(view, 1)).collect();
    anchored_depth::small_map(&photos.iter().collect::<Vec<_>>(), range)
}

/// What the others of a group confirm of each of its maps; the cameras are those of the full size.
pub fn group_confirmed(cameras: &[&Camera], maps: &[PhotoDisparity]) -> Vec<ConfirmedDisparity> {
    Group::of(cameras, maps.to_vec()).confirmed
}

/// Anchors of the first photo of a group, given the depth `found` of its cells of 2×2 pixels: which
/// cells are kept, and the disparity that each is drawn to (−1: none), `[h/2, w/2]`.
pub fn anchors(
    cameras: &[&Camera],
    maps: &[PhotoDisparity],
    confirmed: Vec<ConfirmedDisparity>,
    found: &PhotoDisparity,
) -> (Array2<bool>, Array2<f32>) {
    let mut group = Group::of(cameras, maps.to_vec());
    group.confirmed = confirmed;
    let Anchors { kept, disparity } = group.anchors(&cameras[0].shrunk(2), found);
    let width = found.disparity.ncols();
    (Array2::from_shape_vec(found.disparity.dim(), kept).expect("one per cell"), map(disparity, width))
}

/// Costs `[h, w, n]` of a search, changed by anchors.
///
/// # Panics
/// If the costs are not in standard order.
pub fn anchored_costs(
    costs: &Array3<u16>,
    kept: Array2<bool>,
    anchor: &Array2<f32>,
    search: &Search<'_>,
) -> Array3<u16> {
    let mut costs = costs.clone();
    let anchors = Anchors { kept: kept.into_iter().collect(), disparity: flat(anchor).to_vec() };
    anchors.add_to(costs.as_slice_mut().expect("standard order"), &search.grid());
    costs
}

/// First indices `[h, w, 2]` of the two segments of each cell around the coarse `index` found
/// there, in a grid of `count` indices, `fine_per_coarse` for each coarse one.
pub fn segment_starts(index: &Array2<f32>, fine_per_coarse: usize, count: usize) -> Array3<u16> {
    let starts = photo_depth::segment_starts(flat(index), index.ncols(), fine_per_coarse, count);
    Array3::from_shape_vec((index.nrows(), index.ncols(), 2), starts.into_flattened()).expect("two per cell")
}

/// Disparity that moves a point by one pixel at the padded target, 1/scene unit.
pub fn target_disparity_per_pixel(views: &[SurfaceView<'_>], target: &Camera, (near, far): (f64, f64)) -> f32 {
    disparity_per_pixel(&warp_sources(views, target), padded(target.size()), near, far)
}

/// Confirmed depths splatted to the padded target and fused; −1 in holes.
pub fn splatted(views: &[SurfaceView<'_>], target: &Camera, disparity_per_pixel: f32) -> Array2<f32> {
    map(splat_confirmed(views, target, disparity_per_pixel), padded(target.size()).width)
}

/// Holes (below 0) filled from their farthest neighbours inwards.
pub fn fill_holes(values: &Array2<f32>) -> Array2<f32> {
    map(neighbourhood::fill_holes(flat(values), values.ncols()), values.ncols())
}

/// 1 where the view sees the point of each pixel of the target at `disparity`, 0 where it is
/// occluded, −1 where the view sees past it; `margin` in 1/scene unit.
pub fn visible(
    view: (&Camera, &ConfirmedDisparity),
    target: &Camera,
    disparity: &Array2<f32>,
    margin: f32,
) -> Array2<f32> {
    map(consistency::visible(view, target, flat(disparity), disparity.ncols(), margin), disparity.ncols())
}

/// Variance `[h, w]` of the photos' colours on a surface; `visible` is 1, 0 or −1 per view and
/// pixel.
pub fn photo_variance(sources: &[WarpSource<'_>], visible: &[Vec<f32>], surface: &Array2<f32>) -> Array2<f32> {
    let (width, all_holes) = (surface.ncols(), vec![-1.0; surface.len()]);
    let seen = SeenSurface { disparity: flat(surface), splatted: &all_holes, width, sources, visible };
    map(target_search::photo_variance(&seen), width)
}

/// The target's own search: the costs `[D, h, w]` of its planes, and the disparity `[h, w]` that it
/// finds; `splat` is of the padded target.
pub fn target_search(
    views: &[SurfaceView<'_>],
    target: &Camera,
    splat: &Array2<f32>,
    range: (f64, f64),
) -> (Array3<f32>, Array2<f32>) {
    let sources = warp_sources(views, target);
    let margin = OCCLUSION_MARGIN_PX * target_disparity_per_pixel(views, target, range);
    let size = Size::new(splat.ncols(), splat.nrows());
    let search = TargetSearch { views, sources: &sources, target, splatted: flat(splat), size, range, margin };
    let planes = search.planes();
    let costs = search.costs(&planes);
    let disparity = map(search.disparity(&planes, costs.view()), size.width);
    (costs, disparity)
}

fn flat(values: &Array2<f32>) -> &[f32] {
    values.as_slice().expect("standard order")
}

fn map(values: Vec<f32>, width: usize) -> Array2<f32> {
    Array2::from_shape_vec((values.len() / width, width), values).expect("complete rows")
}
