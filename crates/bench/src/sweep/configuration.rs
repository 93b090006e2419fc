//! The settings of a sweep, and the configurations that they ask for.

use liveview::LayerSpec;
use liveview::network::ViewAgreement;

/// Layers measured without a network: the same single layer as with one, and the default.
const WITHOUT_NETWORK: [LayerSpec; 2] = [LayerSpec::Surface(1), ViewAgreement::LAYERS];

/// What is measured, and how.
#[derive(Debug)]
pub struct SweepSettings {
    /// The scene as it was given.
    pub scene: String,
    /// Views to render, by name, all held out.
    pub targets: Vec<String>,
    /// Layers to measure.
    pub layers: Vec<LayerSpec>,
    /// Widths of the picture; none: the photo's.
    pub widths: Vec<usize>,
    /// Number of further engines, for surface and guided layers.
    pub engines: usize,
    /// Whether no network is used at all.
    pub without_network: bool,
    /// Timed renders of each configuration.
    pub repetitions: usize,
    /// Command of the reference implementations.
    pub reference: Option<String>,
    /// Number of threads.
    pub threads: usize,
    /// Layers per run of the network.
    pub batch: usize,
}

/// The engine of a row.
#[derive(Debug, Clone, Copy)]
pub enum RowEngine {
    /// That of the options.
    Own,
    /// One of the further engines, by its index.
    Other(usize),
    /// None: views are weighted by their agreement.
    NoNetwork,
}

/// What a row measures.
#[derive(Debug)]
pub struct Configuration {
    /// Of the target, pixels; `None`: the photo's.
    pub width: Option<usize>,
    /// The layers.
    pub layers: LayerSpec,
    /// The engine.
    pub engine: RowEngine,
}

/// The configurations of all rows, width by width; of each those on the engine of the options first.
pub fn configurations(settings: &SweepSettings) -> Vec<Configuration> {
    let along_surface = |layers: &&LayerSpec| matches!(layers, LayerSpec::Surface(_));
    let light =
        settings.layers.iter().filter(|layers| along_surface(layers) || matches!(layers, LayerSpec::Guided { .. }));
    let others = (0..settings.engines)
        .flat_map(|engine| light.clone().map(move |layers| (layers.clone(), RowEngine::Other(engine))));
    let own = settings.layers.iter().map(|layers| (layers.clone(), RowEngine::Own));
    let with_surface = settings.layers.iter().any(|layers| along_surface(&layers));
    let without_network = (with_surface && !settings.without_network).then_some(WITHOUT_NETWORK);
    let without_network = without_network.into_iter().flatten().map(|layers| (layers, RowEngine::NoNetwork));
    let rows: Vec<_> = own.chain(without_network).chain(others).collect();
    let widths =
        if settings.widths.is_empty() { vec![None] } else { settings.widths.iter().copied().map(Some).collect() };
    let of_width = |width: Option<usize>| {
        rows.iter().cloned().map(move |(layers, engine)| Configuration { width, layers, engine })
    };
    widths.into_iter().flat_map(of_width).collect()
}
