//! The network: a homography warped volume in, logits out (paper, section "Neural Network").
//!
//! [`PlaneNetwork`] is the interface; [`OrtNetwork`] runs a LiveView model with ONNX Runtime.

mod execution_provider;
mod model_card;
mod ort;
mod ort_library;

use std::path::{Path, PathBuf};

use ndarray::{ArrayView4, ArrayViewMut4};

#[cfg(feature = "fuzzing")]
pub(crate) use self::ort::check_outlets;
pub use self::ort::{OrtNetwork, RunEnd};
pub use execution_provider::{ExecutionProvider, Precision, cpu_has_bf16};
#[cfg(feature = "fuzzing")]
pub(crate) use model_card::read_card;
pub use model_card::{Alpha, AlphaKind, ModelCard};
pub use ort_library::{OrtLibrary, OrtLibraryError};

/// Computes the logits of a batch of layers, each layer alone (paper, section "Neural Network").
pub trait PlaneNetwork: Send {
    /// V, the number of views in its input.
    fn views(&self) -> usize;

    /// `hwv` `[n, 3V, h, w]` (views nearest first, RGB in [0, 1], zeros outside the photos; h and w
    /// are multiples of [`crate::layers::STRIDE`]) and its `coverage` `[n, V, h, w]` (0 where a view does
    /// not see the layer, 1 where it does) → `logits` `[n, V, h, w]` (logit 0: opacity; 1 to V − 1: the weight of
    /// these views against the first), all in standard layout.
    ///
    /// # Errors
    ///
    /// [`NetworkError`] if the network cannot be run.
    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        coverage: ArrayView4<'_, f32>,
        logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError>;

    /// Its name in messages: the path of its file, if it has one.
    fn name(&self) -> String {
        "the network".to_owned()
    }
}

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

fn unfit(path: &Path, field: impl Into<String>, mut found: String, expected: impl Into<String>) -> NetworkError {
    // Metadata may be of any length.
    if let Some((end, _)) = found.char_indices().nth(MAX_QUOTED) {
        found.truncate(end);
        found.push('…');
    }
    NetworkError::Unfit { path: path.to_path_buf(), field: field.into(), found, expected: expected.into() }
}

/// Characters of a model's text that an error repeats.
const MAX_QUOTED: usize = 80;

/// Refuses a directory, a pipe or a device, whose opening could block; the error says what it is.
fn check_file(path: &Path) -> Result<(), String> {
    match path.metadata() {
        Ok(about) if about.is_file() => Ok(()),
        Ok(about) if about.is_dir() => Err("a folder; expected a file".to_owned()),
        Ok(_) => Err("a pipe or a device; expected a regular file".to_owned()),
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.to_string()),
        Err(_) if path.is_symlink() => Err("a link to no file".to_owned()),
        Err(_) => Err("there is no such file".to_owned()),
    }
}
