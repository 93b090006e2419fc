//! Finding model files: `liveview_v{V}.onnx` and the quantised `liveview_v{V}_int8.onnx`, one of
//! each per number of views V.
//!
//! There may also be models for kinds of layers: `liveview_v{V}_planes.onnx` for competing planes,
//! `liveview_v{V}_planes_paper.onnx` for independent ones, `liveview_v{V}_surface.onnx` for layers
//! along the surface, and their `_int8.onnx`.

use std::path::{Path, PathBuf};

use liveview::network::AlphaKind;

use crate::layer_spec::LayerSpec;

/// No model for that number of views in any of the folders.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no model for {views} views: liveview_v{views}{ending} is not in {looked_in}; there, {found}", looked_in = folder_list(looked_in), found = found_text(found))]
pub struct ModelNotFound {
    /// The number of views V that was requested.
    pub views: usize,
    /// The ending of the file name that was searched for.
    pub ending: &'static str,
    /// The folders, in the order of the search.
    pub looked_in: Vec<PathBuf>,
    /// V of the models in these folders whose names have this ending.
    pub found: Vec<usize>,
}

/// The default folders of models: the one named by the environment variable `LIVEVIEW_MODELS` if it
/// is set, else a `models` folder beside the running program or up to three folders above it.
pub fn model_folders() -> Vec<PathBuf> {
    if let Some(named) = std::env::var_os("LIVEVIEW_MODELS").filter(|v| !v.is_empty()) {
        return vec![named.into()];
    }
    let program = std::env::current_exe().unwrap_or_default();
    program.ancestors().skip(1).take(4).map(|folder| folder.join("models")).collect()
}

/// The model file for `views` views in the first folder that has it; `quantized`: the int8 model.
/// For `layers`, and for planes the way in which they share a pixel (by default they compete): the
/// model trained for that, if any folder has one, else the general model.
///
/// # Errors
///
/// [`ModelNotFound`], with the folders and the V of the models in them.
pub fn find_model(
    folders: Vec<PathBuf>,
    views: usize,
    quantized: bool,
    layers: Option<&LayerSpec>,
    alpha: Option<AlphaKind>,
) -> Result<PathBuf, ModelNotFound> {
    let ending = if quantized { "_int8.onnx" } else { ".onnx" };
    let kind = layers.and_then(|layers| match (layers.kind(), alpha) {
        ("surface", _) => Some("_surface"),
        ("guided", _) => None,
        (_, Some(AlphaKind::Independent)) => Some("_planes_paper"),
        (_, Some(AlphaKind::Competing) | None) => Some("_planes"),
    });
    let for_kind = kind.and_then(|kind| first_with(&folders, views, &format!("{kind}{ending}")));
    for_kind.map_or_else(|| find_in(folders, views, ending), Ok)
}

fn find_in(mut folders: Vec<PathBuf>, views: usize, ending: &'static str) -> Result<PathBuf, ModelNotFound> {
    let mut distinct = std::collections::HashSet::new();
    folders.retain(|folder| distinct.insert(folder.clone()));
    if let Some(file) = first_with(&folders, views, ending) {
        return Ok(file);
    }
    let mut found: Vec<usize> = folders.iter().flat_map(|folder| models_in(folder, ending)).collect();
    found.sort_unstable();
    found.dedup();
    Err(ModelNotFound { views, ending, looked_in: folders, found })
}

fn first_with(folders: &[PathBuf], views: usize, ending: &str) -> Option<PathBuf> {
    // Also a pipe, a folder or a broken link, which is an error that names it when it is opened.
    let is_there = |file: &PathBuf| file.symlink_metadata().is_ok();
    folders.iter().map(|folder| folder.join(format!("liveview_v{views}{ending}"))).find(is_there)
}

/// V of each model in a folder; nothing if it cannot be read.
fn models_in(folder: &Path, ending: &str) -> Vec<usize> {
    let views = |name: &str| name.strip_prefix("liveview_v")?.strip_suffix(ending)?.parse().ok();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| views(entry.file_name().to_str()?)).collect()
}

fn folder_list(folders: &[PathBuf]) -> String {
    folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", ")
}

fn found_text(found: &[usize]) -> String {
    if found.is_empty() {
        return "no model".to_owned();
    }
    let found = found.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    format!("models for V = {found}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_folder_with_the_model_is_used_and_an_error_lists_the_models_found() {
        let root = tempfile::tempdir().unwrap();
        let folders = ["a", "b", "absent"].map(|name| root.path().join(name));
        for (folder, file) in [
            (0, "liveview_v4.onnx"),
            (1, "liveview_v4.onnx"),
            (1, "liveview_v5_int8.onnx"),
            (1, "liveview_v10.onnx"),
            (0, "notes.onnx"),
        ] {
            std::fs::create_dir_all(&folders[folder]).unwrap();
            std::fs::write(folders[folder].join(file), "").unwrap();
        }
        assert_eq!(find_in(folders.to_vec(), 4, ".onnx").unwrap(), folders[0].join("liveview_v4.onnx"));
        let found = |quantized| {
            let [guided, planes] = ["guided:2", "planes:8"].map(|layers| layers.parse().unwrap());
            let kinds = [
                (None, None),
                (Some(&guided), Some(AlphaKind::Competing)),
                (Some(&planes), None),
                (Some(&planes), Some(AlphaKind::Independent)),
            ];
            kinds.map(|(layers, alpha)| find_model(folders.to_vec(), 4, quantized, layers, alpha).unwrap())
        };
        let general = folders[0].join("liveview_v4.onnx");
        assert_eq!(found(false), [(); 4].map(|()| general.clone()));
        for (quantized, ending) in [(false, ".onnx"), (true, "_int8.onnx")] {
            let files = ["", "_planes", "_planes_paper"].map(|of| folders[1].join(format!("liveview_v4{of}{ending}")));
            files.iter().for_each(|file| std::fs::write(file, "").unwrap());
            let [of_folder_b, competing, independent] = files;
            let general = if quantized { of_folder_b } else { general.clone() };
            assert_eq!(found(quantized), [general.clone(), general, competing, independent]);
        }
        {
            let surface = folders[1].join("liveview_v4_surface.onnx");
            std::fs::write(&surface, "").unwrap();
            assert_eq!(find_model(folders.to_vec(), 4, false, Some(&LayerSpec::Surface(1)), None).unwrap(), surface);
        }
        assert_eq!(find_in(folders.to_vec(), 10, ".onnx").unwrap(), folders[1].join("liveview_v10.onnx"));
        assert_eq!(find_in(folders.to_vec(), 5, "_int8.onnx").unwrap(), folders[1].join("liveview_v5_int8.onnx"));
        let missing = find_in(folders.to_vec(), 5, ".onnx").unwrap_err();
        assert_eq!(missing.found, [4, 10]);
        let message = missing.to_string();
        assert!(message.contains("no model for 5 views") && message.contains("V = 4, 10"), "{message}");
    }
}
