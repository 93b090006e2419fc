//! Every stage of the runtime against the float64 reference: parity/goldens holds small cases that
//! python/liveview_ref/parity/goldens.py wrote (`make goldens`), so that no Python is needed here.
//!
//! Bounds are the ceilings of parity/tolerances.json, which come from an analysis of each stage and
//! hold on every processor; others are stated with their reason. Each test prints its stage, the number
//! of values compared, the largest error and the bound (`cargo test --test goldens -- --nocapture`).

mod wheel;

use std::path::{Path, PathBuf};

use liveview::geometry::Size;
use liveview::layers::{plane_histogram, select_planes, uniform_disparities};
use liveview::network::{Alpha, ExecutionProvider, OrtNetwork, PlaneNetwork};
use liveview::render::{Accumulated, Blended, Competing, DistanceWeights, LayerSamples};
use liveview::warp::{SourceView, warp_layers, warp_sources};
use liveview::{Camera, ImageRgb, Layers, RenderRequest, Renderer, Texture};
use ndarray::{ArrayView4, ArrayViewMut4};
use serde_json::Value;

// --- reading ---

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn json(path: PathBuf) -> Value {
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn cases(stage: &str) -> Vec<Value> {
    let file = json(root().join("parity/goldens").join(format!("{stage}.json")));
    file["cases"].as_array().expect("a list of cases").clone()
}

/// The ceiling of a stage in parity/tolerances.json.
fn ceiling(stage: &str) -> f64 {
    json(root().join("parity/tolerances.json"))[stage]["ceiling"].as_f64().expect("a stage with a ceiling")
}

fn text(value: &Value) -> &str {
    value.as_str().expect("a text")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("an array").iter().map(|number| number.as_f64().expect("a number")).collect()
}

/// Numbers that were float32, or 8-bit.
fn floats(value: &Value) -> Vec<f32> {
    numbers(value).into_iter().map(|number| number as f32).collect()
}

fn flags(value: &Value) -> Vec<bool> {
    numbers(value).into_iter().map(|number| number != 0.0).collect()
}

fn size(value: &Value) -> Size {
    let sides = numbers(value);
    Size::new(sides[0] as usize, sides[1] as usize)
}

fn camera(value: &Value) -> Camera {
    let row = |row: &Value| numbers(row);
    let rows = |matrix: &Value| matrix.as_array().expect("rows").iter().map(row).collect::<Vec<_>>();
    let k = rows(&value["k"]).into_iter().map(|row| row.try_into().expect("3 columns")).collect::<Vec<_>>();
    let mut pose: Vec<[f64; 4]> =
        rows(&value["pose"]).into_iter().map(|row| row.try_into().expect("4 columns")).collect();
    pose.push([0.0, 0.0, 0.0, 1.0]);
    let (k, pose) = (k.try_into().expect("3 rows"), pose.try_into().expect("4 rows"));
    Camera::from_opencv(k, pose, size(&value["size"])).expect("a camera")
}

/// An 8-bit photo.
fn photo(values: &Value, size: Size) -> Texture {
    let values = floats(values).into_iter().map(|value| value / 255.0).collect();
    Texture::new(&ImageRgb::new(size.width, size.height, values).expect("three values a pixel"))
}

/// Layers `[n]` of colours `[n, 3, pixels]`, without opacity.
fn coloured(rgb: &[f32], pixels: usize) -> Vec<Blended> {
    let layer = |rgb: &[f32]| Blended {
        rgb: [0, 1, 2].map(|channel| rgb[channel * pixels..][..pixels].to_vec()),
        ..Blended::new(pixels)
    };
    rgb.chunks(3 * pixels).map(layer).collect()
}

// --- comparing ---

/// Values of one stage that were compared with one bound.
struct Stage {
    name: &'static str,
    bound: f64,
    values: usize,
    largest: f64,
}

impl Stage {
    fn new(name: &'static str, bound: f64) -> Self {
        Self { name, bound, values: 0, largest: 0.0 }
    }

    /// Compares absolute differences with the bound.
    fn compare<T: Into<f64> + Copy>(&mut self, case: &Value, found: &[T], expected: &Value) {
        self.compare_in_units_of(1.0, case, found, expected);
    }

    /// Compares differences relative to the largest expected element.
    fn compare_relative<T: Into<f64> + Copy>(&mut self, case: &Value, found: &[T], expected: &Value) {
        let largest = numbers(expected).into_iter().map(f64::abs).fold(0.0, f64::max);
        self.compare_in_units_of(largest, case, found, expected);
    }

    fn compare_in_units_of<T: Into<f64> + Copy>(&mut self, unit: f64, case: &Value, found: &[T], expected: &Value) {
        let (stage, bound, case, expected) = (self.name, self.bound, text(&case["name"]), numbers(expected));
        assert_eq!(found.len(), expected.len(), "{stage}, {case}: number of values");
        let error = |i: usize| {
            let found: f64 = found[i].into();
            if found == expected[i] { 0.0 } else { (found - expected[i]).abs() / unit }
        };
        // total_cmp: NaN counts as the largest error.
        let worst = (0..found.len()).max_by(|&a, &b| error(a).total_cmp(&error(b))).expect("at least one value");
        assert!(
            error(worst) <= bound,
            "{stage}, {case}: element {worst} is {:?}, expected {:?}: error {:.3e}, bound {bound:.1e}",
            found[worst].into(),
            expected[worst],
            error(worst),
        );
        self.values += found.len();
        self.largest = self.largest.max(error(worst));
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        println!("{}: {} values, largest error {:.2e}, bound {:.1e}", self.name, self.values, self.largest, self.bound);
    }
}

// --- the stages ---

#[test]
fn warp_equals_the_reference() {
    let mut colours = Stage::new("warp: colour", ceiling("colour"));
    let mut coverages = Stage::new("warp: coverage", ceiling("coverage"));
    for case in cases("warp") {
        let (source, target) = (camera(&case["source"]), camera(&case["target"]));
        let texture = photo(&case["photo"], source.size());
        let views = [SourceView { camera: &source, texture: &texture }];
        let pixels = target.size().pixels();
        let disparity: Vec<f32> = floats(&case["disparities"]).into_iter().flat_map(|d| vec![d; pixels]).collect();
        let (mut colour, mut coverage) = (vec![-1.0; 3 * disparity.len()], vec![-1.0; disparity.len()]);
        warp_layers(&disparity, &warp_sources(&views, &target), target.size(), &mut colour, &mut coverage);
        colours.compare(&case, &colour, &case["colour"]);
        coverages.compare(&case, &coverage, &case["coverage"]);
    }
}

#[test]
fn blend_equals_the_reference() {
    let mut alphas = Stage::new("blend: alpha", ceiling("alpha"));
    let mut colours = Stage::new("blend: colour", ceiling("rgb"));
    for case in cases("blend") {
        let [logits, colour, coverage] = ["logits", "colour", "coverage"].map(|name| floats(&case[name]));
        let distances = numbers(&case["distances"]);
        let mut out = Blended::new(coverage.len() / distances.len());
        let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage };
        samples.blend(&DistanceWeights::new(&distances), 0, &mut out);
        alphas.compare(&case, &out.alpha, &case["alpha"]);
        colours.compare(&case, &out.rgb.concat(), &case["rgb"]);
    }
}

