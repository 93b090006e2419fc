//! The network alone, and all stages of a picture of a rig or of a scene, for the parity tests.

use std::path::{Path, PathBuf};

use liveview::layers::Layers;
use liveview::network::{Alpha, ExecutionProvider, OrtLibrary, OrtNetwork, Precision};
use liveview::render::{Batch, RenderRequest, Renderer};
use liveview_surface::guided::GuidedSearch;
use liveview_synthesizer::{
    LayerSpec, ModelOptions, OpenedRenderer, Plan, SceneViews, Synthesizer, Targets, ViewDepth,
};
use numpy::{IntoPyArray, PyArray4, PyReadonlyArray3, PyReadonlyArray4};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::recorded::{Recorded, put_depths, put_search, put_shot};
use super::warp::{Photo, photos};
use crate::arguments::{Object, kind, library, value, view_index};
use crate::camera::camera;
use crate::engine::compute;
use crate::scene::Scene;
use crate::synthesizer::installed;

/// The ONNX Runtime of a folder, by default the installed one.
fn runtime(py: Python<'_>, provider: ExecutionProvider, folder: Option<&Path>) -> PyResult<Option<PathBuf>> {
    folder.map_or_else(|| installed(py), |folder| Ok(OrtLibrary::find_in(folder, provider)))
}

fn open(py: Python<'_>, model: &Path, openvino: Option<&Path>) -> PyResult<OrtNetwork> {
    let provider = if openvino.is_some() { ExecutionProvider::OpenVino } else { ExecutionProvider::Cpu };
    let runtime = OrtLibrary::load(provider, runtime(py, provider, openvino)?.as_deref()).map_err(library)?;
    OrtNetwork::open(&runtime, model, 1).map_err(library)
}

/// Logits [n, V, h, w] of warped colours [n, 3 V, h, w]; `openvino`: the folder of its ONNX Runtime.
#[pyfunction]
#[pyo3(signature = (model, colour, openvino = None))]
pub(crate) fn logits<'py>(
    py: Python<'py>,
    model: PathBuf,
    colour: PyReadonlyArray4<'py, f32>,
    openvino: Option<PathBuf>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let mut network = open(py, &model, openvino.as_deref())?;
    Ok(super::render::logits(&mut network, colour.as_array())?.into_pyarray(py))
}

/// The stages of the guided search between the depths of `range`, for `count` layers.
#[pyfunction]
pub(crate) fn guided_search<'py>(
    py: Python<'py>,
    views: &Object<'py>,
    cameras: &Object<'py>,
    target: &Object<'py>,
    range: (f64, f64),
    count: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let views: Vec<_> = photos.iter().map(Photo::source).collect();
    let found = GuidedSearch { near: range.0, far: range.1, planes: None }.search(&views, &target);
    let found = found.map_err(library)?;
    let layers = found.range.layers(count).map_err(library)?;
    let arrays = PyDict::new(py);
    put_search(found, &layers, &arrays)?;
    Ok(arrays)
}

/// Every stage of a picture of a rig on planes or on maps on cells, `batch` layers at a time; layers
/// compete with `alpha_scale`.
#[pyfunction]
#[pyo3(signature = (model, views, cameras, target, layers, batch, alpha_scale = None))]
pub(crate) fn render<'py>(
    py: Python<'py>,
    model: PathBuf,
    views: &Object<'py>,
    cameras: &Object<'py>,
    target: &Object<'py>,
    layers: &Object<'py>,
    batch: usize,
    alpha_scale: Option<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let (photos, target) = (photos(("views", views), ("cameras", cameras))?, camera("target", target)?);
    let layers = match layers.extract::<PyReadonlyArray3<'_, f32>>() {
        Ok(maps) => Layers::maps(maps.as_array().outer_iter().map(|map| map.to_owned()).collect()),
        Err(_) => Layers::planes(&layers.extract::<Vec<f64>>()?),
    };
    let layers = layers.map_err(library)?;
    let alpha = alpha_scale.map(|scale| Alpha::Competing { scale }).unwrap_or_default();
    let mut renderer = Renderer::new(Box::new(open(py, &model, None)?), alpha, batch);
    renderer.set_skip_uncovered(false);
    let mut recorded = Recorded::default();
    let mut observer = |batch: &Batch<'_>| recorded.add(batch);
    let views: Vec<_> = photos.iter().map(Photo::source).collect();
    let request = RenderRequest { observer: Some(&mut observer), ..RenderRequest::new(&views, &target, &layers) };
    let frame = renderer.render(request).map_err(library)?;
    let arrays = PyDict::new(py);
    recorded.put(&layers, renderer.alpha(), frame, &arrays)?;
    Ok(arrays)
}

/// One of the program's options, if it is given and not `None`.
fn given<'py, T: FromPyObjectOwned<'py>>(options: &Bound<'py, PyDict>, name: &str) -> PyResult<Option<T>> {
    let found = options.get_item(name)?.filter(|found| !found.is_none());
    found.map(|found| found.extract::<T>().map_err(Into::into)).transpose()
}

