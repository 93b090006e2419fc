//! Every stage against the float64 oracle and float32 torch, on the goldens of `parity/generate.py` (`make test-rust` generates them).
//!
//! Each stage is fed the float32 roundings of the oracle's outputs of the stage before: the first stage that fails is the
//! one that departs. Bounds are those of `parity/tolerances.json`.

mod wheel;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics, Size, distance};
use liveview::image::ImageRgb;
use liveview::layers::guided::{
    COARSE, GuidedSearch, WINDOWS, fine_layers, layer_costs, range_of, semi_global, winner_takes_all,
};
use liveview::layers::{CELL, Layer, Layers, cover_planes, padded, plane_histogram, select_planes};
use liveview::network::{Alpha, ExecutionProvider, OrtNetwork, PlaneNetwork, ViewAgreement};
use liveview::render::{
    Accumulated, Batch, Blended, Competing, DistanceWeights, LayerSamples, RenderRequest, Renderer,
};
use liveview::warp::{SourceView, Texture, warp_layers, warp_sources};
use ndarray::{Array, Array1, Array2, Array3, ArrayD, Axis, Dimension, IxDyn, OwnedRepr, s};
use ndarray_npy::{NpzReader, ReadNpyError, ReadNpzError, ReadableElement};

const CASES: [&str; 19] = [
    "random_v4",
    "random_v5",
    "random_v10",
    "rectified_v2",
    "one_plane",
    "infinity",
    "coincident",
    "unseen",
    "guided_v4",
    "guided_v5",
    "guided_v2",
    "guided_one",
    "competing_v4",
    "competing_unseen",
    "competing_guided",
    "spaced_v4",
    "spaced_uneven",
    "spaced_one",
    "spaced_unseen",
];

/// Depth range of the generated cases.
const NEAR: f64 = 1.0;
const FAR: f64 = 8.0;

/// Final images of Rust and of the float32 reference may differ by this much on [0, 1].
const FRAME_TOLERANCE: f64 = 1e-4;

fn folder() -> PathBuf {
    let folder = std::env::var_os("LIVEVIEW_GOLDENS").map(PathBuf::from);
    folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/goldens"))
}

/// One golden file, its photos and cameras ready to use.
struct Case {
    name: &'static str,
    path: PathBuf,
    cameras: Vec<Camera>,
    textures: Vec<Texture>,
    target: Camera,
}

impl Case {
    fn open(name: &'static str) -> Self {
        let path = folder().join(format!("{name}.npz"));
        assert!(path.is_file(), "{}: run `make test-rust`, which generates it", path.display());
        let mut case = Self { name, path, cameras: Vec::new(), textures: Vec::new(), target: camera_at_origin() };
        for view in 0.. {
            let Some(image) = case.find::<f32>(&format!("view{view}.image")) else { break };
            let (height, width) = (image.shape()[0], image.shape()[1]);
            case.cameras.push(case.camera(&format!("view{view}"), width, height));
            case.textures.push(Texture::new(&ImageRgb::new(width, height, flat(image)).unwrap()));
        }
        let size = case.get::<i64>("target.size");
        case.target = case.camera("target", size[[0]] as usize, size[[1]] as usize);
        case
    }

    fn find<T: ReadableElement>(&self, array: &str) -> Option<ArrayD<T>> {
        let mut file = NpzReader::new(std::fs::File::open(&self.path).unwrap()).unwrap();
        match file.by_name::<OwnedRepr<T>, IxDyn>(array) {
            Ok(found) => Some(found),
            Err(ReadNpzError::Npy(ReadNpyError::WrongDescriptor(kind))) => panic!("{}: {array} is {kind:?}", self.name),
            Err(_) => None,
        }
    }

    fn get<T: ReadableElement>(&self, array: &str) -> ArrayD<T> {
        self.find(array).unwrap_or_else(|| panic!("{}: no array {array}", self.name))
    }

