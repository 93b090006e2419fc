//! Keeps models open from one render to the next.

use std::collections::HashMap;

use anyhow::Result;
use liveview::LayerSpec;
use liveview::render::Renderer;

use crate::args::model::ModelArgs;
use crate::args::model_info::ModelInfo;

/// Open models, by the options and the kind of layers that chose them.
#[derive(Debug, Default)]
pub struct ModelPool(HashMap<Key, (Renderer, ModelInfo)>);

type Key = (ModelArgs, Option<&'static str>);

impl ModelPool {
    /// Takes the model of these options out of the pool, or opens it.
    pub fn open(&mut self, model: &ModelArgs, layers: Option<&LayerSpec>) -> Result<(Renderer, ModelInfo)> {
        self.0.remove(&key(model, layers)).map_or_else(|| model.open_for(layers), Ok)
    }

    /// Puts a model that was opened by these options into the pool.
    pub fn give_back(&mut self, model: &ModelArgs, layers: Option<&LayerSpec>, opened: (Renderer, ModelInfo)) {
        self.0.insert(key(model, layers), opened);
    }
}

fn key(model: &ModelArgs, layers: Option<&LayerSpec>) -> Key {
    (model.clone(), layers.map(LayerSpec::kind))
}
