//! Options of the model, ONNX Runtime and threads.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use clap::Args;
use liveview::network::{
    Alpha, ExecutionProvider, OrtLibrary, OrtNetwork, Precision, ViewAgreement, check_threads, cpu_has_bf16,
};
use liveview::render::Renderer;
use liveview::{LayerSpec, Model, ModelOptions};

use super::model_info::{ModelInfo, OpenedModel};
use super::model_names::{AlphaName, NetworkName, PrecisionName, ProviderChoice, ProviderName, flag};
use super::numbers;
use crate::console::print_message;
use crate::ort_wheel::wheel;
use crate::outputs::OutputPlan;

/// Options that choose the model and how it is run.
#[derive(Debug, Args)]
#[command(next_help_heading = "Model and engine")]
pub struct ModelArgs {
    /// Views that each picture is made from; picks the model [default: 4, or the --model's own]
    #[arg(long, value_name = "V", value_parser = numbers::count)]
    pub views: Option<usize>,
    /// none: no network, and neither a model nor ONNX Runtime is needed. Views are weighed by their distance and by how well they agree,
    /// which also decides how layers share a pixel: only layers along the surface make a good picture [default layers: surface:3]
    #[arg(long, value_enum, conflicts_with_all = ["model", "alpha", "engine", "precision", "ort_lib"])]
    network: Option<NetworkName>,
    /// Model file [default: liveview_v<V>.onnx in LIVEVIEW_MODELS, or in a `models` folder beside or above the binary, or
    /// in the working directory's; for layers that are planes liveview_v<V>_planes.onnx, with --alpha independent
    /// liveview_v<V>_planes_paper.onnx, if there is one]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// How the layers of a pixel share it. independent: each has its own opacity (the paper's; that of liveview_v<V>_planes_paper.onnx also
    /// depends on how near the next plane lies); competing: a softmax over all of them, so that faint false ones do not add up to fog
    /// [default: as the model was trained]
    #[arg(long, value_enum)]
    alpha: Option<AlphaName>,
    /// What computes the network: an execution provider of ONNX Runtime. cuda and tensorrt: see `ONNX Runtime` in the README
    #[arg(long, value_enum, default_value_t = ProviderName::Cpu)]
    engine: ProviderName,
    /// Precision of the network. int8: a quantised model (liveview_v<V>_int8.onnx, for planes liveview_v<V>_planes_int8.onnx, unless --model
    /// names it); bf16: --engine openvino, on CPUs that have it [default: the model's own]
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
    pub batch: usize,
}

impl ModelArgs {
    /// Protects the files of the model and of the engine.
    pub fn protect(&self, output_plan: &mut OutputPlan, model: Option<&Path>) {
        output_plan.protect("--model", model);
        output_plan.protect("--ort-lib", self.ort_lib.as_deref());
    }

    /// Whether there is no network.
    pub fn without_network(&self) -> bool {
        self.network.is_some()
    }

    /// The same options on a command line, without a network.
    pub fn to_args_without_network(&self, views: usize) -> Vec<OsString> {
        let [threads, batch] = [self.threads(), self.batch];
        vec![
            "--network=none".into(),
            format!("--views={views}").into(),
            format!("--threads={threads}").into(),
            format!("--batch={batch}").into(),
        ]
    }

