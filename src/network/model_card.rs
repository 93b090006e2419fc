//! The model card: what a model's metadata says about it.

use std::path::Path;

use super::alpha::{Alpha, AlphaKind};
use super::error::{NetworkError, unfit};
use crate::layers::{LayerSpec, STRIDE};

/// A model's metadata.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ModelCard {
    /// V, the number of views in its input.
    pub views: usize,
    /// The layers that it was made for, as a [`crate::layers::LayerSpec`].
    pub recommended_layers: String,
    /// The kinds of layers that it is for, such as `planes` and `kmeans` ([`LayerSpec::kind`]); empty: all.
    pub layer_kinds: Vec<String>,
    /// How layers were composited when it was trained.
    pub alpha: AlphaKind,
    /// The scale of competing layers; `None`: it was not trained for these.
    pub alpha_scale: Option<f64>,
    /// Precision of the weights and of the arithmetic on them: `f32`, or `int8` for a quantised model.
    pub precision: String,
    /// How it was trained, in a line.
    pub training: String,
    /// Licence of the weights and of the data they were trained on.
    pub licence: String,
}

impl ModelCard {
    /// How to composite its layers: as it was trained unless `asked` otherwise.
    pub fn alpha(&self, asked: Option<AlphaKind>) -> Alpha {
        match asked.unwrap_or(self.alpha) {
            AlphaKind::Independent => Alpha::Independent,
            AlphaKind::Competing => Alpha::Competing { scale: self.alpha_scale.unwrap_or(Alpha::UNTRAINED_SCALE) },
        }
    }

    /// Whether it is for such layers.
    pub fn is_for(&self, layers: &LayerSpec) -> bool {
        self.layer_kinds.is_empty() || self.layer_kinds.iter().any(|kind| kind == layers.kind())
    }
}

/// Reads the card from the entries of the metadata; `path` is for errors.
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
    let alpha = entry("alpha").map_or(Ok(AlphaKind::Independent), |found| {
        found.parse().map_err(|expected| wrong("alpha", Some(found), expected))
    })?;
    let scale = |text: &String| text.parse().ok().filter(|scale: &f64| scale.is_finite() && *scale > 0.0);
    let alpha_scale = match entry("alpha_scale") {
        Some(found) => {
            Some(scale(&found).ok_or_else(|| wrong("alpha_scale", Some(found), "a positive, finite number"))?)
        }
        None if alpha == AlphaKind::Competing => Some(1.0),
        None => None,
    };
    let kinds = entry("layer_kinds").unwrap_or_default();
    Ok(ModelCard {
        views: count.ok_or_else(|| wrong("views", Some(views), "a whole number, 2 to 64"))?,
        recommended_layers: text("recommended_layers")?,
        layer_kinds: kinds.split(',').map(|kind| kind.trim().to_owned()).filter(|kind| !kind.is_empty()).collect(),
        alpha,
        alpha_scale,
        precision: entry("precision").unwrap_or_else(|| "f32".into()),
        training: text("training")?,
        licence: text("licence")?,
    })
}
