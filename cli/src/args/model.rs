//! What to render with: the model, ONNX Runtime, threads.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use liveview::network::{self, Precision};
use liveview::network;
use liveview::network::OrtNetwork;
use liveview::render::Renderer;
use liveview::network::OrtLibrary;
use serde_json::{Value, json};

/// V where neither `--views` nor `--model` says.
const DEFAULT_VIEWS: usize = 4;

/// Options that choose the model and how it is run.
#[derive(Debug, Args)]
#[command(next_help_heading = "Model and engine")]
pub(super) struct ModelArgs {
    /// Views that each picture is made from; picks the model [default: 4, or the --model's own]
    #[arg(long, value_name = "V", value_parser = super::count)]
    pub(super) views: Option<usize>,
    /// Model file [default: liveview_v<V>.onnx in LIVEVIEW_MODELS, or in a `models` folder beside or above the binary, or
    /// in the working directory's]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// What computes the network: an execution provider of ONNX Runtime. cuda and tensorrt: see `ONNX Runtime` in the README
    #[arg(long, value_enum, default_value_t = ProviderName::Cpu)]
    engine: ProviderName,
    /// Precision of the network. int8: a quantised model (liveview_v<V>_int8.onnx unless --model names it); bf16: --engine
    /// openvino, on CPUs that have it [default: the model's own]
    #[arg(long, value_enum)]
    precision: Option<PrecisionName>,
    /// ONNX Runtime library [default: ORT_DYLIB_PATH, then the wheel in a .venv, for other engines than cpu one in
    /// .venv-openvino or .venv-cuda first, then the system's]
    #[arg(long, value_name = "FILE")]
    ort_lib: Option<PathBuf>,
    /// Threads, for the network and for everything else [default: one per core]
    #[arg(long, value_name = "N", value_parser = super::few)]
    threads: Option<usize>,
    /// Layers that go through the network at once: memory grows with it, the result does not change
    #[arg(long, value_name = "N", default_value = "1", value_parser = super::few)]
    pub(super) batch: usize,
}

/// `--engine`.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum ProviderName {
    Cpu,
    Openvino,
    Cuda,
    Tensorrt,
}

impl From<ProviderName> for ExecutionProvider {
    fn from(name: ProviderName) -> Self {
        match name {
            ProviderName::Cpu => Self::Cpu,
            ProviderName::Openvino => Self::OpenVino,
            ProviderName::Cuda => Self::Cuda,
            ProviderName::Tensorrt => Self::TensorRt,
        }
    }
}

/// `--precision`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PrecisionName {
    F32,
    Bf16,
    Int8,
}

/// `--name=value`
fn flag(name: &str, value: &impl ValueEnum) -> Option<String> {
    Some(format!("--{name}={}", value.to_possible_value()?.get_name()))
}

/// An engine and a precision, such as `openvino int8`.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProviderChoice {
    engine: ProviderName,
    precision: Option<PrecisionName>,
}

impl FromStr for ProviderChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (engine, precision) = text.trim().split_once(' ').map_or((text.trim(), None), |(e, p)| (e, Some(p)));
        let precision = precision.map(|precision| PrecisionName::from_str(precision, true)).transpose()?;
        Ok(Self { engine: ProviderName::from_str(engine, true)?, precision })
    }
}

/// A model, ready to render.
pub(super) struct LoadedModel {
    pub(super) renderer: Renderer<OrtNetwork>,
    pub(super) library: PathBuf,
    pub(super) name: ExecutionProvider,
    /// Of the arithmetic: f32, bf16 or int8.
    pub(super) precision: String,
    pub(super) threads: usize,
    pub(super) batch: usize,
}

impl ModelArgs {
    /// The same options on a command line, on another engine if one is named.
    pub(super) fn to_args(&self, other: Option<ProviderChoice>) -> Vec<String> {
        let ProviderChoice { engine, precision } =
            other.unwrap_or(ProviderChoice { engine: self.engine, precision: self.precision });
        let mut args = vec![format!("--threads={}", self.threads()), format!("--batch={}", self.batch)];
        args.extend(flag("engine", &engine));
        args.extend(precision.and_then(|precision| flag("precision", &precision)));
        args.extend(self.views.map(|views| format!("--views={views}")));
        args.extend(self.model.as_ref().map(|model| format!("--model={}", super::shown(model))));
        args.extend(self.ort_lib.as_ref().map(|library| format!("--ort-lib={}", super::shown(library))));
        args
    }

