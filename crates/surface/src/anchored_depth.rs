//! The depth of a photo, with what its neighbours find at a small size as anchors: where there is no
//! texture, the costs alone decide nothing.
//!
//! 1. The photo and its neighbours are one group. Each has a map at a small size, on cells of 4×4
//!    pixels, searched among its own neighbours: it depends on that photo alone and serves the searches
//!    of all photos around it ([`SmallMaps`]). Of many planes only those around what a search on cells of
//!    8×8 pixels found are searched ([`crate::grid`]). What the others of the group confirm of a map is
//!    kept ([`crate::consistency`], with two pixels of parallax for one).
//! 2. The first search of the photo, on cells of 2×2 pixels, around its map of step 1. A cell is kept
//!    where the group's maps confirm it, and where they confirm more than a third of the 31×31 cells
//!    around it: holes in places with texture are occluded, thin or at an edge, and their own costs know
//!    more than their surroundings.
//! 3. Anchors: the kept cell's own depth where it is confirmed; elsewhere the group's confirmed depths
//!    splatted to the photo, but not where these differ by more than 20 px within 3×3 cells.
//! 4. The cells that are not kept are searched again with the anchors ([`Anchors`]), then the whole
//!    photo around the result ([`mod@crate::photo_depth`]).
//!
//! px is the photo's disparity per pixel (docs/design-log/ordinary-scenes.md, speed.md).

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};

use ndarray::Array2;
use rayon::prelude::*;

use crate::consistency::confirmed_by;
use crate::fusion::{AVERAGED_PX, SAME_SURFACE_PX, Single, splat};
use crate::neighbourhood::{extremes3, share_of_known};
use crate::photo_depth::{Anchors, CELL, CellSearch, detail_pixels, refined};
use crate::{ConfirmedDisparity, PhotoDisparity};
use liveview::geometry::Camera;
use liveview::warp::{SourceView, Texture};

/// Pixels of parallax that count as one when the group's maps are compared.
const GROUP_PX: f32 = 2.0;
/// Half the side of the window that decides whether a hole is kept, cells.
const WINDOW_RADIUS: usize = 15;
/// No depth is carried over where those around it differ by more than this, px.
const EDGE_PX: f32 = 20.0;

/// Searches the depth of `photo` among its `neighbours` (at least one), from `near` to `far` (scene
/// units), with anchors; the neighbours among each other and the photo. A photo without detail of one
/// pixel is searched at the size that holds its detail, as are its neighbours; all pixels of a cell have
/// its depth.
pub fn anchored_depth(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], near: f64, far: f64) -> PhotoDisparity {
    let views: Vec<_> = std::iter::once(photo).chain(neighbours).copied().collect();
    let all = 0..views.len();
    let each_first = |photo| std::iter::once(photo).chain(all.clone().filter(move |&other| other != photo)).collect();
    let searched: Vec<_> = all.clone().map(each_first).collect();
    let small = |index: usize, detail| Ok::<_, Infallible>(SmallPhoto::new(&views[index], detail));
    let Ok(found) = anchored_depth_in_scene(&views, (near, far), &SmallMaps::default(), &searched, small);
    found
}

