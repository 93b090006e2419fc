//! The model card: what a model's metadata says about it.

use std::path::Path;

use super::error::{NetworkError, unfit};
use crate::layers::STRIDE;

/// A model's metadata.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ModelCard {
    /// V, the number of views in its input.
    pub views: usize,
    /// The layers that it was made for, as a [`crate::layers::LayerSpec`].
    pub recommended_layers: String,
    /// Precision of the weights and of the arithmetic on them: `f32`, or `int8` for a quantised model.
    pub precision: String,
    /// How it was trained, in a line.
    pub training: String,
    /// Licence of the weights and of the data they were trained on.
    pub licence: String,
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
    Ok(ModelCard {
        views: count.ok_or_else(|| wrong("views", Some(views), "a whole number, 2 to 64"))?,
        recommended_layers: text("recommended_layers")?,
        precision: entry("precision").unwrap_or_else(|| "f32".into()),
        training: text("training")?,
        licence: text("licence")?,
    })
}
