//! The network: a homography warped volume in, logits out. One trait, so that the pipeline can run without weights.

mod execution_provider;
mod model_file;
mod ort;
mod ort_library;

use std::path::{Path, PathBuf};

use ndarray::{ArrayView4, ArrayViewMut4};

pub use self::ort::{MAX_MODEL_BYTES, OrtNetwork};
pub use execution_provider::{ExecutionProvider, Precision, cpu_has_bf16};
pub use model_file::{ModelNotFound, find_model, model_folders};
pub use ort_library::{OrtLibrary, OrtLibraryError};

use crate::layers::STRIDE;

#[cfg(fuzzing)]
pub(crate) use self::ort::check_outlets;

/// Computes the logits of a batch of layers, each layer alone (paper, section "Neural Network").
pub trait PlaneNetwork {
    /// V: how many views its input holds.
    fn views(&self) -> usize;

    /// `hwv` `[n, 3V, h, w]` (views nearest first, RGB in [0, 1], zeros where nothing is seen; h and w multiples of
    /// [`STRIDE`]) → `logits` `[n, V, h, w]`, both in standard layout.
    fn infer(&mut self, hwv: ArrayView4<'_, f32>, logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError>;
}

/// Why a model was refused or failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The file does not hold a LiveView model for the views asked for.
    #[error("{path}: {field} is {found}, expected {expected}", path = path.display())]
    Unfit {
        /// The model file.
        path: PathBuf,
        /// Which input, output or metadata entry.
        field: String,
        /// What the model says.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// ONNX Runtime refused the file or failed while running it.
    #[error("{path}: ONNX Runtime: {reason}", path = path.display())]
    OnnxRuntime {
        /// The model file.
        path: PathBuf,
        /// What ONNX Runtime said.
        reason: String,
    },
}

/// What a model says about itself in its metadata.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelCard {
    /// V.
    pub views: usize,
    /// Layers that serve it best, a [`crate::layers::LayerSpec`].
    pub recommended_layers: String,
    /// Of the weights and of the arithmetic on them: `f32`, or `int8` for a quantised model.
    pub precision: String,
    /// How it was trained, in a line.
    pub training: String,
    /// Licence of the weights and of the data they were trained on.
    pub licence: String,
}

pub(super) fn unfit(path: &Path, field: impl Into<String>, found: String, expected: impl Into<String>) -> NetworkError {
    NetworkError::Unfit { path: path.to_path_buf(), field: field.into(), found, expected: expected.into() }
}

/// The card, from the metadata's entries.
pub(crate) fn read_card(path: &Path, entry: impl Fn(&str) -> Option<String>) -> Result<ModelCard, NetworkError> {
    let wrong = |key: &str, found: Option<String>, expected: &str| {
        unfit(path, format!("metadata `{key}`"), found.unwrap_or_else(|| "missing".into()), expected)
    };
    let text = |key: &str| entry(key).ok_or_else(|| wrong(key, None, "a text"));
    let views = text("views")?;
    let count = views.parse().ok().filter(|v| (2..=64).contains(v));
    let stride = text("stride")?;
    if stride != STRIDE.to_string() {
        return Err(wrong("stride", Some(stride), &STRIDE.to_string()));
    }
    Ok(ModelCard {
        views: count.ok_or_else(|| wrong("views", Some(views), "a whole number, 2 to 64"))?,
        recommended_layers: text("recommended_layers")?,
        precision: entry("precision").unwrap_or_else(|| "f32".into()),
        training: text("training")?,
        licence: text("licence")?,
    })
}
