//! The photos of one time step, and those that a target is searched in.

use std::sync::OnceLock;

use crate::geometry::{Camera, PlaneSweep, looking_alike};
use crate::image::ImageRgb;
use crate::layers::guided::Levels;
use crate::warp::{NO_GAINS, SourceView, Texture};

/// The photos of one time step; textures are made of them when they are first needed.
pub(super) struct Step<'a> {
    pub(super) cameras: &'a [Camera],
    photos: &'a [Option<&'a ImageRgb>],
    textures: Vec<OnceLock<Texture>>,
}

impl<'a> Step<'a> {
    pub(super) fn new(cameras: &'a [Camera], photos: &'a [Option<&'a ImageRgb>]) -> Self {
        Self { cameras, photos, textures: photos.iter().map(|_| OnceLock::new()).collect() }
    }

    /// Number of cameras that have delivered a photo.
    pub(super) fn delivered(&self) -> usize {
        self.photos.iter().flatten().count()
    }

    /// The cameras that have delivered a photo and look the same way as this one, nearest first.
    pub(super) fn nearest(&self, camera: &Camera) -> Vec<usize> {
        let delivered: Vec<usize> = (0..self.photos.len()).filter(|&view| self.photos[view].is_some()).collect();
        let cameras: Vec<&Camera> = delivered.iter().map(|&view| &self.cameras[view]).collect();
        looking_alike(&cameras, camera).into_iter().map(|index| delivered[index]).collect()
    }

    /// A camera that has delivered a photo, and its texture.
    pub(super) fn source(&self, view: usize) -> SourceView<'_> {
        let texture = || Texture::new(self.photos[view].expect("delivered"));
        SourceView { camera: &self.cameras[view], texture: self.textures[view].get_or_init(texture) }
    }
}

/// The views of one time step, and the target that they are searched for.
pub(super) struct TargetViews<'a> {
    pub(super) levels: Levels<'a>,
    /// In the order of the levels' textures.
    pub(super) cameras: Vec<&'a Camera>,
    pub(super) target: &'a Camera,
}

impl<'a> TargetViews<'a> {
    pub(super) fn new(step: &'a Step<'_>, views: &[usize], target: &'a Camera) -> Self {
        let sources: Vec<_> = views.iter().map(|&view| step.source(view)).collect();
        let levels = Levels::new(sources.iter().map(|source| (source.texture, NO_GAINS)).collect());
        Self { levels, cameras: sources.iter().map(|source| source.camera).collect(), target }
    }

    /// Plane sweeps for a target, or for a part of one.
    pub(super) fn sweeps(&self, target: &Camera) -> Vec<PlaneSweep> {
        self.cameras.iter().map(|camera| PlaneSweep::new(camera, target)).collect()
    }
}
