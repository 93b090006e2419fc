//! The ONNX Runtime library: finding it, loading it, and its environment, one per process.

use std::fmt;
#[cfg(feature = "load-dynamic")]
use std::fs::File;
#[cfg(feature = "load-dynamic")]
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use ort::environment::Environment;

#[cfg(feature = "load-dynamic")]
use super::check_file;
use super::execution_provider::ExecutionProvider;

/// Why ONNX Runtime could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OrtLibraryError {
    /// No library file was found.
    #[error("no ONNX Runtime library with the execution provider {provider} was found (looked in {looked_in})")]
    NotFound {
        /// The requested provider.
        provider: ExecutionProvider,
        /// The places that were searched, as text.
        looked_in: String,
    },
    /// A library was given, or found, and could not be loaded.
    #[error("{path}: not a usable ONNX Runtime library (expected version 1.24 or later): {reason}", path = path.display())]
    NotUsable {
        /// The file.
        path: PathBuf,
        /// The loader's message.
        reason: String,
    },
    /// The library does not have the requested provider.
    #[error("{path}: this ONNX Runtime library has no execution provider {provider}", path = path.display())]
    NoProvider {
        /// The file.
        path: PathBuf,
        /// The requested provider.
        provider: ExecutionProvider,
    },
    /// This build does not have the requested provider.
    #[error("the execution provider {provider} is not compiled in: build with the cargo feature `{feature}`")]
    NotCompiled {
        /// The requested provider.
        provider: ExecutionProvider,
        /// The feature it needs.
        feature: &'static str,
    },
    /// This process has already loaded another library.
    #[error("{asked}: this process already loaded {loaded}, and can load only one", asked = asked.display(), loaded = loaded.display())]
    AlreadyLoaded {
        /// The requested file.
        asked: PathBuf,
        /// The file in use.
        loaded: PathBuf,
    },
}

/// A loaded ONNX Runtime library, and which of its execution providers to use. Clones share the
/// library.
#[derive(Clone)]
pub struct OrtLibrary {
    pub(super) environment: Environment,
    path: PathBuf,
    provider: ExecutionProvider,
}

impl fmt::Debug for OrtLibrary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OrtLibrary").field("path", &self.path).field("provider", &self.provider).finish_non_exhaustive()
    }
}

/// Where Linux keeps libraries.
#[cfg(feature = "load-dynamic")]
const FOLDERS: [&str; 5] =
    ["/usr/local/lib", "/usr/lib", "/usr/lib64", "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"];

/// ONNX Runtime has one environment per process.
static LOADED: Mutex<Option<OrtLibrary>> = Mutex::new(None);

impl OrtLibrary {
    /// Loads the library at `path` if given, else at the environment variable `ORT_DYLIB_PATH` (a name
    /// without a folder is searched in the folders that follow), else from the folders of `LD_LIBRARY_PATH`
    /// and the system's, to compute on `provider`. A process can load only
    /// one library. With the cargo feature `download-binaries` in place of `load-dynamic` the
    /// library is linked at build time, and `path` must be `None`.
    ///
    /// # Errors
    ///
    /// [`OrtLibraryError`] if there is no library, it cannot be loaded, it or this build lacks the
    /// provider, or another one is loaded already.
    pub fn load(provider: ExecutionProvider, path: Option<&Path>) -> Result<Self, OrtLibraryError> {
        if let Some(feature) = provider.missing_feature() {
            return Err(OrtLibraryError::NotCompiled { provider, feature });
        }
        let library = Self { provider, ..Self::load_library(provider, path)? };
        match provider.is_available() {
            Ok(true) => Ok(library),
            Ok(false) => Err(OrtLibraryError::NoProvider { path: library.path, provider }),
            Err(error) => Err(OrtLibraryError::NotUsable { path: library.path, reason: error.to_string() }),
        }
    }

