//! The depth of a camera's photo that follows the photo from time step to time step: where the photo has
//! changed, a search from coarse to fine among its neighbours; elsewhere nothing.
//!
//! - A cell of 2×2 pixels has changed if the mean of a channel differs by more than 0.1 from when it was
//!   searched: noise averages out, and slow changes accumulate. Of a tile of 2×2 cells and those around it
//!   all are searched: some cells of what appears have the colour of what they hide. While anything changes,
//!   so is a twentieth of the rows, in turn: no error stays.
//! - At a quarter of the size: all planes, 2 px of parallax apart, a multiple of 16 of them. At half the
//!   size: planes half as far apart, in the segments around what the quarter's 3×3 cells found
//!   ([`segment_starts`]). The costs and the aggregation of [`mod@crate::photo_depth`]; paths enter from
//!   cells that are not searched at their known index. 3×3 median.
//! - At the full size: the four cells around a pixel, weighted bilinearly, of those within 1.5 planes of
//!   the pixel's own cell. Where the cells within 3×3 differ by more, there is an edge, and the pixel has
//!   that, the nearest or the farthest of these: whichever the costs in the nearest three neighbours say,
//!   aggregated ([`aggregate_own`]).
//!
//! Measured alternatives: docs/design-log/video.md.

use ndarray::Array2;

use crate::aggregate::{aggregate_in, aggregate_own};
use crate::grid::{Candidates, Grid, OWN, PerOwn, Planes, SEGMENT};
use crate::neighbourhood::median3;
use crate::parallax::widest_parallax;
use crate::photo_depth::{PhotoDisparity, segment_starts};
use crate::photo_sweep::costs_in;
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::warp::{Texture, WarpSource};

/// A cell has changed if the mean of a channel differs by more than this, of values in [0, 1].
const MIN_CHANGE: f32 = 0.1;
/// Cells per side of a tile.
const TILE: usize = 2;
/// Updates after which each row was searched.
const TURNS: usize = 20;
/// A photo of which more than this share of the tiles has changed shows something else: a cut.
const CUT_SHARE: f64 = 0.5;
/// Distance between the planes at a quarter of the size, px.
const PLANE_SPACING: f64 = 2.0;
/// Number of these planes at most.
const MAX_PLANES: usize = 128;
/// Cells of half the size differ by more than this at an edge, planes.
const EDGE: f32 = 1.5;
/// Neighbours that decide at edges.
const EDGE_NEIGHBOURS: usize = 3;

/// A photo of a time step, at all sizes.
#[derive(Debug, Clone, Copy)]
pub struct StepPhoto<'a> {
    /// Its camera.
    pub camera: &'a Camera,
    /// The photo.
    pub texture: &'a Texture,
    /// The same at half and at a quarter of its size.
    pub smaller: &'a [Texture; 2],
}

/// The depth of a camera's photo.
#[derive(Debug, Default)]
pub struct FollowedDepth {
    /// Mean colours of the cells of 2×2 pixels when they were searched.
    colours: Vec<[f32; 3]>,
    /// At a quarter of the size.
    grid: Option<Grid>,
    /// Index of each cell at half and at a quarter of the size, and of each pixel, each in the grid of its
    /// size.
    half: Vec<f32>,
    quarter: Vec<f32>,
    full: Vec<f32>,
    /// Candidates of each pixel.
    candidates: Vec<PerOwn>,
    disparity: Array2<f32>,
    disparity_per_pixel: f32,
    updates: usize,
    /// Costs and their sums: memory that is used again.
    buffers: [Vec<u16>; 2],
}

impl FollowedDepth {
    /// The depth of the photo.
    pub fn depth(&self) -> PhotoDisparity {
        PhotoDisparity { disparity: self.disparity.clone(), disparity_per_pixel: self.disparity_per_pixel }
    }

