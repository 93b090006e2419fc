//! Who sees what: a view sees a point unless a confirmed depth of its own, there, is nearer by more than some pixels of parallax.
//!
//! The view's own depth is taken at the pixel that the point falls on; where that is not confirmed, or outside, nothing hides the
//! point. What a view does not see has neither colour nor coverage. Where the coverage that is left, summed over the views, is
//! 0.05 or less, all views serve as if none were hidden, and the pixel counts as unseen. (Further photos in their place: no gain,
//! docs/experiments.md.)

use rayon::prelude::*;

use super::project::Projected;
use super::{Camera, KnownDepth, PlaneSweep, RUN, RunCoverage, SharpenedPhotos, Size, WarpSource, whole};

/// Coverage, summed over the views, from which on a pixel is seen.
const SEEN: f32 = 0.05;

/// What hides layers of a target from its views, and how their photos' exposure and sharpness are balanced.
#[derive(Debug, Clone)]
pub struct Visibility<'a> {
    /// In the order of the views.
    pub views: Vec<VisibleView<'a>>,
    /// How much nearer than a point the view's own depth must be to hide it, 1/scene unit.
    pub margin: f32,
}

/// What is known of a view.
#[derive(Debug, Clone, Copy)]
pub struct VisibleView<'a> {
    /// Its camera.
    pub camera: &'a Camera,
    /// Its photo's confirmed depth.
    pub known: &'a KnownDepth,
    /// What its colours are multiplied by, per channel.
    pub gains: [f32; 3],
    /// How much its photo is sharpened ([`super::sharpening`]).
    pub sharpening: f32,
}

/// Layers that the views were warped by.
#[derive(Debug)]
pub(crate) struct WarpedLayers<'a> {
    /// `[n, h, w]`, 1/scene unit.
    pub(crate) disparity: &'a [f32],
    /// `[n, 3V, h, w]`.
    pub(crate) colour: &'a mut [f32],
    /// `[n, V, h, w]`.
    pub(crate) coverage: &'a mut [f32],
    /// What is known of the coverage, by layer, view and row.
    pub(crate) run_coverage: &'a mut [RunCoverage],
}

/// A row of a view: colour by channel, coverage, what is known of it.
struct Row<'a> {
    colour: [&'a mut [f32]; 3],
    coverage: &'a mut [f32],
    seen: &'a mut [RunCoverage],
}

