//! Options of the model, ONNX Runtime and threads.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use liveview::network::{ExecutionProvider, NoNetwork, OrtLibrary, OrtNetwork, Precision, cpu_has_bf16};
use liveview::render::Renderer;
use liveview::{Model, ModelOptions};

use super::model_info::{ModelInfo, OpenedModel};
use super::numbers;
use crate::console::{print_message, shown};
use crate::network::Network;
use crate::ort_wheel::wheel;

/// Options that choose the model and how it is run.
#[derive(Debug, Args)]
#[command(next_help_heading = "Model and engine")]
pub(crate) struct ModelArgs {
    /// Views that each picture is made from; picks the model [default: 4, or the --model's own]
    #[arg(long, value_name = "V", value_parser = numbers::count)]
    pub(crate) views: Option<usize>,
    /// none: no network, and neither a model nor ONNX Runtime is needed. Views are weighed by their distance alone; every layer but the
    /// last is half opaque, the last opaque, so that one layer makes the best picture [default layers: surface:1]
    #[arg(long, value_enum, conflicts_with_all = ["model", "engine", "precision", "ort_lib"])]
    network: Option<NetworkName>,
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
    #[arg(long, value_name = "N", value_parser = numbers::few)]
    threads: Option<usize>,
    /// Layers that go through the network at once: memory grows with it, the result does not change
    #[arg(long, value_name = "N", default_value = "1", value_parser = numbers::few)]
    pub(crate) batch: usize,
}

/// `--network`: where it is not given, a model.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum NetworkName {
    None,
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
pub(crate) struct ProviderChoice {
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

impl ModelArgs {
    /// Whether there is no network.
    pub(crate) fn without_network(&self) -> bool {
        self.network.is_some()
    }

    /// The same options on a command line, without a network.
    pub(crate) fn to_args_without_network(&self, views: usize) -> Vec<String> {
        let [threads, batch] = [self.threads(), self.batch];
        vec![
            "--network=none".into(),
            format!("--views={views}"),
            format!("--threads={threads}"),
            format!("--batch={batch}"),
        ]
    }

    /// The same options on a command line, on another engine if one is named.
    pub(crate) fn to_args(&self, other: Option<ProviderChoice>) -> Vec<String> {
        if self.without_network() {
            return self.to_args_without_network(self.views_or_default());
        }
        let ProviderChoice { engine, precision } =
            other.unwrap_or(ProviderChoice { engine: self.engine, precision: self.precision });
        let mut args = vec![format!("--threads={}", self.threads()), format!("--batch={}", self.batch)];
        args.extend(flag("engine", &engine));
        args.extend(precision.and_then(|precision| flag("precision", &precision)));
        args.extend(self.views.map(|views| format!("--views={views}")));
        args.extend(self.model.as_ref().map(|model| format!("--model={}", shown(model))));
        args.extend(self.ort_lib.as_ref().map(|library| format!("--ort-lib={}", shown(library))));
        args
    }

    /// The library's options, with the views and the threads given.
    fn views_and_threads(&self) -> ModelOptions {
        let mut options = ModelOptions::default();
        options.views = self.views;
        options.threads = self.threads;
        options
    }

    /// Threads as given, else one per core.
    pub(crate) fn threads(&self) -> usize {
        self.views_and_threads().threads_or_default()
    }

    /// Sets the threads of everything but the network; once per process, before any other work.
    pub(crate) fn set_threads(&self) -> Result<usize> {
        let threads = self.threads();
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        Ok(threads)
    }

    /// V where no model says otherwise.
    pub(crate) fn views_or_default(&self) -> usize {
        self.views_and_threads().views_or_default()
    }

    fn options(&self) -> Result<ModelOptions> {
        let bf16 = self.precision == Some(PrecisionName::Bf16);
        if bf16 && !ExecutionProvider::from(self.engine).knows_bf16() {
            bail!("--precision bf16: expected --engine {}, the only one that has it", ExecutionProvider::OpenVino);
        }
        let mut options = self.views_and_threads();
        options.file.clone_from(&self.model);
        if std::env::var_os("LIVEVIEW_MODELS").is_none_or(|folder| folder.is_empty()) {
            options.folders.push(std::env::current_dir().unwrap_or_default().join("models"));
        }
        options.quantized = self.precision == Some(PrecisionName::Int8);
        options.provider = self.engine.into();
        options.precision = if bf16 { Precision::Bf16 } else { Precision::F32 };
        options.library = self.ort_lib.clone().or_else(|| wheel(options.provider));
        options.batch = self.batch;
        Ok(options)
    }

    /// Finds and opens the model, if there is to be one.
    pub(crate) fn open(&self) -> Result<(Renderer<Network>, ModelInfo)> {
        let (network, model) = if self.without_network() {
            (Network::None(NoNetwork { views: self.views_or_default() }), None)
        } else {
            let (network, model) = self.open_model()?;
            (Network::Model(Box::new(network)), Some(model))
        };
        let info = ModelInfo { model, threads: self.set_threads()?, batch: self.batch };
        Ok((Renderer::new(network, self.batch), info))
    }

    /// Finds and opens the model.
    pub(crate) fn open_model(&self) -> Result<(OrtNetwork, OpenedModel)> {
        if self.without_network() {
            bail!("--network none: expected a model");
        }
        let options = self.options()?;
        let Model { renderer, library, precision, .. } = Model::open(&options)?;
        let network = renderer.into_network();
        let (path, card) = (network.path().to_owned(), network.card().clone());
        let expected = if options.quantized { "int8" } else { "f32" };
        if self.precision.is_some() && card.precision != expected {
            bail!("{}: metadata `precision` is {}, expected {expected} (--precision)", path.display(), card.precision);
        }
        if options.precision == Precision::Bf16 && !cpu_has_bf16() {
            print_message("note", "--precision bf16: this CPU has no instructions for it; OpenVINO computes in f32");
        }
        if let Some(asked) = self.views.filter(|&asked| asked != card.views) {
            bail!("{}: metadata `views` is {}, expected {asked} (--views {asked})", path.display(), card.views);
        }
        let (provider, library) = (library.provider(), library.path().to_owned());
        Ok((network, OpenedModel { path, card, library, provider, precision }))
    }

    /// The models for fewer views than `views`, to fall back on; none if --model names one.
    pub(crate) fn open_smaller(&self, views: usize) -> Result<Vec<Renderer<Network>>> {
        if self.without_network() {
            let none = |views| Renderer::new(Network::None(NoNetwork { views }), self.batch);
            return Ok((2..views).map(none).collect());
        }
        if self.model.is_some() {
            return Ok(Vec::new());
        }
        let options = self.options()?;
        let library =
            OrtLibrary::load(options.provider, options.library.as_deref()).map_err(liveview::SynthesisError::from)?;
        let open = |path: PathBuf| OrtNetwork::open_in(options.precision, &library, &path, self.threads());
        let networks = (2..views).filter_map(|views| options.find(views).ok()).map(open);
        networks.map(|network| Ok(Renderer::new(Network::Model(Box::new(network?)), self.batch))).collect()
    }
}
