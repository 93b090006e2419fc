//! The depth of a scene's photos: each computed when it is first needed, and kept.

use std::sync::Arc;

use super::{Camera, KnownDepth, PhotoDepth, Settings, SourceView, confirmed, photo_depth};
use crate::geometry::looking_alike;

/// Depth maps of some photos of a scene, which alone take part: a held-out photo is not among them.
#[derive(Debug, Clone)]
pub struct DepthMaps {
    cameras: Vec<Camera>,
    near: f64,
    far: f64,
    settings: Settings,
    found: Vec<Option<Arc<PhotoDepth>>>,
    /// What the maps of the last set confirmed of each other.
    known: Option<(Vec<usize>, Vec<Arc<KnownDepth>>)>,
}

impl DepthMaps {
    /// For photos of these cameras, to be searched from `near` to `far` (0 < near < far, scene units; far may be infinite).
    pub fn new(cameras: Vec<Camera>, near: f64, far: f64, settings: Settings) -> Self {
        let found = vec![None; cameras.len()];
        Self { cameras, near, far, settings, found, known: None }
    }

    /// What it is tuned by.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Nearest and farthest depth searched.
    pub fn range(&self) -> (f64, f64) {
        (self.near, self.far)
    }

    /// Photos that a target is rendered from, nearest first (ties: the earlier): `count`, and as many more as the settings say.
    pub fn photos_for(&self, target: &Camera, count: usize) -> Vec<usize> {
        self.nearest(target, count + self.settings.extra + self.settings.further, None)
    }

    /// Photos that photo `index` is matched with, nearest first.
    pub fn neighbours(&self, index: usize) -> Vec<usize> {
        self.nearest(&self.cameras[index], self.settings.neighbours, Some(index))
    }

    fn nearest(&self, camera: &Camera, count: usize, but: Option<usize>) -> Vec<usize> {
        let cameras: Vec<&Camera> = self.cameras.iter().collect();
        let mut photos = looking_alike(&cameras, camera);
        photos.retain(|&photo| Some(photo) != but);
        photos.truncate(count);
        photos
    }

    /// The photos whose depth a set of photos still lacks.
    pub fn missing(&self, set: &[usize]) -> Vec<usize> {
        set.iter().copied().filter(|&index| self.found[index].is_none()).collect()
    }

    /// The depth of photo `index`, searched now if it is not known; `view` shows it and its neighbours. A photo without
    /// neighbours has none.
    pub fn depth<'a>(&mut self, index: usize, view: impl Fn(usize) -> SourceView<'a>) -> Option<Arc<PhotoDepth>> {
        if self.found[index].is_none() {
            let neighbours: Vec<_> = self.neighbours(index).into_iter().map(&view).collect();
            if neighbours.is_empty() {
                return None;
            }
            let found = photo_depth(&view(index), &neighbours, self.near, self.far, &self.settings);
            self.found[index] = Some(Arc::new(found));
        }
        self.found[index].clone()
    }

    /// Cameras of the photos that take part.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// A depth found elsewhere, such as in a file.
    pub fn insert(&mut self, index: usize, depth: PhotoDepth) {
        self.found[index] = Some(Arc::new(depth));
        self.known = None;
    }

    /// Forgets the depth of all photos but these.
    pub fn retain(&mut self, keep: &[usize]) {
        let others = self.found.iter_mut().enumerate().filter(|(index, _)| !keep.contains(index));
        others.for_each(|(_, found)| *found = None);
        self.known = None;
    }

    /// The depth of photo `index`, if it is known.
    pub fn found(&self, index: usize) -> Option<&PhotoDepth> {
        self.found[index].as_deref()
    }

    /// The depth of photo `index`, and what its neighbours' confirm of it; `None` if its depth is not known. Neighbours whose depth
    /// is not known are left out.
    pub fn confirmed_by_neighbours(&self, index: usize) -> Option<(Arc<PhotoDepth>, KnownDepth)> {
        let found = self.found[index].clone()?;
        let others = self.neighbours(index).into_iter();
        let others = others.filter_map(|other| Some((&self.cameras[other], self.found[other].as_deref()?)));
        let maps: Vec<_> = std::iter::once((&self.cameras[index], &*found)).chain(others).collect();
        let known = KnownDepth::new(&found, &confirmed(0, &maps, &self.settings));
        Some((found, known))
    }

    /// What the maps of these photos confirm of each other, in their order; photos whose depth is not known are left out.
    pub fn known(&mut self, set: &[usize]) -> Vec<(usize, Arc<PhotoDepth>, Arc<KnownDepth>)> {
        let set: Vec<usize> = set.iter().copied().filter(|&index| self.found[index].is_some()).collect();
        let found: Vec<_> = set.iter().filter_map(|&index| self.found[index].clone()).collect();
        if self.known.as_ref().is_none_or(|(of, _)| *of != set) {
            let maps: Vec<_> = set.iter().zip(&found).map(|(&index, map)| (&self.cameras[index], &**map)).collect();
            let one = |k: usize| Arc::new(KnownDepth::new(&found[k], &confirmed(k, &maps, &self.settings)));
            let known = (0..set.len()).map(one).collect();
            self.known = Some((set.clone(), known));
        }
        let known = self.known.iter().flat_map(|(_, known)| known.iter().cloned());
        set.into_iter().zip(found).zip(known).map(|((index, found), known)| (index, found, known)).collect()
    }
}
