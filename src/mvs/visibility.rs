//! Who sees what: a view sees a point unless a confirmed depth of its own, there, is nearer by more than some pixels of parallax.
//!
//! The view's own depth is taken at the pixel that the point falls on; where that is not confirmed, or outside, nothing hides the
//! point. What a view does not see has neither colour nor coverage. Where the coverage that is left, summed over the views, is
//! 0.05 or less, further photos stand in for them: those that see the point (with a coverage above 0.5), in their order, take the
//! places of the first views, one each, with full coverage. Where none does, all views serve as if none were hidden, and the pixel
//! counts as unseen.

use rayon::prelude::*;

use super::project::Projected;
use super::{Camera, KnownDepth, PlaneSweep, RUN, RunCoverage, Size, SourceView};

/// Coverage, summed over the views, from which on a pixel is seen.
const SEEN: f32 = 0.05;

/// What hides layers of a target from its views.
#[derive(Debug, Clone)]
pub struct Visibility<'a> {
    /// Each view's camera and confirmed depth, in the order of the views.
    pub views: Vec<(&'a Camera, &'a KnownDepth)>,
    /// Further photos, nearest first, and their confirmed depth.
    pub further: Vec<(SourceView<'a>, &'a KnownDepth)>,
    /// How much nearer than a point the view's own depth must be to hide it, 1/scene unit.
    pub margin: f32,
}

/// A layer that the views were warped by.
#[derive(Debug)]
pub(crate) struct WarpedLayer<'a> {
    /// `[h, w]`, 1/scene unit.
    pub(crate) disparity: &'a [f32],
    /// `[3V, h, w]`.
    pub(crate) colour: &'a mut [f32],
    /// `[V, h, w]`.
    pub(crate) coverage: &'a mut [f32],
    /// What is known of the coverage, by view and row.
    pub(crate) run_coverage: &'a mut [RunCoverage],
}

/// A row of a view: colour by channel, coverage, what is known of it.
struct Row<'a> {
    colour: [&'a mut [f32]; 3],
    coverage: &'a mut [f32],
    seen: &'a mut [RunCoverage],
}