    /// Updates it for the photo of a time step and its neighbours (at least one), from near to far (scene
    /// units); returns the share of the photo that was searched, 0 to 1. One that `waits` is updated after a
    /// cut alone; one that is `coarse` is not decided at edges, but bilinear.
    pub fn update(
        &mut self,
        photo: &StepPhoto<'_>,
        neighbours: &[StepPhoto<'_>],
        (near, far): (f64, f64),
        waits: bool,
        coarse: bool,
    ) -> f64 {
        let sweeps: Vec<_> = neighbours.iter().map(|n| PlaneSweep::new(n.camera, photo.camera)).collect();
        let (size, [half, quarter]) = (photo.camera.size(), photo.smaller);
        if self.grid.is_none() {
            // Of the neighbours that the first step has: without one of them depth stays.
            let parallax = widest_parallax(&sweeps, size, near, far).max(1.0);
            let count = (parallax / PLANE_SPACING).ceil() as usize + 1;
            self.grid = Some(Grid::new(near, far, count.next_multiple_of(2 * SEGMENT).min(MAX_PLANES)));
            self.disparity_per_pixel = ((1.0 / near - 1.0 / far) / parallax) as f32;
            self.disparity = Array2::zeros((size.height, size.width));
            self.candidates = vec![[0.0; OWN]; size.pixels()];
            let cells = |texture: &Texture| vec![0.0; texture.width() * texture.height()];
            (self.full, self.half, self.quarter) = (cells(photo.texture), cells(half), cells(quarter));
        }
        let grid = self.grid.expect("set above");
        let mask = self.changed(half, waits);
        let searched = mask.iter().filter(|&&searched| searched).count();
        if searched == 0 {
            return 0.0;
        }
        let mut quarter_mask = vec![false; self.quarter.len()];
        for (row, mask) in mask.chunks_exact(half.width()).enumerate() {
            let quarter = quarter_mask[row / 2 * quarter.width()..].iter_mut();
            quarter.zip(mask.chunks(2)).for_each(|(quarter, mask)| *quarter |= mask[0] | mask[mask.len() - 1]);
        }
        let sources = |level: usize, cell: f64| -> Vec<WarpSource<'_>> {
            let all = neighbours.iter().zip(&sweeps);
            all.map(|(n, sweep)| WarpSource::new(&n.smaller[level], sweep.shrunk(cell))).collect()
        };
        let (cells, from) = (Planes::new(quarter), sources(1, 4.0));
        search(&quarter_mask, &cells, &from, &grid, Candidates::All, &mut self.buffers, &mut self.quarter);
        let grid = grid.divided(2);
        let (starts, columns) = (segment_starts(&self.quarter, quarter.width(), 2, grid.count), quarter.width());
        let candidates = Candidates::Segments { starts: &starts, columns, cells_per_side: 2 };
        search(&mask, &Planes::new(half), &sources(0, 2.0), &grid, candidates, &mut self.buffers, &mut self.half);
        let grid = grid.divided(2);
        let half_size = Size::new(half.width(), half.height());
        self.enlarge(&mask, half_size, size);
        if !coarse {
            let edges = self.edges(&mask, half_size, size);
            let nearest = neighbours.iter().zip(&sweeps).take(EDGE_NEIGHBOURS);
            let from: Vec<_> = nearest.map(|(n, &sweep)| WarpSource::new(n.texture, sweep)).collect();
            let (reference, costs) = (Planes::new(photo.texture), &mut self.buffers[0]);
            costs_in(&edges, &reference, &from, &grid, Candidates::Own(&self.candidates), costs);
            let pixels: Vec<usize> = (0..edges.len()).filter(|&at| edges[at]).collect();
            aggregate_own(&pixels, &self.candidates, costs.as_chunks().0, &reference, &mut self.full);
        }
        for (y, row) in self.disparity.outer_iter_mut().enumerate() {
            let mask = &mask[y / 2 * half.width()..];
            let pixels = row.into_iter().zip(&self.full[y * size.width..]).enumerate();
            pixels.filter(|(x, _)| mask[x / 2]).for_each(|(_, (d, &index))| *d = grid.disparity(index));
        }
        searched as f64 / mask.len() as f64
    }

