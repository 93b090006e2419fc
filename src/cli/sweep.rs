//! `liveview sweep`: error against run time, each configuration in a worker process, their repetitions interleaved.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use liveview::image_io::ImageRgb;
use liveview::layers::uniform_disparities;
use liveview::metrics::{psnr, ssim};
use ndarray::{Array1, Array3};
use serde_json::{Value, json};

use super::dump::Arrays;
use super::engine::EngineArgs;
use super::output::write_whole;
use super::render::SCORE_BORDER;
use super::setup::{Photos, SceneArgs};
use super::targets::held_out;
use super::workers::Worker;
use super::{Report, progress};
use crate::report::{self, PixelError, Row, Score, Sweep};

const EXAMPLES: &str = "\
Examples:
  liveview sweep scene --target IMG_7.jpg -o report/
  liveview sweep scene --target IMG_7.jpg --layers \"guided 2,guided 4,planes 64\" --repetitions 9 -o report/
  Time against size:
    liveview sweep scene --target IMG_7.jpg --layers \"guided 4,planes 16\" --widths 500,1000,2000 -o scaling/";

/// Every kind of layers, fewest first; the last is what the others are compared with.
const LAYERS: &str = "guided 1,guided 2,guided 3,guided 4,guided 6,guided 8,guided 12,kmeans 8,kmeans 16,select 8,select 16,\
                      select 32,planes 8,planes 16,planes 32,planes 64";

/// Engines of `python -m liveview_ref.worker`.
const REFERENCES: [&str; 4] = ["torch", "torch channels_last", "onnxruntime + kornia", "one graph"];

/// Options of `liveview sweep`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct SweepArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Views to render, by name; all are held out. Scores are means over them, times are the first one's
    #[arg(long, value_name = "NAME", value_delimiter = ',', required = true)]
    target: Vec<String>,
    /// What to measure, separated by commas: guided L, planes D, kmeans K or select K
    #[arg(long, value_name = "LIST", default_value = LAYERS, value_delimiter = ',', value_parser = kind_and_count)]
    layers: Vec<(String, usize)>,
    /// Widths that the photos are scaled to, separated by commas [default: as they are, or --width]
    #[arg(long, value_name = "PIXELS", value_delimiter = ',', value_parser = super::count, conflicts_with = "width")]
    widths: Vec<usize>,
    /// Times that each is rendered, after one to warm up
    #[arg(long, value_name = "N", default_value = "5", value_parser = super::count)]
    repetitions: usize,
    /// A command that speaks as `liveview worker` does, to measure the reference implementations on the most planes, such as
    /// ".venv/bin/python -m liveview_ref.worker"
    #[arg(long, value_name = "COMMAND")]
    reference: Option<String>,
    #[command(flatten)]
    engine: EngineArgs,
    /// Folder for sweep.json, sweep.md and sweep.svg
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
}

/// `guided 4` and the like.
fn kind_and_count(text: &str) -> Result<(String, usize), String> {
    let known = |kind: &&str| ["guided", "planes", "kmeans", "select"].contains(kind);
    let (kind, number) = text
        .trim()
        .split_once(' ')
        .filter(|(kind, _)| known(kind))
        .ok_or("expected guided L, planes D, kmeans K or select K")?;
    Ok((kind.to_owned(), super::count(number.trim())?))
}

/// A configuration that is being measured.
struct Measured {
    worker: Worker,
    row: Row,
    /// The pictures of all targets that it renders.
    pictures: Vec<ImageRgb>,
}

