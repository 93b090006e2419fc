//! The blend of single pixels.

use super::*;

/// One pixel: α, colour and whether it is covered.
fn blend(distances: &[f64], logits: &[f32], coverage: &[f32]) -> (f32, [f32; 3], bool) {
    let grey: Vec<f32> = coverage.iter().enumerate().flat_map(|(v, c)| [c * (v + 1) as f32 / 10.0; 3]).collect();
    let mut out = Blended::new(1);
    let samples = LayerSamples { logits, colour: &grey, coverage, logit_shift: 0.0 };
    DistanceWeights::new(distances).blend(&samples, 0, &mut out);
    (out.alpha[0], std::array::from_fn(|c| out.rgb[c][0]), out.covered[0])
}

#[test]
fn equal_logits_are_weighted_by_inverse_distance() {
    let (alpha, rgb, _) = blend(&[1.0, 3.0], &[0.0, 0.0], &[1.0, 1.0]);
    assert_eq!(alpha, 0.5);
    assert!((rgb[0] - (0.75 * 0.1 + 0.25 * 0.2)).abs() < 1e-7, "{rgb:?}");
}

#[test]
fn low_coverage_does_not_darken_the_colour() {
    let (_, rgb, _) = blend(&[1.0, 1.0], &[0.0, 0.0], &[1e-6, 0.0]);
    assert!((rgb[0] - 0.1).abs() < 1e-7, "{rgb:?}");
}

#[test]
fn coincident_view_has_all_weight_where_it_covers_the_pixel() {
    assert_eq!(blend(&[0.0, 1.0], &[0.0, 50.0], &[1.0, 1.0]).1, [0.1; 3]);
    assert_eq!(blend(&[0.0, 1.0], &[0.0, 50.0], &[0.0, 1.0]).1, [0.2; 3]);
}

#[test]
fn extreme_logits_and_distances_stay_finite() {
    assert_eq!(blend(&[1e-30, 1e30], &[-1e4, 1e4], &[1.0, 1.0]), (0.0, [0.2; 3], true));
    assert_eq!(blend(&[1e-30, 1.0], &[1e4, -1e4], &[0.0, 1.0]), (1.0, [0.2; 3], true));
    let infinity = f32::INFINITY;
    assert_eq!(blend(&[1.0; 3], &[-infinity, infinity, infinity], &[1.0; 3]).1, [0.25; 3]);
}

#[test]
fn uncovered_pixel_is_transparent() {
    assert_eq!(blend(&[1.0, 2.0], &[9.0, 0.0], &[0.0, 0.0]), (0.0, [0.0; 3], false));
}
