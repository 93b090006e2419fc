//! What a synthesizer is opened with: options, and the model with ONNX Runtime.

use std::num::NonZero;
use std::path::PathBuf;

use liveview::Renderer;
use liveview::network::{
    Alpha, AlphaKind, ExecutionProvider, NetworkError, OrtLibrary, OrtNetwork, Precision, RunEnd, cpu_has_bf16,
};
use liveview_scene::SceneOptions;
use liveview_surface::PhotoCorrection;

use crate::error::SynthesisError;
use crate::layer_spec::LayerSpec;
use crate::model_file::{find_model, model_folders};
use crate::threads::{MAX_THREADS, check_threads};
use crate::view_agreement::ViewAgreement;

/// V, the number of views, where neither the options nor a model file set it.
pub const DEFAULT_VIEWS: usize = 4;

/// Options of [`crate::Synthesizer::open`].
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// How the scene is read.
    pub scene: SceneOptions,
    /// Nearest depth, scene units; `None`: the smallest of the chosen views' depth ranges.
    pub near: Option<f64>,
    /// Farthest depth, scene units, may be infinite; `None`: the largest of the chosen views' depth
    /// ranges.
    pub far: Option<f64>,
    /// Which model, and how ONNX Runtime runs it.
    pub model: ModelOptions,
    /// Which layers; `None`: `surface:3`, or those that the model recommends.
    pub layers: Option<LayerSpec>,
    /// Which differences between photos are corrected, for surface layers and for planes.
    pub photo_correction: PhotoCorrection,
    /// Folder where the depth of photos is kept for later runs
    /// ([`crate::ScenePhotos::keep_depths_in`]).
    pub cache: Option<PathBuf>,
}

/// Options of the model and of ONNX Runtime.
#[derive(Debug, Clone)]
pub struct ModelOptions {
    /// V, the number of views that each picture is rendered from; `None`: the model file's, else
    /// [`DEFAULT_VIEWS`].
    pub views: Option<usize>,
    /// Whether a network weights photos and layers; `None`: see [`Self::uses_network`]. Without one,
    /// photos are weighted by their agreement ([`ViewAgreement`]): neither a model nor ONNX Runtime
    /// is needed, and the other options but `views` and `batch` do not apply.
    pub network: Option<bool>,
    /// The model file; `None`: `liveview_v{V}.onnx`, or the quantised `liveview_v{V}_int8.onnx`, in
    /// one of the `folders`; for layers that are planes `liveview_v{V}_planes.onnx` or
    /// `liveview_v{V}_planes_int8.onnx`, if there is one; with an independent `alpha`
    /// `liveview_v{V}_planes_paper.onnx` or its int8.
    pub file: Option<PathBuf>,
    /// Folders of models; by default [`model_folders`].
    pub folders: Vec<PathBuf>,
    /// Whether to search for the quantised model (int8).
    pub quantized: bool,
    /// How the layers of a pixel share it; `None`: as the model was trained.
    pub alpha: Option<AlphaKind>,
    /// Execution provider that computes the network.
    pub provider: ExecutionProvider,
    /// Precision of the arithmetic on float32 weights.
    pub precision: Precision,
    /// The ONNX Runtime library; `None`: see [`OrtLibrary::load`].
    pub library: Option<PathBuf>,
    /// Threads of the network; `None`: one per core. Everything else runs in rayon's pool.
    pub threads: Option<usize>,
    /// Layers that go through the network at once: memory grows with it, the result stays the same.
    pub batch: usize,
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            views: None,
            network: None,
            file: None,
            folders: model_folders(),
            quantized: false,
            alpha: None,
            provider: ExecutionProvider::default(),
            precision: Precision::default(),
            library: None,
            threads: None,
            batch: 1,
        }
    }
}

impl ModelOptions {
    /// Whether a network renders these layers: as `network` says, else if `file` is set, and for all
    /// layers but those along the surface, which are rendered better and faster without one
    /// (docs/benchmarks.md).
    pub fn uses_network(&self, layers: Option<&LayerSpec>) -> bool {
        let along_surface = layers.is_none_or(|layers| layers.kind() == "surface");
        self.network.unwrap_or(self.file.is_some() || !along_surface)
    }

    /// V, before the model is opened.
    pub fn views_or_default(&self) -> usize {
        self.views.unwrap_or(DEFAULT_VIEWS)
    }

