//! Guided layers: a coarse search gives each pixel its own range of disparities.
//!
//! At 1/4 resolution: sweep the views through planes a cell of parallax apart, take the variance of their colours over a
//! window ([`crate::cost`]), make it agree along rows and columns ([`crate::semiglobal`]), keep the cheapest plane, refined
//! between planes by a parabola. The neighbourhood's largest and smallest disparity, half a plane step wider, are what is
//! searched at 1/2 resolution: the same over a few layers that divide that range, each cell for itself. The extremes of
//! what this finds are the range. Known in stereo as adaptive thin volumes (UCS-Net, 2020).
//!
//! Against the plain search it grew from (32 planes, winner takes all, one plane step wider, 1/4 resolution alone), with
//! one and the same network on four layers, PSNR in dB: grid of cameras 3×3 19.99 → 23.3, EPFL fountain 23.3 → 26.2,
//! coffee rig 28.1 → 31.0, LLFF flower 26.8 → 27.2, RealEstate10K 32.4 → 33.1. A first search at 1/2 resolution lost 0.4
//! to 0.7 dB on photos (their poses are not that exact) and won 0.6 on the path-traced scene. Planes a cell of parallax
//! apart are the best or within 0.1 dB of it on every scene, where 32 lose 0.2 to 0.9 dB and 64 up to 0.7 on one or another.
//! A final range half a layer's distance wider lost 0.1 to 0.4 dB on two layers (mean of five scenes 0.19), twice as wide 0.9.
//! A first search at 1/8 resolution lost 0.04 to 0.95 dB on every photo tried. The network's α as its cost, at half a full
//! layer's time for 8 planes, lost 0.0 to 0.4 dB on four photos of five.
//!
//! For occlusion, on the grid of cameras and the path-traced scene (V = 4, two layers), dB gained: searching over eight views
//! -0.9 to -0.3, leaving out of the search the views behind the surface found first -1.8 to -0.3, or the worst quarter of the
//! views -0.2 to +0.1, windows that keep to edges (guided filter, bilateral) -0.1 to 0.0. The true depth in place of the second
//! search's gains 0.0 and 0.7 dB on the two targets of the latter: the network's judgement is what limits (models/README.md).

use std::cell::OnceCell;

use glam::DVec3;
use ndarray::{Array2, Array3, ArrayView3, Axis};
use rayon::prelude::*;

use crate::cost::Shrunk;
use crate::layers::{CELL, LayersError, enlarge, uniform_disparities};
use crate::semiglobal::semi_global;
use crate::sweep::Sweep;
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
pub struct CoarsePass {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units; may be infinite.
    pub far: f64,
    /// Planes of the first search; `None`: a cell of parallax apart, 8 to 128.
    pub planes: Option<usize>,
}

/// Nearest and farthest disparity (1/scene unit) per cell of the target, and the surface between them, `[h, w]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeMap {
    nearest: Array2<f32>,
    surface: Array2<f32>,
    farthest: Array2<f32>,
}

impl RangeMap {
    /// Nearest disparity per cell: the larger number.
    pub fn nearest(&self) -> &Array2<f32> {
        &self.nearest
    }

    /// Disparity found per cell, median-filtered.
    pub fn surface(&self) -> &Array2<f32> {
        &self.surface
    }

    /// Farthest disparity per cell: the smaller number, at least 0.
    pub fn farthest(&self) -> &Array2<f32> {
        &self.farthest
    }

    /// `count` maps that divide each cell's range evenly, near → far; one alone follows the surface, which beats the middle
    /// of the range by 0.1 to 0.3 dB (the same with three layers or more: 0.03).
    pub(crate) fn divided(&self, count: usize) -> impl Iterator<Item = Array2<f32>> {
        (0..count).map(move |k| {
            if count == 1 {
                return self.surface.clone();
            }
            let step = k as f64 / (count - 1) as f64;
            let between = |&n: &f32, &f: &f32| (f64::from(n) + step * (f64::from(f) - f64::from(n))) as f32;
            ndarray::Zip::from(&self.nearest).and(&self.farthest).map_collect(between)
        })
    }
}

/// What the coarse pass found, step by step.
#[derive(Debug, Clone)]
pub struct Search {
    /// Planes of the first search, near → far, `D`.
    pub disparities: Vec<f64>,
    /// Their costs per cell of [`COARSE`] pixels, `[D, h, w]`.
    pub costs: Array3<f32>,
    /// The costs after [`semi_global`].
    pub agreed: Array3<f32>,
    /// The disparity they point at, `[h, w]`.
    pub coarse: Array2<f32>,
    /// Layers of the second search, `[D, h, w]` in cells of [`CELL`] pixels.
    pub fine_layers: Array3<f32>,
    /// Their costs.
    pub fine_costs: Array3<f32>,
    /// The disparity those point at, `[h, w]`.
    pub fine: Array2<f32>,
    /// The range of each cell of [`CELL`]×[`CELL`] pixels.
    pub range: RangeMap,
}