    fn camera(&self, name: &str, width: usize, height: usize) -> Camera {
        let matrix = |part: &str| {
            let m = self.get::<f64>(&format!("{name}.{part}"));
            DMat3::from_cols_array_2d(&std::array::from_fn(|column| std::array::from_fn(|row| m[[row, column]])))
        };
        let k = matrix("k").to_cols_array_2d();
        let intrinsics = Intrinsics { fx: k[0][0], fy: k[1][1], cx: k[2][0], cy: k[2][1], skew: k[1][0] };
        let translation = DVec3::from_slice(&flat(self.get::<f64>(&format!("{name}.translation"))));
        Camera::new(intrinsics, width, height, matrix("rotation"), translation).unwrap()
    }

    fn views(&self) -> Vec<SourceView<'_>> {
        self.cameras.iter().zip(&self.textures).map(|(camera, texture)| SourceView { camera, texture }).collect()
    }

    fn padded(&self) -> Size {
        padded(self.target.size())
    }

    fn layers(&self) -> Layers {
        match self.find::<f64>("disparities") {
            Some(disparities) => Layers::planes(&flat(disparities)).unwrap(),
            None => {
                let maps = self.get::<f32>("cell_maps").into_dimensionality::<ndarray::Ix3>().unwrap();
                Layers::maps(maps.outer_iter().map(|m| m.to_owned()).collect()).unwrap()
            }
        }
    }

    fn alpha(&self) -> Alpha {
        let number = |name: &str| self.find::<f64>(name).map(|values| values[[0]]);
        let spaced = || number("alpha_spacing").map(|most| Alpha::PerPixel { most });
        number("alpha_scale").map(|scale| Alpha::Competing { scale }).or_else(spaced).unwrap_or_default()
    }

    fn network(&self) -> OrtNetwork {
        let path = folder().join(format!("network_v{}.onnx", self.cameras.len()));
        OrtNetwork::open(&wheel::load(ExecutionProvider::Cpu).unwrap(), &path, 1).unwrap()
    }

    /// Hold `found` against the oracle's `stage`, within what float32 torch's own error and the tolerance file allow.
    fn check<T: Into<f64> + Copy, D: Dimension>(&self, stage: &str, found: &Array<T, D>) {
        let oracle = self.get::<f64>(&format!("oracle.{stage}"));
        assert_eq!(found.shape(), oracle.shape(), "{}: shape of {stage}", self.name);
        let scale = if scaled(stage) { oracle.iter().fold(0.0, |top: f64, x| top.max(x.abs())) } else { 1.0 };
        let error = |(a, b): (&T, &f64)| ((*a).into() - b).abs() / scale;
        let errors: Vec<f64> = found.iter().zip(oracle.iter()).map(error).collect();
        assert!(errors.iter().all(|e| e.is_finite()), "{}: {stage} is not finite everywhere", self.name);
        let worst = (0..errors.len()).max_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let (index, _) = oracle.indexed_iter().nth(worst).unwrap();
        let torch = flat(self.get::<f64>(&format!("torch.{stage}")));
        let tolerance = tolerance(stage);
        let most = tolerance["floor"].max(tolerance["max_factor"] * torch[0]);
        let most = tolerance.get("ceiling").map_or(most, |&ceiling| most.min(ceiling));
        // The means themselves are sums in another order: equal errors must count as equal.
        let mean_most = tolerance["mean_floor"].max(tolerance["mean_factor"] * torch[1]) * (1.0 + 1e-9);
        let told = format!(
            "{:13} {stage:14} max {:.1e} (torch {:.1e})  mean {mean:.3e} (torch {:.3e})  worst at {:?}: {} for {}",
            self.name,
            errors[worst],
            torch[0],
            torch[1],
            index.slice(),
            found.iter().nth(worst).map(|&x| x.into()).unwrap(),
            oracle.iter().nth(worst).unwrap(),
        );
        println!("{told}");
        assert!(errors[worst] <= most && mean <= mean_most, "beyond max {most:.1e} or mean {mean_most:.1e}:\n{told}");
    }
}

