//! Why a model was refused, or a network failed.

use std::path::{Path, PathBuf};

use super::threads::ThreadsError;

/// Why a model was refused, or a network failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The file is not a LiveView model, or not one for this input.
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
    /// The threads to run it on cannot be started.
    #[error("{path}: cannot be run: {source}", path = path.display())]
    Threads {
        /// The model file.
        path: PathBuf,
        /// Why.
        source: ThreadsError,
    },
    /// More than one logit in 10,000 is NaN or infinite.
    #[error(
        "{network}: {count} of {of} logits are NaN or infinite; expected finite numbers (a damaged model, or one for other input)"
    )]
    NotFinite {
        /// The network's name.
        network: String,
        /// How many logits are not finite.
        count: usize,
        /// How many logits there are in all.
        of: usize,
    },
}

pub(super) fn unfit(path: &Path, field: impl Into<String>, found: String, expected: impl Into<String>) -> NetworkError {
    NetworkError::Unfit { path: path.to_path_buf(), field: field.into(), found, expected: expected.into() }
}