    /// The same options on a command line, on another engine if one is named.
    pub fn to_args(&self, other: Option<ProviderChoice>) -> Vec<OsString> {
        if self.without_network() {
            return self.to_args_without_network(self.views_or_default());
        }
        let ProviderChoice { engine, precision } =
            other.unwrap_or(ProviderChoice { engine: self.engine, precision: self.precision });
        let mut args = vec![format!("--threads={}", self.threads()), format!("--batch={}", self.batch)];
        args.extend(flag("engine", &engine));
        args.extend(precision.and_then(|precision| flag("precision", &precision)));
        args.extend(self.alpha.and_then(|alpha| flag("alpha", &alpha)));
        args.extend(self.views.map(|views| format!("--views={views}")));
        let mut args: Vec<OsString> = args.into_iter().map(OsString::from).collect();
        for (option, file) in [("--model=", &self.model), ("--ort-lib=", &self.ort_lib)] {
            args.extend(
                file.as_ref().map(|file| [option.as_ref(), file.as_os_str()].into_iter().collect::<OsString>()),
            );
        }
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
    pub fn threads(&self) -> usize {
        self.views_and_threads().threads_or_default()
    }

    /// Sets the threads of everything but the network, before any other work; of several calls in a process the first counts.
    pub fn set_threads(&self) -> Result<usize> {
        static SET: Mutex<bool> = Mutex::new(false);
        let threads = self.threads();
        let mut set = SET.lock().unwrap_or_else(PoisonError::into_inner);
        if !*set {
            start_threads(threads)?;
            *set = true;
        }
        Ok(threads)
    }

    /// V where no model says otherwise.
    pub fn views_or_default(&self) -> usize {
        self.views_and_threads().views_or_default()
    }

    fn options(&self) -> Result<ModelOptions> {
        let bf16 = self.precision == Some(PrecisionName::Bf16);
        if bf16 && !ExecutionProvider::from(self.engine).supports_bf16() {
            bail!("--precision bf16: expected --engine {}, the only one that has it", ExecutionProvider::OpenVino);
        }
        let mut options = self.views_and_threads();
        options.file.clone_from(&self.model);
        if std::env::var_os("LIVEVIEW_MODELS").is_none_or(|folder| folder.is_empty()) {
            options.folders.push(std::env::current_dir().unwrap_or_default().join("models"));
        }
        options.quantized = self.precision == Some(PrecisionName::Int8);
        options.alpha = self.alpha.map(Into::into);
        options.provider = self.engine.into();
        options.precision = if bf16 { Precision::Bf16 } else { Precision::F32 };
        options.library = self.ort_lib.clone().or_else(|| wheel(options.provider));
        options.batch = self.batch;
        Ok(options)
    }

    /// Finds and opens the model for these layers, if there is to be one.
    pub fn open_for(&self, layers: Option<&LayerSpec>) -> Result<(Renderer, ModelInfo)> {
        let (renderer, model) = if self.without_network() {
            (self.renderer_without_network(self.views_or_default()), None)
        } else {
            let (network, model) = self.open_model(layers)?;
            (self.renderer(network), Some(model))
        };
        Ok((renderer, ModelInfo { model, threads: self.set_threads()?, batch: self.batch }))
    }

    /// A renderer with the model's alpha, or the one asked for.
    fn renderer(&self, network: OrtNetwork) -> Renderer {
        let alpha = network.card().alpha(self.alpha.map(Into::into));
        let mut renderer = Renderer::new(Box::new(network), self.batch);
        renderer.set_alpha(alpha);
        renderer
    }

    /// A renderer whose views and layers count as far as the views agree.
    fn renderer_without_network(&self, views: usize) -> Renderer {
        let mut renderer = Renderer::new(Box::new(ViewAgreement { views }), self.batch);
        renderer.set_alpha(Alpha::Competing { scale: 1.0 });
        renderer
    }

    /// The model file for any layers.
    pub fn general_file(&self) -> Result<PathBuf> {
        let options = self.options()?;
        Ok(options.file.clone().map_or_else(|| options.find(self.views_or_default(), None), Ok)?)
    }

    /// Finds and opens the model for these layers.
    pub fn open_model(&self, layers: Option<&LayerSpec>) -> Result<(OrtNetwork, OpenedModel)> {
        if self.without_network() {
            bail!("--network none: expected a model");
        }
        let options = self.options()?;
        let Model { network, alpha, library, precision, .. } = Model::open(&options, layers)?;
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
        Ok((network, OpenedModel { path, card, alpha, library, provider, precision }))
    }

    /// The models for fewer views than `views`, to fall back on; none if --model names one.
    pub fn open_smaller(&self, views: usize, layers: Option<&LayerSpec>) -> Result<Vec<Renderer>> {
        if self.without_network() {
            return Ok((2..views).map(|views| self.renderer_without_network(views)).collect());
        }
        if self.model.is_some() {
            return Ok(Vec::new());
        }
        let options = self.options()?;
        let library =
            OrtLibrary::load(options.provider, options.library.as_deref()).map_err(liveview::SynthesisError::from)?;
        let open = |path: PathBuf| OrtNetwork::open_in(options.precision, &library, &path, self.threads());
        let networks = (2..views).filter_map(|views| options.find(views, layers).ok()).map(open);
        let fits = |network: &OrtNetwork| layers.is_none_or(|layers| network.card().is_for(layers));
        let networks = networks.filter(|network| network.as_ref().map_or(true, fits));
        networks.map(|network| Ok(self.renderer(network?))).collect()
    }
}

/// Starts the threads of everything but the network; once per process, before any other work.
pub fn start_threads(threads: usize) -> Result<()> {
    check_threads(threads).with_context(|| format!("--threads {threads}"))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    // The thread that renders is one of them: not to sleep and be woken at each stage takes 1 of 17 native ms off a frame. It must not
    // be the only one: whoever else uses the pool, to undistort a photo, would wait for it, and it perhaps for that photo.
    let pool = if threads > 1 { pool.use_current_thread() } else { pool };
    Ok(pool.build_global()?)
}
