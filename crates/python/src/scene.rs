//! Scenes: from a folder, or from arrays.

use std::path::PathBuf;

use liveview::ImageRgb;
use liveview_scene::cameras::CameraPath;
use liveview_scene::undistorted;
use liveview_synthesizer::{SceneOptions, Targets};
use ndarray::{ArrayView3, Ix3};
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arguments::{
    Object, Sides, as_array, expect, kind, library, matrix, some, value, vector, view_index, whole,
};
use crate::camera::{Camera, posed, refused};
use crate::engine::compute;
use crate::frame::picture_array;

/// Posed photos: from a folder, or by `from_arrays`.
///
/// A folder in one of the formats that the program reads, or a `transforms.json`. Photos wider than
/// `width` pixels are scaled down to it, by default those of more than 2.4 megapixels to that; `images` names the
/// photos' folder, `format` one of several formats in it; `exif_rotate` turns photos by their EXIF orientation.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Scene(pub(crate) liveview_synthesizer::Scene);

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (path, *, width = None, images = None, format = None, exif_rotate = false))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        width: Option<&Object<'_>>,
        images: Option<String>,
        format: Option<&str>,
        exif_rotate: bool,
    ) -> PyResult<Self> {
        let width = width.map(|width| whole("width", width)).transpose()?;
        let format = format.map(str::parse).transpose().map_err(|error: String| value("format", error))?;
        let options = SceneOptions { width, images, format, exif_rotate, ..SceneOptions::default() };
        compute(py, || liveview_synthesizer::Scene::open(&path, &options).map_err(library)).map(Self)
    }

    /// photos [n, h, w, 3], uint8 or float32 in [0, 1], or a list of [h, w, 3] of several sizes; k
    /// [3, 3] or [n, 3, 3]; poses [n, 4, 4], as `Camera` takes them. Views are in the order of
    /// their names, which are 0000, 0001 … by default.
    #[staticmethod]
    #[pyo3(signature = (photos, k, poses, *, convention = "opencv", names = None))]
    fn from_arrays(
        py: Python<'_>,
        photos: &Object<'_>,
        k: &Object<'_>,
        poses: &Object<'_>,
        convention: &str,
        names: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let posed = posed(convention)?;
        let photos = some("photos", photos)?;
        let count = photos.len();
        let pictures = photos.iter().map(|(name, photo)| picture(name, photo)).collect::<PyResult<Vec<_>>>()?;
        let poses = of_each("poses", poses, count)?;
        let one_k = as_array("k", k)?.ndim() == 2;
        let ks = if one_k { vec![("k".to_owned(), k.clone()); count] } else { of_each("k", k, count)? };
        let names = names.unwrap_or_else(|| (0..count).map(|index| format!("{index:04}")).collect());
        if names.len() != count {
            return Err(value("names", format!("{} names; expected {count}, one for each photo", names.len())));
        }
        let mut views = Vec::with_capacity(count);
        for (index, (name, picture)) in names.into_iter().zip(pictures).enumerate() {
            let [(k_name, k), (pose_name, pose)] = [&ks[index], &poses[index]];
            let camera = posed(matrix(k_name, k)?, matrix(pose_name, pose)?, picture.size());
            let camera = camera.map_err(|error| refused(&error, [k_name, pose_name, &photos[index].0]))?;
            views.push((name, picture, camera));
        }
        let scene = compute(py, || {
            liveview_synthesizer::Scene::in_memory(views, &SceneOptions::default())
                .map_err(|error| value("photos", error))
        });
        scene.map(Self)
    }

    /// Of the views, in order.
    #[getter]
    fn names(&self) -> Vec<&str> {
        self.0.views.iter().map(|view| view.name.as_str()).collect()
    }

    /// Of the views, in order.
    #[getter]
    fn cameras(&self) -> Vec<Camera> {
        self.0.views.iter().map(|view| Camera(view.camera.clone())).collect()
    }

    /// Nearest and farthest depth of each view, scene units, where the scene's files give it.
    #[getter]
    fn depth_ranges(&self) -> Vec<Option<(f64, f64)>> {
        self.0.views.iter().map(|view| view.depth_range).collect()
    }

    /// What was skipped or assumed when the scene was opened.
    #[getter]
    fn notes(&self) -> Vec<&str> {
        self.0.notes.iter().map(String::as_str).collect()
    }

    /// The photo of a view, undistorted, at the size of its camera: [h, w, 3] float32 in [0, 1].
    fn photo<'py>(&self, py: Python<'py>, view: &Object<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let index = view_index(&self.0, "view", view)?;
        let photo = compute(py, || self.0.load_image(index).map_err(library))?;
        Ok(picture_array(photo).into_pyarray(py))
    }

    /// The cameras of a path around the views, as `render --path` takes it: "spiral:30".
    fn path(&self, path: &str) -> PyResult<Vec<Camera>> {
        let path: CameraPath = path.parse().map_err(|error| value("path", error))?;
        let targets = Targets::path(&self.0, path).map_err(library)?;
        Ok(targets.list.into_iter().map(|target| Camera(target.camera)).collect())
    }

    fn __len__(&self) -> usize {
        self.0.views.len()
    }

    fn __repr__(&self) -> String {
        format!("Scene({}, {} photos)", self.0.root.display(), self.0.views.len())
    }
}

