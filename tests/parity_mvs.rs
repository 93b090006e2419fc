//! The photos' depth and the target's surface, stage by stage, against the float64 oracle and float32 torch, on the goldens
//! of `parity/generate.py` (`make goldens`).
//!
//! Each stage is fed the float32 roundings of the oracle's outputs of the stage before. Elements whose decision hangs on the
//! last bits are marked doubtful by the oracle (`liveview_ref/parity/mvs_goldens.py`): they may be off, but only few are
//! doubtful. All others lie within the bounds of `parity/tolerances.json`.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics, PlaneSweep, Size, distance};
use liveview::image::ImageRgb;
use liveview::layers::{Layer, padded};
use liveview::mvs::stages::{self, Search};
use liveview::mvs::{
    KnownDepth, PhotoDepth, Settings, SurfaceView, Visibility, confirmed, exposure_gains, photo_depth, surface,
};
use liveview::warp::{SourceView, Texture, WarpSource};
use ndarray::{Array, Array2, Array3, ArrayD, Axis, Dimension, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadNpyError, ReadNpzError, ReadableElement};

const CASES: [&str; 12] = [
    "scene",
    "windows",
    "sizes",
    "one_neighbour",
    "rectified",
    "identical",
    "flat",
    "exposure",
    "infinity",
    "near_is_far",
    "further",
    "planes_4096",
];

/// Photos that a photo is matched with, as parity/mvs_stages.py has it.
const NEIGHBOURS: usize = 4;
/// Layers along the surface, as there.
const LAYERS: usize = 3;

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
    range: (f64, f64),
    count: usize,
    settings: Settings,
    /// Photos at the target that the further ones help.
    main: usize,
    /// What `check` found beyond bounds; all of it is told at the end.
    failures: Mutex<Vec<String>>,
}

impl Case {
    fn open(name: &'static str) -> Self {
        let path = folder().join(format!("mvs_{name}.npz"));
        assert!(path.is_file(), "{}: run `make goldens` first", path.display());
        let mut case = Self {
            name,
            path,
            cameras: Vec::new(),
            textures: Vec::new(),
            target: camera_at_origin(),
            range: (0.0, 0.0),
            count: 0,
            settings: Settings::default(),
            main: 0,
            failures: Mutex::default(),
        };
        for view in 0.. {
            let Some(image) = case.find::<f32>(&format!("view{view}.image")) else { break };
            let (height, width) = (image.shape()[0], image.shape()[1]);
            case.cameras.push(case.camera(&format!("view{view}"), Size::new(width, height)));
            case.textures.push(Texture::new(&ImageRgb::new(width, height, flat(image)).unwrap()));
        }
        let size = case.get::<i64>("target.size");
        case.target = case.camera("target", Size::new(size[[0]] as usize, size[[1]] as usize));
        let range = case.get::<f64>("range");
        (case.range, case.count) = ((range[[0]], range[[1]]), flat(case.get::<i64>("count"))[0] as usize);
        case.main = flat(case.get::<i64>("main"))[0] as usize;
        let radius = case.get::<i64>("radius");
        (case.settings.radius, case.settings.fine_radius) = (radius[[0]] as usize, radius[[1]] as usize);
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

    fn map(&self, array: &str) -> Array2<f32> {
        self.get::<f32>(array).into_dimensionality().unwrap()
    }

    fn volume<T: ReadableElement>(&self, array: &str) -> Array3<T> {
        self.get::<T>(array).into_dimensionality().unwrap()
    }

    fn camera(&self, name: &str, size: Size) -> Camera {
        let matrix = |part: &str| {
            let m = self.get::<f64>(&format!("{name}.{part}"));
            DMat3::from_cols_array_2d(&std::array::from_fn(|column| std::array::from_fn(|row| m[[row, column]])))
        };
        let k = matrix("k").to_cols_array_2d();
        let intrinsics = Intrinsics { fx: k[0][0], fy: k[1][1], cx: k[2][0], cy: k[2][1], skew: k[1][0] };
        let translation = DVec3::from_slice(&flat(self.get::<f64>(&format!("{name}.translation"))));
        Camera::new(intrinsics, size.width, size.height, matrix("rotation"), translation).unwrap()
    }

    fn view(&self, index: usize) -> SourceView<'_> {
        SourceView { camera: &self.cameras[index], texture: &self.textures[index] }
    }

