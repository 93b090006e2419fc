//! The depth of a scene's photos, with some views held out.

use std::sync::Arc;
use std::time::Duration;

use crate::kinds::PhotosWithDepth;
use crate::scene::Scene;
use crate::surface::{Comparison, ConfirmedDepth, DepthMaps, PhotoDepth, SmallMaps, Votes};
use crate::warp::SourceView;

/// How the depth of a photo was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthSource {
    /// Searched among the photo's neighbours.
    Searched,
    /// Read from the folder of [`crate::ScenePhotos::keep_depths_in`].
    Kept,
    /// There is no other photo to search it with: nothing is confirmed.
    Alone,
}

/// The depth of a view's photo.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ViewDepth {
    /// What the search found.
    pub found: Arc<PhotoDepth>,
    /// Of that, what the depths of the photo's neighbours confirm.
    pub confirmed: ConfirmedDepth,
    /// Nearest and farthest depth searched, scene units.
    pub range: (f64, f64),
    /// How it was found.
    pub source: DepthSource,
    /// Wall time of that, without loading photos and taking their digests.
    pub time: Duration,
}

/// The next photo whose depth is searched ([`crate::ScenePhotos::on_depth_search`]).
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct DepthProgress<'a> {
    /// The name of its view.
    pub name: &'a str,
    /// How many photos have been searched before it, of those that are needed now.
    pub done: usize,
    /// How many are needed now.
    pub count: usize,
}

/// Depth maps of the views that are not held out.
pub(in crate::synthesizer) struct SceneDepth {
    maps: DepthMaps,
    small_maps: Arc<SmallMaps>,
    /// Views of the maps' photos.
    free: Vec<usize>,
    held_out: Vec<usize>,
    /// How the depth of each of them was found, and in what time.
    sources: Vec<(DepthSource, Duration)>,
}

impl SceneDepth {
    pub(in crate::synthesizer) fn new(
        scene: &Scene,
        free: Vec<usize>,
        held_out: Vec<usize>,
        (near, far): (f64, f64),
    ) -> Self {
        let cameras = free.iter().map(|&view| scene.views[view].camera.clone()).collect();
        let sources = vec![(DepthSource::Alone, Duration::ZERO); free.len()];
        Self { maps: DepthMaps::new(cameras, near, far), small_maps: Arc::default(), free, held_out, sources }
    }

    /// Whether exactly these views are held out.
    pub(in crate::synthesizer) fn serves(&self, held_out: &[usize]) -> bool {
        self.held_out == held_out
    }

    /// Index of a view's photo among the maps'.
    fn map_index(&self, view: usize) -> usize {
        self.find_map_index(view).expect("a view that is not held out")
    }

    fn find_map_index(&self, view: usize) -> Option<usize> {
        self.free.iter().position(|&free| free == view)
    }

    /// A view and those whose photos its own is matched with, nearest first.
    pub(in crate::synthesizer) fn with_neighbours(&self, view: usize) -> Vec<usize> {
        let neighbours = self.maps.neighbours(self.map_index(view)).into_iter().map(|index| self.free[index]);
        std::iter::once(view).chain(neighbours).collect()
    }

    /// The views whose photos are needed to search the depth of one, itself first; none if it is
    /// known.
    pub(in crate::synthesizer) fn photos_to_search(&self, view: usize) -> Vec<usize> {
        if self.found(view).is_some() { Vec::new() } else { self.with_neighbours(view) }
    }

    /// The views that are held out.
    pub(in crate::synthesizer) fn held_out(&self) -> &[usize] {
        &self.held_out
    }

    /// Nearest and farthest depth searched, scene units.
    pub(in crate::synthesizer) fn range(&self) -> (f64, f64) {
        self.maps.range()
    }

    /// What searches share.
    pub(in crate::synthesizer) fn small_maps(&self) -> Arc<SmallMaps> {
        Arc::clone(&self.small_maps)
    }

    /// The depth of a view's photo, if it is known.
    pub(in crate::synthesizer) fn found(&self, view: usize) -> Option<&PhotoDepth> {
        self.maps.get(self.map_index(view))
    }

    /// Takes the depth of a view's photo as found, with the votes of its [`Self::comparison`].
    pub(in crate::synthesizer) fn insert(
        &mut self,
        view: usize,
        (found, votes): (PhotoDepth, Votes),
        source: DepthSource,
        time: Duration,
    ) {
        let index = self.map_index(view);
        self.maps.insert_compared(index, found, votes);
        self.sources[index] = (source, time);
    }

    /// The depth of a view's photo, and what is confirmed of it; `None` if it is unknown yet.
    pub(in crate::synthesizer) fn view_depth(&mut self, view: usize) -> Option<ViewDepth> {
        let index = self.map_index(view);
        let (found, confirmed) = self.maps.confirmed_by_neighbours(index)?;
        let (source, time) = self.sources[index];
        Some(ViewDepth { found, confirmed, range: self.maps.range(), source, time })
    }

    /// What compares the depth of a view's photo with those that are known of other views' photos.
    pub(in crate::synthesizer) fn comparison(&self, view: usize, others: &[usize]) -> Comparison {
        let others: Vec<usize> = others.iter().filter_map(|&view| self.find_map_index(view)).collect();
        self.maps.comparison(self.map_index(view), &others)
    }

    /// Drops the depth of all views but these, and what confirms it unless it is needed `soon`.
    pub(in crate::synthesizer) fn retain(&mut self, views: &[usize], soon: &[usize]) {
        let indices = |views: &[usize]| views.iter().filter_map(|&view| self.find_map_index(view)).collect::<Vec<_>>();
        let (keep, soon) = (indices(views), indices(soon));
        self.maps.retain(&keep, &soon);
    }

    /// Bytes of the depth of a view's photo; 0 if it is unknown.
    pub(in crate::synthesizer) fn bytes(&self, view: usize) -> usize {
        let found = self.find_map_index(view).and_then(|index| self.maps.get(index));
        found.map_or(0, |found| size_of_val(found.disparity.as_slice().expect("standard order")))
    }

    /// The photos of these views with their depth; a target is rendered from the first ones.
    pub(in crate::synthesizer) fn with_depth<'a>(
        &'a mut self,
        photos: &[(usize, SourceView<'a>)],
        rendered_from: usize,
    ) -> PhotosWithDepth<'a> {
        let photos = photos.iter().map(|&(view, source)| (self.map_index(view), source)).collect();
        PhotosWithDepth { maps: &mut self.maps, photos, rendered_from, searched: 1.0 }
    }
}
