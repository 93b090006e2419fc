//! ONNX Runtime: where its library is found, and the one environment of the process.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use ort::environment::Environment;

use crate::engine::Engine;

/// Why ONNX Runtime could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// No library file was found.
    #[error(
        "no ONNX Runtime library for the engine {engine} was found (looked in {looked_in}). {hint}",
        hint = engine.how_to_get()
    )]
    NotFound {
        /// The engine asked for.
        engine: Engine,
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
    /// The library does not have the engine asked for.
    #[error("{path}: this ONNX Runtime library has no engine {engine}. {hint}", path = path.display(), hint = engine.how_to_get())]
    NoEngine {
        /// The file.
        path: PathBuf,
        /// The engine asked for.
        engine: Engine,
    },
    /// This build of liveview does not have the engine asked for.
    #[error("the engine {engine} is not compiled in: build liveview with the cargo feature `{feature}`")]
    NotCompiled {
        /// The engine asked for.
        engine: Engine,
        /// The feature it needs.
        feature: &'static str,
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

/// A loaded ONNX Runtime, and the engine to use of it. Clones share it.
#[derive(Clone)]
pub struct Runtime {
    pub(crate) environment: Environment,
    library: PathBuf,
    engine: Engine,
}

/// One environment per process is all that ONNX Runtime has.
static LOADED: Mutex<Option<Runtime>> = Mutex::new(None);

impl Runtime {
    /// Load the library, for [`Engine::Cpu`]: `library` if given, else `ORT_DYLIB_PATH`, else the wheel in a `.venv` of the
    /// working directory or above the binary, else the system's.
    pub fn load(library: Option<&Path>) -> Result<Self, RuntimeError> {
        Self::load_for(Engine::Cpu, library)
    }

    /// Load a library that has `engine`: as [`Runtime::load`], but a wheel with OpenVINO is first looked for in
    /// `.venv-openvino`, one with CUDA or TensorRT in `.venv-cuda`. A process can load one library only.
    pub fn load_for(engine: Engine, library: Option<&Path>) -> Result<Self, RuntimeError> {
        if let Some(feature) = engine.missing_feature() {
            return Err(RuntimeError::NotCompiled { engine, feature });
        }
        let runtime = Self { engine, ..Self::load_library(engine, library)? };
        engine.check(&runtime.library)?;
        Ok(runtime)
    }

    #[cfg(feature = "load-dynamic")]
    fn load_library(engine: Engine, library: Option<&Path>) -> Result<Self, RuntimeError> {
        let library = match library.map(Path::to_path_buf).or_else(from_environment) {
            Some(named) => named,
            None => find(engine)?,
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
        let runtime = Self { environment, library, engine };
        *loaded = Some(runtime.clone());
        Ok(runtime)
    }

    /// The library linked at build time; `library` must not be given.
    #[cfg(not(feature = "load-dynamic"))]
    fn load_library(engine: Engine, library: Option<&Path>) -> Result<Self, RuntimeError> {
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
        let runtime = Self { environment, library: linked, engine };
        *loaded = Some(runtime.clone());
        Ok(runtime)
    }

    /// The library file in use.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// The engine that sessions use.
    pub fn engine(&self) -> Engine {
        self.engine
    }
}

#[cfg(feature = "load-dynamic")]
fn from_environment() -> Option<PathBuf> {
    std::env::var_os("ORT_DYLIB_PATH").filter(|v| !v.is_empty()).map(PathBuf::from)
}

/// The library in a virtual environment or on the system, in a folder that has the engine.
#[cfg(feature = "load-dynamic")]
fn find(engine: Engine) -> Result<PathBuf, RuntimeError> {
    let working = std::env::current_dir().unwrap_or_default();
    let binary = std::env::current_exe().unwrap_or_default();
    let places: Vec<_> = binary.ancestors().skip(1).take(4).chain([working.as_path()]).collect();
    let environments = engine.environments().iter().flat_map(|name| places.iter().map(move |place| place.join(name)));
    let wheels = environments
        .flat_map(|venv| children(&venv.join("lib")))
        .map(|python| python.join("site-packages").join("onnxruntime").join("capi"));
    let system =
        ["/usr/local/lib", "/usr/lib", "/usr/lib64", "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"];
    let provider = format!("onnxruntime_providers_{engine}.");
    let named = |file: &PathBuf, is: &dyn Fn(&str) -> bool| is(&file.file_name().unwrap_or_default().to_string_lossy());
    let has_engine = |files: &Vec<PathBuf>| {
        engine == Engine::Cpu || files.iter().any(|f| named(f, &|name| name.contains(&provider)))
    };
    let folders = wheels.chain(system.map(PathBuf::from)).map(|folder| children(&folder)).filter(has_engine);
    let found = folders.flatten().find(|file| {
        named(file, &|name| {
            name.starts_with("libonnxruntime.so") || name == "libonnxruntime.dylib" || name == "onnxruntime.dll"
        })
    });
    found.ok_or_else(|| RuntimeError::NotFound {
        engine,
        looked_in: format!(
            "--ort-lib, ORT_DYLIB_PATH, {} of the working directory and above the binary, system library folders",
            engine.environments().join(" and ")
        ),
    })
}

/// What lies in a folder, sorted; nothing if it cannot be read.
#[cfg(feature = "load-dynamic")]
fn children(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    entries.sort();
    entries
}
