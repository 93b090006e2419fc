//! Every stage of a picture as arrays by name, for the parity tests.

use std::sync::Arc;

use liveview::layers::{Layer, Layers};
use liveview::network::Alpha;
use liveview::render::{Batch, Blended, LayerSamples};
use liveview::{Frame, image};
use liveview_surface::guided::SearchStages;
use liveview_synthesizer::{Plan, Scene, Shot, ViewDepth};
use ndarray::{Array, Array2, Array3, ArrayD, Axis, concatenate, stack};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::library;
use crate::frame::picture_array;

/// The names of the arrays of a batch of layers.
const OF_LAYERS: [&str; 6] = ["maps", "colour", "coverage", "logits", "alpha", "rgb"];

/// What a renderer shows its observer, of all layers near → far.
#[derive(Default)]
pub(super) struct Recorded {
    /// Of each batch, in the order of [`OF_LAYERS`].
    batches: Vec<[ArrayD<f32>; OF_LAYERS.len()]>,
}

impl Recorded {
    pub(super) fn add(&mut self, batch: &Batch<'_>) {
        let (n, _, height, width) = batch.logits.dim();
        let (mut alpha, mut rgb) = (Vec::new(), Vec::new());
        for k in 0..n {
            let [logits, colour, coverage] = [batch.logits, batch.hwv, batch.coverage]
                .map(|all| all.index_axis(Axis(0), k).iter().copied().collect::<Vec<_>>());
            let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage };
            let mut blended = Blended::new(height * width);
            samples.blend(batch.weights, 0, &mut blended);
            alpha.extend(blended.alpha);
            rgb.extend(blended.rgb.into_iter().flatten());
        }
        let alpha = Array::from_shape_vec((n, height, width), alpha).expect("one per pixel");
        let rgb = Array::from_shape_vec((n, 3, height, width), rgb).expect("three per pixel");
        let maps = batch.disparity.to_owned().into_dyn();
        let [colour, coverage, logits] =
            [batch.hwv, batch.coverage, batch.logits].map(|array| array.to_owned().into_dyn());
        self.batches.push([maps, colour, coverage, logits, alpha.into_dyn(), rgb.into_dyn()]);
    }

    /// Adds the arrays of the layers and of the frame.
    pub(super) fn put(self, layers: &Layers, alpha: Alpha, frame: Frame, arrays: &Bound<'_, PyDict>) -> PyResult<()> {
        let py = arrays.py();
        for (stage, name) in OF_LAYERS.iter().enumerate() {
            let parts: Vec<_> = self.batches.iter().map(|batch| batch[stage].view()).collect();
            arrays.set_item(name, concatenate(Axis(0), &parts).expect("of one size").into_pyarray(py))?;
        }
        let plane = |layer: &Layer| if let Layer::Plane(disparity) = layer { Some(*disparity) } else { None };
        let planes: Vec<f64> = layers.as_slice().iter().filter_map(plane).collect();
        if !planes.is_empty() {
            arrays.set_item("disparities", planes.into_pyarray(py))?;
        }
        if let Alpha::Competing { scale } = alpha {
            arrays.set_item("alpha_scale", scale)?;
        }
        let (height, width) = frame.disparity.dim();
        let picture = Array3::from_shape_fn((3, height, width), |(c, y, x)| frame.raw().pixel(x, y)[c]);
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

/// Adds what a shot was chosen to be rendered from.
pub(super) fn put_shot(shot: &Shot, scene: &Scene, arrays: &Bound<'_, PyDict>) -> PyResult<()> {
    let py = arrays.py();
    let photos: Vec<i64> = shot.views.iter().chain(&shot.helpers).map(|&view| view as i64).collect();
    arrays.set_item("shot.photos", photos.into_pyarray(py))?;
    let free = (0..scene.views.len()).filter(|view| !shot.held_out.contains(view)).map(|view| view as i64);
    arrays.set_item("shot.free", free.collect::<Vec<_>>().into_pyarray(py))?;
    arrays.set_item("shot.range", vec![shot.near, shot.far].into_pyarray(py))?;
    for (index, view) in shot.views.iter().map(|&view| &scene.views[view]).enumerate() {
        let (model, coefficients) = view.distortion();
        let fisheye = model == "OPENCV_FISHEYE";
        let distorted = fisheye || coefficients.iter().any(|(_, value)| *value != 0.0);
        if distorted && view.native_camera().size() == view.camera.size() {
            let photo = image::load(view.image_path()).map_err(library)?;
            arrays.set_item(format!("original{index}.photo"), picture_array(photo).into_pyarray(py))?;
            arrays.set_item(format!("original{index}.fisheye"), fisheye)?;
            for (name, value) in coefficients {
                arrays.set_item(format!("original{index}.{name}"), value)?;
            }
        }
    }
    Ok(())
}

/// Adds the depth of photos, and what a plan took from it.
pub(super) fn put_depths(depths: Vec<ViewDepth>, plan: &Plan, arrays: &Bound<'_, PyDict>) -> PyResult<()> {
    let py = arrays.py();
    let pixels: Vec<f32> = depths.iter().map(|depth| depth.found.disparity_per_pixel).collect();
    for (index, depth) in depths.into_iter().enumerate() {
        arrays.set_item("surface.range", depth.range)?;
        arrays.set_item(format!("depth{index}"), Arc::unwrap_or_clone(depth.found).disparity.into_pyarray(py))?;
    }
    if !plan.corrections.is_empty() {
        let shape = (plan.corrections.len(), 3);
        let gains = Array2::from_shape_fn(shape, |(view, channel)| plan.corrections[view].gains[channel]);
        arrays.set_item("gains", gains.into_pyarray(py))?;
        let sharpening: Vec<f32> = plan.corrections.iter().map(|view| view.sharpening).collect();
        arrays.set_item("sharpening", sharpening.into_pyarray(py))?;
    }
    let Some(surface) = &plan.surface else { return Ok(()) };
    arrays.set_item("pixel", pixels.into_pyarray(py))?;
    for (index, used) in surface.visibility().disparities.into_iter().enumerate() {
        arrays.set_item(format!("used{index}"), used.clone().into_pyarray(py))?;
    }
    arrays.set_item("surface", surface.surface().disparity.clone().into_pyarray(py))
}
