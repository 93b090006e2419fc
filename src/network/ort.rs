//! A network run by ONNX Runtime.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ndarray::{ArrayView4, ArrayViewMut4};
use ort::session::builder::SessionBuilder;
use ort::session::{RunOptions, Session};
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::execution_provider::{ExecutionProvider, Precision};
use super::model_card::{ModelCard, read_card};
use super::ort_library::OrtLibrary;
use super::{NetworkError, PlaneNetwork, check_file, unfit};

/// Largest model file that is opened, bytes: a hundred times the paper's network. A model with
/// weights in separate files (ONNX external data) is refused.
const MAX_MODEL_BYTES: u64 = 256 << 20;

/// A LiveView model run by ONNX Runtime.
#[derive(Debug)]
pub struct OrtNetwork {
    session: Session,
    path: PathBuf,
    card: ModelCard,
    run_end: RunEnd,
}

impl OrtNetwork {
    /// Opens the ONNX model at `path` on `threads` threads, in its own precision. Its input is
    /// `hwv` `[n, 3V, h, w]`, its output `logits` `[n, V, h, w]`, f32, n, h and w free.
    ///
    /// # Errors
    ///
    /// [`NetworkError::Unfit`] if the size, the metadata, the inputs or the outputs are not those
    /// of a LiveView model, naming what differs; [`NetworkError::OnnxRuntime`] if there is no such
    /// file, or ONNX Runtime refuses it. If the system refuses some of the threads, ONNX Runtime waits for
    /// them for ever.
    pub fn open(library: &OrtLibrary, path: &Path, threads: usize) -> Result<Self, NetworkError> {
        Self::open_in(Precision::F32, library, path, threads)
    }

    /// As [`OrtNetwork::open`], with float32 arithmetic replaced by `precision`.
    /// [`Precision::Bf16`] needs [`ExecutionProvider::OpenVino`]; a CPU without the instructions
    /// ([`crate::network::cpu_has_bf16`]) computes in float32.
    ///
    /// # Errors
    ///
    /// As [`OrtNetwork::open`]; [`NetworkError::OnnxRuntime`] for a precision that the execution
    /// provider does not support.
    pub fn open_in(
        precision: Precision,
        library: &OrtLibrary,
        path: &Path,
        threads: usize,
    ) -> Result<Self, NetworkError> {
        let failed = |reason: String| NetworkError::OnnxRuntime { path: path.to_path_buf(), reason };
        check_file(path).map_err(failed)?;
        let bytes = path.metadata().map_or(0, |file| file.len());
        if bytes > MAX_MODEL_BYTES {
            return Err(unfit(path, "the size", format!("{bytes} bytes"), format!("at most {MAX_MODEL_BYTES}")));
        }
        if precision == Precision::Bf16 && !library.provider().supports_bf16() {
            return Err(failed(format!(
                "bf16 needs the execution provider {}; this is {}",
                ExecutionProvider::OpenVino,
                library.provider()
            )));
        }
        let failed_in_ort = |e: ort::Error| failed(e.to_string());
        let mut builder = builder(library, path, threads, precision).map_err(failed_in_ort)?;
        let model = std::fs::read(path).map_err(|e| failed(e.to_string()))?;
        let session = builder.commit_from_memory(&model).map_err(failed_in_ort)?;
        drop((model, builder));
        let metadata = session.metadata().map_err(failed_in_ort)?;
        let card = read_card(path, |key| metadata.custom(key))?;
        drop(metadata);
        check_outlets(path, &named(session.inputs()), "hwv", 3 * card.views)?;
        check_outlets(path, &named(session.outputs()), "logits", card.views)?;
        let run_end = RunEnd(Arc::new(RunOptions::new().map_err(failed_in_ort)?));
        Ok(Self { session, path: path.to_path_buf(), card, run_end })
    }

    /// The model's metadata.
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// The model file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A handle that ends its runs from another thread.
    pub fn run_end(&self) -> RunEnd {
        self.run_end.clone()
    }
}

