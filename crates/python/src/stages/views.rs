//! `liveview_ref.reference.geometry.view_selection`.

use liveview::geometry;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

use crate::arguments::whole;
use crate::camera::{camera, cameras};
use crate::error::value;

/// Indices of the `count` cameras nearest to the target, nearest first, among those that face its
/// direction.
#[pyfunction]
pub(crate) fn choose_views(
    cameras: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    count: &Bound<'_, PyAny>,
) -> PyResult<Vec<usize>> {
    let (found, target) = (self::cameras("cameras", cameras)?, camera("target", target)?);
    let found: Vec<_> = found.iter().collect();
    geometry::choose_views(&found, &target, whole("count", count)?).map_err(|error| value("cameras", error))
}

/// Distances of the cameras' centres to the target's, [V] float64, scene units.
#[pyfunction]
pub(crate) fn view_distances<'py>(
    py: Python<'py>,
    cameras: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (found, target) = (self::cameras("cameras", cameras)?, camera("target", target)?);
    let found: Vec<f64> = found.iter().map(|camera| geometry::distance(camera, &target)).collect();
    Ok(found.into_pyarray(py))
}
