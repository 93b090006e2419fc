//! Properties that hold for all photos, cameras and networks: symmetries of the world, and the
//! algebra of blending and compositing.

mod double;

use double::{Scrambler, camera, photo};
use glam::{DMat3, DQuat, DVec3};
use liveview::geometry::{Camera, Size};
use liveview::layers::guided::GuidedSearch;
use liveview::layers::{Layers, padded};
use liveview::network::{NetworkError, PlaneNetwork};
use liveview::render::{
    Accumulated, Blended, Competing, DistanceWeights, Frame, LayerSamples, RenderRequest, Renderer,
};
use liveview::warp::{SourceView, Texture, warp_sources};
use ndarray::{ArrayView4, ArrayViewMut4};
use proptest::prelude::*;

/// Columns and rows of the target.
const SIZE: (usize, usize) = (20, 16);
/// Columns and rows of the photos, which cover every pixel of the target on every layer.
const PHOTO: (usize, usize) = (80, 64);

/// A network whose logits change by no more than the colours do: the sum of each logit's weights is
/// 1.
struct WeightedSum;

impl PlaneNetwork for WeightedSum {
    fn views(&self) -> usize {
        2
    }

    fn infer(&mut self, hwv: ArrayView4<'_, f32>, mut logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
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
        Renderer::new(Box::new(network), batch)
            .render(RenderRequest::new(&self.sources(), &self.target, layers))
            .unwrap()
    }

    /// Renders on guided layers between these depths.
    fn render_guided(&self, network: impl PlaneNetwork + 'static, near: f64, far: f64) -> Frame {
        let size = padded(Size::new(SIZE.0, SIZE.1));
        let sources = warp_sources(&self.sources(), &self.target);
        let found = GuidedSearch::new(near, far).search(&sources, size).unwrap();
        self.render(network, &found.range.layers(3).unwrap(), 1)
    }
}

fn scrambler() -> Scrambler {
    Scrambler::new(0.0)
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

    /// Poses differ by roundings of f64, so that a position may be computed in f64 for one of them
    /// and by offsets for the other: these differ by up to 8e-6 of a pixel
    /// (warp/sample_positions.rs) in each direction, and a photo of noise changes by up to 1 per
    /// pixel. α changes by at most a quarter of that per layer, and the picture by at most the sum
    /// over the 6 layers.
    #[test]
    fn render_rigid_motion_of_the_world_gives_the_same_picture(
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
        let picture = max_difference(before.picture.data(), after.picture.data());
        prop_assert!(picture <= bound, "pictures {picture:e} different, bound {bound:e}");
        let disparity = max_difference(before.disparity.as_slice().unwrap(), after.disparity.as_slice().unwrap());
        prop_assert!(disparity <= bound, "disparities {disparity:e} different, bound {bound:e}");
    }

    #[test]
    fn render_scaled_by_a_power_of_two_gives_the_same_bits(seed in any::<u32>(), power in -60..60_i32) {
        let unit = 2.0_f64.powi(power);
        let rig = Rig::new(seed);
        let scaled = rig.moved(|camera| (camera.rotation(), camera.translation() * unit));
        let planes = |unit: f64| Layers::planes(&[1.0, 0.7, 0.3, 0.0].map(|disparity| disparity / unit)).unwrap();
        for (before, after) in [
            (rig.render(scrambler(), &planes(1.0), 2), scaled.render(scrambler(), &planes(unit), 2)),
            (rig.render_guided(scrambler(), 1.0, 9.0), scaled.render_guided(scrambler(), unit, 9.0 * unit)),
        ] {
            prop_assert_eq!(before.picture.data(), after.picture.data());
            prop_assert_eq!(before.transmittance, after.transmittance);
            prop_assert_eq!(before.best_layer, after.best_layer);
            prop_assert_eq!(before.disparity, after.disparity * unit as f32);
        }
    }

    #[test]
    fn render_stays_within_the_range_of_the_photos_colours(
        low in 0.0_f32..0.5, span in 0.0_f32..0.5, seed in any::<u32>(), opacity in -20.0_f32..20.0,
    ) {
        let mut rig = Rig::new(seed);
        let within = |seed: u32| {
            let noise = |i: u32| (i.wrapping_add(seed).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
            let values = (0..3 * (PHOTO.0 * PHOTO.1) as u32).map(|i| low + span * noise(i)).collect();
            Texture::new(&liveview::image::ImageRgb::new(PHOTO.0, PHOTO.1, values).unwrap())
        };
        rig.photos = [within(seed), within(!seed)];
        let frame = rig.render(Scrambler::new(opacity), &Layers::uniform(1.0, 8.0, 5).unwrap(), 2);
        let outside = frame.picture.data().iter().map(|&value| (low - value).max(value - low - span)).fold(0.0, f32::max);
        // A sample has two roundings of f32 on each of two axes, blending three more.
        prop_assert!(outside <= 8.0 * f32::EPSILON, "{outside:e} outside");
    }
}

/// Distance, logit, colour and coverage of each of several views of a pixel.
fn seen_by(views: std::ops::Range<usize>) -> impl Strategy<Value = Vec<(f64, f32, f32, f32)>> {
    let distance = (-60.0..60.0_f64).prop_map(|power| power.exp2());
    let logit = prop_oneof![-10.0_f32..10.0, -1e4_f32..1e4];
    let coverage = prop_oneof![Just(0.0_f32), Just(1.0), 1e-6_f32..1.0];
    prop::collection::vec((distance, logit, 0.0_f32..1.0, coverage), views)
}

/// α and grey of a blended pixel, and whether it is covered. The volume contains colour times
/// coverage.
fn blend(views: &[(f64, f32, f32, f32)]) -> (f32, f32, bool) {
    let distances: Vec<f64> = views.iter().map(|view| view.0).collect();
    let logits: Vec<f32> = views.iter().map(|view| view.1).collect();
    let colour: Vec<f32> = views.iter().flat_map(|view| [view.2 * view.3; 3]).collect();
    let coverage: Vec<f32> = views.iter().map(|view| view.3).collect();
    let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage, logit_shift: 0.0 };
    let mut out = Blended::new(1);
    DistanceWeights::new(&distances).blend(&samples, 0, &mut out);
    (out.alpha[0], out.rgb[0][0], out.covered[0])
}

