//! Frames of any photos, cameras and networks: moving or scaling the world does not change them,
//! and colours stay within the range of the photos.

use glam::{DMat3, DQuat, DVec3};
use liveview::geometry::{Camera, Size};
use liveview::layers::{CELL, Layers, padded};

use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::{Frame, RenderRequest, Renderer};
use liveview::warp::{SourceView, Texture};
use ndarray::{Array2, ArrayView4, ArrayViewMut4};
use proptest::prelude::*;

use crate::synthetic::{PseudorandomNetwork, camera, photo};

/// Columns and rows of the target.
const SIZE: (usize, usize) = (20, 16);
/// Columns and rows of the photos, which cover every pixel of the target on every layer.
const PHOTO: (usize, usize) = (80, 64);

/// Each logit is a weighted sum of the colours with weights that add up to 1: it changes by no more
/// than the colours do.
struct WeightedSum;

impl PlaneNetwork for WeightedSum {
    fn views(&self) -> usize {
        2
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        for ((n, v, y, x), logit) in logits.indexed_iter_mut() {
            *logit = (0..6).map(|c| ((c + 2 * v) % 6) as f32 / 15.0 * hwv[[n, c, y, x]]).sum::<f32>() - 0.5;
        }
        Ok(())
    }
}

/// Two views and the target between them.
struct Rig {
    views: [Camera; 2],
    photos: [Texture; 2],
    target: Camera,
}

impl Rig {
    fn new(seed: u32) -> Self {
        let turn = DMat3::from_rotation_y(0.03);
        let views = [-0.1, 0.15].map(|x| camera(PHOTO, turn, DVec3::new(x, 0.05, 0.0)));
        let target = camera(SIZE, DMat3::IDENTITY, DVec3::ZERO);
        Self { views, photos: [photo(PHOTO, seed), photo(PHOTO, !seed)], target }
    }

    /// The same rig with other poses.
    fn moved(&self, place: impl Fn(&Camera) -> (DMat3, DVec3)) -> Self {
        let placed = |camera: &Camera| {
            let (rotation, translation) = place(camera);
            camera.with_pose(rotation, translation).unwrap()
        };
        let views = [placed(&self.views[0]), placed(&self.views[1])];
        Self { views, photos: self.photos.clone(), target: placed(&self.target) }
    }

    fn sources(&self) -> Vec<SourceView<'_>> {
        self.views.iter().zip(&self.photos).map(|(camera, texture)| SourceView { camera, texture }).collect()
    }

    fn render(&self, network: impl PlaneNetwork + 'static, layers: &Layers, batch: usize) -> Frame {
        Renderer::new(Box::new(network), Alpha::Independent, batch)
            .render(RenderRequest::new(&self.sources(), &self.target, layers))
            .unwrap()
    }
}

fn max_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(range).prop_map(DVec3::from_array)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// The poses of the two worlds differ by rounding errors of f64. Therefore a sample position
    /// may be computed in f64 in one world and from row offsets in the other
    /// (warp/sample_positions.rs). The two positions differ by up to 8e-6 pixels in each direction,
    /// and a photo of noise changes by up to 1 per pixel. α changes by at most a quarter of that on
    /// each layer, and the picture by at most the sum over the 6 layers.
    #[test]
    fn frame_of_a_rigidly_moved_world_is_the_same(
        seed in any::<u32>(), axis in vector(-1.0..1.0), angle in -3.0..3.0, shift in vector(-50.0..50.0),
    ) {
        prop_assume!(axis.length() > 0.1);
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle));
        let rig = Rig::new(seed);
        let moved = rig.moved(|camera| {
            let rotation = camera.rotation() * turn.transpose();
            (rotation, camera.translation() - rotation * shift)
        });
        let layers = Layers::uniform(1.0, 8.0, 6).unwrap();
        let [before, after] = [&rig, &moved].map(|rig| rig.render(WeightedSum, &layers, 2));
        let colour = 2.0 * 8e-6;
        let bound = colour + 6.0 * 0.25 * colour + 1e-6;
        let picture = max_difference(before.raw().data(), after.raw().data());
        prop_assert!(picture <= bound, "pictures differ by {picture:e}, bound {bound:e}");
        let disparity = max_difference(before.disparity.as_slice().unwrap(), after.disparity.as_slice().unwrap());
        prop_assert!(disparity <= bound, "disparities differ by {disparity:e}, bound {bound:e}");
    }

    #[test]
    fn frame_of_a_world_scaled_by_a_power_of_two_has_the_same_bits(seed in any::<u32>(), power in -60..60_i32) {
        let unit = 2.0_f64.powi(power);
        let rig = Rig::new(seed);
        let scaled = rig.moved(|camera| (camera.rotation(), camera.translation() * unit));
        let planes = |unit: f64| Layers::planes(&[1.0, 0.7, 0.3, 0.0].map(|disparity| disparity / unit)).unwrap();
        let Size { width, height } = padded(Size::new(SIZE.0, SIZE.1));
        let map = |nearest: f64| {
            move |(y, x): (usize, usize)| (nearest * (1.0 + 0.5 * ((x + 2 * y) as f64 * 0.3).sin())) as f32
        };
        let cells = (height / CELL, width / CELL);
        let maps = |unit: f64| {
            Layers::maps([0.6, 0.2].map(|nearest| Array2::from_shape_fn(cells, map(nearest / unit))).to_vec()).unwrap()
        };
        for (before, after) in [
            (rig.render(PseudorandomNetwork::new(0.0), &planes(1.0), 2), scaled.render(PseudorandomNetwork::new(0.0), &planes(unit), 2)),
            (rig.render(PseudorandomNetwork::new(0.0), &maps(1.0), 1), scaled.render(PseudorandomNetwork::new(0.0), &maps(unit), 1)),
        ] {
            prop_assert_eq!(before.raw().data(), after.raw().data());
            prop_assert_eq!(before.transmittance, after.transmittance);
            prop_assert_eq!(before.best_layer, after.best_layer);
            prop_assert_eq!(before.disparity, after.disparity * unit as f32);
        }
    }

    #[test]
    fn picture_stays_within_the_range_of_the_photos(
        low in 0.0_f32..0.5, span in 0.0_f32..0.5, seed in any::<u32>(), opacity in -20.0_f32..20.0,
    ) {
        let mut rig = Rig::new(seed);
        let photo_in_range = |seed: u32| {
            let noise = |i: u32| (i.wrapping_add(seed).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
            let values = (0..3 * (PHOTO.0 * PHOTO.1) as u32).map(|i| low + span * noise(i)).collect();
            Texture::new(&liveview::image::ImageRgb::new(PHOTO.0, PHOTO.1, values).unwrap())
        };
        rig.photos = [photo_in_range(seed), photo_in_range(!seed)];
        let frame = rig.render(PseudorandomNetwork::new(opacity), &Layers::uniform(1.0, 8.0, 5).unwrap(), 2);
        let outside = frame.raw().data().iter().map(|&value| (low - value).max(value - low - span)).fold(0.0, f32::max);
        // Sampling rounds to f32 twice on each of two axes, and blending rounds three times.
        prop_assert!(outside <= 8.0 * f32::EPSILON, "{outside:e} outside");
    }
}
