//! The depth of each camera's photo, kept from step to step: searched anew where the photo has changed since.
//!
//! A camera's depth belongs to its photo alone; its neighbours only help to find it. So what a photo goes on showing keeps its depth,
//! whatever changes in others, and wherever the target moves. Photos are compared by the means of [`CELL`]×[`CELL`] pixels with what they
//! showed when that part was searched: noise averages out, and slow changes add up.

use ndarray::{Array2, s};

use super::dirty_tiles::{Region, dirty_regions};
use super::policy::Policy;
use super::settings::LiveSettings;
use super::step::Step;
use crate::geometry::{Camera, Size};
use crate::surface::{DepthMaps, EXTRA_PHOTOS, NEIGHBOURS, PhotoCorrection, PhotoDepth, TargetSurface, photo_depth};
use crate::warp::{SourceView, Texture};

/// Pixels per side of a cell.
const CELL: usize = 2;
/// A cell has changed if the mean of a channel differs by more than this, of values in [0, 1].
const CHANGED: f32 = 0.03;
/// Tiles around what has changed that are searched with it, so that its edges agree with their surroundings.
const HALO: usize = 1;
/// Where what is to be searched covers more than this share of a photo, all of it is searched: that takes no longer.
const WHOLE: f64 = 0.75;

/// What a photo shows, by cell and channel.
type Cells = Array2<[f32; 3]>;

/// Depth maps of the cameras of a rig.
pub(super) struct CameraDepths {
    maps: DepthMaps,
    /// What each camera showed when its depth was searched.
    searched: Vec<Option<Cells>>,
}

impl CameraDepths {
    pub(super) fn new(cameras: &[Camera], near: f64, far: f64) -> Self {
        let maps = DepthMaps::new(cameras.to_vec(), near, far);
        Self { maps, searched: vec![None; cameras.len()] }
    }

    /// Forgets all depth.
    pub(super) fn forget(&mut self) {
        self.maps.retain(&[], &[]);
        self.searched.fill(None);
    }

    /// The surface of a target that is rendered from its `count` nearest cameras, and the share of the photos used that was searched
    /// for it, 1 for all.
    pub(super) fn surface(
        &mut self,
        step: &Step<'_>,
        target: &Camera,
        count: usize,
        settings: &LiveSettings,
    ) -> (TargetSurface, f64) {
        let mut set = step.nearest(target);
        set.truncate(count + EXTRA_PHOTOS);
        let searched: f64 = set.iter().map(|&camera| self.update(step, camera, settings.policy)).sum();
        let photos: Vec<_> = set.iter().map(|&camera| (camera, step.source(camera))).collect();
        let correction = PhotoCorrection { exposure: !settings.keep_exposure, ..PhotoCorrection::default() };
        (TargetSurface::find(&mut self.maps, &photos, count, target, correction), searched / set.len() as f64)
    }

    /// Searches what the policy says of a camera's photo; its share.
    fn update(&mut self, step: &Step<'_>, camera: usize, policy: Policy) -> f64 {
        let view = step.source(camera);
        let Some((then, found)) = self.searched[camera].as_mut().zip(self.maps.get(camera)) else {
            self.searched[camera] = Some(cells(view.texture));
            self.maps.insert(camera, search(&view, &neighbours(step, camera), &self.maps));
            return 1.0;
        };
        if policy != Policy::Propagate {
            return 0.0;
        }
        let now = cells(view.texture);
        let dirty = changed(then, &now);
        if dirty.is_empty() {
            return 0.0;
        }
        let expanded: Vec<Region> = dirty.iter().map(|region| region.expanded(HALO, now.dim())).collect();
        let share = |regions: &[Region]| regions.iter().map(Region::area).sum::<usize>() as f64 / now.len() as f64;
        let neighbours = neighbours(step, camera);
        if share(&expanded) > WHOLE {
            *then = now;
            self.maps.insert(camera, search(&view, &neighbours, &self.maps));
            return 1.0;
        }
        let mut renewed = found.clone();
        for (region, expanded) in dirty.iter().zip(&expanded) {
            let inside = s![region.top..region.bottom, region.left..region.right];
            then.slice_mut(inside).assign(&now.slice(inside));
            let size = view.camera.size();
            let ((left, right), (top, bottom)) = expanded.pixels(size);
            let size_of_part = Size::new(right - left, bottom - top);
            let part = view.camera.with_window(left as f64, top as f64, size_of_part.width, size_of_part.height);
            let texture = view.texture.window((left, top), size_of_part);
            let part = SourceView { camera: &part.expect("a part of a photo"), texture: &texture };
            let found = search(&part, &neighbours, &self.maps);
            let (columns, rows) = region.pixels(size);
            let inner = s![rows.0 - top..rows.1 - top, columns.0 - left..columns.1 - left];
            renewed.disparity.slice_mut(s![rows.0..rows.1, columns.0..columns.1]).assign(&found.disparity.slice(inner));
        }
        self.maps.insert(camera, renewed);
        share(&dirty)
    }
}

impl Region {
    /// First column and the one after the last, and so the rows, of a region of cells in a photo.
    fn pixels(&self, size: Size) -> ((usize, usize), (usize, usize)) {
        let (right, bottom) = ((self.right * CELL).min(size.width), (self.bottom * CELL).min(size.height));
        ((self.left * CELL, right), (self.top * CELL, bottom))
    }
}

/// What a camera's photo is matched with.
fn neighbours<'a>(step: &'a Step<'_>, camera: usize) -> Vec<SourceView<'a>> {
    let near = step.nearest(&step.cameras[camera]).into_iter().filter(|&other| other != camera);
    near.take(NEIGHBOURS).map(|other| step.source(other)).collect()
}

fn search(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], maps: &DepthMaps) -> PhotoDepth {
    let (near, far) = maps.range();
    if neighbours.is_empty() {
        return PhotoDepth::unknown(photo.camera.size());
    }
    photo_depth(photo, neighbours, near, far)
}

fn cells(photo: &Texture) -> Cells {
    let means = photo.shrunk(CELL);
    Array2::from_shape_fn((means.height(), means.width()), |(y, x)| means.pixel(x, y))
}

/// Where the photo differs.
fn changed(then: &Cells, now: &Cells) -> Vec<Region> {
    let differs = |then: &[f32; 3], now: &[f32; 3]| then.iter().zip(now).any(|(a, b)| (a - b).abs() > CHANGED);
    dirty_regions(ndarray::Zip::from(then).and(now).map_collect(differs).view())
}
