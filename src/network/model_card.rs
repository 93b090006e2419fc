//! The model card: a model's metadata, among it how its layers share a pixel.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use super::{NetworkError, unfit};
use crate::layers::STRIDE;

/// How the layers of a pixel share it, given their logits 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Alpha {
    /// The paper's: the α of a layer is sigmoid(logit 0), independent of the other layers, and
    /// layers are composited front to back.
    #[default]
    Independent,
    /// The weights of a pixel are the softmax of scale · logit 0 over the layers that cover it, so
    /// that faint false surfaces cannot accumulate into haze. Not in the paper. Still an MPI: the α
    /// of a layer is its weight divided by what the nearer layers leave.
    Competing {
        /// What the logits are multiplied by: positive, finite.
        scale: f64,
    },
}

impl Alpha {
    /// The scale of competing layers for a network that was not trained for them; measured in
    /// docs/design-log/planes.md.
    pub const UNTRAINED_SCALE: f64 = 2.0;

    /// Whether each layer has its own opacity, independent of the other layers.
    pub fn is_independent(self) -> bool {
        matches!(self, Self::Independent)
    }
}

impl fmt::Display for Alpha {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Independent => write!(f, "independent"),
            Self::Competing { scale } => write!(f, "competing, scale {scale}"),
        }
    }
}

/// The name of an [`Alpha`] in options and model cards: without its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AlphaKind {
    /// [`Alpha::Independent`].
    Independent,
    /// [`Alpha::Competing`].
    Competing,
}

impl FromStr for AlphaKind {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "independent" => Ok(Self::Independent),
            "competing" => Ok(Self::Competing),
            _ => Err("\"independent\" or \"competing\""),
        }
    }
}

/// A model's metadata.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ModelCard {
    /// V, the number of views in its input.
    pub views: usize,
    /// The layers that it was trained for, as text such as `planes:64`; `surface` and `guided` are found by
    /// the package `liveview-synthesizer`.
    pub recommended_layers: String,
    /// The kinds of layers that it can be used for, such as `planes` and `select`; empty: all.
    pub layer_kinds: Vec<String>,
    /// How layers were composited when it was trained.
    pub alpha: AlphaKind,
    /// The scale of competing layers; `None`: it was not trained for them.
    pub alpha_scale: Option<f64>,
    /// Precision of the weights and of the arithmetic on them: `f32`, or `int8` for a quantised
    /// model.
    pub precision: String,
    /// How it was trained, in a line; may be empty.
    pub training: String,
    /// Licence of the weights and of the data they were trained on; may be empty.
    pub licence: String,
}

impl ModelCard {
    /// How to composite its layers: as `requested`, by default as it was trained.
    pub fn alpha(&self, requested: Option<AlphaKind>) -> Alpha {
        match requested.unwrap_or(self.alpha) {
            AlphaKind::Independent => Alpha::Independent,
            AlphaKind::Competing => Alpha::Competing { scale: self.alpha_scale.unwrap_or(Alpha::UNTRAINED_SCALE) },
        }
    }

    /// Whether it can be used for layers of that kind.
    pub fn is_for(&self, layers: &str) -> bool {
        self.layer_kinds.is_empty() || self.layer_kinds.iter().any(|kind| kind == layers)
    }
}

