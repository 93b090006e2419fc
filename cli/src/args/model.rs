//! Options for the model, ONNX Runtime and threads.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use liveview::network::{AlphaKind, ExecutionProvider, Precision, cpu_has_bf16};
use liveview::render::Renderer;
use liveview_synthesizer::{LayerSpec, Model, ModelOptions, OpenedRenderer, check_threads};

use super::ADVANCED;
use super::model_info::ModelInfo;
use super::numbers;
use crate::console::print_message;
use crate::interrupt;
use crate::ort_wheel::wheel;
use crate::outputs::OutputPlan;

/// Options that choose the model and how it is run.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct ModelArgs {
    /// Number of photos per picture; selects the model [default: 4, or as --model]
    #[arg(long, value_name = "V", value_parser = numbers::count)]
    pub(crate) views: Option<usize>,
    /// model: a network weights photos and layers. none: neither a model nor ONNX Runtime is needed
    ///
    /// Without a network, photos are weighted by their distance to the target and by how well they
    /// agree; only surface layers make a good picture this way [default: none for surface layers,
    /// model for all others and with any of --model, --alpha, --engine, --precision and --ort-lib].
    #[arg(long, value_enum, value_name = "none|model", hide_possible_values = true)]
    network: Option<NetworkName>,
    /// Model file [default: the installed model for --views and --layers]
    ///
    /// The folders searched are LIVEVIEW_MODELS if it is set, else `models` beside the program, up
    /// to three folders above it, and in the working directory. With --views 4 the file
    /// is liveview_v4.onnx; if they exist, for surface layers liveview_v4_surface.onnx, for planes
    /// liveview_v4_planes.onnx or, with --alpha independent, liveview_v4_planes_paper.onnx.
    #[arg(long, value_name = "FILE", help_heading = ADVANCED, hide_short_help = true)]
    model: Option<PathBuf>,
    /// How the layers of a pixel share it [default: as the model was trained]
    #[arg(long, value_parser = alpha_parser(), help_heading = ADVANCED, hide_short_help = true)]
    alpha: Option<AlphaKind>,
    /// Execution provider of ONNX Runtime that runs the network [default: cpu]
    #[arg(long, value_parser = provider_parser(), help_heading = ADVANCED, hide_short_help = true)]
    engine: Option<ExecutionProvider>,
    /// Precision of the network [default: the model's]
    #[arg(long, value_enum, help_heading = ADVANCED, hide_short_help = true)]
    precision: Option<PrecisionName>,
    /// ONNX Runtime library [default: ORT_DYLIB_PATH, else a Python wheel, else the system's]
    ///
    /// Wheels are looked for in .venv (for other engines than cpu in .venv-openvino or .venv-cuda
    /// first), in the working directory and above the program.
    #[arg(long, value_name = "FILE", help_heading = ADVANCED, hide_short_help = true)]
    ort_lib: Option<PathBuf>,
    /// Number of threads, for the network and for everything else [default: one per core]
    #[arg(long, value_name = "N", value_parser = numbers::up_to_256, help_heading = ADVANCED, hide_short_help = true)]
    threads: Option<usize>,
    /// Layers per run of the network: more need more memory, the result is the same
    #[arg(long, value_name = "N", default_value = "1", value_parser = numbers::up_to_256)]
    #[arg(help_heading = ADVANCED, hide_short_help = true)]
    pub(crate) batch: usize,
}

impl ModelArgs {
    /// Protects the files of the model, if it is open or given, and of the engine.
    pub(crate) fn protect(&self, output_plan: &mut OutputPlan, model: Option<&Path>) {
        output_plan.protect("--model", model.or(self.model.as_deref()));
        output_plan.protect("--ort-lib", self.ort_lib.as_deref());
    }

    /// Whether `--network none` is given.
    pub(crate) fn without_network(&self) -> bool {
        self.network == Some(NetworkName::None)
    }

