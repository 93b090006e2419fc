//! Hostile input: runs by seed, half of them of scene folders with random faults, and a list of commands. Each
//! run must end within a time limit with a picture or with an error that names a file or field, and must not
//! change existing files. `ATTACKS` is the number of runs by seed (`make attack`).
#![cfg(unix)]

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../tests/scene_common/mod.rs"]
mod scene_common;

#[path = "../../../tests/wheel/mod.rs"]
mod wheel;

mod attacks;
mod commands;
mod faults_of_photos;
mod faults_of_poses;
mod interrupts;
#[cfg(feature = "viewer")]
mod requests;
mod scene;
mod snapshot;
mod videos;

use std::fs;
use std::path::Path;
use std::time::Duration;

use assert_cmd::Command;
use rayon::prelude::*;
use scene::Hostile;
use snapshot::snapshot;

/// Number of runs by seed.
fn attack_count() -> u64 {
    std::env::var("ATTACKS").map_or(400, |count| count.parse().expect("a number of runs"))
}

/// Time limit of a run; most take about 10 ms.
const LIMIT: Duration = Duration::from_secs(30);

/// The program; the environment variable `LIVEVIEW` may name another build.
fn program() -> std::ffi::OsString {
    std::env::var_os("LIVEVIEW").unwrap_or_else(|| env!("CARGO_BIN_EXE_liveview").into())
}

#[test]
fn attacks_give_a_picture_or_one_error_that_names_what_is_wrong() {
    let count = attack_count();
    let run = |seed: u64| if seed.is_multiple_of(2) { render(seed / 2) } else { attacks::attack(seed) };
    let results: Vec<_> =
        (0..count).into_par_iter().map(|seed| run(seed).map_err(|why| format!("run {seed}: {why}"))).collect();
    let failures: Vec<_> = results.iter().filter_map(|result| result.as_ref().err()).map(String::as_str).collect();
    assert!(failures.is_empty(), "{} of {count} runs:\n{}", failures.len(), failures.join("\n"));
    let pictures = results.iter().filter(|result| **result == Ok(true)).count() as u64;
    println!("{count} runs: {pictures} pictures, {} errors", count - pictures);
    // The generators must cover both results.
    assert!((count / 10..=count * 9 / 10).contains(&pictures), "{pictures} pictures");
}

/// Renders one folder; returns whether it gave a picture, or how it failed.
fn render(seed: u64) -> Result<bool, String> {
    let Hostile { root, target, faults } = Hostile::new(seed);
    let (scene, out) = (root.path().join("scene"), root.path().join("out"));
    let before = snapshot(&scene);
    let layers = ["surface:1", "guided:1", "planes:4"][seed as usize % 3];
    let mut render = Command::new(program());
    render.arg("render").arg(&scene).args(["--network", "none", "--threads", "1", "--layers", layers]).args(target);
    let output = render.arg("-o").arg(out.join("a.png")).timeout(LIMIT).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let failed = |what: &str| Err(format!("seed {seed}, {layers}, {}: {what}; {stderr}", faults.join(", ")));
    let written: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    if snapshot(&scene) != before {
        return failed("the scene is changed");
    }
    match output.status.code() {
        Some(0) if written == ["a.png"] => match image::open(out.join("a.png")) {
            Ok(_) => Ok(true),
            Err(error) => failed(&format!("an invalid picture: {error}")),
        },
        Some(0) => failed(&format!("no picture: {written:?}")),
        Some(2) if !written.is_empty() => failed(&format!("{written:?} are left")),
        Some(2) if stderr.contains("panicked") => failed("panicked"),
        Some(2) if stderr.lines().filter(|line| line.starts_with("error: ")).count() != 1 => failed("not one error"),
        Some(2) if !names_a_file(&stderr, &scene) => failed("the error names no file"),
        Some(2) => Ok(false),
        Some(code) => failed(&format!("exit code {code}")),
        None => failed("a signal or the time limit"),
    }
}

/// Whether an error names the scene or a file in it.
fn names_a_file(stderr: &str, scene: &Path) -> bool {
    let error = stderr.lines().skip_while(|line| !line.starts_with("error: ")).collect::<Vec<_>>().join("\n");
    let names = snapshot(scene).into_keys().filter_map(|path| Some(path.file_name()?.to_str()?.to_owned()));
    error.contains(scene.to_str().unwrap()) || names.into_iter().any(|name| error.contains(&name))
}
