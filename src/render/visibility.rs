//! Per-view occlusion: a view sees a point unless the view's own depth, at the pixel that the point
//! projects to, is nearer by more than a margin.
//!
//! Where the view's own depth is unknown, or the point projects outside the photo, nothing hides
//! the point. An occluded sample gets neither colour nor coverage. Where the coverage that remains,
//! summed over the views, is 0.05 or less, the occlusion of all views is ignored and the pixel
//! counts as occluded. (Using further photos there instead: no gain,
//! docs/design-log/surface-layers.md.)

use std::ops::Range;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::corrected_photos::{SharpenedPhotos, ViewCorrection, correct_photos};
use crate::geometry::{Camera, Size};
use crate::warp::{
    ALL_SEEN, LayerBand, OwnDisparity, RUN, RunCoverage, SourceView, WarpedLayers, run_coverage_len, warp_layers_into,
    warp_sources,
};

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
/// sees `[h, w]`. For the parity tests; the renderer does the same in its own buffers.
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
    let pixels = views.len() * size.pixels();
    let (mut colour, mut coverage, mut seen) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![false; size.pixels()]);
    let mut run_coverage = vec![RunCoverage::Partial; views.len() * run_coverage_len(size)];
    let mut seen_runs = vec![0; run_coverage.len()];
    let (mut sources, mut sharpened) = (warp_sources(views, target), SharpenedPhotos::default());
    correct_photos(corrections, &mut sources, &mut sharpened);
    let mut warped = WarpedLayers {
        disparity: layer.as_slice().expect("standard order"),
        colour: &mut colour,
        coverage: &mut coverage,
        run_coverage: &mut run_coverage,
        seen: &mut seen_runs,
    };
    warp_layers_into(&sources, &visibility.own_depth(), size, &mut warped);
    hide_occluded(views.len(), size, &mut warped, &mut seen);
    let volume = |values: Vec<f32>| {
        Array3::from_shape_vec((values.len() / size.pixels(), height, width), values).expect("complete maps")
    };
    (volume(colour), volume(coverage), Array2::from_shape_vec((height, width), seen).expect("one per pixel"))
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
