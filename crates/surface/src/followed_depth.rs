//! The depth of a camera's photo that follows the photo from time step to time step: where the photo has
//! changed, a search from coarse to fine among its neighbours; elsewhere nothing.
//!
//! - A cell of 2×2 pixels has changed if the mean of a channel differs by more than 0.03 from when it was
//!   searched: noise averages out, and slow changes accumulate. Of a tile of 2×2 cells all are searched.
//! - At a quarter of the size: all planes, 2 px of parallax apart, a multiple of 16 of them. At half the
//!   size: planes half as far apart, in the segments around what the quarter's 3×3 cells found
//!   ([`segment_starts`]). The costs and the aggregation of [`mod@crate::photo_depth`]; paths enter from
//!   cells that are not searched at their known index. 3×3 median.
//! - At the full size: the four cells around a pixel, weighted bilinearly, of those within 1.5 planes of
//!   the pixel's own cell. Where the cells within 3×3 differ by more, there is an edge, and the pixel has
//!   that, the nearest or the farthest of these: whichever the costs in the nearest three neighbours say,
//!   aggregated ([`aggregate_labels`]).
//!
//! Measured alternatives: docs/design-log/video.md.

use ndarray::Array2;

use crate::aggregate::{LABELS, PerLabel, aggregate_in, aggregate_labels};
use crate::grid::{Candidates, Grid, Planes, SEGMENT};
use crate::neighbourhood::median3;
use crate::parallax::widest_parallax;
use crate::photo_depth::{PhotoDisparity, segment_starts};
use crate::photo_sweep::{costs_in, label_costs};
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::warp::{Texture, WarpSource};

/// A cell has changed if the mean of a channel differs by more than this, of values in [0, 1].
const MIN_CHANGE: f32 = 0.03;
/// Cells per side of a tile.
const TILE: usize = 2;
/// Distance between the planes at a quarter of the size, px.
const PLANE_SPACING: f64 = 2.0;
/// Number of these planes at most.
const MAX_PLANES: usize = 128;
/// Cells of half the size differ by more than this at an edge, planes.
const EDGE: f32 = 1.5;
/// Neighbours that decide at edges.
const EDGE_NEIGHBOURS: usize = 3;

/// A photo of a time step at half and at a quarter of its size.
#[derive(Debug)]
pub struct SmallerPhotos([Texture; 2]);

impl SmallerPhotos {
    /// Of this photo.
    pub fn new(photo: &Texture) -> Self {
        let half = photo.shrunk(2);
        let quarter = half.shrunk(2);
        Self([half, quarter])
    }
}

/// A photo of a time step, at all sizes.
#[derive(Debug, Clone, Copy)]
pub struct StepPhoto<'a> {
    /// Its camera.
    pub camera: &'a Camera,
    /// The photo.
    pub texture: &'a Texture,
    /// The same, smaller.
    pub smaller: &'a SmallerPhotos,
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
    labels: Vec<PerLabel>,
    disparity: Array2<f32>,
    disparity_per_pixel: f32,
    buffers: Buffers,
}

/// Memory that is used again.
#[derive(Debug, Default)]
struct Buffers {
    costs: Vec<u16>,
    sums: Vec<u16>,
    label_costs: Vec<[u16; LABELS]>,
}

impl FollowedDepth {
    /// The depth of the photo.
    pub fn depth(&self) -> PhotoDisparity {
        PhotoDisparity { disparity: self.disparity.clone(), disparity_per_pixel: self.disparity_per_pixel }
    }