/// A photo [h, w, 3] as a pinhole camera with its K shows it, float32; edge pixels are repeated where it shows nothing.
/// `distortion`: OpenCV's k1, k2, p1, p2, or with k3, or with k3 to k6 too; with `fisheye` its k1 to k4.
#[pyfunction]
#[pyo3(signature = (photo, k, distortion, *, fisheye = false))]
pub(crate) fn undistort<'py>(
    py: Python<'py>,
    photo: &Object<'py>,
    k: &Object<'py>,
    distortion: &Object<'py>,
    fisheye: bool,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let picture = picture("photo", photo)?;
    let here = liveview::glam::DMat4::IDENTITY.to_cols_array_2d();
    let camera = liveview::Camera::from_opencv(matrix("k", k)?, here, picture.size());
    let camera = camera.map_err(|error| refused(&error, ["k", "k", "photo"]))?;
    let given = vector("distortion", distortion, "n")?.to_vec();
    let is_right = given.len() == 4 || !fisheye && [5, 8].contains(&given.len());
    expect("distortion", format!("{} numbers", given.len()), is_right, "4, 5 or 8, of a fisheye 4")?;
    let found =
        compute(py, || undistorted(&picture, &camera, &given, fisheye).map_err(|error| value("distortion", error)));
    Ok(picture_array(found?).into_pyarray(py))
}

/// As many items as photos, with their names.
fn of_each<'py>(name: &str, argument: &Object<'py>, count: usize) -> PyResult<Vec<(String, Object<'py>)>> {
    let found = some(name, argument)?;
    let wrong = || value(name, format!("{} of them; expected {count}, one for each photo", found.len()));
    if found.len() == count { Ok(found) } else { Err(wrong()) }
}

/// A picture `[h, w, 3]` of u8, or of f32 in [0, 1].
pub(crate) fn picture(name: &str, argument: &Object<'_>) -> PyResult<ImageRgb> {
    let array = as_array(name, argument)?;
    let is_u8 = array.dtype().to_string() == "uint8";
    let picture = if is_u8 {
        let found: PyReadonlyArray<'_, u8, Ix3> = Sides::default().array(name, array.as_any(), "h w 3")?;
        ImageRgb::from_array_u8(found.as_array())
    } else {
        if array.dtype().to_string() != "float32" {
            return Err(kind(name, format!("the array is {}; expected uint8 or float32", array.dtype())));
        }
        let found: PyReadonlyArray<'_, f32, Ix3> = Sides::default().array(name, array.as_any(), "h w 3")?;
        in_range(name, found.as_array())?;
        ImageRgb::from_array(found.as_array())
    };
    picture.map_err(|error| value(name, error))
}

/// Refuses values outside [0, 1].
pub(crate) fn in_range(name: &str, values: ArrayView3<'_, f32>) -> PyResult<()> {
    match values.iter().find(|value| !(0.0..=1.0).contains(*value)) {
        Some(found) => Err(value(name, format!("a value is {found}; expected values in [0, 1]"))),
        None => Ok(()),
    }
}
