//! Per-view occlusion: a view sees a point unless the view's own depth, at the pixel that the point
//! projects to, is nearer by more than a margin.
//!
//! Where the view's own depth is unknown, or the point projects outside the photo, nothing hides
//! the point. An occluded sample gets neither colour nor coverage. Where the coverage that remains,
//! summed over the views, is 0.05 or less, the occlusion of all views is ignored and the pixel
//! counts as occluded. (Using further photos there instead: no gain,
//! docs/design-log/surface-layers.md.)

use std::ops::Range;

use ndarray::{Array2, Array3, Axis};
use rayon::prelude::*;

use super::blend::DistanceWeights;
use super::buffers::Buffers;
use super::corrected_photos::{SharpenedPhotos, ViewCorrection, correct_photos};
use crate::geometry::{Camera, Size};
use crate::layers::Layer;
use crate::warp::{ALL_SEEN, LayerBand, OwnDisparity, RUN, RunCoverage, SourceView, WarpedLayers, warp_sources};

/// Coverage, summed over the views that are not occluded, up to which a pixel counts as occluded.
const MIN_COVERAGE: f32 = 0.05;

/// Own depth of each view, for layers along a surface.
#[derive(Debug, Clone)]
pub struct Visibility<'a> {
    /// Disparity of each pixel of the views' photos, in their order, `[h, w]`, 1/scene unit; −1 where
    /// it is unknown.
    pub disparities: Vec<&'a Array2<f32>>,
    /// How much nearer than a point the view's own depth must be to hide it, 1/scene unit.
    pub margin: f32,
    /// Whether the views' depth was carried to the target; if not, no view covers any of it.
    pub is_seen: bool,
}

impl Visibility<'_> {
    /// The views' own depth, as the warp asks for it.
    pub(crate) fn own_depth(&self) -> Vec<OwnDisparity<'_>> {
        let disparities = self.disparities.iter().map(|disparity| disparity.as_slice().expect("standard order"));
        disparities.map(|disparity| OwnDisparity { disparity, margin: self.margin }).collect()
    }
}

