//! A target's surface together with what hides it from its views: all that rendering along it needs.

use std::sync::Arc;

use super::correction::{balanced, gains_to_first, sharpening_with};
use super::depth_maps::DepthMaps;
use super::fusion::{ConfirmedDepth, Surface, SurfaceView, surface};
use crate::geometry::{Camera, distance};
use crate::layers::{Layers, LayersError};
use crate::render::{Visibility, VisibleView};
use crate::warp::{NO_GAINS, SourceView};

/// In what the photos of a target are made alike, as far as their correspondences tell; by default in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhotoCorrection {
    /// Exposure and white balance ([`super::exposure_gains`]).
    pub exposure: bool,
    /// Sharpness ([`super::sharpening`]).
    pub sharpness: bool,
}

impl Default for PhotoCorrection {
    fn default() -> Self {
        Self { exposure: true, sharpness: true }
    }
}

/// A target's surface, and what is known of the photos of its views.
#[derive(Debug, Clone)]
pub struct TargetSurface {
    surface: Surface,
    /// How much nearer than a point a photo's own depth must be to hide it, 1/scene unit.
    margin: f32,
    /// The confirmed depth of each view's photo.
    known: Vec<Arc<ConfirmedDepth>>,
    /// What each view's photo is multiplied by, per channel, so that all have the exposure that the target is to have.
    gains: Vec<[f32; 3]>,
    /// How much each view's photo is sharpened.
    sharpening: Vec<f32>,
}

impl TargetSurface {
    /// Finds the surface by photos of known depth, given by their indices among the maps' with camera and texture, nearest first; the
    /// target is rendered from the first `count`.
    pub(crate) fn find(
        maps: &mut DepthMaps,
        photos: &[(usize, SourceView<'_>)],
        count: usize,
        target: &Camera,
        photo_correction: PhotoCorrection,
    ) -> Self {
        let set: Vec<usize> = photos.iter().map(|&(photo, _)| photo).collect();
        let known = maps.known(&set);
        let view = |(&(_, view), known)| SurfaceView { view, known, gains: NO_GAINS };
        let mut views: Vec<SurfaceView<'_>> = photos.iter().zip(known.iter().map(Arc::as_ref)).map(view).collect();
        let mut gains = vec![NO_GAINS; views.len()];
        let mut sharpening = vec![0.0; count.min(views.len())];
        let statistics = maps.statistics();
        statistics.keep_of(&views);
        if photo_correction.exposure {
            gains = gains_to_first(&views, statistics);
        }
        set_gains(&mut views, &gains);
        if photo_correction.sharpness {
            // By the gains that do not depend on the target; their quotients are the same.
            sharpening = sharpening_with(&views[..sharpening.len()], statistics);
        }
        if photo_correction.exposure {
            let distances: Vec<f64> = views.iter().map(|view| distance(view.view.camera, target)).collect();
            gains = balanced(&gains, &distances);
        }
        set_gains(&mut views, &gains);
        let ((near, far), settings) = (maps.range(), maps.settings());
        let surface = surface(&views, target, near, far, settings);
        gains.truncate(count);
        let margin = settings.hides * surface.pixel;
        Self { surface, margin, known: known.into_iter().take(count).collect(), gains, sharpening }
    }

    /// The surface.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Factors of exposure of each view, by channel; 1 where they are left as they are.
    pub fn gains(&self) -> &[[f32; 3]] {
        &self.gains
    }

    /// How much each view's photo is sharpened; 0 where they are left as they are.
    pub fn sharpening(&self) -> &[f32] {
        &self.sharpening
    }

    /// `count` layers along the surface ([`Surface::layers`]).
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for none.
    pub fn layers(&self, count: usize) -> Result<Layers, LayersError> {
        self.surface.layers(count)
    }

    /// What hides its layers from these views, and makes their photos alike.
    pub(crate) fn visibility<'a>(&'a self) -> Visibility<'a> {
        let views = self.known.iter().zip(self.gains.iter().zip(&self.sharpening));
        let view = |(known, (&gains, &sharpening)): (&'a Arc<ConfirmedDepth>, _)| VisibleView {
            disparity: &known.disparity,
            gains,
            sharpening,
        };
        Visibility { views: views.map(view).collect(), margin: self.margin }
    }
}

fn set_gains(views: &mut [SurfaceView<'_>], gains: &[[f32; 3]]) {
    views.iter_mut().zip(gains).for_each(|(view, &gains)| view.gains = gains);
}
