//! The summary of the model and of ONNX Runtime, as text and as JSON.

use std::path::Path;

use liveview_synthesizer::Model;
use serde_json::{Value, json};

use crate::console::{counted, escaped, path_text};

/// The model, if any, and how it is run.
#[derive(Debug)]
pub(crate) struct ModelInfo {
    /// `None` without a network.
    pub(crate) model: Option<Model>,
    /// Number of threads of the network and of everything else.
    pub(crate) threads: usize,
    /// Layers per run of the network.
    pub(crate) batch: usize,
}

impl ModelInfo {
    /// The model file.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.model.as_ref().map(|model| &*model.path)
    }

    /// The name of the stage that computes opacities and view weights: `network`, or `blend`
    /// without one.
    pub(crate) fn weighting_stage(&self) -> &'static str {
        if self.model.is_some() { "network" } else { "blend" }
    }

    /// Execution provider and precision, such as `openvino, int8`, or `no network`.
    pub(crate) fn engine(&self) -> String {
        let engine = |model: &Model| format!("{}, {}", model.provider, model.precision);
        self.model.as_ref().map_or_else(|| "no network".into(), engine)
    }

    /// As lines of text.
    pub(crate) fn text(&self) -> String {
        let Some(model) = &self.model else {
            return format!("network none: views weighted by distance and agreement, {} threads\n", self.threads);
        };
        format!(
            "engine  ONNX Runtime ({}), {} {}, {} threads, {} per run\nmodel   {}: {}\nalpha   {}\n",
            escaped(&path_text(model.library.file_name().unwrap_or_default().as_ref())),
            model.provider,
            escaped(&model.precision),
            self.threads,
            counted(self.batch, "layer"),
            escaped(&path_text(&model.path)),
            escaped(&model.card.training),
            model.alpha
        )
    }

    /// As JSON.
    pub(crate) fn json(&self) -> Value {
        let Some(model) = &self.model else {
            return json!({ "model": null, "engine": { "name": "none", "threads": self.threads, "batch": self.batch } });
        };
        let card = &model.card;
        json!({
            "model": {
                "file": path_text(&model.path), "views": card.views, "recommended_layers": card.recommended_layers,
                "training": card.training, "licence": card.licence,
            },
            "alpha": model.alpha.to_string(),
            "engine": {
                "name": "ONNX Runtime", "library": path_text(&model.library), "provider": model.provider.name(),
                "precision": model.precision, "threads": self.threads, "batch": self.batch,
            },
        })
    }
}
