//! `liveview_ref.reference.warp`, `render/corrected_photos.py` and `network/view_agreement.py`.

use liveview::geometry::{PlaneSweep, Size};
use liveview::glam::{DMat3, DVec3};
use liveview::network::PlaneNetwork;
use liveview::warp::{Texture, WarpSource, warp_layers};
use liveview_surface::stages;
use liveview_synthesizer::ViewAgreement;
use ndarray::{Array3, Array4, Axis, Ix3, Ix4, Ix5};
use numpy::{IntoPyArray, PyArray3, PyArray4, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::photo::image;
use crate::arguments::Sides;
use crate::camera::camera;
use crate::error::{library, value};
use crate::work::compute;

/// Colour and coverage.
type Warped<'py> = (Bound<'py, PyArray4<f32>>, Bound<'py, PyArray3<f32>>);

/// Warps a photo [3, h, w] by maps of disparity [L, H, W] to colour [L, 3, H, W] and coverage [L,
/// H, W]. The photo is at 1/scale of its camera's size, a pixel of the maps is `scale` pixels of
/// the target wide.
#[pyfunction]
#[pyo3(signature = (image, source, target, maps, scale = 1.0))]
pub(crate) fn warp_maps<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    source: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    maps: &Bound<'py, PyAny>,
    scale: f64,
) -> PyResult<Warped<'py>> {
    let picture = self::image("image", image)?;
    let (source, target) = (camera("source", source)?, camera("target", target)?);
    let maps: PyReadonlyArray<'py, f32, Ix3> = Sides::default().array("maps", maps, "L H W")?;
    if !(scale.is_finite() && scale > 0.0) {
        return Err(value("scale", format!("{scale}; expected a positive number")));
    }
    let (shape, disparity) = (maps.as_array().dim(), maps.as_slice()?);
    let (layers, height, width) = shape;
    let (colour, coverage) = compute(py, || {
        let (texture, sweep) = (Texture::new(&picture), scaled(PlaneSweep::new(&source, &target), scale));
        let mut colour = Array4::zeros((layers, 3, height, width));
        let mut coverage = Array3::zeros(shape);
        let to = (colour.as_slice_mut().expect("new"), coverage.as_slice_mut().expect("new"));
        warp_layers(disparity, &[WarpSource::new(&texture, sweep)], Size::new(width, height), to.0, to.1);
        Ok((colour, coverage))
    })?;
    Ok((colour.into_pyarray(py), coverage.into_pyarray(py)))
}

/// The sweep between images whose pixels are `scale` pixels wide.
fn scaled(sweep: PlaneSweep, scale: f64) -> PlaneSweep {
    let down = DVec3::new(1.0 / scale, 1.0 / scale, 1.0);
    let up = DMat3::from_diagonal(DVec3::new(scale, scale, 1.0));
    PlaneSweep {
        homography_at_infinity: DMat3::from_diagonal(down) * sweep.homography_at_infinity * up,
        epipole: down * sweep.epipole,
    }
}

/// The photo [3, h, w] plus `amount` times its detail, in [0, 1].
#[pyfunction]
pub(crate) fn sharpened<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    amount: f32,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let picture = self::image("image", image)?;
    if !amount.is_finite() {
        return Err(value("amount", format!("{amount}; expected a finite number")));
    }
    let found = compute(py, || {
        let found = stages::sharpened(&Texture::new(&picture), amount);
        Ok(found.permuted_axes([2, 0, 1]).as_standard_layout().into_owned())
    })?;
    Ok(found.into_pyarray(py))
}

/// Logits [L, V, H, W] without a network, of warped colours [L, V, 3, H, W] and their coverage [L, V, H, W], 0
/// where a view does not see the layer.
#[pyfunction]
pub(crate) fn agreement_logits<'py>(
    py: Python<'py>,
    colour: &Bound<'py, PyAny>,
    coverage: &Bound<'py, PyAny>,
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
pub(crate) fn source_from_target(
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    disparity: f64,
) -> PyResult<[[f64; 3]; 3]> {
    let sweep = PlaneSweep::new(&camera("source", source)?, &camera("target", target)?);
    Ok(sweep.source_from_target(disparity).transpose().to_cols_array_2d())
}
