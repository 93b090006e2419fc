//! `liveview_ref.reference.layers`: planes, their selection, and the guided search.

use liveview::geometry::Size;
use liveview::layers::{self, Layers, padded};
use liveview::render::{Accumulated, Blended};
use liveview_surface::guided::{GuidedSearch, RangeMap};
use liveview_synthesizer::MAX_LAYERS;
use ndarray::{Array3, Ix3};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray};
use pyo3::prelude::*;

use super::warp::{Photo, photos};
use crate::arguments::{Maps, Object, Sides, expect, named, value, vector, whole};
use crate::camera::camera;
use crate::engine::compute;

/// [count] float64 disparities evenly spaced from 1/near to 1/far; far may be infinite.
#[pyfunction]
pub(crate) fn uniform_disparities<'py>(
    py: Python<'py>,
    near: f64,
    far: f64,
    count: &Object<'py>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let count = whole("count", count)?;
    expect("count", count, count <= MAX_LAYERS, &format!("at most {MAX_LAYERS}"))?;
    let found = layers::uniform_disparities(near, far, count);
    Ok(found.map_err(|error| value(if count == 0 { "count" } else { "near, far" }, error))?.into_pyarray(py))
}

/// Number of pixels of which each plane is the most opaque, [D] int64, of alpha [D, H, W].
#[pyfunction]
pub(crate) fn plane_histogram<'py>(py: Python<'py>, alpha: &Object<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let alpha: PyReadonlyArray<'py, f32, Ix3> = Sides::default().array("alpha", alpha, "D H W")?;
    let alpha = alpha.as_array();
    let found = compute(py, || {
        let (planes, height, width) = alpha.dim();
        let best = (0..height).flat_map(|y| {
            let mut row = Accumulated::new(width);
            for (k, alpha) in alpha.outer_iter().enumerate() {
                let layer = Blended { alpha: alpha.row(y).to_vec(), ..Blended::new(width) };
                row.add(k as u32, &layer, &vec![0.0; width], false);
            }
            row.best_layer
        });
        Ok(layers::plane_histogram(best.map(|best| (best != u32::MAX).then_some(best as usize)), planes))
    })?;
    let counts: Vec<i64> = found.into_iter().map(|count| count as i64).collect();
    Ok(counts.into_pyarray(py))
}

/// Indices of the `count` fullest bins, near to far.
#[pyfunction]
pub(crate) fn select_planes(histogram: &Object<'_>, count: &Object<'_>) -> PyResult<Vec<usize>> {
    Ok(layers::select_planes(&counts(histogram)?, whole("count", count)?))
}

/// Indices, near to far, of the `count` planes that lie nearest to the best planes of all pixels.
#[pyfunction]
pub(crate) fn cover_planes(py: Python<'_>, histogram: &Object<'_>, count: &Object<'_>) -> PyResult<Vec<usize>> {
    let (histogram, count) = (counts(histogram)?, whole("count", count)?);
    compute(py, || Ok(liveview_synthesizer::cover_planes(&histogram, count)))
}

/// Numbers of pixels, of at most as many planes as a picture has.
fn counts(histogram: &Object<'_>) -> PyResult<Vec<u64>> {
    const MOST: f64 = (1_u64 << 40) as f64;
    let found = vector("histogram", histogram, "D")?;
    let planes = format!("{} planes", found.len());
    expect("histogram", planes, found.len() <= MAX_LAYERS, &format!("at most {MAX_LAYERS}"))?;
    let wrong = |count: &&f64| !((0.0..=MOST).contains(*count) && count.fract() == 0.0);
    match found.iter().find(wrong) {
        Some(count) => Err(value("histogram", format!("a count is {count}; expected whole numbers of at least 0"))),
        None => Ok(found.iter().map(|&count| count as u64).collect()),
    }
}

/// The range of disparities of each cell of 2 x 2 pixels of the padded target, found by a search
/// among photos [3, h, w] with `planes` planes, or as many as the parallax asks for.
#[pyfunction]
#[pyo3(signature = (views, cameras, target, near, far, planes = None))]
pub(crate) fn guided_search<'py>(
    py: Python<'py>,
    views: &Object<'py>,
    cameras: &Object<'py>,
    target: &Object<'py>,
    near: f64,
    far: f64,
    planes: Option<&Object<'py>>,
) -> PyResult<Object<'py>> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let planes = coarse_planes(planes)?;
    let found = compute(py, || searched(&photos, &target, (near, far), planes))?;
    let [nearest, surface, farthest] = [&found.nearest, &found.surface, &found.farthest];
    let array = |map: &ndarray::Array2<f32>| map.clone().into_pyarray(py);
    named(py, "RangeMap", (array(nearest), array(surface), array(farthest)))
}

/// `count` guided layers as maps of disparity [count, H, W] over the padded target.
#[pyfunction]
#[pyo3(signature = (views, cameras, target, near, far, count, planes = None))]
pub(crate) fn guided_layers<'py>(
    py: Python<'py>,
    views: &Object<'py>,
    cameras: &Object<'py>,
    target: &Object<'py>,
    near: f64,
    far: f64,
    count: &Object<'py>,
    planes: Option<&Object<'py>>,
) -> PyResult<Maps<'py>> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let (count, planes) = (layer_count(count)?, coarse_planes(planes)?);
    let maps = compute(py, || {
        let range = searched(&photos, &target, (near, far), planes)?;
        let layers = range.layers(count).map_err(|error| value("count", error))?;
        Ok(maps_of(&layers, padded(target.size())))
    })?;
    Ok(maps.into_pyarray(py))
}

/// Maps of disparity of layers, [L, h, w].
pub(super) fn maps_of(layers: &Layers, Size { width, height }: Size) -> Array3<f32> {
    let mut maps = Array3::zeros((layers.len(), height, width));
    for (layer, mut map) in layers.as_slice().iter().zip(maps.outer_iter_mut()) {
        layer.fill(width, map.as_slice_mut().expect("new"));
    }
    maps
}

/// A number of layers.
pub(super) fn layer_count(count: &Object<'_>) -> PyResult<usize> {
    let count = whole("count", count)?;
    expect("count", count, (1..=MAX_LAYERS).contains(&count), &format!("1 to {MAX_LAYERS}"))?;
    Ok(count)
}

fn coarse_planes(planes: Option<&Object<'_>>) -> PyResult<Option<usize>> {
    let planes = planes.map(|planes| whole("planes", planes)).transpose()?;
    let right = |&planes: &usize| (2..=MAX_LAYERS).contains(&planes);
    planes.iter().try_for_each(|given| expect("planes", given, right(given), &format!("2 to {MAX_LAYERS}")))?;
    Ok(planes)
}

/// The guided search of a target among photos.
fn searched(
    photos: &[Photo],
    target: &liveview::Camera,
    (near, far): (f64, f64),
    planes: Option<usize>,
) -> PyResult<RangeMap> {
    let views: Vec<_> = photos.iter().map(Photo::source).collect();
    let stages = GuidedSearch { near, far, planes }.search(&views, target);
    Ok(stages.map_err(|error| value("near, far", error))?.range)
}
