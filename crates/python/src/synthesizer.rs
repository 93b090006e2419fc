//! The synthesizer: a scene, layers and a network, which render targets.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use liveview::network::RunEnd;
use liveview::{DepthProgress, LayerSpec, Model, ModelOptions, Options, Shot, Targets};
use numpy::IntoPyArray;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::camera::{camera, cameras};
use crate::error::{library, value};
use crate::frame::{Frame, Times, times};
use crate::frames::Frames;
use crate::names::view_index;
use crate::onnx_runtime;
use crate::scene::Scene;
use crate::tuples::named;
use crate::work::{compute, run};

/// Renders new views of a scene. Photos and their depth are kept from picture to picture. Several
/// threads may share one: their pictures are made one after the other.
///
/// `views`: photos to a picture, the network's number or 4 by default. `layers`: such as
/// "surface:3" or "planes:64"; the network's or "surface:3" by default. `network`: a model file
/// (.onnx); None weighs photos by their agreement. ONNX Runtime is that of `ORT_DYLIB_PATH`, else
/// of the installed package onnxruntime. `near`, `far`: depth range, scene units, by default the
/// scene's. `cache`: a folder that keeps the depth of photos. `progress(done, count, name)` is
/// called before each search of a photo's depth; its exception ends the search.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Synthesizer {
    inner: Mutex<liveview::Synthesizer>,
    scene: Py<Scene>,
    /// How the network is opened again after an interrupt has ended it; `None` without one.
    model: Option<ModelOptions>,
    runs: Mutex<Option<RunEnd>>,
    control: Arc<Control>,
}

/// What a running search sees from outside, and what it leaves.
#[derive(Default)]
struct Control {
    stop: AtomicBool,
    /// The thread that renders, which calls `progress`.
    worker: Mutex<Option<ThreadId>>,
    /// The exception of `progress`.
    raised: Mutex<Option<PyErr>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Control {
    /// Asks Python's callback whether the next photo is searched.
    fn next(&self, progress: Option<&Py<PyAny>>, next: DepthProgress<'_>) -> ControlFlow<()> {
        let called = progress
            .map(|progress| Python::attach(|py| progress.call1(py, (next.done, next.count, next.name)).map(|_| ())));
        if let Some(Err(raised)) = called {
            *locked(&self.raised) = Some(raised);
            return ControlFlow::Break(());
        }
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

impl Synthesizer {
    /// Runs work on the library's synthesizer, one at a time.
    pub(crate) fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut liveview::Synthesizer) -> PyResult<T> + Send,
    ) -> PyResult<T> {
        if *locked(&self.control.worker) == Some(thread::current().id()) {
            return Err(PyRuntimeError::new_err("progress: it called the synthesizer that called it"));
        }
        let interrupted = AtomicBool::new(false);
        let interrupt = || {
            interrupted.store(true, Ordering::Relaxed);
            self.control.stop.store(true, Ordering::Relaxed);
            locked(&self.runs).iter().for_each(RunEnd::end);
        };
        run(py, interrupt, || {
            let mut synthesizer = locked(&self.inner);
            if interrupted.load(Ordering::Relaxed) {
                return Err(PyRuntimeError::new_err("interrupted while another thread rendered"));
            }
            if self.control.stop.swap(false, Ordering::Relaxed) {
                self.open_again(&mut synthesizer)?;
            }
            *locked(&self.control.worker) = Some(thread::current().id());
            let result = work(&mut synthesizer);
            *locked(&self.control.worker) = None;
            locked(&self.control.raised).take().map_or(result, Err)
        })
    }

    /// Opens the network whose runs an interrupt has ended.
    fn open_again(&self, synthesizer: &mut liveview::Synthesizer) -> PyResult<()> {
        let Some(options) = &self.model else { return Ok(()) };
        let layers = synthesizer.layers().clone();
        *synthesizer.renderer_mut() = Model::open(options, Some(&layers)).map_err(library)?.into_renderer();
        *locked(&self.runs) = synthesizer.renderer().network().run_end();
        Ok(())
    }

    /// The targets that an argument names: a view of the scene, or a camera.
    fn targets(&self, name: &str, argument: &Bound<'_, PyAny>) -> PyResult<Targets> {
        let scene = &self.scene.get().0;
        if argument.extract::<String>().is_ok() || argument.extract::<isize>().is_ok() {
            return Ok(Targets::held_out(scene, vec![view_index(scene, name, argument)?]));
        }
        Ok(Targets::cameras(vec![camera(name, argument)?]))
    }
}

/// Renders one shot; `later` are those that follow.
pub(crate) fn rendered(
    synthesizer: &mut liveview::Synthesizer,
    shot: &Shot,
    later: &[Shot],
) -> PyResult<(liveview::Frame, Times)> {
    let loaded = synthesizer.load(shot, later).map_err(library)?;
    let plan = synthesizer.plan(&loaded).map_err(library)?;
    let frame = synthesizer.render_plan(&loaded, &plan, None).map_err(library)?;
    let times = times(&plan, &frame);
    Ok((frame, times))
}

#[pymethods]
impl Synthesizer {
    #[new]
    #[pyo3(signature = (scene, *, views = None, layers = None, network = None, near = None, far = None, cache = None,
                        progress = None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        scene: Py<Scene>,
        views: Option<usize>,
        layers: Option<&str>,
        network: Option<PathBuf>,
        near: Option<f64>,
        far: Option<f64>,
        cache: Option<PathBuf>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let mut options = Options::default();
        (options.near, options.far, options.cache) = (near, far, cache);
        options.layers = layers.map(str::parse::<LayerSpec>).transpose().map_err(|error| value("layers", error))?;
        if views == Some(0) {
            return Err(value("views", "0; expected at least 1"));
        }
        (options.model.views, options.model.without_network) = (views, network.is_none());
        options.model.file = network;
        if options.model.file.is_some() {
            options.model.library = onnx_runtime::installed(py)?;
        }
        if let Some(progress) = progress.as_ref().filter(|progress| !progress.bind(py).is_callable()) {
            return Err(crate::error::kind("progress", format!("{progress}; expected a function")));
        }
        let (folder, control) = (scene.get().0.clone(), Arc::<Control>::default());
        let mut inner = compute(py, || liveview::Synthesizer::with_scene(folder, &options).map_err(library))?;
        let found = inner.renderer().network().views();
        if let Some(views) = views.filter(|&views| views != found) {
            return Err(value("views", format!("{views}; the network takes {found}")));
        }
        let watched = Arc::clone(&control);
        inner.photos_mut().on_depth_search(move |next| watched.next(progress.as_ref(), next));
        let runs = Mutex::new(inner.renderer().network().run_end());
        let model = options.model.file.is_some().then_some(options.model);
        Ok(Self { inner: Mutex::new(inner), scene, model, runs, control })
    }

