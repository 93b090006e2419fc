//! `liveview stability`: stiff and extreme cases, derived from a scene's rig, compared with float64.

mod blend;
mod case;
mod cases;
mod composite;
mod composite_competing;
mod network;
mod outcome;
mod rigs;
mod sampling;
mod select;
mod table;
mod warp;

use std::cell::RefCell;

use anyhow::{Context, Result, bail};
use case::{Case, Expected};
use cases::cases;
use clap::Args;
use liveview::{Model, Targets};
use liveview_common::args::model::ModelArgs;
use liveview_common::args::scene::SceneArgs;
use liveview_common::args::targets::named;
use liveview_common::console::{Output, path_text, print_notes, progress};
use liveview_common::statistics::share;
use ndarray::Array1;
use outcome::{Errors, Outcome};
use rigs::TestRig;
use serde_json::json;
use table::{Table, markdown};

use crate::npz::Arrays;
use crate::worker_process::{WorkerProcess, words};

const EXAMPLES: &str = "\
Examples:
  liveview stability scene --target IMG_7.jpg
  Beside PyTorch, kornia and onnxruntime:
    liveview stability scene --target IMG_7.jpg --reference \".venv/bin/python -m liveview_ref.parity.stability\"";

/// Width of the photos without `--width`, pixels: failures do not depend on the size.
const WIDTH: usize = 126;

/// Options of `liveview stability`.
#[derive(Debug, Args)]
#[command(after_help = "--help also lists the advanced options.", after_long_help = EXAMPLES)]
pub struct StabilityArgs {
    /// The view whose camera is the target, by name
    #[arg(long, value_name = "NAME")]
    target: String,
    /// Only three cases of each family: the ends and the middle
    #[arg(long)]
    short: bool,
    /// Command of the reference implementations: "python -m liveview_ref.parity.stability"
    #[arg(long, value_name = "COMMAND")]
    reference: Option<String>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    scene: SceneArgs,
}

/// Runs `liveview stability`.
pub fn run(args: &StabilityArgs) -> Result<Output> {
    let photos = args.scene.open_at(WIDTH)?;
    args.model.set_threads()?;
    let Model { network, precision, library, .. } = args.model.open_model(None)?;
    print_notes(&photos.scene().notes);
    let targets = Targets::held_out(photos.scene(), named(photos.scene(), std::slice::from_ref(&args.target))?);
    let shot = photos.shots(targets, network.card().views, 0, None)?.remove(0);
    let Some(&farthest) = shot.views.last() else { bail!("{}: no views", args.target) };
    let rig = TestRig {
        photo: photos.scene().load_image(farthest)?,
        source: photos.scene().views[farthest].camera.clone(),
        // The depth of a disparity rounded to float32, as the pixels' disparities are.
        depth: 1.0 / f64::from((0.5 / shot.near + 0.5 / shot.far) as f32),
        distances: photos.cameras(&shot.views).map(|camera| camera.centre().distance(shot.target.centre())).collect(),
        target: shot.target,
    };
    let about = format!(
        "{}, target {}, views {} ({}x{}); {}, {}.",
        args.scene.folder().display(),
        args.target,
        photos.names(&shot.views).join(", "),
        rig.photo.width(),
        rig.photo.height(),
        network.path().file_name().unwrap_or_default().display(),
        format_args!("{}, {precision}", library.provider())
    );
    let path = path_text(network.path());
    let network = RefCell::new(network);
    let mut reference = args.reference.as_ref().map(|command| Reference::start(command, path)).transpose()?;
    let cases = cases(&rig, &network, args.short);
    let bar = progress("cases")?;
    bar.set_length(cases.len() as u64);
    let outcomes = cases.iter().map(|case| {
        bar.set_message(format!("{}, {}", case.family, case.name));
        let outcome = outcome(case, reference.as_mut());
        bar.inc(1);
        outcome
    });
    let table = Table { about, outcomes: outcomes.collect::<Result<_>>()? };
    bar.finish_and_clear();
    let text = markdown(&table);
    if table.failed() > 0 {
        let failures = text
            .lines()
            .filter(|line| line.contains("**failed**") || line.contains("**refused**"))
            .collect::<Vec<_>>()
            .join("; ");
        bail!("{} of {} cases fail: {failures}", table.failed(), table.outcomes.len());
    }
    Ok(Output { json: json!({ "about": table.about, "cases": table.outcomes.len() }), text })
}

/// The reference implementations, in their own process.
struct Reference {
    worker: WorkerProcess,
    folder: tempfile::TempDir,
    model: String,
}

impl Reference {
    fn start(command: &str, model: String) -> Result<Self> {
        let folder = tempfile::tempdir().context("a temporary folder for the reference cannot be created")?;
        Ok(Self { worker: WorkerProcess::start("--reference", &words(command), None)?.0, folder, model })
    }
}

/// Runs a case, and the reference on it if there is one.
fn outcome(case: &Case<'_>, reference: Option<&mut Reference>) -> Result<Outcome> {
    let test = &case.test;
    let answer = test.computed();
    let expected = test.expected();
    let rust = match (&answer, &expected) {
        (Ok(found), Some(expected)) => Ok(Some(Errors::between(found, expected, case.bound))),
        (Err(refusal), _) => Err(refusal.clone()),
        (Ok(found), None) if found.iter().all(|(_, values)| values.iter().all(|value| value.is_finite())) => Ok(None),
        (Ok(_), None) => Ok(Some(Errors { largest: f64::INFINITY, doubtful: 0.0 })),
    };
    let equal = test.equivalent().map(|other| match (&answer, other) {
        (Ok(answer), Ok(other)) => bits(answer) == bits(&other),
        (answer, other) => answer.is_err() && other.is_err(),
    });
    let mut outcome = Outcome {
        family: case.family,
        name: case.name.clone(),
        stage: test.stage(),
        bound: case.bound,
        doubtful: expected.as_ref().map_or(0.0, |expected| share(&expected.doubtful, |&doubtful| doubtful)),
        covered: expected.as_ref().and_then(Expected::covered),
        must_cover: test.must_cover(),
        rust,
        equal,
        torch: None,
        kornia: None,
        onnxruntime: None,
        oracle: None,
        relative_time: test.relative_time(),
    };
    if let (Some(reference), Ok(answer)) = (reference, answer) {
        let file = reference.folder.path().join("case.npz");
        let mut arrays = Arrays::create(&file)?;
        test.write(&mut arrays)?;
        match &expected {
            Some(expected) => expected.write(&mut arrays)?,
            None => answer
                .into_iter()
                .try_for_each(|(name, values)| arrays.add(&format!("rust.{name}"), Array1::from_vec(values)))?,
        }
        arrays.finish()?;
        let request =
            json!({ "case": path_text(&file), "stage": outcome.stage, "model": reference.model, "bound": case.bound });
        let found = reference.worker.ask(&request)?;
        if expected.is_none() {
            outcome.rust = Ok(Errors::from_json(&found["rust"]));
        }
        outcome.torch = Errors::from_json(&found["torch"]);
        outcome.kornia = Errors::from_json(&found["kornia"]);
        outcome.onnxruntime = Errors::from_json(&found["onnxruntime"]);
        outcome.oracle = found["oracle"].as_f64();
        // The network must equal onnxruntime, which runs the same library.
        if expected.is_none() {
            outcome.equal = found["equal"].as_bool();
        }
    }
    Ok(outcome)
}

fn bits(outputs: &[(&'static str, Vec<f32>)]) -> Vec<u32> {
    outputs.iter().flat_map(|(_, values)| values.iter().map(|value| value.to_bits())).collect()
}
