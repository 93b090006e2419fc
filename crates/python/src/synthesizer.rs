//! The synthesizer: a scene, layers and a network, which render targets; and the live session, which renders the time steps of a rig.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use liveview::ImageRgb;
use liveview::network::{ExecutionProvider, OrtLibrary};
use liveview::render::Renderer;
use liveview_live::session::{self, LiveError, LiveSettings, Policy};
use liveview_synthesizer::{LayerSpec, ModelOptions, Options, Targets};
use numpy::IntoPyArray;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::arguments::{Object, library, named, some, value, view_index, whole};
use crate::camera::{camera, cameras};
use crate::engine::{Engine, compute, rendered};
use crate::frame::{Frame, Frames};
use crate::scene::{Scene, picture};

/// Renders new views of a scene. Photos and their depth are kept from picture to picture. Several
/// threads may share one: their pictures are made one after the other.
///
/// `views`: photos to a picture, the network's number or 4 by default. `layers`: such as
/// "surface:3" or "planes:64"; the network's or "surface:3" by default. `network`: a model file
/// (.onnx); None weights photos by their agreement. ONNX Runtime is that of `ORT_DYLIB_PATH`, else
/// of the installed package onnxruntime. `near`, `far`: depth range, scene units, by default the
/// scene's. `cache`: a folder that keeps the depth of photos. `progress(done, count, name)` is
/// called before each search of a photo's depth; its exception ends the search.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Synthesizer {
    engine: Arc<Engine>,
    scene: Py<Scene>,
    /// The views whose depth was asked for: that of the others may be next.
    asked: Mutex<Vec<bool>>,
}

impl Synthesizer {
    /// The targets that an argument names: a view of the scene, or a camera.
    fn targets(&self, name: &str, argument: &Object<'_>) -> PyResult<Targets> {
        let scene = &self.scene.get().0;
        if argument.extract::<String>().is_ok() || argument.extract::<isize>().is_ok() {
            return Ok(Targets::held_out(scene, vec![view_index(scene, name, argument)?]));
        }
        Ok(Targets::cameras(vec![camera(name, argument)?]))
    }

    /// Notes that the depth of a view is asked for, the second time in a new round over all views;
    /// returns the views that have not been.
    fn ask(&self, view: usize) -> Vec<usize> {
        let mut asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        if std::mem::replace(&mut asked[view], true) {
            asked.fill(false);
            asked[view] = true;
        }
        (0..asked.len()).filter(|&view| !asked[view]).collect()
    }
}

#[pymethods]
impl Synthesizer {
    #[new]
    #[pyo3(signature = (scene, *, views = None, layers = None, network = None, near = None, far = None, cache = None,
                        progress = None))]
    fn new(
        py: Python<'_>,
        scene: Py<Scene>,
        views: Option<&Object<'_>>,
        layers: Option<&str>,
        network: Option<PathBuf>,
        near: Option<f64>,
        far: Option<f64>,
        cache: Option<PathBuf>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let layers = layers.map(str::parse::<LayerSpec>).transpose().map_err(|error| value("layers", error))?;
        let model = model_options(py, views, network)?;
        let views = model.views;
        let options = Options { near, far, cache, layers, model, ..Options::default() };
        if let Some(progress) = progress.as_ref().filter(|progress| !progress.bind(py).is_callable()) {
            return Err(crate::arguments::kind("progress", format!("{progress}; expected a function")));
        }
        let folder = scene.get().0.clone();
        let engine = compute(py, || Engine::open(folder, options, progress))?;
        engine.with(py, |synthesizer| check_views(views, synthesizer.renderer()))?;
        let asked = Mutex::new(vec![false; scene.get().0.views.len()]);
        Ok(Self { engine: Arc::new(engine), scene, asked })
    }

    /// The picture of a camera, or of a view of the scene (its name or index), rendered from the
    /// others.
    fn render(&self, py: Python<'_>, target: &Object<'_>) -> PyResult<Frame> {
        let targets = self.targets("target", target)?;
        self.engine.with(py, |synthesizer| {
            let shots = synthesizer.shots(targets).map_err(library)?;
            let [shot] = shots.as_slice() else { return Err(PyRuntimeError::new_err("target: not one")) };
            Ok(rendered(synthesizer, shot, &[], None)?.0)
        })
    }

    /// The pictures of cameras along a path, one after the other, over one depth range.
    fn render_path(&self, py: Python<'_>, targets: &Object<'_>) -> PyResult<Frames> {
        let path = Targets::cameras(cameras("targets", targets)?);
        let shots = self.engine.with(py, |synthesizer| synthesizer.shots(path).map_err(library))?;
        Ok(Frames { engine: Arc::clone(&self.engine), shots, progress: Mutex::default() })
    }

    /// The depth of a view's photo, searched among its neighbours. Depths that views not yet
    /// asked for need stay in memory, others within 128 MiB.
    fn depth<'py>(&self, py: Python<'py>, photo: &Object<'py>) -> PyResult<Object<'py>> {
        let view = view_index(&self.scene.get().0, "photo", photo)?;
        let later = self.ask(view);
        let found = self
            .engine
            .with(py, |synthesizer| synthesizer.photos_mut().view_depth(view, &[], &later, false).map_err(library))?;
        let confirmed = found.confirmed.disparity.mapv(|disparity| disparity >= 0.0).into_pyarray(py);
        let pixel = found.found.disparity_per_pixel;
        let disparity = Arc::unwrap_or_clone(found.found).disparity.into_pyarray(py);
        named(py, "ViewDepth", (disparity, confirmed, pixel, found.range))
    }

    /// The scene.
    #[getter]
    fn scene(&self, py: Python<'_>) -> Py<Scene> {
        self.scene.clone_ref(py)
    }

    /// The layers it renders on.
    #[getter]
    fn layers(&self, py: Python<'_>) -> PyResult<String> {
        self.engine.with(py, |synthesizer| Ok(synthesizer.layers().to_string()))
    }

    /// Photos to a picture.
    #[getter]
    fn views(&self, py: Python<'_>) -> PyResult<usize> {
        self.engine.with(py, |synthesizer| Ok(synthesizer.renderer().network().views()))
    }
}

