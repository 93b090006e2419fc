//! Photos `[3, h, w]` as arguments; warp, choice of views, corrected photos, agreement of views, scores.

use liveview::geometry::{PlaneSweep, Size};
use liveview::network::PlaneNetwork;
use liveview::warp::{SourceView, Texture, WarpSource, warp_layers};
use liveview::{ImageRgb, geometry};
use liveview_synthesizer::ViewAgreement;
use ndarray::{Array3, Array4, ArrayView3, Axis, Ix3, Ix4, Ix5};
use numpy::{IntoPyArray, PyArray1, PyArray4, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arguments::{Maps, Object, Sides, expect, items, kind, library, some, value, whole};
use crate::camera::{camera, cameras};
use crate::engine::compute;
use crate::scene::in_range;

/// Colour and coverage.
type Warped<'py> = (Bound<'py, PyArray4<f32>>, Maps<'py>);

/// Warps a photo [3, h, w] by maps of disparity [L, H, W] to colour [L, 3, H, W] and coverage [L,
/// H, W]. The photo is at 1/scale of its camera's size, a pixel of the maps is `scale` pixels of
/// the target wide.
#[pyfunction]
#[pyo3(signature = (image, source, target, maps, scale = 1.0))]
pub(crate) fn warp_maps<'py>(
    py: Python<'py>,
    image: &Object<'py>,
    source: &Object<'py>,
    target: &Object<'py>,
    maps: &Object<'py>,
    scale: f64,
) -> PyResult<Warped<'py>> {
    let picture = self::image("image", image)?;
    let (source, target) = (camera("source", source)?, camera("target", target)?);
    let maps: PyReadonlyArray<'py, f32, Ix3> = Sides::default().array("maps", maps, "L H W")?;
    expect("scale", scale, scale.is_finite() && scale > 0.0, "a positive number")?;
    let (shape, disparity) = (maps.as_array().dim(), maps.as_slice()?);
    let (layers, height, width) = shape;
    let (colour, coverage) = compute(py, || {
        let (texture, sweep) = (Texture::new(&picture), PlaneSweep::new(&source, &target).shrunk(scale));
        let mut colour = Array4::zeros((layers, 3, height, width));
        let mut coverage = Array3::zeros(shape);
        let to = (colour.as_slice_mut().expect("new"), coverage.as_slice_mut().expect("new"));
        warp_layers(disparity, &[WarpSource::new(&texture, sweep)], Size::new(width, height), to.0, to.1);
        Ok((colour, coverage))
    })?;
    Ok((colour.into_pyarray(py), coverage.into_pyarray(py)))
}

/// The photo [3, h, w] plus `amount` times its detail, in [0, 1].
#[pyfunction]
pub(crate) fn sharpened<'py>(py: Python<'py>, image: &Object<'py>, amount: f32) -> PyResult<Maps<'py>> {
    let picture = self::image("image", image)?;
    expect("amount", amount, amount.is_finite(), "a finite number")?;
    let found = compute(py, || {
        let mut found = Texture::default();
        Texture::new(&picture).sharpen(amount, &mut found);
        Ok(Array3::from_shape_fn((3, found.height(), found.width()), |(c, y, x)| found.pixel(x, y)[c]))
    })?;
    Ok(found.into_pyarray(py))
}

/// Logits [L, V, H, W] without a network, of warped colours [L, V, 3, H, W] and their coverage [L, V, H, W], 0
/// where a view does not see the layer.
#[pyfunction]
pub(crate) fn agreement_logits<'py>(
    py: Python<'py>,
    colour: &Object<'py>,
    coverage: &Object<'py>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let mut sides = Sides::default();
    let colour: PyReadonlyArray<'py, f32, Ix5> = sides.array("colour", colour, "L V 3 H W")?;
    let coverage: PyReadonlyArray<'py, f32, Ix4> = sides.array("coverage", coverage, "L V H W")?;
    let coverage = coverage.as_array();
    let &[layers, views, _, height, width] = colour.shape() else { unreachable!("five sides") };
    let colour = colour.as_array();
    let logits = compute(py, || {
        let hwv = colour.into_shape_with_order((layers, 3 * views, height, width)).expect("standard order");
        let mut logits = Array4::zeros((layers, views, height, width));
        let layers = hwv.axis_chunks_iter(Axis(0), 1).zip(coverage.axis_chunks_iter(Axis(0), 1));
        for ((hwv, coverage), logits) in layers.zip(logits.axis_chunks_iter_mut(Axis(0), 1)) {
            ViewAgreement { views }.infer(hwv, coverage, logits).map_err(library)?;
        }
        Ok(logits)
    })?;
    Ok(logits.into_pyarray(py))
}

/// `PlaneSweep.source_from_target`.
#[pyfunction]
pub(crate) fn source_from_target(source: &Object<'_>, target: &Object<'_>, disparity: f64) -> PyResult<[[f64; 3]; 3]> {
    let sweep = PlaneSweep::new(&camera("source", source)?, &camera("target", target)?);
    Ok(sweep.source_from_target(disparity).transpose().to_cols_array_2d())
}

/// A photo `[3, h, w]` of f32 with any values.
pub(super) fn image(name: &str, argument: &Object<'_>) -> PyResult<ImageRgb> {
    let array: PyReadonlyArray<'_, f32, Ix3> = Sides::default().array(name, argument, "3 h w")?;
    ImageRgb::from_array(interleaved(array.as_array())).map_err(|error| value(name, error))
}

