//! Finds ONNX Runtime for the tests: the library named by `ORT_DYLIB_PATH`, otherwise the one in
//! the Python wheel that `make runtime` or `make setup WITH=openvino` installed.
#![allow(dead_code, reason = "no test binary uses all functions")]

use std::path::{Path, PathBuf};

use liveview::network::{ExecutionProvider, OrtLibrary, OrtLibraryError};

/// The library file in the virtual environment of the checkout.
pub(crate) fn file(provider: ExecutionProvider) -> Option<PathBuf> {
    let environment = if provider == ExecutionProvider::Cpu { ".venv" } else { ".venv-openvino" };
    let mut roots = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|root| root.join(environment));
    let pythons = std::fs::read_dir(roots.find(|root| root.exists())?.join("lib")).into_iter().flatten().flatten();
    let mut folders = pythons.map(|python| python.path().join("site-packages/onnxruntime/capi"));
    folders.find_map(|folder| OrtLibrary::find_in(&folder, provider))
}

pub(crate) fn load(provider: ExecutionProvider) -> Result<OrtLibrary, OrtLibraryError> {
    let named = std::env::var_os("ORT_DYLIB_PATH").is_some_and(|path| !path.is_empty());
    OrtLibrary::load(provider, if named { None } else { file(provider) }.as_deref())
}
