//! A rendered picture.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use liveview::{ImageRgb, Layers};
use liveview_scene::save_picture;
use liveview_synthesizer::{LayerSpec, Plan, Shot, Synthesizer};
use ndarray::Array3;
use numpy::{IntoPyArray, PyArray2, PyArray3, ToPyArray};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::library;
use crate::engine::{Engine, compute, rendered};

/// A stage and its wall time.
type Stage = (&'static str, Duration);

/// A rendered picture. Each read of an array is a copy.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Frame {
    /// The target's.
    #[pyo3(get)]
    name: String,
    frame: liveview::Frame,
    /// The share of the pixels whose surface no two photos confirm; None for layers that do not follow it.
    #[pyo3(get)]
    guessed: Option<f64>,
    times: Vec<Stage>,
}

impl Frame {
    /// `before`: wall time of the stages before rendering; `guessed`: the share of guessed pixels.
    pub(crate) fn new(name: String, frame: liveview::Frame, before: [Stage; 2], guessed: Option<f64>) -> Self {
        let times = &frame.times;
        let rendering = [("warp", times.warp), ("network", times.network), ("composite", times.composite)];
        Self { name, guessed, times: before.into_iter().chain(rendering).collect(), frame }
    }
}

/// A picture as an array `[h, w, 3]`, without a copy.
pub(crate) fn picture_array(picture: ImageRgb) -> Array3<f32> {
    let shape = (picture.height(), picture.width(), 3);
    Array3::from_shape_vec(shape, picture.into_data()).expect("3 values for each pixel")
}

#[pymethods]
impl Frame {
    /// [h, w, 3] float32 in [0, 1]; pixels that no photo covers are filled from their surroundings.
    #[getter]
    fn picture<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        Ok(picture_array(compute(py, || Ok(self.frame.picture()))?).into_pyarray(py))
    }

    /// The picture as it was composited, [h, w, 3] float32; black where no photo covers any layer.
    #[getter]
    fn raw<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f32>> {
        self.frame.raw().as_array().to_pyarray(py)
    }

    /// [h, w] float32, 1/scene unit.
    #[getter]
    fn disparity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        self.frame.disparity.to_pyarray(py)
    }

    /// [h, w] float32: the share of each pixel that no photo covers, in [0, 1].
    #[getter]
    fn transmittance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        self.frame.transmittance.to_pyarray(py)
    }

    /// The share of the picture that no photo covers.
    #[getter]
    fn uncovered(&self) -> f64 {
        self.frame.uncovered_share()
    }

    /// The share of the pixels that are hidden in every photo, by the photos' own depth.
    #[getter]
    fn occluded(&self) -> f64 {
        self.frame.occluded_pixels as f64 / self.frame.transmittance.len() as f64
    }

    /// Seconds of each stage: depth, selection (of a live session photos, layers), warp, network,
    /// composite.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seconds = PyDict::new(py);
        self.times.iter().try_for_each(|(stage, time)| seconds.set_item(stage, time.as_secs_f64()))?;
        Ok(seconds)
    }

    /// Writes the picture, as `liveview render` does: JPEG for .jpg, else PNG.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        compute(py, || save_picture(&self.frame.picture(), &path).map_err(library))
    }

    fn __repr__(&self) -> String {
        format!("Frame({:?}, {}, {:.1} % uncovered)", self.name, self.frame.raw().size(), 100.0 * self.uncovered())
    }
}

/// The pictures of a path; each is rendered when it is asked for.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Frames {
    pub(crate) engine: Arc<Engine>,
    pub(crate) shots: Vec<Shot>,
    pub(crate) progress: Mutex<Progress>,
}

/// What is done of a path.
#[derive(Default)]
pub(crate) struct Progress {
    /// Index of the next shot.
    next: usize,
    /// The planes that the first shot selects, as in the paper's video.
    selected: Option<Layers>,
}

impl Progress {
    /// Renders a shot on the path's planes.
    fn render(&mut self, synthesizer: &mut Synthesizer, shots: &[Shot], index: usize) -> PyResult<Frame> {
        let selects = matches!(synthesizer.layers(), LayerSpec::Select { .. });
        if selects && index > 0 && self.selected.is_none() {
            self.render(synthesizer, shots, 0)?;
        }
        let (shot, known) = (&shots[index], self.selected.clone().map(Plan::known));
        let (frame, plan) = rendered(synthesizer, shot, &shots[index + 1..], known)?;
        if selects {
            self.selected.get_or_insert(plan.layers);
        }
        Ok(frame)
    }
}

#[pymethods]
impl Frames {
    fn __iter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __len__(&self) -> usize {
        self.shots.len()
    }

    /// Any frame of the path, the same as when it is reached one after the other.
    fn __getitem__(&self, py: Python<'_>, index: usize) -> PyResult<Frame> {
        if index >= self.shots.len() {
            return Err(PyIndexError::new_err(format!("frame {index}: the path has {}", self.shots.len())));
        }
        self.engine.with(py, |synthesizer| {
            let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
            progress.render(synthesizer, &self.shots, index)
        })
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        // All under the engine's lock, so that threads get different frames on the same planes.
        self.engine.with(py, |synthesizer| {
            let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
            let next = progress.next;
            if next == self.shots.len() {
                return Ok(None);
            }
            let found = progress.render(synthesizer, &self.shots, next)?;
            // A frame that failed, or that an interrupt drops, comes again.
            progress.next += usize::from(!self.engine.is_interrupted());
            Ok(Some(found))
        })
    }
}