pub(super) fn run(args: &SweepArgs) -> Result<Report> {
    fs::create_dir_all(&args.output).with_context(|| format!("-o {}: cannot be written", args.output.display()))?;
    let folder = tempfile::tempdir().context("a folder for what the workers hand over")?;
    let widths =
        if args.widths.is_empty() { vec![args.scene.width] } else { args.widths.iter().copied().map(Some).collect() };
    let bar = progress()?;
    let mut all = Vec::new();
    let mut model = String::new();
    for width in widths {
        let scene = args.scene.with_width(width);
        let photos = scene.open()?;
        if all.is_empty() {
            photos.tell_notes();
        }
        let truths = truths(args, &photos)?;
        let started = all.len();
        for (kind, count) in &args.layers {
            let layers = [format!("--{kind}"), count.to_string()];
            let mut command = vec!["worker".to_owned()];
            command.extend(
                [scene.to_args(), args.engine.to_args(), vec!["--target".into(), args.target.join(",")], layers.into()]
                    .concat(),
            );
            let (worker, ready) = Worker::start(&std::env::current_exe()?.display().to_string(), &command, None)?;
            model = ready["model"].as_str().unwrap_or_default().to_owned();
            let row = row(&ready, ready["layers"].as_str().unwrap_or_default(), false, &truths[0]);
            all.push(Measured { worker, row, pictures: Vec::new() });
        }
        if let Some(command) = &args.reference {
            let planes = args.layers.iter().filter(|(kind, _)| kind == "planes").map(|&(_, count)| count).max();
            let Some(planes) = planes else { bail!("--reference: expected planes among --layers, to measure it on") };
            let job = folder.path().join(format!("job_{started}.npz"));
            write_job(&job, args, &photos, planes)?;
            for engine in REFERENCES {
                let weights = Path::new(&model).with_extension("pt");
                let job = json!({
                    "job": super::shown(&job), "model": model, "weights": weights.is_file().then(|| super::shown(&weights)),
                    "engine": engine, "threads": args.engine.threads(), "batch": args.engine.batch,
                });
                let mut words = command.split_whitespace().map(str::to_owned);
                let program = words.next().unwrap_or_default();
                let (worker, ready) = Worker::start(&program, &words.collect::<Vec<_>>(), Some(&job))?;
                let mut row = row(&ready, &format!("planes {planes}"), true, &truths[0]);
                row.count = planes;
                all.push(Measured { worker, row, pictures: Vec::new() });
            }
        }
        bar.inc_length(((all.len() - started) * (args.repetitions + 1)) as u64);
        for measured in &mut all[started..] {
            bar.set_message(format!("{}, {}", measured.row.layers, measured.row.engine));
            measured.warm_up(&truths, folder.path())?;
            bar.inc(1);
        }
        let dense = (started..all.len()).filter(|&i| !all[i].row.reference && all[i].row.layers.starts_with("planes "));
        let dense = dense.max_by_key(|&i| all[i].row.count).map(|i| all[i].pictures.clone());
        for measured in &mut all[started..] {
            measured.score(&truths, dense.as_deref());
        }
    }
    for _ in 0..args.repetitions {
        for measured in &mut all {
            bar.set_message(format!("{}, {}", measured.row.layers, measured.row.engine));
            measured.time()?;
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let sweep = Sweep {
        scene: args.scene.folder().display().to_string(),
        targets: args.target.clone(),
        views: args.engine.views_or_default(),
        model: Path::new(&model).file_name().unwrap_or_default().to_string_lossy().into_owned(),
        threads: args.engine.threads(),
        batch: args.engine.batch,
        cpu: cpu(),
        rows: all.into_iter().map(|measured| measured.row).collect(),
    };
    if sweep.noisy() {
        super::tell("warning", "the repetitions lie far apart: the machine is too noisy for these times to be trusted");
    }
    let (text, json) = (report::markdown(&sweep), sweep.json());
    let files =
        [("sweep.json", format!("{json:#}\n")), ("sweep.md", text.clone()), ("sweep.svg", report::plot(&sweep))];
    for (name, contents) in files {
        write_whole(&args.output.join(name), contents.as_bytes())?;
    }
    Ok(Report { text, json })
}

/// The photos that show the truth.
fn truths(args: &SweepArgs, photos: &Photos) -> Result<Vec<ImageRgb>> {
    let views = args.target.iter().map(|name| Ok(photos.scene.load_image(photos.scene.view_index(name)?)?));
    views.collect()
}

fn row(ready: &Value, layers: &str, reference: bool, truth: &ImageRgb) -> Row {
    Row {
        layers: layers.to_owned(),
        engine: ready["engine"].as_str().unwrap_or("unnamed").to_owned(),
        reference,
        size: (truth.width(), truth.height()),
        count: 0,
        runs: Vec::new(),
        once: 0.0,
        score: None,
        error: None,
        peak_memory_bytes: None,
    }
}

impl Measured {
    /// Renders every target once and keeps the pictures; a reference renders the first alone.
    fn warm_up(&mut self, truths: &[ImageRgb], folder: &Path) -> Result<()> {
        let targets = if self.row.reference { 1 } else { truths.len() };
        for target in 0..targets {
            let frame = folder.join("frame.npy");
            let answer = self.worker.ask(&json!({ "run": true, "target": target, "frame": super::shown(&frame) }))?;
            let pixels: Array3<f32> = ndarray_npy::read_npy(&frame).context("the picture that a worker handed over")?;
            let (height, width, _) = pixels.dim();
            self.pictures.push(ImageRgb::new(width, height, pixels.iter().copied().collect())?);
            if let (0, Some(once)) = (target, answer["seconds"]["select"].as_f64()) {
                self.row.once = once;
            }
            if let Some(count) = answer["layers"].as_u64() {
                self.row.count = count as usize;
            }
        }
        Ok(())
    }

    fn time(&mut self) -> Result<()> {
        let answer = self.worker.ask(&json!({ "run": true, "target": 0 }))?;
        let Some(seconds) = answer["seconds"].as_object() else { bail!("{}: told no times", self.row.engine) };
        let stages = seconds.iter().map(|(stage, time)| (stage.clone(), time.as_f64().unwrap_or(f64::NAN)));
        self.row.runs.push(stages.collect());
        self.row.peak_memory_bytes = answer["peak_memory_bytes"].as_u64();
        Ok(())
    }

    fn score(&mut self, truths: &[ImageRgb], dense: Option<&[ImageRgb]>) {
        let count = self.pictures.len() as f64;
        let mean = |of: &dyn Fn(&ImageRgb, &ImageRgb) -> f64| {
            self.pictures.iter().zip(truths).map(|(picture, truth)| of(picture, truth)).sum::<f64>() / count
        };
        let score = Score {
            psnr: mean(&|picture, truth| psnr(picture, truth, SCORE_BORDER)),
            ssim: mean(&|picture, truth| ssim(picture, truth, SCORE_BORDER)),
        };
        self.row.score = Some(score).filter(|score| score.psnr.is_finite() && score.ssim.is_finite());
        self.row.error = dense.map(|dense| {
            let apart = self.pictures.iter().zip(dense).flat_map(|(a, b)| a.data().iter().zip(b.data()));
            let (max, sum, values) = apart.fold((0.0, 0.0, 0), |(max, sum, values): (f64, f64, usize), (a, b)| {
                let apart = f64::from((a - b).abs());
                (max.max(apart), sum + apart, values + 1)
            });
            PixelError { max, mean: sum / values as f64 }
        });
        self.pictures.clear();
    }
}

/// What a reference renders: the first target on uniform planes, everything chosen.
fn write_job(path: &Path, args: &SweepArgs, photos: &Photos, planes: usize) -> Result<()> {
    let views = args.target.iter().map(|name| photos.scene.view_index(name)).collect::<Result<Vec<_>, _>>()?;
    let shot = photos.shot(held_out(photos, views), args.engine.views_or_default())?;
    let mut arrays = Arrays::create(path)?;
    arrays.add_rig(photos, &shot)?;
    arrays.add("disparities", Array1::from_vec(uniform_disparities(shot.near, shot.far, planes)?))?;
    arrays.finish(path)
}

/// The processor's name, where the system tells it (Linux).
fn cpu() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}
