//! The frames of a path.

use std::sync::{Arc, Mutex, PoisonError};

use liveview::Layers;
use liveview_synthesizer::{LayerSpec, Plan, Shot, Synthesizer};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

use crate::engine::{Engine, rendered};
use crate::frame::{Frame, Times};

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
