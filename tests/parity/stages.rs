//! The stages from photos to frame, except for the guided search, and for those that the Python
//! package has: `python/tests/binding/test_stages.py` compares these, on the same cases.

use liveview::geometry::{Size, distance};
use liveview::network::PlaneNetwork;
use liveview::render::{Batch, Blended, DistanceWeights, LayerSamples, RenderRequest, Renderer};
use liveview::warp::warp_sources;
use ndarray::{Array, Array1, Array3, Array4, Axis, s};

use crate::golden::listed_cases;
use crate::stage_case::{CASES, for_all};

/// Largest difference between the final frames of Rust and of the float32 reference, on [0, 1].
const FRAME_TOLERANCE: f64 = 1e-4;

#[test]
fn generated_cases_are_all_tested() {
    assert_eq!(listed_cases("cases.txt"), CASES);
}

#[test]
fn homography_is_within_bounds() {
    for_all(|case| {
        let Some(disparities) = case.find::<f64>("disparities") else { return };
        let sweeps: Vec<_> = warp_sources(&case.views(), &case.target).iter().map(|s| s.sweep).collect();
        let shape = (disparities.len(), sweeps.len(), 3, 3);
        let found = Array::from_shape_fn(shape, |(d, v, row, column)| {
            sweeps[v].source_from_target(disparities[[d]]).row(row)[column]
        });
        case.check("homography", &found);
    });
}

#[test]
fn disparity_maps_are_within_bounds() {
    for_all(|case| {
        let Size { width, height } = case.padded();
        let layers = case.layers();
        let mut found = Array3::<f32>::zeros((layers.len(), height, width));
        for (layer, mut map) in layers.as_slice().iter().zip(found.outer_iter_mut()) {
            layer.fill(width, map.as_slice_mut().unwrap());
        }
        case.check("maps", &found);
    });
}

#[test]
fn logits_are_within_bounds_and_equal_onnxruntime() {
    for_all(|case| {
        let hwv = case.layers_of("colour");
        let (n, _, height, width) = hwv.dim();
        let mut found = Array::<f32, _>::zeros((n, case.cameras.len(), height, width));
        case.network().infer(hwv.view(), found.view_mut()).unwrap();
        case.check("logits", &found);
        let python = case.get::<f32>("onnxruntime.logits");
        let differ = found.iter().zip(python.iter()).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert_eq!(differ, 0, "{}: ort and onnxruntime differ in {differ} of {} logits", case.name, found.len());
    });
}

fn layer_slice(all: &Array4<f32>, k: usize) -> &[f32] {
    let size = all.len() / all.dim().0;
    &all.as_slice().unwrap()[k * size..(k + 1) * size]
}

#[test]
fn blend_is_within_bounds() {
    for_all(|case| {
        let [logits, colour, coverage] = ["logits", "colour", "coverage"].map(|name| case.layers_of(name));
        let (n, _, height, width) = logits.dim();
        let distances: Vec<f64> = case.cameras.iter().map(|c| distance(c, &case.target)).collect();
        let weights = DistanceWeights::new(&distances);
        let shifts = case.find::<f64>("logit_shift");
        let mut alpha = Array3::<f32>::zeros((n, height, width));
        let mut rgb = Array::<f32, _>::zeros((n, 3, height, width));
        for k in 0..n {
            let [logits, colour, coverage] = [&logits, &colour, &coverage].map(|all| layer_slice(all, k));
            let mut blended = Blended::new(height * width);
            let logit_shift = shifts.as_ref().map_or(0.0, |shifts| shifts[[k]]);
            weights.blend(&LayerSamples { logits, colour, coverage, logit_shift }, 0, &mut blended);
            let plane = |values: Vec<f32>| Array::from_shape_vec((height, width), values).unwrap();
            alpha.index_axis_mut(Axis(0), k).assign(&plane(blended.alpha));
            for (c, values) in blended.rgb.into_iter().enumerate() {
                rgb.slice_mut(s![k, c, .., ..]).assign(&plane(values));
            }
        }
        case.check("alpha", &alpha);
        case.check("rgb", &rgb);
    });
}

/// All stages together, from photos to frame.
#[test]
fn frame_is_within_tolerance_for_any_batch_size() {
    for_all(|case| {
        let views = case.views();
        let frames: Vec<_> = [1, 3]
            .map(|batch| {
                let mut renderer = Renderer::new(Box::new(case.network()), batch);
                renderer.set_alpha(case.alpha());
                let mut shifts = Vec::<f64>::new();
                let mut observer = |batch: &Batch<'_>| shifts.extend(batch.logit_shifts);
                let layers = case.layers();
                let request = RenderRequest::new(&views, &case.target, &layers);
                let frame = renderer.render(RenderRequest { observer: Some(&mut observer), ..request }).unwrap();
                if case.find::<f64>("logit_shift").is_some() {
                    case.check("logit_shift", &Array1::from_vec(shifts));
                }
                frame
            })
            .into();
        let oracle = case.volume::<f64>("oracle.end");
        let torch = case.volume::<f32>("reference.end").mapv(f64::from);
        let picture = &frames[0].picture;
        let rust = Array3::from_shape_fn(oracle.dim(), |(c, y, x)| f64::from(picture.pixel(x, y)[c]));
        let ((rust_max, rust_mean), (torch_max, torch_mean)) = (errors(&rust, &oracle), errors(&torch, &oracle));
        let (difference, _) = errors(&rust, &torch);
        println!(
            "{:13} frame: max {rust_max:.1e} (torch {torch_max:.1e}), mean {rust_mean:.1e} (torch {torch_mean:.1e}), \
             Rust and torch differ by {difference:.1e}",
            case.name
        );
        assert!(difference <= FRAME_TOLERANCE, "{}: frame differs from the reference by {difference:.1e}", case.name);
        assert!(rust_max <= FRAME_TOLERANCE, "{}: frame differs from the oracle by {rust_max:.1e}", case.name);
        assert_eq!(frames[0].picture, frames[1].picture, "{}: the batch size changes the frame", case.name);
    });
}

/// Largest and mean absolute difference.
fn errors(found: &Array3<f64>, expected: &Array3<f64>) -> (f64, f64) {
    let difference = (found - expected).mapv(f64::abs);
    (difference.iter().copied().fold(0.0, f64::max), difference.mean().unwrap())
}
