//! The depth of each camera's photo, kept from step to step: searched again where the photo has
//! changed.
//!
//! A camera's depth belongs to its photo alone; its neighbours only help to find it. Where a photo
//! stays the same, its depth is reused, whatever changes in other photos and wherever the target
//! moves. A photo is compared, by the means of [`CELL`]×[`CELL`] pixels, with its content when that
//! part was searched: noise averages out, and slow changes accumulate.

use std::sync::OnceLock;

use liveview::geometry::{Camera, Size, facing_alike};
use liveview::image::ImageRgb;
use liveview::warp::{SourceView, Texture};
use liveview_surface::{
    DepthMaps, EXTRA_PHOTOS, NEIGHBOURS, PhotoDisparity, Region, Reuse, dirty_regions, photo_depth,
};
use liveview_synthesizer::PhotosWithDepth;
use ndarray::{Array2, s};

/// Pixels per side of a cell.
const CELL: usize = 2;
/// A cell has changed if the mean of a channel differs by more than this, of values in [0, 1].
const MIN_CHANGE: f32 = 0.03;
/// Where the regions to be searched cover more than this share of a photo, all of it is searched:
/// that takes no longer.
const MAX_DIRTY_SHARE: f64 = 0.75;

/// Mean colour of each cell of a photo.
type Cells = Array2<[f32; 3]>;

/// Depth maps of the cameras of a rig.
#[derive(Debug)]
pub(super) struct CameraDepths {
    maps: DepthMaps,
    /// The photo of each camera when its depth was searched.
    searched: Vec<Option<Cells>>,
}

impl CameraDepths {
    pub(super) fn new(cameras: &[Camera], near: f64, far: f64) -> Self {
        let maps = DepthMaps::new(cameras.to_vec(), near, far);
        Self { maps, searched: vec![None; cameras.len()] }
    }

    /// The photos of a time step near the target, with their depth: searched where there is none yet, and
    /// where `reuse` says. The frame is rendered from the nearest ones, `rendered_from`.
    pub(super) fn photos<'a>(
        &'a mut self,
        step: &'a Step<'_>,
        target: &Camera,
        rendered_from: usize,
        reuse: Reuse,
    ) -> PhotosWithDepth<'a> {
        if reuse == Reuse::Nothing {
            self.maps.retain(&[], &[]);
            self.searched.fill(None);
        }
        let mut set = step.nearest(target);
        set.truncate(rendered_from + EXTRA_PHOTOS);
        let refresh = reuse == Reuse::Refreshed;
        let searched: f64 = set.iter().map(|&camera| self.update(step, camera, refresh)).sum();
        PhotosWithDepth {
            maps: &mut self.maps,
            photos: set.iter().map(|&camera| (camera, step.source(camera))).collect(),
            rendered_from,
            searched: searched / set.len() as f64,
        }
    }

    /// Searches the depth of a camera's photo where there is none yet, and with `refresh` where the
    /// photo has changed. Returns the share of the photo that was searched.
    fn update(&mut self, step: &Step<'_>, camera: usize, refresh: bool) -> f64 {
        let view = step.source(camera);
        let Some((then, found)) = self.searched[camera].as_mut().zip(self.maps.get(camera)) else {
            self.searched[camera] = Some(cells(view.texture));
            self.maps.insert(camera, search(&view, &neighbours(step, camera), &self.maps));
            return 1.0;
        };
        if !refresh {
            return 0.0;
        }
        let now = cells(view.texture);
        let dirty = changed(then, &now);
        if dirty.is_empty() {
            return 0.0;
        }
        let expanded: Vec<Region> = dirty.iter().map(|region| region.expanded(now.dim())).collect();
        let share = |regions: &[Region]| regions.iter().map(Region::area).sum::<usize>() as f64 / now.len() as f64;
        let neighbours = neighbours(step, camera);
        if share(&expanded) > MAX_DIRTY_SHARE {
            *then = now;
            self.maps.insert(camera, search(&view, &neighbours, &self.maps));
            return 1.0;
        }
        let mut renewed = found.clone();
        for (region, expanded) in dirty.iter().zip(&expanded) {
            let cells = s![region.top..region.bottom, region.left..region.right];
            then.slice_mut(cells).assign(&now.slice(cells));
            let size = view.camera.size();
            let ((left, right), (top, bottom)) = pixels(expanded, size);
            let part_size = Size::new(right - left, bottom - top);
            let part = view.camera.with_window(left as f64, top as f64, part_size.width, part_size.height);
            let texture = view.texture.window((left, top), part_size);
            let part = SourceView { camera: &part.expect("a part of a photo"), texture: &texture };
            let found = search(&part, &neighbours, &self.maps);
            let (columns, rows) = pixels(region, size);
            let inner = s![rows.0 - top..rows.1 - top, columns.0 - left..columns.1 - left];
            renewed.disparity.slice_mut(s![rows.0..rows.1, columns.0..columns.1]).assign(&found.disparity.slice(inner));
        }
        self.maps.insert(camera, renewed);
        share(&dirty)
    }
}