    /// As given, else one per core.
    pub(super) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, Into::into))
    }

    /// Sets the threads of everything but the network; once per process, before any other work.
    pub(super) fn set_threads(&self) -> Result<usize> {
        let threads = self.threads();
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        Ok(threads)
    }

    /// V where no model says otherwise.
    pub(super) fn views_or_default(&self) -> usize {
        self.views.unwrap_or(DEFAULT_VIEWS)
    }

    /// Finds and opens the model.
    pub(super) fn open(&self) -> Result<LoadedModel> {
        let threads = self.set_threads()?;
        let bf16 = self.precision == Some(PrecisionName::Bf16);
        if bf16 && !ExecutionProvider::from(self.engine).knows_bf16() {
            bail!("--precision bf16: expected --engine {}, the only one that has it", ExecutionProvider::OpenVino);
        }
        let path = match &self.model {
            Some(path) => path.clone(),
            None if self.precision == Some(PrecisionName::Int8) => models::find_int8(self.views_or_default())?,
            None => models::find(self.views_or_default())?,
        };
        let runtime = OrtLibrary::load_for(self.engine.into(), self.ort_lib.as_deref())?;
        let arithmetic = if bf16 { Precision::Bf16 } else { Precision::F32 };
        let network = OrtNetwork::open_in(arithmetic, &runtime, &path, threads)?;
        let precision = &network.card().precision;
        let expected = if self.precision == Some(PrecisionName::Int8) { "int8" } else { "f32" };
        if self.precision.is_some() && precision != expected {
            bail!("{}: metadata `precision` is {precision}, expected {expected} (--precision)", path.display());
        }
        let computed = bf16 && network::cpu_has_bf16();
        if bf16 && !computed {
            super::tell("note", "--precision bf16: this CPU has no instructions for it; OpenVINO computes in f32");
        }
        let precision = if computed { "bf16".to_owned() } else { precision.clone() };
        let views = network.card().views;
        if let Some(asked) = self.views.filter(|&asked| asked != views) {
            bail!("{}: metadata `views` is {views}, expected {asked} (--views {asked})", path.display());
        }
        let (library, name) = (runtime.library().to_owned(), runtime.engine());
        let renderer = Renderer::new(network, self.batch);
        Ok(LoadedModel { renderer, library, name, precision, threads, batch: self.batch })
    }
}

impl ModelArgs {
    /// Models for fewer views than `views`, to fall back on; none beside a --model of one's own.
    pub(super) fn open_smaller(&self, views: usize) -> Result<Vec<Renderer<OrtNetwork>>> {
        if self.model.is_some() {
            return Ok(Vec::new());
        }
        let find = if self.precision == Some(PrecisionName::Int8) { models::find_int8 } else { models::find };
        let arithmetic = if self.precision == Some(PrecisionName::Bf16) { Precision::Bf16 } else { Precision::F32 };
        let runtime = OrtLibrary::load_for(self.engine.into(), self.ort_lib.as_deref())?;
        let open = |path: PathBuf| OrtNetwork::open_in(arithmetic, &runtime, &path, self.threads());
        let networks = (2..views).filter_map(|views| find(views).ok()).map(open);
        networks.map(|network| Ok(Renderer::new(network?, self.batch))).collect()
    }
}

impl LoadedModel {
    /// What runs the network, in a few words.
    pub(super) fn described(&self) -> String {
        format!("{}, {}", self.name, self.precision)
    }

    pub(super) fn network(&self) -> &OrtNetwork {
        self.renderer.network()
    }

    pub(super) fn text(&self) -> String {
        let (network, library) = (self.network(), self.library.file_name().unwrap_or_default());
        format!(
            "engine  ONNX Runtime ({}), {} {}, {} threads, {} layers at once\nmodel   {}: {}\n",
            library.display(),
            self.name,
            self.precision,
            self.threads,
            self.batch,
            network.path().display(),
            network.card().training
        )
    }

    pub(super) fn json(&self) -> Value {
        let card = self.network().card();
        json!({
            "model": {
                "file": super::shown(self.network().path()), "views": card.views, "recommended_layers": card.recommended_layers,
                "training": card.training, "licence": card.licence,
            },
            "engine": {
                "name": "ONNX Runtime", "library": super::shown(&self.library), "provider": self.name.name(),
                "precision": self.precision, "threads": self.threads, "batch": self.batch,
            },
        })
    }
}
