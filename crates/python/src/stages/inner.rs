//! The search of a photo's depth, and the fusion of confirmed depths at the target, stage by stage, for
//! the parity tests.
//!
//! `grid` is (near, far, count, parts, cell, starts, ranges): [`Search`].

use liveview::geometry::PlaneSweep;
use liveview::render::{ViewCorrection, Visibility, occluded};
use liveview::warp::{SourceView, WarpSource};
use liveview_surface::stages::{self, Search};
use liveview_surface::{ConfirmedDisparity, DepthMaps, PhotoDisparity};
use numpy::{IntoPyArray, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::surface::View;
use super::warp::Photo;
use crate::arguments::{Map, Maps, Object};
use crate::camera::{camera, cameras};

type Planes<'py> = Option<PyReadonlyArray3<'py, u16>>;
type GridArgument<'py> = (f64, f64, usize, usize, usize, Planes<'py>, Planes<'py>);
/// Disparity, and the disparity worth one pixel.
pub(super) type DepthArgument<'py> = (PyReadonlyArray2<'py, f32>, f32);

fn with_search<T>(
    (near, far, count, parts, cell, starts, ranges): GridArgument<'_>,
    run: impl FnOnce(&Search<'_>) -> T,
) -> T {
    let [starts, ranges] = [starts, ranges].map(|planes| planes.map(|planes| planes.as_array().to_owned()));
    run(&Search { range: (near, far), count, parts, cell, starts: starts.as_ref(), ranges: ranges.as_ref() })
}

pub(super) fn depth((disparity, pixel): &DepthArgument<'_>) -> PhotoDisparity {
    PhotoDisparity { disparity: disparity.as_array().to_owned(), disparity_per_pixel: *pixel }
}

/// Those of the photos of these cameras that photo `which` is matched with.
#[pyfunction]
pub(crate) fn neighbours(cameras: &Object<'_>, which: usize) -> PyResult<Vec<usize>> {
    Ok(DepthMaps::new(self::cameras("cameras", cameras)?, 1.0, 2.0).neighbours(which))
}

#[pyfunction]
pub(crate) fn costs<'py>(
    py: Python<'py>,
    photo: &Object<'py>,
    neighbours: &Object<'py>,
    grid: GridArgument<'py>,
) -> PyResult<Maps<'py, u16>> {
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
) -> Option<Maps<'py, u16>> {
    let coarser = coarser.as_array().to_owned();
    with_search(grid, |search| stages::tile_ranges(&coarser, search, size)).map(|found| found.into_pyarray(py))
}

#[pyfunction]
pub(crate) fn aggregate<'py>(
    py: Python<'py>,
    costs: PyReadonlyArray3<'py, u16>,
    photo: &Object<'py>,
    grid: GridArgument<'py>,
) -> PyResult<Map<'py>> {
    let (costs, photo) = (costs.as_array().to_owned(), Photo::pair("photo", photo)?);
    Ok(with_search(grid, |search| stages::aggregated(&costs, &photo.texture, search)).into_pyarray(py))
}

#[pyfunction]
pub(crate) fn bands<'py>(index: PyReadonlyArray2<'py, f32>, parts: usize, count: usize) -> Maps<'py, u16> {
    stages::segment_starts(&index.as_array().to_owned(), parts, count).into_pyarray(index.py())
}

/// The disparities of indices.
#[pyfunction]
pub(crate) fn disparity<'py>(index: PyReadonlyArray2<'py, f32>, grid: GridArgument<'py>) -> Map<'py> {
    let py = index.py();
    with_search(grid, |search| stages::disparity(&index.as_array().to_owned(), search)).into_pyarray(py)
}

/// The depth of the first of these photos at the small size, searched among the others.
#[pyfunction]
pub(crate) fn small_map<'py>(py: Python<'py>, views: &Object<'py>, near: f64, far: f64) -> PyResult<(Map<'py>, f32)> {
    let views = Photo::pairs("views", views)?;
    let views: Vec<SourceView<'_>> = views.iter().map(Photo::source).collect();
    let found = stages::small_map(&views, (near, far));
    Ok((found.disparity.into_pyarray(py), found.disparity_per_pixel))
}

/// What the others of a group confirm of each; cameras of the full size.
#[pyfunction]
pub(crate) fn group_confirmed<'py>(cameras: &Object<'py>, maps: Vec<DepthArgument<'py>>) -> PyResult<Vec<Map<'py>>> {
    let py = cameras.py();
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
    cameras: &Object<'py>,
    maps: Vec<DepthArgument<'py>>,
    confirmed: Vec<PyReadonlyArray2<'py, f32>>,
    found: DepthArgument<'py>,
) -> PyResult<(Map<'py, bool>, Map<'py>)> {
    let cameras = self::cameras("cameras", cameras)?;
    let maps: Vec<_> = maps.iter().map(depth).collect();
    let sure = |(map, sure): (&PhotoDisparity, &PyReadonlyArray2<'_, f32>)| ConfirmedDisparity {
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
) -> Maps<'py, u16> {
    let (costs, anchor) = (costs.as_array().to_owned(), anchor.as_array().to_owned());
    with_search(grid, |search| stages::anchored_costs(&costs, kept.as_array().to_owned(), &anchor, search))
        .into_pyarray(py)
}

