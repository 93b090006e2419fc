//! The surface of a frame, carried over to the next: forward-warped to its camera, compared with
//! its photos, and searched again where they disagree.
//!
//! The comparison uses the matching cost of the guided search, the windowed variance of the warped
//! colours, on a single layer: the carried surface. A search computes that cost on every one of its
//! planes.
//!
//! The regions searched again are those of dirty tiles: rectangles around the cells whose disparity no
//! longer agrees with the photos. Measured alternatives: docs/design-log/video.md.

use glam::DVec3;
use ndarray::{Array2, ArrayView2, Axis, s};

use crate::Reuse;
use crate::guided::{COARSE, GuidedSearch, RangeMap, SearchStages, TargetViews, WINDOWS, range_of};
use crate::neighbourhood::extremes3;
use liveview::geometry::{Camera, PlaneSweep, source_from_target};
use liveview::layers::{CELL, LayersError};
use liveview::warp::SourceView;

/// A cell is an outlier if its cost is more than this many times what it was when the cell was
/// searched …
const OUTLIER_COST_RATIO: f32 = 1.5;
/// … plus this: a variance of colours in [0, 1].
const NOISE_VARIANCE: f32 = 2e-4;
/// Where the dirty regions cover more than this share of the target, all of it is searched: that
/// takes no longer.
const MAX_DIRTY_SHARE: f64 = 0.5;