/// A layer `[h, w]` (1/scene unit) of a padded target warped by `views`, with their photo correction and
/// without the samples that they do not see: colour `[3V, h, w]`, coverage `[V, h, w]`, and which pixels any view
/// sees `[h, w]`. For the parity tests.
#[doc(hidden)]
pub fn occluded(
    visibility: &Visibility<'_>,
    corrections: &[ViewCorrection],
    views: &[SourceView<'_>],
    target: &Camera,
    layer: &Array2<f32>,
) -> (Array3<f32>, Array3<f32>, Array2<bool>) {
    let (height, width) = layer.dim();
    let size = Size::new(width, height);
    let (mut sources, mut sharpened) = (warp_sources(views, target), SharpenedPhotos::default());
    correct_photos(corrections, &mut sources, &mut sharpened);
    let (mut buffers, mut seen) = (Buffers::default(), vec![false; size.pixels()]);
    buffers.make_room(1, views.len(), size).expect("memory for a layer");
    let layer = Layer::Pixels(layer.clone());
    buffers.warp(std::iter::once((0, &layer)), &sources, &visibility.own_depth(), &mut Vec::new());
    buffers.hide_occluded(1, &mut seen);
    let weights = DistanceWeights::new(&[]);
    let (batch, _) = buffers.batch(1, &weights);
    let [colour, coverage] = [batch.hwv, batch.coverage].map(|all| all.index_axis_move(Axis(0), 0).to_owned());
    (colour, coverage, Array2::from_shape_vec((height, width), seen).expect("one per pixel"))
}

/// Sets colour and coverage of `layers` to 0 where a view is occluded. The layers are of that many
/// views, were warped with the views' own depth, and cover a target padded to `size`; `visible`,
/// one per pixel, becomes true where some view is not occluded on one of them.
pub(crate) fn hide_occluded(views: usize, size: Size, layers: &mut WarpedLayers<'_>, visible: &mut [bool]) {
    // The same row of all layers and views, so that one thread decides over all of them at once.
    let rows_of_layers = layers.coverage.len() / size.pixels();
    let mut rows: Vec<_> = (0..size.height).map(|_| Vec::with_capacity(rows_of_layers)).collect();
    layers.for_each_band(views, size, 1, |_, row, layer| rows[row].push(layer));
    rows.into_par_iter().zip(visible.par_chunks_mut(size.width)).for_each(|(mut rows, visible)| {
        for layer in rows.chunks_mut(views) {
            for (run, visible) in visible.chunks_mut(RUN).enumerate() {
                hide_run(layer, run, visible);
            }
        }
    });
}

/// As [`hide_occluded`], one run of a row of a layer.
fn hide_run(views: &mut [LayerBand<'_>], run: usize, visible: &mut [bool]) {
    let span = run * RUN..run * RUN + visible.len();
    if views.iter().any(|view| view.seen[run] == ALL_SEEN && view.run_coverage[run] == RunCoverage::All) {
        visible.fill(true);
    } else {
        let mut remaining = [0.0; RUN];
        for view in &*views {
            let seen = view.seen[run];
            let pixels = remaining.iter_mut().zip(&view.planes[3][span.clone()]).enumerate();
            pixels.for_each(|(i, (remaining, coverage))| *remaining += bit(seen, i) * coverage);
        }
        let remaining = &remaining[..visible.len()];
        visible.iter_mut().zip(remaining).for_each(|(visible, &coverage)| *visible |= coverage > MIN_COVERAGE);
        let occluded_in_all = remaining
            .iter()
            .enumerate()
            .fold(0, |mask, (i, &coverage)| mask | u64::from(coverage <= MIN_COVERAGE) << i);
        views.iter_mut().for_each(|view| view.seen[run] |= occluded_in_all);
    }
    for view in views {
        hide(view, run, span.clone());
    }
}

/// 1 where bit `i` is set, else 0.
fn bit(mask: u64, i: usize) -> f32 {
    f32::from((mask >> i & 1) as u8)
}

/// Sets colour and coverage of a run to 0 where the view is occluded.
fn hide(view: &mut LayerBand<'_>, run: usize, span: Range<usize>) {
    let seen = view.seen[run];
    if seen == ALL_SEEN || view.run_coverage[run] == RunCoverage::None {
        return;
    }
    view.run_coverage[run] = RunCoverage::Partial;
    for values in &mut view.planes {
        let values = &mut values[span.clone()];
        let mut hidden = !seen;
        while hidden != 0 {
            values[hidden.trailing_zeros() as usize] = 0.0;
            hidden &= hidden - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::geometry::{Intrinsics, PlaneSweep};
    use crate::image::ImageRgb;
    use crate::warp::{Texture, warp_layers};

    const WIDTH: usize = 72;
    const HEIGHT: usize = 16;
    const MARGIN: f32 = 0.1;

    /// With as many pixels more on each side.
    fn camera(x: f64, more: usize) -> Camera {
        let (cx, cy) = (36.0 + more as f64, 8.0 + more as f64);
        let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx, cy, skew: 0.0 };
        Camera::new(intrinsics, WIDTH + 2 * more, HEIGHT + 2 * more, DMat3::IDENTITY, DVec3::new(x, 0.03, 0.1 * x))
            .unwrap()
    }

    #[test]
    fn occluded_equals_its_definition() {
        // Photos that end within the target, and photos that cover it.
        assert_occluded(0);
        assert_occluded(60);
    }

    fn assert_occluded(more: usize) {
        let (width, height) = (WIDTH + 2 * more, HEIGHT + 2 * more);
        let noise = |at: usize| (at as u32).wrapping_mul(2_654_435_761) >> 12;
        let (target, cameras) = (camera(0.0, 0), [camera(1.3, more), camera(-0.7, more), camera(0.4, more)]);
        let photo = |k: usize| (0..3 * width * height).map(|at| (noise(at + k) % 200) as f32 / 200.0).collect();
        let photos = [0, 1, 2].map(|k| Texture::new(&ImageRgb::new(width, height, photo(k)).unwrap()));
        // Depths in blocks: unknown, before the layer, and behind it.
        let own = |k: usize| {
            Array2::from_shape_fn((height, width), |(y, x)| {
                [-1.0, 0.95, 0.75, 0.1][noise(x / 3 + 9 * (y / 2) + 99 * k) as usize % 4]
            })
        };
        let depths = [0, 1, 2].map(own);
        let layer = Array2::from_shape_fn((HEIGHT, WIDTH), |(y, x)| 0.5 + 0.004 * x as f32 + 0.001 * y as f32);
        let views: Vec<_> =
            cameras.iter().zip(&photos).map(|(camera, texture)| SourceView { camera, texture }).collect();
        let visibility = Visibility { disparities: depths.iter().collect(), margin: MARGIN, is_seen: true };
        let correction = ViewCorrection { gains: [1.0; 3], sharpening: 0.0 };
        let (found_colour, found_coverage, found_seen) =
            occluded(&visibility, &[correction; 3], &views, &target, &layer);

        let (pixels, size) = (WIDTH * HEIGHT, Size::new(WIDTH, HEIGHT));
        let (mut colour, mut coverage) = (vec![0.0; 9 * pixels], vec![0.0; 3 * pixels]);
        warp_layers(layer.as_slice().unwrap(), &warp_sources(&views, &target), size, &mut colour, &mut coverage);
        let mut met = [0; 3];
        for ((y, x), &disparity) in layer.indexed_iter() {
            let (at, mut clear) = (y * WIDTH + x, true);
            let hidden = [0, 1, 2].map(|view| {
                let sweep = PlaneSweep::new(&cameras[view], &target);
                let uvw = sweep.source_from_target(disparity.into()) * DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
                let (u, v, there) = (uvw.x / uvw.z, uvw.y / uvw.z, f64::from(disparity) / uvw.z);
                let inside = (0.0..width as f64).contains(&u) && (0.0..height as f64).contains(&v);
                let own = if inside { f64::from(depths[view][(v as usize, u as usize)]) } else { -1.0 };
                // Not where rounding decides.
                clear &= (u - u.round()).abs() > 1e-4
                    && (v - v.round()).abs() > 1e-4
                    && (own - there - f64::from(MARGIN)).abs() > 1e-5;
                own - there >= f64::from(MARGIN)
            });
            if !clear {
                continue;
            }
            let remaining: f32 = (0..3).filter(|&view| !hidden[view]).map(|view| coverage[view * pixels + at]).sum();
            let seen = remaining > 0.05;
            assert_eq!(found_seen[(y, x)], seen, "row {y}, column {x}");
            met[if !seen { 0 } else { usize::from(hidden.contains(&true)) + 1 }] += 1;
            for view in 0..3 {
                let share = if seen && hidden[view] { 0.0 } else { 1.0 };
                assert_eq!(found_coverage[(view, y, x)], share * coverage[view * pixels + at], "row {y}, column {x}");
                for c in 3 * view..3 * view + 3 {
                    assert_eq!(found_colour[(c, y, x)], share * colour[c * pixels + at], "row {y}, column {x}");
                }
            }
        }
        assert!(met.iter().all(|&count| count > 20), "{met:?}");
    }
}