impl PlaneNetwork for OrtNetwork {
    fn views(&self) -> usize {
        self.card.views
    }

    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        let path = &self.path;
        let failed = |e: ort::Error| NetworkError::OnnxRuntime { path: path.clone(), reason: e.to_string() };
        let input = TensorRef::from_array_view(hwv).map_err(failed)?;
        // Not IoBinding: ort 2.0.0-rc.15 copies a bound input through another session, and
        // deadlocks in it.
        let outputs = self.session.run_with_options(ort::inputs!["hwv" => input], &*self.run_end.0).map_err(failed)?;
        let found = outputs["logits"].try_extract_array::<f32>().map_err(failed)?;
        if found.shape() != logits.shape() {
            let (found, expected) = (format!("{:?}", found.shape()), format!("{:?}", logits.shape()));
            return Err(unfit(path, "the output", found, expected));
        }
        logits.assign(&found);
        Ok(())
    }
}

fn builder(library: &OrtLibrary, path: &Path, threads: usize, precision: Precision) -> ort::Result<SessionBuilder> {
    let builder = Session::builder(&library.environment)?.with_intra_threads(threads)?.with_inter_threads(1)?;
    // The warp and the blend run on the same cores: idle threads of ONNX Runtime must not spin on
    // them.
    let mut builder = builder.with_intra_op_spinning(false)?;
    if let Some(provider) = library.provider().dispatch(threads, precision) {
        builder = builder.with_execution_providers([provider])?;
        if library.provider() == ExecutionProvider::OpenVino {
            // OpenVINO can run the whole graph; a part that fell back to ONNX Runtime's CPU
            // provider would go unnoticed.
            builder = builder.with_disable_cpu_fallback()?;
        }
    }
    // The size limit does not count weights in separate files: ONNX Runtime is made to look for
    // these in a folder that cannot exist, below the model file.
    let nowhere = path.to_string_lossy();
    Ok(builder.with_config_entry("session.model_external_initializers_file_folder_path", nowhere)?)
}

fn named(outlets: &[Outlet]) -> Vec<(&str, &ValueType)> {
    outlets.iter().map(|outlet| (outlet.name(), outlet.dtype())).collect()
}

/// Refuses inputs or outputs unless they are one named `expected`, f32 `[n, channels, h, w]`.
pub(crate) fn check_outlets(
    path: &Path,
    outlets: &[(&str, &ValueType)],
    expected: &str,
    channels: usize,
) -> Result<(), NetworkError> {
    if let [(name, dtype)] = outlets
        && *name == expected
        && let ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } = dtype
        && shape.len() == 4
        && shape[1] == channels as i64
        && [0, 2, 3].iter().all(|&axis| shape[axis] == -1)
    {
        return Ok(());
    }
    let described = outlets.iter().map(|(name, dtype)| match dtype {
        ValueType::Tensor { ty, shape, .. } => format!("{name} {ty:?} {:?}", shape.iter().collect::<Vec<_>>()),
        other => format!("{name} {other:?}"),
    });
    let found = described.collect::<Vec<_>>().join(", ");
    let field = if expected == "hwv" { "the input" } else { "the output" };
    Err(unfit(path, field, found, format!("{expected} f32 [n, {channels}, h, w] with n, h and w free")))
}

/// Ends a network's runs from another thread.
#[derive(Clone)]
pub struct RunEnd(pub(super) Arc<RunOptions>);

impl fmt::Debug for RunEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("RunEnd")
    }
}

impl RunEnd {
    /// Ends the current run, if there is one, and makes every later run fail, with
    /// [`super::NetworkError::OnnxRuntime`]. Execution providers other than
    /// [`super::ExecutionProvider::Cpu`] may finish the current run.
    pub fn end(&self) {
        // ONNX Runtime's function cannot fail.
        let _ = self.0.terminate();
    }
}
