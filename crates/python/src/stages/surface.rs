//! `liveview_ref.reference.surface`: the depth of photos and what other photos confirm of it, the
//! surface at a target, occlusion, and the photos' correction.

use liveview::geometry::Size;
use liveview::layers::padded;
use liveview::warp::SourceView;
use liveview_surface::stages::{self, SurfaceView};
use liveview_surface::{ConfirmedDisparity, ConsistencyVotes, PhotoDisparity, Surface};
use ndarray::{Array2, Ix2};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray};
use pyo3::prelude::*;

use super::layers::{layer_count, maps_of};
use super::warp::{Photo, two};
use crate::arguments::{Map, Maps, Object, Sides, distances, expect, field, named, some, value, vector, whole};
use crate::camera::camera;
use crate::engine::compute;

/// A photo with its confirmed depth: the reference's `SurfaceView`.
pub(super) struct View {
    pub(super) photo: Photo,
    confirmed: ConfirmedDisparity,
    pub(super) gains: [f32; 3],
}

impl View {
    fn new(name: &str, argument: &Object<'_>) -> PyResult<Self> {
        let field = |field| self::field(name, argument, field, "image, camera, confirmed and gains");
        let of = |field: &str| format!("{name}.{field}");
        let photo = Photo::new((&of("image"), &field("image")?), (&of("camera"), &field("camera")?))?;
        let confirmed = depth_map(&of("confirmed"), &field("confirmed")?, &photo.camera)?;
        let gains = vector(&of("gains"), &field("gains")?, "3")?;
        if let Some(wrong) = gains.iter().find(|gain| !((**gain as f32).is_finite() && **gain > 0.0)) {
            return Err(value(&of("gains"), format!("a gain is {wrong}; expected positive numbers")));
        }
        let confirmed = ConfirmedDisparity { disparity: confirmed.0, disparity_per_pixel: confirmed.1 };
        Ok(Self { photo, confirmed, gains: std::array::from_fn(|channel| gains[channel] as f32) })
    }

    pub(super) fn all(argument: &Object<'_>) -> PyResult<Vec<Self>> {
        some("views", argument)?.iter().map(|(name, view)| Self::new(name, view)).collect()
    }

    pub(super) fn of_all(views: &[Self]) -> Vec<SurfaceView<'_>> {
        let all = views.iter().map(|Self { photo, confirmed, gains }| (photo.source(), confirmed, *gains));
        all.map(|(view, confirmed, gains)| SurfaceView { view, confirmed, gains }).collect()
    }
}

/// The target's surface from the confirmed depth of photos, nearest first.
#[pyfunction]
pub(crate) fn surface<'py>(views: &Object<'py>, target: &Object<'py>, near: f64, far: f64) -> PyResult<Object<'py>> {
    let py = views.py();
    let (views, target) = (View::all(views)?, camera("target", target)?);
    check_range(near, far)?;
    let found = compute(py, || Ok(stages::surface(&View::of_all(&views), &target, (near, far))))?;
    let (guessed, confidence) = (found.guessed_share(), found.confidence());
    let confidence = confidence.unwrap_or_else(|| Array2::ones(found.disparity.dim())).into_pyarray(py);
    named(py, "Surface", (found.disparity.into_pyarray(py), found.disparity_per_pixel, guessed, confidence))
}

/// `Surface.layers`.
#[pyfunction(name = "_surface_layers")]
pub(crate) fn surface_layers<'py>(
    py: Python<'py>,
    disparity: &Object<'py>,
    count: &Object<'py>,
) -> PyResult<Maps<'py>> {
    let (disparity, count) = (map("disparity", disparity, "h w")?, layer_count(count)?);
    let maps = compute(py, || {
        let size = Size::new(disparity.ncols(), disparity.nrows());
        let [guessed, doubted] = [(); 2].map(|()| Array2::default(disparity.dim()));
        let surface = Surface { disparity, disparity_per_pixel: 1.0, guessed, doubted };
        let layers = surface.layers(count).map_err(|error| value("count", error))?;
        Ok(maps_of(&layers, size))
    })?;
    Ok(maps.into_pyarray(py))
}

