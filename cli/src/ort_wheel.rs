//! Finds the ONNX Runtime library of a wheel in a Python virtual environment, and advises how to
//! install it.

use std::path::{Path, PathBuf};

use liveview::network::{ExecutionProvider, OrtLibrary, OrtLibraryError};

/// The library of a wheel, in a virtual environment of the working directory or above the program;
/// `None` if `ORT_DYLIB_PATH` is set, which takes precedence.
pub(crate) fn wheel(provider: ExecutionProvider) -> Option<PathBuf> {
    if std::env::var_os("ORT_DYLIB_PATH").is_some_and(|path| !path.is_empty()) {
        return None;
    }
    let pythons = environments_near(environments(provider)).flat_map(|environment| {
        let entries = std::fs::read_dir(environment.join("lib")).into_iter().flatten().flatten();
        let mut pythons: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        pythons.sort();
        pythons
    });
    let mut folders = pythons.map(|python| python.join("site-packages").join("onnxruntime").join("capi"));
    folders.find_map(|folder| OrtLibrary::find_in(&folder, provider))
}

/// Where virtual environments of these names would be: above the program, and in the working directory.
pub(crate) fn environments_near(names: &[&'static str]) -> impl Iterator<Item = PathBuf> {
    let working = std::env::current_dir().unwrap_or_default();
    let program = std::env::current_exe().unwrap_or_default();
    let places: Vec<PathBuf> = program.ancestors().skip(1).take(4).map(Path::to_owned).chain([working]).collect();
    names.iter().copied().flat_map(move |name| places.clone().into_iter().map(move |place| place.join(name)))
}

/// Names of the virtual environments that may hold the wheel with a provider, in order of
/// precedence.
fn environments(provider: ExecutionProvider) -> &'static [&'static str] {
    match provider {
        ExecutionProvider::Cpu => &[".venv"],
        ExecutionProvider::OpenVino => &[".venv-openvino", ".venv"],
        _ => &[".venv-cuda", ".venv"],
    }
}

/// How to install a library that was not found, or one that has the provider.
pub(crate) fn advice(error: &OrtLibraryError) -> Option<String> {
    let (provider, searched) = match error {
        OrtLibraryError::NotFound { provider, .. } => (*provider, true),
        OrtLibraryError::NoProvider { provider, .. } => (*provider, false),
        OrtLibraryError::NotUsable { path, .. } => return missing_libraries(path),
        _ => return None,
    };
    let get = match provider {
        ExecutionProvider::Cpu => {
            "Get it with `make runtime`, or `pip install onnxruntime` and pass its \
             onnxruntime/capi/libonnxruntime.so.* by --ort-lib or ORT_DYLIB_PATH"
        }
        ExecutionProvider::OpenVino => {
            "Get it with `make setup WITH=openvino`, or `pip install onnxruntime-openvino` into a separate environment \
             and pass its onnxruntime/capi/libonnxruntime.so.* by --ort-lib or ORT_DYLIB_PATH"
        }
        _ => {
            "Get it with `pip install onnxruntime-gpu` into a separate environment, .venv-cuda, or pass its \
             onnxruntime/capi/libonnxruntime.so.* by --ort-lib or ORT_DYLIB_PATH"
        }
    };
    let environments = environments(provider).join(" and ");
    let also_searched = format!("Nor is it in {environments} of the working directory and above the program. ");
    Some(if searched { also_searched + get } else { get.to_owned() })
}

/// The libraries that a library needs and that are missing, by `ldd`: the loader's own error does not name them.
fn missing_libraries(path: &Path) -> Option<String> {
    let listed = std::process::Command::new("ldd").arg(path).output().ok()?;
    let text = String::from_utf8_lossy(&listed.stdout).into_owned();
    let missing = text.lines().filter_map(|line| line.trim().strip_suffix(" => not found"));
    let missing = missing.collect::<Vec<_>>().join(", ");
    (!missing.is_empty()).then(|| format!("Missing: {missing}"))
}
