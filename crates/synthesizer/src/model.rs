//! What a synthesizer is opened with: options, and the model with ONNX Runtime.
//!
//! Model files are `liveview_v{V}.onnx` and the quantised `liveview_v{V}_int8.onnx`, one of
//! each per number of views V.
//!
//! There may also be models for kinds of layers: `liveview_v{V}_planes.onnx` for competing planes,
//! `liveview_v{V}_planes_paper.onnx` for independent ones, `liveview_v{V}_surface.onnx` for layers
//! along the surface, and their `_int8.onnx`.

use std::collections::BTreeSet;
use std::io;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Builder};

use crate::{LayerSpec, SynthesisError, ViewAgreement};
use liveview::Renderer;
use liveview::network::{
    Alpha, AlphaKind, ExecutionProvider, ModelCard, NetworkError, OrtLibrary, OrtNetwork, Precision, RunEnd,
    cpu_has_bf16,
};
use liveview_files::memory;
use liveview_scene::SceneOptions;
use liveview_surface::PhotoCorrection;

/// V, the number of views, where neither the options nor a model file set it.
const DEFAULT_VIEWS: usize = 4;

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
#[derive(Debug, Clone, Default)]
pub struct ModelOptions {
    /// V, the number of views that each picture is rendered from; `None`: the model file's, else
    /// `DEFAULT_VIEWS`.
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
    /// Folders of models that are searched after the one named by the environment variable `LIVEVIEW_MODELS` if
    /// it is set, else after `models` beside the running program and up to three folders above it.
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
    /// Layers that go through the network at once, 0 as 1: memory grows with it, the result stays the same.
    pub batch: usize,
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
        let folders = model_folders().into_iter().chain(self.folders.iter().cloned()).collect();
        find_model(folders, views, self.quantized, layers, self.alpha).map_err(SynthesisError::Model)
    }

    /// A renderer of these options, and the layers that it renders on: these, or those that the
    /// network recommends.
    ///
    /// # Errors
    ///
    /// As [`Model::open`].
    pub fn open_renderer(&self, layers: Option<&LayerSpec>) -> Result<OpenedRenderer, SynthesisError> {
        if self.uses_network(layers) {
            let (model, network) = Model::open(self, layers)?;
            let layers = layers.cloned().map_or_else(|| recommended_layers(&network), Ok)?;
            let renderer = Renderer::new(Box::new(network), model.alpha, self.batch);
            return Ok(OpenedRenderer { renderer, layers, model: Some(model) });
        }
        let network = ViewAgreement { views: self.views_or_default() };
        let renderer = Renderer::new(Box::new(network), ViewAgreement::ALPHA, self.batch);
        Ok(OpenedRenderer { renderer, layers: layers.cloned().unwrap_or(ViewAgreement::LAYERS), model: None })
    }
}

/// What [`ModelOptions::open_renderer`] opens.
#[derive(Debug)]
pub struct OpenedRenderer {
    /// The renderer.
    pub renderer: Renderer,
    /// The layers that it renders on.
    pub layers: LayerSpec,
    /// The model whose network it runs; `None` without one.
    pub model: Option<Model>,
}

/// An opened model, and how it is run.
#[derive(Debug)]
#[non_exhaustive]
pub struct Model {
    /// The model file.
    pub path: PathBuf,
    /// The metadata of the file.
    pub card: ModelCard,
    /// How the layers of a pixel share it.
    pub alpha: Alpha,
    /// The file of the ONNX Runtime library.
    pub library: PathBuf,
    /// The execution provider.
    pub provider: ExecutionProvider,
    /// Precision of the arithmetic: f32, bf16 or int8.
    pub precision: String,
    /// Ends the network's runs from another thread.
    pub run_end: RunEnd,
}

