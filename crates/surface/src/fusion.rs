//! The target's surface: the confirmed depths of the photos, fused at the target, holes filled.
//!
//! 1. Splat of the confirmed depths ([`splat`]).
//! 2. Holes: from their farthest neighbours inwards ([`fill_holes`]). Where holes are more than 5 %
//!    of the target, it is searched among the first four views ([`TargetSearch`]). What that
//!    finds takes the place of the first, except where the first has the lower variance of the photos
//!    that see it ([`photo_variance`]): below 0.9 of the other's − 1e-7
//!    (docs/design-log/ordinary-scenes.md).
//! 3. 3×3 median.
//!
//! px is the target's disparity per pixel: (1/near − 1/far) over the parallax between near and far
//! in the view where it is largest (at least 1).
//!
//! In the splat each pixel of a photo is a square with a side of 0.4 pixels. A point covers the pixels that contain its four corners (±0.2 pixel); of each photo's points
//! each pixel keeps the largest disparity. Over the photos: the largest that another photo has
//! within `same` of it, or the largest of all if there is no such pair, unless [`Single`] depths are
//! left out (docs/design-log/surface-layers.md); then the mean, in f32 and in their order, of those at most
//! `averaged` behind that.

use ndarray::Array2;
use rayon::prelude::*;

use crate::ConfirmedDisparity;
use crate::consistency::{Projected, project_row, visible};
use crate::neighbourhood::{extremes3, fill_holes, median3, share_of_known};
use crate::parallax::widest_parallax;
use crate::target_search::{SeenSurface, TargetSearch, photo_variance};
use liveview::geometry::{Camera, PlaneSweep, Size};
use liveview::layers::{Layers, LayersError, padded};
use liveview::warp::{RUN, SourceView, WarpSource, round_to_i32};

/// Two depths splatted to a pixel are one surface within this, px.
pub(crate) const SAME_SURFACE_PX: f32 = 2.0;
/// Depths up to this far behind the nearest are averaged with it, px.
pub(crate) const AVERAGED_PX: f32 = 3.0;
/// How much nearer a view's own depth must be to hide a point, px.
pub(crate) const OCCLUSION_MARGIN_PX: f32 = 4.0;
/// Share of holes from which on the target is searched.
const SEARCHED_HOLE_SHARE: f64 = 0.05;
/// Number of views that the target is searched with.
const SEARCHED_VIEWS: usize = 4;
/// The first candidate stays below this share of the second one's variance.
const VARIANCE_RATIO: f32 = 0.9;
/// And by this much: rounding, the only difference where the photos have no texture (a tenth of a
/// grey level, squared).
const VARIANCE_ROUNDING: f32 = 1e-7;

/// Photo variance from which on a guessed pixel is doubted.
const DOUBT_VARIANCE: f32 = 0.002;
/// Half the side of the window of the share of doubted pixels, pixels.
const DOUBT_RADIUS: usize = 5;
/// Share of a pixel's colour that is not trusted where all around it are doubted.
const MOST_DOUBT: f32 = 0.99;

/// Disparity of each pixel of a padded target.
#[derive(Debug, Clone)]
pub struct Surface {
    /// 1/scene unit, `[h, w]`, multiples of 8.
    pub disparity: Array2<f32>,
    /// Disparity that moves a point by one pixel in the view with the largest parallax, 1/scene
    /// unit.
    pub disparity_per_pixel: f32,
    /// Which pixels are a guess: holes, to which no depth is carried that two photos confirm, `[h, w]`.
    pub guessed: Array2<bool>,
    /// Guessed pixels on whose colour no two photos agree, `[h, w]`; none where the target is not searched.
    pub doubted: Array2<bool>,
}

impl Surface {
    /// The share of guessed pixels, 0 to 1.
    pub fn guessed_share(&self) -> f64 {
        share_of(&self.guessed)
    }

