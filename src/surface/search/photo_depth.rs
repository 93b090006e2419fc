//! The depth of one photo: a plane sweep with the photo as reference at half resolution, then a narrow band around what it
//! finds at full resolution.
//!
//! 1. Cells of 2×2 pixels (area averages), n = ⌈parallax / spacing⌉ + 1 planes, 32 to 256, from near to far; the parallax is that of
//!    near and far in the neighbour that sees most of it. Costs ([`super::photo_sweep`]), aggregated ([`super::aggregate`]), 3×3
//!    median of the indices (between two planes).
//! 2. Pixels, planes half as far apart. Each cell has one or two segments of 8 of them, around the nearest and the farthest index n and
//!    f of its 3×3 neighbourhood, in steps of the finer grid, m = round((n + f)/2): where f − n < 3 one, from m − 3 on; where
//!    f − n < 10 two that join, from m − 7 on; else one from round(n) − 3 and one from round(f) − 4 on, not before the end of the
//!    first. All are moved to lie on the grid. The same costs, aggregation and median.

use ndarray::Array2;
use rayon::prelude::*;

use super::aggregate::aggregate;
use super::grid::{Candidates, Grid, SEGMENT};
use super::penalties::Penalties;
use super::photo_sweep::costs;
use super::planes::Planes;
use crate::geometry::parallax::widest_parallax;
use crate::geometry::{PlaneSweep, Size};
use crate::surface::neighbourhood::median3;
use crate::surface::settings::Settings;
use crate::warp::{SourceView, Texture, WarpSource};

/// What a photo's search found, before other photos were asked.
#[derive(Debug, Clone)]
pub struct PhotoDepth {
    /// Disparity of each pixel, `[h, w]`, 1/scene unit.
    pub disparity: Array2<f32>,
    /// Disparity that is worth one pixel of parallax in the neighbour that sees most of it, 1/scene unit.
    pub pixel: f32,
}

impl PhotoDepth {
    /// That of a photo without neighbours: nothing will confirm any of it.
    pub(crate) fn unknown(size: Size) -> Self {
        Self { disparity: Array2::from_elem((size.height, size.width), -1.0), pixel: 1.0 }
    }
}

/// Number of planes of the first search.
const PLANES: std::ops::RangeInclusive<usize> = 32..=256;

/// Searches the depth of `photo` among its `neighbours` (one at least), from `near` to `far`.
pub fn photo_depth(
    photo: &SourceView<'_>,
    neighbours: &[SourceView<'_>],
    near: f64,
    far: f64,
    settings: &Settings,
) -> PhotoDepth {
    let sweeps: Vec<PlaneSweep> = neighbours.iter().map(|n| PlaneSweep::new(n.camera, photo.camera)).collect();
    let size = photo.camera.size();
    let widest = widest_parallax(&sweeps, size, near, far).max(1.0);
    let pixel = ((1.0 / near - 1.0 / far) / widest) as f32;
    let count = ((widest / settings.spacing).ceil() as usize + 1).clamp(*PLANES.start(), *PLANES.end());
    let grid = Grid::new(near, far, count);
    let penalties = Penalties { step: settings.step, jump: settings.jump, edge: settings.edge };

    let halves: Vec<Texture> = neighbours.iter().map(|n| n.texture.shrunk(2)).collect();
    let half = Planes::new(&photo.texture.shrunk(2));
    let sources: Vec<_> =
        halves.iter().zip(&sweeps).map(|(texture, sweep)| WarpSource::new(texture, sweep.shrunk(2.0))).collect();
    let volume = costs(&half, &sources, &grid, Candidates::All);
    let found = aggregate(&volume, &half, &grid, Candidates::All, &penalties);
    drop(volume);
    let index = median3(&found, half.width);

    let fine = grid.divided(settings.parts);
    let starts = bands(&index, half.width, settings.parts, fine.count());
    let candidates = Candidates::Two { starts: &starts, columns: half.width, share: 2 };
    let whole = Planes::new(photo.texture);
    let sources: Vec<_> = neighbours.iter().zip(&sweeps).map(|(n, &sweep)| WarpSource::new(n.texture, sweep)).collect();
    let volume = costs(&whole, &sources, &fine, candidates);
    let found = aggregate(&volume, &whole, &fine, candidates, &penalties);
    let index = median3(&found, whole.width);
    let disparity = index.iter().map(|&index| fine.disparity(index)).collect();
    PhotoDepth {
        disparity: Array2::from_shape_vec((size.height, size.width), disparity).expect("one per pixel"),
        pixel,
    }
}

/// The two segments of each cell; `parts` indices of the finer grid, of `count`, for one of the coarser.
pub(crate) fn bands(index: &[f32], width: usize, parts: usize, count: usize) -> Vec<[u16; 2]> {
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
            let (near, far) = (near * parts as f32, far * parts as f32);
            let last = (count.max(2 * SEGMENT) - 2 * SEGMENT) as f32;
            let middle = (0.5 * (near + far)).round();
            *starts = if far - near < 3.0 {
                [(middle - 3.0).clamp(0.0, last + segment) as u16, Candidates::NONE]
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
