//! ONNX Runtime: where its library is found, and the one environment of the process.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use ort::environment::Environment;

/// Why ONNX Runtime could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// No library file was found.
    #[error(
        "the ONNX Runtime library was not found (looked in {looked_in}). Get it with `make runtime`, or \
         `pip install onnxruntime` and pass its onnxruntime/capi/libonnxruntime.so.* by --ort-lib or ORT_DYLIB_PATH"
    )]
    NotFound {
        /// The places, in words.
        looked_in: String,
    },
    /// A library was named, or found, and could not be loaded.
    #[error("{path}: not a usable ONNX Runtime library (version 1.24 or later is expected): {reason}", path = path.display())]
    NotUsable {
        /// The file.
        path: PathBuf,
        /// What the loader said.
        reason: String,
    },
    /// This process already runs another library.
    #[error("{asked}: this process already loaded {loaded}, and can load only one", asked = asked.display(), loaded = loaded.display())]
    AlreadyLoaded {
        /// The file asked for.
        asked: PathBuf,
        /// The file in use.
        loaded: PathBuf,
    },
}

/// A loaded ONNX Runtime. Clones share it.
#[derive(Clone)]
pub struct Runtime {
    pub(crate) environment: Environment,
    library: PathBuf,
}

/// One environment per process is all that ONNX Runtime has.
static LOADED: Mutex<Option<Runtime>> = Mutex::new(None);

impl Runtime {
    /// Load the library: `library` if given, else `ORT_DYLIB_PATH`, else the wheel in a `.venv` of the working directory or
    /// above the binary, else the system's.
    #[cfg(feature = "load-dynamic")]
    pub fn load(library: Option<&Path>) -> Result<Self, RuntimeError> {
        let library = match library.map(Path::to_path_buf).or_else(from_environment) {
            Some(named) => named,
            None => find()?,
        };
        let library = std::path::absolute(&library).unwrap_or(library);
        let mut loaded = LOADED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(runtime) = loaded.as_ref() {
            if runtime.library == library {
                return Ok(runtime.clone());
            }
            return Err(RuntimeError::AlreadyLoaded { asked: library, loaded: runtime.library.clone() });
        }
        let unusable = |reason: String| RuntimeError::NotUsable { path: library.clone(), reason };
        if !library.is_file() {
            return Err(unusable("there is no such file".into()));
        }
        let builder = ort::init_from(&library).map_err(|e| unusable(e.to_string()))?;
        let environment =
            builder.with_name("liveview").with_telemetry(false).build().map_err(|e| unusable(e.to_string()))?;
        let runtime = Self { environment, library };
        *loaded = Some(runtime.clone());
        Ok(runtime)
    }

    /// The library linked at build time; `library` must not be given.
    #[cfg(not(feature = "load-dynamic"))]
    pub fn load(library: Option<&Path>) -> Result<Self, RuntimeError> {
        let linked = PathBuf::from("(linked at build time)");
        if let Some(asked) = library {
            return Err(RuntimeError::AlreadyLoaded { asked: asked.to_path_buf(), loaded: linked });
        }
        let mut loaded = LOADED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(runtime) = loaded.as_ref() {
            return Ok(runtime.clone());
        }
        let unusable = |e: ort::Error| RuntimeError::NotUsable { path: linked.clone(), reason: e.to_string() };
        let environment = ort::init().with_name("liveview").with_telemetry(false).build().map_err(unusable)?;
        let runtime = Self { environment, library: linked };
        *loaded = Some(runtime.clone());
        Ok(runtime)
    }

    /// The library file in use.
    pub fn library(&self) -> &Path {
        &self.library
    }
}

#[cfg(feature = "load-dynamic")]
fn from_environment() -> Option<PathBuf> {
    std::env::var_os("ORT_DYLIB_PATH").filter(|v| !v.is_empty()).map(PathBuf::from)
}

/// The library in a virtual environment or on the system.
#[cfg(feature = "load-dynamic")]
fn find() -> Result<PathBuf, RuntimeError> {
    let working = std::env::current_dir().unwrap_or_default();
    let binary = std::env::current_exe().unwrap_or_default();
    let environments = binary.ancestors().skip(1).take(4).chain([working.as_path()]).map(|folder| folder.join(".venv"));
    let wheels = environments
        .flat_map(|venv| children(&venv.join("lib")))
        .map(|python| python.join("site-packages").join("onnxruntime").join("capi"));
    let system =
        ["/usr/local/lib", "/usr/lib", "/usr/lib64", "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"];
    let found = wheels.chain(system.map(PathBuf::from)).flat_map(|folder| children(&folder)).find(|file| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libonnxruntime.so") || name == "libonnxruntime.dylib" || name == "onnxruntime.dll"
    });
    found.ok_or_else(|| RuntimeError::NotFound {
        looked_in:
            "--ort-lib, ORT_DYLIB_PATH, .venv of the working directory and above the binary, system library folders"
                .into(),
    })
}

/// What lies in a folder, sorted; nothing if it cannot be read.
#[cfg(feature = "load-dynamic")]
fn children(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    entries.sort();
    entries
}
