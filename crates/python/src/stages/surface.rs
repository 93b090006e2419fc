//! `liveview_ref.reference.surface`: the surface at a target, occlusion, and the photos' correction.

use liveview::geometry::Size;
use liveview::layers::padded;
use liveview_surface::stages::{self, SurfaceView};
use liveview_surface::{ConfirmedDepth, Surface};
use ndarray::{Array2, Ix2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray};
use pyo3::prelude::*;

use super::depth::{check_range, depth_map, finite, map};
use super::layers::{layer_count, maps_of};
use super::photo::Photo;
use crate::arguments::{Sides, distances, some, vector};
use crate::camera::camera;
use crate::error::{kind, value};
use crate::tuples::named;
use crate::work::compute;

/// A photo with its confirmed depth: the reference's `SurfaceView`.
pub(super) struct View {
    pub(super) photo: Photo,
    confirmed: ConfirmedDepth,
    pub(super) gains: [f32; 3],
}

impl View {
    fn new(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<Self> {
        let field = |field: &str| {
            let found = argument.getattr(field);
            found.map_err(|_| kind(name, format!("it has no {field}; expected image, camera, confirmed and gains")))
        };
        let of = |field: &str| format!("{name}.{field}");
        let photo = Photo::new((&of("image"), &field("image")?), (&of("camera"), &field("camera")?))?;
        let confirmed = depth_map(&of("confirmed"), &field("confirmed")?, &photo.camera)?;
        let gains = vector(&of("gains"), &field("gains")?, "3")?;
        if let Some(wrong) = gains.iter().find(|gain| !((**gain as f32).is_finite() && **gain > 0.0)) {
            return Err(value(&of("gains"), format!("a gain is {wrong}; expected positive numbers")));
        }
        let confirmed = ConfirmedDepth { disparity: confirmed.0, disparity_per_pixel: confirmed.1 };
        Ok(Self { photo, confirmed, gains: std::array::from_fn(|channel| gains[channel] as f32) })
    }

    pub(super) fn all(argument: &Bound<'_, PyAny>) -> PyResult<Vec<Self>> {
        some("views", argument)?.iter().map(|(name, view)| Self::new(name, view)).collect()
    }

    pub(super) fn of(&self) -> SurfaceView<'_> {
        SurfaceView { view: self.photo.source(), confirmed: &self.confirmed, gains: self.gains }
    }
}

/// The target's surface from the confirmed depth of photos, nearest first.
#[pyfunction]
pub(crate) fn surface<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    near: f64,
    far: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let (views, target) = (View::all(views)?, camera("target", target)?);
    check_range(near, far)?;
    let found = compute(py, || {
        let views: Vec<_> = views.iter().map(View::of).collect();
        Ok(stages::surface(&views, &target, (near, far), true))
    })?;
    named(py, "Surface", (found.disparity.into_pyarray(py), found.disparity_per_pixel, found.holes))
}

/// `Surface.layers`.
#[pyfunction(name = "_surface_layers")]
pub(crate) fn surface_layers<'py>(
    py: Python<'py>,
    disparity: &Bound<'py, PyAny>,
    count: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (disparity, count) = (map2("disparity", disparity)?, layer_count(count)?);
    let maps = compute(py, || {
        let size = Size::new(disparity.ncols(), disparity.nrows());
        let surface = Surface { disparity, disparity_per_pixel: 1.0, holes: 0.0 };
        let layers = surface.layers(count).map_err(|error| value("count", error))?;
        Ok(maps_of(&layers, size))
    })?;
    Ok(maps.into_pyarray(py))
}

/// Gains [V, 3] that bring the photos to a common exposure; distances [V] from the target.
#[pyfunction]
pub(crate) fn exposure_gains<'py>(
    py: Python<'py>,
    views: &Bound<'py, PyAny>,
    distances: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let views = View::all(views)?;
    let distances = self::distances("distances", distances, &views.len().to_string())?.to_vec();
    let found = compute(py, || {
        let views: Vec<_> = views.iter().map(View::of).collect();
        Ok(stages::exposure_gains(&views, &distances))
    })?;
    Ok(ndarray::arr2(&found).into_pyarray(py))
}

/// How much to sharpen each photo, [V].
#[pyfunction]
pub(crate) fn sharpening<'py>(py: Python<'py>, views: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let views = View::all(views)?;
    let found = compute(py, || Ok(stages::sharpening(&views.iter().map(View::of).collect::<Vec<_>>())))?;
    Ok(found.into_pyarray(py))
}

/// 1 where a view sees the points of the target's pixels at `disparity` [h, w], 0 where its own
/// confirmed disparity [h, w] (-1: none) is nearer by `margin`, 1/scene unit.
#[pyfunction]
pub(crate) fn visible<'py>(
    py: Python<'py>,
    camera: &Bound<'py, PyAny>,
    confirmed: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    disparity: &Bound<'py, PyAny>,
    margin: f32,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let found = seen(py, [camera, confirmed, target, disparity], margin)?;
    Ok(found.mapv(|sees| if sees == 0.0 { 0.0 } else { 1.0 }).into_pyarray(py))
}

/// As visible, but -1 where the view sees past the point.
#[pyfunction]
pub(crate) fn visible_or_past<'py>(
    py: Python<'py>,
    camera: &Bound<'py, PyAny>,
    confirmed: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    disparity: &Bound<'py, PyAny>,
    margin: f32,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    Ok(seen(py, [camera, confirmed, target, disparity], margin)?.into_pyarray(py))
}

fn seen<'py>(
    py: Python<'py>,
    [of, confirmed, target, disparity]: [&Bound<'py, PyAny>; 4],
    margin: f32,
) -> PyResult<Array2<f32>> {
    let (view, target) = (camera("camera", of)?, camera("target", target)?);
    if !(margin.is_finite() && margin >= 0.0) {
        return Err(value("margin", format!("{margin}; expected a finite number of at least 0")));
    }
    let confirmed = ConfirmedDepth { disparity: map("confirmed", confirmed, &view)?, disparity_per_pixel: 1.0 };
    let disparity = map2("disparity", disparity)?;
    let (found, size) = (Size::new(disparity.ncols(), disparity.nrows()), target.size());
    if found != size && found != padded(size) {
        let expected = format!("the map is {found}; expected {size} as target, or its padded size {}", padded(size));
        return Err(value("disparity", expected));
    }
    compute(py, || Ok(stages::visible((&view, &confirmed), &target, &disparity, margin)))
}

/// The map [h, w] with its holes, pixels below 0, filled from their farthest neighbours.
#[pyfunction]
pub(crate) fn fill_holes<'py>(py: Python<'py>, map_: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let map = map2("map_", map_)?;
    Ok(compute(py, || Ok(stages::fill_holes(&map)))?.into_pyarray(py))
}

/// 3 x 3 median of a map [h, w], edges repeated.
#[pyfunction]
pub(crate) fn median3<'py>(py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let map = map2("x", x)?;
    Ok(compute(py, || Ok(stages::median3(&map)))?.into_pyarray(py))
}

/// A map `[h, w]` of finite numbers.
fn map2(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<Array2<f32>> {
    let found: PyReadonlyArray<'_, f32, Ix2> = Sides::default().array(name, argument, "h w")?;
    finite(name, found.as_array())?;
    Ok(found.as_array().to_owned())
}