/// Reads the card from the entries of the metadata; `path` is for errors.
pub(crate) fn read_card(path: &Path, entry: impl Fn(&str) -> Option<String>) -> Result<ModelCard, NetworkError> {
    let wrong = |key: &str, found: Option<String>, expected: &str| {
        unfit(path, format!("metadata `{key}`"), found.unwrap_or_else(|| "missing".into()), expected)
    };
    let missing: Vec<&str> =
        ["views", "stride", "recommended_layers"].into_iter().filter(|key| entry(key).is_none()).collect();
    if !missing.is_empty() {
        return Err(wrong(&missing.join("`, `"), None, "all of views, stride and recommended_layers"));
    }
    let text = |key: &str| entry(key).unwrap_or_default();
    let views = text("views");
    let count = views.parse().ok().filter(|v| (2..=64).contains(v));
    let stride = text("stride");
    if stride != STRIDE.to_string() {
        return Err(wrong("stride", Some(stride), &STRIDE.to_string()));
    }
    let alpha = entry("alpha").map_or(Ok(AlphaKind::Independent), |found| {
        found.parse().map_err(|expected| wrong("alpha", Some(found), expected))
    })?;
    let positive = |key: &str| {
        let number = |text: &String| text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
        let read = |found| number(&found).ok_or_else(|| wrong(key, Some(found), "a positive, finite number"));
        entry(key).map(read).transpose()
    };
    let alpha_scale = positive("alpha_scale")?.or((alpha == AlphaKind::Competing).then_some(1.0));
    let kinds = entry("layer_kinds").unwrap_or_default();
    Ok(ModelCard {
        views: count.ok_or_else(|| wrong("views", Some(views), "a whole number, 2 to 64"))?,
        recommended_layers: text("recommended_layers"),
        layer_kinds: kinds.split(',').map(|kind| kind.trim().to_owned()).filter(|kind| !kind.is_empty()).collect(),
        alpha,
        alpha_scale,
        precision: entry("precision").unwrap_or_else(|| "f32".into()),
        training: text("training"),
        licence: text("licence"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(more: &[(&str, &str)]) -> Result<ModelCard, String> {
        let needed =
            [("views", "4"), ("stride", "8"), ("recommended_layers", "planes:64"), ("training", "-"), ("licence", "-")];
        let entry =
            |key: &str| needed.iter().chain(more).find(|(name, _)| *name == key).map(|(_, value)| (*value).to_owned());
        read_card(Path::new("m.onnx"), entry).map_err(|error| error.to_string())
    }

    #[test]
    fn alpha_of_a_card_is_as_trained_unless_requested_otherwise() {
        let competing = |scale| Alpha::Competing { scale };
        for (entries, expected) in [
            (&[][..], [Alpha::Independent, competing(2.0)]),
            (&[("alpha", "competing")], [competing(1.0); 2]),
            (&[("alpha", "competing"), ("alpha_scale", "1.5")], [competing(1.5); 2]),
            (&[("alpha", "independent"), ("alpha_scale", "3")], [Alpha::Independent, competing(3.0)]),
        ] {
            let card = read(entries).unwrap();
            assert_eq!([card.alpha(None), card.alpha(Some(AlphaKind::Competing))], expected, "{entries:?}");
            assert_eq!(card.alpha(Some(AlphaKind::Independent)), Alpha::Independent);
        }
        for (entry, expected) in [
            (("alpha", "Competing"), "metadata `alpha` is Competing, expected \"independent\" or \"competing\""),
            (("alpha_scale", "0"), "metadata `alpha_scale` is 0, expected a positive, finite number"),
            (("alpha_scale", "inf"), "metadata `alpha_scale` is inf, expected a positive, finite number"),
        ] {
            let message = read(&[entry]).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
        let message = read(&[("alpha", &"é".repeat(1 << 20))]).unwrap_err();
        assert!(message.contains(&format!("is {}…, expected", "é".repeat(80))), "{} bytes", message.len());
    }

    #[test]
    fn all_missing_keys_are_in_one_message_and_others_are_optional() {
        let read = |keys: &[&str]| {
            let entry = |key: &str| keys.contains(&key).then(|| "8".to_owned());
            read_card(Path::new("m.onnx"), entry).map_err(|error| error.to_string())
        };
        let message = read(&["views"]).unwrap_err();
        assert!(message.contains("metadata `stride`, `recommended_layers` is missing"), "{message}");
        assert_eq!(read(&["views", "stride", "recommended_layers"]).unwrap().licence, "");
    }

    #[test]
    fn layer_kinds_of_a_card_limit_its_layers() {
        let card = read(&[("layer_kinds", "planes, select")]).unwrap();
        assert!(card.is_for("planes") && card.is_for("select") && !card.is_for("guided") && !card.is_for("list"));
        assert!(read(&[]).unwrap().is_for("surface"));
    }
}