fn camera_at_origin() -> Camera {
    let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5, skew: 0.0 };
    Camera::new(intrinsics, 1, 1, DMat3::IDENTITY, DVec3::ZERO).unwrap()
}

fn flat<T: Clone>(array: ArrayD<T>) -> Vec<T> {
    array.iter().cloned().collect()
}

fn tolerance(stage: &str) -> BTreeMap<String, f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/tolerances.json");
    let all: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let entry = all[stage].as_object().unwrap_or_else(|| panic!("parity/tolerances.json has no {stage}"));
    entry.iter().filter_map(|(key, value)| Some((key.clone(), value.as_f64()?))).collect()
}

/// Whether a stage's errors are relative to the oracle's largest element, as the tolerance file says.
fn scaled(stage: &str) -> bool {
    [
        "homography",
        "coarse_disparity",
        "fine_layers",
        "fine_disparity",
        "range",
        "cell_maps",
        "maps",
        "logits",
        "disparity",
    ]
    .contains(&stage)
}

fn for_all(check: impl Fn(&Case)) {
    CASES.iter().for_each(|name| check(&Case::open(name)));
}

#[test]
fn every_generated_case_is_tested() {
    let listed = std::fs::read_to_string(folder().join("cases.txt")).expect("run `make test-rust`, which generates it");
    assert_eq!(listed.lines().collect::<Vec<_>>(), CASES);
}