    /// A given option that only has an effect where a model runs.
    pub(crate) fn option_of_run(&self) -> Option<&'static str> {
        let given = [("--network", self.network.is_some()), ("--threads", self.threads.is_some())];
        let given = given.into_iter().find_map(|(option, given)| given.then_some(option));
        given.or_else(|| self.option_of_network().filter(|&option| option != "--ort-lib"))
    }

    /// The ONNX Runtime library given, else that of a wheel.
    pub(crate) fn library(&self, provider: ExecutionProvider) -> Option<PathBuf> {
        self.ort_lib.clone().or_else(|| wheel(provider))
    }

    /// A given option that only a network has a use for.
    fn option_of_network(&self) -> Option<&'static str> {
        let given = [
            ("--model", self.model.is_some()),
            ("--alpha", self.alpha.is_some()),
            ("--engine", self.engine.is_some()),
            ("--precision", self.precision.is_some()),
            ("--ort-lib", self.ort_lib.is_some()),
        ];
        given.into_iter().find_map(|(option, given)| given.then_some(option))
    }

    /// These options with a network, unless it is ruled out; with another engine and precision if
    /// given.
    pub(crate) fn with_network(&self, other: Option<ProviderChoice>) -> Self {
        if self.without_network() {
            return self.clone();
        }
        let (engine, precision) = other.map_or((self.engine, self.precision), |o| (Some(o.engine), o.precision));
        Self { network: Some(NetworkName::Model), engine, precision, ..self.clone() }
    }

    /// Without a network, for so many views on the same threads.
    pub(crate) fn no_network(&self, views: usize) -> Self {
        let network = Some(NetworkName::None);
        Self { views: Some(views), network, threads: self.threads, batch: self.batch, ..Self::default() }
    }

    /// Number of threads as given, else one per core.
    pub(crate) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| ModelOptions::default().threads_or_default())
    }

    fn options(&self) -> Result<ModelOptions> {
        let bf16 = self.precision == Some(PrecisionName::Bf16);
        let provider = self.engine.unwrap_or_default();
        if bf16 && !provider.supports_bf16() {
            bail!("--precision bf16: expected --engine {}, the only one that supports it", ExecutionProvider::OpenVino);
        }
        let mut options = ModelOptions {
            views: self.views,
            threads: self.threads,
            network: self
                .network
                .map_or(self.option_of_network().map(|_| true), |name| Some(name == NetworkName::Model)),
            file: self.model.clone(),
            quantized: self.precision == Some(PrecisionName::Int8),
            alpha: self.alpha,
            provider,
            precision: if bf16 { Precision::Bf16 } else { Precision::F32 },
            library: self.library(provider),
            batch: self.batch,
            ..ModelOptions::default()
        };
        if std::env::var_os("LIVEVIEW_MODELS").is_none_or(|folder| folder.is_empty()) {
            options.folders.push(std::env::current_dir().unwrap_or_default().join("models"));
        }
        Ok(options)
    }

    /// The same options with this way of sharing a pixel, unless `--alpha` is given.
    pub(crate) fn with_alpha(&self, alpha: Option<AlphaKind>) -> Self {
        let alpha = self.alpha.or(alpha.filter(|_| !self.without_network()));
        Self { alpha, ..self.clone() }
    }

    /// Opens the model for these layers, or the model and the layers that its card recommends; without a network, no
    /// model.
    pub(crate) fn open_for(&self, layers: Option<&LayerSpec>) -> Result<(Renderer, LayerSpec, ModelInfo)> {
        if let Some(option) = self.option_of_network().filter(|_| self.without_network()) {
            bail!("{option}: cannot be used with --network none");
        }
        let options = self.options()?;
        if let Some(layers @ LayerSpec::Select { .. }) = layers
            && !options.uses_network(Some(layers))
        {
            bail!("--network none: {layers} needs a network; expected --network model, or other --layers or --quality");
        }
        let OpenedRenderer { renderer, layers, model } = options.open_renderer(layers)?;
        model.iter().try_for_each(|model| self.check(model, &options))?;
        let threads = self.threads();
        start_threads(threads)?;
        Ok((renderer, layers, ModelInfo { model, threads, batch: self.batch }))
    }

    /// Checks an opened model; an interrupt ends its runs.
    fn check(&self, model: &Model, options: &ModelOptions) -> Result<()> {
        interrupt::end_runs(model.run_end.clone());
        let (path, card) = (model.path.display(), &model.card);
        let expected = if options.quantized { "int8" } else { "f32" };
        if self.precision.is_some() && card.precision != expected {
            bail!("{path}: metadata `precision` is {}, expected {expected} (--precision)", card.precision);
        }
        if options.precision == Precision::Bf16 && !cpu_has_bf16() {
            print_message("note", "--precision bf16: this CPU does not support it; OpenVINO computes in f32");
        }
        if self.alpha == Some(AlphaKind::Independent) && card.alpha == AlphaKind::Competing {
            print_message("note", format_args!("--alpha independent: {path} was trained for competing layers alone"));
        }
        if let Some(expected) = self.views.filter(|&expected| expected != card.views) {
            bail!("{path}: metadata `views` is {}, expected {expected} (--views {expected})", card.views);
        }
        Ok(())
    }

    /// Opens the models for fewer views than `views`, as fallbacks; none if `--model` is given.
    pub(crate) fn open_smaller(&self, views: usize, layers: Option<&LayerSpec>) -> Result<Vec<Renderer>> {
        let mut options = self.options()?;
        let sizes = 2..views;
        if !options.uses_network(layers) {
            let renderer = |views| ModelOptions { views: Some(views), ..options.clone() }.open_renderer(layers);
            return sizes.map(|views| Ok(renderer(views)?.renderer)).collect();
        }
        if self.model.is_some() {
            return Ok(Vec::new());
        }
        let files: Vec<_> = sizes.filter_map(|views| options.find(views, layers).ok()).collect();
        let mut renderers = Vec::new();
        for file in files {
            options.file = Some(file);
            let OpenedRenderer { renderer, model, .. } = options.open_renderer(layers)?;
            model.iter().for_each(|model| interrupt::end_runs(model.run_end.clone()));
            if layers.is_none_or(|layers| model.is_none_or(|model| model.card.is_for(layers.kind()))) {
                renderers.push(renderer);
            }
        }
        Ok(renderers)
    }
}

