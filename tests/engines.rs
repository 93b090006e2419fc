//! Engines other than ONNX Runtime's own, where they are installed: their logits against float64, on the goldens of
//! `make goldens`, within the bounds of `parity/tolerances.json`. A process can load one library: hence a file of its own.

mod common;

use std::path::{Path, PathBuf};

use common::{Folders, fixture};
use liveview::network::ExecutionProvider;
use liveview::network::{OrtLibrary, OrtLibraryError};
use liveview::network::{OrtNetwork, PlaneNetwork};
use ndarray::{Array4, Ix4, OwnedRepr};
use ndarray_npy::{NpzReader, ReadableElement};

fn folder() -> PathBuf {
    let folder = std::env::var_os("LIVEVIEW_GOLDENS").map(PathBuf::from);
    folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/goldens"))
}

fn get<T: ReadableElement>(case: &str, array: &str) -> Array4<T> {
    let path = folder().join(format!("{case}.npz"));
    let file =
        std::fs::File::open(&path).unwrap_or_else(|e| panic!("{}: {e}: run `make goldens` first", path.display()));
    NpzReader::new(file).unwrap().by_name::<OwnedRepr<T>, Ix4>(array).unwrap()
}

/// Largest and mean error allowed, relative to the largest logit.
fn bound(entry: &str) -> (f64, f64) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/tolerances.json");
    let all: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let number = |key: &str| all[entry][key].as_f64().unwrap_or_else(|| panic!("no {key} of {entry}"));
    (number("floor"), number("mean_floor"))
}

#[test]
fn openvino_logits() {
    let runtime = match OrtLibrary::load_for(ExecutionProvider::OpenVino, None) {
        Ok(runtime) => runtime,
        Err(OrtLibraryError::NotFound { .. } | OrtLibraryError::NoEngine { .. }) => {
            println!("skipped: OpenVINO is not installed (make runtime-openvino)");
            return;
        }
        Err(error) => panic!("{error}"),
    };
    let (most, mean_most) = bound("logits openvino");
    // Of different sizes: one session serves them all.
    for views in [4, 5, 2] {
        let path = folder().join(format!("network_v{views}.onnx"));
        let mut network = OrtNetwork::open(&runtime, &path, 2).unwrap();
        for case in [format!("guided_v{views}"), format!("random_v{views}")] {
            if !folder().join(format!("{case}.npz")).is_file() {
                continue;
            }
            let (hwv, oracle) = (get::<f32>(&case, "colour"), get::<f64>(&case, "oracle.logits"));
            let mut found = Array4::<f32>::zeros(oracle.raw_dim());
            network.infer(hwv.view(), found.view_mut()).unwrap();
            let scale = oracle.iter().fold(0.0, |top: f64, x| top.max(x.abs()));
            let errors: Vec<f64> = found.iter().zip(&oracle).map(|(&a, b)| (f64::from(a) - b).abs() / scale).collect();
            let (worst, mean) =
                (errors.iter().copied().fold(0.0, f64::max), errors.iter().sum::<f64>() / errors.len() as f64);
            println!("{case:10} {:?}: max {worst:.1e}, mean {mean:.1e}", oracle.shape());
            assert!(
                worst <= most && mean <= mean_most,
                "{case}: max {worst:.1e}, mean {mean:.1e}: {most:.1e}, {mean_most:.1e}"
            );
        }
    }
}

/// A binary elsewhere finds no wheel of this checkout. Here, where no other test forks: a fork that inherits the copy while it
/// is open for writing makes it "text file busy".
#[test]
fn no_library_with_the_engine() {
    let folders = Folders::new();
    let binary = tempfile::tempdir().unwrap();
    let copy = binary.path().join("liveview");
    std::fs::copy(env!("CARGO_BIN_EXE_liveview"), &copy).unwrap();
    let mut render = assert_cmd::Command::new(copy);
    render.current_dir(binary.path()).env_remove("ORT_DYLIB_PATH").arg("render").arg(folders.scene());
    render.args(["--target", "2", "--engine", "openvino", "--model", &fixture("tiny_v4"), "-o", &folders.out("a.png")]);
    folders.assert_refused(&mut render, &["engine openvino", "looked in", ".venv-openvino", "make runtime-openvino"]);
}