/// The four results of a composite.
struct Composites {
    rgb: Stage,
    disparity: Stage,
    transmittance: Stage,
    best: Stage,
}

impl Composites {
    fn new([rgb, disparity, transmittance, best]: [&'static str; 4]) -> Self {
        Self {
            rgb: Stage::new(rgb, ceiling("frame")),
            disparity: Stage::new(disparity, ceiling("disparity")),
            transmittance: Stage::new(transmittance, ceiling("transmittance")),
            best: Stage::new(best, 0.0), // a choice
        }
    }

    fn compare(&mut self, case: &Value, found: &Accumulated) {
        let best: Vec<f64> = found.best_layer.iter().map(|&k| if k == u32::MAX { -1.0 } else { k.into() }).collect();
        self.rgb.compare(case, &found.rgb.concat(), &case["expected_rgb"]);
        self.disparity.compare_relative(case, &found.disparity, &case["expected_disparity"]);
        self.transmittance.compare(case, &found.transmittance, &case["expected_transmittance"]);
        self.best.compare(case, &best, &case["expected_best"]);
    }
}

#[test]
fn composite_equals_the_reference() {
    let mut stage =
        Composites::new(["composite: rgb", "composite: disparity", "composite: transmittance", "composite: best"]);
    for case in cases("composite") {
        let (covered, disparities) = (flags(&case["last_covered"]), floats(&case["disparities"]));
        let pixels = covered.len();
        let alpha = floats(&case["alpha"]);
        let mut row = Accumulated::new(pixels);
        for (index, layer) in coloured(&floats(&case["rgb"]), pixels).into_iter().enumerate() {
            let alpha = alpha[index * pixels..][..pixels].to_vec();
            let layer = Blended { alpha, covered: covered.clone(), ..layer };
            row.add(index as u32, &layer, &vec![disparities[index]; pixels], index + 1 == disparities.len());
        }
        stage.compare(&case, &row);
    }
}

#[test]
fn competing_composite_equals_the_reference() {
    let mut stage =
        Composites::new(["competing: rgb", "competing: disparity", "competing: transmittance", "competing: best"]);
    for case in cases("competing") {
        let [logits, disparities] = ["logits", "disparities"].map(|name| floats(&case[name]));
        let covered = flags(&case["covered"]);
        let pixels = covered.len() / disparities.len();
        let mut row = Competing::new(pixels, case["scale"].as_f64().unwrap());
        for (index, layer) in coloured(&floats(&case["rgb"]), pixels).into_iter().enumerate() {
            let span = index * pixels..(index + 1) * pixels;
            let layer = Blended { covered: covered[span.clone()].to_vec(), ..layer };
            row.add(index as u32, &logits[span], &layer, &vec![disparities[index]; pixels]);
        }
        stage.compare(&case, &row.finish());
    }
}

#[test]
fn selection_equals_the_reference() {
    let mut stage = Stage::new("selection", 0.0); // counts and choices
    for case in cases("selection") {
        let (alpha, planes) = (floats(&case["alpha"]), case["histogram"].as_array().unwrap().len());
        let pixels = alpha.len() / planes;
        let mut row = Accumulated::new(pixels);
        for (index, alpha) in alpha.chunks(pixels).enumerate() {
            let layer = Blended { alpha: alpha.to_vec(), ..Blended::new(pixels) };
            row.add(index as u32, &layer, &vec![0.0; pixels], index + 1 == planes);
        }
        let best = row.best_layer.iter().map(|&best| (best != u32::MAX).then_some(best as usize));
        let histogram = plane_histogram(best, planes);
        stage.compare(&case, &histogram.iter().map(|&votes| votes as f64).collect::<Vec<_>>(), &case["histogram"]);
        for (count, expected) in case["chosen"].as_object().unwrap() {
            let chosen = select_planes(&histogram, count.parse().unwrap());
            stage.compare(&case, &chosen.iter().map(|&plane| plane as f64).collect::<Vec<_>>(), expected);
        }
    }
}

#[test]
fn uniform_planes_equal_the_reference() {
    let mut stage = Stage::new("uniform planes", ceiling("choice"));
    for case in cases("uniform_planes") {
        let far = case["far"].as_f64().unwrap_or(f64::INFINITY);
        let count = case["count"].as_u64().unwrap() as usize;
        let found = uniform_disparities(case["near"].as_f64().unwrap(), far, count).unwrap();
        stage.compare_relative(&case, &found, &case["disparities"]);
    }
}

/// The model of a case, run by ONNX Runtime.
fn network(case: &Value) -> OrtNetwork {
    let library = wheel::load(ExecutionProvider::Cpu).unwrap_or_else(|error| panic!("{error}: run `make runtime`"));
    OrtNetwork::open(&library, &root().join(text(&case["model"])), 1).unwrap()
}

#[test]
fn a_run_of_a_model_equals_the_reference() {
    let mut stage = Stage::new("network", ceiling("logits"));
    for case in cases("network") {
        let mut network = network(&case);
        let (views, side) = (network.views(), case["side"].as_u64().unwrap() as usize);
        let hwv: Vec<f32> = floats(&case["hwv"]).into_iter().map(|value| value / 255.0).collect();
        let coverage = vec![1.0; views * side * side];
        let mut logits = vec![0.0; views * side * side];
        network
            .infer(
                ArrayView4::from_shape((1, 3 * views, side, side), &hwv).unwrap(),
                ArrayView4::from_shape((1, views, side, side), &coverage).unwrap(),
                ArrayViewMut4::from_shape((1, views, side, side), &mut logits).unwrap(),
            )
            .unwrap();
        stage.compare_relative(&case, &logits, &case["logits"]);
    }
}

/// The bound adds those of the stages: on each of D planes, α and the weights of the views change by
/// at most a quarter of an error of the logits, whose bound is relative to the largest; to these add the
/// errors of the samples, of the blend and of the composite.
#[test]
fn a_picture_equals_the_reference() {
    for case in cases("render") {
        let disparities = numbers(&case["disparities"]);
        let logits = ceiling("logits") * case["largest_logit"].as_f64().unwrap();
        let of_planes = 2.0 * disparities.len() as f64 * logits / 4.0;
        let bound = of_planes + ceiling("colour") + ceiling("rgb") + ceiling("frame");
        let target = camera(&case["target"]);
        let cameras: Vec<Camera> = case["sources"].as_array().unwrap().iter().map(camera).collect();
        let photos = case["photos"].as_array().unwrap().iter().zip(&cameras);
        let photos: Vec<Texture> = photos.map(|(values, camera)| photo(values, camera.size())).collect();
        let views: Vec<SourceView<'_>> =
            cameras.iter().zip(&photos).map(|(camera, texture)| SourceView { camera, texture }).collect();
        let planes = Layers::planes(&disparities).unwrap();
        let mut renderer = Renderer::new(Box::new(network(&case)), Alpha::Independent, 1);
        let frame = renderer.render(RenderRequest::new(&views, &target, &planes)).unwrap();
        let channels: Vec<f32> =
            (0..3).flat_map(|channel| frame.raw().data().iter().skip(channel).step_by(3).copied()).collect();
        Stage::new("picture: rgb", bound).compare(&case, &channels, &case["rgb"]);
        let disparity = frame.disparity.as_slice().unwrap();
        Stage::new("picture: disparity", bound).compare_relative(&case, disparity, &case["disparity"]);
        let transmittance = frame.transmittance.as_slice().unwrap();
        Stage::new("picture: transmittance", bound).compare(&case, transmittance, &case["transmittance"]);
        let best: Vec<f64> = frame.best_layer.iter().map(|best| best.map_or(-1.0, f64::from)).collect();
        Stage::new("picture: best", 0.0).compare(&case, &best, &case["best"]);
    }
}