    /// How far the colour of each pixel is trusted, `[h, w]`: 1 − 0.99·s of a doubted one, with s the share of
    /// those within 11×11 pixels, else 1; `None` if none is doubted. In a picture, what is not trusted is filled
    /// from around ([`liveview::Frame::picture`]): scraps of photos that contradict each other become blurred
    /// (docs/design-log/ordinary-scenes.md).
    pub fn confidence(&self) -> Option<Array2<f32>> {
        self.doubted.iter().any(|&doubted| doubted).then(|| {
            let known = self.doubted.mapv(|doubted| if doubted { 0.0 } else { -1.0 });
            let share = share_of_known(&known, DOUBT_RADIUS);
            let trusted = |at| if self.doubted[at] { 1.0 - MOST_DOUBT * share(at) } else { 1.0 };
            Array2::from_shape_fn(self.doubted.dim(), trusted)
        })
    }

    /// `count` layers near → far: one follows the surface; two are its largest and its smallest
    /// disparity over 3×3 pixels, three these with the surface between them; more divide that range
    /// evenly (k-th of L: near + k/(L − 1)·(far − near), in f32).
    ///
    /// # Errors
    ///
    /// [`LayersError::Empty`] for a count of 0.
    pub fn layers(&self, count: usize) -> Result<Layers, LayersError> {
        if count <= 1 {
            return Layers::pixels(vec![self.disparity.clone(); count]);
        }
        let (height, width) = self.disparity.dim();
        let extremes = extremes3(self.disparity.as_slice().expect("standard order"), width);
        let [near, far] = [extremes.0, extremes.1]
            .map(|values| Array2::from_shape_vec((height, width), values).expect("one per pixel"));
        match count {
            2 => return Layers::pixels(vec![near, far]),
            3 => return Layers::pixels(vec![near, self.disparity.clone(), far]),
            _ => {}
        }
        let layer = |k: usize| {
            let share = k as f32 / (count - 1) as f32;
            let between = |&near: &f32, &far: &f32| if k + 1 == count { far } else { near + share * (far - near) };
            ndarray::Zip::from(&near).and(&far).map_collect(between)
        };
        Layers::pixels((0..count).map(layer).collect())
    }
}

/// Finds the surface of `target` from these photos, nearest first (at least one), from near to far
/// (scene units).
pub fn surface(views: &[SurfaceView<'_>], target: &Camera, (near, far): (f64, f64)) -> Surface {
    let size = padded(target.size());
    let sources = warp_sources(views, target);
    let disparity_per_pixel = disparity_per_pixel(&sources, size, near, far);
    let splatted = splat_confirmed(views, target, disparity_per_pixel);
    let guessed = splatted.iter().map(|&disparity| disparity < 0.0).collect();
    let guessed = Array2::from_shape_vec((size.height, size.width), guessed).expect("one per pixel");
    let mut filled = fill_holes(&splatted, size.width);
    let mut doubted = Array2::from_elem((size.height, size.width), false);
    if share_of(&guessed) > SEARCHED_HOLE_SHARE {
        let count = views.len().min(SEARCHED_VIEWS);
        let (views, sources) = (&views[..count], &sources[..count]);
        let margin = OCCLUSION_MARGIN_PX * disparity_per_pixel;
        let search = TargetSearch { views, sources, target, splatted: &splatted, size, range: (near, far), margin };
        let planes = search.planes();
        let searched = search.disparity(&planes, search.costs(&planes).view());
        let variance = |disparity: &[f32]| {
            let visible_to =
                |v: &SurfaceView<'_>| visible((v.view.camera, v.confirmed), target, disparity, size.width, margin);
            let visible: Vec<_> = views.par_iter().map(visible_to).collect();
            let (visible, splatted, width) = (&visible, &splatted, size.width);
            photo_variance(&SeenSurface { disparity, splatted, width, sources, visible })
        };
        let (of_filled, of_searched) = (variance(&filled), variance(&searched));
        for ((at, &splatted), doubted) in splatted.iter().enumerate().zip(&mut doubted) {
            let is_better = of_filled[at] < VARIANCE_RATIO * of_searched[at] - VARIANCE_ROUNDING;
            if splatted < 0.0 {
                let variance = if is_better { &of_filled } else { &of_searched };
                *doubted = variance[at] >= DOUBT_VARIANCE;
                filled[at] = if is_better { filled[at] } else { searched[at] };
            }
        }
    }
    let disparity = median3(&filled, size.width);
    let disparity = Array2::from_shape_vec((size.height, size.width), disparity).expect("one per pixel");
    Surface { disparity, disparity_per_pixel, guessed, doubted }
}

/// The share of true pixels, 0 to 1.
fn share_of(map: &Array2<bool>) -> f64 {
    map.iter().filter(|&&is_so| is_so).count() as f64 / map.len() as f64
}

/// The views for the warp to `target`, with their gains.
pub(crate) fn warp_sources<'a>(views: &[SurfaceView<'a>], target: &Camera) -> Vec<WarpSource<'a>> {
    let source = |v: &SurfaceView<'a>| {
        let SourceView { camera, texture } = v.view;
        WarpSource { texture, sweep: PlaneSweep::new(camera, target), gains: v.gains }
    };
    views.iter().map(source).collect()
}

