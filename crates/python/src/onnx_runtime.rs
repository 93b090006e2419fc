//! The ONNX Runtime library of the installed package `onnxruntime`.

use std::path::PathBuf;

use liveview::network::{ExecutionProvider, OrtLibrary};
use pyo3::prelude::*;

/// The library's file; `None` if `ORT_DYLIB_PATH` is set, which takes precedence, or the package is
/// not installed. The package is not imported.
pub(crate) fn installed(py: Python<'_>) -> PyResult<Option<PathBuf>> {
    if std::env::var_os("ORT_DYLIB_PATH").is_some_and(|path| !path.is_empty()) {
        return Ok(None);
    }
    let found = py.import("importlib.util")?.call_method1("find_spec", ("onnxruntime",))?;
    if found.is_none() {
        return Ok(None);
    }
    let folders: Option<Vec<PathBuf>> = found.getattr("submodule_search_locations")?.extract()?;
    let mut libraries = folders.into_iter().flatten().map(|folder| folder.join("capi"));
    Ok(libraries.find_map(|folder| OrtLibrary::find_in(&folder, ExecutionProvider::Cpu)))
}