impl Model {
    /// Finds and opens the model for these layers, by default for those along the surface, and its network.
    ///
    /// # Errors
    ///
    /// [`SynthesisError::Model`], [`SynthesisError::Library`] and [`SynthesisError::Network`].
    pub fn open(options: &ModelOptions, layers: Option<&LayerSpec>) -> Result<(Self, OrtNetwork), SynthesisError> {
        let path = match &options.file {
            Some(path) => path.clone(),
            None => options.find(options.views_or_default(), layers.or(Some(&ViewAgreement::LAYERS)))?,
        };
        let threads = options.threads_or_default();
        let library = OrtLibrary::load(options.provider, options.library.as_deref())?;
        // If ONNX Runtime gets only some of its threads, it waits for ever.
        check_threads(threads).map_err(|reason| SynthesisError::Threads { path: path.clone(), reason })?;
        let network = OrtNetwork::open_in(options.precision, &library, &path, threads)?;
        // A model that the user names may render any layers.
        if let (None, Some(layers)) = (&options.file, layers)
            && !network.card().is_for(layers.kind())
        {
            let kinds = format!("\"{}\"", network.card().layer_kinds.join(", "));
            return Err(unfit(&network, "layer_kinds", kinds, format!("{} among them", layers.kind())).into());
        }
        let card = network.card().clone();
        let in_bf16 = options.precision == Precision::Bf16 && cpu_has_bf16();
        let precision = if in_bf16 { "bf16".to_owned() } else { card.precision.clone() };
        let (alpha, run_end) = (card.alpha(options.alpha), network.run_end());
        let (provider, library) = (options.provider, library.path().to_owned());
        Ok((Self { path, card, alpha, library, provider, precision, run_end }, network))
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

/// The folders before those of [`ModelOptions::folders`].
fn model_folders() -> Vec<PathBuf> {
    if let Some(named) = std::env::var_os("LIVEVIEW_MODELS").filter(|v| !v.is_empty()) {
        return vec![named.into()];
    }
    let program = std::env::current_exe().unwrap_or_default();
    program.ancestors().skip(1).take(4).map(|folder| folder.join("models")).collect()
}

/// The model file for `views` views in the first folder that has it; `quantized`: the int8 model.
/// For `layers`, and for planes the way in which they share a pixel (by default they compete): the
/// model trained for that, if any folder has one, else the general model.
///
/// The error names the folders and the V of the models in them.
fn find_model(
    folders: Vec<PathBuf>,
    views: usize,
    quantized: bool,
    layers: Option<&LayerSpec>,
    alpha: Option<AlphaKind>,
) -> Result<PathBuf, String> {
    let ending = if quantized { "_int8.onnx" } else { ".onnx" };
    let kind = layers.and_then(|layers| match (layers.kind(), alpha) {
        ("surface", _) => Some("_surface"),
        ("guided", _) => None,
        (_, Some(AlphaKind::Independent)) => Some("_planes_paper"),
        (_, Some(AlphaKind::Competing) | None) => Some("_planes"),
    });
    let for_kind = kind.and_then(|kind| first_with(&folders, views, &format!("{kind}{ending}")));
    for_kind.map_or_else(|| find_in(folders, views, ending), Ok)
}

fn find_in(mut folders: Vec<PathBuf>, views: usize, ending: &str) -> Result<PathBuf, String> {
    let mut distinct = std::collections::HashSet::new();
    folders.retain(|folder| distinct.insert(folder.clone()));
    if let Some(file) = first_with(&folders, views, ending) {
        return Ok(file);
    }
    let found: BTreeSet<usize> = folders.iter().flat_map(|folder| models_in(folder, ending)).collect();
    let found: Vec<String> = found.iter().map(usize::to_string).collect();
    let found = if found.is_empty() { "no model".to_owned() } else { format!("models for V = {}", found.join(", ")) };
    let folders: Vec<String> = folders.iter().map(|folder| folder.display().to_string()).collect();
    let folders = folders.join(", ");
    Err(format!("no model for {views} views: liveview_v{views}{ending} is not in {folders}; there, {found}"))
}

fn first_with(folders: &[PathBuf], views: usize, ending: &str) -> Option<PathBuf> {
    // Also a pipe, a folder or a broken link, which is an error that names it when it is opened.
    let is_there = |file: &PathBuf| file.symlink_metadata().is_ok();
    folders.iter().map(|folder| folder.join(format!("liveview_v{views}{ending}"))).find(is_there)
}

/// V of each model in a folder; nothing if it cannot be read.
fn models_in(folder: &Path, ending: &str) -> Vec<usize> {
    let views = |name: &str| name.strip_prefix("liveview_v")?.strip_suffix(ending)?.parse().ok();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| views(entry.file_name().to_str()?)).collect()
}

/// Most threads that a network is run on.
pub const MAX_THREADS: usize = 256;

/// Stack of one thread, bytes: the usual default, so that a limit of address space is met here.
const STACK_BYTES: usize = 8 << 20;
/// Address space that stays free: what threads allocate as they start, without which they abort the
/// process (64 KiB each, a signal stack for the most part). More than that, because glibc keeps
/// freed blocks of up to 32 MiB and would reserve the same one for every thread.
const FREE_BYTES: usize = 64 << 20;

/// Starts `count` threads at the same time, and ends them.
///
/// # Errors
///
/// More than [`MAX_THREADS`] or none; what the system starts of them, and why no more.
pub fn check_threads(count: usize) -> Result<(), String> {
    if !(1..=MAX_THREADS).contains(&count) {
        return Err(format!("{count} threads; expected 1 to {MAX_THREADS}"));
    }
    let gate = Mutex::new(());
    thread::scope(|scope| {
        let closed = gate.lock().unwrap_or_else(PoisonError::into_inner);
        let start = |started| {
            let spawn = || Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, || drop(gate.lock()));
            let has_space = memory::can_reserve(STACK_BYTES + FREE_BYTES);
            let thread = if has_space { spawn() } else { Err(io::ErrorKind::OutOfMemory.into()) };
            thread.err().map(|source| {
                format!(
                    "of {count} threads only {started} can be started: {source}; expected fewer threads, or a higher limit \
                     of processes (ulimit -u, a container's pids.max) or of address space (ulimit -v)"
                )
            })
        };
        let refused = (0..count).find_map(start);
        drop(closed);
        refused.map_or(Ok(()), Err)
    })
}

