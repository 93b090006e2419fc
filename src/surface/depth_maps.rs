//! The depth of a scene's photos: each computed when it is first needed, and kept.

use std::collections::HashMap;
use std::sync::Arc;

use super::correction::PairStatistics;
use super::fusion::{ConfirmedDepth, ConsistencyVotes, confirmed};
use super::search::{PhotoDepth, photo_depth};
use super::settings::Settings;
use crate::geometry::{Camera, looking_alike};
use crate::warp::SourceView;

/// Depth maps of some photos of a scene, which alone take part: a held-out photo is not among them.
#[derive(Debug, Clone)]
pub struct DepthMaps {
    cameras: Vec<Camera>,
    near: f64,
    far: f64,
    settings: Settings,
    found: Vec<Option<Arc<PhotoDepth>>>,
    /// What the map of one photo says of another's: `[the other, the one]`.
    opinions: HashMap<[usize; 2], ConsistencyVotes>,
    /// What the maps of the last set confirmed of each other.
    known: Option<HashMap<usize, Arc<ConfirmedDepth>>>,
    /// Of the photos of that set.
    statistics: PairStatistics,
}

impl DepthMaps {
    /// For photos of these cameras, to be searched from `near` to `far` (0 < near < far, scene units; far may be infinite).
    pub fn new(cameras: Vec<Camera>, near: f64, far: f64, settings: Settings) -> Self {
        let found = vec![None; cameras.len()];
        let statistics = PairStatistics::default();
        Self { cameras, near, far, settings, found, opinions: HashMap::new(), known: None, statistics }
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
        self.nearest(target, count + self.settings.extra, None)
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
        self.opinions.retain(|pair, _| !pair.contains(&index));
        self.known = None;
    }

    /// Forgets the depth of all photos but these, and what maps say of each other unless both are needed `soon`.
    pub fn retain(&mut self, keep: &[usize], soon: &[usize]) {
        let others = self.found.iter_mut().enumerate().filter(|(index, _)| !keep.contains(index));
        others.for_each(|(_, found)| *found = None);
        self.opinions.retain(|pair, _| pair.iter().all(|photo| keep.contains(photo) && soon.contains(photo)));
        self.known = self.known.take().filter(|known| known.keys().all(|photo| keep.contains(photo)));
    }

    /// The depth of photo `index`, if it is known.
    pub fn found(&self, index: usize) -> Option<&PhotoDepth> {
        self.found[index].as_deref()
    }

    /// The depth of photo `index`, and what its neighbours' confirm of it; `None` if its depth is not known. Neighbours whose depth
    /// is not known are left out.
    pub fn confirmed_by_neighbours(&mut self, index: usize) -> Option<(Arc<PhotoDepth>, ConfirmedDepth)> {
        let found = self.found[index].clone()?;
        let known = self.confirmed_by(index, &self.neighbours(index));
        Some((found, known))
    }

    /// What the maps of these photos confirm of each other, in their order; photos whose depth is not known are left out.
    pub fn known(&mut self, set: &[usize]) -> Vec<Arc<ConfirmedDepth>> {
        let set: Vec<usize> = set.iter().copied().filter(|&index| self.found[index].is_some()).collect();
        let known =
            self.known.take().filter(|known| known.len() == set.len() && set.iter().all(|i| known.contains_key(i)));
        let known = known.unwrap_or_else(|| {
            self.statistics = PairStatistics::default();
            set.iter().map(|&index| (index, Arc::new(self.confirmed_by(index, &set)))).collect::<HashMap<_, _>>()
        });
        let in_order = set.iter().map(|index| Arc::clone(&known[index])).collect();
        self.known = Some(known);
        in_order
    }

    /// What pairs of photos of the last set that [`Self::known`] was asked for tell.
    pub(super) fn statistics(&mut self) -> &mut PairStatistics {
        &mut self.statistics
    }

    /// What the maps of `others` confirm of the photo's own, which is known.
    fn confirmed_by(&mut self, index: usize, others: &[usize]) -> ConfirmedDepth {
        let found = self.found[index].as_ref().expect("known");
        let maps = others.iter().filter(|&&other| other != index);
        let maps: Vec<_> = maps.filter_map(|&other| Some((other, self.found[other].as_ref()?))).collect();
        for &(other, map) in &maps {
            let opinion = || {
                let (camera, other_camera) = (&self.cameras[index], &self.cameras[other]);
                ConsistencyVotes::new((camera, found), (other_camera, map), &self.settings)
            };
            self.opinions.entry([other, index]).or_insert_with(opinion);
        }
        let opinions: Vec<_> = maps.iter().map(|(other, _)| &self.opinions[&[*other, index]]).collect();
        ConfirmedDepth::new(found, &confirmed(&opinions, found.disparity.dim()))
    }
}