impl Visibility<'_> {
    /// Gives the views their balanced colours, and the sharpened photos of those that are to be sharpened.
    pub(crate) fn balance<'a>(&self, sources: &mut [WarpSource<'a>], sharpened: &'a mut SharpenedPhotos) {
        let photos = sources.iter().zip(&self.views).map(|(source, view)| (source.texture, view.sharpening));
        sharpened.sharpen(photos.filter(|(_, amount)| *amount != 0.0));
        for (source, view) in sources.iter_mut().zip(&self.views) {
            source.gains = view.gains;
            if view.sharpening != 0.0 {
                source.texture = sharpened.get(source.texture, view.sharpening);
            }
        }
    }

    /// Multiply colour and coverage of layers of `target`, padded to `size`, by 1 or 0. `seen_any` becomes true where a view sees one
    /// of them.
    pub(crate) fn hide(&self, target: &Camera, size: Size, layers: WarpedLayers<'_>, seen_any: &mut [bool]) {
        let (width, plane) = (size.width, size.pixels());
        let sweeps: Vec<_> = self.views.iter().map(|view| PlaneSweep::new(view.camera, target)).collect();
        let runs = width.div_ceil(RUN);
        // Rows of all layers and views side by side, so that a thread decides over all of them at once.
        let mut rows: Vec<Vec<Row<'_>>> = (0..size.height).map(|_| Vec::new()).collect();
        let views = layers.colour.chunks_mut(3 * plane).zip(layers.coverage.chunks_mut(plane));
        for ((colour, coverage), seen) in views.zip(layers.run_coverage.chunks_mut(size.height * runs)) {
            let (red, rest) = colour.split_at_mut(plane);
            let (green, blue) = rest.split_at_mut(plane);
            let lines = red.chunks_mut(width).zip(green.chunks_mut(width)).zip(blue.chunks_mut(width));
            let lines = lines.zip(coverage.chunks_mut(width)).zip(seen.chunks_mut(runs));
            for (rows, ((((red, green), blue), coverage), seen)) in rows.iter_mut().zip(lines) {
                rows.push(Row { colour: [red, green, blue], coverage, seen });
            }
        }
        let lines = rows.into_par_iter().zip(seen_any.par_chunks_mut(width)).enumerate();
        lines.for_each_init(
            || (Projected::default(), vec![vec![1.0; width]; sweeps.len()], vec![0.0; width]),
            |(projected, masks, left), (y, (mut rows, seen_any))| {
                let mut before: Option<&[f32]> = None;
                for (disparity, views) in layers.disparity.chunks(plane).zip(rows.chunks_mut(sweeps.len())) {
                    let disparity = &disparity[y * width..(y + 1) * width];
                    for start in (0..width).step_by(RUN) {
                        let run = start..(start + RUN).min(width);
                        // Most of a layer along a surface lies where the one before it does.
                        if before.is_some_and(|before| before[run.clone()] == disparity[run.clone()]) {
                            continue;
                        }
                        left[run.clone()].fill(0.0);
                        let left = &mut left[run.clone()];
                        for (((sweep, view), mask), row) in sweeps.iter().zip(&self.views).zip(&mut *masks).zip(&*views)
                        {
                            let mask = &mut mask[run.clone()];
                            projected.part(sweep, (start, y), &disparity[run.clone()]);
                            see(projected, view.known, self.margin, mask);
                            left.iter_mut()
                                .zip(&*mask)
                                .zip(&row.coverage[run.clone()])
                                .for_each(|((left, m), c)| *left += m * c);
                        }
                        for x in run.clone().filter(|&x| left[x - start] <= SEEN) {
                            masks.iter_mut().for_each(|mask| mask[x] = 1.0);
                        }
                    }
                    before = Some(disparity);
                    seen_any.iter_mut().zip(&*left).for_each(|(seen, &left)| *seen |= left > SEEN);
                    for (mask, row) in masks.iter().zip(views) {
                        row.hide(mask);
                    }
                }
            },
        );
    }
}

impl Row<'_> {
    /// Multiplies it by a mask of ones and zeros.
    fn hide(&mut self, mask: &[f32]) {
        for (run, mask) in mask.chunks(RUN).enumerate() {
            if mask.iter().all(|&m| m == 1.0) || self.seen[run] == RunCoverage::None {
                continue;
            }
            self.seen[run] = RunCoverage::Partly;
            let span = run * RUN..run * RUN + mask.len();
            let [red, green, blue] = &mut self.colour;
            for values in [&mut **red, green, blue, self.coverage] {
                values[span.clone()].iter_mut().zip(mask).for_each(|(value, m)| *value *= m);
            }
        }
    }
}

/// 1 where the view sees the points of a row, else 0.
#[pulp::with_simd(see = pulp::Arch::new())]
#[inline(always)]
fn see_with<'a, S: pulp::Simd>(_simd: S, points: &'a Projected, map: &'a KnownDepth, margin: f32, seen: &'a mut [f32]) {
    let (rows, columns) = map.disparity.dim();
    let cells = map.disparity.as_slice().expect("standard order");
    let (right, bottom) = (columns as f32, rows as f32);
    let points = points.x.iter().zip(&points.y).zip(&points.disparity);
    for (((&x, &y), &disparity), seen) in points.zip(seen) {
        let inside = (x >= 0.0) & (y >= 0.0) & (x < right) & (y < bottom);
        let at = |at: f32| whole(at.floor()) as usize;
        let own = if inside { cells[at(y) * columns + at(x)] } else { -1.0 };
        *seen = if own - disparity < margin { 1.0 } else { 0.0 };
    }
}

/// 1 where the view sees the point of each pixel of the target at `disparity` (row by row, `width` wide), else 0.
pub(super) fn visible(
    (camera, map): (&Camera, &KnownDepth),
    target: &Camera,
    disparity: &[f32],
    width: usize,
    margin: f32,
) -> Vec<f32> {
    let sweep = PlaneSweep::new(camera, target);
    let mut seen = vec![1.0; disparity.len()];
    let lines = seen.par_chunks_mut(width).zip(disparity.par_chunks(width)).enumerate();
    lines.for_each_init(Projected::default, |projected, (y, (seen, disparity))| {
        projected.row(&sweep, y, disparity);
        see(projected, map, margin, seen);
    });
    seen
}
