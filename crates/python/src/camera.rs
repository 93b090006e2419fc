//! Cameras, and the objects that are taken for cameras.

use liveview::Intrinsics;
use liveview::geometry::{CameraError, Size};
use liveview::glam::DMat3;
use ndarray::{arr1, arr2};
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arguments::{Object, field, matrix, some, value, vector, whole};

/// A pinhole camera. Always valid: a K without an inverse, a matrix that is not a rotation and
/// numbers that are not finite are refused.
///
/// k [3, 3] in pixels; pose [4, 4] in scene units: "opencv": cam_from_world, x right, y down, z
/// forward; "opengl": world_from_cam, x right, y up, z backwards, as nerfstudio and Blender have
/// it.
#[pyclass(frozen, module = "liveview", eq, from_py_object)]
#[derive(Clone, PartialEq)]
pub(crate) struct Camera(pub(crate) liveview::Camera);

/// A camera of K, a pose and a size.
type Posed = fn([[f64; 3]; 3], [[f64; 4]; 4], Size) -> Result<liveview::Camera, CameraError>;

/// What makes a camera of a pose in a convention.
pub(crate) fn posed(convention: &str) -> PyResult<Posed> {
    match convention {
        "opencv" => Ok(liveview::Camera::from_opencv),
        "opengl" => Ok(liveview::Camera::from_opengl),
        _ => Err(value("convention", format!("{convention:?}; expected \"opencv\" or \"opengl\""))),
    }
}

/// Which of the arguments K, pose and size an error is about.
pub(crate) fn refused(error: &CameraError, [k, pose, size]: [&str; 3]) -> PyErr {
    let argument = match error {
        CameraError::Size { .. } => size,
        CameraError::SingularK { .. } | CameraError::TooLarge { .. } | CameraError::Matrix { matrix: "K", .. } => k,
        CameraError::NotFinite { field, .. } if ["fx", "fy", "cx", "cy", "skew"].contains(&field.as_str()) => k,
        _ => pose,
    };
    value(argument, error)
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (k, pose, width, height, *, convention = "opencv"))]
    fn new(
        k: &Object<'_>,
        pose: &Object<'_>,
        width: &Object<'_>,
        height: &Object<'_>,
        convention: &str,
    ) -> PyResult<Self> {
        let posed = posed(convention)?;
        let size = Size::new(whole("width", width)?, whole("height", height)?);
        let camera = posed(matrix("k", k)?, matrix("pose", pose)?, size);
        Ok(Self(camera.map_err(|error| refused(&error, ["k", "pose", "width, height"]))?))
    }

    /// [3, 3] float64, pixels.
    #[getter]
    fn k<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        rows(py, self.0.k())
    }

    /// R of cam_from_world, [3, 3] float64.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        rows(py, self.0.rotation())
    }

    /// t of cam_from_world, [3] float64, scene units.
    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        arr1(&self.0.translation().to_array()).into_pyarray(py)
    }

    /// The camera's centre in the world, [3] float64, scene units.
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        arr1(&self.0.centre().to_array()).into_pyarray(py)
    }

    /// Pixels.
    #[getter]
    fn width(&self) -> usize {
        self.0.width()
    }

    /// Pixels.
    #[getter]
    fn height(&self) -> usize {
        self.0.height()
    }

    /// [4, 4] float64, as the constructor takes it.
    #[pyo3(signature = (convention = "opencv"))]
    fn pose<'py>(&self, py: Python<'py>, convention: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        posed(convention)?;
        let (axes, origin) = if convention == "opencv" {
            (self.0.rotation(), self.0.translation())
        } else {
            let rows = self.0.rotation().transpose();
            (DMat3::from_cols(rows.x_axis, -rows.y_axis, -rows.z_axis), self.0.centre())
        };
        let row = |i: usize| [axes.row(i).x, axes.row(i).y, axes.row(i).z, origin[i]];
        Ok(arr2(&[row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]).into_pyarray(py))
    }

    /// The same camera for its picture resampled to that size, pixels.
    fn with_size_scaled(&self, width: &Object<'_>, height: &Object<'_>) -> PyResult<Self> {
        let scaled = self.0.with_size_scaled(whole("width", width)?, whole("height", height)?);
        Ok(Self(scaled.map_err(|error| value("width, height", error))?))
    }

    /// The same camera with another pose [4, 4].
    #[pyo3(signature = (pose, *, convention = "opencv"))]
    fn with_pose(&self, pose: &Object<'_>, convention: &str) -> PyResult<Self> {
        let k = self.0.k().transpose().to_cols_array_2d();
        let moved = posed(convention)?(k, matrix("pose", pose)?, self.0.size());
        Ok(Self(moved.map_err(|error| value("pose", error))?))
    }

    fn __repr__(&self) -> String {
        let Intrinsics { fx, fy, cx, cy, .. } = self.0.intrinsics();
        format!("Camera({}, fx {fx}, fy {fy}, cx {cx}, cy {cy}, centre {})", self.0.size(), self.0.centre())
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<NewArguments<'py>> {
        Ok((self.k(py), self.pose(py, "opencv")?, self.width(), self.height()))
    }
}

/// What `copy` and `pickle` make a camera of.
type NewArguments<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, usize, usize);

fn rows(py: Python<'_>, matrix: DMat3) -> Bound<'_, PyArray2<f64>> {
    arr2(&matrix.transpose().to_cols_array_2d()).into_pyarray(py)
}

/// The camera of an argument: a [`Camera`], or any object with the fields of the reference's, `k`,
/// `rotation`, `translation`, `width` and `height`.
pub(crate) fn camera(name: &str, argument: &Object<'_>) -> PyResult<liveview::Camera> {
    if let Ok(camera) = argument.cast::<Camera>() {
        return Ok(camera.get().0.clone());
    }
    let field = |field: &str| self::field(name, argument, field, "a Camera");
    let of = |field: &str| format!("{name}.{field}");
    let k: [[f64; 3]; 3] = matrix(&of("k"), &field("k")?)?;
    let rotation: [[f64; 3]; 3] = matrix(&of("rotation"), &field("rotation")?)?;
    let translation = vector(&of("translation"), &field("translation")?, "3")?;
    let side =
        |word: &str| field(word)?.extract::<usize>().map_err(|_| value(&of(word), "expected a whole number of pixels"));
    let (width, height) = (side("width")?, side("height")?);
    let row = |i: usize| [rotation[i][0], rotation[i][1], rotation[i][2], translation[i]];
    let pose = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
    let camera = liveview::Camera::from_opencv(k, pose, Size::new(width, height));
    camera.map_err(|error| value(name, error))
}

/// The cameras of an argument, at least one.
pub(crate) fn cameras(name: &str, argument: &Object<'_>) -> PyResult<Vec<liveview::Camera>> {
    some(name, argument)?.iter().map(|(name, item)| camera(name, item)).collect()
}
