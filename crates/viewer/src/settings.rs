//! What is viewed, and how.

use liveview::render::Renderer;
use liveview_live::rig::Rig;
use liveview_synthesizer::{LayerSpec, Synthesizer};

/// What is viewed.
#[derive(Debug)]
pub enum Shown {
    /// The photos of a scene.
    Photos(Box<Synthesizer>),
    /// The video of a rig.
    Video(Box<RigVideo>),
}

/// The video of a rig.
#[derive(Debug)]
pub struct RigVideo {
    /// The cameras.
    pub rig: Rig,
    /// The networks, those of fewer views first; the last is the one that is used while all cameras deliver.
    pub renderers: Vec<Renderer>,
    /// Whether these are models, which predict opacities.
    pub with_models: bool,
    /// Layers per run of the network.
    pub batch: usize,
    /// The layers.
    pub layers: LayerSpec,
    /// Whether the exposure of the photos is not balanced.
    pub keep_exposure: bool,
    /// Time steps per second.
    pub rate: f64,
}

/// How it is shown.
#[derive(Debug)]
pub struct ViewSettings {
    /// Indices of the photos or cameras that are held out.
    pub held_out: Vec<usize>,
    /// Execution provider and precision, such as `cpu, f32`.
    pub engine: String,
    /// Whether photos and layers are weighted without a network.
    pub without_network: bool,
    /// Number of threads.
    pub threads: usize,
    /// Takes notes for the user.
    pub note: fn(&str),
    /// The text of an error for the page.
    pub error_text: fn(&anyhow::Error) -> String,
}
