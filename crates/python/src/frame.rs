//! A rendered picture.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use liveview::geometry::Size;
use liveview::{ImageRgb, Layers};
use liveview_scene::save_picture;
use liveview_synthesizer::{LayerSpec, Plan, Shot, Synthesizer};
use ndarray::{Array3, Ix3};
use numpy::{IntoPyArray, PyArray2, PyArray3};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::{Sides, library};
use crate::engine::{Engine, compute, rendered};

/// A rendered picture.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Frame {
    /// The target's.
    #[pyo3(get)]
    name: String,
    size: Size,
    /// [h, w, 3] float32 in [0, 1]; pixels that no photo covers are filled from their surroundings.
    #[pyo3(get)]
    picture: Py<PyArray3<f32>>,
    /// The picture as it was composited, [h, w, 3] float32; black where no photo covers any layer.
    #[pyo3(get)]
    raw: Py<PyArray3<f32>>,
    /// [h, w] float32, 1/scene unit.
    #[pyo3(get)]
    disparity: Py<PyArray2<f32>>,
    /// [h, w] float32: the share of each pixel that no photo covers, in [0, 1].
    #[pyo3(get)]
    transmittance: Py<PyArray2<f32>>,
    /// The share of the picture that no photo covers.
    #[pyo3(get)]
    uncovered: f64,
    /// The share of the pixels that are hidden in every photo, by the photos' own depth.
    #[pyo3(get)]
    occluded: f64,
    /// Seconds of each stage: depth, selection (of a live session photos, layers), warp, network,
    /// composite.
    #[pyo3(get)]
    times: Py<PyDict>,
}

/// Wall time of each stage, seconds.
pub(crate) type Times = Vec<(&'static str, Duration)>;

/// Wall time of each stage of a picture.
pub(crate) fn times(plan: &Plan, frame: &liveview::Frame) -> Times {
    let stages = [("depth", plan.search), ("selection", plan.selection)];
    stages.into_iter().chain(rendering(frame)).collect()
}

/// Wall time of the stages of rendering.
pub(crate) fn rendering(frame: &liveview::Frame) -> [(&'static str, Duration); 3] {
    [("warp", frame.times.warp), ("network", frame.times.network), ("composite", frame.times.composite)]
}

impl Frame {
    /// The arrays of a frame, which are not copied.
    pub(crate) fn new(py: Python<'_>, name: String, frame: liveview::Frame, times: Times) -> PyResult<Self> {
        let seconds = PyDict::new(py);
        for (stage, time) in times {
            seconds.set_item(stage, time.as_secs_f64())?;
        }
        let (uncovered, pixels) = (frame.uncovered_share(), frame.transmittance.len() as f64);
        Ok(Self {
            name,
            size: frame.raw().size(),
            uncovered,
            occluded: frame.occluded_pixels as f64 / pixels,
            picture: picture_array(frame.picture()).into_pyarray(py).unbind(),
            raw: frame.raw().as_array().to_owned().into_pyarray(py).unbind(),
            disparity: frame.disparity.into_pyarray(py).unbind(),
            transmittance: frame.transmittance.into_pyarray(py).unbind(),
            times: seconds.unbind(),
        })
    }
}

/// A picture as an array `[h, w, 3]`, without a copy.
pub(crate) fn picture_array(picture: ImageRgb) -> Array3<f32> {
    let shape = (picture.height(), picture.width(), 3);
    Array3::from_shape_vec(shape, picture.into_data()).expect("3 values for each pixel")
}

#[pymethods]
impl Frame {
    /// Writes the picture, as `liveview render` does: JPEG for .jpg, else PNG.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let picture = Sides::default().array::<f32, Ix3>("picture", self.picture.bind(py), "H W 3")?;
        let picture = picture.as_array().to_owned();
        compute(py, || {
            ImageRgb::from_array(picture.view())
                .map_err(library)
                .and_then(|picture| save_picture(&picture, &path).map_err(library))
        })
    }

    fn __repr__(&self) -> String {
        format!("Frame({:?}, {}, {:.1} % uncovered)", self.name, self.size, 100.0 * self.uncovered)
    }
}

/// The pictures of a path; each is rendered when it is asked for.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Frames {
    engine: Arc<Engine>,
    shots: Vec<Shot>,
    progress: Mutex<Progress>,
}

/// What is done of a path.
#[derive(Default)]
struct Progress {
    /// Index of the next shot.
    next: usize,
    /// The planes that the first shot selects, as in the paper's video.
    selected: Option<Layers>,
}

impl Progress {
    /// Renders a shot on the path's planes.
    fn render(
        &mut self,
        synthesizer: &mut Synthesizer,
        shots: &[Shot],
        index: usize,
    ) -> PyResult<(String, liveview::Frame, Times)> {
        let selects = matches!(synthesizer.layers(), LayerSpec::Select { .. });
        if selects && index > 0 && self.selected.is_none() {
            self.render(synthesizer, shots, 0)?;
        }
        let (shot, known) = (&shots[index], self.selected.clone().map(Plan::known));
        let (frame, plan, times) = rendered(synthesizer, shot, &shots[index + 1..], known)?;
        if selects {
            self.selected.get_or_insert(plan.layers);
        }
        Ok((shot.name.clone(), frame, times))
    }
}

impl Frames {
    pub(crate) fn new(engine: Arc<Engine>, shots: Vec<Shot>) -> Self {
        Self { engine, shots, progress: Mutex::default() }
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
        let found = self.engine.with(py, |synthesizer| {
            let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
            progress.render(synthesizer, &self.shots, index)
        })?;
        let (name, frame, times) = found;
        Frame::new(py, name, frame, times)
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        // All under the engine's lock, so that threads get different frames on the same planes.
        let found = self.engine.with(py, |synthesizer| {
            let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
            let next = progress.next;
            if next == self.shots.len() {
                return Ok(None);
            }
            let found = progress.render(synthesizer, &self.shots, next)?;
            // A frame that failed, or that an interrupt drops, comes again.
            progress.next += usize::from(!self.engine.is_interrupted());
            Ok(Some(found))
        })?;
        found.map(|(name, frame, times)| Frame::new(py, name, frame, times)).transpose()
    }
}