/// Disparity that moves a point by one pixel on a padded target of that size, 1/scene unit.
pub(crate) fn disparity_per_pixel(sources: &[WarpSource<'_>], size: Size, near: f64, far: f64) -> f32 {
    let sweeps: Vec<_> = sources.iter().map(|source| source.sweep).collect();
    ((1.0 / near - 1.0 / far) / widest_parallax(&sweeps, size, near, far).max(1.0)) as f32
}

/// The confirmed depths splatted to the padded target, row by row; −1 in holes.
pub(crate) fn splat_confirmed(views: &[SurfaceView<'_>], target: &Camera, disparity_per_pixel: f32) -> Vec<f32> {
    let margins = (SAME_SURFACE_PX * disparity_per_pixel, AVERAGED_PX * disparity_per_pixel);
    let maps: Vec<_> = views.iter().map(|v| (v.view.camera, &v.confirmed.disparity)).collect();
    splat(&maps, target, padded(target.size()), margins, Single::Kept)
}

/// A photo with its confirmed depth.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceView<'a> {
    /// Camera and photo.
    pub view: SourceView<'a>,
    /// The photo's depth where other photos confirm it.
    pub confirmed: &'a ConfirmedDisparity,
    /// Factor of each colour channel ([`crate::stages::exposure_gains`]).
    pub gains: [f32; 3],
}

/// Half the side of a point's square, pixels.
const HALF_SIDE: f32 = 0.2;

/// What becomes of a pixel whose depths are those of one photo each: no other has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Single {
    /// It has the nearest of them.
    Kept,
    /// It is a hole.
    LeftOut,
}

/// Disparity of each pixel of a padded target of `size`, row by row; −1 in holes. `maps`: disparities
/// `[h, w]` of photos, below 0 where there is no point. `same` and `averaged`: 1/scene unit.
pub(crate) fn splat(
    maps: &[(&Camera, &Array2<f32>)],
    target: &Camera,
    size: Size,
    (same, averaged): (f32, f32),
    single: Single,
) -> Vec<f32> {
    let each: Vec<Vec<f32>> = maps.par_iter().map(|map| splat_one(map, target, size)).collect();
    let mut fused = vec![-1.0; size.pixels()];
    fused.par_chunks_mut(size.width).enumerate().for_each(|(y, fused)| {
        let begin = (y + 1) * (size.width + 2) + 1;
        let rows: Vec<&[f32]> = each.iter().map(|map| &map[begin..begin + size.width]).collect();
        fuse_row(&rows, (same, averaged), single, fused);
    });
    fused
}