/// First column and the one after the last, and first row and the one after the last, of a region
/// of cells in a photo of that size.
fn pixels(region: &Region, size: Size) -> ((usize, usize), (usize, usize)) {
    let (right, bottom) = ((region.right * CELL).min(size.width), (region.bottom * CELL).min(size.height));
    ((region.left * CELL, right), (region.top * CELL, bottom))
}

/// The photos that a camera's photo is matched with.
fn neighbours<'a>(step: &'a Step<'_>, camera: usize) -> Vec<SourceView<'a>> {
    let nearest = step.nearest(&step.cameras[camera]).into_iter().filter(|&other| other != camera);
    nearest.take(NEIGHBOURS).map(|other| step.source(other)).collect()
}

fn search(photo: &SourceView<'_>, neighbours: &[SourceView<'_>], maps: &DepthMaps) -> PhotoDisparity {
    let (near, far) = maps.range();
    if neighbours.is_empty() {
        return PhotoDisparity::unknown(photo.camera.size());
    }
    photo_depth(photo, neighbours, near, far)
}

fn cells(photo: &Texture) -> Cells {
    let means = photo.shrunk(CELL);
    Array2::from_shape_fn((means.height(), means.width()), |(y, x)| means.pixel(x, y))
}

/// Where a photo differs from an earlier one.
fn changed(then: &Cells, now: &Cells) -> Vec<Region> {
    let differs = |then: &[f32; 3], now: &[f32; 3]| then.iter().zip(now).any(|(a, b)| (a - b).abs() > MIN_CHANGE);
    dirty_regions(ndarray::Zip::from(then).and(now).map_collect(differs).view())
}

/// The photos of one time step; each becomes a texture when it is first needed.
pub(super) struct Step<'a> {
    pub(super) cameras: &'a [Camera],
    photos: &'a [Option<&'a ImageRgb>],
    textures: Vec<OnceLock<Texture>>,
}

impl<'a> Step<'a> {
    pub(super) fn new(cameras: &'a [Camera], photos: &'a [Option<&'a ImageRgb>]) -> Self {
        Self { cameras, photos, textures: photos.iter().map(|_| OnceLock::new()).collect() }
    }

    /// Number of cameras that have delivered a photo.
    pub(super) fn delivered(&self) -> usize {
        self.photos.iter().flatten().count()
    }

    /// The cameras that have delivered a photo and face the direction of this one, nearest first.
    pub(super) fn nearest(&self, camera: &Camera) -> Vec<usize> {
        let delivered: Vec<usize> = (0..self.photos.len()).filter(|&view| self.photos[view].is_some()).collect();
        let cameras: Vec<&Camera> = delivered.iter().map(|&view| &self.cameras[view]).collect();
        facing_alike(&cameras, camera).into_iter().map(|index| delivered[index]).collect()
    }

    /// A camera that has delivered a photo, and its texture.
    pub(super) fn source(&self, view: usize) -> SourceView<'_> {
        let texture = || Texture::new(self.photos[view].expect("delivered"));
        SourceView { camera: &self.cameras[view], texture: self.textures[view].get_or_init(texture) }
    }
}