/// The range of disparities of each cell, which guided layers divide: of a first frame by a search of the
/// target, of a next one from the surface of the frame before, which is moved with the camera and searched
/// again where the photos contradict it. Also the share of the target that was searched, 0 to 1. The surface
/// is left in `carried` for a next frame if one `is_followed`.
///
/// # Errors
///
/// As [`GuidedSearch::search`].
pub fn guided_range(
    search: &GuidedSearch,
    carried: &mut Option<CarriedSurface>,
    sources: &[SourceView<'_>],
    target: &Camera,
    reuse: Reuse,
    is_followed: bool,
) -> Result<(RangeMap, f64), LayersError> {
    let views = TargetViews::new(sources, target);
    // A surface can be carried over only to a target of the same size.
    let has_its_size = |before: &CarriedSurface| before.target.size() == target.size();
    let before = carried.take().filter(|before| reuse != Reuse::Nothing && has_its_size(before));
    if let Some(before) = before {
        let mut moved = before.moved(target);
        let refreshed = if reuse == Reuse::Refreshed { moved.refresh(search, &views)? } else { 0.0 };
        return Ok((range_of(&carried.insert(moved).disparity, 0.0), refreshed));
    }
    let stages = search.search_part(&views, target)?;
    let range = stages.range.clone();
    *carried = is_followed.then(|| CarriedSurface::new(stages, &views));
    Ok((range, 1.0))
}

/// The surface that a frame was rendered along.
#[derive(Debug)]
pub struct CarriedSurface {
    target: Camera,
    /// Per cell of [`CELL`] pixels of the padded target, 1/scene unit.
    disparity: Array2<f32>,
    /// Its matching cost per cell of [`COARSE`] pixels, when it was searched.
    cost: Array2<f32>,
    /// Planes of the first search.
    planes: usize,
}

impl CarriedSurface {
    /// The surface that a search of the whole target found.
    fn new(stages: SearchStages, views: &TargetViews<'_>) -> Self {
        let cost = cost(&stages.fine_disparity, views);
        let planes = stages.disparities.len();
        Self { target: views.target.clone(), disparity: stages.fine_disparity, cost, planes }
    }

    /// The surface forward-warped to another camera: the nearest where several points project to
    /// one cell; where none does, the farther of those left and right.
    fn moved(self, target: &Camera) -> Self {
        if self.target == *target {
            return self;
        }
        let (height, width) = self.disparity.dim();
        let mut disparity = Array2::from_elem((height, width), f32::NAN);
        // Cells that were occluded before have no cost yet: with 0 they are searched unless the
        // photos agree with what fills them.
        let mut cost = Array2::zeros(self.cost.dim());
        let sweep = PlaneSweep::new(target, &self.target);
        let pose = source_from_target(target, &self.target);
        let ray_from_pixel = self.target.k_inverse();
        let at = |along: f64, side: usize| {
            let cell = (along / CELL as f64).floor();
            (cell >= 0.0 && cell < side as f64).then_some(cell as usize)
        };
        for ((y, x), &before) in self.disparity.indexed_iter() {
            let pixel = DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 0.0) * CELL as f64 + DVec3::Z;
            let uvw = sweep.source_from_target(before.into()) * pixel;
            // Depth in the new camera over depth in the old one.
            let depth = (pose.rotation * (ray_from_pixel * pixel) + pose.translation * f64::from(before)).z;
            if uvw.z <= 0.0 || depth <= 0.0 {
                continue;
            }
            let (Some(row), Some(column)) = (at(uvw.y / uvw.z, height), at(uvw.x / uvw.z, width)) else { continue };
            let (moved, cell) = ((f64::from(before) / depth) as f32, &mut disparity[(row, column)]);
            if cell.is_nan() || moved > *cell {
                *cell = moved;
                let shrink = |(y, x): (usize, usize)| (y * CELL / COARSE, x * CELL / COARSE);
                cost[shrink((row, column))] = self.cost[shrink((y, x))];
            }
        }
        fill_holes(&mut disparity);
        // Edges are displaced by up to a cell: a cell may cost as much as any of its neighbours.
        let largest = extremes3(cost.as_slice().expect("standard order"), cost.ncols()).0;
        let cost = Array2::from_shape_vec(cost.dim(), largest).expect("one per cell");
        Self { target: target.clone(), disparity, cost, planes: self.planes }
    }

    /// Compares the surface, which has been moved to the target, with the photos, and searches the
    /// regions where they disagree. Returns the share of the target that was searched, 1 for all of
    /// it.
    fn refresh(&mut self, search: &GuidedSearch, views: &TargetViews<'_>) -> Result<f64, LayersError> {
        let now = cost(&self.disparity, views);
        let is_outlier = |&now: &f32, &then: &f32| now > OUTLIER_COST_RATIO * then + NOISE_VARIANCE;
        let outliers = ndarray::Zip::from(&now).and(&self.cost).map_collect(is_outlier);
        let dirty = dirty_regions(outliers.view());
        if dirty.is_empty() {
            return Ok(0.0);
        }
        let share = |cells: usize| cells as f64 / now.len() as f64;
        let expanded: Vec<Region> = dirty.iter().map(|region| region.expanded(now.dim())).collect();
        if share(expanded.iter().map(Region::area).sum()) > MAX_DIRTY_SHARE {
            let stages = search.search_part(views, views.target)?;
            *self = Self::new(stages, views);
            return Ok(1.0);
        }
        let search = GuidedSearch { planes: Some(self.planes), ..*search };
        let fine = |cell: usize| cell * COARSE / CELL;
        for (region, expanded) in dirty.iter().zip(&expanded) {
            let [left, top] = [expanded.left, expanded.top].map(|cell| (cell * COARSE) as f64);
            let (width, height) = (expanded.width() * COARSE, expanded.height() * COARSE);
            let part = views.target.with_window(left, top, width, height).expect("a part of a padded target");
            let found = search.search_part(views, &part)?.fine_disparity;
            let inner = |start: usize, end: usize, from: usize| fine(start - from)..fine(end - from);
            let rows = inner(region.top, region.bottom, expanded.top);
            let found = found.slice(s![rows, inner(region.left, region.right, expanded.left)]);
            let cells = s![fine(region.top)..fine(region.bottom), fine(region.left)..fine(region.right)];
            self.disparity.slice_mut(cells).assign(&found);
        }
        let after = cost(&self.disparity, views);
        for region in &dirty {
            let cells = s![region.top..region.bottom, region.left..region.right];
            self.cost.slice_mut(cells).assign(&after.slice(cells));
        }
        Ok(share(dirty.iter().map(Region::area).sum()))
    }
}