/// A layer of one pixel: α, grey, disparity.
type Plane = (f32, f32, f32);

fn composite<'a>(planes: impl IntoIterator<Item = &'a Plane>) -> Accumulated {
    let mut row = Accumulated::new(1);
    for &(alpha, grey, disparity) in planes {
        let layer = Blended { alpha: vec![alpha], rgb: std::array::from_fn(|_| vec![grey]), covered: vec![true] };
        // One index for all: the best layer is not tested here.
        row.add(0, &layer, &[disparity], false);
    }
    row
}

/// Composites planes that compete, with 100 times their α as logits.
fn competing<'a>(planes: impl IntoIterator<Item = (usize, &'a Plane)>) -> Accumulated {
    let mut row = Competing::new(1, 1.5);
    for (index, &(logit, grey, disparity)) in planes {
        let layer = Blended { alpha: vec![0.0], rgb: std::array::from_fn(|_| vec![grey]), covered: vec![true] };
        row.add(index as u32, &[100.0 * logit], &layer, &[disparity]);
    }
    row.finish()
}

fn planes(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Plane>> {
    // Transparent, opaque, and the floats next to them.
    let special =
        prop::sample::select(vec![0.0, f32::from_bits(1), f32::MIN_POSITIVE, 1e-7, 1.0 - f32::EPSILON / 2.0, 1.0]);
    let alpha = prop_oneof![0.0_f32..1.0, special];
    prop::collection::vec((alpha, 0.0_f32..1.0, 0.0_f32..1.0), count)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// The network's first logit is α, and the weight of the nearest view has logit 0: the other
    /// views may be permuted with their logits. Only sums of f64 change their order.
    #[test]
    fn blend_permuted_views_but_the_nearest_gives_the_same_colour(views in seen_by(2..7), by in 0..6_usize) {
        let mut moved = views.clone();
        moved[1..].rotate_left(by % (views.len() - 1));
        let (before, after) = (blend(&views), blend(&moved));
        prop_assert_eq!((before.0, before.2), (after.0, after.2));
        prop_assert!((before.1 - after.1).abs() <= f32::EPSILON, "{} and {}", before.1, after.1);
    }

    #[test]
    fn blend_lies_between_the_colours_of_the_covering_views(views in seen_by(1..7)) {
        let (alpha, grey, covered) = blend(&views);
        let seen = || views.iter().filter(|view| view.3 > 0.0).map(|view| view.2);
        prop_assert_eq!(covered, seen().next().is_some());
        prop_assert!((0.0..=1.0).contains(&alpha));
        if covered {
            let (low, high) = (seen().fold(1.0, f32::min), seen().fold(0.0, f32::max));
            // Colour times coverage is rounded, and so are both products with the weight.
            let margin = 4.0 * f32::EPSILON;
            prop_assert!((low - margin..=high + margin).contains(&grey), "{grey} is not in {low} to {high}");
        } else {
            prop_assert_eq!((alpha, grey), (0.0, 0.0));
        }
    }

    #[test]
    fn composite_transparent_plane_changes_no_bit(planes in planes(1..40), at in any::<prop::sample::Index>(), grey in 0.0_f32..1.0) {
        let mut more = planes.clone();
        more.insert(at.index(planes.len() + 1), (0.0, grey, 0.5));
        let (mut row, mut expected) = (composite(&more), composite(&planes));
        // It is never the best layer; the indices of the others are not compared.
        (row.best_layer, expected.best_layer) = (Vec::new(), Vec::new());
        prop_assert_eq!(row, expected);
    }

    /// C = C_front + T_front C_rest, and T = T_front T_rest; each of n additions and products is
    /// rounded once.
    #[test]
    fn composite_of_front_and_rest_is_the_composite_of_all(planes in planes(1..200), at in any::<prop::sample::Index>()) {
        let (front, rest) = planes.split_at(at.index(planes.len() + 1));
        let (all, front, rest) = (composite(&planes), composite(front), composite(rest));
        let bound = 2.0 * planes.len() as f64 * f64::EPSILON;
        let left = front.transmittance[0];
        for (all, front, rest) in [
            (all.rgb[1][0], front.rgb[1][0], rest.rgb[1][0]),
            (all.disparity[0], front.disparity[0], rest.disparity[0]),
            (all.transmittance[0], 0.0, rest.transmittance[0]),
        ] {
            prop_assert!((all - (front + left * rest)).abs() <= bound, "{all} and {front} + {left} {rest}");
        }
    }

    /// Each of n additions and products is rounded once, and the exponential is exact to 4e-10 of
    /// its value.
    #[test]
    fn competing_layers_in_any_order_give_the_same_picture(planes in planes(1..200), by in any::<prop::sample::Index>()) {
        let numbered: Vec<_> = planes.iter().enumerate().collect();
        let mut moved = numbered.clone();
        moved.rotate_left(by.index(planes.len()));
        moved.reverse();
        let (before, after) = (competing(numbered), competing(moved));
        prop_assert_eq!((&before.best_layer, &before.transmittance), (&after.best_layer, &after.transmittance));
        for (a, b) in [(before.rgb[0][0], after.rgb[0][0]), (before.disparity[0], after.disparity[0])] {
            prop_assert!((a - b).abs() <= 5e-9, "{a} and {b}");
        }
    }

    /// Competing planes equal an MPI whose α are each plane's weight divided by the sum of its own
    /// and all farther weights, composited front to back.
    #[test]
    fn competing_planes_equal_an_mpi(planes in planes(1..60)) {
        let found = competing(planes.iter().enumerate());
        let terms: Vec<f64> = planes.iter().map(|plane| (1.5 * f64::from(100.0 * plane.0)).exp()).collect();
        let behind = |k: usize| terms[k..].iter().sum::<f64>();
        let alphas = (0..planes.len()).map(|k| (terms[k] / behind(k)) as f32);
        let mpi: Vec<Plane> = planes.iter().zip(alphas).map(|(plane, alpha)| (alpha, plane.1, plane.2)).collect();
        let expected = composite(&mpi);
        for (a, b) in [(found.rgb[0][0], expected.rgb[0][0]), (found.disparity[0], expected.disparity[0])] {
            prop_assert!((a - b).abs() <= 2.0 * f64::from(f32::EPSILON), "{a} and {b}");
        }
    }

    #[test]
    fn composite_weights_and_transmittance_sum_to_one(mut planes in planes(1..400)) {
        planes.iter_mut().for_each(|plane| plane.1 = 1.0);
        let row = composite(&planes);
        let off = (row.rgb[0][0] + row.transmittance[0] - 1.0).abs();
        prop_assert!(off <= planes.len() as f64 * f64::EPSILON, "{off:e}");
    }
}