#[pulp::with_simd(fuse_row = liveview::simd::arch())]
#[inline(always)]
fn fuse_row_with<'a, S: pulp::Simd>(
    _simd: S,
    rows: &'a [&'a [f32]],
    (same, averaged): (f32, f32),
    single: Single,
    fused: &'a mut [f32],
) {
    let width = fused.len();
    let mut paired = vec![-1.0; width];
    for (k, row) in rows.iter().enumerate() {
        let row = &row[..width];
        for x in 0..width {
            fused[x] = if row[x] > fused[x] { row[x] } else { fused[x] };
        }
        for other in &rows[..k] {
            let other = &other[..width];
            for x in 0..width {
                let (near, far) = if row[x] > other[x] { (row[x], other[x]) } else { (other[x], row[x]) };
                let pair = (far >= 0.0) & (near - far <= same) & (near > paired[x]);
                paired[x] = if pair { near } else { paired[x] };
            }
        }
    }
    for x in 0..width {
        fused[x] = if (paired[x] >= 0.0) | (single == Single::LeftOut) { paired[x] } else { fused[x] };
    }
    let (mut sum, mut number) = (vec![0.0_f32; width], vec![0.0_f32; width]);
    for row in rows {
        let row = &row[..width];
        for x in 0..width {
            let counts = (row[x] >= 0.0) & (row[x] <= fused[x]) & (fused[x] - row[x] <= averaged);
            sum[x] += if counts { row[x] } else { 0.0 };
            number[x] += if counts { 1.0 } else { 0.0 };
        }
    }
    for x in 0..width {
        fused[x] = if number[x] > 0.0 { sum[x] / number[x] } else { fused[x] };
    }
}

/// The points of one photo on the target, which has a border of one pixel for points that overlap
/// its edge.
fn splat_one((camera, map): &(&Camera, &Array2<f32>), target: &Camera, size: Size) -> Vec<f32> {
    let mut buffer = vec![-1.0_f32; (size.width + 2) * (size.height + 2)];
    let (sweep, mut projected) = (PlaneSweep::new(target, camera), Projected::default());
    for (y, row) in map.outer_iter().enumerate() {
        let row = row.to_slice().expect("standard order");
        project_row(&sweep, y, row, &mut projected);
        splat_row(&projected, row, size, &mut buffer);
    }
    buffer
}