/// Near and far of confirmed disparities, within those searched.
#[pyfunction]
pub(crate) fn depth_range(disparities: PyReadonlyArray1<'_, f32>, searched: (f64, f64)) -> Option<(f64, f64)> {
    stages::range_of(disparities.as_array().to_vec(), searched)
}

/// The depth of photo `which` of a set, moved to the nearer side at edges; `confirmed`: its pixels that
/// the others confirm.
#[pyfunction]
pub(crate) fn nearer_edges<'py>(
    py: Python<'py>,
    which: usize,
    photos: &Object<'py>,
    maps: Vec<DepthArgument<'py>>,
    confirmed: PyReadonlyArray2<'py, bool>,
) -> PyResult<Map<'py>> {
    let photos = Photo::pairs("photos", photos)?;
    let maps: Vec<_> = maps.iter().map(depth).collect();
    let set: Vec<_> = photos.iter().map(Photo::source).zip(&maps).collect();
    let confirmed = ConfirmedDisparity::new(&maps[which], &confirmed.as_array().to_owned());
    Ok(stages::nearer_edges(&set, which, &confirmed).disparity.into_pyarray(py))
}

/// The disparity worth one pixel at the target.
#[pyfunction]
pub(crate) fn pixel_of(views: &Object<'_>, target: &Object<'_>, near: f64, far: f64) -> PyResult<f32> {
    let views = View::all(views)?;
    Ok(stages::target_disparity_per_pixel(&View::of_all(&views), &camera("target", target)?, (near, far)))
}

/// The views' confirmed depth at the target; `pixel`: the disparity worth one there.
#[pyfunction]
pub(crate) fn splat<'py>(py: Python<'py>, views: &Object<'py>, target: &Object<'py>, pixel: f32) -> PyResult<Map<'py>> {
    let views = View::all(views)?;
    Ok(stages::splatted(&View::of_all(&views), &camera("target", target)?, pixel).into_pyarray(py))
}

#[pyfunction]
pub(crate) fn photo_variance<'py>(
    py: Python<'py>,
    views: &Object<'py>,
    visible: PyReadonlyArray3<'py, f32>,
    target: &Object<'py>,
    surface: PyReadonlyArray2<'py, f32>,
) -> PyResult<Map<'py>> {
    let (views, target) = (View::all(views)?, camera("target", target)?);
    let sources = views.iter().map(|view| WarpSource {
        gains: view.gains,
        ..WarpSource::new(&view.photo.texture, PlaneSweep::new(&view.photo.camera, &target))
    });
    let sources: Vec<_> = sources.collect();
    let visible: Vec<Vec<f32>> = visible.as_array().outer_iter().map(|map| map.iter().copied().collect()).collect();
    Ok(stages::photo_variance(&sources, &visible, &surface.as_array().to_owned()).into_pyarray(py))
}

/// The target's own search from its splat: costs [D, h, w], and the disparity found [h, w].
#[pyfunction]
pub(crate) fn target_search<'py>(
    py: Python<'py>,
    views: &Object<'py>,
    target: &Object<'py>,
    splatted: PyReadonlyArray2<'py, f32>,
    near: f64,
    far: f64,
) -> PyResult<(Maps<'py>, Map<'py>)> {
    let views = View::all(views)?;
    let (target, splatted) = (camera("target", target)?, splatted.as_array().to_owned());
    let (costs, disparity) = stages::target_search(&View::of_all(&views), &target, &splatted, (near, far));
    Ok((costs.into_pyarray(py), disparity.into_pyarray(py)))
}

/// A surface warped from the views, in balanced colours and without the samples hidden by `margin`:
/// colour [3 V, h, w], coverage [V, h, w], and where any view sees it.
#[pyfunction]
pub(crate) fn hide<'py>(
    py: Python<'py>,
    views: &Object<'py>,
    target: &Object<'py>,
    surface: PyReadonlyArray2<'py, f32>,
    margin: f32,
) -> PyResult<(Maps<'py>, Maps<'py>, Map<'py, bool>)> {
    let (views, target) = (View::all(views)?, camera("target", target)?);
    let views = View::of_all(&views);
    let disparities = views.iter().map(|view| &view.confirmed.disparity).collect();
    let visibility = Visibility { disparities, margin, is_seen: true };
    let gains = views.iter().map(|view| ViewCorrection { gains: view.gains, sharpening: 0.0 });
    let corrections: Vec<_> = gains.collect();
    let sources: Vec<_> = views.iter().map(|view| view.view).collect();
    let (colour, coverage, seen) =
        occluded(&visibility, &corrections, &sources, &target, &surface.as_array().to_owned());
    Ok((colour.into_pyarray(py), coverage.into_pyarray(py), seen.into_pyarray(py)))
}