/// Gains [V, 3] that bring the photos to a common exposure; distances [V] from the target.
#[pyfunction]
pub(crate) fn exposure_gains<'py>(py: Python<'py>, views: &Object<'py>, distances: &Object<'py>) -> PyResult<Map<'py>> {
    let views = View::all(views)?;
    let distances = self::distances("distances", distances, &views.len().to_string())?.to_vec();
    let found = compute(py, || Ok(stages::exposure_gains(&View::of_all(&views), &distances)))?;
    Ok(ndarray::arr2(&found).into_pyarray(py))
}

/// How much to sharpen each photo, [V].
#[pyfunction]
pub(crate) fn sharpening<'py>(py: Python<'py>, views: &Object<'py>) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let views = View::all(views)?;
    let found = compute(py, || Ok(stages::sharpening(&View::of_all(&views))))?;
    Ok(found.into_pyarray(py))
}

/// 1 where a view sees the points of the target's pixels at `disparity` [h, w], 0 where its own
/// confirmed disparity [h, w] (-1: none) is nearer by `margin`, 1/scene unit.
#[pyfunction]
pub(crate) fn visible<'py>(
    py: Python<'py>,
    camera: &Object<'py>,
    confirmed: &Object<'py>,
    target: &Object<'py>,
    disparity: &Object<'py>,
    margin: f32,
) -> PyResult<Map<'py>> {
    let found = visible_or_past(py, camera, confirmed, target, disparity, margin)?;
    Ok(found.readonly().as_array().mapv(|sees| if sees == 0.0 { 0.0 } else { 1.0 }).into_pyarray(py))
}

/// As visible, but -1 where the view sees past the point.
#[pyfunction]
pub(crate) fn visible_or_past<'py>(
    py: Python<'py>,
    camera: &Object<'py>,
    confirmed: &Object<'py>,
    target: &Object<'py>,
    disparity: &Object<'py>,
    margin: f32,
) -> PyResult<Map<'py>> {
    let (view, target) = (self::camera("camera", camera)?, self::camera("target", target)?);
    expect("margin", margin, margin.is_finite() && margin >= 0.0, "a finite number of at least 0")?;
    let confirmed = map("confirmed", confirmed, &shape(&view))?;
    let confirmed = ConfirmedDisparity { disparity: confirmed, disparity_per_pixel: 1.0 };
    let disparity = map("disparity", disparity, "h w")?;
    let (found, size) = (Size::new(disparity.ncols(), disparity.nrows()), target.size());
    if found != size && found != padded(size) {
        let expected = format!("the map is {found}; expected {size} as target, or its padded size {}", padded(size));
        return Err(value("disparity", expected));
    }
    let found = compute(py, || Ok(stages::visible((&view, &confirmed), &target, &disparity, margin)))?;
    Ok(found.into_pyarray(py))
}

/// The map [h, w] with its holes, pixels below 0, filled from their farthest neighbours.
#[pyfunction]
pub(crate) fn fill_holes<'py>(py: Python<'py>, map_: &Object<'py>) -> PyResult<Map<'py>> {
    let map = map("map_", map_, "h w")?;
    Ok(compute(py, || Ok(stages::fill_holes(&map)))?.into_pyarray(py))
}

/// 3 x 3 median of a map [h, w], edges repeated.
#[pyfunction]
pub(crate) fn median3<'py>(py: Python<'py>, x: &Object<'py>) -> PyResult<Map<'py>> {
    let map = map("x", x, "h w")?;
    Ok(compute(py, || Ok(stages::median3(&map)))?.into_pyarray(py))
}

/// The depth of a photo, searched from near to far (scene units) among its neighbours; photos [3,
/// h, w] in [0, 1] with their cameras.
#[pyfunction]
pub(crate) fn photo_depth<'py>(
    py: Python<'py>,
    photo: &Object<'py>,
    neighbours: &Object<'py>,
    near: f64,
    far: f64,
) -> PyResult<Object<'py>> {
    searched(py, photo, neighbours, (near, far), liveview_surface::photo_depth)
}

