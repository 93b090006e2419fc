//! Maps of photos at a small size ([`mod@super::anchored_depth`]): each photo is searched once among its
//! neighbours, whichever photo's search needs its map. A picture of a scene of 50 photos takes 0.63 of
//! the processor time that it took when each photo was searched once in every group
//! (docs/design-log/speed.md).

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::search::PhotoDepth;
use super::search::cell_search::CellSearch;
use liveview::geometry::Camera;
use liveview::warp::{SourceView, Texture};

/// Pixels per side of a cell of a map.
pub(crate) const SMALL_CELL: usize = 4;
/// The same of the search before it, where there are many planes.
const LARGER_CELL: usize = 8;
/// Maps and small photos that are kept, those used last. A map takes 1/64 of the memory of a photo, a
/// small photo 5/64.
const KEPT_MAPS: usize = 64;
const KEPT_PHOTOS: usize = 24;

/// A photo by cells.
#[derive(Debug)]
pub struct SmallPhoto {
    /// Of the full size.
    camera: Camera,
    by_cells: Texture,
    by_larger_cells: Texture,
}

impl SmallPhoto {
    pub(crate) fn new(view: &SourceView<'_>) -> Self {
        let [by_cells, by_larger_cells] = [SMALL_CELL, LARGER_CELL].map(|cell| view.texture.shrunk(cell));
        Self { camera: view.camera.clone(), by_cells, by_larger_cells }
    }
}

/// The depth `[h/4, w/4]` of the first of these photos, searched among the others (at least one) from
/// near to far (scene units).
pub(super) fn small_map(photos: &[&SmallPhoto], range: (f64, f64)) -> PhotoDepth {
    let by_cells = views(photos, |photo| &photo.by_cells);
    let coarser = || {
        let by_larger_cells = views(photos, |photo| &photo.by_larger_cells);
        Some(CellSearch::new(&by_larger_cells, LARGER_CELL, range, || None).depth())
    };
    CellSearch::new(&by_cells, SMALL_CELL, range, coarser).depth()
}

fn views<'a>(photos: &[&'a SmallPhoto], texture: fn(&SmallPhoto) -> &Texture) -> Vec<SourceView<'a>> {
    photos.iter().map(|photo| SourceView { camera: &photo.camera, texture: texture(photo) }).collect()
}

/// Maps of a scene's photos for one depth range, and the small photos; by the photo's index in the
/// scene and the pixels per side of the detail at whose size it was searched.
#[derive(Debug)]
pub struct SmallMaps {
    maps: Recent<PhotoDepth>,
    photos: Recent<SmallPhoto>,
}

impl Default for SmallMaps {
    fn default() -> Self {
        Self { maps: Recent::new(KEPT_MAPS), photos: Recent::new(KEPT_PHOTOS) }
    }
}

impl SmallMaps {
    /// The map of the first of the photos of each list, searched among the others of the list unless it
    /// is known. `load` reads a photo.
    pub(crate) fn get_or_search<E: Send>(
        &self,
        searched: &[Vec<usize>],
        detail: usize,
        range: (f64, f64),
        load: impl Fn(usize) -> Result<SmallPhoto, E> + Sync,
    ) -> Result<Vec<PhotoDepth>, E> {
        let known: Vec<_> = searched.iter().map(|photos| self.maps.get((photos[0], detail))).collect();
        let missing: Vec<_> = searched.iter().zip(&known).filter(|(_, known)| known.is_none()).collect();
        let needed: BTreeSet<usize> = missing.iter().flat_map(|(photos, _)| photos.iter().copied()).collect();
        let photo = |photo: usize| match self.photos.get((photo, detail)) {
            Some(known) => Ok((photo, known)),
            None => Ok((photo, self.photos.insert((photo, detail), load(photo)?))),
        };
        let photos = needed.into_par_iter().map(photo).collect::<Result<BTreeMap<_, _>, E>>()?;
        let search = |photos_of: &[usize]| {
            let small: Vec<&SmallPhoto> = photos_of.iter().map(|photo| &*photos[photo]).collect();
            self.maps.insert((photos_of[0], detail), small_map(&small, range))
        };
        let all = searched.par_iter().zip(known).map(|(photos, known)| known.unwrap_or_else(|| search(photos)));
        Ok(all.map(|map| (*map).clone()).collect())
    }
}

/// A photo and its detail.
type Key = (usize, usize);

/// Values used last.
#[derive(Debug)]
struct Recent<T> {
    kept: usize,
    /// The last used one first.
    values: Mutex<VecDeque<(Key, Arc<T>)>>,
}

impl<T> Recent<T> {
    fn new(kept: usize) -> Self {
        Self { kept, values: Mutex::default() }
    }

    fn get(&self, key: Key) -> Option<Arc<T>> {
        let mut values = self.values.lock().unwrap_or_else(PoisonError::into_inner);
        let at = values.iter().position(|&(of, _)| of == key)?;
        let found = values.remove(at)?;
        let value = Arc::clone(&found.1);
        values.push_front(found);
        Some(value)
    }

    fn insert(&self, key: Key, value: T) -> Arc<T> {
        let value = Arc::new(value);
        let mut values = self.values.lock().unwrap_or_else(PoisonError::into_inner);
        values.truncate(self.kept - 1);
        values.push_front((key, Arc::clone(&value)));
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recent_keeps_what_was_used_last() {
        let recent = Recent::new(2);
        recent.insert((0, 1), "a");
        recent.insert((0, 2), "b");
        assert_eq!(recent.get((0, 1)).as_deref(), Some(&"a"));
        recent.insert((1, 1), "c");
        assert_eq!([(0, 1), (0, 2), (1, 1)].map(|key| recent.get(key).is_some()), [true, false, true]);
    }
}
