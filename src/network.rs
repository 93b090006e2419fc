//! The network: a homography warped volume in, logits out. One trait, so that the pipeline can run without weights.

use std::path::{Path, PathBuf};

use ndarray::{ArrayView4, ArrayViewMut4};
use ort::session::Session;
use ort::value::{Outlet, TensorRef, ValueType};

use crate::engine::{Engine, Precision};
use crate::file;
use crate::layers::STRIDE;
use crate::runtime::Runtime;

/// Largest model file that is opened, in bytes: a hundred times the paper's network. A model with weights in files of their
/// own (ONNX external data) is refused.
pub const MAX_MODEL_BYTES: u64 = 256 << 20;

/// Computes the logits of a batch of layers, each layer alone (paper, section "Neural Network").
pub trait PlaneNetwork {
    /// V: how many views its input holds.
    fn views(&self) -> usize;

    /// `hwv` `[n, 3V, h, w]` (views nearest first, RGB in [0, 1], zeros where nothing is seen; h and w multiples of
    /// [`STRIDE`]) → `logits` `[n, V, h, w]`, both in standard layout.
    fn infer(&mut self, hwv: ArrayView4<'_, f32>, logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError>;
}

/// Why a model was refused or failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The file does not hold a LiveView model for the views asked for.
    #[error("{path}: {field} is {found}, expected {expected}", path = path.display())]
    Unfit {
        /// The model file.
        path: PathBuf,
        /// Which input, output or metadata entry.
        field: String,
        /// What the model says.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// ONNX Runtime refused the file or failed while running it.
    #[error("{path}: ONNX Runtime: {reason}", path = path.display())]
    Engine {
        /// The model file.
        path: PathBuf,
        /// What ONNX Runtime said.
        reason: String,
    },
}

/// What a model says about itself in its metadata.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelCard {
    /// V.
    pub views: usize,
    /// Layers that serve it best, such as `guided 4` or `planes 64`.
    pub recommended_layers: String,
    /// Of the weights and of the arithmetic on them: `f32`, or `int8` for a quantised model.
    pub precision: String,
    /// How it was trained, in a line.
    pub training: String,
    /// Licence of the weights and of the data they were trained on.
    pub licence: String,
}

/// A LiveView model run by ONNX Runtime.
pub struct OrtNetwork {
    session: Session,
    path: PathBuf,
    card: ModelCard,
}

impl OrtNetwork {
    /// Open the ONNX model at `path` on `threads` threads, in the precision it was made in. Refuses, naming what differs, a model whose metadata, inputs or
    /// outputs are not a LiveView model's: `hwv` `[n, 3V, h, w]` → `logits` `[n, V, h, w]`, f32, n, h and w free.
    pub fn open(runtime: &Runtime, path: &Path, threads: usize) -> Result<Self, NetworkError> {
        Self::open_in(Precision::F32, runtime, path, threads)
    }

    /// As [`OrtNetwork::open`], float32 arithmetic replaced by `precision`. [`Precision::Bf16`] is refused by engines other
    /// than [`Engine::OpenVino`]; a CPU that lacks it ([`crate::engine::cpu_has_bf16`]) computes in float32 all the same.
    pub fn open_in(precision: Precision, runtime: &Runtime, path: &Path, threads: usize) -> Result<Self, NetworkError> {
        let engine = |reason: String| NetworkError::Engine { path: path.to_path_buf(), reason };
        if !path.is_file() {
            return Err(engine("there is no such file".into()));
        }
        let bytes = path.metadata().map_or(0, |file| file.len());
        if bytes > MAX_MODEL_BYTES {
            return Err(unfit(path, "the size", format!("{bytes} bytes"), format!("at most {MAX_MODEL_BYTES}")));
        }
        if precision == Precision::Bf16 && !runtime.engine().knows_bf16() {
            return Err(engine(format!(
                "bf16 is for the engine {}, and this is the engine {}",
                Engine::OpenVino,
                runtime.engine()
            )));
        }
        let session = build(runtime, path, threads, precision).map_err(engine)?;
        let metadata = session.metadata().map_err(|e| engine(e.to_string()))?;
        let card = read_card(path, |key| metadata.custom(key))?;
        drop(metadata);
        check_outlets(path, &named(session.inputs()), "hwv", 3 * card.views)?;
        check_outlets(path, &named(session.outputs()), "logits", card.views)?;
        Ok(Self { session, path: path.to_path_buf(), card })
    }

    /// The model's metadata.
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// The model file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl PlaneNetwork for OrtNetwork {
    fn views(&self) -> usize {
        self.card.views
    }

