//! Models that are kept from one render to the next.

use std::collections::HashMap;

use anyhow::Result;
use liveview::LayerSpec;
use liveview::render::Renderer;

use crate::args::model::ModelArgs;
use crate::args::model_info::ModelInfo;

/// Open models, each by the options that chose it.
#[derive(Debug, Default)]
pub struct KeptModels(HashMap<String, (Renderer, ModelInfo)>);

impl KeptModels {
    /// The model of these options, kept or opened anew. It is not kept any longer until it is given back.
    pub fn open(&mut self, model: &ModelArgs, layers: Option<&LayerSpec>) -> Result<(Renderer, ModelInfo)> {
        self.0.remove(&key(model, layers)).map_or_else(|| model.open_for(layers), Ok)
    }

    /// Keeps a model that was opened by these options.
    pub fn give_back(&mut self, model: &ModelArgs, layers: Option<&LayerSpec>, opened: (Renderer, ModelInfo)) {
        self.0.insert(key(model, layers), opened);
    }
}

/// What decides which model is opened, and how.
fn key(model: &ModelArgs, layers: Option<&LayerSpec>) -> String {
    format!("{model:?} {:?}", layers.map(LayerSpec::kind))
}
