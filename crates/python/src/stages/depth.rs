//! `liveview_ref.reference.surface`: the depth of photos, and what other photos confirm of it.

use liveview::warp::SourceView;
use liveview_surface::{self, ConsistencyVotes};
use ndarray::{Array2, ArrayView2, Ix2};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray};
use pyo3::prelude::*;

use super::photo::{Photo, two};
use crate::arguments::{Sides, some, whole};
use crate::camera::camera;
use crate::error::value;
use crate::tuples::named;
use crate::work::compute;

/// The depth of a photo, searched from near to far (scene units) among its neighbours; photos [3,
/// h, w] in [0, 1] with their cameras.
#[pyfunction]
pub(crate) fn photo_depth<'py>(
    py: Python<'py>,
    photo: &Bound<'py, PyAny>,
    neighbours: &Bound<'py, PyAny>,
    near: f64,
    far: f64,
) -> PyResult<Bound<'py, PyAny>> {
    searched(py, photo, neighbours, (near, far), liveview_surface::photo_depth)
}

/// As photo_depth, with what the neighbours find at a small size as anchors.
#[pyfunction]
pub(crate) fn anchored_depth<'py>(
    py: Python<'py>,
    photo: &Bound<'py, PyAny>,
    neighbours: &Bound<'py, PyAny>,
    near: f64,
    far: f64,
) -> PyResult<Bound<'py, PyAny>> {
    searched(py, photo, neighbours, (near, far), liveview_surface::stages::anchored_depth)
}

/// A search of the library.
type Search = fn(&SourceView<'_>, &[SourceView<'_>], f64, f64) -> liveview_surface::PhotoDepth;

fn searched<'py>(
    py: Python<'py>,
    photo: &Bound<'py, PyAny>,
    neighbours: &Bound<'py, PyAny>,
    (near, far): (f64, f64),
    search: Search,
) -> PyResult<Bound<'py, PyAny>> {
    let (photo, neighbours) = (Photo::pair("photo", photo)?, Photo::pairs("neighbours", neighbours)?);
    check_range(near, far)?;
    let found = compute(py, || {
        let others: Vec<_> = neighbours.iter().map(Photo::source).collect();
        Ok(search(&photo.source(), &others, near, far))
    })?;
    named(py, "PhotoDepth", (found.disparity.into_pyarray(py), found.disparity_per_pixel))
}

/// Refuses all but 0 < near < far.
pub(super) fn check_range(near: f64, far: f64) -> PyResult<()> {
    liveview::layers::uniform_disparities(near, far, 2).map(|_| ()).map_err(|error| value("near, far", error))
}

/// The pixels [h, w] bool of map `which` that the other maps confirm.
#[pyfunction]
pub(crate) fn confirmed<'py>(
    py: Python<'py>,
    which: &Bound<'py, PyAny>,
    maps: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<bool>>> {
    let maps = some("maps", maps)?;
    let maps = maps.iter().map(|(name, pair)| camera_and_depth(name, pair)).collect::<PyResult<Vec<_>>>()?;
    let which = whole("which", which)?;
    let Some((camera, depth)) = maps.get(which) else {
        return Err(value("which", format!("{which}; expected an index of {} maps", maps.len())));
    };
    let found = compute(py, || {
        let others = maps.iter().enumerate().filter(|(other, _)| *other != which);
        let votes: Vec<_> =
            others.map(|(_, (other, found))| ConsistencyVotes::new((camera, depth), (other, found))).collect();
        Ok(liveview_surface::stages::confirmed(&votes.iter().collect::<Vec<_>>(), depth.disparity.dim()))
    })?;
    Ok(found.into_pyarray(py))
}

fn camera_and_depth(name: &str, pair: &Bound<'_, PyAny>) -> PyResult<(liveview::Camera, liveview_surface::PhotoDepth)> {
    let (of, depth) = two(name, pair, "camera and PhotoDepth")?;
    let camera = camera(&format!("{name}[0]"), &of)?;
    let (disparity, disparity_per_pixel) = depth_map(&format!("{name}[1]"), &depth, &camera)?;
    Ok((camera, liveview_surface::PhotoDepth { disparity, disparity_per_pixel }))
}

/// The fields of a `PhotoDepth` or `ConfirmedDepth` of a camera.
pub(super) fn depth_map(
    name: &str,
    depth: &Bound<'_, PyAny>,
    camera: &liveview::Camera,
) -> PyResult<(Array2<f32>, f32)> {
    let field = |field: &str| {
        let found = depth.getattr(field);
        found.map_err(|_| crate::error::kind(name, format!("it has no {field}; expected a PhotoDepth")))
    };
    let disparity = map(&format!("{name}.disparity"), &field("disparity")?, camera)?;
    let pixel: f32 = field("pixel")?.extract().map_err(|_| value(&format!("{name}.pixel"), "expected a number"))?;
    if !(pixel.is_finite() && pixel > 0.0) {
        return Err(value(&format!("{name}.pixel"), format!("{pixel}; expected a positive number")));
    }
    Ok((disparity, pixel))
}

/// A map of disparities `[h, w]` of a camera's size.
pub(super) fn map(name: &str, argument: &Bound<'_, PyAny>, camera: &liveview::Camera) -> PyResult<Array2<f32>> {
    let shape = format!("{} {}", camera.height(), camera.width());
    let found: PyReadonlyArray<'_, f32, Ix2> = Sides::default().array(name, argument, &shape)?;
    finite(name, found.as_array())?;
    Ok(found.as_array().to_owned())
}

/// Refuses values that are not finite.
pub(super) fn finite(name: &str, values: ArrayView2<'_, f32>) -> PyResult<()> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(found) => Err(value(name, format!("a value is {found}; expected finite numbers"))),
        None => Ok(()),
    }
}