#[test]
fn homography() {
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
fn maps() {
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
fn warp() {
    for_all(|case| {
        let (Size { width, height }, views) = (case.padded(), case.views());
        let disparity = flat(case.get::<f32>("maps"));
        let (n, v) = (disparity.len() / (height * width), views.len());
        let mut colour = Array::<f32, _>::zeros((n, 3 * v, height, width));
        let mut coverage = Array::<f32, _>::zeros((n, v, height, width));
        let (to_colour, to_coverage) = (colour.as_slice_mut().unwrap(), coverage.as_slice_mut().unwrap());
        warp_layers(&disparity, &warp_sources(&views, &case.target), Size { width, height }, to_colour, to_coverage);
        case.check("coverage", &coverage);
        case.check("colour", &colour);
    });
}

#[test]
fn logits() {
    for_all(|case| {
        let hwv = case.get::<f32>("colour").into_dimensionality::<ndarray::Ix4>().unwrap();
        let (n, _, height, width) = hwv.dim();
        let mut found = Array::<f32, _>::zeros((n, case.cameras.len(), height, width));
        case.network().infer(hwv.view(), found.view_mut()).unwrap();
        case.check("logits", &found);
        let python = case.get::<f32>("onnxruntime.logits");
        let differ = found.iter().zip(python.iter()).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert_eq!(differ, 0, "{}: ort and onnxruntime differ in {differ} of {} logits", case.name, found.len());
    });
}

#[test]
fn agreement() {
    for_all(|case| {
        let hwv = input(case, "colour");
        let (n, _, height, width) = hwv.dim();
        let views = case.cameras.len();
        let mut found = Array::<f32, _>::zeros((n, views, height, width));
        ViewAgreement { views }.infer(hwv.view(), found.view_mut()).unwrap();
        case.check("agreement", &found);
    });
}

/// A stage's inputs as the oracle's roundings: [L, channels, H, W].
fn input(case: &Case, name: &str) -> Array<f32, ndarray::Ix4> {
    case.get::<f32>(name).into_dimensionality().unwrap()
}

fn layer_slice(all: &Array<f32, ndarray::Ix4>, k: usize) -> &[f32] {
    let size = all.len() / all.dim().0;
    &all.as_slice().unwrap()[k * size..(k + 1) * size]
}

#[test]
fn blend() {
    for_all(|case| {
        let [logits, colour, coverage] = ["logits", "colour", "coverage"].map(|name| input(case, name));
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

/// Composite the oracle's α, or logits, and colour: what each row gathered.
fn gathered(case: &Case) -> Vec<Accumulated> {
    let [rgb, coverage, logits] = ["rgb", "coverage", "logits"].map(|name| input(case, name));
    let [alpha, maps] = ["alpha", "maps"].map(|name| volume(case, name));
    let (last, width) = (alpha.dim().0 - 1, case.target.width());
    let row = |y: usize| {
        let mut row = Accumulated::new(width);
        let mut competing = match case.alpha() {
            Alpha::Competing { scale } => Some(Competing::new(width, scale)),
            _ => None,
        };
        for k in 0..=last {
            let covered = |x: usize| coverage.slice(s![k, .., y, x]).iter().any(|&c| c > 0.0);
            let layer = Blended {
                alpha: alpha.slice(s![k, y, ..width]).to_vec(),
                rgb: std::array::from_fn(|c| rgb.slice(s![k, c, y, ..width]).to_vec()),
                covered: (0..width).map(covered).collect(),
            };
            let disparity = maps.slice(s![k, y, ..width]).to_vec();
            match &mut competing {
                Some(row) => row.add(k as u32, &logits.slice(s![k, 0, y, ..width]).to_vec(), &layer, &disparity),
                None => row.add(k as u32, &layer, &disparity, k == last),
            }
        }
        competing.map_or(row, Competing::finish)
    };
    (0..case.target.height()).map(row).collect()
}

#[test]
fn composite() {
    for_all(|case| {
        let rows = gathered(case);
        let (height, width) = (case.target.height(), case.target.width());
        case.check("frame", &Array3::from_shape_fn((3, height, width), |(c, y, x)| rows[y].rgb[c][x] as f32));
        case.check("disparity", &Array2::from_shape_fn((height, width), |(y, x)| rows[y].disparity[x] as f32));
        case.check("transmittance", &Array2::from_shape_fn((height, width), |(y, x)| rows[y].transmittance[x] as f32));
    });
}

#[test]
fn selection() {
    for_all(|case| {
        if case.find::<i64>("selected").is_none() {
            return;
        }
        let best = |row: Accumulated| row.best_layer.into_iter().map(|k| (k != u32::MAX).then_some(k as usize));
        let histogram = plane_histogram(gathered(case).into_iter().flat_map(best), case.layers().len());
        let counted: Vec<i64> = histogram.iter().map(|&n| n as i64).collect();
        assert_eq!(counted, flat(case.get::<i64>("histogram")), "{}: histogram", case.name);
        for (name, select) in
            [("selected", select_planes as fn(&[u64], usize) -> Vec<usize>), ("covering", cover_planes)]
        {
            let found: Vec<i64> = select(&histogram, 2).into_iter().map(|k| k as i64).collect();
            assert_eq!(found, flat(case.get::<i64>(name)), "{}: planes {name}", case.name);
        }
    });
}

#[test]
fn guided_search() {
    for_all(|case| {
        let Some(disparities) = case.find::<f64>("coarse_disparities") else { return };
        let [costs, aggregated, layers, fine_costs] =
            ["costs", "aggregated_costs", "fine_layers", "fine_costs"].map(|name| volume(case, name));
        let views = case.views();
        let sources = warp_sources(&views, &case.target);
        let planes = Array3::from_shape_fn(costs.dim(), |(plane, _, _)| disparities[[plane]] as f32);
        case.check("costs", &layer_costs(&sources, planes.view(), COARSE, WINDOWS[0]));
        case.check("aggregated_costs", &semi_global(costs.view()));
        case.check("coarse_disparity", &winner_takes_all(aggregated.view(), planes.view()));
        let coarse = case.get::<f32>("coarse_disparity").into_dimensionality::<ndarray::Ix2>().unwrap();
        let margin = ((disparities[[0]] - disparities[[1]]) / 2.0) as f32;
        case.check("fine_layers", &fine_layers(&range_of(&coarse, margin)));
        case.check("fine_costs", &layer_costs(&sources, layers.view(), CELL, WINDOWS[1]));
        case.check("fine_disparity", &winner_takes_all(fine_costs.view(), layers.view()));
        let fine = case.get::<f32>("fine_disparity").into_dimensionality::<ndarray::Ix2>().unwrap();
        let range = range_of(&fine, 0.0);
        let maps = [range.nearest(), range.surface(), range.farthest()].map(|map| map.view());
        case.check("range", &ndarray::stack(Axis(0), &maps).unwrap());
        let layers = range.layers(case.layers().len()).unwrap();
        let map = |layer: &Layer| if let Layer::Map(map) = layer { map.clone() } else { unreachable!("guided layers") };
        let maps: Vec<_> = layers.as_slice().iter().map(map).collect();
        case.check("cell_maps", &ndarray::stack(Axis(0), &maps.iter().map(|m| m.view()).collect::<Vec<_>>()).unwrap());

        let found = GuidedSearch::new(NEAR, FAR).search(&sources, case.padded()).unwrap();
        assert_eq!(found.disparities, flat(disparities), "{}: planes searched", case.name);
    });
}

fn volume(case: &Case, name: &str) -> Array3<f32> {
    case.get::<f32>(name).into_dimensionality().unwrap()
}

/// All stages together, photos to frame.
#[test]
fn end_to_end() {
    for_all(|case| {
        let views = case.views();
        let frames: Vec<_> = [1, 3]
            .map(|batch| {
                let mut renderer = Renderer::new(Box::new(case.network()), batch);
                renderer.set_alpha(case.alpha());
                let mut shifts = Vec::<f64>::new();
                let mut gather = |batch: &Batch<'_>| shifts.extend(batch.logit_shifts);
                let layers = case.layers();
                let request = RenderRequest::new(&views, &case.target, &layers);
                let frame = renderer.render(RenderRequest { observer: Some(&mut gather), ..request }).unwrap();
                if case.find::<f64>("logit_shift").is_some() {
                    case.check("logit_shift", &Array1::from_vec(shifts));
                }
                frame
            })
            .into();
        let picture = &frames[0].picture;
        let oracle = case.get::<f64>("oracle.end");
        let reference = case.get::<f32>("reference.end");
        let against = |truth: &dyn Fn(&[usize]) -> f64| {
            let pixel = |i: &[usize]| f64::from(picture.pixel(i[2], i[1])[i[0]]);
            let errors = oracle.indexed_iter().map(|(i, _)| (pixel(i.slice()) - truth(i.slice())).abs());
            errors.fold((0.0, 0.0), |(top, sum): (f64, f64), e| (top.max(e), sum + e))
        };
        let ours = against(&|i| oracle[i]);
        let apart = against(&|i| f64::from(reference[i])).0;
        let count = oracle.len() as f64;
        let theirs = oracle.iter().zip(reference.iter()).map(|(o, r)| (o - f64::from(*r)).abs());
        let theirs = theirs.fold((0.0, 0.0), |(top, sum): (f64, f64), e| (top.max(e), sum + e));
        println!(
            "{:13} end to end: max {:.1e} (torch {:.1e}), mean {:.1e} (torch {:.1e}), Rust and torch apart {apart:.1e}",
            case.name,
            ours.0,
            theirs.0,
            ours.1 / count,
            theirs.1 / count
        );
        assert!(apart <= FRAME_TOLERANCE, "{}: frame differs from the reference by {apart:.1e}", case.name);
        assert!(ours.0 <= FRAME_TOLERANCE, "{}: frame differs from the oracle by {:.1e}", case.name, ours.0);
        assert_eq!(frames[0].picture, frames[1].picture, "{}: the batch size changes the frame", case.name);
    });
}
