//! What a synthesizer is opened with: options, and the model with ONNX Runtime.

use std::num::NonZero;
use std::path::PathBuf;

use super::error::SynthesisError;
use crate::layers::LayerSpec;
use crate::network::{
    Alpha, AlphaKind, ExecutionProvider, MAX_THREADS, OrtLibrary, OrtNetwork, PlaneNetwork, Precision, ViewAgreement,
    cpu_has_bf16, find_model, model_folders,
};
use crate::render::Renderer;
use crate::scene::SceneOptions;
#[cfg(feature = "surface")]
use crate::surface::PhotoCorrection;

/// V, the number of views, where neither the options nor a model file set it.
pub const DEFAULT_VIEWS: usize = 4;

/// What the model is for where the options name no layers.
#[cfg(feature = "surface")]
const DEFAULT_LAYERS: Option<&LayerSpec> = Some(&ViewAgreement::LAYERS);
#[cfg(not(feature = "surface"))]
const DEFAULT_LAYERS: Option<&LayerSpec> = None;

/// Options of [`crate::Synthesizer::open`].
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
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
    #[cfg(feature = "surface")]
    pub photo_correction: PhotoCorrection,
    #[cfg(feature = "surface")]
    /// Folder where the depth of photos is kept for later runs
    /// ([`crate::ScenePhotos::keep_depths_in`]).
    pub cache: Option<PathBuf>,
}

/// Options of the model and of ONNX Runtime.
#[derive(Debug, Clone)]
#[non_exhaustive]
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
        let along_surface = layers.map_or(cfg!(feature = "surface"), |layers| layers.kind() == "surface");
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
    pub fn open_renderer(&self, layers: Option<&LayerSpec>) -> Result<(Renderer, LayerSpec), SynthesisError> {
        let (renderer, recommended) = if self.uses_network(layers) {
            let model = Model::open(self, layers)?;
            let recommended = model.network.recommended_layers();
            (model.into_renderer(), recommended)
        } else {
            let network = ViewAgreement { views: self.views_or_default() };
            let recommended = network.recommended_layers();
            (Renderer::new(Box::new(network), self.batch), recommended)
        };
        Ok((renderer, layers.cloned().map_or(recommended, Ok)?))
    }
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
            None => options.find(options.views_or_default(), layers.or(DEFAULT_LAYERS))?,
        };
        let library = OrtLibrary::load(options.provider, options.library.as_deref())?;
        let network = OrtNetwork::open_in(options.precision, &library, &path, options.threads_or_default())?;
        let in_bf16 = options.precision == Precision::Bf16 && cpu_has_bf16();
        let precision = if in_bf16 { "bf16".to_owned() } else { network.card().precision.clone() };
        let alpha = network.card().alpha(options.alpha);
        // A model named by the user is refused only for layers that it cannot render.
        if let (true, Some(layers)) = (options.file.is_none() || matches!(alpha, Alpha::PerPixel { .. }), layers) {
            network.check_layers(layers)?;
        }
        Ok(Self { network, alpha, batch: options.batch, library, precision })
    }

    /// A renderer that runs it.
    pub fn into_renderer(self) -> Renderer {
        let mut renderer = Renderer::new(Box::new(self.network), self.batch);
        renderer.set_alpha(self.alpha);
        renderer
    }
}
