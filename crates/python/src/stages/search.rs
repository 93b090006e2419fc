//! The search of a photo's depth stage by stage, for the parity tests.
//!
//! `grid` is (near, far, count, parts, cell, starts, ranges): [`Search`].

use liveview::surface::stages::{self, Search};
use liveview::surface::{ConfirmedDepth, DepthMaps, PhotoDepth};
use liveview::warp::SourceView;
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::photo::Photo;
use crate::camera::cameras;

type Planes<'py> = Option<PyReadonlyArray3<'py, u16>>;
type GridArgument<'py> = (f64, f64, usize, usize, usize, Planes<'py>, Planes<'py>);
/// Disparity, and the disparity worth one pixel.
pub(super) type DepthArgument<'py> = (PyReadonlyArray2<'py, f32>, f32);
type Map<'py, T> = Bound<'py, PyArray2<T>>;
type Costs<'py> = Bound<'py, PyArray3<u16>>;

fn with_search<T>(
    (near, far, count, parts, cell, starts, ranges): GridArgument<'_>,
    run: impl FnOnce(&Search<'_>) -> T,
) -> T {
    let [starts, ranges] = [starts, ranges].map(|planes| planes.map(|planes| planes.as_array().to_owned()));
    run(&Search { range: (near, far), count, parts, cell, starts: starts.as_ref(), ranges: ranges.as_ref() })
}

pub(super) fn depth((disparity, pixel): &DepthArgument<'_>) -> PhotoDepth {
    PhotoDepth { disparity: disparity.as_array().to_owned(), disparity_per_pixel: *pixel }
}

/// Those of the photos of these cameras that photo `which` is matched with.
#[pyfunction]
pub(crate) fn neighbours(cameras: &Bound<'_, PyAny>, which: usize) -> PyResult<Vec<usize>> {
    Ok(DepthMaps::new(self::cameras("cameras", cameras)?, 1.0, 2.0).neighbours(which))
}

#[pyfunction]
pub(crate) fn costs<'py>(
    py: Python<'py>,
    photo: &Bound<'py, PyAny>,
    neighbours: &Bound<'py, PyAny>,
    grid: GridArgument<'py>,
) -> PyResult<Costs<'py>> {
    let (photo, neighbours) = (Photo::pair("photo", photo)?, Photo::pairs("neighbours", neighbours)?);
    let neighbours: Vec<_> = neighbours.iter().map(Photo::source).collect();
    Ok(with_search(grid, |search| stages::matching_costs(&photo.source(), &neighbours, search)).into_pyarray(py))
}

/// The planes that each tile of [h, w] cells is searched at, around a coarser map.
#[pyfunction]
pub(crate) fn tile_ranges<'py>(
    py: Python<'py>,
    coarser: PyReadonlyArray2<'py, f32>,
    grid: GridArgument<'py>,
    size: (usize, usize),
) -> Option<Costs<'py>> {
    let coarser = coarser.as_array().to_owned();
    with_search(grid, |search| stages::tile_ranges(&coarser, search, size)).map(|found| found.into_pyarray(py))
}

#[pyfunction]
pub(crate) fn aggregate<'py>(
    py: Python<'py>,
    costs: PyReadonlyArray3<'py, u16>,
    photo: &Bound<'py, PyAny>,
    grid: GridArgument<'py>,
) -> PyResult<Map<'py, f32>> {
    let (costs, photo) = (costs.as_array().to_owned(), Photo::pair("photo", photo)?);
    Ok(with_search(grid, |search| stages::aggregated(&costs, &photo.texture, search)).into_pyarray(py))
}

#[pyfunction]
pub(crate) fn bands<'py>(py: Python<'py>, index: PyReadonlyArray2<'py, f32>, parts: usize, count: usize) -> Costs<'py> {
    stages::segment_starts(&index.as_array().to_owned(), parts, count).into_pyarray(py)
}

/// The disparities of indices.
#[pyfunction]
pub(crate) fn disparity<'py>(
    py: Python<'py>,
    index: PyReadonlyArray2<'py, f32>,
    grid: GridArgument<'py>,
) -> Map<'py, f32> {
    with_search(grid, |search| stages::disparity(&index.as_array().to_owned(), search)).into_pyarray(py)
}

/// The depth of the first of these photos at the small size, searched among the others.
#[pyfunction]
pub(crate) fn small_map<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    near: f64,
    far: f64,
) -> PyResult<(Map<'py, f32>, f32)> {
    let views = Photo::pairs("views", views)?;
    let views: Vec<SourceView<'_>> = views.iter().map(Photo::source).collect();
    let found = stages::small_map(&views, (near, far));
    Ok((found.disparity.into_pyarray(py), found.disparity_per_pixel))
}

/// What the others of a group confirm of each; cameras of the full size.
#[pyfunction]
pub(crate) fn group_confirmed<'py>(
    py: Python<'py>,
    cameras: &Bound<'py, PyAny>,
    maps: Vec<DepthArgument<'py>>,
) -> PyResult<Vec<Map<'py, f32>>> {
    let cameras = self::cameras("cameras", cameras)?;
    let maps: Vec<_> = maps.iter().map(depth).collect();
    let found = stages::group_confirmed(&cameras.iter().collect::<Vec<_>>(), &maps).into_iter();
    Ok(found.map(|confirmed| confirmed.disparity.into_pyarray(py)).collect())
}

/// Which cells of the first photo of a group are kept, and what they are drawn to, from its maps,
/// what is confirmed of them, and what was found of the photo.
#[pyfunction]
pub(crate) fn anchors<'py>(
    py: Python<'py>,
    cameras: &Bound<'py, PyAny>,
    maps: Vec<DepthArgument<'py>>,
    confirmed: Vec<PyReadonlyArray2<'py, f32>>,
    found: DepthArgument<'py>,
) -> PyResult<(Map<'py, bool>, Map<'py, f32>)> {
    let cameras = self::cameras("cameras", cameras)?;
    let maps: Vec<_> = maps.iter().map(depth).collect();
    let sure = |(map, sure): (&PhotoDepth, &PyReadonlyArray2<'_, f32>)| ConfirmedDepth {
        disparity: sure.as_array().to_owned(),
        disparity_per_pixel: map.disparity_per_pixel,
    };
    let confirmed = maps.iter().zip(&confirmed).map(sure).collect();
    let (kept, anchor) = stages::anchors(&cameras.iter().collect::<Vec<_>>(), &maps, confirmed, &depth(&found));
    Ok((kept.into_pyarray(py), anchor.into_pyarray(py)))
}

#[pyfunction]
pub(crate) fn anchored_costs<'py>(
    py: Python<'py>,
    costs: PyReadonlyArray3<'py, u16>,
    kept: PyReadonlyArray2<'py, bool>,
    anchor: PyReadonlyArray2<'py, f32>,
    grid: GridArgument<'py>,
) -> Costs<'py> {
    let (costs, anchor) = (costs.as_array().to_owned(), anchor.as_array().to_owned());
    with_search(grid, |search| stages::anchored_costs(&costs, kept.as_array().to_owned(), &anchor, search))
        .into_pyarray(py)
}

/// Near and far of confirmed disparities, within those searched.
#[pyfunction]
pub(crate) fn depth_range(disparities: PyReadonlyArray1<'_, f32>, searched: (f64, f64)) -> Option<(f64, f64)> {
    stages::range_of(disparities.as_array().to_vec(), searched)
}
