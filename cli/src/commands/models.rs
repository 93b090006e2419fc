//! `liveview models`: the installed models and their cards.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use liveview::SynthesisError;
use liveview::network::{ExecutionProvider, ModelCard, OrtLibrary, OrtNetwork, PlaneNetwork, model_folders};
use liveview_common::console::{Output, escaped, path_text};
use liveview_common::ort_wheel::wheel;
use serde_json::{Value, json};

/// Options of `liveview models`.
#[derive(Debug, Args)]
pub(crate) struct ModelsArgs {
    /// ONNX Runtime library [default: ORT_DYLIB_PATH, else the wheel in a .venv, else the system's]
    #[arg(long, value_name = "FILE")]
    ort_lib: Option<PathBuf>,
}

pub(crate) fn run(args: &ModelsArgs) -> Result<Output> {
    let provider = ExecutionProvider::Cpu;
    let library = args.ort_lib.clone().or_else(|| wheel(provider));
    let library = OrtLibrary::load(provider, library.as_deref()).map_err(SynthesisError::from)?;
    let mut folders = model_folders();
    if std::env::var_os("LIVEVIEW_MODELS").is_none_or(|folder| folder.is_empty()) {
        folders.push(std::env::current_dir().unwrap_or_default().join("models"));
    }
    let (mut text, mut models) = (String::new(), Vec::new());
    for file in files(&folders) {
        // A model that cannot be opened or has no layers is listed with the error.
        let network = OrtNetwork::open(&library, &file, 1);
        let card = network.and_then(|network| network.recommended_layers().map(|_| network.card().clone()));
        let name = escaped(&file.display().to_string());
        match card {
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
    let folders: Vec<String> = folders.iter().map(|folder| path_text(folder)).collect();
    if models.is_empty() {
        let _ = writeln!(text, "no model (.onnx) in {}", escaped(&folders.join(", ")));
    }
    Ok(Output { text, json: json!({ "folders": folders, "models": models }) })
}

/// The models in these folders. If several folders hold a file of the same name, the first one is
/// used, so only that is listed.
fn files(folders: &[PathBuf]) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = Vec::new();
    for folder in folders {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut models: Vec<PathBuf> =
            entries.filter(|file| file.extension().is_some_and(|extension| extension == "onnx")).collect();
        models.sort();
        models.retain(|file| !found.iter().any(|other| other.file_name() == file.file_name()));
        found.extend(models);
    }
    found
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

fn card_json(file: &std::path::Path, card: &ModelCard) -> Value {
    json!({
        "file": path_text(file), "views": card.views, "precision": card.precision, "layer_kinds": card.layer_kinds,
        "recommended_layers": card.recommended_layers, "alpha": card.alpha(None).to_string(),
        "training": card.training, "licence": card.licence,
    })
}
