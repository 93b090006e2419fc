//! The photos of a scene that are in memory.

use std::sync::Arc;

use rayon::prelude::*;

use super::shot::LoadedPhoto;
use liveview::warp::Texture;
use liveview_scene::{Scene, SceneError};

/// The photos of a scene that are in memory, by view.
pub(super) struct PhotoStore {
    textures: Vec<Option<Arc<Texture>>>,
}

impl PhotoStore {
    /// Without a photo yet, for a scene of so many views.
    pub(super) fn new(views: usize) -> Self {
        Self { textures: vec![None; views] }
    }

    /// The photos of views of the store's scene, those that are not in memory read from their files
    /// side by side. Of several errors it is the first view's.
    pub(super) fn load(&mut self, scene: &Scene, views: &[usize]) -> Result<Vec<LoadedPhoto>, SceneError> {
        let load = |&view: &usize| LoadedPhoto::read(scene, view, self.textures[view].as_ref());
        let loaded: Vec<_> = views.par_iter().map(load).collect();
        let store = |photo: Result<LoadedPhoto, SceneError>| {
            photo.inspect(|photo| self.textures[photo.view] = Some(Arc::clone(&photo.texture)))
        };
        loaded.into_iter().map(store).collect()
    }

    /// The photo of a view, if it is in memory.
    pub(super) fn get(&self, view: usize) -> Option<Arc<Texture>> {
        self.textures[view].clone()
    }

    /// Takes the photo of a view, unless it is in memory.
    pub(super) fn insert(&mut self, view: usize, texture: &Arc<Texture>) {
        self.textures[view].get_or_insert_with(|| Arc::clone(texture));
    }

    /// The views whose photos are in memory.
    pub(super) fn loaded(&self) -> impl Iterator<Item = usize> {
        self.textures.iter().enumerate().filter_map(|(view, texture)| texture.as_ref().map(|_| view))
    }

    /// Bytes of a view's photo; 0 if it is not in memory.
    pub(super) fn bytes(&self, view: usize) -> usize {
        self.textures[view].as_ref().map_or(0, |texture| texture.bytes())
    }

    /// Drops the photos of all views but those that `keep` names.
    pub(super) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let dropped = self.textures.iter_mut().enumerate().filter(|(view, _)| !keep(*view));
        dropped.for_each(|(_, texture)| *texture = None);
    }
}
