//! The search of the photos' depth, stage by stage: the arrays of photo i of a shot are named `search{i}.…`.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use anyhow::Result;
use liveview::surface::stages::{self, Search};
use liveview::surface::{DepthMaps, PhotoDepth};
use liveview::warp::{SourceView, Texture};
use liveview::{Camera, Scene, Shot};
use ndarray::{Array, Array1, Array2, Dimension};
use ndarray_npy::WritableElement;

use super::photos::Photos;
use crate::npz::Arrays;

/// Planes of the second search per plane of the first.
const FINE_PER_COARSE: usize = 2;
/// Planes of the first search, at least and at most.
const PLANES: std::ops::RangeInclusive<usize> = 32..=256;

pub(super) fn write_search(scene: &Scene, shot: &Shot, photos: &Photos, arrays: &mut Arrays) -> Result<()> {
    let free: Vec<usize> = (0..scene.views.len()).filter(|view| !shot.held_out.contains(view)).collect();
    let cameras: Vec<Camera> = free.iter().map(|&view| scene.views[view].camera.clone()).collect();
    let maps = DepthMaps::new(cameras.clone(), photos.range.0, photos.range.1);
    for (index, (view, depth)) in photos.views.iter().zip(&photos.depths).enumerate() {
        let place = free.iter().position(|free| free == view).expect("a view that is not held out");
        let neighbours = maps.neighbours(place);
        let of_photo = &mut OfPhoto { arrays, index };
        of_photo.add("neighbours", neighbours.iter().map(|&place| free[place] as i64).collect::<Array1<_>>())?;
        if neighbours.is_empty() {
            continue;
        }
        let group: Vec<usize> = std::iter::once(place).chain(neighbours).collect();
        let photos_of = |place: usize| -> Vec<usize> { std::iter::once(place).chain(maps.neighbours(place)).collect() };
        let searched: Vec<Vec<usize>> = group.iter().map(|&place| photos_of(place)).collect();
        let mut textures = HashMap::new();
        for &place in searched.iter().flatten() {
            if let Entry::Vacant(entry) = textures.entry(place) {
                entry.insert(Texture::new(&scene.load_image(free[place])?));
            }
        }
        let views_of = |places: &[usize]| -> Vec<SourceView<'_>> {
            places.iter().map(|place| SourceView { camera: &cameras[*place], texture: &textures[place] }).collect()
        };
        let mut small_maps = Vec::with_capacity(group.len());
        for (which, places) in searched.iter().enumerate() {
            let around: Array1<i64> = places[1..].iter().map(|&place| free[place] as i64).collect();
            of_photo.add(&format!("coarse_neighbours{which}"), around)?;
            small_maps.push(write_small_map(&views_of(places), which, photos.range, of_photo)?);
        }
        write_of_photo(&views_of(&group), &small_maps, photos.range, depth.disparity_per_pixel, of_photo)?;
    }
    Ok(())
}

/// The arrays of one photo.
struct OfPhoto<'a> {
    arrays: &'a mut Arrays,
    index: usize,
}

impl OfPhoto<'_> {
    fn add<A: WritableElement, D: Dimension>(&mut self, name: &str, array: Array<A, D>) -> Result<()> {
        self.arrays.add(&format!("search{}.{name}", self.index), array)
    }
}

