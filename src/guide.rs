//! Guided layers: a coarse plane sweep gives each pixel its own range of disparities.
//!
//! At 1/4 resolution: warp the views by [`CoarsePass::planes`] uniform planes, take the variance of their colours over a
//! window, keep the plane of the lowest (winner takes all), median-filter, and widen to the neighbourhood's largest and
//! smallest disparity plus one plane step. Known in stereo as adaptive thin volumes (UCS-Net, 2020).

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use crate::layers::{CELL, LayersError, uniform_disparities};
use crate::warp::{Texture, WarpSource, warp_layers};

/// Side of the window over which the variance is averaged, in cells.
const WINDOW: usize = 5;
/// Cost where fewer than two views look: above any variance of colours in [0, 1].
const UNSEEN: f32 = 1.0;

/// Settings of the coarse pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarsePass {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Planes swept between them.
    pub planes: usize,
}

/// Nearest and farthest disparity (1/scene unit) per cell of [`CELL`]×[`CELL`] target pixels, `[h, w]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeMap {
    nearest: Array2<f32>,
    farthest: Array2<f32>,
}

impl RangeMap {
    /// Nearest disparity per cell: the larger number.
    pub fn nearest(&self) -> &Array2<f32> {
        &self.nearest
    }

    /// Farthest disparity per cell: the smaller number, at least 0.
    pub fn farthest(&self) -> &Array2<f32> {
        &self.farthest
    }
}

impl CoarsePass {
    /// The range of each cell of a padded target of `height`×`width` pixels (multiples of 8).
    pub fn range(&self, sources: &[WarpSource<'_>], size: (usize, usize)) -> Result<RangeMap, LayersError> {
        let disparities = uniform_disparities(self.near, self.far, self.planes.max(2))?;
        let costs = plane_costs(sources, size, &disparities);
        let step = (disparities[0] - disparities[1]) as f32;
        Ok(range_of(&winner(&costs, &disparities), step))
    }
}

/// Windowed variance of the warped views per plane and cell, `[D, h, w]`.
pub fn plane_costs(sources: &[WarpSource<'_>], (height, width): (usize, usize), disparities: &[f64]) -> Array3<f32> {
    let (height, width) = (height / CELL, width / CELL);
    let textures: Vec<Texture> = sources.par_iter().map(|s| s.texture.shrunk(CELL)).collect();
    let shrunk: Vec<_> = textures
        .iter()
        .zip(sources)
        .map(|(texture, source)| WarpSource { texture, sweep: source.sweep.shrunk(CELL as f64) })
        .collect();
    let plane = height * width;
    let mut costs = vec![0.0; disparities.len() * plane];
    costs.par_chunks_mut(plane).zip(disparities).for_each(|(cost, &disparity)| {
        let mut colour = vec![0.0; 3 * sources.len() * plane];
        let mut coverage = vec![0.0; sources.len() * plane];
        warp_layers(&vec![disparity as f32; plane], &shrunk, (height, width), &mut colour, &mut coverage);
        let (variance, seen) = variance(&colour, &coverage, plane);
        window_mean(&variance, &seen, (height, width), cost);
    });
    Array3::from_shape_vec((disparities.len(), height, width), costs).expect("one cost per plane and cell")
}

/// Variance of the colours of the views that see a cell (0 where fewer than two do), and whether two do.
fn variance(colour: &[f32], coverage: &[f32], plane: usize) -> (Vec<f32>, Vec<f32>) {
    let cell = |at: usize| {
        let seen = || (0..coverage.len() / plane).filter(move |v| coverage[v * plane + at] > 0.5);
        let count = seen().count() as f32;
        if count < 2.0 {
            return (0.0, 0.0);
        }
        let channel = |c: usize| {
            let value = |v: usize| colour[(3 * v + c) * plane + at] / coverage[v * plane + at];
            let mean = seen().map(value).sum::<f32>() / count;
            seen().map(|v| (value(v) - mean).powi(2)).sum::<f32>()
        };
        ((channel(0) + channel(1) + channel(2)) / (3.0 * (count - 1.0)), 1.0)
    };
    (0..plane).map(cell).unzip()
}

/// Mean of `value` over the cells of a window for which `seen` is 1.
fn window_mean(value: &[f32], seen: &[f32], (height, width): (usize, usize), out: &mut [f32]) {
    let half = WINDOW / 2;
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut count) = (0.0, 0.0);
            for yy in y.saturating_sub(half)..(y + half + 1).min(height) {
                let row = yy * width + x.saturating_sub(half)..yy * width + (x + half + 1).min(width);
                sum += value[row.clone()].iter().sum::<f32>();
                count += seen[row].iter().sum::<f32>();
            }
            out[y * width + x] = if count > 0.0 { sum / count } else { UNSEEN };
        }
    }
}

/// Disparity of the plane of lowest cost per cell (ties: the nearer), `[h, w]`.
pub fn winner(costs: &Array3<f32>, disparities: &[f64]) -> Array2<f32> {
    let (planes, height, width) = costs.dim();
    Array2::from_shape_fn((height, width), |(y, x)| {
        let better = |best: usize, k: usize| if costs[(k, y, x)] < costs[(best, y, x)] { k } else { best };
        disparities[(1..planes).fold(0, better)] as f32
    })
}

/// Widen the winners: median 3×3, the neighbourhood's extremes one `step` wider, smoothed by a 3×3 mean.
pub fn range_of(winner: &Array2<f32>, step: f32) -> RangeMap {
    let winner = neighbourhood(winner, |mut n| {
        n.sort_by(f32::total_cmp);
        n[4]
    });
    let mean = |n: [f32; 9]| (n.iter().map(|&x| f64::from(x)).sum::<f64>() / 9.0) as f32;
    let nearest = neighbourhood(&winner, |n| n.into_iter().fold(f32::MIN, f32::max) + step);
    let farthest = neighbourhood(&winner, |n| (n.into_iter().fold(f32::MAX, f32::min) - step).max(0.0));
    RangeMap { nearest: neighbourhood(&nearest, mean), farthest: neighbourhood(&farthest, mean) }
}

/// A function of each cell's 3×3 neighbourhood, edges held.
fn neighbourhood(map: &Array2<f32>, f: impl Fn([f32; 9]) -> f32) -> Array2<f32> {
    let (height, width) = map.dim();
    let near = |at: usize, step: usize, side: usize| (at + step).saturating_sub(1).min(side - 1);
    Array2::from_shape_fn((height, width), |(y, x)| {
        f(std::array::from_fn(|k| map[(near(y, k / 3, height), near(x, k % 3, width))]))
    })
}