    /// Updates it for the photo of a time step and its neighbours (at least one), from near to far (scene
    /// units); returns the share of the photo that was searched, 0 to 1.
    pub fn update(&mut self, photo: &StepPhoto<'_>, neighbours: &[StepPhoto<'_>], (near, far): (f64, f64)) -> f64 {
        let sweeps: Vec<_> = neighbours.iter().map(|n| PlaneSweep::new(n.camera, photo.camera)).collect();
        let (size, [half, quarter]) = (photo.camera.size(), &photo.smaller.0);
        let parallax = widest_parallax(&sweeps, size, near, far).max(1.0);
        let count = (parallax / PLANE_SPACING).ceil() as usize + 1;
        let grid = Grid::new(near, far, count.next_multiple_of(2 * SEGMENT).min(MAX_PLANES));
        if self.grid != Some(grid) {
            let cells = |texture: &Texture| vec![0.0; texture.width() * texture.height()];
            *self = Self {
                grid: Some(grid),
                half: cells(half),
                quarter: cells(quarter),
                full: cells(photo.texture),
                labels: vec![[0.0; LABELS]; size.pixels()],
                disparity: Array2::zeros((size.height, size.width)),
                disparity_per_pixel: ((1.0 / near - 1.0 / far) / parallax) as f32,
                buffers: std::mem::take(&mut self.buffers),
                ..Self::default()
            };
        }
        let mask = self.changed(half);
        let searched = mask.iter().filter(|&&searched| searched).count();
        if searched == 0 {
            return 0.0;
        }
        let mut quarter_mask = vec![false; self.quarter.len()];
        for (row, mask) in mask.chunks_exact(half.width()).enumerate() {
            let quarter = quarter_mask[row / 2 * quarter.width()..].iter_mut();
            quarter.zip(mask.chunks(2)).for_each(|(quarter, mask)| *quarter |= mask[0] | mask[mask.len() - 1]);
        }
        let sources = |texture: fn(&SmallerPhotos) -> &Texture, cell: f64| -> Vec<WarpSource<'_>> {
            let all = neighbours.iter().zip(&sweeps);
            all.map(|(n, sweep)| WarpSource::new(texture(n.smaller), sweep.shrunk(cell))).collect()
        };
        let buffers = &mut self.buffers;
        let reference = Planes::new(quarter);
        let from = sources(|smaller| &smaller.0[1], 4.0);
        search(&quarter_mask, &reference, &from, &grid, Candidates::All, buffers, &mut self.quarter);
        let grid = grid.divided(2);
        let (starts, columns) = (segment_starts(&self.quarter, quarter.width(), 2, grid.count), quarter.width());
        let candidates = Candidates::Segments { starts: &starts, columns, cells_per_side: 2 };
        let from = sources(|smaller| &smaller.0[0], 2.0);
        search(&mask, &Planes::new(half), &from, &grid, candidates, buffers, &mut self.half);
        let grid = grid.divided(2);
        let edges = self.enlarge(&mask, Size::new(half.width(), half.height()), size);
        let nearest = neighbours.iter().zip(&sweeps).take(EDGE_NEIGHBOURS);
        let from: Vec<_> = nearest.map(|(n, &sweep)| WarpSource::new(n.texture, sweep)).collect();
        self.decide(&edges, &Planes::new(photo.texture), &from, &grid);
        for (y, row) in self.disparity.outer_iter_mut().enumerate() {
            let mask = &mask[y / 2 * half.width()..];
            let pixels = row.into_iter().zip(&self.full[y * size.width..]).enumerate();
            pixels.filter(|(x, _)| mask[x / 2]).for_each(|(_, (d, &index))| *d = grid.disparity(index));
        }
        searched as f64 / mask.len() as f64
    }

    /// The cells of a photo of half the size that differ from when they were searched, in whole tiles; all
    /// if none was searched.
    fn changed(&mut self, photo: &Texture) -> Vec<bool> {
        let (width, height) = (photo.width(), photo.height());
        let is_first = self.colours.is_empty();
        self.colours.resize(width * height, [f32::INFINITY; 3]);
        let mut mask = vec![is_first; width * height];
        for y in (0..height).step_by(TILE) {
            for x in (0..width).step_by(TILE) {
                let columns = x..(x + TILE).min(width);
                let cells = (y..(y + TILE).min(height)).flat_map(|y| columns.clone().map(move |x| (x, y)));
                let differs = |(x, y): (usize, usize)| {
                    let (then, now) = (self.colours[y * width + x], photo.pixel(x, y));
                    (0..3).any(|c| (then[c] - now[c]).abs() > MIN_CHANGE)
                };
                if cells.clone().any(differs) {
                    for (x, y) in cells {
                        (mask[y * width + x], self.colours[y * width + x]) = (true, photo.pixel(x, y));
                    }
                }
            }
        }
        mask
    }

    /// Sets index and candidates of the pixels of a mask of cells; returns which pixels are at an edge.
    fn enlarge(&mut self, mask: &[bool], half: Size, size: Size) -> Vec<bool> {
        let mut edges = vec![false; size.pixels()];
        let index = |x: usize, y: usize| self.half[y * half.width + x];
        let around = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
        for (cell, _) in mask.iter().enumerate().filter(|(_, searched)| **searched) {
            let (x, y) = (cell % half.width, cell / half.width);
            let own = index(x, y);
            let (mut near, mut far) = (own, own);
            for y in around(y, half.height) {
                for &index in &self.half[y * half.width..][around(x, half.width)] {
                    (near, far) = (near.min(index), far.max(index));
                }
            }
            let is_edge = far - near > EDGE;
            for (px, py) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, below)| (2 * x + right, 2 * y + below)) {
                if px >= size.width || py >= size.height {
                    continue;
                }
                let beside =
                    |at: usize, pixel: usize, side: usize| (at + 2 * (pixel % 2)).saturating_sub(1).min(side - 1);
                let (bx, by) = (beside(x, px, half.width), beside(y, py, half.height));
                let (mut sum, mut total) = (0.5625 * own, 0.5625);
                for (weight, index) in [(0.1875, index(bx, y)), (0.1875, index(x, by)), (0.0625, index(bx, by))] {
                    if (index - own).abs() <= EDGE {
                        (sum, total) = (sum + weight * index, total + weight);
                    }
                }
                let (at, smooth) = (py * size.width + px, 2.0 * sum / total);
                (self.full[at], edges[at]) = (smooth, is_edge);
                self.labels[at] = if is_edge { [smooth, 2.0 * near, 2.0 * far] } else { [smooth; LABELS] };
            }
        }
        edges
    }

    /// Decides which of its candidates each pixel at an edge has.
    fn decide(&mut self, edges: &[bool], photo: &Planes, sources: &[WarpSource<'_>], grid: &Grid) {
        let pixels: Vec<usize> = (0..edges.len()).filter(|&at| edges[at]).collect();
        label_costs(edges, &self.labels, photo, sources, grid, &mut self.buffers.label_costs);
        let costs: Vec<_> = pixels.iter().map(|&at| self.buffers.label_costs[at]).collect();
        let labels: Vec<_> = pixels.iter().map(|&at| self.labels[at]).collect();
        aggregate_labels(&pixels, &labels, &costs, photo, &mut self.full);
    }
}

/// Searches the cells of a mask; `index` is that of all cells.
fn search(
    mask: &[bool],
    photo: &Planes,
    sources: &[WarpSource<'_>],
    grid: &Grid,
    candidates: Candidates<'_>,
    buffers: &mut Buffers,
    index: &mut [f32],
) {
    costs_in(mask, photo, sources, grid, candidates, &mut buffers.costs);
    let found = aggregate_in(Some((mask, index)), &buffers.costs, photo, grid, candidates, &mut buffers.sums);
    let all = found.iter().zip(&*index).zip(mask);
    let all: Vec<f32> = all.map(|((&found, &known), &searched)| if searched { found } else { known }).collect();
    let smooth = median3(&all, photo.width);
    let cells = index.iter_mut().zip(smooth).zip(mask);
    cells.filter(|(_, searched)| **searched).for_each(|((index, smooth), _)| *index = smooth);
}