impl Visibility<'_> {
    /// Multiply colour and coverage of a layer of `target`, padded to `size`, by 1 or 0. `seen_any` becomes true where a view sees
    /// it.
    pub(crate) fn hide(&self, target: &Camera, size: Size, layer: WarpedLayer<'_>, seen_any: &mut [bool]) {
        let (width, plane) = (size.width, size.pixels());
        let sweeps: Vec<_> = self.views.iter().map(|(camera, _)| PlaneSweep::new(camera, target)).collect();
        let further: Vec<_> = self.further.iter().map(|(view, _)| PlaneSweep::new(view.camera, target)).collect();
        let runs = width.div_ceil(RUN);
        // Rows of all views side by side, so that a thread decides over all of them at once.
        let mut rows: Vec<Vec<Row<'_>>> = (0..size.height).map(|_| Vec::with_capacity(sweeps.len())).collect();
        let views = layer.colour.chunks_mut(3 * plane).zip(layer.coverage.chunks_mut(plane));
        for ((colour, coverage), seen) in views.zip(layer.run_coverage.chunks_mut(size.height * runs)) {
            let (red, rest) = colour.split_at_mut(plane);
            let (green, blue) = rest.split_at_mut(plane);
            let lines = red.chunks_mut(width).zip(green.chunks_mut(width)).zip(blue.chunks_mut(width));
            let lines = lines.zip(coverage.chunks_mut(width)).zip(seen.chunks_mut(runs));
            for (rows, ((((red, green), blue), coverage), seen)) in rows.iter_mut().zip(lines) {
                rows.push(Row { colour: [red, green, blue], coverage, seen });
            }
        }
        let lines = rows.into_par_iter().zip(layer.disparity.par_chunks(width)).zip(seen_any.par_chunks_mut(width));
        lines.enumerate().for_each_init(
            || (Projected::default(), vec![vec![1.0; width]; sweeps.len()], vec![0.0; width]),
            |(projected, masks, left), (y, ((mut views, disparity), seen_any))| {
                left.fill(0.0);
                for (((sweep, (_, map)), mask), row) in sweeps.iter().zip(&self.views).zip(&mut *masks).zip(&views) {
                    projected.row(sweep, y, disparity);
                    see(projected, map, self.margin, mask);
                    left.iter_mut().zip(&*mask).zip(&*row.coverage).for_each(|((left, m), c)| *left += m * c);
                }
                let unseen: Vec<usize> = (0..width).filter(|&x| left[x] <= SEEN).collect();
                let (mut taken, slots) = (vec![0; unseen.len()], views.len());
                for ((view, map), sweep) in self.further.iter().zip(&further).take_while(|_| !unseen.is_empty()) {
                    projected.row(sweep, y, disparity);
                    for (taken, &x) in taken.iter_mut().zip(&unseen).filter(|(taken, _)| **taken < slots) {
                        let sample = seen_colour(projected, x, view, map, self.margin);
                        let Some(colour) = sample else { continue };
                        if *taken == 0 {
                            masks.iter_mut().for_each(|mask| mask[x] = 0.0);
                        }
                        masks[*taken][x] = 1.0;
                        let row = &mut views[*taken];
                        (0..3).for_each(|c| row.colour[c][x] = colour[c]);
                        row.coverage[x] = 1.0;
                        row.seen[x / RUN] = RunCoverage::Partly;
                        *taken += 1;
                    }
                }
                for (taken, &x) in taken.iter().zip(&unseen) {
                    if *taken == 0 {
                        masks.iter_mut().for_each(|mask| mask[x] = 1.0);
                    } else {
                        left[x] = 1.0;
                    }
                }
                seen_any.iter_mut().zip(&*left).for_each(|(seen, &left)| *seen |= left > SEEN);
                for (mask, row) in masks.iter_mut().zip(&mut views) {
                    for (run, mask) in mask.chunks(RUN).enumerate() {
                        if mask.iter().all(|&m| m == 1.0) || row.seen[run] == RunCoverage::None {
                            continue;
                        }
                        row.seen[run] = RunCoverage::Partly;
                        let span = run * RUN..run * RUN + mask.len();
                        let [red, green, blue] = &mut row.colour;
                        for values in [&mut **red, green, blue, row.coverage] {
                            values[span.clone()].iter_mut().zip(mask).for_each(|(value, m)| *value *= m);
                        }
                    }
                }
            },
        );
    }
}

/// The colour of a point of a row in a photo that sees it.
fn seen_colour(points: &Projected, x: usize, view: &SourceView<'_>, map: &KnownDepth, margin: f32) -> Option<[f32; 3]> {
    let (at_x, at_y) = (points.x[x], points.y[x]);
    let (rows, columns) = map.disparity.dim();
    if !(at_x >= 0.0 && at_y >= 0.0 && at_x < columns as f32 && at_y < rows as f32) {
        return None;
    }
    if map.disparity[(at_y as usize, at_x as usize)] - points.disparity[x] >= margin {
        return None;
    }
    let [r, g, b, coverage] = view.texture.sample_at(at_x, at_y);
    (coverage > 0.5).then(|| [r, g, b].map(|value| value / coverage))
}

/// 1 where the view sees the points of a row, else 0.
fn see(points: &Projected, map: &KnownDepth, margin: f32, seen: &mut [f32]) {
    let (rows, columns) = map.disparity.dim();
    let cells = map.disparity.as_slice().expect("standard order");
    for (x, seen) in seen.iter_mut().enumerate() {
        let (at_x, at_y) = (points.x[x], points.y[x]);
        let inside = at_x >= 0.0 && at_y >= 0.0 && at_x < columns as f32 && at_y < rows as f32;
        let own = if inside { cells[at_y as usize * columns + at_x as usize] } else { -1.0 };
        *seen = if own - points.disparity[x] < margin { 1.0 } else { 0.0 };
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
