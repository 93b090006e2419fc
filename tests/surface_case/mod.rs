//! A golden file of surface layers, and the bounds of the errors of the Rust stages.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics, PlaneSweep, Size};
use liveview::image::ImageRgb;
use liveview::surface::stages::target_disparity_per_pixel;
use liveview::surface::{ConfirmedDepth, NEIGHBOURS, PhotoDepth, SurfaceView};
use liveview::warp::{SourceView, Texture, WarpSource};
use ndarray::{Array, Array2, Array3, ArrayD, Dimension, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadNpyError, ReadNpzError, ReadableElement};

pub(crate) fn folder() -> PathBuf {
    let folder = std::env::var_os("LIVEVIEW_GOLDENS").map(PathBuf::from);
    folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/goldens"))
}

/// One golden file, its photos and cameras ready to use.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) path: PathBuf,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) textures: Vec<Texture>,
    pub(crate) target: Camera,
    pub(crate) range: (f64, f64),
    pub(crate) count: usize,
    /// Errors that `check` found beyond their bounds; all of them are reported at the end.
    pub(crate) failures: Mutex<Vec<String>>,
}

impl Case {
    pub(crate) fn open(name: &'static str) -> Self {
        let path = folder().join(format!("surface_{name}.npz"));
        assert!(path.is_file(), "{}: run `make test-rust`, which generates it", path.display());
        let mut case = Self {
            name,
            path,
            cameras: Vec::new(),
            textures: Vec::new(),
            target: camera_at_origin(),
            range: (0.0, 0.0),
            count: 0,
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

    pub(crate) fn get<T: ReadableElement>(&self, array: &str) -> ArrayD<T> {
        self.find(array).unwrap_or_else(|| panic!("{}: no array {array}", self.name))
    }

    pub(crate) fn map(&self, array: &str) -> Array2<f32> {
        self.get::<f32>(array).into_dimensionality().unwrap()
    }

    pub(crate) fn volume<T: ReadableElement>(&self, array: &str) -> Array3<T> {
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

    pub(crate) fn view(&self, index: usize) -> SourceView<'_> {
        SourceView { camera: &self.cameras[index], texture: &self.textures[index] }
    }

    /// Neighbours of photo `which`.
    pub(crate) fn neighbours(&self, which: usize) -> Vec<SourceView<'_>> {
        (0..self.cameras.len()).filter(|&i| i != which).take(NEIGHBOURS).map(|i| self.view(i)).collect()
    }

    pub(crate) fn depths(&self) -> Vec<PhotoDepth> {
        let pixels = self.get::<f32>("pixel");
        let depth =
            |i: usize| PhotoDepth { disparity: self.map(&format!("depth{i}")), disparity_per_pixel: pixels[[i]] };
        (0..self.cameras.len()).map(depth).collect()
    }

    fn confirmed(&self, depths: &[PhotoDepth]) -> Vec<ConfirmedDepth> {
        let confirmed =
            |(i, depth)| ConfirmedDepth::new(depth, &self.map(&format!("confirmed{i}")).mapv(|yes| yes > 0.0));
        depths.iter().enumerate().map(confirmed).collect()
    }

    /// `use_views` of the views with their confirmed depth.
    pub(crate) fn with_views<T>(&self, use_views: impl FnOnce(&[SurfaceView<'_>]) -> T) -> T {
        let depths = self.depths();
        let confirmed = self.confirmed(&depths);
        let gains = self.gains();
        let view = |i: usize| SurfaceView { view: self.view(i), confirmed: &confirmed[i], gains: gains[i] };
        use_views(&(0..depths.len()).map(view).collect::<Vec<_>>())
    }

    /// The views at the target, and which pixels of the surface they see.
    pub(crate) fn at_target(&self) -> (Vec<WarpSource<'_>>, Vec<Vec<f32>>) {
        let (gains, sweep) = (self.gains(), |i: usize| PlaneSweep::new(&self.cameras[i], &self.target));
        let source = |i: usize| WarpSource { gains: gains[i], ..WarpSource::new(&self.textures[i], sweep(i)) };
        let visible = self.volume::<f32>("visible");
        let visible = visible.outer_iter().map(|map| map.iter().copied().collect()).collect();
        ((0..self.cameras.len()).map(source).collect(), visible)
    }

    /// Disparity that moves a point by one pixel at the target.
    pub(crate) fn disparity_per_pixel(&self) -> f32 {
        self.with_views(|views| target_disparity_per_pixel(views, &self.target, self.range))
    }

    /// Exposure gains of each photo.
    fn gains(&self) -> Vec<[f32; 3]> {
        let gains = self.get::<f32>("gains");
        (0..self.cameras.len()).map(|view| std::array::from_fn(|channel| gains[[view, channel]])).collect()
    }

    /// Compares `found` with the oracle's stage `name`: few elements may be doubtful, and the errors of all
    /// others are bounded by float32 torch's own error and the tolerance file.
    pub(crate) fn check<T: Into<f64> + Copy, D: Dimension>(&self, name: &str, found: &Array<T, D>) {
        let oracle = self.get::<f64>(&format!("oracle.{name}"));
        assert_eq!(found.shape(), oracle.shape(), "{}: shape of {name}", self.name);
        let errors: Vec<f64> = found.iter().zip(oracle.iter()).map(|(&a, b)| (a.into() - b).abs()).collect();
        assert!(errors.iter().all(|e| e.is_finite()), "{}: {name} is not finite everywhere", self.name);
        let doubtful = self.find::<bool>(&format!("doubtful.{name}")).map_or(vec![false; errors.len()], flat);
        let share = doubtful.iter().filter(|&&d| d).count() as f64 / errors.len() as f64;
        let certain: Vec<usize> = (0..errors.len()).filter(|&i| !doubtful[i]).collect();
        let worst = certain
            .iter()
            .copied()
            .max_by(|&a, &b| errors[a].total_cmp(&errors[b]))
            .expect("some elements are not doubtful");
        let mean = certain.iter().map(|&i| errors[i]).sum::<f64>() / certain.len() as f64;
        let tolerance = Tolerance::of(name.trim_end_matches(char::is_numeric));
        let torch = flat(self.get::<f64>(&format!("torch.{name}")));
        let max_bound = tolerance.floor.max(tolerance.max_factor * torch[0]);
        // The means are sums in different orders: equal errors must count as equal.
        let mean_bound = tolerance.mean_floor.max(tolerance.mean_factor * torch[1]) * (1.0 + 1e-9);
        let off = (0..errors.len()).filter(|&i| doubtful[i] && errors[i] > max_bound).count();
        let report = format!(
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
        println!("{report}");
        let mut failures = self.failures.lock().unwrap();
        if share > tolerance.doubtful {
            failures.push(format!("more than {} doubtful:\n{report}", tolerance.doubtful));
        }
        if errors[worst] > max_bound || mean > mean_bound {
            failures.push(format!("beyond max {max_bound:.1e} or mean {mean_bound:.2e}:\n{report}"));
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
        let entry = &all[&format!("surface {stage}")];
        let get =
            |key: &str| entry[key].as_f64().unwrap_or_else(|| panic!("tolerances.json: surface {stage}: no {key}"));
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

pub(crate) fn flat<T: Clone>(array: ArrayD<T>) -> Vec<T> {
    array.iter().cloned().collect()
}