/// `[h, w, 3]` of `[3, h, w]`.
fn interleaved(planes: ArrayView3<'_, f32>) -> ArrayView3<'_, f32> {
    planes.permuted_axes([1, 2, 0])
}

/// A photo and its camera.
pub(super) struct Photo {
    pub(super) texture: Texture,
    pub(super) camera: liveview::Camera,
}

impl Photo {
    /// A photo `[3, h, w]` of values in [0, 1], of its camera's size.
    pub(super) fn new(
        (image_name, argument): (&str, &Object<'_>),
        (camera_name, of): (&str, &Object<'_>),
    ) -> PyResult<Self> {
        let (picture, camera) = (image(image_name, argument)?, camera(camera_name, of)?);
        in_range(image_name, picture.as_array())?;
        if picture.size() != camera.size() {
            let what = format!("the photo is {}; expected {} as {camera_name}", picture.size(), camera.size());
            return Err(value(image_name, what));
        }
        Ok(Self { texture: Texture::new(&picture), camera })
    }

    /// A photo as the reference's `View`: the pair of photo and camera.
    pub(super) fn pair(name: &str, argument: &Object<'_>) -> PyResult<Self> {
        let (image, camera) = two(name, argument, "photo and camera")?;
        Self::new((&format!("{name}[0]"), &image), (&format!("{name}[1]"), &camera))
    }

    /// As [`Photo::pair`], of a list with one at least.
    pub(super) fn pairs(name: &str, argument: &Object<'_>) -> PyResult<Vec<Self>> {
        some(name, argument)?.iter().map(|(name, pair)| Self::pair(name, pair)).collect()
    }

    pub(super) fn source(&self) -> SourceView<'_> {
        SourceView { camera: &self.camera, texture: &self.texture }
    }
}

/// The two items of a pair.
pub(super) fn two<'py>(name: &str, argument: &Object<'py>, what: &str) -> PyResult<(Object<'py>, Object<'py>)> {
    argument.extract().map_err(|_| kind(name, format!("expected a pair of {what}")))
}

/// Photos and their cameras from two lists of the same length.
pub(super) fn photos(images: (&str, &Object<'_>), cameras: (&str, &Object<'_>)) -> PyResult<Vec<Photo>> {
    let (found, of) = (some(images.0, images.1)?, items(cameras.0, cameras.1)?);
    if found.len() != of.len() {
        return Err(value(cameras.0, format!("{} of them; expected {} as in {}", of.len(), found.len(), images.0)));
    }
    let pairs = found.iter().zip(&of);
    pairs.map(|((name, image), (camera, at))| Photo::new((name, image), (camera, at))).collect()
}

/// Indices of the `count` cameras to render the target from, nearest first: those that show it, from all
/// sides; of those in `kept` (indices) the cost is a tenth lower.
#[pyfunction]
#[pyo3(signature = (cameras, target, count, kept = Vec::new()), text_signature = "(cameras, target, count, kept=())")]
pub(crate) fn choose_views(
    cameras: &Object<'_>,
    target: &Object<'_>,
    count: &Object<'_>,
    kept: Vec<usize>,
) -> PyResult<Vec<usize>> {
    let (found, target) = (self::cameras("cameras", cameras)?, camera("target", target)?);
    let found: Vec<_> = found.iter().collect();
    geometry::choose_views(&found, &target, whole("count", count)?, &kept).map_err(|error| value("cameras", error))
}

/// Distances of the cameras' centres to the target's, [V] float64, scene units.
#[pyfunction]
pub(crate) fn view_distances<'py>(cameras: &Object<'py>, target: &Object<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let py = cameras.py();
    let (found, target) = (self::cameras("cameras", cameras)?, camera("target", target)?);
    let found: Vec<f64> = found.iter().map(|camera| geometry::distance(camera, &target)).collect();
    Ok(found.into_pyarray(py))
}

/// Peak signal-to-noise ratio of pictures [3, h, w], dB; infinite for equal ones.
#[pyfunction]
pub(crate) fn psnr(py: Python<'_>, image: &Object<'_>, truth: &Object<'_>) -> PyResult<f64> {
    let (found, truth) = pair(image, truth)?;
    compute(py, || Ok(liveview_synthesizer::psnr(&found, &truth, 0)))
}

/// Structural similarity of pictures [3, h, w] of at least 11 x 11 pixels.
#[pyfunction]
pub(crate) fn ssim(py: Python<'_>, image: &Object<'_>, truth: &Object<'_>) -> PyResult<f64> {
    let (found, truth) = pair(image, truth)?;
    let what = format!("the picture is {}", found.size());
    expect("image", what, found.width().min(found.height()) >= 11, "at least 11x11")?;
    compute(py, || Ok(liveview_synthesizer::ssim(&found, &truth, 0)))
}

/// Two pictures of one size.
fn pair(found: &Object<'_>, truth: &Object<'_>) -> PyResult<(ImageRgb, ImageRgb)> {
    let (found, truth) = (image("image", found)?, image("truth", truth)?);
    let differ = || value("truth", format!("the picture is {}; expected {} as image", truth.size(), found.size()));
    if found.size() == truth.size() { Ok((found, truth)) } else { Err(differ()) }
}