/// How the network is opened; without a file, photos are weighted by their agreement.
pub(crate) fn model_options(
    py: Python<'_>,
    views: Option<&Object<'_>>,
    network: Option<PathBuf>,
) -> PyResult<ModelOptions> {
    let views = views.map(|views| whole("views", views)).transpose()?;
    if views == Some(0) {
        return Err(value("views", "0; expected at least 1"));
    }
    let library = if network.is_some() { installed(py)? } else { None };
    Ok(ModelOptions { views, network: Some(network.is_some()), library, file: network, ..ModelOptions::default() })
}

/// Refuses `views` where the network takes another number.
pub(crate) fn check_views(views: Option<usize>, renderer: &Renderer) -> PyResult<()> {
    let found = renderer.network().views();
    match views.filter(|&views| views != found) {
        Some(views) => Err(value("views", format!("{views}; the network takes {found}"))),
        None => Ok(()),
    }
}

/// The library's file; `None` if `ORT_DYLIB_PATH` is set, which takes precedence, or the package is
/// not installed. The package is not imported.
pub(crate) fn installed(py: Python<'_>) -> PyResult<Option<PathBuf>> {
    if std::env::var_os("ORT_DYLIB_PATH").is_some_and(|path| !path.is_empty()) {
        return Ok(None);
    }
    let found = py.import("importlib.util")?.call_method1("find_spec", ("onnxruntime",))?;
    if found.is_none() {
        return Ok(None);
    }
    let folders: Option<Vec<PathBuf>> = found.getattr("submodule_search_locations")?.extract()?;
    let mut libraries = folders.into_iter().flatten().map(|folder| folder.join("capi"));
    Ok(libraries.find_map(|folder| OrtLibrary::find_in(&folder, ExecutionProvider::Cpu)))
}

/// Renders the time steps of a rig of cameras, one after the other. What one has found the next
/// reuses: the depth of a photo where it stays the same, or the planes that were selected.
///
/// `near`, `far`: depth range, scene units. `views`, `layers`, `network`: as of `Synthesizer`.
/// `policy`: when layers are searched: "propagate", where the photos have changed; "each" step; "once". By default "propagate", and "once" for planes.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct LiveSession(Mutex<Steps>);

/// The session, and the number of steps rendered.
struct Steps {
    session: session::LiveSession,
    rendered: usize,
}

#[pymethods]
impl LiveSession {
    #[new]
    #[pyo3(signature = (cameras, near, far, *, views = None, layers = None, network = None, policy = None))]
    fn new(
        py: Python<'_>,
        cameras: &Object<'_>,
        near: f64,
        far: f64,
        views: Option<&Object<'_>>,
        layers: Option<&str>,
        network: Option<PathBuf>,
        policy: Option<&str>,
    ) -> PyResult<Self> {
        let cameras = self::cameras("cameras", cameras)?;
        let layers: Option<LayerSpec> = layers.map(str::parse).transpose().map_err(|error| value("layers", error))?;
        let policy: Option<Policy> = policy.map(str::parse).transpose().map_err(|error| value("policy", error))?;
        let options = model_options(py, views, network)?;
        let opened = compute(py, || options.open_renderer(layers.as_ref()).map_err(library))?;
        let given = layers.is_some();
        let (renderer, layers) = (opened.renderer, opened.layers);
        check_views(options.views, &renderer)?;
        let policy = Policy::for_layers(policy, &layers).map_err(|error| value("policy", error))?;
        let mut settings = LiveSettings::new(near, far);
        let layers = if given { layers } else { policy.layers_by_default(layers) };
        (settings.layers, settings.policy) = (layers, policy);
        let session = session::LiveSession::new(cameras, vec![renderer], settings);
        let session = session.map_err(|error| value("near, far", error))?;
        Ok(Self(Mutex::new(Steps { session, rendered: 0 })))
    }

    /// The picture of a camera at the next time step; photos: of each camera in order [h, w, 3], as
    /// `Scene.from_arrays` takes them, or None where it has delivered nothing.
    fn render(&self, py: Python<'_>, photos: &Object<'_>, target: &Object<'_>) -> PyResult<Frame> {
        let target = camera("target", target)?;
        let photos = some("photos", photos)?;
        let photos = photos.iter().map(|(name, photo)| (!photo.is_none()).then(|| picture(name, photo)).transpose());
        let photos = photos.collect::<PyResult<Vec<_>>>()?;
        let (step, found) = compute(py, || {
            let photos: Vec<Option<&ImageRgb>> = photos.iter().map(Option::as_ref).collect();
            let mut steps = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let found = steps.session.render(&photos, &target).map_err(|error| match error {
                LiveError::Photos(_) => value("photos", error),
                _ => library(error),
            })?;
            steps.rendered += 1;
            Ok((steps.rendered - 1, found))
        })?;
        let before = [("photos", found.times.photos), ("layers", found.times.layers)];
        Ok(Frame::new(format!("frame_{step:04}"), found.frame, before, None))
    }

    /// Forgets what earlier steps have found: the next is rendered like the first.
    fn restart(&self, py: Python<'_>) -> PyResult<()> {
        compute(py, || {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).session.restart();
            Ok(())
        })
    }
}