/// Matching cost of a surface per cell of [`COARSE`] pixels.
fn cost(disparity: &Array2<f32>, views: &TargetViews<'_>) -> Array2<f32> {
    // One fine cell of each coarse one, not their mean: at a depth edge the mean lies on neither
    // side.
    let step = (COARSE / CELL) as isize;
    let map = disparity.slice(s![..;step, ..;step]).insert_axis(Axis(0));
    let costs = views.coarse().costs(&views.sweeps(views.target), map, WINDOWS[0]);
    costs.index_axis_move(Axis(0), 0)
}

/// Cells without a value (NaN) take the farther of the nearest values left and right; rows without
/// any are copied from the nearest row that has some.
fn fill_holes(disparity: &mut Array2<f32>) {
    let (height, width) = disparity.dim();
    let mut empty = Vec::new();
    for (y, mut row) in disparity.outer_iter_mut().enumerate() {
        let last_value = |last: &mut f32, &value: &f32| {
            *last = if value.is_nan() { *last } else { value };
            Some(*last)
        };
        let left: Vec<f32> = row.iter().scan(f32::NAN, last_value).collect();
        let right: Vec<f32> = row.iter().rev().scan(f32::NAN, last_value).collect();
        for ((value, left), &right) in row.iter_mut().zip(left).zip(right.iter().rev()) {
            // `f32::min` ignores NaN, which stands for the edge of the target.
            *value = left.min(right);
        }
        if row[0].is_nan() {
            empty.push(y);
        }
    }
    for y in empty {
        let with = (0..height).filter(|&other| !disparity[(other, 0)].is_nan()).min_by_key(|&other| other.abs_diff(y));
        let row = with.map_or_else(|| ndarray::Array1::zeros(width), |other| disparity.row(other).to_owned());
        disparity.row_mut(y).assign(&row);
    }
}

/// Cells per side of a tile.
const TILE: usize = 8;
/// A tile is dirty if more than this many of its cells are outliers.
const MAX_OUTLIERS: usize = 2;
/// Cells around a dirty region that are searched with it, so that its edges agree with their
/// surroundings.
const MARGIN: usize = TILE;

/// A rectangle of cells: first column and row, and those after the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Region {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
}

impl Region {
    fn width(&self) -> usize {
        self.right - self.left
    }

    fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// Number of its cells.
    fn area(&self) -> usize {
        self.width() * self.height()
    }

    /// The rectangle with its margin on each side, cut at the edges of a map of `(height, width)`
    /// cells.
    fn expanded(&self, (height, width): (usize, usize)) -> Self {
        Self {
            left: self.left.saturating_sub(MARGIN),
            top: self.top.saturating_sub(MARGIN),
            right: (self.right + MARGIN).min(width),
            bottom: (self.bottom + MARGIN).min(height),
        }
    }
}

/// The bounding rectangle of each group of adjoining dirty tiles: whole tiles, cut at the edges of
/// the map.
fn dirty_regions(outliers: ArrayView2<'_, bool>) -> Vec<Region> {
    let (height, width) = outliers.dim();
    let mut dirty = Array2::from_shape_fn((height.div_ceil(TILE), width.div_ceil(TILE)), |(y, x)| {
        let rows = y * TILE..(y * TILE + TILE).min(height);
        let cells = rows.flat_map(|y| (x * TILE..(x * TILE + TILE).min(width)).map(move |x| (y, x)));
        cells.filter(|&cell| outliers[cell]).count() > MAX_OUTLIERS
    });
    let (rows, columns) = dirty.dim();
    let mut found = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            if !std::mem::take(&mut dirty[(y, x)]) {
                continue;
            }
            let (mut left, mut right, mut bottom) = (x, x, y);
            let mut group = vec![(y, x)];
            while let Some((y, x)) = group.pop() {
                (left, right, bottom) = (left.min(x), right.max(x), bottom.max(y));
                for y in y.saturating_sub(1)..(y + 2).min(rows) {
                    for x in x.saturating_sub(1)..(x + 2).min(columns) {
                        if std::mem::take(&mut dirty[(y, x)]) {
                            group.push((y, x));
                        }
                    }
                }
            }
            found.push(Region {
                left: left * TILE,
                top: y * TILE,
                right: ((right + 1) * TILE).min(width),
                bottom: ((bottom + 1) * TILE).min(height),
            });
        }
    }
    found
}