/// As photo_depth, with what the neighbours find at a small size as anchors.
#[pyfunction]
pub(crate) fn anchored_depth<'py>(
    py: Python<'py>,
    photo: &Object<'py>,
    neighbours: &Object<'py>,
    near: f64,
    far: f64,
) -> PyResult<Object<'py>> {
    searched(py, photo, neighbours, (near, far), stages::anchored_depth)
}

/// A search of the library.
type Search = fn(&SourceView<'_>, &[SourceView<'_>], f64, f64) -> PhotoDisparity;

fn searched<'py>(
    py: Python<'py>,
    photo: &Object<'py>,
    neighbours: &Object<'py>,
    (near, far): (f64, f64),
    search: Search,
) -> PyResult<Object<'py>> {
    let (photo, neighbours) = (Photo::pair("photo", photo)?, Photo::pairs("neighbours", neighbours)?);
    check_range(near, far)?;
    let found = compute(py, || {
        let others: Vec<_> = neighbours.iter().map(Photo::source).collect();
        Ok(search(&photo.source(), &others, near, far))
    })?;
    named(py, "PhotoDisparity", (found.disparity.into_pyarray(py), found.disparity_per_pixel))
}

/// Refuses all but 0 < near < far.
pub(super) fn check_range(near: f64, far: f64) -> PyResult<()> {
    liveview::layers::uniform_disparities(near, far, 2).map(|_| ()).map_err(|error| value("near, far", error))
}

/// The pixels [h, w] bool of map `which` that the other maps confirm.
#[pyfunction]
pub(crate) fn confirmed<'py>(py: Python<'py>, which: &Object<'py>, maps: &Object<'py>) -> PyResult<Map<'py, bool>> {
    let maps = some("maps", maps)?;
    let camera_and_depth = |(name, pair): &(String, Object<'py>)| -> PyResult<_> {
        let (of, depth) = two(name, pair, "camera and PhotoDisparity")?;
        let camera = camera(&format!("{name}[0]"), &of)?;
        let (disparity, disparity_per_pixel) = depth_map(&format!("{name}[1]"), &depth, &camera)?;
        Ok((camera, PhotoDisparity { disparity, disparity_per_pixel }))
    };
    let maps = maps.iter().map(camera_and_depth).collect::<PyResult<Vec<_>>>()?;
    let which = whole("which", which)?;
    let Some((camera, depth)) = maps.get(which) else {
        return Err(value("which", format!("{which}; expected an index of {} maps", maps.len())));
    };
    let found = compute(py, || {
        let others = maps.iter().enumerate().filter(|(other, _)| *other != which);
        let votes: Vec<_> =
            others.map(|(_, (other, found))| ConsistencyVotes::new((camera, depth), (other, found))).collect();
        Ok(stages::confirmed(&votes.iter().collect::<Vec<_>>(), depth.disparity.dim()))
    })?;
    Ok(found.into_pyarray(py))
}

/// The fields of a `PhotoDisparity` or `ConfirmedDisparity` of a camera.
pub(super) fn depth_map(name: &str, depth: &Object<'_>, camera: &liveview::Camera) -> PyResult<(Array2<f32>, f32)> {
    let field = |field| self::field(name, depth, field, "a PhotoDisparity");
    let disparity = map(&format!("{name}.disparity"), &field("disparity")?, &shape(camera))?;
    let of = format!("{name}.pixel");
    let pixel: f32 = field("pixel")?.extract().map_err(|_| value(&of, "expected a number"))?;
    expect(&of, pixel, pixel.is_finite() && pixel > 0.0, "a positive number")?;
    Ok((disparity, pixel))
}

/// The shape of a camera's picture, as [`Sides::array`] takes it.
fn shape(camera: &liveview::Camera) -> String {
    format!("{} {}", camera.height(), camera.width())
}

/// A map of finite numbers, `shape` as [`Sides::array`] takes it.
fn map(name: &str, argument: &Object<'_>, shape: &str) -> PyResult<Array2<f32>> {
    let found: PyReadonlyArray<'_, f32, Ix2> = Sides::default().array(name, argument, shape)?;
    match found.as_array().iter().find(|value| !value.is_finite()) {
        Some(wrong) => Err(value(name, format!("a value is {wrong}; expected finite numbers"))),
        None => Ok(found.as_array().to_owned()),
    }
}
