//! A network without a scene.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use liveview::layers::STRIDE;
use liveview::network::{OrtNetwork, PlaneNetwork};
use liveview_synthesizer::Model;
use ndarray::{Array4, Ix4};
use numpy::{IntoPyArray, PyArray4, PyReadonlyArray};
use pyo3::prelude::*;

use crate::arguments::{Sides, whole};
use crate::error::{library, value};
use crate::model;
use crate::work::compute;

/// The network of a model file (.onnx): called with warped photos hwv [n, 3V, h, w] in [0, 1], it
/// returns logits [n, V, h, w]; h and w are multiples of 8. `threads`: one per core by default.
/// ONNX Runtime as for `Synthesizer`. A run is not ended by Ctrl-C.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct Network {
    network: Mutex<OrtNetwork>,
    /// V, photos to a picture.
    #[pyo3(get)]
    views: usize,
}

#[pymethods]
impl Network {
    #[new]
    #[pyo3(signature = (path, *, threads = None))]
    fn new(py: Python<'_>, path: PathBuf, threads: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let mut options = model::options(py, None, Some(path))?;
        options.threads = threads.map(|threads| whole("threads", threads)).transpose()?;
        let network = compute(py, || Model::open(&options, None).map_err(library))?.network;
        let views = network.views();
        Ok(Self { network: Mutex::new(network), views })
    }

    fn __call__<'py>(&self, py: Python<'py>, hwv: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray4<f32>>> {
        let shape = format!("n {} h w", 3 * self.views);
        let hwv: PyReadonlyArray<'py, f32, Ix4> = Sides::default().array("hwv", hwv, &shape)?;
        let hwv = hwv.as_array();
        let (n, _, height, width) = hwv.dim();
        if height % STRIDE != 0 || width % STRIDE != 0 {
            return Err(value("hwv", format!("{height} rows, {width} columns; expected multiples of {STRIDE}")));
        }
        let logits = compute(py, || {
            let mut logits = Array4::zeros((n, self.views, height, width));
            // Models do not look at it.
            let coverage = Array4::ones((n, self.views, height, width));
            let mut network = self.network.lock().unwrap_or_else(PoisonError::into_inner);
            network.infer(hwv, coverage.view(), logits.view_mut()).map_err(library)?;
            Ok(logits)
        })?;
        Ok(logits.into_pyarray(py))
    }
}