#[cfg(test)]
mod carried_surface_tests {
    use glam::DMat3;

    use super::*;
    use liveview::geometry::Intrinsics;

    fn camera(x: f64, z: f64) -> Camera {
        let k = Intrinsics { fx: 32.0, fy: 32.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        Camera::new(k, 64, 48, DMat3::IDENTITY, -DVec3::new(x, 0.0, z)).unwrap()
    }

    fn surface(disparity: Array2<f32>) -> CarriedSurface {
        CarriedSurface { target: camera(0.0, 0.0), disparity, cost: Array2::from_elem((12, 16), 0.5), planes: 8 }
    }

    #[test]
    fn wall_moved_to_a_nearer_camera_has_a_larger_disparity() {
        let wall = || surface(Array2::from_elem((24, 32), 0.25));
        let moved = wall().moved(&camera(0.5, 2.0));
        assert!(moved.disparity.iter().all(|&d| (d - 0.5).abs() < 1e-6), "{}", moved.disparity);
        assert_eq!(wall().moved(&camera(0.0, 0.0)).disparity, wall().disparity);
        let away = wall().moved(&camera(0.0, 5.0));
        assert!(away.disparity.iter().all(|&d| d == 0.0), "no disparity behind the camera");
    }

    #[test]
    fn nearer_cells_occlude_and_disoccluded_cells_are_far_and_without_cost() {
        let mut disparity = Array2::from_elem((24, 32), 0.0);
        disparity.slice_mut(s![.., 14..22]).fill(0.5);
        // 1 to the right: what lies at depth 2 moves 16 pixels, 8 cells, to the left.
        let moved = surface(disparity).moved(&camera(1.0, 0.0));
        let row = moved.disparity.row(7);
        assert!((0..32).all(|x| row[x] == if (6..14).contains(&x) { 0.5 } else { 0.0 }), "{row}");
        // Disoccluded are the cells 14 to 21, the coarse ones 7 to 10; the outer two take the cost
        // of their neighbours.
        let cost = moved.cost.row(4);
        assert!((0..16).all(|x| cost[x] == if (8..10).contains(&x) { 0.0 } else { 0.5 }), "{cost}");
    }

    #[test]
    fn holes_take_the_farther_neighbour_of_their_row() {
        let n = f32::NAN;
        let mut map = ndarray::array![[n, n, n], [n, 2.0, n], [3.0, n, 1.0], [n, n, n]];
        fill_holes(&mut map);
        assert_eq!(map, ndarray::array![[2.0, 2.0, 2.0], [2.0, 2.0, 2.0], [3.0, 1.0, 1.0], [3.0, 1.0, 1.0]]);
    }
}

#[cfg(test)]
mod dirty_tiles_tests {
    use super::*;

    #[test]
    fn adjoining_dirty_tiles_become_one_rectangle_and_single_outliers_none() {
        let mut outliers = Array2::from_elem((30, 44), false);
        outliers[(20, 30)] = true;
        assert_eq!(dirty_regions(outliers.view()), []);
        // Two tiles that touch at a corner, and one at the lower right edge.
        for (y, x) in [(7, 15), (8, 16), (29, 43)] {
            (0..4).for_each(|i| outliers[(y / 8 * 8 + i, x)] = true);
        }
        let found = dirty_regions(outliers.view());
        assert_eq!(
            found,
            [Region { left: 8, top: 0, right: 24, bottom: 16 }, Region { left: 40, top: 24, right: 44, bottom: 30 }]
        );
        assert_eq!(found[0].expanded(outliers.dim()), Region { left: 0, top: 0, right: 32, bottom: 24 });
    }
}
