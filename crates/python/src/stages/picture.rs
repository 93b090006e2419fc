//! The network alone, and all stages from photos to picture on given layers, for the parity tests.

use std::path::{Path, PathBuf};

use liveview::layers::Layers;
use liveview::network::{Alpha, ExecutionProvider, OrtLibrary, OrtNetwork, PlaneNetwork};
use liveview::render::{Batch, RenderRequest, Renderer};
use ndarray::{Array3, Array4};
use numpy::{IntoPyArray, PyArray3, PyArray4, PyReadonlyArray3, PyReadonlyArray4};
use pyo3::prelude::*;

use super::guided::layers_on_cells;
use super::photo::{Photo, photos};
use crate::camera::camera;
use crate::error::library;
use crate::model::installed;

/// Opens a model with the installed ONNX Runtime, or that of OpenVINO in a folder.
fn open(py: Python<'_>, model: &Path, openvino: Option<&Path>) -> PyResult<OrtNetwork> {
    let (provider, file) = match openvino {
        Some(folder) => (ExecutionProvider::OpenVino, OrtLibrary::find_in(folder, ExecutionProvider::OpenVino)),
        None => (ExecutionProvider::Cpu, installed(py)?),
    };
    let runtime = OrtLibrary::load(provider, file.as_deref()).map_err(library)?;
    OrtNetwork::open(&runtime, model, 1).map_err(library)
}

/// Logits [n, V, h, w] of warped colours [n, 3 V, h, w].
#[pyfunction]
#[pyo3(signature = (model, colour, openvino = None))]
pub(crate) fn logits<'py>(
    py: Python<'py>,
    model: PathBuf,
    colour: PyReadonlyArray4<'py, f32>,
    openvino: Option<PathBuf>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let mut network = open(py, &model, openvino.as_deref())?;
    let (n, _, height, width) = colour.as_array().dim();
    let mut logits = Array4::zeros((n, network.views(), height, width));
    network.infer(colour.as_array(), logits.view_mut()).map_err(library)?;
    Ok(logits.into_pyarray(py))
}

/// The picture [h, w, 3] on planes or on maps on cells, and the value added to logit 0 of each
/// layer; opacity competes with `alpha_scale`, and is per pixel of parallax with `alpha_spacing`.
#[pyfunction]
#[pyo3(signature = (model, views, cameras, target, layers, batch, alpha_scale = None, alpha_spacing = None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn render<'py>(
    py: Python<'py>,
    model: PathBuf,
    views: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    layers: &Bound<'py, PyAny>,
    batch: usize,
    alpha_scale: Option<f64>,
    alpha_spacing: Option<f64>,
) -> PyResult<(Bound<'py, PyArray3<f32>>, Vec<f64>)> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let layers = match layers.extract::<PyReadonlyArray3<'_, f32>>() {
        Ok(maps) => layers_on_cells(&maps)?,
        Err(_) => Layers::planes(&layers.extract::<Vec<f64>>()?).map_err(library)?,
    };
    let mut renderer = Renderer::new(Box::new(open(py, &model, None)?), batch);
    let spaced = alpha_spacing.map(|max_spacing| Alpha::PerPixel { max_spacing });
    renderer.set_alpha(alpha_scale.map(|scale| Alpha::Competing { scale }).or(spaced).unwrap_or_default());
    let mut shifts = Vec::new();
    let mut observer = |batch: &Batch<'_>| shifts.extend(batch.logit_shifts);
    let views: Vec<_> = photos.iter().map(Photo::source).collect();
    let request = RenderRequest { observer: Some(&mut observer), ..RenderRequest::new(&views, &target, &layers) };
    let picture = renderer.render(request).map_err(library)?.picture;
    let shape = (picture.height(), picture.width(), 3);
    let picture = Array3::from_shape_vec(shape, picture.data().to_vec()).expect("three per pixel");
    Ok((picture.into_pyarray(py), shifts))
}
