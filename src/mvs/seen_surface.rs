//! A target's surface together with what hides it from its views: all that rendering along it needs.

use std::sync::Arc;

use super::exposure::{balanced, gains_to_first};
use super::sharpness::sharpening_with;
use super::{
    Camera, DepthMaps, KnownDepth, Layers, LayersError, SourceView, Surface, SurfaceView, Visibility, VisibleView,
    surface,
};
use crate::geometry::distance;
use crate::warp::NO_GAINS;

/// In what the photos of a target are made alike, as far as their correspondences tell; by default in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Matched {
    /// Exposure and white balance ([`super::exposure_gains`]).
    pub exposure: bool,
    /// Sharpness ([`super::sharpening`]).
    pub sharpness: bool,
}

impl Default for Matched {
    fn default() -> Self {
        Self { exposure: true, sharpness: true }
    }
}

/// A target's surface, and what is known of the photos of its views.
#[derive(Debug, Clone)]
pub struct SeenSurface {
    surface: Surface,
    /// How much nearer than a point a photo's own depth must be to hide it, 1/scene unit.
    margin: f32,
    /// The confirmed depth of each view's photo.
    known: Vec<Arc<KnownDepth>>,
    /// What each view's photo is multiplied by, per channel, so that all have the exposure that the target is to have.
    gains: Vec<[f32; 3]>,
    /// How much each view's photo is sharpened.
    sharpening: Vec<f32>,
}

impl SeenSurface {
    /// Finds the surface by photos of known depth, given by their indices among the maps' with camera and texture, nearest first; the
    /// target is rendered from the first `count`.
    pub(crate) fn find(
        maps: &mut DepthMaps,
        photos: &[(usize, SourceView<'_>)],
        count: usize,
        target: &Camera,
        matched: Matched,
    ) -> Self {
        let set: Vec<usize> = photos.iter().map(|&(photo, _)| photo).collect();
        let known = maps.known(&set);
        let view = |(&(_, view), known)| SurfaceView { view, known, gains: NO_GAINS };
        let mut views: Vec<SurfaceView<'_>> = photos.iter().zip(known.iter().map(Arc::as_ref)).map(view).collect();
        let mut gains = vec![NO_GAINS; views.len()];
        let mut sharpening = vec![0.0; count.min(views.len())];
        let statistics = maps.statistics();
        statistics.keep_of(&views);
        if matched.exposure {
            gains = gains_to_first(&views, statistics);
        }
        set_gains(&mut views, &gains);
        if matched.sharpness {
            // By the gains that do not depend on the target; their quotients are the same.
            sharpening = sharpening_with(&views[..sharpening.len()], statistics);
        }
        if matched.exposure {
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
    pub(crate) fn visibility<'a>(&'a self, views: &[SourceView<'a>]) -> Visibility<'a> {
        let known = self.known.iter().zip(self.gains.iter().zip(&self.sharpening));
        let view = |(view, (known, (&gains, &sharpening))): (&SourceView<'a>, (&'a Arc<KnownDepth>, _))| VisibleView {
            camera: view.camera,
            known,
            gains,
            sharpening,
        };
        let views = views.iter().zip(known).map(view).collect();
        Visibility { views, margin: self.margin }
    }
}

fn set_gains(views: &mut [SurfaceView<'_>], gains: &[[f32; 3]]) {
    views.iter_mut().zip(gains).for_each(|(view, &gains)| view.gains = gains);
}