    /// Threads of the network: as set, else one per core, at most [`MAX_THREADS`].
    pub fn threads_or_default(&self) -> usize {
        self.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, NonZero::get).min(MAX_THREADS))
    }

    /// The file of the model for `views` views and these layers, if they are known.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Model`] if none of the folders has it.
    pub fn find(&self, views: usize, layers: Option<&LayerSpec>) -> Result<PathBuf, SynthesisError> {
        Ok(find_model(self.folders.clone(), views, self.quantized, layers, self.alpha)?)
    }

    /// A renderer of these options, and the layers that it renders on: these, or those that the
    /// network recommends.
    ///
    /// # Errors
    ///
    /// As [`Model::open`].
    pub fn open_renderer(&self, layers: Option<&LayerSpec>) -> Result<OpenedRenderer, SynthesisError> {
        if self.uses_network(layers) {
            let model = Model::open(self, layers)?;
            let layers = layers.cloned().map_or_else(|| model.recommended_layers(), Ok)?;
            let run_end = Some(model.network.run_end());
            return Ok(OpenedRenderer { renderer: model.into_renderer(), layers, run_end });
        }
        let network = ViewAgreement { views: self.views_or_default() };
        let renderer = Renderer::new(Box::new(network), ViewAgreement::ALPHA, self.batch);
        Ok(OpenedRenderer { renderer, layers: layers.cloned().unwrap_or(ViewAgreement::LAYERS), run_end: None })
    }
}

/// What [`ModelOptions::open_renderer`] opens.
#[derive(Debug)]
pub struct OpenedRenderer {
    /// The renderer.
    pub renderer: Renderer,
    /// The layers that it renders on.
    pub layers: LayerSpec,
    /// Ends the runs of its network from another thread; `None` without a network.
    pub run_end: Option<RunEnd>,
}

/// An opened model.
#[derive(Debug)]
#[non_exhaustive]
pub struct Model {
    /// The network.
    pub network: OrtNetwork,
    /// How the layers of a pixel share it.
    pub alpha: Alpha,
    /// Layers that go through the network at once.
    pub batch: usize,
    /// ONNX Runtime.
    pub library: OrtLibrary,
    /// Precision of the arithmetic: f32, bf16 or int8.
    pub precision: String,
}

impl Model {
    /// Finds and opens the model for these layers, by default for those along the surface.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Model`], [`SynthesisError::Library`] and [`SynthesisError::Network`].
    pub fn open(options: &ModelOptions, layers: Option<&LayerSpec>) -> Result<Self, SynthesisError> {
        let path = match &options.file {
            Some(path) => path.clone(),
            None => options.find(options.views_or_default(), layers.or(Some(&ViewAgreement::LAYERS)))?,
        };
        let threads = options.threads_or_default();
        let library = OrtLibrary::load(options.provider, options.library.as_deref())?;
        // If ONNX Runtime gets only some of its threads, it waits for ever.
        check_threads(threads).map_err(|source| SynthesisError::Threads { path: path.clone(), source })?;
        let network = OrtNetwork::open_in(options.precision, &library, &path, threads)?;
        let in_bf16 = options.precision == Precision::Bf16 && cpu_has_bf16();
        let precision = if in_bf16 { "bf16".to_owned() } else { network.card().precision.clone() };
        let alpha = network.card().alpha(options.alpha);
        // A model that the user names may render any layers.
        if let (None, Some(layers)) = (&options.file, layers)
            && !network.card().is_for(layers.kind())
        {
            let kinds = format!("\"{}\"", network.card().layer_kinds.join(", "));
            return Err(unfit(&network, "layer_kinds", kinds, format!("{} among them", layers.kind())).into());
        }
        Ok(Self { network, alpha, batch: options.batch, library, precision })
    }

    /// The layers that it was trained for.
    ///
    /// # Errors
    ///
    /// As [`recommended_layers`].
    pub fn recommended_layers(&self) -> Result<LayerSpec, SynthesisError> {
        recommended_layers(&self.network)
    }

    /// A renderer that runs it.
    pub fn into_renderer(self) -> Renderer {
        Renderer::new(Box::new(self.network), self.alpha, self.batch)
    }
}

/// The layers that a network was trained for, by its card.
///
/// # Errors
///
/// [`SynthesisError::Network`] if that is not the text of a [`LayerSpec`].
pub fn recommended_layers(network: &OrtNetwork) -> Result<LayerSpec, SynthesisError> {
    let found = &network.card().recommended_layers;
    let expected = "such as \"guided:2\" or \"planes:64\"".to_owned();
    Ok(found.parse().map_err(|_| unfit(network, "recommended_layers", format!("\"{found}\""), expected))?)
}

fn unfit(network: &OrtNetwork, key: &str, found: String, expected: String) -> NetworkError {
    NetworkError::Unfit { path: network.path().to_owned(), field: format!("metadata `{key}`"), found, expected }
}
