//! The depth of a scene's photos, with some views held out.

use std::sync::Arc;
use std::time::Duration;

use crate::error::SynthesisError;
use crate::scene_views::SceneViews;
use liveview_surface::{ConfirmedDepth, DepthMaps, PhotoDepth, SmallMaps};

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
pub(super) struct SceneDepth {
    pub(super) maps: DepthMaps,
    /// What searches share.
    pub(super) small_maps: Arc<SmallMaps>,
    /// Views of the maps' photos.
    free: Vec<usize>,
    pub(super) held_out: Vec<usize>,
    /// How the depth of each of them was found, and in what time.
    pub(super) sources: Vec<(DepthSource, Duration)>,
}

impl SceneDepth {
    /// Of the views that are not held out; no depth is known yet.
    pub(super) fn new(views: &SceneViews, held_out: &[usize]) -> Result<Self, SynthesisError> {
        let free = views.all_but(held_out);
        let (near, far) = views.depth_range(&free, held_out)?;
        let maps = DepthMaps::new(views.cameras(&free).cloned().collect(), near, far);
        let sources = vec![(DepthSource::Alone, Duration::ZERO); free.len()];
        Ok(Self { maps, small_maps: Arc::default(), free, held_out: held_out.to_vec(), sources })
    }

    /// Index of a view's photo among the maps'.
    pub(super) fn map_index(&self, view: usize) -> usize {
        self.find_map_index(view).expect("a view that is not held out")
    }

    pub(super) fn find_map_index(&self, view: usize) -> Option<usize> {
        self.free.iter().position(|&free| free == view)
    }

    /// A view and those whose photos its own is matched with, nearest first.
    pub(super) fn with_neighbours(&self, view: usize) -> Vec<usize> {
        let neighbours = self.maps.neighbours(self.map_index(view)).into_iter().map(|index| self.free[index]);
        std::iter::once(view).chain(neighbours).collect()
    }

    /// The depth of a view's photo, if it is known.
    pub(super) fn found(&self, view: usize) -> Option<&PhotoDepth> {
        self.maps.get(self.map_index(view))
    }

    /// Drops the depth of all views but these, and what confirms it unless it is needed `soon`.
    pub(super) fn retain(&mut self, views: &[usize], soon: &[usize]) {
        let indices = |views: &[usize]| views.iter().filter_map(|&view| self.find_map_index(view)).collect::<Vec<_>>();
        let (keep, soon) = (indices(views), indices(soon));
        self.maps.retain(&keep, &soon);
    }

    /// Bytes of the depth of a view's photo; 0 if it is unknown.
    pub(super) fn bytes(&self, view: usize) -> usize {
        let found = self.find_map_index(view).and_then(|index| self.maps.get(index));
        found.map_or(0, |found| size_of_val(found.disparity.as_slice().expect("standard order")))
    }
}
