//! What is told of the model and of ONNX Runtime, or of their absence.

use std::path::{Path, PathBuf};

use liveview::network::{Alpha, ExecutionProvider, ModelCard};
use serde_json::{Value, json};

use crate::console::shown;

/// What makes the pictures.
#[derive(Debug)]
pub struct ModelInfo {
    /// `None`: no network.
    pub model: Option<OpenedModel>,
    /// Threads of the network and of everything else.
    pub threads: usize,
    /// Layers that go through the network at once.
    pub batch: usize,
}

/// A model, and ONNX Runtime that runs it.
#[derive(Debug)]
pub struct OpenedModel {
    /// The model file.
    pub path: PathBuf,
    /// The metadata of the file.
    pub card: ModelCard,
    /// How the layers of a pixel share it.
    pub alpha: Alpha,
    /// The file of ONNX Runtime.
    pub library: PathBuf,
    /// What of ONNX Runtime computes.
    pub provider: ExecutionProvider,
    /// Precision of the arithmetic: f32, bf16 or int8.
    pub precision: String,
}

impl OpenedModel {
    /// Execution provider and precision, such as `openvino, int8`.
    pub fn provider_and_precision(&self) -> String {
        format!("{}, {}", self.provider, self.precision)
    }
}

impl ModelInfo {
    /// The model file.
    pub fn path(&self) -> Option<&Path> {
        self.model.as_ref().map(|model| &*model.path)
    }

    /// The name of the stage that computes opacities and view weights: `network`, or `blend` without one.
    pub fn weighting_stage(&self) -> &'static str {
        if self.model.is_some() { "network" } else { "blend" }
    }

    /// Execution provider and precision, or `no network`.
    pub fn engine(&self) -> String {
        self.model.as_ref().map_or_else(|| "no network".into(), OpenedModel::provider_and_precision)
    }

    /// The lines of a summary.
    pub fn text(&self) -> String {
        let Some(model) = &self.model else {
            return format!("network none: views weighed by distance and agreement, {} threads\n", self.threads);
        };
        format!(
            "engine  ONNX Runtime ({}), {} {}, {} threads, {} layers at once\nmodel   {}: {}\nalpha   {}\n",
            model.library.file_name().unwrap_or_default().display(),
            model.provider,
            model.precision,
            self.threads,
            self.batch,
            model.path.display(),
            model.card.training,
            model.alpha
        )
    }

    /// The same for `--json`.
    pub fn json(&self) -> Value {
        let Some(model) = &self.model else {
            return json!({ "model": null, "engine": { "name": "none", "threads": self.threads, "batch": self.batch } });
        };
        let card = &model.card;
        json!({
            "model": {
                "file": shown(&model.path), "views": card.views, "recommended_layers": card.recommended_layers,
                "training": card.training, "licence": card.licence,
            },
            "alpha": model.alpha.to_string(),
            "engine": {
                "name": "ONNX Runtime", "library": shown(&model.library), "provider": model.provider.name(),
                "precision": model.precision, "threads": self.threads, "batch": self.batch,
            },
        })
    }
}