    /// The cells of a photo of half the size that differ from when they were searched, in whole tiles, and those
    /// of the tiles around, and the rows whose turn it is; all if none was searched.
    fn changed(&mut self, photo: &Texture, waits: bool) -> Vec<bool> {
        let (width, height) = (photo.width(), photo.height());
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        self.colours.resize(width * height, [f32::INFINITY; 3]);
        let cells = |tile: usize| {
            let (x, y) = (tile % columns * TILE, tile / columns * TILE);
            let line = move |y| (x..(x + TILE).min(width)).map(move |x| (x, y));
            (y..(y + TILE).min(height)).flat_map(line)
        };
        let differs = |(x, y): (usize, usize)| {
            let (then, now) = (self.colours[y * width + x], photo.pixel(x, y));
            (0..3).any(|c| (then[c] - now[c]).abs() > MIN_CHANGE)
        };
        let dirty: Vec<bool> = (0..columns * rows).map(|tile| cells(tile).any(differs)).collect();
        let number = dirty.iter().filter(|&&dirty| dirty).count();
        let mut mask = vec![false; width * height];
        if number == 0 || waits && number as f64 <= CUT_SHARE * dirty.len() as f64 {
            return mask;
        }
        let turn = [self.updates % TURNS, self.updates % TURNS + 1].map(|turn| turn * rows / TURNS);
        self.updates += 1;
        let is_searched = |tile: &usize| {
            let (x, y) = (tile % columns, tile / columns);
            let row = |y: usize| &dirty[y * columns..][x.saturating_sub(1)..(x + 2).min(columns)];
            (turn[0]..turn[1]).contains(&y) || (y.saturating_sub(1)..(y + 2).min(rows)).any(|y| row(y).contains(&true))
        };
        for (x, y) in (0..columns * rows).filter(is_searched).flat_map(cells) {
            (mask[y * width + x], self.colours[y * width + x]) = (true, photo.pixel(x, y));
        }
        mask
    }

    /// Sets the index of the pixels of a mask of cells, bilinear.
    fn enlarge(&mut self, mask: &[bool], half: Size, size: Size) {
        let index = |x: usize, y: usize| self.half[y * half.width + x];
        for (x, y) in cells_of(mask, half) {
            let own = index(x, y);
            for (px, py) in pixels_of((x, y), size) {
                let beside =
                    |at: usize, pixel: usize, side: usize| (at + 2 * (pixel % 2)).saturating_sub(1).min(side - 1);
                let (bx, by) = (beside(x, px, half.width), beside(y, py, half.height));
                let (mut sum, mut total) = (0.5625 * own, 0.5625);
                for (weight, index) in [(0.1875, index(bx, y)), (0.1875, index(x, by)), (0.0625, index(bx, by))] {
                    if (index - own).abs() <= EDGE {
                        (sum, total) = (sum + weight * index, total + weight);
                    }
                }
                self.full[py * size.width + px] = 2.0 * sum / total;
            }
        }
    }

    /// Sets the candidates of the pixels at edges of a mask of cells; returns which they are.
    fn edges(&mut self, mask: &[bool], half: Size, size: Size) -> Vec<bool> {
        let mut edges = vec![false; size.pixels()];
        let around = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
        for (x, y) in cells_of(mask, half) {
            let (mut near, mut far) = (f32::MAX, f32::MIN);
            for y in around(y, half.height) {
                for &index in &self.half[y * half.width..][around(x, half.width)] {
                    (near, far) = (near.min(index), far.max(index));
                }
            }
            let is_edge = far - near > EDGE;
            for (px, py) in pixels_of((x, y), size) {
                let at = py * size.width + px;
                let smooth = self.full[at];
                edges[at] = is_edge;
                self.candidates[at] = if is_edge { [smooth, 2.0 * near, 2.0 * far] } else { [smooth; OWN] };
            }
        }
        edges
    }
}

