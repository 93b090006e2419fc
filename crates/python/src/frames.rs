//! The frames of a path, one after the other.

use std::sync::{Arc, Mutex, PoisonError};

use liveview::{LayerSpec, Layers, Plan, Shot};
use pyo3::prelude::*;

use crate::engine::{Engine, rendered};
use crate::frame::Frame;

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

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        // All under the engine's lock, so that threads get different frames on the same planes.
        let found = self.engine.with(py, |synthesizer| {
            let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(shot) = self.shots.get(progress.next) else { return Ok(None) };
            let (later, known) = (&self.shots[progress.next + 1..], progress.selected.clone().map(Plan::known));
            let (frame, plan, times) = rendered(synthesizer, shot, later, known)?;
            if matches!(synthesizer.layers(), LayerSpec::Select { .. }) {
                progress.selected.get_or_insert(plan.layers);
            }
            // A frame that failed, or that an interrupt drops, comes again.
            progress.next += usize::from(!self.engine.is_interrupted());
            Ok(Some((shot.name.clone(), frame, times)))
        })?;
        found.map(|(name, frame, times)| Frame::new(py, name, frame, times)).transpose()
    }
}
