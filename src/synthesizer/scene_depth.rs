//! The depth of a scene's photos, kept for all pictures of a run, and the surface of a target from it.

use std::time::{Duration, Instant};

use super::photo_depths::{DepthSource, ViewDepth};
use super::target::Shot;
use crate::scene::Scene;
use crate::surface::cache::{DepthKey, PhotoDigest};
use crate::surface::{DepthMaps, PhotoCorrection, PhotoDepth, TargetSurface};
use crate::warp::SourceView;

/// Depth maps of the views that may take part.
pub(super) struct SceneDepth {
    maps: DepthMaps,
    /// Views of the maps' photos.
    free: Vec<usize>,
    held_out: Vec<usize>,
    /// How the depth of each of them was found, and in what time.
    sources: Vec<(DepthSource, Duration)>,
}

impl SceneDepth {
    pub(super) fn new(scene: &Scene, free: Vec<usize>, held_out: Vec<usize>, (near, far): (f64, f64)) -> Self {
        let cameras = free.iter().map(|&view| scene.views[view].camera.clone()).collect();
        let sources = vec![(DepthSource::Alone, Duration::ZERO); free.len()];
        Self { maps: DepthMaps::new(cameras, near, far), free, held_out, sources }
    }

    /// Whether exactly these views are held out.
    pub(super) fn serves(&self, held_out: &[usize]) -> bool {
        self.held_out == held_out
    }

    /// Index of a view among the photos that take part.
    fn photo(&self, view: usize) -> usize {
        self.taking_part(view).expect("a view that is not held out")
    }

    fn taking_part(&self, view: usize) -> Option<usize> {
        self.free.iter().position(|&free| free == view)
    }

    /// A view and those whose photos its own is matched with, nearest first.
    pub(super) fn with_neighbours(&self, view: usize) -> Vec<usize> {
        let neighbours = self.maps.neighbours(self.photo(view)).into_iter().map(|photo| self.free[photo]);
        std::iter::once(view).chain(neighbours).collect()
    }

    /// The views whose photos are needed to search the depth of one, itself first; none if it is known.
    pub(super) fn photos_to_search(&self, view: usize) -> Vec<usize> {
        if self.maps.missing(&[self.photo(view)]).is_empty() { Vec::new() } else { self.with_neighbours(view) }
    }

    /// What identifies the depth of the first view's photo, searched among the others; their digests.
    pub(super) fn key(&self, views: &[usize], digests: &[PhotoDigest]) -> DepthKey {
        let cameras = views.iter().map(|&view| &self.maps.cameras()[self.photo(view)]);
        let photos: Vec<_> = cameras.zip(digests.iter().copied()).collect();
        DepthKey::new(&photos, self.maps.range())
    }

    /// The depth of a view's photo, if it is known.
    pub(super) fn found(&self, view: usize) -> Option<&PhotoDepth> {
        self.maps.get(self.photo(view))
    }

    /// Takes the depth of a view's photo as found.
    pub(super) fn insert(&mut self, view: usize, found: PhotoDepth, source: DepthSource, time: Duration) {
        let photo = self.photo(view);
        self.maps.insert(photo, found);
        self.sources[photo] = (source, time);
    }

    /// Searches the depth of a view's photo, unless it is known. A photo without neighbours has none that anything confirms.
    pub(super) fn search<'a>(&mut self, view: usize, source: impl Fn(usize) -> SourceView<'a>) {
        let photo = self.photo(view);
        if self.maps.missing(&[photo]).is_empty() {
            return;
        }
        let (free, started) = (&self.free, Instant::now());
        if self.maps.depth(photo, |photo| source(free[photo])).is_some() {
            self.sources[photo] = (DepthSource::Searched, started.elapsed());
        } else {
            let size = source(view).camera.size();
            self.insert(view, PhotoDepth::unknown(size), DepthSource::Alone, started.elapsed());
        }
    }

    /// The depth of a view's photo, and what is confirmed of it.
    ///
    /// # Panics
    ///
    /// If it is not known.
    pub(super) fn view_depth(&mut self, view: usize) -> ViewDepth {
        let photo = self.photo(view);
        let (found, known) = self.maps.confirmed_by_neighbours(photo).expect("searched before");
        let (source, time) = self.sources[photo];
        ViewDepth { found, known, range: self.maps.range(), source, time }
    }

    /// Forgets the depth of all views but these, and what confirms it unless it is needed `soon`.
    pub(super) fn retain(&mut self, views: &[usize], soon: &[usize]) {
        let photos = |views: &[usize]| views.iter().filter_map(|&view| self.taking_part(view)).collect::<Vec<_>>();
        let (keep, soon) = (photos(views), photos(soon));
        self.maps.retain(&keep, &soon);
    }

    /// Bytes of the depth of a view's photo; 0 if it is not known.
    pub(super) fn bytes(&self, view: usize) -> usize {
        let found = self.taking_part(view).and_then(|photo| self.maps.get(photo));
        found.map_or(0, |found| size_of_val(found.disparity.as_slice().expect("standard order")))
    }

    /// The surface of a target, from the photos of these views: the first are those that it is rendered from.
    pub(super) fn surface<'a>(
        &mut self,
        shot: &Shot,
        set: &[usize],
        source: impl Fn(usize) -> SourceView<'a>,
        photo_correction: PhotoCorrection,
    ) -> TargetSurface {
        let photos: Vec<_> = set.iter().map(|&view| (self.photo(view), source(view))).collect();
        TargetSurface::find(&mut self.maps, &photos, shot.views.len(), &shot.target, photo_correction)
    }
}
