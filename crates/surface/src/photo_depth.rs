//! The depth of one photo: a plane sweep with the photo as reference at half resolution, then a
//! narrow band around its result at full resolution.
//!
//! 1. All planes on cells of 2×2 pixels ([`CellSearch`]).
//! 2. Pixels, planes half as far apart. Each cell has one or two segments of 8 of them, around the
//!    nearest and the farthest index n and f of its 3×3 neighbourhood, in steps of the finer grid,
//!    m = round((n + f)/2): where f − n < 3 one, from m − 3 on; where f − n < 10 two that join,
//!    from m − 7 on; else one from round(n) − 3 and one from round(f) − 4 on, not before the end of
//!    the first. All are shifted to lie on the grid. The same costs, aggregation and median.
//!
//! A search on cells of c×c pixels (area averages) has n = ⌈parallax / (c/2) px⌉ + 1 planes, 32 to 256, from near to
//! far; the parallax is that between near and far in the neighbour where it is largest. Costs
//! ([`crate::photo_sweep`]), of many planes only around what a search on larger cells found
//! ([`tile_ranges`]), aggregated ([`aggregate`]), 3×3 median of the (fractional) indices.
//!
//! Anchors draw the cells of a second aggregation to a depth. A cell with an anchor of disparity d pays 0.05·min(|k − k(d)|/4, 1) more for index k, with k(d) the
//! (fractional) index of d; a cell without one pays half its costs, so that the paths from anchored
//! cells decide. The costs of a cell that is kept and has no anchor stay. In units of the volume
//! (1/32768), rounded to nearest; half a cost is rounded down.
//!
//! An enlarged or soft photo has no detail of one pixel, and a search at its full size costs more and finds
//! less ([`detail_pixels`]). The detail of a size is the mean square, over the inner pixels, of 4 times a pixel's grey (the mean
//! of its channels) less its four neighbours. While a photo's detail is below 0.22 of that of the photo
//! at half its size (area averages), the smaller one takes its place, as long as its shorter side has
//! 240 pixels. Photos as cameras took them have 0.27 to 1.0 (median of each of 46 scenes but two), the
//! same enlarged twice 0.12 to 0.20.

use ndarray::Array2;
use rayon::prelude::*;

use crate::aggregate::aggregate;
use crate::grid::{Candidates, Grid, Planes, SEGMENT, has_many_planes, tile_ranges};
use crate::neighbourhood::median3;
use crate::parallax::widest_parallax;
use crate::photo_sweep::{COST_SCALE, costs};
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::warp::{SourceView, Texture, WarpSource, round_to_i32, warp_sources};

/// Pixels per side of a cell of the first search.
pub(crate) const CELL: usize = 2;
/// Planes of the second search per plane of the first.
pub(crate) const FINE_PER_COARSE: usize = 2;

/// Searches the depth of `photo` among its `neighbours` (at least one), from `near` to `far` (scene
/// units).
pub fn photo_depth(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], near: f64, far: f64) -> PhotoDisparity {
    let views: Vec<_> = std::iter::once(photo).chain(neighbours).copied().collect();
    refined(&views, CellSearch::of_full_size(&views, CELL, (near, far), || None))
}

/// The second search of the first of these photos, around the result of the first search.
pub(crate) fn refined(views: &[SourceView<'_>], first: CellSearch) -> PhotoDisparity {
    let (photo, neighbours) = views.split_first().expect("a photo");
    let CellSearch { photo: cells, grid, index, disparity_per_pixel, costs: spent } = first;
    drop(spent);
    let fine = grid.divided(FINE_PER_COARSE);
    let starts = segment_starts(&index, cells.width, FINE_PER_COARSE, fine.count);
    let candidates = Candidates::Segments { starts: &starts, columns: cells.width, cells_per_side: CELL };
    let reference = Planes::new(photo.texture);
    let volume = costs(&reference, &warp_sources(neighbours, photo.camera), &fine, candidates, None);
    let index = smooth_index(&volume, &reference, &fine, candidates);
    PhotoDisparity::at(&index, reference.width, &fine, disparity_per_pixel)
}

/// First indices of the two segments of each cell, from the coarse indices that were found (rows
/// `width` wide). The finer grid has `count` indices, `fine_per_coarse` for each coarse one.
pub(crate) fn segment_starts(index: &[f32], width: usize, fine_per_coarse: usize, count: usize) -> Vec<[u16; 2]> {
    let (height, segment) = (index.len() / width, SEGMENT as f32);
    let mut starts = vec![[0; 2]; index.len()];
    starts.par_chunks_mut(width).enumerate().for_each(|(y, starts)| {
        for (x, starts) in starts.iter_mut().enumerate() {
            let (mut near, mut far) = (f32::MAX, f32::MIN);
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for &index in &index[row * width..][x.saturating_sub(1)..(x + 2).min(width)] {
                    (near, far) = (near.min(index), far.max(index));
                }
            }
            let (near, far) = (near * fine_per_coarse as f32, far * fine_per_coarse as f32);
            let last = (count.max(2 * SEGMENT) - 2 * SEGMENT) as f32;
            let middle = (0.5 * (near + far)).round();
            *starts = if far - near < 3.0 {
                [(middle - 3.0).clamp(0.0, last + segment) as u16, Candidates::NO_SEGMENT]
            } else if far - near < segment + 2.0 {
                let first = (middle - (segment - 1.0)).clamp(0.0, last) as u16;
                [first, first + SEGMENT as u16]
            } else {
                let first = (near.round() - 3.0).clamp(0.0, last) as u16;
                [first, ((far.round() - 4.0).min(last + segment) as u16).max(first + SEGMENT as u16)]
            };
        }
    });
    starts
}