    /// Photos that photo `which` is matched with.
    fn neighbours(&self, which: usize) -> Vec<SourceView<'_>> {
        (0..self.cameras.len()).filter(|&i| i != which).take(NEIGHBOURS).map(|i| self.view(i)).collect()
    }

    fn depths(&self) -> Vec<PhotoDepth> {
        let pixels = self.get::<f32>("pixel");
        let depth = |i: usize| PhotoDepth { disparity: self.map(&format!("depth{i}")), pixel: pixels[[i]] };
        (0..self.cameras.len()).map(depth).collect()
    }

    fn known(&self, depths: &[PhotoDepth]) -> Vec<KnownDepth> {
        let known = |(i, depth)| KnownDepth::new(depth, &self.map(&format!("confirmed{i}")).mapv(|sure| sure > 0.0));
        depths.iter().enumerate().map(known).collect()
    }

    /// `use_views` with what is known of the photos.
    fn with_views<T>(&self, use_views: impl FnOnce(&[SurfaceView<'_>]) -> T) -> T {
        let depths = self.depths();
        let known = self.known(&depths);
        let view = |i: usize| SurfaceView { view: self.view(i), all: &depths[i], known: &known[i] };
        use_views(&(0..depths.len()).map(view).collect::<Vec<_>>())
    }

    /// The views at the target, and which pixels of the surface they see.
    fn at_target(&self) -> (Vec<WarpSource<'_>>, Vec<Vec<f32>>) {
        let source = |i: usize| WarpSource {
            texture: &self.textures[i],
            sweep: PlaneSweep::new(&self.cameras[i], &self.target),
        };
        let visible = self.volume::<f32>("visible");
        let visible = visible.outer_iter().map(|map| map.iter().copied().collect()).collect();
        ((0..self.cameras.len()).map(source).collect(), visible)
    }

    /// Disparity worth a pixel of parallax at the target.
    fn pixel(&self) -> f32 {
        let settings = Settings { refine: 0, second: false, ..self.settings.clone() };
        self.with_views(|views| surface(views, self.main, &self.target, self.range.0, self.range.1, &settings).pixel)
    }

    /// Hold `found` against the oracle's `stage`: few elements are doubtful, and all others within what float32 torch's own
    /// error and the tolerance file allow.
    fn check<T: Into<f64> + Copy, D: Dimension>(&self, name: &str, found: &Array<T, D>) {
        let oracle = self.get::<f64>(&format!("oracle.{name}"));
        assert_eq!(found.shape(), oracle.shape(), "{}: shape of {name}", self.name);
        let errors: Vec<f64> = found.iter().zip(oracle.iter()).map(|(&a, b)| (a.into() - b).abs()).collect();
        assert!(errors.iter().all(|e| e.is_finite()), "{}: {name} is not finite everywhere", self.name);
        let doubtful = self.find::<bool>(&format!("doubtful.{name}")).map_or(vec![false; errors.len()], flat);
        let share = doubtful.iter().filter(|&&d| d).count() as f64 / errors.len() as f64;
        let sure: Vec<usize> = (0..errors.len()).filter(|&i| !doubtful[i]).collect();
        let worst = sure.iter().copied().max_by(|&a, &b| errors[a].total_cmp(&errors[b])).expect("some are sure");
        let mean = sure.iter().map(|&i| errors[i]).sum::<f64>() / sure.len() as f64;
        let tolerance = Tolerance::of(name.trim_end_matches(char::is_numeric));
        let torch = flat(self.get::<f64>(&format!("torch.{name}")));
        let most = tolerance.floor.max(tolerance.max_factor * torch[0]);
        // The means themselves are sums in another order: equal errors must count as equal.
        let mean_most = tolerance.mean_floor.max(tolerance.mean_factor * torch[1]) * (1.0 + 1e-9);
        let off = (0..errors.len()).filter(|&i| doubtful[i] && errors[i] > most).count();
        let told = format!(
            "{:13} {name:12} max {:.1e} (torch {:.1e})  mean {mean:.2e} (torch {:.2e})  doubtful {:.3} %, {off} of them off  \
             worst at {:?}: {} for {}",
            self.name,
            errors[worst],
            torch[0],
            torch[1],
            100.0 * share,
            oracle.indexed_iter().nth(worst).unwrap().0.slice(),
            found.iter().nth(worst).map(|&x| x.into()).unwrap(),
            oracle.iter().nth(worst).unwrap(),
        );
        println!("{told}");
        let mut failures = self.failures.lock().unwrap();
        if share > tolerance.doubtful {
            failures.push(format!("more than {} doubtful:\n{told}", tolerance.doubtful));
        }
        if errors[worst] > most || mean > mean_most {
            failures.push(format!("beyond max {most:.1e} or mean {mean_most:.2e}:\n{told}"));
        }
    }
}

/// Bounds of a stage.
struct Tolerance {
    floor: f64,
    max_factor: f64,
    mean_floor: f64,
    mean_factor: f64,
    /// Largest share of doubtful elements.
    doubtful: f64,
}

impl Tolerance {
    fn of(stage: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/tolerances.json");
        let all: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let entry = &all[&format!("mvs {stage}")];
        let get = |key: &str| entry[key].as_f64().unwrap_or_else(|| panic!("tolerances.json: mvs {stage}: no {key}"));
        Self {
            floor: get("floor"),
            max_factor: get("max_factor"),
            mean_floor: get("mean_floor"),
            mean_factor: get("mean_factor"),
            doubtful: get("doubtful"),
        }
    }
}

fn camera_at_origin() -> Camera {
    let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5, skew: 0.0 };
    Camera::new(intrinsics, 1, 1, DMat3::IDENTITY, DVec3::ZERO).unwrap()
}

