//! Depth ranges and reprojection errors from a model's tracked points.

use std::collections::HashMap;

use glam::DVec3;

use super::model::{Lens, Registered};
use crate::geometry::Intrinsics;

/// Tracked points that a view needs for a depth range.
const MIN_POINTS: usize = 8;

/// Depths of the tracked points in front of the camera, and their reprojection errors in pixels.
pub(super) fn depths_and_errors(image: &Registered, lens: &Lens, points: &HashMap<u64, DVec3>) -> (Vec<f64>, Vec<f64>) {
    let Intrinsics { fx, fy, cx, cy, .. } = lens.intrinsics;
    let projected = image.tracked.iter().filter_map(|&(u, v, id)| {
        let point = image.rotation * *points.get(&id)? + image.translation;
        let (x, y) = lens.distortion.distort(point.x / point.z, point.y / point.z);
        (point.z > 0.0).then(|| (point.z, (fx * x + cx - u).hypot(fy * y + cy - v)))
    });
    projected.unzip()
}

/// Near and far depth with a margin, in scene units; `None` for fewer than [`MIN_POINTS`].
pub(in crate::scene::formats) fn depth_range(mut depths: Vec<f64>) -> Option<(f64, f64)> {
    if depths.len() < MIN_POINTS {
        return None;
    }
    depths.sort_by(f64::total_cmp);
    Some((0.9 * percentile(&depths, 0.01), 1.1 * percentile(&depths, 0.99)))
}

/// Percentile of sorted values, interpolated linearly between ranks as in NumPy.
fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    let rank = fraction * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[rank as usize], sorted[rank.ceil() as usize]);
    low + (high - low) * rank.fract()
}

/// The note on the reprojection errors (pixels) of all views.
pub(super) fn reprojection_note(mut errors: Vec<f64>) -> Option<String> {
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2)?;
    let warning = if *median > 2.0 { ": poses or photos may not belong together" } else { "" };
    Some(format!("median reprojection error of {} tracked points: {median:.2} px{warning}", errors.len()))
}
