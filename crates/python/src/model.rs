//! The arguments `views` and `network`, and the ONNX Runtime of the installed package `onnxruntime`.

use std::path::PathBuf;

use liveview::network::{ExecutionProvider, OrtLibrary};
use liveview::render::Renderer;
use liveview_synthesizer::ModelOptions;
use pyo3::prelude::*;

use crate::arguments::whole;
use crate::error::value;

/// How the network is opened; without a file, photos are weighted by their agreement.
pub(crate) fn options(
    py: Python<'_>,
    views: Option<&Bound<'_, PyAny>>,
    network: Option<PathBuf>,
) -> PyResult<ModelOptions> {
    let mut options = ModelOptions::default();
    options.views = views.map(|views| whole("views", views)).transpose()?;
    if options.views == Some(0) {
        return Err(value("views", "0; expected at least 1"));
    }
    options.network = Some(network.is_some());
    options.library = if network.is_some() { installed(py)? } else { None };
    options.file = network;
    Ok(options)
}

/// Refuses `views` where the network takes another number.
pub(crate) fn check_views(views: Option<usize>, renderer: &Renderer) -> PyResult<()> {
    let found = renderer.network().views();
    match views.filter(|&views| views != found) {
        Some(views) => Err(value("views", format!("{views}; the network takes {found}"))),
        None => Ok(()),
    }
}

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