#[cfg(test)]
mod model_file_tests {
    use super::*;

    #[test]
    fn first_folder_with_the_model_is_used_and_an_error_lists_the_models_found() {
        let root = tempfile::tempdir().unwrap();
        let folders = ["a", "b", "absent"].map(|name| root.path().join(name));
        for (folder, file) in [
            (0, "liveview_v4.onnx"),
            (1, "liveview_v4.onnx"),
            (1, "liveview_v5_int8.onnx"),
            (1, "liveview_v10.onnx"),
            (0, "notes.onnx"),
        ] {
            std::fs::create_dir_all(&folders[folder]).unwrap();
            std::fs::write(folders[folder].join(file), "").unwrap();
        }
        assert_eq!(find_in(folders.to_vec(), 4, ".onnx").unwrap(), folders[0].join("liveview_v4.onnx"));
        let found = |quantized| {
            let [guided, planes] = ["guided:2", "planes:8"].map(|layers| layers.parse().unwrap());
            let kinds = [
                (None, None),
                (Some(&guided), Some(AlphaKind::Competing)),
                (Some(&planes), None),
                (Some(&planes), Some(AlphaKind::Independent)),
            ];
            kinds.map(|(layers, alpha)| find_model(folders.to_vec(), 4, quantized, layers, alpha).unwrap())
        };
        let general = folders[0].join("liveview_v4.onnx");
        assert_eq!(found(false), [(); 4].map(|()| general.clone()));
        for (quantized, ending) in [(false, ".onnx"), (true, "_int8.onnx")] {
            let files = ["", "_planes", "_planes_paper"].map(|of| folders[1].join(format!("liveview_v4{of}{ending}")));
            files.iter().for_each(|file| std::fs::write(file, "").unwrap());
            let [of_folder_b, competing, independent] = files;
            let general = if quantized { of_folder_b } else { general.clone() };
            assert_eq!(found(quantized), [general.clone(), general, competing, independent]);
        }
        {
            let surface = folders[1].join("liveview_v4_surface.onnx");
            std::fs::write(&surface, "").unwrap();
            assert_eq!(find_model(folders.to_vec(), 4, false, Some(&LayerSpec::Surface(1)), None).unwrap(), surface);
        }
        assert_eq!(find_in(folders.to_vec(), 10, ".onnx").unwrap(), folders[1].join("liveview_v10.onnx"));
        assert_eq!(find_in(folders.to_vec(), 5, "_int8.onnx").unwrap(), folders[1].join("liveview_v5_int8.onnx"));
        let missing = find_in(folders.to_vec(), 5, ".onnx").unwrap_err();
        assert!(missing.contains("no model for 5 views") && missing.ends_with("V = 4, 10"), "{missing}");
    }
}

#[cfg(test)]
mod threads_tests {
    use super::*;

    #[test]
    fn zero_threads_or_too_many_are_refused() {
        assert!(check_threads(2).is_ok());
        for count in [0, MAX_THREADS + 1, usize::MAX] {
            assert_eq!(check_threads(count).unwrap_err(), format!("{count} threads; expected 1 to 256"));
        }
    }
}