/// Splats the points of a row, given their positions in the target and their disparities `own` in
/// their photo (below 0: no point).
#[pulp::with_simd(splat_row = liveview::simd::arch())]
#[inline(always)]
fn splat_row_with<'a, S: pulp::Simd>(
    _simd: S,
    points: &'a Projected,
    own: &'a [f32],
    size: Size,
    buffer: &'a mut [f32],
) {
    let stride = size.width + 2;
    let (right, bottom) = (size.width as f32 + HALF_SIDE, size.height as f32 + HALF_SIDE);
    let points = points.x.chunks(RUN).zip(points.y.chunks(RUN)).zip(points.disparity.chunks(RUN)).zip(own.chunks(RUN));
    // Index of the upper left corner, and the offsets from it to the right and down: 0 or 1, 0 or a
    // row.
    let (mut first, mut across, mut down) = ([0; RUN], [0; RUN], [0; RUN]);
    for (((x, y), disparity), own) in points {
        for i in 0..x.len() {
            let (x, y) = (x[i], y[i]);
            // A point behind the camera has the position −1.
            let inside = (own[i] >= 0.0) & (x >= -HALF_SIDE) & (y >= -HALF_SIDE) & (x < right) & (y < bottom);
            let [left, right, top, bottom] =
                [x - HALF_SIDE, x + HALF_SIDE, y - HALF_SIDE, y + HALF_SIDE].map(|at| round_to_i32(at.floor()));
            first[i] = if inside { (top + 1) * stride as i32 + left + 1 } else { -1 };
            (across[i], down[i]) = (right - left, (bottom - top) * stride as i32);
        }
        first[x.len()..].fill(-1);
        for i in 0..RUN {
            // In steps of a quarter of a run: consecutive points often fall on the same pixels, and
            // each write would wait for the one before.
            let i = i % 4 * (RUN / 4) + i / 4;
            if first[i] < 0 {
                continue;
            }
            let (disparity, first, across, down) =
                (disparity[i], first[i] as usize, across[i] as usize, down[i] as usize);
            for at in [first, first + across, first + down, first + down + across] {
                buffer[at] = if disparity > buffer[at] { disparity } else { buffer[at] };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use glam::DVec3;

    use super::*;
    use liveview::geometry::Intrinsics;
    use liveview::image::ImageRgb;
    use liveview::warp::Texture;

    fn camera(shift: f64) -> Camera {
        let intrinsics = Intrinsics { fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0, skew: 0.0 };
        Camera::new(intrinsics, 8, 8, DMat3::IDENTITY, DVec3::new(-shift, 0.0, 0.0)).unwrap()
    }

    #[test]
    fn splat_shifted_camera_moves_points_by_parallax_and_keeps_the_nearest() {
        // Disparity 1 moves by eight pixels for a unit's shift.
        let mut map = Array2::from_elem((8, 8), -1.0);
        map[(3, 5)] = 1.0;
        map[(3, 3)] = 0.0;
        let found = splat(&[(&camera(0.0), &map)], &camera(0.25), Size::new(8, 8), (0.0, 0.0), Single::Kept);
        let expected = |at: usize| if at == 3 * 8 + 3 { 1.0 } else { -1.0 };
        assert!(found.iter().enumerate().all(|(at, &d)| d == expected(at)), "{found:?}");
    }

    #[test]
    fn splat_prefers_a_pair_of_photos_to_a_nearer_single_depth() {
        let at = |d: f32| Array2::from_elem((8, 8), d);
        let (a, b, c) = (at(0.5), at(0.25), at(0.125));
        let here = camera(0.0);
        let maps = [(&here, &a), (&here, &b), (&here, &b), (&here, &c)];
        let found = |maps: &[_], single| splat(maps, &here, Size::new(8, 8), (0.01, 0.01), single)[0];
        assert_eq!((found(&maps, Single::Kept), found(&maps[..2], Single::Kept)), (0.25, 0.5));
        assert_eq!((found(&maps, Single::LeftOut), found(&maps[..2], Single::LeftOut)), (0.25, -1.0));
    }

    #[test]
    fn splat_averages_depths_within_the_margin() {
        let at = |d: f32| Array2::from_elem((8, 8), d);
        let (a, b, c) = (at(0.5), at(0.45), at(0.1));
        let here = camera(0.0);
        let maps = [(&here, &a), (&here, &b), (&here, &c)];
        let found = |same: f32, averaged: f32| splat(&maps, &here, Size::new(8, 8), (same, averaged), Single::Kept);
        assert!(found(0.1, 0.1).iter().all(|&d| d == (0.5 + 0.45) / 2.0));
        assert!(found(0.0, 0.0).iter().all(|&d| d == 0.5));
    }

    #[test]
    fn confirmed_depths_are_one_surface_within_two_pixels_and_averaged_within_three() {
        const PX: f32 = 0.01;
        let here = camera(0.0);
        let photo = Texture::new(&ImageRgb::new(8, 8, vec![0.5; 3 * 64]).unwrap());
        let found = |depths: &[f32]| {
            let confirmed =
                |&d: &f32| ConfirmedDisparity { disparity: Array2::from_elem((8, 8), d), disparity_per_pixel: PX };
            let confirmed: Vec<_> = depths.iter().map(confirmed).collect();
            let view = SourceView { camera: &here, texture: &photo };
            let views = confirmed.iter().map(|confirmed| SurfaceView { view, confirmed, gains: [1.0; 3] });
            splat_confirmed(&views.collect::<Vec<_>>(), &here, PX)[0]
        };
        let behind = |pixels: f32| 0.5 - pixels * PX;
        assert!(
            (found(&[0.5, behind(1.98), 0.9]) - (0.5 + behind(1.98)) / 2.0).abs() < 1e-6,
            "a pair before a single depth"
        );
        assert_eq!(found(&[0.5, behind(2.02), 0.9]), 0.9, "no pair: the nearest");
        assert!((found(&[0.5, 0.5, behind(2.98)]) - (1.0 + behind(2.98)) / 3.0).abs() < 1e-6);
        assert_eq!(found(&[0.5, 0.5, behind(3.02)]), 0.5);
    }

    /// Of a pixel's depths, one a photo: as the module's documentation says.
    fn fused(depths: &[f32], (same, averaged): (f32, f32), single: Single) -> f32 {
        let largest = |depths: &[f32]| depths.iter().copied().fold(-1.0, f32::max);
        let has_pair = |k: usize| {
            let others = (0..depths.len()).filter(|&other| other != k).map(|other| depths[other]);
            others.into_iter().any(|other| other >= 0.0 && other <= depths[k] && depths[k] - other <= same)
        };
        let paired: Vec<f32> = (0..depths.len()).filter(|&k| has_pair(k)).map(|k| depths[k]).collect();
        let nearest = match (paired.is_empty(), single) {
            (true, Single::LeftOut) => return -1.0,
            (true, Single::Kept) => largest(depths),
            (false, _) => largest(&paired),
        };
        let near: Vec<f32> =
            depths.iter().copied().filter(|&d| d >= 0.0 && d <= nearest && nearest - d <= averaged).collect();
        if near.is_empty() { nearest } else { near.iter().sum::<f32>() / near.len() as f32 }
    }

    #[test]
    fn splat_equals_its_definition() {
        let size = Size::new(72, 16);
        let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 36.0, cy: 8.0, skew: 0.0 };
        let placed = |x: f64, z: f64, turn: f64| {
            Camera::new(intrinsics, 72, 16, DMat3::from_rotation_y(turn), DVec3::new(x, 0.1 * x, z)).unwrap()
        };
        let target = placed(0.0, 0.0, 0.0);
        let cameras = [placed(0.3, 0.1, 0.02), placed(-0.2, -0.3, 0.0), placed(0.1, -2.5, -0.1)];
        let value = |at: usize, k: usize| {
            let noise = (at as u32).wrapping_mul(2_654_435_761).wrapping_add(k as u32 * 77_777_777) >> 8;
            match noise % 5 {
                0 => -1.0,
                1 => 0.0,
                near => near as f32 * 0.1 + (noise % 13) as f32 * 0.004,
            }
        };
        let map = |k: usize| Array2::from_shape_fn((14, 70), |(y, x)| value(70 * y + x, k));
        let photos: Vec<_> = [0, 1, 2].map(map).into();
        let maps: Vec<_> = cameras.iter().zip(&photos).collect();
        let each: Vec<Vec<f32>> = maps
            .iter()
            .map(|(camera, map)| {
                let (sweep, mut buffer) = (PlaneSweep::new(&target, camera), vec![-1.0_f32; size.pixels()]);
                for ((y, x), &own) in map.indexed_iter().filter(|(_, own)| **own >= 0.0) {
                    let (u, v, disparity) = crate::consistency::project(&sweep, (x, y), own);
                    for (u, v) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)].map(|(a, b)| (u + a, v + b)) {
                        if (0.0..72.0).contains(&u) && (0.0..16.0).contains(&v) && disparity > 0.0
                            || own == 0.0 && (0.0..72.0).contains(&u) && (0.0..16.0).contains(&v)
                        {
                            let at = v as usize * 72 + u as usize;
                            buffer[at] = buffer[at].max(disparity);
                        }
                    }
                }
                buffer
            })
            .collect();
        assert!(each.iter().all(|buffer| buffer.iter().filter(|d| **d >= 0.0).count() > 200));
        for (margins, single) in [((0.02, 0.03), Single::Kept), ((0.05, 0.02), Single::LeftOut)] {
            let found = splat(&maps, &target, size, margins, single);
            for (at, &found) in found.iter().enumerate() {
                let depths: Vec<f32> = each.iter().map(|buffer| buffer[at]).collect();
                let expected = fused(&depths, margins, single);
                assert!((found - expected).abs() < 1e-6, "{at}: {found}, not {expected} of {depths:?}");
            }
        }
    }
}
