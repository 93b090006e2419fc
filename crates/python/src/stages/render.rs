//! `liveview_ref.reference.composite`, `render/blend.py` and `render/composite_competing.py`.

use liveview::render::{Accumulated, Blended, Competing, DistanceWeights, LayerSamples};
use ndarray::{Array2, Array3, Array4, ArrayView3, ArrayView4, Ix2, Ix3, Ix4, Ix5, s};
use numpy::{IntoPyArray, PyArray3, PyArray4, PyReadonlyArray};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arguments::{Sides, as_array, distances};
use crate::error::value;
use crate::tuples::named;
use crate::work::compute;

/// Opacity and colour.
type AlphaRgb<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray4<f32>>);

/// Opacity [N, H, W] and colour [N, 3, H, W] of layers, of logits [N, V, H, W], colour [N, V, 3, H,
/// W], coverage [N, V, H, W] and the views' distances [V] or [N, V], scene units.
#[pyfunction]
#[pyo3(signature = (logits, colour, coverage, distances, power = 1.0))]
pub(crate) fn blend<'py>(
    py: Python<'py>,
    logits: &Bound<'py, PyAny>,
    colour: &Bound<'py, PyAny>,
    coverage: &Bound<'py, PyAny>,
    distances: &Bound<'py, PyAny>,
    power: f64,
) -> PyResult<AlphaRgb<'py>> {
    let mut sides = Sides::default();
    let logits: PyReadonlyArray<'py, f32, Ix4> = sides.array("logits", logits, "N V H W")?;
    let colour: PyReadonlyArray<'py, f32, Ix5> = sides.array("colour", colour, "N V 3 H W")?;
    let coverage: PyReadonlyArray<'py, f32, Ix4> = sides.array("coverage", coverage, "N V H W")?;
    let (n, views, height, width) = logits.as_array().dim();
    let weights = weights(&mut sides, distances, power)?;
    let (logits, colour, coverage) = (logits.as_slice()?, colour.as_slice()?, coverage.as_slice()?);
    let (alpha, rgb) = compute(py, || {
        let pixels = height * width;
        let (mut alpha, mut rgb) = (Array3::zeros((n, height, width)), Array4::zeros((n, 3, height, width)));
        let to = alpha.as_slice_mut().expect("new").par_chunks_mut(pixels);
        let to = to.zip(rgb.as_slice_mut().expect("new").par_chunks_mut(3 * pixels));
        let from = logits.par_chunks(views * pixels).zip(coverage.par_chunks(views * pixels));
        let from = from.zip(colour.par_chunks(3 * views * pixels));
        to.zip(from).enumerate().for_each(|(layer, ((alpha, rgb), ((logits, coverage), colour)))| {
            let mut blended = Blended::new(pixels);
            let samples = LayerSamples { logits, colour, coverage, logit_shift: 0.0 };
            weights[layer % weights.len()].blend(&samples, 0, &mut blended);
            alpha.copy_from_slice(&blended.alpha);
            for (to, channel) in rgb.chunks_mut(pixels).zip(&blended.rgb) {
                to.copy_from_slice(channel);
            }
        });
        Ok((alpha, rgb))
    })?;
    Ok((alpha.into_pyarray(py), rgb.into_pyarray(py)))
}

/// Factors of distances `[V]` for all layers, or `[N, V]` of each.
fn weights(sides: &mut Sides, argument: &Bound<'_, PyAny>, power: f64) -> PyResult<Vec<DistanceWeights>> {
    if !power.is_finite() {
        return Err(value("power", format!("{power}; expected a finite number")));
    }
    let array = as_array("distances", argument)?;
    let views = sides.length('V');
    let rows = if numpy::PyUntypedArrayMethods::ndim(&array) == 2 {
        sides.check("distances", numpy::PyUntypedArrayMethods::shape(&array), "N V")?;
        array.try_iter()?.collect::<PyResult<Vec<_>>>()?
    } else {
        vec![array.into_any()]
    };
    let row = |row: &Bound<'_, PyAny>| {
        let found = distances("distances", row, &views.to_string())?;
        Ok(DistanceWeights::with_power(&found.to_vec(), power))
    };
    rows.iter().map(row).collect()
}

