//! Every stage of a picture as arrays by name, for the parity tests.

use liveview::Frame;
use liveview::layers::guided::SearchStages;
use liveview::layers::{Layer, Layers};
use liveview::network::Alpha;
use liveview::render::{Batch, Blended, LayerSamples};
use ndarray::{Array, Array3, ArrayD, Axis, concatenate, stack};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The names of the arrays of a batch of layers.
const OF_LAYERS: [&str; 6] = ["maps", "colour", "coverage", "logits", "alpha", "rgb"];

/// What a renderer shows its observer, of all layers near → far.
#[derive(Default)]
pub(super) struct Recorded {
    /// Of each batch, in the order of [`OF_LAYERS`].
    batches: Vec<[ArrayD<f32>; OF_LAYERS.len()]>,
    logit_shift: Vec<f64>,
}

impl Recorded {
    pub(super) fn add(&mut self, batch: &Batch<'_>) {
        let (n, _, height, width) = batch.logits.dim();
        let (mut alpha, mut rgb) = (Vec::new(), Vec::new());
        for (k, &logit_shift) in batch.logit_shifts.iter().enumerate() {
            let [logits, colour, coverage] = [batch.logits, batch.hwv, batch.coverage]
                .map(|all| all.index_axis(Axis(0), k).iter().copied().collect::<Vec<_>>());
            let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage, logit_shift };
            let mut blended = Blended::new(height * width);
            batch.weights.blend(&samples, 0, &mut blended);
            alpha.extend(blended.alpha);
            rgb.extend(blended.rgb.into_iter().flatten());
        }
        let alpha = Array::from_shape_vec((n, height, width), alpha).expect("one per pixel");
        let rgb = Array::from_shape_vec((n, 3, height, width), rgb).expect("three per pixel");
        let maps = batch.disparity.to_owned().into_dyn();
        let [colour, coverage, logits] =
            [batch.hwv, batch.coverage, batch.logits].map(|array| array.to_owned().into_dyn());
        self.batches.push([maps, colour, coverage, logits, alpha.into_dyn(), rgb.into_dyn()]);
        self.logit_shift.extend(batch.logit_shifts);
    }

    /// Adds the arrays of the layers and of the frame.
    pub(super) fn put(self, layers: &Layers, alpha: Alpha, frame: Frame, arrays: &Bound<'_, PyDict>) -> PyResult<()> {
        let py = arrays.py();
        for (stage, name) in OF_LAYERS.iter().enumerate() {
            let parts: Vec<_> = self.batches.iter().map(|batch| batch[stage].view()).collect();
            arrays.set_item(name, concatenate(Axis(0), &parts).expect("of one size").into_pyarray(py))?;
        }
        let mut planes = Vec::new();
        for layer in layers.as_slice() {
            if let Layer::Plane(disparity) = layer {
                planes.push(*disparity);
            }
        }
        if !planes.is_empty() {
            arrays.set_item("disparities", planes.into_pyarray(py))?;
        }
        match alpha {
            Alpha::Competing { scale } => arrays.set_item("alpha_scale", scale)?,
            Alpha::PerPixel { max_spacing } => {
                arrays.set_item("alpha_spacing", max_spacing)?;
                arrays.set_item("logit_shift", self.logit_shift.into_pyarray(py))?;
            }
            _ => (),
        }
        let (height, width) = frame.disparity.dim();
        let picture = Array3::from_shape_fn((3, height, width), |(c, y, x)| frame.picture.pixel(x, y)[c]);
        arrays.set_item("frame", picture.into_pyarray(py))?;
        arrays.set_item("disparity", frame.disparity.into_pyarray(py))?;
        arrays.set_item("transmittance", frame.transmittance.into_pyarray(py))?;
        let best = frame.best_layer.map(|best| best.map_or(-1, i64::from));
        arrays.set_item("best_layer", best.into_pyarray(py))
    }
}

/// Adds the stages of a guided search, and the layers on cells that divide the range that it found.
pub(super) fn put_search(found: SearchStages, layers: &Layers, arrays: &Bound<'_, PyDict>) -> PyResult<()> {
    let py = arrays.py();
    let range = &found.range;
    let range = [range.nearest(), range.surface(), range.farthest()].map(|map| map.view());
    arrays.set_item("range", stack(Axis(0), &range).expect("of one size").into_pyarray(py))?;
    let map = |layer: &Layer| if let Layer::Map(map) = layer { Some(map.clone()) } else { None };
    let maps: Vec<_> = layers.as_slice().iter().filter_map(map).collect();
    let maps: Vec<_> = maps.iter().map(|map| map.view()).collect();
    arrays.set_item("cell_maps", stack(Axis(0), &maps).expect("of one size").into_pyarray(py))?;
    arrays.set_item("coarse_disparities", found.disparities.into_pyarray(py))?;
    for (name, maps) in [
        ("costs", found.costs),
        ("aggregated_costs", found.aggregated_costs),
        ("fine_layers", found.fine_layers),
        ("fine_costs", found.fine_costs),
    ] {
        arrays.set_item(name, maps.into_pyarray(py))?;
    }
    arrays.set_item("coarse_disparity", found.coarse_disparity.into_pyarray(py))?;
    arrays.set_item("fine_disparity", found.fine_disparity.into_pyarray(py))
}