/// The map of photo `which` of a group at the small size: the first of these photos, searched among the others.
fn write_small_map(
    views: &[SourceView<'_>],
    which: usize,
    range: (f64, f64),
    arrays: &mut OfPhoto<'_>,
) -> Result<PhotoDepth> {
    let map = stages::small_map(views, range);
    let photo = views[0].texture;
    let count = planes(range, map.disparity_per_pixel, 4);
    let mut search = Search { range, count, parts: 1, cell: 4, starts: None, ranges: None };
    let size = (photo.height().div_ceil(4), photo.width().div_ceil(4));
    let larger = Search { count: planes(range, map.disparity_per_pixel, 8), cell: 8, ..search };
    let costs = stages::matching_costs(&views[0], &views[1..], &larger);
    let found = stages::aggregated(&costs, photo, &larger);
    let larger_map = stages::disparity(&stages::median3(&found), &larger);
    let ranges = stages::tile_ranges(&larger_map, &search, size);
    if let Some(ranges) = &ranges {
        arrays.add(&format!("larger_costs{which}"), costs)?;
        arrays.add(&format!("larger_found{which}"), found)?;
        arrays.add(&format!("larger{which}"), larger_map)?;
        arrays.add(&format!("coarse_ranges{which}"), ranges.clone())?;
    }
    search.ranges = ranges.as_ref();
    let costs = stages::matching_costs(&views[0], &views[1..], &search);
    arrays.add(&format!("coarse_found{which}"), stages::aggregated(&costs, photo, &search))?;
    arrays.add(&format!("coarse_costs{which}"), costs)?;
    arrays.add(&format!("coarse{which}"), map.disparity.clone())?;
    Ok(map)
}

/// The search of the first of these photos among the others, given the maps of all at the small size.
fn write_of_photo(
    views: &[SourceView<'_>],
    maps: &[PhotoDepth],
    range: (f64, f64),
    disparity_per_pixel: f32,
    arrays: &mut OfPhoto<'_>,
) -> Result<()> {
    let (photo, neighbours) = (&views[0], &views[1..]);
    let count = planes(range, disparity_per_pixel, 2);
    arrays.add("count", ndarray::arr0(count as i64))?;
    let cameras: Vec<_> = views.iter().map(|view| view.camera).collect();
    arrays.add("coarse_pixel", maps.iter().map(|map| map.disparity_per_pixel).collect::<Array1<_>>())?;
    let sure = stages::group_confirmed(&cameras, maps);
    for (which, sure) in sure.iter().enumerate() {
        arrays.add(&format!("coarse_sure{which}"), sure.disparity.mapv(|disparity| f32::from(disparity >= 0.0)))?;
    }
    let mut first = Search { range, count, parts: 1, cell: 2, starts: None, ranges: None };
    let (height, width) = (photo.texture.height().div_ceil(2), photo.texture.width().div_ceil(2));
    let ranges = stages::tile_ranges(&maps[0].disparity, &first, (height, width));
    ranges.iter().try_for_each(|ranges| arrays.add("half_ranges", ranges.clone()))?;
    first.ranges = ranges.as_ref();
    let half_costs = stages::matching_costs(photo, neighbours, &first);
    let half_found = stages::aggregated(&half_costs, photo.texture, &first);
    let half_index = stages::median3(&half_found);
    let half = PhotoDepth { disparity: stages::disparity(&half_index, &first), disparity_per_pixel };
    let (kept, anchor) = stages::anchors(&cameras, maps, sure, &half);
    let anchored_costs = stages::anchored_costs(&half_costs, kept.clone(), &anchor, &first);
    let anchored_found = stages::aggregated(&anchored_costs, photo.texture, &first);
    let median = stages::median3(&anchored_found);
    let anchored_index = Array2::from_shape_fn(kept.dim(), |at| if kept[at] { half_index[at] } else { median[at] });

    let starts = stages::segment_starts(&anchored_index, FINE_PER_COARSE, (count - 1) * FINE_PER_COARSE + 1);
    let second = Search { range, count, parts: FINE_PER_COARSE, cell: 1, starts: Some(&starts), ranges: None };
    let mut fine_costs = stages::matching_costs(photo, neighbours, &second);
    // The costs of a segment that a cell does not have are unspecified.
    let missing = |y: usize, x: usize| starts[(y / 2, x / 2, 1)] == u16::MAX;
    fine_costs.indexed_iter_mut().filter(|((y, x, k), _)| *k >= 8 && missing(*y, *x)).for_each(|(_, cost)| *cost = 0);
    let fine_found = stages::aggregated(&fine_costs, photo.texture, &second);

    arrays.add("fine_index", stages::median3(&fine_found))?;
    arrays.add("fine_found", fine_found)?;
    arrays.add("fine_costs", fine_costs)?;
    arrays.add("starts", starts)?;
    arrays.add("anchored_index", anchored_index)?;
    arrays.add("anchored_found", anchored_found)?;
    arrays.add("anchored_costs", anchored_costs)?;
    arrays.add("anchor", anchor)?;
    arrays.add("kept", kept.mapv(f32::from))?;
    arrays.add("half_index", half_index)?;
    arrays.add("half_found", half_found)?;
    arrays.add("half_costs", half_costs)
}

/// Number of planes of a first search on cells of so many pixels a side: half a cell of parallax apart.
fn planes((near, far): (f64, f64), disparity_per_pixel: f32, cell: usize) -> usize {
    let widest = (1.0 / near - 1.0 / far) / f64::from(disparity_per_pixel);
    // The pixel of parallax is rounded.
    ((widest / (0.5 * cell as f64) * (1.0 - 1e-7)).ceil() as usize + 1).clamp(*PLANES.start(), *PLANES.end())
}