/// Number of planes, at least and at most.
const PLANE_COUNT: std::ops::RangeInclusive<usize> = 32..=256;
/// Distance between the planes, pixels of parallax per pixel of a cell's side.
pub(crate) const PLANE_SPACING: f64 = 0.5;

/// Of the first of these cameras among the others: the plane sweeps, the pixels of parallax from the first to the
/// last plane in the neighbour where it is largest, and the number of planes for cells of `cell` pixels a side.
fn sweep(cameras: &[&Camera], cell: usize, (near, far): (f64, f64)) -> (Vec<PlaneSweep>, f64, usize) {
    let (photo, neighbours) = cameras.split_first().expect("a photo");
    let sweeps: Vec<_> = neighbours.iter().map(|camera| PlaneSweep::new(camera, photo)).collect();
    let parallax = widest_parallax(&sweeps, photo.size(), near, far).max(1.0);
    let count = (parallax / (PLANE_SPACING * cell as f64)).ceil() as usize + 1;
    (sweeps, parallax, count.clamp(*PLANE_COUNT.start(), *PLANE_COUNT.end()))
}

/// Bytes of the costs of the search for the depth of a photo among its neighbours, their cameras given in that
/// order, with their sums and what else it takes at the size of the photo.
pub fn search_bytes(cameras: &[&Camera], range: (f64, f64)) -> usize {
    let pixels = cameras[0].size().pixels();
    let planes = sweep(cameras, CELL, range).2.next_multiple_of(2 * SEGMENT);
    let first = pixels / (CELL * CELL) * planes;
    let second = pixels * 2 * SEGMENT;
    // Costs and sums of 16 bits; maps and pictures at the size of the photo.
    4 * first.max(second) + 60 * pixels
}

/// A search on cells, and what it found.
pub(crate) struct CellSearch {
    /// The photo by cells.
    pub(crate) photo: Planes,
    pub(crate) grid: Grid,
    /// `[h, w, n]`.
    costs: Vec<u16>,
    /// Of each cell, a fraction between two of the grid.
    pub(crate) index: Vec<f32>,
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
        coarser: impl FnOnce() -> Option<PhotoDisparity>,
    ) -> Self {
        let (photo, neighbours) = views.split_first().expect("a photo");
        let cameras: Vec<_> = views.iter().map(|view| view.camera).collect();
        let (sweeps, parallax, count) = sweep(&cameras, cell, (near, far));
        let grid = Grid::new(near, far, count);
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
        coarser: impl FnOnce() -> Option<PhotoDisparity>,
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
    pub(crate) fn depth(&self) -> PhotoDisparity {
        PhotoDisparity::at(&self.index, self.photo.width, &self.grid, self.disparity_per_pixel)
    }
}

/// The index of each cell by aggregation, smoothed by a 3×3 median.
fn smooth_index(costs: &[u16], photo: &Planes, grid: &Grid, candidates: Candidates<'_>) -> Vec<f32> {
    median3(&aggregate(costs, photo, grid, candidates), photo.width)
}

