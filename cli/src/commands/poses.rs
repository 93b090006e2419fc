//! `liveview poses`: a scene of photos or videos whose poses are not known, by COLMAP. The work is done by a Python script
//! that the program carries, which is also `liveview.poses` of the Python package.

use std::fmt::Write;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use clap::Args;
use liveview_scene::{Format, Scene, SceneOptions};
use serde_json::{Value, json};

use crate::args::refuse_stdout;
use crate::console::{Output, escaped, path_text, print_message, print_notes, progress};
use crate::ort_wheel::environments_near;

const SCRIPT: &str = include_str!("../../../crates/python/python/liveview/_poses.py");

/// Options of `liveview poses`.
#[derive(Debug, Args)]
pub(crate) struct PosesArgs {
    /// Photos, folders of photos, or videos (by ffmpeg: at most 60 frames, chosen by sharpness and motion)
    #[arg(required = true, value_name = "PHOTOS|VIDEO")]
    inputs: Vec<PathBuf>,
    /// New folder of the scene: transforms.json, sparse/0 and links to the photos
    #[arg(short, long, value_name = "SCENE")]
    output: PathBuf,
    /// Python with the package pycolmap [default: that of .venv, else of the PATH; or the program colmap of the PATH]
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
}

pub(crate) fn run(args: &PosesArgs) -> Result<Output> {
    refuse_stdout("-o", &args.output)?;
    let python = python(args.python.as_deref())?;
    let mut command = Command::new(&python);
    command.arg("-c").arg(SCRIPT).arg(&args.output).args(&args.inputs).stdin(Stdio::null()).stdout(Stdio::piped());
    let failed = || format!("{}: cannot be run", python.display());
    let mut script = command.spawn().with_context(failed)?;
    let (bar, mut step, mut found) = (progress()?, String::new(), None);
    for line in BufReader::new(script.stdout.take().expect("a pipe")).lines() {
        let line: Value = serde_json::from_str(&line.with_context(failed)?).unwrap_or_default();
        if let Some(error) = line["error"].as_str() {
            bail!("{error}");
        }
        let now = line["step"].as_str().unwrap_or_default().to_owned();
        bar.set_length(line["of"].as_u64().unwrap_or(0));
        bar.set_position(line["done"].as_u64().unwrap_or(0));
        if step != now && !now.is_empty() {
            let of = line["of"].as_u64().map(|of| format!(": {of}")).unwrap_or_default();
            bar.suspend(|| print_message("step", format!("{now}{of}")));
        }
        bar.set_prefix(now.clone());
        step = now;
        found = line.get("result").cloned().or(found);
    }
    bar.finish_and_clear();
    let status = script.wait().with_context(failed)?;
    let found = found.with_context(|| format!("{}: ended without a result: {status}", python.display()))?;
    report(&args.output, &found)
}

/// The report on a new scene.
fn report(folder: &Path, found: &Value) -> Result<Output> {
    let text_of = |value: &Value| value.as_str().map(str::to_owned);
    print_notes(&found["notes"].as_array().into_iter().flatten().filter_map(text_of).collect::<Vec<_>>());
    let scene = Scene::open(folder, &SceneOptions { format: Some(Format::Colmap), ..SceneOptions::default() })?;
    let mut text = format!("registered {} of {} photos", found["registered"], found["photos"]);
    if let Some(error) = scene.reprojection_error {
        let _ = write!(text, ", median reprojection error {error:.2} px");
    }
    for (name, why) in found["left_out"].as_object().into_iter().flatten() {
        let why = text_of(why).unwrap_or_default();
        let _ = write!(text, "\nleft out   {}: {}", escaped(name), escaped(&why));
    }
    let _ = writeln!(text, "\nwrote      {0}\nnext       liveview view {0}", folder.display());
    let mut json = found.clone();
    json["scene"] = json!(path_text(folder));
    json["reprojection_error"] = json!(scene.reprojection_error);
    Ok(Output { text, json })
}

/// The Python that is given, or one with pycolmap, or any where colmap is on the PATH.
fn python(given: Option<&Path>) -> Result<PathBuf> {
    if let Some(given) = given {
        return Ok(given.to_owned());
    }
    let own = environments_near(&[".venv"]).map(|folder| folder.join("bin/python"));
    let pythons: Vec<PathBuf> = own.chain(["python3".into(), "python".into()]).collect();
    let runs = |program: &Path, arguments: &[&str]| {
        let status = Command::new(program).args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).status();
        status.is_ok_and(|status| status.success())
    };
    let with_package = pythons.iter().find(|python| runs(python, &["-c", "import pycolmap"]));
    let any = || pythons.iter().find(|python| runs(python, &["-c", ""])).filter(|_| runs("colmap".as_ref(), &["help"]));
    match with_package.or_else(any) {
        Some(python) => Ok(python.clone()),
        None => bail!(
            "COLMAP is missing, which finds the poses; `python3 -m pip install pycolmap` gets it (into a virtual \
             environment: pass its python by --python)"
        ),
    }
}
