//! The options of `liveview sweep`, and the configurations that they ask for.

use std::path::PathBuf;

use clap::Args;
use liveview::LayerSpec;
use liveview::network::ViewAgreement;
use liveview_common::args::model::ModelArgs;
use liveview_common::args::model_names::ProviderChoice;
use liveview_common::args::numbers;
use liveview_common::args::scene::SceneArgs;

const EXAMPLES: &str = "\
Examples:
  liveview sweep scene --target IMG_7.jpg -o report/
  liveview sweep scene --target IMG_7.jpg --layers guided:2,guided:4,planes:64 --repetitions 9 -o report/
  Time against size:
    liveview sweep scene --target IMG_7.jpg --layers guided:4,planes:16 --widths 500,1000,2000 -o scaling/";

/// Kinds and numbers of layers.
const LAYERS: &str = "surface:1,surface:2,guided:1,guided:2,guided:3,guided:4,guided:6,guided:8,guided:12,select:8,select:16,\
                      select:32,planes:8,planes:16,planes:32,planes:64";

/// Layers measured without a network: the same single layer as with one, and the default.
const WITHOUT_NETWORK: [LayerSpec; 2] = [LayerSpec::Surface(1), ViewAgreement::LAYERS];

/// Options of `liveview sweep`.
#[derive(Debug, Args)]
#[command(after_help = "--help also lists the advanced options.", after_long_help = EXAMPLES)]
pub struct SweepArgs {
    /// Views to render, by name, all held out: scores are their means, times those of the first
    #[arg(long, value_name = "NAME,…", required = true)]
    pub(super) target: Vec<String>,
    /// Layers to measure, separated by commas; with any surface layers, also surface:1 and surface:3 without a
    /// network [default: several of each kind]
    #[arg(long, value_name = "LIST", default_value = LAYERS, hide_default_value = true, value_delimiter = ',')]
    pub(super) layers: Vec<LayerSpec>,
    /// Widths of the picture, separated by commas, to measure time against size [default: the photo's]
    #[arg(long, value_name = "PIXELS", value_delimiter = ',', value_parser = numbers::count)]
    pub(super) widths: Vec<usize>,
    /// Further engines for surface and guided layers, with precisions, such as "cpu int8,openvino int8"
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with = "network")]
    pub(super) engines: Vec<ProviderChoice>,
    /// Timed renders of each configuration, after one to warm up
    #[arg(long, value_name = "N", default_value = "5", value_parser = numbers::count)]
    pub(super) repetitions: usize,
    /// Command of the reference implementations: "python -m liveview_ref.competitors.worker"
    #[arg(long, value_name = "COMMAND", conflicts_with = "network")]
    pub(super) reference: Option<String>,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    /// Folder for sweep.json, sweep.md and sweep.svg
    #[arg(short, long, value_name = "FOLDER")]
    pub(super) output: PathBuf,
    /// Run one configuration, controlled by lines of JSON: its number, and that of views without a network
    #[arg(long, num_args = 2, value_names = ["N", "V"], hide = true)]
    pub(super) worker: Option<Vec<usize>>,
    #[command(flatten)]
    pub(super) scene: SceneArgs,
}

impl SweepArgs {
    /// Whether it is the process of one configuration: its errors go to the sweep that started it.
    pub fn is_worker(&self) -> bool {
        self.worker.is_some()
    }
}

/// The engine of a row.
#[derive(Clone, Copy)]
pub(super) enum RowEngine {
    /// That of the options.
    Own,
    Other(ProviderChoice),
    NoNetwork,
}

/// What a row measures.
pub(super) struct Configuration {
    /// Of the target, pixels; `None`: the photo's.
    pub(super) width: Option<usize>,
    pub(super) layers: LayerSpec,
    pub(super) engine: RowEngine,
}

/// The configurations of all rows, width by width; of each those on the engine of the options first.
pub(super) fn configurations(args: &SweepArgs) -> Vec<Configuration> {
    let along_surface = |layers: &&LayerSpec| matches!(layers, LayerSpec::Surface(_));
    let light = args.layers.iter().filter(|layers| along_surface(layers) || matches!(layers, LayerSpec::Guided { .. }));
    let others = args
        .engines
        .iter()
        .flat_map(|&engine| light.clone().map(move |layers| (layers.clone(), RowEngine::Other(engine))));
    let own = args.layers.iter().map(|layers| (layers.clone(), RowEngine::Own));
    let with_surface = args.layers.iter().any(|layers| along_surface(&layers));
    let without_network = (with_surface && !args.model.without_network()).then_some(WITHOUT_NETWORK);
    let without_network = without_network.into_iter().flatten().map(|layers| (layers, RowEngine::NoNetwork));
    let rows: Vec<_> = own.chain(without_network).chain(others).collect();
    let widths = if args.widths.is_empty() { vec![None] } else { args.widths.iter().copied().map(Some).collect() };
    let of_width = |width: Option<usize>| {
        rows.iter().cloned().map(move |(layers, engine)| Configuration { width, layers, engine })
    };
    widths.into_iter().flat_map(of_width).collect()
}