fn flat<T: Clone>(array: ArrayD<T>) -> Vec<T> {
    array.iter().cloned().collect()
}

/// On each of the cases, whose failures are told together.
fn for_cases(names: &[&'static str], check: impl Fn(&Case)) {
    let failures = names.iter().flat_map(|name| {
        let case = Case::open(name);
        check(&case);
        case.failures.into_inner().unwrap()
    });
    let failures: Vec<_> = failures.collect();
    assert!(failures.is_empty(), "{} beyond their bounds:\n{}", failures.len(), failures.join("\n"));
}

fn for_all(check: impl Fn(&Case)) {
    for_cases(&CASES, check);
}

/// All but the last, which has the first search alone.
fn for_whole(check: impl Fn(&Case)) {
    for_cases(&CASES[..CASES.len() - 1], check);
}

#[test]
fn every_generated_case_is_tested() {
    let listed = std::fs::read_to_string(folder().join("mvs_cases.txt")).expect("run `make goldens` first");
    assert_eq!(listed.lines().collect::<Vec<_>>(), CASES);
}

#[test]
fn half_resolution() {
    for_all(|case| {
        let search = Search { range: case.range, count: case.count, parts: 1, cell: 2, starts: None };
        let found = stages::matching_costs(&case.view(0), &case.neighbours(0), &search, case.settings.radius);
        case.check("half_costs", &found);
        let costs = case.volume::<u16>("half_costs");
        case.check("half_found", &stages::aggregated(&costs, &case.textures[0], &search, &case.settings));
        case.check("half_index", &stages::median3(&case.map("half_found")));
        let fine = (case.count - 1) * case.settings.parts + 1;
        case.check("starts", &stages::bands(&case.map("half_index"), case.settings.parts, fine));
    });
}

#[test]
fn narrow_band() {
    for_whole(|case| {
        let starts = case.volume::<u16>("starts");
        let (range, count, parts) = (case.range, case.count, case.settings.parts);
        let search = Search { range, count, parts, cell: 1, starts: Some(&starts) };
        let mut found = stages::matching_costs(&case.view(0), &case.neighbours(0), &search, case.settings.fine_radius);
        // What a cell does not have is anything.
        let missing = |y: usize, x: usize| starts[(y / 2, x / 2, 1)] == u16::MAX;
        found.indexed_iter_mut().filter(|((y, x, k), _)| *k >= 8 && missing(*y, *x)).for_each(|(_, cost)| *cost = 0);
        case.check("fine_costs", &found);
        let costs = case.volume::<u16>("fine_costs");
        case.check("fine_found", &stages::aggregated(&costs, &case.textures[0], &search, &case.settings));
        case.check("fine_index", &stages::median3(&case.map("fine_found")));
    });
}

#[test]
fn depth_of_each_photo() {
    for_whole(|case| {
        for which in 0..case.cameras.len() {
            let neighbours = case.neighbours(which);
            let found = photo_depth(&case.view(which), &neighbours, case.range.0, case.range.1, &case.settings);
            case.check(&format!("depth{which}"), &found.disparity);
            let pixel = case.get::<f32>("pixel")[[which]];
            assert!((found.pixel / pixel - 1.0).abs() < 3e-7, "{}: a pixel is {}, not {pixel}", case.name, found.pixel);
        }
    });
}

#[test]
fn consistency() {
    for_whole(|case| {
        let depths = case.depths();
        let maps: Vec<_> = case.cameras.iter().zip(&depths).collect();
        for which in 0..maps.len() {
            let found = confirmed(which, &maps, &case.settings);
            case.check(&format!("confirmed{which}"), &found.mapv(|sure| if sure { 1.0_f32 } else { 0.0 }));
        }
    });
}

#[test]
fn carried_to_the_target() {
    for_whole(|case| {
        let (pixel, size) = (case.pixel(), padded(case.target.size()));
        case.with_views(|views| {
            let maps: Vec<_> = views.iter().map(|v| (v.view.camera, v.known)).collect();
            case.check("splat", &stages::splatted(&maps, &case.target, size, case.settings.fuse * pixel));
            case.check("grown", &stages::grown(&case.map("splat")));
            let (map, margin) = (case.map("grown"), case.settings.hides * pixel);
            let seen: Vec<_> = maps.iter().map(|&m| stages::visible(m, &case.target, &map, margin)).collect();
            let seen: Vec<_> = seen.iter().map(|map| map.view()).collect();
            case.check("visible", &ndarray::stack(Axis(0), &seen).unwrap());
        });
    });
}

#[test]
fn refinement() {
    for_whole(|case| {
        let ((sources, visible), map, pixel) = (case.at_target(), case.map("grown"), case.pixel());
        let offsets = [1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -1.5].map(|offset: f32| offset * pixel);
        case.check("disagreement", &stages::disagreed((&sources, &visible), &map, &offsets, 3));
        case.check("refined", &stages::refined((&sources, &visible), &map, pixel, &case.settings));
    });
}

#[test]
fn surface_from_what_is_known() {
    for_whole(|case| {
        let ((near, far), target) = (case.range, &case.target);
        let found = case.with_views(|views| surface(views, case.main, target, near, far, &case.settings));
        case.check("surface", &found.disparity);
        let layers = found.layers(LAYERS).unwrap();
        let map = |layer: &Layer| if let Layer::Pixels(map) = layer { map.clone() } else { panic!("not by pixel") };
        let maps: Vec<_> = layers.as_slice().iter().map(map).collect();
        case.check("layers", &ndarray::stack(Axis(0), &maps.iter().map(|m| m.view()).collect::<Vec<_>>()).unwrap());
    });
}

#[test]
fn hidden_from_views() {
    for_whole(|case| {
        let (map, pixel) = (case.map("grown"), case.pixel());
        let (colour, coverage, seen) = case.with_views(|views| {
            let (main, further) = views.split_at(case.main);
            let visibility = Visibility {
                views: main.iter().map(|v| (v.view.camera, v.known)).collect(),
                further: further.iter().map(|v| (v.view, v.known)).collect(),
                margin: case.settings.hides * pixel,
            };
            let main: Vec<_> = main.iter().map(|v| v.view).collect();
            stages::hidden(&visibility, &main, &case.target, &map)
        });
        let (height, width) = map.dim();
        case.check("hidden_colour", &colour.into_shape_with_order((case.main, 3, height, width)).unwrap());
        case.check("hidden_coverage", &coverage);
        case.check("seen", &seen.mapv(|any| if any { 1.0_f32 } else { 0.0 }));
    });
}

#[test]
fn exposure() {
    for_whole(|case| {
        let distances: Vec<f64> = case.cameras.iter().map(|camera| distance(camera, &case.target)).collect();
        let found = case.with_views(|views| exposure_gains(views, &distances));
        case.check("gains", &Array2::from_shape_fn((found.len(), 3), |(view, channel)| found[view][channel]));
    });
}

/// Depth, confirmations and surface are the same bits whatever the threads.
#[test]
fn threads_change_no_bit() {
    for name in ["scene", "sizes"] {
        let case = Case::open(name);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let (near, far) = case.range;
                let depth = photo_depth(&case.view(0), &case.neighbours(0), near, far, &case.settings).disparity;
                let surface = case.with_views(|views| surface(views, 2, &case.target, near, far, &case.settings));
                let gains = case.with_views(|views| exposure_gains(views, &vec![1.0; views.len()])).concat();
                let all = depth.iter().chain(&surface.disparity).chain(&gains);
                all.map(|value| value.to_bits()).collect::<Vec<_>>()
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(3), "{name}");
    }
}
