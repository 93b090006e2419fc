//! The photos of one time step.

use std::sync::OnceLock;

use liveview::geometry::{Camera, facing_alike};
use liveview::image::ImageRgb;
use liveview::warp::{SourceView, Texture};

/// The photos of one time step; each becomes a texture when it is first needed.
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

    /// The cameras that have delivered a photo and face the direction of this one, nearest first.
    pub(super) fn nearest(&self, camera: &Camera) -> Vec<usize> {
        let delivered: Vec<usize> = (0..self.photos.len()).filter(|&view| self.photos[view].is_some()).collect();
        let cameras: Vec<&Camera> = delivered.iter().map(|&view| &self.cameras[view]).collect();
        facing_alike(&cameras, camera).into_iter().map(|index| delivered[index]).collect()
    }

    /// A camera that has delivered a photo, and its texture.
    pub(super) fn source(&self, view: usize) -> SourceView<'_> {
        let texture = || Texture::new(self.photos[view].expect("delivered"));
        SourceView { camera: &self.cameras[view], texture: self.textures[view].get_or_init(texture) }
    }
}
