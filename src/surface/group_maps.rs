//! Depth maps of recent groups ([`mod@super::anchored_depth`]). Photos side by side often have the same
//! neighbours: their groups are the same photos, whose maps are searched once.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, PoisonError};

use super::search::PhotoDepth;

/// Groups whose maps are kept, the last used ones: more than the photos of a picture. The maps of a
/// group take a tenth of the memory of a photo.
const KEPT: usize = 8;

/// Maps of recent groups of a scene, for one depth range.
#[derive(Debug, Default)]
pub(crate) struct GroupMaps {
    /// The last used one first.
    recent: Mutex<VecDeque<KeptGroup>>,
}

#[derive(Debug)]
struct KeptGroup {
    /// Pixels per side of the detail at whose size the photos were searched.
    detail: usize,
    /// The map of each photo of the group, by the photo's index in the scene.
    maps: BTreeMap<usize, PhotoDepth>,
}

impl GroupMaps {
    /// The maps of these photos (indices in the scene, each once), in their order; `search` finds
    /// them unless they are known.
    pub(super) fn get_or_search(
        &self,
        photos: &[usize],
        detail: usize,
        search: impl FnOnce() -> Vec<PhotoDepth>,
    ) -> Vec<PhotoDepth> {
        self.get(photos, detail).unwrap_or_else(|| {
            let found = search();
            let maps = photos.iter().copied().zip(found.iter().cloned()).collect();
            let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
            recent.truncate(KEPT - 1);
            recent.push_front(KeptGroup { detail, maps });
            found
        })
    }

    fn get(&self, photos: &[usize], detail: usize) -> Option<Vec<PhotoDepth>> {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let is_same = |kept: &KeptGroup| {
            kept.detail == detail
                && kept.maps.len() == photos.len()
                && photos.iter().all(|photo| kept.maps.contains_key(photo))
        };
        let at = recent.iter().position(is_same)?;
        let kept = recent.remove(at)?;
        let maps = photos.iter().map(|photo| kept.maps[photo].clone()).collect();
        recent.push_front(kept);
        Some(maps)
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;

    fn map(value: usize) -> PhotoDepth {
        PhotoDepth { disparity: Array2::from_elem((1, 1), value as f32), disparity_per_pixel: 1.0 }
    }

    /// The values of the maps of these photos, and whether they were searched; a search gives each
    /// photo its index and ten times the detail.
    fn found(groups: &GroupMaps, photos: &[usize], detail: usize) -> (Vec<f32>, bool) {
        let mut searched = false;
        let maps = groups.get_or_search(photos, detail, || {
            searched = true;
            photos.iter().map(|photo| map(photo + 10 * detail)).collect()
        });
        (maps.iter().map(|map| map.disparity[(0, 0)]).collect(), searched)
    }

    #[test]
    fn same_photos_in_any_order_are_searched_once() {
        let groups = GroupMaps::default();
        assert_eq!(found(&groups, &[3, 1, 2], 1), (vec![13.0, 11.0, 12.0], true));
        assert_eq!(found(&groups, &[1, 2, 3], 1), (vec![11.0, 12.0, 13.0], false));
        assert_eq!(found(&groups, &[1, 2, 3], 2), (vec![21.0, 22.0, 23.0], true), "another size");
        assert_eq!(found(&groups, &[1, 2], 1), (vec![11.0, 12.0], true), "fewer photos");
        assert_eq!(found(&groups, &[1, 2, 4], 1), (vec![11.0, 12.0, 14.0], true), "another photo");
    }

    #[test]
    fn groups_used_last_are_kept() {
        let groups = GroupMaps::default();
        (0..KEPT).for_each(|photo| assert!(found(&groups, &[photo], 1).1));
        assert!(!found(&groups, &[0], 1).1);
        assert!(found(&groups, &[KEPT], 1).1);
        assert!(!found(&groups, &[0], 1).1, "used after 1");
        assert!(found(&groups, &[1], 1).1, "dropped");
    }
}