/// The cells of a mask.
fn cells_of(mask: &[bool], Size { width, .. }: Size) -> impl Iterator<Item = (usize, usize)> {
    mask.iter().enumerate().filter(|(_, searched)| **searched).map(move |(cell, _)| (cell % width, cell / width))
}

/// The pixels of a cell of half the size.
fn pixels_of((x, y): (usize, usize), size: Size) -> impl Iterator<Item = (usize, usize)> {
    let all = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, below)| (2 * x + right, 2 * y + below));
    all.into_iter().filter(move |&(x, y)| x < size.width && y < size.height)
}

/// Searches the cells of a mask; `index` is that of all cells.
fn search(
    mask: &[bool],
    photo: &Planes,
    sources: &[WarpSource<'_>],
    grid: &Grid,
    candidates: Candidates<'_>,
    [costs, sums]: &mut [Vec<u16>; 2],
    index: &mut [f32],
) {
    costs_in(mask, photo, sources, grid, candidates, costs);
    let found = aggregate_in(Some((mask, index)), costs, photo, grid, candidates, sums);
    let all = found.iter().zip(&*index).zip(mask);
    let all: Vec<f32> = all.map(|((&found, &known), &searched)| if searched { found } else { known }).collect();
    let smooth = median3(&all, photo.width);
    let cells = index.iter_mut().zip(smooth).zip(mask);
    cells.filter(|(_, searched)| **searched).for_each(|((index, smooth), _)| *index = smooth);
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use liveview::geometry::Intrinsics;
    use liveview::image::ImageRgb;

    use super::*;

    const SIZE: Size = Size::new(128, 64);
    /// Parallax between neighbouring cameras, pixels: that of disparity 1.
    const FOCAL: f64 = 64.0;
    /// Parallax of the wall, and of the board in front of it.
    const PARALLAX: [usize; 2] = [4, 12];

    fn is_board(x: i64, y: usize) -> bool {
        (50..86).contains(&x) && (16..48).contains(&y)
    }

    /// The cameras' photos: a wall, and before it a board.
    fn photos(board: bool) -> Vec<(Camera, Texture)> {
        let photo = |camera: i64| {
            let pixel = |at: usize| {
                let y = at / SIZE.width;
                let [wall, front] = PARALLAX.map(|parallax| (at % SIZE.width) as i64 + camera * parallax as i64);
                let (x, phase) = if board && is_board(front, y) { (front, 2.0) } else { (wall, 0.0) };
                let wave = |f: f64, g: f64| (f * x as f64 + g * y as f64 + phase).sin();
                let value = |c: f64| (0.5 + 0.25 * wave(0.9 + c, 0.4) + 0.2 * wave(0.37, c - 0.8)) as f32;
                [value(0.0), value(0.3), value(0.7)]
            };
            let picture = ImageRgb::new(SIZE.width, SIZE.height, (0..SIZE.pixels()).flat_map(pixel).collect());
            let k = Intrinsics { fx: FOCAL, fy: FOCAL, cx: 64.0, cy: 32.0, skew: 0.0 };
            let at = DVec3::new(-camera as f64, 0.0, 0.0);
            let camera = Camera::new(k, SIZE.width, SIZE.height, DMat3::IDENTITY, at).unwrap();
            (camera, Texture::new(&picture.unwrap()))
        };
        [0, 1, -1, 2].map(photo).into()
    }

    fn update(depth: &mut FollowedDepth, board: bool) -> f64 {
        update_or_wait(depth, board, false)
    }

    fn update_or_wait(depth: &mut FollowedDepth, board: bool, waits: bool) -> f64 {
        update_with(depth, board, waits, false)
    }

    fn update_with(depth: &mut FollowedDepth, board: bool, waits: bool, coarse: bool) -> f64 {
        let photos = photos(board);
        let smaller: Vec<[Texture; 2]> =
            photos.iter().map(|(_, photo)| [photo.shrunk(2), photo.shrunk(2).shrunk(2)]).collect();
        let all = photos.iter().zip(&smaller);
        let all: Vec<_> = all.map(|((camera, texture), smaller)| StepPhoto { camera, texture, smaller }).collect();
        depth.update(&all[0], &all[1..], (FOCAL / 20.0, FOCAL), waits, coarse)
    }

    /// Share of the pixels, but those near the photo's sides, whose depth is right to half a pixel.
    fn right(depth: &FollowedDepth, board: bool) -> f64 {
        let inner = depth.disparity.indexed_iter().filter(|((_, x), _)| (24..SIZE.width - 24).contains(x));
        let is_right = |((y, x), disparity): &((usize, usize), &f32)| {
            let parallax = PARALLAX[usize::from(board && is_board(*x as i64, *y))];
            (f64::from(**disparity) * FOCAL - parallax as f64).abs() < 0.5
        };
        let all = inner.clone().count() as f64;
        inner.filter(is_right).count() as f64 / all
    }

    #[test]
    fn depth_is_searched_where_the_photo_changes() {
        let mut depth = FollowedDepth::default();
        assert_eq!(update(&mut depth, false), 1.0);
        assert!(right(&depth, false) > 0.98, "{}", right(&depth, false));
        let before = depth.disparity.clone();
        assert_eq!(update(&mut depth, false), 0.0);
        assert!(right(&depth, true) < 0.8, "the board is not there yet");
        // No row has its turn.
        depth.updates = 0;
        let share = update(&mut depth, true);
        assert!(share > 0.1 && share < 0.25, "{share}");
        assert!(right(&depth, true) > 0.96, "{}", right(&depth, true));
        let same = before.indexed_iter().filter(|((y, x), d)| depth.disparity[(*y, *x)] == **d).count();
        assert!(same as f64 > 0.75 * before.len() as f64, "depth of the wall stays: {same}");
    }

    #[test]
    fn depth_that_waits_is_updated_after_a_cut_alone() {
        let mut depth = FollowedDepth::default();
        assert_eq!(update_or_wait(&mut depth, false, true), 1.0, "the first photo");
        assert_eq!(update_or_wait(&mut depth, true, true), 0.0);
        assert!(update_or_wait(&mut depth, true, false) > 0.1, "the change is not forgotten");
        depth.colours.iter_mut().for_each(|colour| *colour = colour.map(|value| 1.0 - value));
        assert!(update_or_wait(&mut depth, true, true) > CUT_SHARE);
    }

    #[test]
    fn coarse_depth_is_less_right_at_edges_alone() {
        let [mut fine, mut coarse] = [(), ()].map(|()| FollowedDepth::default());
        update(&mut fine, true);
        update_with(&mut coarse, true, false, true);
        let [of_fine, of_coarse] = [&fine, &coarse].map(|depth| right(depth, true));
        assert!(of_coarse > 0.9 && of_coarse < of_fine, "{of_coarse} {of_fine}");
        let differs = fine.disparity.iter().zip(&coarse.disparity).filter(|(fine, coarse)| fine != coarse).count();
        assert!(differs < SIZE.pixels() / 5, "{differs}");
    }

    #[test]
    fn an_error_is_gone_once_each_row_had_its_turn() {
        let mut depth = FollowedDepth::default();
        update(&mut depth, false);
        depth.disparity.fill(0.0);
        assert!(right(&depth, false) < 0.1);
        for step in 0..TURNS {
            // Something changes in each step: without, nothing is searched.
            depth.colours[step] = [f32::INFINITY; 3];
            update(&mut depth, false);
        }
        assert!(right(&depth, false) > 0.98, "{}", right(&depth, false));
    }
}
