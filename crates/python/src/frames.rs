//! The frames of a path, one after the other.

use std::sync::{Mutex, PoisonError};

use liveview::Shot;
use pyo3::prelude::*;

use crate::frame::Frame;
use crate::synthesizer::{Synthesizer, rendered};

/// The pictures of a path; each is rendered when it is asked for.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Frames {
    synthesizer: Py<Synthesizer>,
    shots: Vec<Shot>,
    next: Mutex<usize>,
}

impl Frames {
    pub(crate) fn new(synthesizer: Py<Synthesizer>, shots: Vec<Shot>) -> Self {
        Self { synthesizer, shots, next: Mutex::default() }
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
        let index = {
            let mut next = self.next.lock().unwrap_or_else(PoisonError::into_inner);
            *next += 1;
            *next - 1
        };
        let Some(shot) = self.shots.get(index) else { return Ok(None) };
        let later = &self.shots[index + 1..];
        let (frame, times) = self.synthesizer.get().with(py, |synthesizer| rendered(synthesizer, shot, later))?;
        Frame::new(py, shot.name.clone(), frame, times).map(Some)
    }
}
