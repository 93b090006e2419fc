//! A target's surface with the occlusion and the correction of its views: all that rendering along
//! it needs.

use std::sync::Arc;

use crate::correction::{balanced, gains_to_first, sharpening_with};
use crate::fusion::{OCCLUSION_MARGIN_PX, SurfaceView, surface};
use crate::{ConfirmedDisparity, DepthMaps, Surface};
use liveview::geometry::{Camera, distance};
use liveview::render::{ViewCorrection, Visibility};
use liveview::warp::{NO_GAINS, SourceView};

/// A target sees the photos' depth if it is carried to at least this share of the pixels that it would
/// be carried to from a photo's own viewpoint: the scene fills a thirtieth of the picture's sides.
const MIN_CARRIED: f64 = 1e-3;

/// The nearest and the farthest of the target's pixels that its planes leave out: single specks.
const UNSEEN_SHARE: f64 = 0.002;
/// What planes go beyond the others, pixels of parallax: the error of the photos' depth.
const SEEN_MARGIN_PX: f64 = 2.0;

/// Which differences between the photos of a target are corrected, by their correspondences; all by
/// default.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhotoCorrection {
    /// Exposure and white balance ([`crate::stages::exposure_gains`]).
    pub exposure: bool,
    /// Sharpness ([`crate::stages::sharpening`]).
    pub sharpness: bool,
}

impl PhotoCorrection {
    /// Photos stay as they are.
    pub const NONE: Self = Self { exposure: false, sharpness: false };
}

impl Default for PhotoCorrection {
    fn default() -> Self {
        Self { exposure: true, sharpness: true }
    }
}

/// A target's surface, with the confirmed depth and the correction of its views' photos.
#[derive(Debug, Clone)]
pub struct TargetSurface {
    /// The surface.
    pub surface: Surface,
    /// The confirmed depth of each view's photo.
    confirmed: Vec<Arc<ConfirmedDisparity>>,
    /// Correction `[V]` of the views' photos.
    pub corrections: Vec<ViewCorrection>,
    /// Mean share, 0 to 1, of the photos' pixels (of its views and helpers) whose depth other photos
    /// confirm.
    pub confirmed_share: f64,
}

impl TargetSurface {
    /// Finds the surface from photos whose depth is in `maps`, given by their indices among the
    /// maps with camera and texture, nearest first; the target is rendered from the first `count`.
    pub fn find(
        maps: &mut DepthMaps,
        photos: &[(usize, SourceView<'_>)],
        count: usize,
        target: &Camera,
        correction: PhotoCorrection,
    ) -> Self {
        let mut confirmed = maps.mutually_confirmed(photos);
        let mut views = views(photos, &confirmed);
        let corrections = correct(maps, photos, &mut views, count, target, correction);
        let surface = surface(&views, target, maps.range());
        let confirmed_share = maps.confirmed_share;
        confirmed.truncate(count);
        Self { surface, confirmed, corrections, confirmed_share }
    }

    /// Whether any of the photos' depth was carried to the target. Without any confirmed depth, the
    /// photos say nothing of what it sees, and the surface is that of the search at the target.
    fn is_seen(&self) -> bool {
        1.0 - self.surface.guessed_share() >= MIN_CARRIED * self.confirmed_share
    }

    /// The part of a depth range (near, far; scene units) in which the target sees something; all of it
    /// where the photos' depth does not say.
    pub fn seen_range(&self, (near, far): (f64, f64)) -> (f64, f64) {
        if !self.is_seen() {
            return (near, far);
        }
        let mut disparities: Vec<f32> = self.surface.disparity.iter().copied().collect();
        let unseen = (disparities.len() as f64 * UNSEEN_SHARE) as usize;
        let mut nth = |rank: usize| f64::from(*disparities.select_nth_unstable_by(rank, f32::total_cmp).1);
        let (farthest, nearest) = (nth(unseen), nth(self.surface.disparity.len() - 1 - unseen));
        let margin = SEEN_MARGIN_PX * f64::from(self.surface.disparity_per_pixel);
        let (farthest, nearest) = ((farthest - margin).max(1.0 / far), (nearest + margin).min(1.0 / near));
        if farthest < nearest { (1.0 / nearest, 1.0 / farthest) } else { (near, far) }
    }

    /// Occlusion of its views, for the renderer.
    pub fn visibility(&self) -> Visibility<'_> {
        let disparities = self.confirmed.iter().map(|confirmed| &confirmed.disparity).collect();
        Visibility {
            disparities,
            margin: OCCLUSION_MARGIN_PX * self.surface.disparity_per_pixel,
            is_seen: self.is_seen(),
        }
    }
}

/// How the first `count` of these photos are corrected, given as for [`TargetSurface::find`].
pub fn photo_corrections(
    maps: &mut DepthMaps,
    photos: &[(usize, SourceView<'_>)],
    count: usize,
    target: &Camera,
    correction: PhotoCorrection,
) -> Vec<ViewCorrection> {
    let confirmed = maps.mutually_confirmed(photos);
    correct(maps, photos, &mut views(photos, &confirmed), count, target, correction)
}

/// Photos with their confirmed depth and their colours unchanged.
fn views<'a>(photos: &[(usize, SourceView<'a>)], confirmed: &'a [Arc<ConfirmedDisparity>]) -> Vec<SurfaceView<'a>> {
    let view = |(&(_, view), confirmed)| SurfaceView { view, confirmed, gains: NO_GAINS };
    photos.iter().zip(confirmed.iter().map(Arc::as_ref)).map(view).collect()
}

/// Sets the gains of the photos; returns the correction of the first `count`.
fn correct(
    maps: &mut DepthMaps,
    photos: &[(usize, SourceView<'_>)],
    views: &mut [SurfaceView<'_>],
    count: usize,
    target: &Camera,
    correction: PhotoCorrection,
) -> Vec<ViewCorrection> {
    let indices: Vec<usize> = photos.iter().map(|&(index, _)| index).collect();
    let number = count.min(views.len());
    let kept = maps.correction.take().filter(|(photos, _, amounts)| (photos, amounts.len()) == (&indices, number));
    let (indices, mut gains, sharpening) = kept.unwrap_or_else(|| {
        let (mut gains, mut sharpening) = (vec![NO_GAINS; views.len()], vec![0.0; number]);
        let statistics = &mut maps.statistics;
        statistics.reset_unless_of(views);
        if correction.exposure {
            gains = gains_to_first(views, statistics);
        }
        set_gains(views, &gains);
        if correction.sharpness {
            // By the gains that do not depend on the target; their quotients are the same.
            sharpening = sharpening_with(&views[..number], statistics);
        }
        (indices, gains, sharpening)
    });
    maps.correction = maps.follows.then(|| (indices, gains.clone(), sharpening.clone()));
    if correction.exposure {
        let distances: Vec<f64> = views.iter().map(|view| distance(view.view.camera, target)).collect();
        gains = balanced(&gains, &distances);
    }
    set_gains(views, &gains);
    let correction = |(gains, sharpening)| ViewCorrection { gains, sharpening };
    gains.into_iter().zip(sharpening).map(correction).collect()
}

fn set_gains(views: &mut [SurfaceView<'_>], gains: &[[f32; 3]]) {
    views.iter_mut().zip(gains).for_each(|(view, &gains)| view.gains = gains);
}
