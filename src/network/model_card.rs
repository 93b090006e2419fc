//! The model card: a model's metadata.

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
    /// The layers that it was trained for, as the text of a [`LayerSpec`].
    pub recommended_layers: String,
    /// The kinds of layers that it can be used for, such as `planes` and `select`
    /// ([`LayerSpec::kind`]); empty: all.
    pub layer_kinds: Vec<String>,
    /// How layers were composited when it was trained.
    pub alpha: AlphaKind,
    /// The scale of competing layers; `None`: it was not trained for them.
    pub alpha_scale: Option<f64>,
    /// The upper limit of [`Alpha::PerPixel`], pixels of parallax; `None`: it was not trained for
    /// it.
    pub alpha_spacing: Option<f64>,
    /// Precision of the weights and of the arithmetic on them: `f32`, or `int8` for a quantised
    /// model.
    pub precision: String,
    /// How it was trained, in a line.
    pub training: String,
    /// Licence of the weights and of the data they were trained on.
    pub licence: String,
}

impl ModelCard {
    /// How to composite its layers: as `requested`, by default as it was trained.
    pub fn alpha(&self, requested: Option<AlphaKind>) -> Alpha {
        match requested.unwrap_or(self.alpha) {
            AlphaKind::Independent => {
                self.alpha_spacing.map_or(Alpha::Independent, |max_spacing| Alpha::PerPixel { max_spacing })
            }
            AlphaKind::Competing => Alpha::Competing { scale: self.alpha_scale.unwrap_or(Alpha::UNTRAINED_SCALE) },
        }
    }

    /// Whether it can be used for these layers.
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
    let positive = |key: &str| {
        let number = |text: &String| text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
        let read = |found| number(&found).ok_or_else(|| wrong(key, Some(found), "a positive, finite number"));
        entry(key).map(read).transpose()
    };
    let alpha_scale = positive("alpha_scale")?.or((alpha == AlphaKind::Competing).then_some(1.0));
    let kinds = entry("layer_kinds").unwrap_or_default();
    Ok(ModelCard {
        views: count.ok_or_else(|| wrong("views", Some(views), "a whole number, 2 to 64"))?,
        recommended_layers: text("recommended_layers")?,
        layer_kinds: kinds.split(',').map(|kind| kind.trim().to_owned()).filter(|kind| !kind.is_empty()).collect(),
        alpha,
        alpha_scale,
        alpha_spacing: positive("alpha_spacing")?,
        precision: entry("precision").unwrap_or_else(|| "f32".into()),
        training: text("training")?,
        licence: text("licence")?,
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
        let spaced = read(&[("alpha_spacing", "3.0")]).unwrap();
        assert_eq!(
            [spaced.alpha(None), spaced.alpha(Some(AlphaKind::Competing))],
            [Alpha::PerPixel { max_spacing: 3.0 }, competing(2.0)]
        );
        for (entry, expected) in [
            (("alpha", "Competing"), "metadata `alpha` is Competing, expected \"independent\" or \"competing\""),
            (("alpha_scale", "0"), "metadata `alpha_scale` is 0, expected a positive, finite number"),
            (("alpha_spacing", "-1"), "metadata `alpha_spacing` is -1, expected a positive, finite number"),
            (("alpha_scale", "inf"), "metadata `alpha_scale` is inf, expected a positive, finite number"),
        ] {
            let message = read(&[entry]).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn layer_kinds_of_a_card_limit_its_layers() {
        let card = read(&[("layer_kinds", "planes, select")]).unwrap();
        let is_for = |layers: &str| card.is_for(&layers.parse().unwrap());
        assert!(is_for("planes:3") && is_for("select:3") && !is_for("guided:2") && !is_for("list:1"));
        assert!(read(&[]).unwrap().is_for(&LayerSpec::Surface(1)));
    }
}
