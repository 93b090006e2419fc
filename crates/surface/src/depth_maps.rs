//! Depth maps of a scene's photos, and what they confirm of each other. The votes of
//! photos on each other are kept from target to target: a viewpoint that comes back to photos that it has
//! left finds them.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use crate::consistency::{confirmed, confirmed_by};
use crate::correction::PairStatistics;
use crate::nearer_edges::nearer_edges;
use crate::{ConfirmedDisparity, ConsistencyVotes, PhotoDisparity};
use liveview::geometry::{Camera, facing_alike};
use liveview::warp::SourceView;

/// Number of neighbours that a photo is matched with.
pub const NEIGHBOURS: usize = 5;
/// Number of photos beyond the V of a picture whose depth its surface is fused from.
pub const EXTRA_PHOTOS: usize = 2;

/// Bytes of votes that stay beyond those that are needed soon.
const KEPT_VOTES: usize = 64 << 20;

/// Depth maps of the photos of a scene.
#[derive(Debug, Clone, Default)]
pub struct DepthMaps {
    cameras: Vec<Camera>,
    /// Indices of photos that take no part.
    pub held_out: Vec<usize>,
    /// Nearest and farthest depth searched, scene units.
    range: (f64, f64),
    maps: Vec<Option<Arc<PhotoDisparity>>>,
    votes: KeptVotes,
    /// Depths that the maps of the last set confirmed among each other, with the colours that its photos
    /// had then.
    confirmed: Option<HashMap<usize, Arc<ConfirmedDisparity>>>,
    /// Mean share of the pixels of that set which are confirmed.
    pub(crate) confirmed_share: f64,
    /// Of the photos of that set.
    pub(crate) statistics: PairStatistics,
    /// Whether the photos are those of time steps ([`Self::update`]), and their number.
    pub(crate) follows: bool,
    steps: usize,
    pub(crate) correction: Option<KeptCorrection>,
}

/// Photos, in order, with their gains and sharpening.
pub(crate) type KeptCorrection = (Vec<usize>, Vec<[f32; 3]>, Vec<f32>);

/// Steps after which photos are compared again.
const CORRECTION_STEPS: usize = 8;

impl DepthMaps {
    /// For photos of these cameras, to be searched from `near` to `far` (0 < near < far, scene
    /// units; far may be infinite).
    pub fn new(cameras: Vec<Camera>, near: f64, far: f64) -> Self {
        let maps = vec![None; cameras.len()];
        Self { cameras, range: (near, far), maps, ..Self::default() }
    }

    /// The cameras.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// Nearest and farthest depth searched, scene units.
    pub fn range(&self) -> (f64, f64) {
        self.range
    }

    /// Photos that photo `index` is matched with, nearest first (ties: the earlier).
    pub fn neighbours(&self, index: usize) -> Vec<usize> {
        let cameras: Vec<&Camera> = self.cameras.iter().collect();
        let mut photos = facing_alike(&cameras, &self.cameras[index]);
        photos.retain(|photo| *photo != index && !self.held_out.contains(photo));
        photos.truncate(NEIGHBOURS);
        photos
    }

    /// Sets the depth of photo `index`, such as one read from a file.
    pub fn insert(&mut self, index: usize, depth: PhotoDisparity) {
        self.maps[index] = Some(Arc::new(depth));
        self.votes.drop_photo(index);
        self.confirmed = None;
    }

    /// Sets the depths of photos of a time step. Depth is not moved at edges from then on: pictures in motion
    /// do not gain by it. Exposure and sharpness of the photos are compared in every eighth step, and in one
    /// that is `new`: a cut.
    pub fn update(&mut self, depths: impl Iterator<Item = (usize, PhotoDisparity)>, new: bool) {
        depths.for_each(|(index, depth)| self.insert(index, depth));
        (self.follows, self.steps) = (true, self.steps + 1);
        self.correction = self.correction.take().filter(|_| !new && !self.steps.is_multiple_of(CORRECTION_STEPS));
    }

    /// Drops the depth of all photos but `keep`, and what compares it; of that between photos of which one
    /// is not needed `soon`, 64 MiB stay.
    pub fn retain(&mut self, keep: &[usize], soon: &[usize]) {
        let others = self.maps.iter_mut().enumerate().filter(|(index, _)| !keep.contains(index));
        others.for_each(|(_, map)| *map = None);
        self.votes.retain(keep, soon, KEPT_VOTES);
        self.confirmed = self.confirmed.take().filter(|confirmed| confirmed.keys().all(|photo| keep.contains(photo)));
    }

    /// The depth of photo `index`, unless it is missing.
    pub fn get(&self, index: usize) -> Option<&PhotoDisparity> {
        self.maps[index].as_deref()
    }

