//! Why a model was refused, or a network failed.

use std::path::{Path, PathBuf};

/// Why a model was refused, or a network failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The file is not a LiveView model, or not one for the input given.
    #[error("{path}: {field} is {found}, expected {expected}", path = path.display())]
    Unfit {
        /// The model file.
        path: PathBuf,
        /// Which input, output or metadata entry.
        field: String,
        /// What the model has.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// ONNX Runtime refused the file or failed while running it.
    #[error("{path}: ONNX Runtime: {reason}", path = path.display())]
    OnnxRuntime {
        /// The model file.
        path: PathBuf,
        /// ONNX Runtime's message.
        reason: String,
    },
}

pub(super) fn unfit(path: &Path, field: impl Into<String>, found: String, expected: impl Into<String>) -> NetworkError {
    NetworkError::Unfit { path: path.to_path_buf(), field: field.into(), found, expected: expected.into() }
}
