//! Models and their cards.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use liveview::network::{ExecutionProvider, ModelCard, OrtLibrary, OrtNetwork};
use liveview_synthesizer::{SynthesisError, recommended_layers};
use serde_json::{Value, json};

use crate::args::model::ModelArgs;
use crate::args::output::has_extension;
use crate::console::{Output, escaped, path_text};

/// The models in a folder, by name.
pub(super) fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut models: Vec<PathBuf> = entries.filter(|file| has_extension(file, &["onnx"])).collect();
    models.sort();
    models
}

/// The card of a model.
pub(super) fn one(file: &Path, args: &ModelArgs) -> Result<Output> {
    let card = card(&library(args)?, file)?;
    Ok(Output { text: card_text(&escaped(&path_text(file)), &card), json: card_json(file, &card) })
}

/// The cards of all models in a folder.
pub(super) fn all(folder: &Path, args: &ModelArgs) -> Result<Output> {
    let library = library(args)?;
    let (mut text, mut models) = (String::new(), Vec::new());
    for file in files(folder) {
        let name = escaped(&path_text(&file));
        match card(&library, &file) {
            Ok(card) => {
                text += &card_text(&name, &card);
                models.push(card_json(&file, &card));
            }
            Err(error) => {
                let _ = writeln!(text, "{name}\n  cannot be used: {}", escaped(&error.to_string()));
                models.push(json!({ "file": path_text(&file), "error": error.to_string() }));
            }
        }
    }
    Ok(Output { text, json: json!({ "folder": path_text(folder), "models": models }) })
}

fn library(args: &ModelArgs) -> Result<OrtLibrary> {
    let provider = ExecutionProvider::Cpu;
    Ok(OrtLibrary::load(provider, args.library(provider).as_deref()).map_err(SynthesisError::from)?)
}

/// The card of a model; an error if it cannot be opened or has no layers.
fn card(library: &OrtLibrary, file: &Path) -> Result<ModelCard, SynthesisError> {
    let network = OrtNetwork::open(library, file, 1)?;
    recommended_layers(&network)?;
    Ok(network.card().clone())
}

fn card_text(file: &str, card: &ModelCard) -> String {
    let kinds = if card.layer_kinds.is_empty() { "all".to_owned() } else { card.layer_kinds.join(", ") };
    format!(
        "{file}\n  views       {}\n  precision   {}\n  layers      {}, recommended {}\n  alpha       {}\n  training    {}\n  licence     {}\n",
        card.views,
        escaped(&card.precision),
        escaped(&kinds),
        escaped(&card.recommended_layers),
        card.alpha(None),
        escaped(&card.training),
        escaped(&card.licence)
    )
}

fn card_json(file: &Path, card: &ModelCard) -> Value {
    json!({
        "file": path_text(file), "views": card.views, "precision": card.precision, "layer_kinds": card.layer_kinds,
        "recommended_layers": card.recommended_layers, "alpha": card.alpha(None).to_string(),
        "training": card.training, "licence": card.licence,
    })
}
