//! Ends the runs of ONNX Runtime from another thread.

use std::fmt;
use std::sync::Arc;

use ort::session::RunOptions;

/// Ends a network's runs from another thread.
#[derive(Clone)]
pub struct RunEnd(pub(super) Arc<RunOptions>);

impl fmt::Debug for RunEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("RunEnd")
    }
}

impl RunEnd {
    /// Ends the current run, if there is one, and makes every later run fail, with
    /// [`super::NetworkError::OnnxRuntime`]. Execution providers other than
    /// [`super::ExecutionProvider::Cpu`] may finish the current run.
    pub fn end(&self) {
        // ONNX Runtime's function cannot fail.
        let _ = self.0.terminate();
    }
}
