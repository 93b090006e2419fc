//! A network without a scene; blend and composites.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use liveview::layers::STRIDE;
use liveview::network::{OrtNetwork, PlaneNetwork};
use liveview::render::{Accumulated, Blended, Competing, DistanceWeights, LayerSamples};
use liveview_synthesizer::Model;
use ndarray::{Array2, Array3, Array4, ArrayView3, ArrayView4, Ix2, Ix3, Ix4, Ix5, s};
use numpy::{IntoPyArray, PyArray4, PyReadonlyArray};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arguments::{Maps, Object, Sides, as_array, distances, expect, library, named, value, whole};
use crate::engine::compute;
use crate::synthesizer::model_options;

/// Opacity and colour.
type AlphaRgb<'py> = (Maps<'py>, Bound<'py, PyArray4<f32>>);

/// Opacity [N, H, W] and colour [N, 3, H, W] of layers, of logits [N, V, H, W], colour [N, V, 3, H,
/// W], coverage [N, V, H, W] and the views' distances [V] or [N, V], scene units.
#[pyfunction]
#[pyo3(signature = (logits, colour, coverage, distances, power = 1.0))]
pub(crate) fn blend<'py>(
    py: Python<'py>,
    logits: &Object<'py>,
    colour: &Object<'py>,
    coverage: &Object<'py>,
    distances: &Object<'py>,
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
            let samples = LayerSamples { logits, colour, coverage };
            samples.blend(&weights[layer % weights.len()], 0, &mut blended);
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
fn weights(sides: &mut Sides, argument: &Object<'_>, power: f64) -> PyResult<Vec<DistanceWeights>> {
    expect("power", power, power.is_finite(), "a finite number")?;
    let array = as_array("distances", argument)?;
    let views = sides.length('V');
    let rows = if numpy::PyUntypedArrayMethods::ndim(&array) == 2 {
        sides.check("distances", numpy::PyUntypedArrayMethods::shape(&array), "N V")?;
        array.try_iter()?.collect::<PyResult<Vec<_>>>()?
    } else {
        vec![array.into_any()]
    };
    let row = |row: &Object<'_>| {
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
    alpha: &Object<'py>,
    rgb: &Object<'py>,
    covered: &Object<'py>,
    maps: &Object<'py>,
) -> PyResult<Object<'py>> {
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
    logit: &Object<'py>,
    rgb: &Object<'py>,
    covered: &Object<'py>,
    maps: &Object<'py>,
    scale: f64,
) -> PyResult<Object<'py>> {
    let mut sides = Sides::default();
    let logit: PyReadonlyArray<'_, f32, Ix3> = sides.array("logit", logit, "L H W")?;
    let rgb: PyReadonlyArray<'_, f32, Ix4> = sides.array("rgb", rgb, "L 3 H W")?;
    let covered: PyReadonlyArray<'_, bool, Ix3> = sides.array("covered", covered, "L H W")?;
    let maps: PyReadonlyArray<'_, f32, Ix3> = sides.array("maps", maps, "L H W")?;
    expect("scale", scale, scale.is_finite() && scale > 0.0, "a positive number")?;
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
) -> PyResult<Object<'py>> {
    let shape = (rows.len(), width);
    let rgb = Array3::from_shape_fn((3, shape.0, width), |(channel, y, x)| rows[y].0.rgb[channel][x] as f32);
    let map = |of: fn(&Accumulated) -> &[f64]| Array2::from_shape_fn(shape, |(y, x)| of(&rows[y].0)[x] as f32);
    let [disparity, transmittance] =
        [map(|row| &row.disparity), map(|row| &row.transmittance)].map(|map| map.into_pyarray(py));
    let weights = Array3::from_shape_fn((layers, shape.0, width), |(k, y, x)| rows[y].1[[k, x]]);
    named(py, "Composited", (rgb.into_pyarray(py), disparity, transmittance, weights.into_pyarray(py)))
}

/// The network of a model file (.onnx): called with warped photos hwv [n, 3V, h, w] in [0, 1], it
/// returns logits [n, V, h, w]; h and w are multiples of 8. `threads`: one per core by default.
/// ONNX Runtime as for `Synthesizer`. A run is not ended by Ctrl-C.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Network {
    network: Mutex<OrtNetwork>,
    /// V, photos to a picture.
    #[pyo3(get)]
    views: usize,
}

#[pymethods]
impl Network {
    #[new]
    #[pyo3(signature = (path, *, threads = None))]
    fn new(py: Python<'_>, path: PathBuf, threads: Option<&Object<'_>>) -> PyResult<Self> {
        let mut options = model_options(py, None, Some(path))?;
        options.threads = threads.map(|threads| whole("threads", threads)).transpose()?;
        let (_, network) = compute(py, || Model::open(&options, None).map_err(library))?;
        let views = network.views();
        Ok(Self { network: Mutex::new(network), views })
    }

    fn __call__<'py>(&self, py: Python<'py>, hwv: &Object<'py>) -> PyResult<Bound<'py, PyArray4<f32>>> {
        let shape = format!("n {} h w", 3 * self.views);
        let hwv: PyReadonlyArray<'py, f32, Ix4> = Sides::default().array("hwv", hwv, &shape)?;
        let hwv = hwv.as_array();
        let (_, _, height, width) = hwv.dim();
        if height % STRIDE != 0 || width % STRIDE != 0 {
            return Err(value("hwv", format!("{height} rows, {width} columns; expected multiples of {STRIDE}")));
        }
        let logits = compute(py, || logits(&mut self.network.lock().unwrap_or_else(PoisonError::into_inner), hwv))?;
        Ok(logits.into_pyarray(py))
    }
}

/// Logits [n, V, h, w] of warped colours [n, 3 V, h, w].
pub(super) fn logits(network: &mut OrtNetwork, colour: ArrayView4<'_, f32>) -> PyResult<Array4<f32>> {
    let (n, _, height, width) = colour.dim();
    let mut logits = Array4::zeros((n, network.views(), height, width));
    // Models do not look at the coverage.
    let coverage = Array4::ones(logits.dim());
    network.infer(colour, coverage.view(), logits.view_mut()).map_err(library)?;
    Ok(logits)
}