/// Result of a photo's search, before other photos confirm it.
#[derive(Debug, Clone)]
pub struct PhotoDisparity {
    /// Disparity of each pixel, `[h, w]`, 1/scene unit.
    pub disparity: Array2<f32>,
    /// Disparity that moves a point by one pixel in the neighbour with the largest parallax,
    /// 1/scene unit; by one pixel of the size that it was searched at, where that is smaller.
    pub disparity_per_pixel: f32,
}

impl PhotoDisparity {
    /// From the index found at each cell, rows `width` wide, a fraction between two of the grid.
    pub(crate) fn at(index: &[f32], width: usize, grid: &Grid, disparity_per_pixel: f32) -> Self {
        let disparity = index.iter().map(|&index| grid.disparity(index)).collect();
        let shape = (index.len() / width, width);
        Self { disparity: Array2::from_shape_vec(shape, disparity).expect("complete rows"), disparity_per_pixel }
    }

    /// That of a photo without neighbours: −1 everywhere, which nothing confirms.
    pub fn unknown(size: Size) -> Self {
        Self { disparity: Array2::from_elem((size.height, size.width), -1.0), disparity_per_pixel: 1.0 }
    }
}

/// Cost of an index far from the anchor.
const ANCHOR_COST: f32 = 0.05;
/// Distance from the anchor from which on that is paid, indices.
const ANCHOR_REACH: f32 = 4.0;

/// What is known of each cell of a search.
#[derive(Debug, Clone)]
pub(crate) struct Anchors {
    /// Whether the cell keeps the depth that it has.
    pub(crate) kept: Vec<bool>,
    /// Disparity that the cell is drawn to, 1/scene unit; −1 for none.
    pub(crate) disparity: Vec<f32>,
}

impl Anchors {
    /// Changes the costs `[h, w, n]` of a search over this grid.
    pub(crate) fn add_to(&self, costs: &mut [u16], grid: &Grid) {
        let count = costs.len() / self.kept.len();
        let cells = costs.par_chunks_mut(count).zip(&self.disparity).zip(&self.kept);
        cells.for_each(|((costs, &disparity), &kept)| {
            if disparity >= 0.0 {
                let anchor = grid.index(disparity);
                for (k, cost) in costs.iter_mut().enumerate() {
                    let share = ((k as f32 - anchor).abs() * (1.0 / ANCHOR_REACH)).min(1.0);
                    *cost += round_to_i32(ANCHOR_COST * COST_SCALE * share) as u16;
                }
            } else if !kept {
                costs.iter_mut().for_each(|cost| *cost /= 2);
            }
        });
    }
}

/// Share of the detail at half the size below which that size has all the detail.
const SOFT_SHARE: f64 = 0.22;
/// Shorter side of the smallest photo, pixels.
const MIN_SIDE: usize = 240;

/// Pixels per side of a photo's finest detail: a power of two.
pub(crate) fn detail_pixels(photo: &Texture) -> usize {
    if photo.width().min(photo.height()).div_ceil(2) < MIN_SIDE {
        return 1;
    }
    let half = photo.shrunk(2);
    let is_soft = mean_square_detail(photo) < SOFT_SHARE * mean_square_detail(&half);
    if is_soft { 2 * detail_pixels(&half) } else { 1 }
}