/// Front-to-back composite of alpha [L, H, W], rgb [L, 3, H, W] and maps of disparity [L, H, W],
/// near to far; covered [H, W] bool: where any view covers the farthest layer, which is opaque
/// there.
#[pyfunction]
pub(crate) fn composite<'py>(
    py: Python<'py>,
    alpha: &Bound<'py, PyAny>,
    rgb: &Bound<'py, PyAny>,
    covered: &Bound<'py, PyAny>,
    maps: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut sides = Sides::default();
    let alpha: PyReadonlyArray<'_, f32, Ix3> = sides.array("alpha", alpha, "L H W")?;
    let rgb: PyReadonlyArray<'_, f32, Ix4> = sides.array("rgb", rgb, "L 3 H W")?;
    let covered: PyReadonlyArray<'_, bool, Ix2> = sides.array("covered", covered, "H W")?;
    let maps: PyReadonlyArray<'_, f32, Ix3> = sides.array("maps", maps, "L H W")?;
    let (alpha, rgb, covered, maps) = (alpha.as_array(), rgb.as_array(), covered.as_array(), maps.as_array());
    let (layers, height, width) = alpha.dim();
    let composited = compute(py, || {
        let row = |y: usize| {
            let (mut row, mut weights) = (Accumulated::new(width), Array2::zeros((layers, width)));
            for (k, mut weights) in weights.outer_iter_mut().enumerate() {
                let layer = layer(alpha, rgb, k, y, covered.row(y).to_vec());
                let (disparity, before) = (maps.slice(s![k, y, ..]), row.transmittance.clone());
                row.add(k as u32, &layer, disparity.to_slice().expect("standard order"), k + 1 == layers);
                let left = before.iter().zip(&row.transmittance);
                weights.iter_mut().zip(left).for_each(|(weight, (before, after))| *weight = (before - after) as f32);
            }
            (row, weights)
        };
        Ok((0..height).into_par_iter().map(row).collect::<Vec<_>>())
    })?;
    composited_rows(py, &composited, (layers, width))
}

/// Composite of competing layers: the softmax of `scale` times logit [L, H, W] over the layers that
/// cover a pixel, covered [L, H, W] bool; rgb [L, 3, H, W], maps of disparity [L, H, W].
#[pyfunction]
#[pyo3(signature = (logit, rgb, covered, maps, scale = 1.0))]
pub(crate) fn composite_competing<'py>(
    py: Python<'py>,
    logit: &Bound<'py, PyAny>,
    rgb: &Bound<'py, PyAny>,
    covered: &Bound<'py, PyAny>,
    maps: &Bound<'py, PyAny>,
    scale: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let mut sides = Sides::default();
    let logit: PyReadonlyArray<'_, f32, Ix3> = sides.array("logit", logit, "L H W")?;
    let rgb: PyReadonlyArray<'_, f32, Ix4> = sides.array("rgb", rgb, "L 3 H W")?;
    let covered: PyReadonlyArray<'_, bool, Ix3> = sides.array("covered", covered, "L H W")?;
    let maps: PyReadonlyArray<'_, f32, Ix3> = sides.array("maps", maps, "L H W")?;
    if !(scale.is_finite() && scale > 0.0) {
        return Err(value("scale", format!("{scale}; expected a positive number")));
    }
    let (logit, rgb, covered, maps) = (logit.as_array(), rgb.as_array(), covered.as_array(), maps.as_array());
    let (layers, height, width) = logit.dim();
    let composited = compute(py, || {
        let row = |y: usize| {
            let of_row = |k| layer(logit, rgb, k, y, covered.slice(s![k, y, ..]).to_vec());
            let all: Vec<_> = (0..layers).map(of_row).collect();
            let mut row = Competing::new(width, scale);
            for (k, layer) in all.iter().enumerate() {
                let disparity = maps.slice(s![k, y, ..]);
                row.add(k as u32, &layer.alpha, layer, disparity.to_slice().expect("standard order"));
            }
            let weights = all.iter().flat_map(|layer| row.weights(&layer.alpha, &layer.covered));
            let weights = Array2::from_shape_vec((layers, width), weights.map(|weight| weight as f32).collect());
            (row.finish(), weights.expect("one per layer and pixel"))
        };
        Ok((0..height).into_par_iter().map(row).collect::<Vec<_>>())
    })?;
    composited_rows(py, &composited, (layers, width))
}

/// Row `y` of layer `k`.
fn layer(alpha: ArrayView3<'_, f32>, rgb: ArrayView4<'_, f32>, k: usize, y: usize, covered: Vec<bool>) -> Blended {
    Blended {
        alpha: alpha.slice(s![k, y, ..]).to_vec(),
        rgb: std::array::from_fn(|channel| rgb.slice(s![k, channel, y, ..]).to_vec()),
        covered,
    }
}

/// The arrays of a composite's rows and their weights.
fn composited_rows<'py>(
    py: Python<'py>,
    rows: &[(Accumulated, Array2<f32>)],
    (layers, width): (usize, usize),
) -> PyResult<Bound<'py, PyAny>> {
    let shape = (rows.len(), width);
    let rgb = Array3::from_shape_fn((3, shape.0, width), |(channel, y, x)| rows[y].0.rgb[channel][x] as f32);
    let map = |of: fn(&Accumulated) -> &[f64]| Array2::from_shape_fn(shape, |(y, x)| of(&rows[y].0)[x] as f32);
    let [disparity, transmittance] =
        [map(|row| &row.disparity), map(|row| &row.transmittance)].map(|map| map.into_pyarray(py));
    let weights = Array3::from_shape_fn((layers, shape.0, width), |(k, y, x)| rows[y].1[[k, x]]);
    named(py, "Composited", (rgb.into_pyarray(py), disparity, transmittance, weights.into_pyarray(py)))
}