fn options_of_model(py: Python<'_>, from: &Bound<'_, PyDict>) -> PyResult<ModelOptions> {
    let text = |name| given::<String>(from, name);
    let mut options = ModelOptions::default();
    let name = text("engine")?.unwrap_or_else(|| "cpu".to_owned());
    let named = ExecutionProvider::ALL.into_iter().find(|provider| provider.name() == name);
    options.provider = named.ok_or_else(|| value("engine", format!("there is no {name}")))?;
    let kind = text("alpha")?.map(|kind| kind.parse()).transpose();
    options.alpha = kind.map_err(|expected| value("alpha", format!("expected {expected}")))?;
    (options.quantized, options.precision) = match text("precision")?.as_deref() {
        None | Some("f32") => (false, Precision::F32),
        Some("int8") => (true, Precision::F32),
        Some("bf16") => (false, Precision::Bf16),
        Some(other) => return Err(value("precision", format!("{other}; expected f32, bf16 or int8"))),
    };
    (options.views, options.network) = (given(from, "views")?, given(from, "network")?);
    options.file = given(from, "model")?;
    options.folders.extend(given::<PathBuf>(from, "models")?);
    options.library = runtime(py, options.provider, given::<PathBuf>(from, "runtime")?.as_deref())?;
    Ok(options)
}

/// Every stage of a picture of a scene as arrays, and what the options chose; the target is a view or a
/// camera.
///
/// `options` are the program's: `layers`, `views`, `near`, `far`, `network` (whether one is used), `model`, `models` (the
/// folder of the models), `alpha`, `precision`, `engine` and `runtime` (the folder of ONNX Runtime); any may be missing.
///
/// Of the shot `shot.photos`, the views to render from and then the helpers, `shot.free`, all views that
/// are not held out, and `shot.range`; `original{i}.…` of view i of the shot, if a distortion was
/// removed and nothing else. With depth of photos `depth{i}` of each of them, `pixel` and
/// `surface.range`; of the surface `used{i}`, the depth of the views to render from as it was used,
/// and `surface`.
#[pyfunction]
pub(crate) fn render_scene<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    target: &Object<'py>,
    options: &Bound<'py, PyDict>,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    let scene = scene.get().0.clone();
    let targets = match camera("target", target) {
        Ok(camera) => Targets::cameras(vec![camera]),
        Err(_) => Targets::held_out(&scene, vec![view_index(&scene, "target", target)?]),
    };
    let layers = given::<String>(options, "layers")?.map(|layers| layers.parse::<LayerSpec>()).transpose();
    let layers = layers.map_err(|error| value("layers", error))?;
    let of_model = options_of_model(py, options)?;
    let (near, far) = (given(options, "near")?, given(options, "far")?);
    let about = PyDict::new(py);
    let OpenedRenderer { renderer, layers, model } =
        compute(py, || of_model.open_renderer(layers.as_ref()).map_err(library))?;
    about.set_item("model", model.as_ref().map(|model| &model.path))?;
    if let Some(model) = model {
        about.set_item("library", model.library)?;
        about.set_item("precision", model.precision)?;
    }
    about.set_item("layers", layers.to_string())?;
    about.set_item("engine", of_model.provider.name())?;
    about.set_item("threads", of_model.threads_or_default())?;
    let mut synthesizer = Synthesizer::new(SceneViews::new(scene, near, far), renderer, layers);
    synthesizer.renderer_mut().set_skip_uncovered(false);

    let mut recorded = Recorded::default();
    let (shot, search, depths, plan, frame) = compute(py, || {
        let mut shots = synthesizer.shots(targets).map_err(library)?;
        let shot = shots.pop().ok_or_else(|| kind("target", "there is none"))?;
        let loaded = synthesizer.load(&shot, &[]).map_err(library)?;
        let (search, plan) = match *synthesizer.layers() {
            LayerSpec::Guided { layers, coarse_planes } => {
                let search = GuidedSearch { near: shot.near, far: shot.far, planes: coarse_planes };
                let search = search.search(&loaded.sources(), &shot.target).map_err(library)?;
                let layers = search.range.layers(layers).map_err(library)?;
                (Some(search), Plan::known(layers))
            }
            _ => (None, synthesizer.plan(&loaded).map_err(library)?),
        };
        let mut observer = |batch: &Batch<'_>| recorded.add(batch);
        let frame = synthesizer.render_plan(&loaded, &plan, Some(&mut observer)).map_err(library)?;
        let mut depths: Vec<ViewDepth> = Vec::new();
        if plan.surface.is_some() {
            let views: Vec<usize> = shot.views.iter().chain(&shot.helpers).copied().collect();
            for &view in &views {
                let found = synthesizer.photos_mut().view_depth(view, &shot.held_out, &views, false);
                depths.push(found.map_err(library)?);
            }
        }
        Ok((shot, search, depths, plan, frame))
    })?;

    let arrays = PyDict::new(py);
    put_shot(&shot, synthesizer.scene(), &arrays)?;
    if let Some(search) = search {
        put_search(search, &plan.layers, &arrays)?;
    }
    put_depths(depths, &plan, &arrays)?;
    recorded.put(&plan.layers, synthesizer.renderer().alpha(), frame, &arrays)?;
    about.set_item("target", &shot.name)?;
    about.set_item("views", synthesizer.views().names(&shot.views))?;
    Ok((arrays, about))
}