fn mean_square_detail(photo: &Texture) -> f64 {
    let photo = Planes::new(photo);
    let grey = |y: usize| -> Vec<f32> {
        let [r, g, b] = [0, 1, 2].map(|channel| photo.row(channel, y));
        (0..photo.width).map(|x| ((r[x] + g[x]) + b[x]) / 3.0).collect()
    };
    let mut rows = [grey(0), grey(1), grey(2)];
    let mut sum = 0.0;
    for y in 1..photo.height - 1 {
        let [above, here, below] = &rows;
        let detail = |x: usize| 4.0 * here[x] - ((here[x - 1] + here[x + 1]) + (above[x] + below[x]));
        sum += (1..photo.width - 1).map(|x| f64::from(detail(x)).powi(2)).sum::<f64>();
        rows.rotate_left(1);
        if y + 2 < photo.height {
            rows[2] = grey(y + 2);
        }
    }
    sum / ((photo.width - 2) * (photo.height - 2)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use liveview::image::ImageRgb;

    #[test]
    fn detail_of_an_enlarged_photo_is_as_large_as_it_was_enlarged() {
        let value = |at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0;
        let sharp = ImageRgb::new(360, 270, (0..360 * 270 * 3).map(value).collect()).unwrap();
        let detail = |factor: usize| {
            let photo = sharp.clone().resized(factor * sharp.width(), factor * sharp.height()).unwrap();
            detail_pixels(&Texture::new(&photo))
        };
        assert_eq!([1, 2, 4].map(detail), [1, 2, 4]);
    }

    #[test]
    fn detail_below_022_of_that_at_half_the_size_is_none() {
        let noise = |at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0;
        let (width, height) = (720, 540);
        let small = ImageRgb::new(360, 270, (0..360 * 270 * 3).map(noise).collect()).unwrap();
        let enlarged = small.resized(width, height).unwrap();
        // An enlarged photo, with some noise of its own size.
        let with_noise = |share: f32| {
            let data =
                enlarged.data().iter().zip(7_u32..).map(|(value, at)| value + share * noise(at.wrapping_mul(31)));
            Texture::new(&ImageRgb::new(width, height, data.collect()).unwrap())
        };
        let found = [0.0, 0.048].map(|share| {
            let photo = with_noise(share);
            (mean_square_detail(&photo) / mean_square_detail(&photo.shrunk(2)), detail_pixels(&photo))
        });
        assert!((0.12..0.21).contains(&found[0].0) && (0.23..0.32).contains(&found[1].0), "{found:?}");
        assert_eq!([found[0].1, found[1].1], [2, 1]);
    }

    #[test]
    fn segments_lie_around_what_the_neighbourhood_found() {
        const NONE: u16 = Candidates::NO_SEGMENT;
        // Two cells with these indices, of a finer grid of 101.
        for (index, expected) in [
            ([10.0, 10.0], [17, NONE]),
            ([10.0, 11.4], [18, NONE]),
            ([10.0, 11.5], [15, 23]),
            ([10.0, 14.9], [18, 26]),
            ([10.0, 15.0], [17, 26]),
            ([10.0, 15.3], [17, 27]),
            ([0.0, 0.0], [0, NONE]),
            ([0.0, 2.0], [0, 8]),
            ([0.0, 20.0], [0, 36]),
            ([50.0, 50.0], [93, NONE]),
            ([47.0, 50.0], [85, 93]),
            ([40.0, 50.0], [77, 93]),
        ] {
            for indices in [[index[0], index[1]], [index[1], index[0]]] {
                for width in [1, 2] {
                    assert_eq!(segment_starts(&indices, width, 2, 101), [expected; 2], "{indices:?}");
                }
            }
        }
        assert_eq!(segment_starts(&[10.0, 10.0, 20.0, 20.0], 4, 2, 101), [[17, NONE], [17, 36], [17, 36], [37, NONE]]);
    }

    #[test]
    fn anchors_draw_to_their_index_and_free_cells_pay_half() {
        let grid = Grid::new(1.0, f64::INFINITY, 11); // index 3 is 0.7
        let anchors = Anchors { kept: vec![false, false, true], disparity: vec![0.7, -1.0, -1.0] };
        let mut costs = vec![1001; 3 * 11];
        anchors.add_to(&mut costs, &grid);
        let drawn = [3, 2, 1, 0, 1, 2, 3, 4, 4, 4, 4].map(|apart| 1001 + (409.6 * f64::from(apart)).round() as u16);
        assert!(costs[..11].iter().zip(drawn).all(|(&found, expected)| found.abs_diff(expected) <= 1), "{costs:?}");
        assert_eq!((&costs[11..22], &costs[22..]), (&[500; 11][..], &[1001; 11][..]));
    }

    #[test]
    fn search_bytes_are_those_of_the_volume_and_of_maps() {
        let camera = |x: f64| {
            let intrinsics = liveview::geometry::Intrinsics { fx: 100.0, fy: 100.0, cx: 50.0, cy: 40.0, skew: 0.0 };
            Camera::new(intrinsics, 100, 80, glam::DMat3::IDENTITY, glam::DVec3::new(x, 0.0, 0.0)).unwrap()
        };
        let (photo, beside) = (camera(0.0), camera(0.5));
        // Disparities from 0 to 1: 50 pixels, 51 planes at cells of 2 pixels, 64 in whole segments.
        let bytes = search_bytes(&[&photo, &beside], (1.0, f64::INFINITY));
        assert_eq!(bytes, 4 * 2000 * 64 + 60 * 8000);
        // 32 planes at least: the second search, 16 at each pixel, takes as much.
        assert_eq!(search_bytes(&[&photo, &photo], (1.0, f64::INFINITY)), 4 * 8000 * 16 + 60 * 8000);
    }
}
