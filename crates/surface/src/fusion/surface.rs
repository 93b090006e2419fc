//! The target's surface: the confirmed depths of the photos, fused at the target, holes filled.
//!
//! 1. Splat of the confirmed depths ([`super::splat`]).
//! 2. Holes: from their farthest neighbours inwards ([`fill_holes`]). Where holes are more than 5 %
//!    of the target, it is searched among the first four views ([`super::target_search`]). What that
//!    finds takes the place of the first, except where the first has the lower variance of the photos
//!    that see it ([`super::photo_variance`]): below 0.9 of the other's − 1e-7
//!    (docs/design-log/ordinary-scenes.md).
//! 3. 3×3 median.
//!
//! px is the target's disparity per pixel: (1/near − 1/far) over the parallax between near and far
//! in the view where it is largest (at least 1).

use ndarray::Array2;
use rayon::prelude::*;

use super::confirmed_depth::ConfirmedDepth;
use super::photo_variance::{SeenSurface, photo_variance};
use super::splat::{Single, splat};
use super::surface_view::SurfaceView;
use super::target_search::TargetSearch;
use super::visible::visible;
use crate::neighbourhood::{extremes3, fill_holes, median3};
use crate::parallax::widest_parallax;
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::layers::{Layers, LayersError, padded};
use liveview::warp::{SourceView, WarpSource};

/// Two depths splatted to a pixel are one surface within this, px.
pub(crate) const SAME_SURFACE_PX: f32 = 2.0;
/// Depths up to this far behind the nearest are averaged with it, px.
pub(crate) const AVERAGED_PX: f32 = 3.0;
/// How much nearer a view's own depth must be to hide a point, px.
pub(crate) const OCCLUSION_MARGIN_PX: f32 = 4.0;
/// Share of holes from which on the target is searched.
const SEARCHED_HOLE_SHARE: f64 = 0.05;
/// Number of views that the target is searched with.
const SEARCHED_VIEWS: usize = 4;
/// The first candidate stays below this share of the second one's variance.
const VARIANCE_RATIO: f32 = 0.9;
/// And by this much: rounding, the only difference where the photos have no texture (a tenth of a
/// grey level, squared).
const VARIANCE_ROUNDING: f32 = 1e-7;

/// Disparity of each pixel of a padded target.
#[derive(Debug, Clone)]
pub struct Surface {
    /// 1/scene unit, `[h, w]`, multiples of 8.
    pub disparity: Array2<f32>,
    /// Disparity that moves a point by one pixel in the view with the largest parallax, 1/scene
    /// unit.
    pub disparity_per_pixel: f32,
    /// Share (0 to 1) of the target without a confirmed depth.
    pub holes: f64,
}

impl Surface {
    /// `count` layers near → far: one follows the surface; two are its largest and its smallest
    /// disparity over 3×3 pixels, three these with the surface between them; more divide that range
    /// evenly (k-th of L: near + k/(L − 1)·(far − near), in f32).
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for a count of 0.
    pub fn layers(&self, count: usize) -> Result<Layers, LayersError> {
        if count <= 1 {
            return Layers::pixels(vec![self.disparity.clone(); count]);
        }
        let (height, width) = self.disparity.dim();
        let extremes = extremes3(self.disparity.as_slice().expect("standard order"), width);
        let [near, far] = [extremes.0, extremes.1]
            .map(|values| Array2::from_shape_vec((height, width), values).expect("one per pixel"));
        match count {
            2 => return Layers::pixels(vec![near, far]),
            3 => return Layers::pixels(vec![near, self.disparity.clone(), far]),
            _ => {}
        }
        let layer = |k: usize| {
            let share = k as f32 / (count - 1) as f32;
            let between = |&near: &f32, &far: &f32| if k + 1 == count { far } else { near + share * (far - near) };
            ndarray::Zip::from(&near).and(&far).map_collect(between)
        };
        Layers::pixels((0..count).map(layer).collect())
    }

    /// How much nearer than a point a view's own depth must be to hide it, 1/scene unit.
    pub fn occlusion_margin(&self) -> f32 {
        OCCLUSION_MARGIN_PX * self.disparity_per_pixel
    }
}