impl CoarsePass {
    /// Searches a padded target of `height`×`width` pixels (multiples of 8).
    ///
    /// # Errors
    /// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for no planes.
    pub fn search(&self, sources: &[WarpSource<'_>], (height, width): (usize, usize)) -> Result<Search, LayersError> {
        let levels = Levels::new(sources.iter().map(|source| source.texture).collect());
        let sweeps: Vec<Sweep> = sources.iter().map(|source| source.sweep).collect();
        self.search_levels(&levels, &sweeps, (height, width))
    }

    /// As [`Self::search`], of a target or of a window of one.
    pub(crate) fn search_levels(
        &self,
        levels: &Levels<'_>,
        sweeps: &[Sweep],
        (height, width): (usize, usize),
    ) -> Result<Search, LayersError> {
        let wanted = || (parallax(sweeps, (height, width), self.near, self.far) / COARSE as f64).ceil() as usize;
        let count = self.planes.unwrap_or_else(|| wanted().clamp(*PLANES.start(), *PLANES.end()));
        let disparities = uniform_disparities(self.near, self.far, count)?;
        let shape = (count, height / COARSE, width / COARSE);
        let maps = Array3::from_shape_fn(shape, |(plane, _, _)| disparities[plane] as f32);
        let costs = levels.coarse().costs(sweeps, maps.view(), WINDOWS[0]);
        let agreed = semi_global(costs.view());
        let coarse = winner(agreed.view(), maps.view());
        let step = disparities.get(1).map_or(0.0, |second| disparities[0] - second);
        let range = range_of(&coarse, (step / 2.0) as f32);
        let fine_layers = fine_layers(&range);
        let fine_costs = levels.fine().costs(sweeps, fine_layers.view(), WINDOWS[1]);
        let fine = winner(fine_costs.view(), fine_layers.view());
        let range = range_of(&fine, 0.0);
        Ok(Search { disparities, costs, agreed, coarse, fine_layers, fine_costs, fine, range })
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
fn parallax(sweeps: &[Sweep], (height, width): (usize, usize), near: f64, far: f64) -> f64 {
    let points = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)];
    let of_view = |sweep: &Sweep| {
        let seen = |disparity: f64, (x, y): (f64, f64)| {
            let uvw = sweep.source_from_target(disparity) * DVec3::new(x * width as f64, y * height as f64, 1.0);
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
pub fn winner(costs: ArrayView3<'_, f32>, maps: ArrayView3<'_, f32>) -> Array2<f32> {
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

/// The range around the disparities found: of the median-filtered neighbourhood the extremes, a `margin` wider, smoothed by
/// a 3×3 mean.
pub fn range_of(disparity: &Array2<f32>, margin: f32) -> RangeMap {
    let disparity = neighbourhood(disparity, |mut n| {
        n.sort_unstable_by(f32::total_cmp);
        n[4]
    });
    let mean = |n: [f32; 9]| (n.iter().map(|&x| f64::from(x)).sum::<f64>() / 9.0) as f32;
    let nearest = neighbourhood(&disparity, |n| n.into_iter().fold(f32::MIN, f32::max)) + margin;
    let farthest =
        (neighbourhood(&disparity, |n| n.into_iter().fold(f32::MAX, f32::min)) - margin).mapv(|d| d.max(0.0));
    RangeMap { nearest: neighbourhood(&nearest, mean), surface: disparity, farthest: neighbourhood(&farthest, mean) }
}

/// A function of each cell's 3×3 neighbourhood, edges held; rows in parallel.
pub(crate) fn neighbourhood(map: &Array2<f32>, f: impl Fn([f32; 9]) -> f32 + Sync) -> Array2<f32> {
    let (height, width) = map.dim();
    let cells = map.as_slice().expect("standard order");
    let mut out = Array2::zeros((height, width));
    let rows = out.as_slice_mut().expect("standard order").par_chunks_mut(width).enumerate();
    rows.for_each(|(y, out)| {
        let row = |y: usize| &cells[y * width..(y + 1) * width];
        let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))];
        for (x, out) in out.iter_mut().enumerate() {
            let columns = [x.saturating_sub(1), x, (x + 1).min(width - 1)];
            *out = f(std::array::from_fn(|k| rows[k / 3][columns[k % 3]]));
        }
    });
    out
}
