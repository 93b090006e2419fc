//! The guided search stage by stage, and what planes and layers are to the warp: for the parity
//! tests.

use liveview::geometry::{PlaneSweep, Size};
use liveview::layers::{CELL, Layer, Layers, padded};
use liveview::warp::warp_sources;
use liveview_surface::guided::{self, GuidedSearch};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::layers::maps_of;
use super::photo::{Photo, photos};
use crate::camera::camera;
use crate::error::library;

type Map<'py> = Bound<'py, PyArray2<f32>>;
type Maps<'py> = Bound<'py, PyArray3<f32>>;

/// `PlaneSweep.source_from_target`.
#[pyfunction]
pub(crate) fn source_from_target(
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    disparity: f64,
) -> PyResult<[[f64; 3]; 3]> {
    let sweep = PlaneSweep::new(&camera("source", source)?, &camera("target", target)?);
    Ok(sweep.source_from_target(disparity).transpose().to_cols_array_2d())
}

/// Planes as maps over the padded target.
#[pyfunction]
pub(crate) fn plane_maps<'py>(
    py: Python<'py>,
    target: &Bound<'py, PyAny>,
    disparities: Vec<f64>,
) -> PyResult<Maps<'py>> {
    let layers = Layers::planes(&disparities).map_err(library)?;
    Ok(maps_of(&layers, padded(camera("target", target)?.size())).into_pyarray(py))
}

/// Maps on cells as maps of pixels.
#[pyfunction]
pub(crate) fn upsample_maps<'py>(py: Python<'py>, coarse: PyReadonlyArray3<'py, f32>) -> PyResult<Maps<'py>> {
    let (_, height, width) = coarse.as_array().dim();
    Ok(maps_of(&layers_on_cells(&coarse)?, Size::new(CELL * width, CELL * height)).into_pyarray(py))
}

/// Layers of maps on cells.
pub(super) fn layers_on_cells(maps: &PyReadonlyArray3<'_, f32>) -> PyResult<Layers> {
    Layers::maps(maps.as_array().outer_iter().map(|map| map.to_owned()).collect()).map_err(library)
}

/// The planes of the first search.
#[pyfunction]
pub(crate) fn search_planes(
    views: &Bound<'_, PyAny>,
    cameras: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    near: f64,
    far: f64,
) -> PyResult<Vec<f64>> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let views: Vec<_> = photos.iter().map(Photo::source).collect();
    let found = GuidedSearch::new(near, far).search(&warp_sources(&views, &target), padded(target.size()));
    Ok(found.map_err(library)?.disparities)
}

#[pyfunction]
pub(crate) fn layer_costs<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    maps: PyReadonlyArray3<'py, f32>,
    cell: usize,
    window: usize,
) -> PyResult<Maps<'py>> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let views: Vec<_> = photos.iter().map(Photo::source).collect();
    Ok(guided::layer_costs(&warp_sources(&views, &target), maps.as_array(), cell, window).into_pyarray(py))
}

#[pyfunction]
pub(crate) fn semi_global<'py>(py: Python<'py>, costs: PyReadonlyArray3<'py, f32>) -> Maps<'py> {
    guided::semi_global(costs.as_array(), guided::PENALTIES).into_pyarray(py)
}

#[pyfunction]
pub(crate) fn winner_takes_all<'py>(
    py: Python<'py>,
    costs: PyReadonlyArray3<'py, f32>,
    maps: PyReadonlyArray3<'py, f32>,
) -> Map<'py> {
    guided::winner_takes_all(costs.as_array(), maps.as_array()).into_pyarray(py)
}

/// The layers of the second search, of the disparity that the first found.
#[pyfunction]
pub(crate) fn fine_layers<'py>(py: Python<'py>, disparity: PyReadonlyArray2<'py, f32>, margin: f32) -> Maps<'py> {
    guided::fine_layers(&guided::range_of(&disparity.as_array().to_owned(), margin)).into_pyarray(py)
}

/// The range of each cell, nearest, surface and farthest, and the layers on cells that divide it.
#[pyfunction]
pub(crate) fn range_of<'py>(
    py: Python<'py>,
    disparity: PyReadonlyArray2<'py, f32>,
    count: usize,
) -> PyResult<([Map<'py>; 3], Maps<'py>)> {
    let range = guided::range_of(&disparity.as_array().to_owned(), 0.0);
    let layers = range.layers(count).map_err(library)?;
    let map = |layer: &'_ Layer| if let Layer::Map(map) = layer { Some(map.clone()) } else { None };
    let maps: Vec<_> = layers.as_slice().iter().filter_map(map).collect();
    let maps: Vec<_> = maps.iter().map(|map| map.view()).collect();
    let maps = ndarray::stack(ndarray::Axis(0), &maps).expect("of one size");
    let range = [range.nearest(), range.surface(), range.farthest()];
    Ok((range.map(|map| map.clone().into_pyarray(py)), maps.into_pyarray(py)))
}
