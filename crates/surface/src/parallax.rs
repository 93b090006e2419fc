//! Parallax and coverage: positions of target pixels in the views, at sample positions of the
//! target.

use glam::{DVec2, DVec3};

use liveview::geometry::{Camera, PlaneSweep, Size};

/// Samples across and down a target.
const GRID: (usize, usize) = (48, 36);

/// Evenly spread positions on a target, in pixels.
pub fn grid(target: &Camera) -> Vec<DVec2> {
    let (width, height) = (target.width() as f64, target.height() as f64);
    let at = |x: usize, y: usize| {
        DVec2::new((x as f64 + 0.5) / GRID.0 as f64 * width, (y as f64 + 0.5) / GRID.1 as f64 * height)
    };
    (0..GRID.1).flat_map(|y| (0..GRID.0).map(move |x| at(x, y))).collect()
}

/// Position in the view (pixels) of a target pixel at a disparity (1/scene unit), if it lies in
/// front of the view.
fn project(sweep: &PlaneSweep, pixel: DVec2, disparity: f64) -> Option<DVec2> {
    let DVec3 { x, y, z } = sweep.source_from_target(disparity) * pixel.extend(1.0);
    (z > 0.0).then(|| DVec2::new(x / z, y / z))
}

/// Whether a position in pixels lies in the view's photo.
fn covers(view: &Camera, at: DVec2) -> bool {
    (0.0..=view.width() as f64).contains(&at.x) && (0.0..=view.height() as f64).contains(&at.y)
}

/// Distance (pixels) between the positions of a target pixel in the view at two disparities
/// (1/scene unit); `None` unless both lie in front of the view and at least one in its photo.
pub fn parallax(view: &Camera, sweep: &PlaneSweep, pixel: DVec2, disparities: (f64, f64)) -> Option<f64> {
    let ends = project(sweep, pixel, disparities.0).zip(project(sweep, pixel, disparities.1));
    ends.filter(|&(a, b)| covers(view, a) || covers(view, b)).map(|(a, b)| a.distance(b))
}

/// Whether a target pixel at a disparity (1/scene unit) lies in front of the view and in its photo.
pub fn is_covered(view: &Camera, sweep: &PlaneSweep, pixel: DVec2, disparity: f64) -> bool {
    project(sweep, pixel, disparity).is_some_and(|at| covers(view, at))
}

/// Share (0 to 1) of the positions that any of the views covers at a disparity (1/scene unit).
pub fn coverage(views: &[(&Camera, PlaneSweep)], grid: &[DVec2], disparity: f64) -> f64 {
    let covered = |pixel: DVec2| views.iter().any(|(view, sweep)| is_covered(view, sweep, pixel, disparity));
    grid.iter().filter(|&&pixel| covered(pixel)).count() as f64 / grid.len() as f64
}

/// Parallax (pixels) between near and far (scene units) in the view where it is largest: per view
/// the median over the target's corners and centre; points behind the view are left out.
pub(crate) fn widest_parallax(sweeps: &[PlaneSweep], size: Size, near: f64, far: f64) -> f64 {
    let points = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)];
    let disparities = (1.0 / near, 1.0 / far);
    let in_view = |sweep: &PlaneSweep| {
        let apart = |&(x, y): &(f64, f64)| {
            let pixel = DVec2::new(x * size.width as f64, y * size.height as f64);
            Some(project(sweep, pixel, disparities.0)?.distance(project(sweep, pixel, disparities.1)?))
        };
        let mut apart: Vec<f64> = points.iter().filter_map(apart).collect();
        apart.sort_by(f64::total_cmp);
        apart.get(apart.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
    };
    sweeps.iter().map(in_view).fold(0.0, f64::max)
}