    /// The ONNX Runtime library file in a folder, if the folder holds one with `provider`.
    #[cfg(feature = "load-dynamic")]
    pub fn find_in(folder: &Path, provider: ExecutionProvider) -> Option<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        files.sort();
        let name = |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let beside = format!("onnxruntime_providers_{provider}.");
        if provider != ExecutionProvider::Cpu && !files.iter().any(|file| name(file).contains(&beside)) {
            return None;
        }
        files.into_iter().find(|file| {
            let name = name(file);
            name.starts_with("libonnxruntime.so") || name == "libonnxruntime.dylib" || name == "onnxruntime.dll"
        })
    }

    /// The file that [`Self::load`] loads.
    #[cfg(feature = "load-dynamic")]
    fn file(provider: ExecutionProvider, path: Option<&Path>) -> Result<PathBuf, OrtLibraryError> {
        let variable = |name| std::env::var_os(name).filter(|value| !value.is_empty());
        let paths = variable("LD_LIBRARY_PATH").unwrap_or_default();
        let folders: Vec<PathBuf> = std::env::split_paths(&paths).chain(FOLDERS.map(PathBuf::from)).collect();
        let named = path.map(Path::to_path_buf).or_else(|| {
            let file = PathBuf::from(variable("ORT_DYLIB_PATH")?);
            // A name without a folder is one that the loader searches for.
            let mut searched = folders.iter().filter(|_| file.components().count() == 1).map(|at| at.join(&file));
            searched.find(|file| file.is_file()).or(Some(file))
        });
        let of_system = || folders.iter().find_map(|folder| Self::find_in(folder, provider));
        let library = named.or_else(of_system).ok_or_else(|| {
            let looked_in = "ORT_DYLIB_PATH, LD_LIBRARY_PATH, system library folders".to_owned();
            OrtLibraryError::NotFound { provider, looked_in }
        })?;
        Ok(std::path::absolute(&library).unwrap_or(library))
    }

    /// What stands for the library linked at build time; `path` must not be given.
    #[cfg(not(feature = "load-dynamic"))]
    fn file(_: ExecutionProvider, path: Option<&Path>) -> Result<PathBuf, OrtLibraryError> {
        let loaded = PathBuf::from("(linked at build time)");
        path.map_or(Ok(loaded.clone()), |asked| {
            Err(OrtLibraryError::AlreadyLoaded { asked: asked.to_path_buf(), loaded })
        })
    }

    fn load_library(provider: ExecutionProvider, path: Option<&Path>) -> Result<Self, OrtLibraryError> {
        let library = Self::file(provider, path)?;
        let mut loaded = LOADED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(loaded) = loaded.as_ref() {
            if loaded.path == library {
                return Ok(loaded.clone());
            }
            return Err(OrtLibraryError::AlreadyLoaded { asked: library, loaded: loaded.path.clone() });
        }
        let unusable = |reason: String| OrtLibraryError::NotUsable { path: library.clone(), reason };
        #[cfg(feature = "load-dynamic")]
        let builder = {
            check_file(&library).map_err(unusable)?;
            check_length(&library).map_err(unusable)?;
            ort::init_from(&library).map_err(|e| unusable(e.to_string()))?
        };
        #[cfg(not(feature = "load-dynamic"))]
        let builder = ort::init();
        // Its log is discarded: it repeats, on standard error, the errors that are returned.
        let builder = builder.with_name("liveview").with_telemetry(false).with_logger(Arc::new(|_, _, _, _, _| {}));
        let environment = builder.build().map_err(|e| unusable(e.to_string()))?;
        let library = Self { environment, path: library, provider };
        *loaded = Some(library.clone());
        Ok(library)
    }

    /// The library file in use.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The execution provider that sessions use.
    pub fn provider(&self) -> ExecutionProvider {
        self.provider
    }
}

/// Refuses a truncated library: the loader maps it all the same, and the process is killed (SIGBUS) at the
/// first missing page. Truncated is a 64-bit little-endian ELF file that ends before its section headers do:
/// linkers write these last. Other files, and files that cannot be read, are left to the loader.
#[cfg(feature = "load-dynamic")]
fn check_length(path: &Path) -> Result<(), String> {
    let mut header = [0; 64];
    let read = File::open(path).and_then(|mut file| {
        file.read_exact(&mut header)?;
        file.metadata()
    });
    let (Ok(about), true) = (read, header.starts_with(b"\x7fELF\x02\x01")) else { return Ok(()) };
    let [e_shentsize, e_shnum] = [0x3A, 0x3C].map(|at| u64::from(u16::from_le_bytes([header[at], header[at + 1]])));
    let e_shoff = u64::from_le_bytes(std::array::from_fn(|i| header[0x28 + i]));
    let (length, needed) = (about.len(), e_shoff.saturating_add(e_shnum * e_shentsize));
    if length < needed { Err(format!("the file is truncated: {length} bytes, expected {needed}")) } else { Ok(()) }
}

#[cfg(all(test, feature = "load-dynamic"))]
mod tests {
    use super::*;

    #[test]
    fn truncated_library_is_an_error_and_other_files_are_not() {
        let complete = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("library.so");
        let check = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            check_length(&path)
        };
        for other in [&b""[..], b"#!/bin/sh\n", &complete[..40]] {
            assert_eq!(check(other), Ok(()));
        }
        if complete.starts_with(b"\x7fELF\x02\x01") {
            assert_eq!(check(&complete), Ok(()));
            for length in [100, 4096, complete.len() / 2, complete.len() - 1] {
                let refused = check(&complete[..length]).unwrap_err();
                assert!(refused.starts_with(&format!("the file is truncated: {length} bytes, expected ")), "{refused}");
            }
        }
    }
}
