//! A golden file: photos, cameras, and the oracle's output of each stage.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics, Size};
use liveview::image::ImageRgb;
use liveview::warp::{SourceView, Texture};
use ndarray::{Array, Array2, Array3, Array4, ArrayD, Dimension, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadNpyError, ReadNpzError, ReadableElement};

use crate::tolerance::Tolerance;

/// Stages whose errors are relative to the oracle's largest element, as the tolerance file says.
const RELATIVE_STAGES: [&str; 9] = [
    "homography",
    "coarse_disparity",
    "fine_layers",
    "fine_disparity",
    "range",
    "cell_maps",
    "maps",
    "logits",
    "disparity",
];

/// The folder of the golden files.
pub(crate) fn folder() -> PathBuf {
    let folder = std::env::var_os("LIVEVIEW_GOLDENS").map(PathBuf::from);
    folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/goldens"))
}

/// The lines of a file in [`folder`], which lists generated cases.
pub(crate) fn listed_cases(file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(folder().join(file)).expect("run `make test-rust`, which generates it");
    text.lines().map(str::to_owned).collect()
}

/// One golden file, with its photos and cameras.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) textures: Vec<Texture>,
    pub(crate) target: Camera,
    path: PathBuf,
    /// Precedes the name of the file, and those of its stages in the tolerance file.
    group: Option<&'static str>,
    /// Errors that [`Self::check`] found beyond their bounds.
    failures: Mutex<Vec<String>>,
}

impl Case {
    /// Opens the file `GROUP_NAME.npz`, or `NAME.npz` without a group.
    pub(crate) fn open(group: Option<&'static str>, name: &'static str) -> Self {
        let file = group.map_or_else(|| format!("{name}.npz"), |group| format!("{group}_{name}.npz"));
        let path = folder().join(file);
        assert!(path.is_file(), "{}: run `make test-rust`, which generates it", path.display());
        let (cameras, textures, failures) = (Vec::new(), Vec::new(), Mutex::default());
        let mut case = Self { name, cameras, textures, target: any_camera(), path, group, failures };
        for view in 0.. {
            let Some(image) = case.find::<f32>(&format!("view{view}.image")) else { break };
            let (height, width) = (image.shape()[0], image.shape()[1]);
            case.cameras.push(case.camera(&format!("view{view}"), Size::new(width, height)));
            case.textures.push(Texture::new(&ImageRgb::new(width, height, flat(image)).unwrap()));
        }
        let size = case.get::<i64>("target.size");
        case.target = case.camera("target", Size::new(size[[0]] as usize, size[[1]] as usize));
        case
    }

    /// An array of the file, if it exists.
    pub(crate) fn find<T: ReadableElement>(&self, array: &str) -> Option<ArrayD<T>> {
        let mut file = NpzReader::new(std::fs::File::open(&self.path).unwrap()).unwrap();
        match file.by_name::<OwnedRepr<T>, IxDyn>(array) {
            Ok(found) => Some(found),
            Err(ReadNpzError::Npy(ReadNpyError::WrongDescriptor(kind))) => panic!("{}: {array} is {kind:?}", self.name),
            Err(_) => None,
        }
    }

    /// An array of the file.
    pub(crate) fn get<T: ReadableElement>(&self, array: &str) -> ArrayD<T> {
        self.find(array).unwrap_or_else(|| panic!("{}: no array {array}", self.name))
    }

    /// An array `[height, width]`.
    pub(crate) fn map(&self, array: &str) -> Array2<f32> {
        self.get::<f32>(array).into_dimensionality().unwrap()
    }

    /// An array of three dimensions.
    pub(crate) fn volume<T: ReadableElement>(&self, array: &str) -> Array3<T> {
        self.get::<T>(array).into_dimensionality().unwrap()
    }

    /// An array `[layers, channels, height, width]`.
    pub(crate) fn layers_of(&self, array: &str) -> Array4<f32> {
        self.get::<f32>(array).into_dimensionality().unwrap()
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

    pub(crate) fn views(&self) -> Vec<SourceView<'_>> {
        (0..self.cameras.len()).map(|index| self.view(index)).collect()
    }

    /// Compares `found` with the oracle's stage `name`: few elements may be doubtful, and the
    /// errors of all others are bounded by float32 torch's own error and the tolerance file. Errors
    /// beyond the bounds are collected for [`Self::into_failures`].
    pub(crate) fn check<T: Into<f64> + Copy, D: Dimension>(&self, name: &str, found: &Array<T, D>) {
        let oracle = self.get::<f64>(&format!("oracle.{name}"));
        assert_eq!(found.shape(), oracle.shape(), "{}: shape of {name}", self.name);
        let is_relative = self.group.is_none() && RELATIVE_STAGES.contains(&name);
        let scale = if is_relative { oracle.iter().fold(0.0, |top: f64, x| top.max(x.abs())) } else { 1.0 };
        let error = |(&a, b): (&T, &f64)| (a.into() - b).abs() / scale;
        let errors: Vec<f64> = found.iter().zip(oracle.iter()).map(error).collect();
        assert!(errors.iter().all(|e| e.is_finite()), "{}: {name} is not finite everywhere", self.name);
        let doubtful = self.find::<bool>(&format!("doubtful.{name}")).map_or(vec![false; errors.len()], flat);
        let share = doubtful.iter().filter(|&&d| d).count() as f64 / errors.len() as f64;
        let certain: Vec<usize> = (0..errors.len()).filter(|&i| !doubtful[i]).collect();
        let worst = certain.iter().copied().max_by(|&a, &b| errors[a].total_cmp(&errors[b]));
        let worst = worst.expect("some elements are not doubtful");
        let mean = certain.iter().map(|&i| errors[i]).sum::<f64>() / certain.len() as f64;
        // Stages of single photos end with the photo's number.
        let stage = name.trim_end_matches(char::is_numeric);
        let entry = self.group.map_or_else(|| stage.to_owned(), |group| format!("{group} {stage}"));
        let tolerance = Tolerance::of(&entry);
        let torch = flat(self.get::<f64>(&format!("torch.{name}")));
        let (max_bound, mean_bound) = (tolerance.max(torch[0]), tolerance.mean(torch[1]));
        let wrong = (0..errors.len()).filter(|&i| doubtful[i] && errors[i] > max_bound).count();
        let report = format!(
            "{:13} {name:14} max {:.1e} (torch {:.1e})  mean {mean:.3e} (torch {:.3e})  \
             doubtful {:.3} %, {wrong} of them wrong  worst at {:?}: {} for {}",
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

    /// Errors that [`Self::check`] found beyond their bounds.
    pub(crate) fn into_failures(self) -> Vec<String> {
        self.failures.into_inner().unwrap()
    }
}

/// Fails with all failures of several cases.
pub(crate) fn assert_none(failures: &[String]) {
    assert!(failures.is_empty(), "{} beyond their bounds:\n{}", failures.len(), failures.join("\n"));
}

fn any_camera() -> Camera {
    let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5, skew: 0.0 };
    Camera::new(intrinsics, 1, 1, DMat3::IDENTITY, DVec3::ZERO).unwrap()
}

pub(crate) fn flat<T: Clone>(array: ArrayD<T>) -> Vec<T> {
    array.iter().cloned().collect()
}
