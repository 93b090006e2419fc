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

    /// Locked for a moment only: a thread that waits for it may hold the interpreter.
    fn with<T>(&self, change: impl FnOnce(&mut Progress) -> T) -> T {
        change(&mut self.progress.lock().unwrap_or_else(PoisonError::into_inner))
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
        let (index, selected) = self.with(|progress| {
            progress.next += 1;
            (progress.next - 1, progress.selected.clone())
        });
        let Some(shot) = self.shots.get(index) else { return Ok(None) };
        let (later, known) = (&self.shots[index + 1..], selected.map(Plan::known));
        let (frame, times) = self.engine.with(py, |synthesizer| {
            let (frame, plan, times) = rendered(synthesizer, shot, later, known)?;
            if matches!(synthesizer.layers(), LayerSpec::Select { .. }) {
                self.with(|progress| progress.selected.get_or_insert(plan.layers).len());
            }
            Ok((frame, times))
        })?;
        Frame::new(py, shot.name.clone(), frame, times).map(Some)
    }
}
