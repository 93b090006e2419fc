//! Compares the logits of OpenVINO with float64, within the bounds of `parity/tolerances.json`. The
//! inputs are the goldens of `parity/generate.py`, which `make test-rust` generates. A process can
//! load only one ONNX Runtime library, so this test has a binary of its own. It is ignored by
//! default; `make test` runs it where OpenVINO is installed.

mod wheel;

use std::path::{Path, PathBuf};

use liveview::network::{ExecutionProvider, OrtNetwork, PlaneNetwork};
use ndarray::{Array4, Ix4, OwnedRepr};
use ndarray_npy::{NpzReader, ReadableElement};

fn folder() -> PathBuf {
    let folder = std::env::var_os("LIVEVIEW_GOLDENS").map(PathBuf::from);
    folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/goldens"))
}

fn get<T: ReadableElement>(case: &str, array: &str) -> Array4<T> {
    let path = folder().join(format!("{case}.npz"));
    let file = std::fs::File::open(&path)
        .unwrap_or_else(|e| panic!("{}: {e}: run `make test-rust`, which generates it", path.display()));
    NpzReader::new(file).unwrap().by_name::<OwnedRepr<T>, Ix4>(array).unwrap()
}

/// The largest and the mean error allowed, relative to the largest logit.
fn bound(entry: &str) -> (f64, f64) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/tolerances.json");
    let all: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let number = |key: &str| all[entry][key].as_f64().unwrap_or_else(|| panic!("no {key} of {entry}"));
    (number("floor"), number("mean_floor"))
}

#[test]
#[ignore = "needs OpenVINO"]
fn openvino_logits_are_within_the_bounds() {
    let library = wheel::load(ExecutionProvider::OpenVino).expect("run `make setup WITH=openvino` first");
    let (max_bound, mean_bound) = bound("logits openvino");
    // Each session runs inputs of different sizes.
    for views in [4, 5, 2] {
        let path = folder().join(format!("network_v{views}.onnx"));
        let mut network = OrtNetwork::open(&library, &path, 2).unwrap();
        for case in [format!("guided_v{views}"), format!("random_v{views}")] {
            if !folder().join(format!("{case}.npz")).is_file() {
                continue;
            }
            let (hwv, oracle) = (get::<f32>(&case, "colour"), get::<f64>(&case, "oracle.logits"));
            let mut found = Array4::<f32>::zeros(oracle.raw_dim());
            network.infer(hwv.view(), found.view_mut()).unwrap();
            let scale = oracle.iter().fold(0.0, |top: f64, x| top.max(x.abs()));
            let errors: Vec<f64> = found.iter().zip(&oracle).map(|(&a, b)| (f64::from(a) - b).abs() / scale).collect();
            let max = errors.iter().copied().fold(0.0, f64::max);
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            println!("{case:10} {:?}: max {max:.1e}, mean {mean:.1e}", oracle.shape());
            assert!(max <= max_bound, "{case}: max {max:.1e}, bound {max_bound:.1e}");
            assert!(mean <= mean_bound, "{case}: mean {mean:.1e}, bound {mean_bound:.1e}");
        }
    }
}