    /// The depth of photo `index`, and where its neighbours' depths confirm it; `None` if it is
    /// missing. Neighbours without depth are left out.
    pub fn confirmed_by_neighbours(&mut self, index: usize) -> Option<(Arc<PhotoDisparity>, ConfirmedDisparity)> {
        let depth = self.maps[index].clone()?;
        let confirmed = self.confirmed_by(index, &self.neighbours(index));
        Some((depth, confirmed))
    }

    /// The depth of the first of these photos (indices with cameras and photos), moved to the nearer side at edges where the
    /// others show that ([`nearer_edges`]), and where their depths confirm it. All have depth.
    ///
    /// # Panics
    ///
    /// If there are no photos, or one is without depth.
    pub fn nearer_by_others(
        &mut self,
        photos: &[(usize, SourceView<'_>)],
    ) -> (Arc<PhotoDisparity>, ConfirmedDisparity) {
        let set: Vec<usize> = photos.iter().map(|&(index, _)| index).collect();
        let confirmed = self.confirmed_by(set[0], &set);
        let depth = |index: usize| &**self.maps[index].as_ref().expect("a photo with depth");
        let found: Vec<_> = photos.iter().map(|&(index, view)| (view, depth(index))).collect();
        let nearer = nearer_edges(&found, 0, &confirmed);
        let others = found[1..].iter().map(|&(view, depth)| (view.camera, depth));
        let confirmed = confirmed_by((found[0].0.camera, &nearer), others);
        (Arc::new(nearer), confirmed)
    }

    /// The depths of these photos (indices with cameras and photos), in their order, where they confirm
    /// each other; photos without depth are left out. At edges, depth is moved to the nearer side where
    /// others of the set show that ([`nearer_edges`]).
    pub fn mutually_confirmed(&mut self, photos: &[(usize, SourceView<'_>)]) -> Vec<Arc<ConfirmedDisparity>> {
        let photos: Vec<_> = photos.iter().copied().filter(|&(index, _)| self.maps[index].is_some()).collect();
        let set: Vec<usize> = photos.iter().map(|&(index, _)| index).collect();
        let of_this_set = |confirmed: &HashMap<usize, _>| {
            confirmed.len() == set.len() && set.iter().all(|photo| confirmed.contains_key(photo))
        };
        let confirmed = self.confirmed.take().filter(of_this_set).unwrap_or_else(|| {
            self.statistics = PairStatistics::default();
            let confirmed = self.with_nearer_edges(&photos);
            let shares = confirmed.iter().map(|(_, confirmed)| confirmed.share());
            self.confirmed_share = shares.sum::<f64>() / confirmed.len().max(1) as f64;
            confirmed.into_iter().map(|(index, confirmed)| (index, Arc::new(confirmed))).collect()
        });
        let in_order = set.iter().map(|index| Arc::clone(&confirmed[index])).collect();
        self.confirmed = Some(confirmed);
        in_order
    }

    /// The depths of these photos, moved to the nearer side at edges, where they confirm each other; sorted
    /// by index: photos are passed by their distance from the target, and sums depend on the order.
    fn with_nearer_edges(&mut self, photos: &[(usize, SourceView<'_>)]) -> Vec<(usize, ConfirmedDisparity)> {
        let mut photos = photos.to_vec();
        photos.sort_unstable_by_key(|&(index, _)| index);
        photos.dedup_by_key(|&mut (index, _)| index);
        let set: Vec<usize> = photos.iter().map(|&(index, _)| index).collect();
        let confirmed: Vec<_> = set.iter().map(|&index| self.confirmed_by(index, &set)).collect();
        if self.follows {
            return set.iter().copied().zip(confirmed).collect();
        }
        let depth = |index: usize| &**self.maps[index].as_ref().expect("a photo with depth");
        let found: Vec<_> = photos.iter().map(|&(index, view)| (view, depth(index))).collect();
        // One photo after another: each is computed in parallel, and allocates several maps of its size.
        let nearer: Vec<PhotoDisparity> =
            confirmed.iter().enumerate().map(|(which, confirmed)| nearer_edges(&found, which, confirmed)).collect();
        let map = |which: usize| (found[which].0.camera, &nearer[which]);
        let others = |which: usize| (0..found.len()).filter(move |&other| other != which).map(map);
        let confirmed = |which: usize| (set[which], confirmed_by(map(which), others(which)));
        (0..found.len()).into_par_iter().map(confirmed).collect()
    }

    /// Where the maps of `others` confirm that of photo `index`, which is not missing.
    fn confirmed_by(&mut self, index: usize, others: &[usize]) -> ConfirmedDisparity {
        let depth = self.maps[index].as_ref().expect("a photo with depth");
        let others = others.iter().copied();
        let voters: Vec<usize> = others.filter(|&other| other != index && self.maps[other].is_some()).collect();
        let map = |index: usize| (&self.cameras[index], &**self.maps[index].as_ref().expect("a photo with depth"));
        let votes = self.votes.get_or_compute(index, &voters, |other| ConsistencyVotes::new(map(index), map(other)));
        ConfirmedDisparity::new(depth, &confirmed(&votes, depth.disparity.dim()))
    }
}

/// Votes of the map of one photo on another's, by `[voter, judged]`, with the number of the request that used them last.
#[derive(Debug, Clone, Default)]
struct KeptVotes {
    votes: HashMap<[usize; 2], (u64, ConsistencyVotes)>,
    requests: u64,
}

impl KeptVotes {
    /// The votes of the maps of these photos on that of photo `judged`; missing ones are computed.
    pub(crate) fn get_or_compute(
        &mut self,
        judged: usize,
        voters: &[usize],
        compute: impl Fn(usize) -> ConsistencyVotes,
    ) -> Vec<&ConsistencyVotes> {
        self.requests += 1;
        for &voter in voters {
            let votes = self.votes.entry([voter, judged]).or_insert_with(|| (0, compute(voter)));
            votes.0 = self.requests;
        }
        voters.iter().map(|&voter| &self.votes[&[voter, judged]].1).collect()
    }

    /// Drops the votes on a photo's map and those of it.
    fn drop_photo(&mut self, photo: usize) {
        self.votes.retain(|pair, _| !pair.contains(&photo));
    }

    /// Drops the votes between photos that are not all in `keep`, and of those not all in `soon` the ones
    /// used longest ago, beyond `bytes`.
    fn retain(&mut self, keep: &[usize], soon: &[usize], bytes: usize) {
        self.votes.retain(|pair, _| pair.iter().all(|photo| keep.contains(photo)));
        let later = self.votes.iter().filter(|(pair, _)| !pair.iter().all(|photo| soon.contains(photo)));
        let mut later: Vec<_> = later.map(|(&pair, (used, votes))| (Reverse(*used), pair, votes.bytes())).collect();
        later.sort_unstable();
        let mut left = bytes;
        for (_, pair, bytes) in later {
            match left.checked_sub(bytes) {
                Some(rest) => left = rest,
                None => drop(self.votes.remove(&pair)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use glam::DVec3;

    use super::*;
    use crate::photo_depth::PhotoDisparity;
    use liveview::geometry::Camera;
    use liveview::geometry::Intrinsics;

    #[test]
    fn votes_used_last_stay() {
        let intrinsics = Intrinsics { fx: 4.0, fy: 4.0, cx: 4.0, cy: 2.0, skew: 0.0 };
        let camera = Camera::new(intrinsics, 8, 4, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let depth = PhotoDisparity::unknown(camera.size());
        let compute = |_| ConsistencyVotes::new((&camera, &depth), (&camera, &depth));
        let mut votes = KeptVotes::default();
        votes.get_or_compute(0, &[1, 2, 3], compute);
        votes.get_or_compute(4, &[1, 2], compute);
        votes.get_or_compute(0, &[1], compute);
        let bytes = compute(0).bytes();
        let known = |votes: &KeptVotes| {
            let mut pairs: Vec<_> = votes.votes.keys().copied().collect();
            pairs.sort_unstable();
            pairs
        };
        votes.retain(&[0, 1, 2, 4], &[2, 4], bytes);
        assert_eq!(known(&votes), [[1, 0], [2, 4]], "used last, and needed soon");
        votes.drop_photo(0);
        assert_eq!(known(&votes), [[2, 4]]);
    }

    #[test]
    fn votes_are_those_of_the_other_photo_and_are_cast_again_for_a_new_depth() {
        let intrinsics = Intrinsics { fx: 4.0, fy: 4.0, cx: 4.0, cy: 2.0, skew: 0.0 };
        let camera = Camera::new(intrinsics, 8, 4, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let mut maps = DepthMaps::new(vec![camera.clone(), camera], 1.0, 100.0);
        let depth = |disparity, disparity_per_pixel| PhotoDisparity {
            disparity: ndarray::Array2::from_elem((4, 8), disparity),
            disparity_per_pixel,
        };
        let shares = |maps: &mut DepthMaps| [0, 1].map(|photo| maps.confirmed_by_neighbours(photo).unwrap().1.share());
        // 0.3 apart: within two pixels of the first photo, not of the second.
        maps.insert(0, depth(0.2, 0.2));
        maps.insert(1, depth(0.5, 0.01));
        assert_eq!(shares(&mut maps), [1.0, 0.0]);
        maps.insert(1, depth(0.2, 0.01));
        assert_eq!(shares(&mut maps), [1.0, 1.0]);
        maps.insert(0, depth(0.9, 0.01));
        assert_eq!(shares(&mut maps), [0.0, 0.0]);
    }
}
