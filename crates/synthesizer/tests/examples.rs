//! Runs each example at a small width and compares its pictures with photos.

#[path = "../../../tests/wheel/mod.rs"]
mod wheel;

use std::path::{Path, PathBuf};
use std::process::Command;

use liveview::image::{ImageRgb, load};
use liveview::network::ExecutionProvider;
use liveview_scene::{Scene, SceneOptions};
use liveview_synthesizer::psnr;
use tempfile::TempDir;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
const WIDTH: usize = 168;
const HEIGHT: usize = 117;

/// Runs an example with that ONNX Runtime library and returns the folder of its pictures.
fn run_with(example: &str, library: &Path) -> TempDir {
    run_for(example, library, WIDTH).0
}

/// As [`run_with`], with that number as the last argument; also returns what it prints.
fn run_for(example: &str, library: &Path, number: usize) -> (TempDir, String) {
    // `cargo test` puts this test into `deps` and the examples into `deps/../examples`.
    let test = std::env::current_exe().unwrap();
    let built = test.ancestors().nth(2).unwrap().join("examples");
    let program = built.join(format!("{example}{}", std::env::consts::EXE_SUFFIX));
    assert!(program.is_file(), "{}: run `cargo build --examples` first", program.display());
    let out = tempfile::tempdir().unwrap();
    let mut command = Command::new(program);
    command.arg(out.path()).arg(number.to_string()).current_dir(ROOT).env("ORT_DYLIB_PATH", library);
    let output = command.env("LIVEVIEW_MODELS", Path::new(ROOT).join("models")).output().unwrap();
    assert!(output.status.success(), "{example}: {}", String::from_utf8_lossy(&output.stderr));
    (out, String::from_utf8(output.stdout).unwrap())
}

fn run(example: &str) -> TempDir {
    run_with(example, &wheel_or_named())
}

fn wheel_or_named() -> PathBuf {
    let named = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()).map(PathBuf::from);
    named.or_else(|| wheel::file(ExecutionProvider::Cpu)).expect("run `make runtime` first")
}

/// A photo of an example scene, at the width of the pictures.
fn photo(scene: &str, name: &str) -> ImageRgb {
    let options = SceneOptions { width: Some(WIDTH), ..SceneOptions::default() };
    let scene = Scene::open(&Path::new(ROOT).join("tests/scenes").join(scene), &options).unwrap();
    scene.load_image(scene.view_index(name).unwrap()).unwrap()
}

/// All pictures of a folder, sorted by name.
fn pictures(folder: &TempDir) -> Vec<ImageRgb> {
    let entries = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|end| end == "png")).collect();
    files.sort();
    let pictures: Vec<ImageRgb> = files.iter().map(|file| load(file).unwrap()).collect();
    assert!(pictures.iter().all(|picture| (picture.width(), picture.height()) == (WIDTH, HEIGHT)));
    pictures
}

/// Asserts that the camera moves: each frame is similar to the one before, but not equal.
fn assert_moves(frames: &[ImageRgb]) {
    for (index, pair) in frames.windows(2).enumerate() {
        let similarity = psnr(&pair[0], &pair[1], 0);
        assert!((12.0..60.0).contains(&similarity), "frames {index} and {}: {similarity:.1} dB", index + 1);
    }
}

/// Asserts that the picture shows the first held-out view of the workshop: it is far more similar
/// to the held-out photo than any other photo is.
fn assert_is_held_out_view(out: &TempDir) {
    let [picture] = &pictures(out)[..] else { panic!("one picture") };
    let truth = photo("workshop", "target_0");
    let others = (0..7).map(|view| psnr(&photo("workshop", &format!("source_{view}")), &truth, 8));
    let (found, nearest) = (psnr(picture, &truth, 8), others.fold(0.0, f64::max));
    println!("{found:.1} dB, the most similar photo {nearest:.1} dB");
    assert!(found > nearest + 8.0, "{found:.1} dB, the most similar photo {nearest:.1} dB");
}

#[test]
fn path_writes_frames() {
    let frames = pictures(&run("path"));
    assert_eq!(frames.len(), 12);
    assert_moves(&frames);
}

#[test]
fn own_network_needs_no_onnx_runtime() {
    assert_is_held_out_view(&run_with("own_network", Path::new("/nonexistent")));
}

#[test]
fn arrays_go_in_and_come_out() {
    assert_is_held_out_view(&run_with("arrays", Path::new("/nonexistent")));
}

#[test]
fn progress_is_reported_and_ends_the_search() {
    let (out, printed) = run_for("progress", Path::new("/nonexistent"), 100);
    assert_is_held_out_view(&out);
    let photos: Vec<&str> = printed.lines().collect();
    let (first, last) = (photos[0], photos[photos.len() - 1]);
    assert!(first.starts_with(&format!("depth of photo 1 of {}: ", photos.len())), "{printed}");
    assert!(last.starts_with(&format!("depth of photo {0} of {0}: ", photos.len())), "{printed}");
    let (out, printed) = run_for("progress", Path::new("/nonexistent"), 2);
    assert_eq!((printed.lines().count(), printed.lines().last()), (4, Some("cancelled")), "{printed}");
    assert!(pictures(&out).is_empty());
}