/// Finds the surface of `target` from these photos, nearest first (at least one), between `near`
/// and `far` (scene units).
pub fn surface(views: &[SurfaceView<'_>], target: &Camera, near: f64, far: f64) -> Surface {
    find_surface(views, target, (near, far), true)
}

/// As [`surface()`]; unless `searches_holes`, they are only filled.
pub(crate) fn find_surface(
    views: &[SurfaceView<'_>],
    target: &Camera,
    (near, far): (f64, f64),
    searches_holes: bool,
) -> Surface {
    let size = padded(target.size());
    let sources = warp_sources(views, target);
    let disparity_per_pixel = disparity_per_pixel(&sources, size, near, far);
    let splatted = splat_confirmed(views, target, disparity_per_pixel);
    let holes = splatted.iter().filter(|&&d| d < 0.0).count() as f64 / splatted.len() as f64;
    let mut filled = fill_holes(&splatted, size.width);
    if searches_holes && holes > SEARCHED_HOLE_SHARE {
        let count = views.len().min(SEARCHED_VIEWS);
        let (views, sources) = (&views[..count], &sources[..count]);
        let margin = OCCLUSION_MARGIN_PX * disparity_per_pixel;
        let search = TargetSearch { views, sources, target, splatted: &splatted, size, range: (near, far), margin };
        let planes = search.planes();
        let searched = search.disparity(&planes, search.costs(&planes).view());
        let variance = |disparity: &[f32]| {
            let visible_to = |&view| visible(view, target, disparity, size.width, margin);
            let visible: Vec<_> = depth_maps(views).par_iter().map(visible_to).collect();
            let (visible, splatted, width) = (&visible, &splatted, size.width);
            photo_variance(&SeenSurface { disparity, splatted, width, sources, visible })
        };
        let (of_filled, of_searched) = (variance(&filled), variance(&searched));
        for (at, &splatted) in splatted.iter().enumerate() {
            let is_better = of_filled[at] < VARIANCE_RATIO * of_searched[at] - VARIANCE_ROUNDING;
            if splatted < 0.0 && !is_better {
                filled[at] = searched[at];
            }
        }
    }
    let disparity = median3(&filled, size.width);
    let disparity = Array2::from_shape_vec((size.height, size.width), disparity).expect("one per pixel");
    Surface { disparity, disparity_per_pixel, holes }
}

/// The views for the warp to `target`, with their gains.
pub(crate) fn warp_sources<'a>(views: &[SurfaceView<'a>], target: &Camera) -> Vec<WarpSource<'a>> {
    let source = |v: &SurfaceView<'a>| {
        let SourceView { camera, texture } = v.view;
        WarpSource { texture, sweep: PlaneSweep::new(camera, target), gains: v.gains }
    };
    views.iter().map(source).collect()
}

/// Disparity that moves a point by one pixel on a padded target of that size, 1/scene unit.
pub(crate) fn disparity_per_pixel(sources: &[WarpSource<'_>], size: Size, near: f64, far: f64) -> f32 {
    let sweeps: Vec<_> = sources.iter().map(|source| source.sweep).collect();
    ((1.0 / near - 1.0 / far) / widest_parallax(&sweeps, size, near, far).max(1.0)) as f32
}

/// The confirmed depths splatted to the padded target, row by row; −1 in holes.
pub(crate) fn splat_confirmed(views: &[SurfaceView<'_>], target: &Camera, disparity_per_pixel: f32) -> Vec<f32> {
    let margins = (SAME_SURFACE_PX * disparity_per_pixel, AVERAGED_PX * disparity_per_pixel);
    let maps: Vec<_> = views.iter().map(|v| (v.view.camera, &v.confirmed.disparity)).collect();
    splat(&maps, target, padded(target.size()), margins, Single::Kept)
}

fn depth_maps<'a>(views: &[SurfaceView<'a>]) -> Vec<(&'a Camera, &'a ConfirmedDepth)> {
    views.iter().map(|v| (v.view.camera, v.confirmed)).collect()
}