/// Starts the threads for everything but the network, before any other work; only the first call in a process has an
/// effect.
pub(crate) fn start_threads(threads: usize) -> Result<()> {
    static STARTED: Mutex<bool> = Mutex::new(false);
    let mut started = STARTED.lock().unwrap_or_else(PoisonError::into_inner);
    if *started {
        return Ok(());
    }
    check_threads(threads).map_err(anyhow::Error::msg).with_context(|| format!("--threads {threads}"))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    // The rendering thread joins the pool: it then need not sleep and wake at each stage, which
    // saves 1 of 17 ms of a frame (network excluded). It must not be the only thread of the pool:
    // another thread that uses the pool, to undistort a photo, would wait for it while it waits for
    // that photo.
    let pool = if threads > 1 { pool.use_current_thread() } else { pool };
    pool.build_global()?;
    *started = true;
    Ok(())
}

/// Values of `--network`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NetworkName {
    None,
    Model,
}

/// Parses the value of `--alpha`.
fn alpha_parser() -> impl TypedValueParser<Value = AlphaKind> {
    let names = [
        ("independent", "Each layer has its own opacity, as in the paper"),
        ("competing", "A softmax over all layers, so that faint false surfaces do not accumulate into haze"),
    ];
    let values = names.map(|(name, help)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(values).try_map(|name| name.parse())
}

/// Parses the value of `--engine`: the name of an execution provider.
fn provider_parser() -> impl TypedValueParser<Value = ExecutionProvider> {
    let names = ExecutionProvider::ALL.map(ExecutionProvider::name);
    PossibleValuesParser::new(names).try_map(|name| provider(&name))
}

/// The provider of a name in lower or upper case.
fn provider(name: &str) -> Result<ExecutionProvider, String> {
    let named = |provider: &ExecutionProvider| provider.name().eq_ignore_ascii_case(name);
    ExecutionProvider::ALL.into_iter().find(named).ok_or_else(|| {
        let names = ExecutionProvider::ALL.map(ExecutionProvider::name).join(", ");
        format!("\"{name}\" is not an engine; expected one of {names}")
    })
}

/// Values of `--precision`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PrecisionName {
    /// 32-bit floats
    F32,
    /// 16-bit floats, with --engine openvino on CPUs that support them
    Bf16,
    /// A quantised model: such as liveview_v4_int8.onnx, for planes liveview_v4_planes_int8.onnx
    Int8,
}

/// An engine and a precision, such as `openvino int8`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ProviderChoice {
    engine: ExecutionProvider,
    precision: Option<PrecisionName>,
}

impl FromStr for ProviderChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (engine, precision) = text.trim().split_once(' ').map_or((text.trim(), None), |(e, p)| (e, Some(p)));
        let precision = precision.map(|text| {
            PrecisionName::from_str(text, true)
                .map_err(|_| format!("\"{text}\" is not a precision; expected f32, bf16 or int8"))
        });
        let precision = precision.transpose()?;
        Ok(Self { engine: provider(engine)?, precision })
    }
}