    /// The picture of a camera, or of a view of the scene (its name or index), rendered from the
    /// others.
    #[pyo3(signature = (target))]
    fn render(&self, py: Python<'_>, target: &Bound<'_, PyAny>) -> PyResult<Frame> {
        let targets = self.targets("target", target)?;
        let (name, (frame, times)) = self.with(py, |synthesizer| {
            let shots = synthesizer.shots(targets).map_err(library)?;
            let [shot] = shots.as_slice() else { return Err(PyRuntimeError::new_err("target: not one")) };
            Ok((shot.name.clone(), rendered(synthesizer, shot, &[])?))
        })?;
        Frame::new(py, name, frame, times)
    }

    /// The pictures of cameras along a path, one after the other, over one depth range.
    #[pyo3(signature = (targets))]
    fn render_path(slf: Bound<'_, Self>, targets: &Bound<'_, PyAny>) -> PyResult<Frames> {
        let path = Targets::cameras(cameras("targets", targets)?);
        let shots = slf.get().with(slf.py(), |synthesizer| synthesizer.shots(path).map_err(library))?;
        Ok(Frames::new(slf.unbind(), shots))
    }

    /// The depth of a view's photo, searched among its neighbours.
    #[pyo3(signature = (photo))]
    fn depth<'py>(&self, py: Python<'py>, photo: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let view = view_index(&self.scene.get().0, "photo", photo)?;
        let found =
            self.with(py, |synthesizer| synthesizer.photos_mut().view_depth(view, &[], &[]).map_err(library))?;
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
        self.with(py, |synthesizer| Ok(synthesizer.layers().to_string()))
    }

    /// Photos to a picture.
    #[getter]
    fn views(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |synthesizer| Ok(synthesizer.renderer().network().views()))
    }
}
