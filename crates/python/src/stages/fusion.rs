//! The fusion of confirmed depths at the target stage by stage, for the parity tests.

use liveview::geometry::PlaneSweep;
use liveview::render::{ViewCorrection, Visibility, occluded};
use liveview::warp::WarpSource;
use liveview_surface::{ConfirmedDepth, stages};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::photo::Photo;
use super::search::{DepthArgument, depth};
use super::surface::View;
use crate::camera::camera;

type Map<'py, T> = Bound<'py, PyArray2<T>>;
type Maps<'py> = Bound<'py, PyArray3<f32>>;

/// The depth of photo `which` of a set, moved to the nearer side at edges; `confirmed`: its pixels that
/// the others confirm.
#[pyfunction]
pub(crate) fn nearer_edges<'py>(
    py: Python<'py>,
    which: usize,
    photos: &Bound<'py, PyAny>,
    maps: Vec<DepthArgument<'py>>,
    confirmed: PyReadonlyArray2<'py, bool>,
) -> PyResult<Map<'py, f32>> {
    let photos = Photo::pairs("photos", photos)?;
    let maps: Vec<_> = maps.iter().map(depth).collect();
    let set: Vec<_> = photos.iter().map(Photo::source).zip(&maps).collect();
    let confirmed = ConfirmedDepth::new(&maps[which], &confirmed.as_array().to_owned());
    Ok(stages::nearer_edges(&set, which, &confirmed).disparity.into_pyarray(py))
}

/// The disparity worth one pixel at the target.
#[pyfunction]
pub(crate) fn pixel_of(views: &Bound<'_, PyAny>, target: &Bound<'_, PyAny>, near: f64, far: f64) -> PyResult<f32> {
    let views = View::all(views)?;
    let views: Vec<_> = views.iter().map(View::of).collect();
    Ok(stages::target_disparity_per_pixel(&views, &camera("target", target)?, (near, far)))
}

/// The views' confirmed depth at the target; `pixel`: the disparity worth one there.
#[pyfunction]
pub(crate) fn splat<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    pixel: f32,
) -> PyResult<Map<'py, f32>> {
    let views = View::all(views)?;
    let views: Vec<_> = views.iter().map(View::of).collect();
    Ok(stages::splatted(&views, &camera("target", target)?, pixel).into_pyarray(py))
}

#[pyfunction]
pub(crate) fn photo_variance<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    visible: PyReadonlyArray3<'py, f32>,
    target: &Bound<'py, PyAny>,
    surface: PyReadonlyArray2<'py, f32>,
) -> PyResult<Map<'py, f32>> {
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
    views: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    splatted: PyReadonlyArray2<'py, f32>,
    near: f64,
    far: f64,
) -> PyResult<(Maps<'py>, Map<'py, f32>)> {
    let views = View::all(views)?;
    let views: Vec<_> = views.iter().map(View::of).collect();
    let (target, splatted) = (camera("target", target)?, splatted.as_array().to_owned());
    let (costs, disparity) = stages::target_search(&views, &target, &splatted, (near, far));
    Ok((costs.into_pyarray(py), disparity.into_pyarray(py)))
}

/// A surface warped from the views, in balanced colours and without the samples hidden by `margin`:
/// colour [3 V, h, w], coverage [V, h, w], and where any view sees it.
#[pyfunction]
pub(crate) fn hide<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    surface: PyReadonlyArray2<'py, f32>,
    margin: f32,
) -> PyResult<(Maps<'py>, Maps<'py>, Map<'py, bool>)> {
    let (views, target) = (View::all(views)?, camera("target", target)?);
    let views: Vec<_> = views.iter().map(View::of).collect();
    let disparities = views.iter().map(|view| &view.confirmed.disparity).collect();
    let visibility = Visibility { disparities, margin, is_seen: true };
    let gains = views.iter().map(|view| ViewCorrection { gains: view.gains, sharpening: 0.0 });
    let corrections: Vec<_> = gains.collect();
    let sources: Vec<_> = views.iter().map(|view| view.view).collect();
    let (colour, coverage, seen) =
        occluded(&visibility, &corrections, &sources, &target, &surface.as_array().to_owned());
    Ok((colour.into_pyarray(py), coverage.into_pyarray(py), seen.into_pyarray(py)))
}