/// As [`anchored_depth`], of the first of the `views`. `searched`: of each of them, itself and the
/// photos that it is searched among for its map of step 1, indices in the scene; `small` returns any of
/// these ([`SmallPhoto::new`]).
///
/// # Errors
///
/// Those of `small`.
pub fn anchored_depth_in_scene<E: Send>(
    views: &[SourceView<'_>],
    range: (f64, f64),
    maps: &SmallMaps,
    searched: &[Vec<usize>],
    small: impl Fn(usize, usize) -> Result<SmallPhoto, E> + Sync,
) -> Result<PhotoDisparity, E> {
    let photo = &views[0];
    let detail = detail_pixels(photo.texture);
    let maps = maps.get_or_search(searched, detail, range, |photo| small(photo, detail))?;
    if detail == 1 {
        return Ok(depth_at_full_size(views, range, maps));
    }
    let small: Vec<_> = views.par_iter().map(|view| shrunk(view, detail)).collect();
    let views: Vec<_> = small.iter().map(|(camera, texture)| SourceView { camera, texture }).collect();
    let found = depth_at_full_size(&views, range, maps);
    let (width, height) = (photo.texture.width(), photo.texture.height());
    let disparity = Array2::from_shape_fn((height, width), |(y, x)| found.disparity[(y / detail, x / detail)]);
    Ok(PhotoDisparity { disparity, ..found })
}

fn shrunk(view: &SourceView<'_>, factor: usize) -> (Camera, Texture) {
    (view.camera.shrunk(factor), view.texture.shrunk(factor))
}

/// The depth of the first of these photos, given the maps of all of them.
fn depth_at_full_size(views: &[SourceView<'_>], range: (f64, f64), maps: Vec<PhotoDisparity>) -> PhotoDisparity {
    let group = Group::of(&views.iter().map(|view| view.camera).collect::<Vec<_>>(), maps);
    let mut first = CellSearch::of_full_size(views, CELL, range, || Some(group.maps[0].clone()));
    let anchors = group.anchors(&views[0].camera.shrunk(CELL), &first.depth());
    first.search_again(&anchors);
    refined(views, first)
}

/// A photo and its neighbours at a small size.
pub(crate) struct Group {
    cameras: Vec<Camera>,
    maps: Vec<PhotoDisparity>,
    /// What the others confirm of each.
    pub(crate) confirmed: Vec<ConfirmedDisparity>,
}

impl Group {
    /// Of these maps and the cameras of the full size, of the photo in question first.
    pub(crate) fn of(cameras: &[&Camera], maps: Vec<PhotoDisparity>) -> Self {
        let cameras: Vec<Camera> = cameras.iter().map(|camera| camera.shrunk(SMALL_CELL)).collect();
        let confirm = |which: usize| {
            let disparity_per_pixel = GROUP_PX * maps[which].disparity_per_pixel;
            let own = PhotoDisparity { disparity_per_pixel, ..maps[which].clone() };
            let others = (0..maps.len()).filter(|&other| other != which);
            confirmed_by((&cameras[which], &own), others.map(|other| (&cameras[other], &maps[other])))
        };
        let confirmed = (0..maps.len()).into_par_iter().map(confirm).collect();
        Self { cameras, maps, confirmed }
    }

    /// Anchors of the first photo's cells, whose depth a first search found; `camera` is the photo's
    /// at their size.
    pub(crate) fn anchors(&self, camera: &Camera, found: &PhotoDisparity) -> Anchors {
        let others = self.cameras.iter().zip(&self.maps).skip(1);
        let own = confirmed_by((camera, found), others).disparity;
        let carried = self.carried(found.disparity_per_pixel);
        let kept = mostly_confirmed(&own);
        let anchor = |((y, x), &own): ((usize, usize), &f32)| {
            if own >= 0.0 || kept[(y, x)] { own } else { carried[(y * CELL / SMALL_CELL, x * CELL / SMALL_CELL)] }
        };
        let disparity = own.indexed_iter().map(anchor).collect();
        Anchors { kept: kept.into_iter().collect(), disparity }
    }

    /// The confirmed depths splatted to the first photo; −1 in holes and at their edges.
    fn carried(&self, px: f32) -> Array2<f32> {
        let maps: Vec<_> = self.cameras.iter().zip(self.confirmed.iter().map(|map| &map.disparity)).collect();
        let size = self.cameras[0].size();
        let map = splat(&maps, &self.cameras[0], size, (SAME_SURFACE_PX * px, AVERAGED_PX * px), Single::Kept);
        let (largest, _) = extremes3(&map, size.width);
        let holes_far: Vec<f32> = map.iter().map(|&d| if d < 0.0 { f32::MAX } else { d }).collect();
        let (_, smallest) = extremes3(&holes_far, size.width);
        let differ = largest.iter().zip(&smallest).map(|(largest, smallest)| largest - smallest > EDGE_PX * px);
        let map = map.iter().zip(differ).map(|(&d, differ)| if differ { -1.0 } else { d }).collect();
        Array2::from_shape_vec((size.height, size.width), map).expect("one per cell")
    }
}

/// Which cells are confirmed (≥ 0), or more than a third of those around them.
fn mostly_confirmed(confirmed: &Array2<f32>) -> Array2<bool> {
    let share = share_of_known(confirmed, WINDOW_RADIUS);
    Array2::from_shape_fn(confirmed.dim(), |at| confirmed[at] >= 0.0 || share(at) > 1.0 / 3.0)
}

/// Pixels per side of a cell of a map.
const SMALL_CELL: usize = 4;
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
    /// Of a photo, where details of the searched photo have so many pixels a side.
    pub fn new(view: &SourceView<'_>, detail: usize) -> Self {
        if detail > 1 {
            let (camera, texture) = shrunk(view, detail);
            return Self::new(&SourceView { camera: &camera, texture: &texture }, 1);
        }
        let [by_cells, by_larger_cells] = [SMALL_CELL, LARGER_CELL].map(|cell| view.texture.shrunk(cell));
        Self { camera: view.camera.clone(), by_cells, by_larger_cells }
    }
}

/// The depth `[h/4, w/4]` of the first of these photos, searched among the others (at least one) from
/// near to far (scene units).
pub(crate) fn small_map(photos: &[&SmallPhoto], range: (f64, f64)) -> PhotoDisparity {
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
#[derive(Debug, Default)]
pub struct SmallMaps {
    maps: Recent<PhotoDisparity>,
    photos: Recent<SmallPhoto>,
}

impl SmallMaps {
    /// The map of the first of the photos of each list, searched among the others of the list unless it
    /// is known. `load` reads a photo.
    fn get_or_search<E: Send>(
        &self,
        searched: &[Vec<usize>],
        detail: usize,
        range: (f64, f64),
        load: impl Fn(usize) -> Result<SmallPhoto, E> + Sync,
    ) -> Result<Vec<PhotoDisparity>, E> {
        let known: Vec<_> = searched.iter().map(|photos| recall(&self.maps, (photos[0], detail))).collect();
        let missing: Vec<_> = searched.iter().zip(&known).filter(|(_, known)| known.is_none()).collect();
        let needed: BTreeSet<usize> = missing.iter().flat_map(|(photos, _)| photos.iter().copied()).collect();
        let photo = |photo: usize| match recall(&self.photos, (photo, detail)) {
            Some(known) => Ok((photo, known)),
            None => Ok((photo, keep(&self.photos, KEPT_PHOTOS, (photo, detail), load(photo)?))),
        };
        let photos = needed.into_par_iter().map(photo).collect::<Result<BTreeMap<_, _>, E>>()?;
        let search = |photos_of: &[usize]| {
            let small: Vec<&SmallPhoto> = photos_of.iter().map(|photo| &*photos[photo]).collect();
            keep(&self.maps, KEPT_MAPS, (photos_of[0], detail), small_map(&small, range))
        };
        let all = searched.par_iter().zip(known).map(|(photos, known)| known.unwrap_or_else(|| search(photos)));
        Ok(all.map(|map| (*map).clone()).collect())
    }
}

/// A photo and its detail.
type Key = (usize, usize);

/// Values, the last used one first.
type Recent<T> = Mutex<VecDeque<(Key, Arc<T>)>>;

fn recall<T>(values: &Recent<T>, key: Key) -> Option<Arc<T>> {
    let mut values = values.lock().unwrap_or_else(PoisonError::into_inner);
    let at = values.iter().position(|&(of, _)| of == key)?;
    let found = values.remove(at)?;
    let value = Arc::clone(&found.1);
    values.push_front(found);
    Some(value)
}

/// Adds a value; as many stay as are `kept`.
fn keep<T>(values: &Recent<T>, kept: usize, key: Key, value: T) -> Arc<T> {
    let value = Arc::new(value);
    let mut values = values.lock().unwrap_or_else(PoisonError::into_inner);
    values.truncate(kept - 1);
    values.push_front((key, Arc::clone(&value)));
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recent_keeps_what_was_used_last() {
        let recent = Recent::default();
        keep(&recent, 2, (0, 1), "a");
        keep(&recent, 2, (0, 2), "b");
        assert_eq!(recall(&recent, (0, 1)).as_deref(), Some(&"a"));
        keep(&recent, 2, (1, 1), "c");
        assert_eq!([(0, 1), (0, 2), (1, 1)].map(|key| recall(&recent, key).is_some()), [true, false, true]);
    }

    fn camera() -> Camera {
        let intrinsics = liveview::geometry::Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        Camera::new(intrinsics, 64, 48, glam::DMat3::IDENTITY, glam::DVec3::ZERO).unwrap()
    }

    #[test]
    fn small_maps_of_another_detail_are_searched_anew() {
        let values = (0..3 * 64 * 48).map(|i| (i * 31 % 113) as f32 / 112.0).collect();
        let photo = Texture::new(&liveview::image::ImageRgb::new(64, 48, values).unwrap());
        let (camera, maps) = (camera(), SmallMaps::default());
        let view = SourceView { camera: &camera, texture: &photo };
        for (detail, size) in [(1, (12, 16)), (2, (6, 8)), (1, (12, 16))] {
            let load = |_| Ok::<_, Infallible>(SmallPhoto::new(&view, detail));
            let Ok(found) = maps.get_or_search(&[vec![0, 1]], detail, (1.0, 10.0), load);
            assert_eq!(found[0].disparity.dim(), size, "detail of {detail} pixels");
        }
    }

    #[test]
    fn anchors_are_what_the_group_confirms_in_the_cell() {
        let camera = camera();
        // Slopes, with steps of 15 pixels (no edge) and of 30.
        let step = |x: usize| {
            if x < 6 {
                0.0
            } else if x < 12 {
                0.15
            } else {
                0.45
            }
        };
        let slope = Array2::from_shape_fn((12, 16), |(y, x)| 0.2 + 0.002 * x as f32 + 0.001 * y as f32 + step(x));
        let map = PhotoDisparity { disparity: slope.clone(), disparity_per_pixel: 0.01 };
        let group = Group::of(&[&camera; 3], vec![map; 3]);
        // The photo's own depth is wrong but in the upper left cell.
        let mut found = PhotoDisparity { disparity: Array2::from_elem((24, 32), 0.95), disparity_per_pixel: 0.01 };
        found.disparity[(0, 0)] = 0.205;
        let anchors = group.anchors(&camera.shrunk(CELL), &found);
        for (at, (&kept, &anchor)) in anchors.kept.iter().zip(&anchors.disparity).enumerate() {
            let (y, x) = (at / 32 / 2, at % 32 / 2);
            let expected = match (at, x) {
                (0, _) => 0.205,
                (_, 11 | 12) => -1.0,
                _ => slope[(y, x)],
            };
            assert!((anchor - expected).abs() < 1e-6 && kept == (at == 0), "{at}: {anchor}, not {expected}; {kept}");
        }
    }

    #[test]
    fn holes_are_kept_where_more_than_a_third_around_is_confirmed() {
        let confirmed = Array2::from_shape_fn((40, 40), |(_, x)| if x < 11 { 0.5 } else { -1.0 });
        let kept = mostly_confirmed(&confirmed);
        // 11 of 31 columns, and 10.
        assert!(kept[(20, 15)] && !kept[(20, 16)] && kept[(20, 0)] && !kept[(0, 16)]);
    }
}
