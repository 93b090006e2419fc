//! Algebra of blending and compositing, for any views and planes.

use liveview::render::{Accumulated, Blended, Competing, DistanceWeights, LayerSamples};
use proptest::prelude::*;

/// Distance, logit, colour and coverage of a pixel in each view.
fn pixel_views(views: std::ops::Range<usize>) -> impl Strategy<Value = Vec<(f64, f32, f32, f32)>> {
    let distance = (-60.0..60.0_f64).prop_map(|power| power.exp2());
    let logit = prop_oneof![-10.0_f32..10.0, -1e4_f32..1e4];
    let coverage = prop_oneof![Just(0.0_f32), Just(1.0), 1e-6_f32..1.0];
    prop::collection::vec((distance, logit, 0.0_f32..1.0, coverage), views)
}

/// α and grey value of a blended pixel, and whether it is covered. Colours are passed premultiplied
/// by coverage.
fn blend(views: &[(f64, f32, f32, f32)]) -> (f32, f32, bool) {
    let distances: Vec<f64> = views.iter().map(|view| view.0).collect();
    let logits: Vec<f32> = views.iter().map(|view| view.1).collect();
    let colour: Vec<f32> = views.iter().flat_map(|view| [view.2 * view.3; 3]).collect();
    let coverage: Vec<f32> = views.iter().map(|view| view.3).collect();
    let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage };
    let mut out = Blended::new(1);
    samples.blend(&DistanceWeights::new(&distances), 0, &mut out);
    (out.alpha[0], out.rgb[0][0], out.covered[0])
}

/// α, grey value and disparity of a plane at one pixel.
type Plane = (f32, f32, f32);

fn composite<'a>(planes: impl IntoIterator<Item = &'a Plane>) -> Accumulated {
    let mut row = Accumulated::new(1);
    for &(alpha, grey, disparity) in planes {
        let layer = Blended { alpha: vec![alpha], rgb: std::array::from_fn(|_| vec![grey]), covered: vec![true] };
        // All planes get the same index: these tests do not compare the best layer.
        row.add(0, &layer, &[disparity], false);
    }
    row
}

/// Composites competing planes, with 100 times their α as logits.
fn competing<'a>(planes: impl IntoIterator<Item = (usize, &'a Plane)>) -> Accumulated {
    let mut row = Competing::new(1, 1.5);
    for (index, &(logit, grey, disparity)) in planes {
        let layer = Blended { alpha: vec![0.0], rgb: std::array::from_fn(|_| vec![grey]), covered: vec![true] };
        row.add(index as u32, &[100.0 * logit], &layer, &[disparity]);
    }
    row.finish()
}

fn planes(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Plane>> {
    // 0 and 1, and numbers close to them.
    let special =
        prop::sample::select(vec![0.0, f32::from_bits(1), f32::MIN_POSITIVE, 1e-7, 1.0 - f32::EPSILON / 2.0, 1.0]);
    let alpha = prop_oneof![0.0_f32..1.0, special];
    prop::collection::vec((alpha, 0.0_f32..1.0, 0.0_f32..1.0), count)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// The first of a pixel's logits is that of α, and the logit of the nearest view's weight is 0.
    /// So only the other views are permuted, with their logits; sums of f64 change their order.
    #[test]
    fn blend_with_farther_views_permuted_gives_the_same_colour(views in pixel_views(2..7), by in 0..6_usize) {
        let mut moved = views.clone();
        moved[1..].rotate_left(by % (views.len() - 1));
        let (before, after) = (blend(&views), blend(&moved));
        prop_assert_eq!((before.0, before.2), (after.0, after.2));
        prop_assert!((before.1 - after.1).abs() <= f32::EPSILON, "{} and {}", before.1, after.1);
    }

    #[test]
    fn blended_colour_lies_between_those_of_the_covering_views(views in pixel_views(1..7)) {
        let (alpha, grey, covered) = blend(&views);
        let colours = || views.iter().filter(|view| view.3 > 0.0).map(|view| view.2);
        prop_assert_eq!(covered, colours().next().is_some());
        prop_assert!((0.0..=1.0).contains(&alpha));
        if covered {
            let (low, high) = (colours().fold(1.0, f32::min), colours().fold(0.0, f32::max));
            // Premultiplying rounds once, and so does each of the two products with the weight.
            let margin = 4.0 * f32::EPSILON;
            prop_assert!((low - margin..=high + margin).contains(&grey), "{grey} is not in {low} to {high}");
        } else {
            prop_assert_eq!((alpha, grey), (0.0, 0.0));
        }
    }

    #[test]
    fn composite_with_a_transparent_plane_has_the_same_bits(planes in planes(1..40), at in any::<prop::sample::Index>(), grey in 0.0_f32..1.0) {
        let mut more = planes.clone();
        more.insert(at.index(planes.len() + 1), (0.0, grey, 0.5));
        let (mut row, mut expected) = (composite(&more), composite(&planes));
        // The transparent plane is never the best layer, but it may shift the index of the best
        // one.
        (row.best_layer, expected.best_layer) = (Vec::new(), Vec::new());
        prop_assert_eq!(row, expected);
    }

    /// C = C_front + T_front C_rest and T = T_front T_rest; each of the n additions and products
    /// rounds once.
    #[test]
    fn composite_of_front_and_rest_is_the_composite_of_all(planes in planes(1..200), at in any::<prop::sample::Index>()) {
        let (front, rest) = planes.split_at(at.index(planes.len() + 1));
        let (all, front, rest) = (composite(&planes), composite(front), composite(rest));
        let bound = 2.0 * planes.len() as f64 * f64::EPSILON;
        let transmittance = front.transmittance[0];
        for (all, front, rest) in [
            (all.rgb[1][0], front.rgb[1][0], rest.rgb[1][0]),
            (all.disparity[0], front.disparity[0], rest.disparity[0]),
            (all.transmittance[0], 0.0, rest.transmittance[0]),
        ] {
            prop_assert!((all - (front + transmittance * rest)).abs() <= bound, "{all} and {front} + {transmittance} {rest}");
        }
    }

    /// Each of the n additions and products rounds once, and the relative error of the exponential
    /// is at most 4e-10.
    #[test]
    fn competing_planes_in_any_order_give_the_same_picture(planes in planes(1..200), by in any::<prop::sample::Index>()) {
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

    /// Competing planes give the same pixel as a multiplane image, composited front to back, in
    /// which a plane's α is its weight divided by the sum of its own and all farther weights.
    #[test]
    fn competing_planes_equal_a_multiplane_image(planes in planes(1..60)) {
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
        let error = (row.rgb[0][0] + row.transmittance[0] - 1.0).abs();
        prop_assert!(error <= planes.len() as f64 * f64::EPSILON, "{error:e}");
    }
}
