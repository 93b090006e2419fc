//! Runs examples/onnx.rs and compares its picture with photos.

mod wheel;

use std::path::{Path, PathBuf};
use std::process::Command;

use liveview::image::{ImageRgb, load};
use liveview::network::ExecutionProvider;

/// Peak signal-to-noise ratio without 8 pixels at each edge, dB.
fn psnr(picture: &ImageRgb, truth: &ImageRgb) -> f64 {
    assert_eq!(picture.size(), truth.size());
    let mut squares = Vec::new();
    for y in 8..truth.height() - 8 {
        for x in 8..truth.width() - 8 {
            squares.extend(picture.pixel(x, y).iter().zip(truth.pixel(x, y)).map(|(a, b)| f64::from(a - b).powi(2)));
        }
    }
    -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).log10()
}

#[test]
fn picture_is_far_more_similar_to_the_held_out_photo_than_other_photos_are() {
    // `cargo test` puts this test into `deps` and the examples into `deps/../examples`.
    let test = std::env::current_exe().unwrap();
    let built = test.ancestors().nth(2).unwrap().join("examples");
    let program = built.join(format!("onnx{}", std::env::consts::EXE_SUFFIX));
    assert!(program.is_file(), "{}: run `cargo build --examples` first", program.display());
    let named = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()).map(PathBuf::from);
    let library = named.or_else(|| wheel::file(ExecutionProvider::Cpu)).expect("run `make runtime` first");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = tempfile::tempdir().unwrap();
    let output =
        Command::new(program).arg(out.path()).current_dir(root).env("ORT_DYLIB_PATH", library).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(printed.contains(" dB against the held-out photo, "), "{printed}");

    let photo = |name: &str| load(&root.join("tests/scenes/workshop/images").join(name)).unwrap();
    let truth = photo("target_0.jpg");
    let others = (0..7).map(|view| psnr(&photo(&format!("source_{view}.jpg")), &truth));
    let (found, nearest) = (psnr(&load(&out.path().join("onnx.png")).unwrap(), &truth), others.fold(0.0, f64::max));
    println!("{found:.1} dB, the most similar photo {nearest:.1} dB");
    assert!(found > nearest + 8.0, "{found:.1} dB, the most similar photo {nearest:.1} dB");
}