    fn infer(&mut self, hwv: ArrayView4<'_, f32>, mut logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
        let path = &self.path;
        let engine = |e: ort::Error| NetworkError::Engine { path: path.clone(), reason: e.to_string() };
        let input = TensorRef::from_array_view(hwv).map_err(engine)?;
        // Not IoBinding: rc.15 copies a bound input through a session of its own, and deadlocks in it.
        let outputs = self.session.run(ort::inputs!["hwv" => input]).map_err(engine)?;
        let found = outputs["logits"].try_extract_array::<f32>().map_err(engine)?;
        if found.shape() != logits.shape() {
            let (found, expected) = (format!("{:?}", found.shape()), format!("{:?}", logits.shape()));
            return Err(unfit(path, "the output", found, expected));
        }
        logits.assign(&found);
        Ok(())
    }
}

fn build(runtime: &Runtime, path: &Path, threads: usize, precision: Precision) -> Result<Session, String> {
    let text = |e: ort::Error| e.to_string();
    let builder = Session::builder(&runtime.environment).map_err(text)?;
    let builder = builder.with_intra_threads(threads).map_err(|e| e.to_string())?;
    let builder = builder.with_inter_threads(1).map_err(|e| e.to_string())?;
    // The warp and the blend run on the same cores: an idle engine must not spin on them.
    let mut builder = builder.with_intra_op_spinning(false).map_err(|e| e.to_string())?;
    if let Some(provider) = runtime.engine().provider(threads, precision) {
        builder = builder.with_execution_providers([provider]).map_err(|e| e.to_string())?;
        if runtime.engine() == Engine::OpenVino {
            // It takes the whole graph: a part left to ONNX Runtime's own code would go unnoticed.
            builder = builder.with_disable_cpu_fallback().map_err(|e| e.to_string())?;
        }
    }
    // Weights in files of their own, which the limit does not count, are looked for where nothing can be: below the model file.
    let nowhere = path.to_string_lossy();
    let mut builder = builder
        .with_config_entry("session.model_external_initializers_file_folder_path", nowhere)
        .map_err(|e| e.to_string())?;
    let model = file::read(path, MAX_MODEL_BYTES).map_err(|e| e.to_string())?;
    builder.commit_from_memory(&model).map_err(text)
}

fn unfit(path: &Path, field: impl Into<String>, found: String, expected: impl Into<String>) -> NetworkError {
    NetworkError::Unfit { path: path.to_path_buf(), field: field.into(), found, expected: expected.into() }
}

/// The card, from the metadata's entries.
pub(crate) fn read_card(path: &Path, entry: impl Fn(&str) -> Option<String>) -> Result<ModelCard, NetworkError> {
    let wrong = |key: &str, found: Option<String>, expected: &str| {
        unfit(path, format!("metadata `{key}`"), found.unwrap_or_else(|| "missing".into()), expected)
    };
    let text = |key: &str| entry(key).ok_or_else(|| wrong(key, None, "a text"));
    let views = text("views")?;
    let count = views.parse().ok().filter(|v| (2..=64).contains(v));
    let stride = text("stride")?;
    if stride != STRIDE.to_string() {
        return Err(wrong("stride", Some(stride), &STRIDE.to_string()));
    }
    Ok(ModelCard {
        views: count.ok_or_else(|| wrong("views", Some(views), "a whole number, 2 to 64"))?,
        recommended_layers: text("recommended_layers")?,
        precision: entry("precision").unwrap_or_else(|| "f32".into()),
        training: text("training")?,
        licence: text("licence")?,
    })
}

fn named(outlets: &[Outlet]) -> Vec<(&str, &ValueType)> {
    outlets.iter().map(|outlet| (outlet.name(), outlet.dtype())).collect()
}

/// Refuses inputs or outputs other than the one `wanted`, f32 `[n, channels, h, w]`.
pub(crate) fn check_outlets(
    path: &Path,
    outlets: &[(&str, &ValueType)],
    wanted: &str,
    channels: usize,
) -> Result<(), NetworkError> {
    if let [(name, dtype)] = outlets
        && *name == wanted
        && has_shape(dtype, channels)
    {
        return Ok(());
    }
    let found =
        outlets.iter().map(|(name, dtype)| format!("{name} {}", describe(dtype))).collect::<Vec<_>>().join(", ");
    let field = if wanted == "hwv" { "the input" } else { "the output" };
    Err(unfit(path, field, found, format!("{wanted} f32 [n, {channels}, h, w] with n, h and w free")))
}

fn has_shape(dtype: &ValueType, channels: usize) -> bool {
    let ValueType::Tensor { ty: ort::value::TensorElementType::Float32, shape, .. } = dtype else { return false };
    shape.len() == 4 && shape[1] == channels as i64 && [0, 2, 3].iter().all(|&axis| shape[axis] == -1)
}

fn describe(dtype: &ValueType) -> String {
    match dtype {
        ValueType::Tensor { ty, shape, .. } => format!("{ty:?} {:?}", shape.iter().collect::<Vec<_>>()),
        other => format!("{other:?}"),
    }
}
