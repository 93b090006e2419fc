//! One module per format; each reads its files into [`DeclaredViews`].

mod colmap;
#[cfg(feature = "fuzzing")]
pub mod fuzz;
mod gaussians;
mod llff;
mod metashape;
mod realestate10k;
mod spaces;
pub(super) mod transforms;

use std::fs;
use std::path::{Path, PathBuf};

use super::{DeclaredViews, Format, PhotoSource, SceneError, SceneOptions};
use crate::photo_folder::EXTENSIONS;

use liveview_files::has_extension;

/// How the files of a format are recognised and read.
pub(super) struct Reader {
    pub(super) format: Format,
    /// Whether a folder holds its files.
    pub(super) is_in: fn(&Path) -> bool,
    /// Reads them, given the folder.
    pub(super) open: fn(&Path, &dyn PhotoSource, &SceneOptions) -> Result<DeclaredViews, SceneError>,
}

/// The readers, in order of precedence.
pub(super) const READERS: [Reader; 7] = [
    Reader { format: Format::Transforms, is_in: |root| transforms::file_in(root).is_some(), open: transforms::open },
    Reader { format: Format::Colmap, is_in: colmap::is_in, open: colmap::open },
    Reader { format: Format::Llff, is_in: |root| root.join("poses_bounds.npy").is_file(), open: llff::open },
    Reader { format: Format::Spaces, is_in: |root| root.join("models.json").is_file(), open: spaces::open },
    Reader { format: Format::RealEstate10k, is_in: realestate10k::is_in, open: realestate10k::open },
    Reader { format: Format::Metashape, is_in: metashape::is_in, open: metashape::open },
    Reader { format: Format::Gaussians, is_in: |root| root.join("cameras.json").is_file(), open: gaussians::open },
];

/// Files of formats that are not read, the beginning of a file's name or its extension: which programs' they are, and what
/// converts them.
const NOT_READ: [(&str, &str); 9] = [
    ("keyframes", "Polycam's raw data: `ns-process-data polycam` converts it"),
    (
        "cameras_sphere.npz",
        "NeuS, DTU: K and pose of each photo (OpenCV's decomposeProjectionMatrix of world_mat) belong into a transforms.json",
    ),
    ("reconstruction.json", "OpenSfM, ODM: `opensfm export_colmap` writes a model for COLMAP"),
    (".csv", "RealityCapture (RealityScan): export \"COLMAP\" there, or `ns-process-data realitycapture`"),
    (".out", "Bundler: export \"COLMAP\" in the program that wrote it"),
    (".nvm", "VisualSfM: open it in Meshroom or COLMAP, or export \"COLMAP\""),
    (".psx", "a Metashape project: File, Export, Export Cameras (.xml)"),
    (".rcproj", "a RealityCapture project: export \"COLMAP\" there"),
    (".sfm", "Meshroom: its node ConvertSfMFormat writes other formats"),
];

/// The only folder in a folder, if this holds a scene and the outer one holds none.
pub(super) fn folder_within(path: &Path) -> Option<PathBuf> {
    let is_scene = |folder: &Path| READERS.iter().any(|reader| (reader.is_in)(folder));
    if !path.is_dir() || is_scene(path) {
        return None;
    }
    let entries = fs::read_dir(path).ok()?.flatten().map(|entry| entry.path());
    let mut folders = entries.filter(|path| path.is_dir() && is_scene(path));
    folders.next().filter(|_| folders.next().is_none())
}

/// Why no reader opens a folder: what it lacks.
pub(super) fn why_none_reads(folder: &Path) -> SceneError {
    let path = folder.to_owned();
    if let Some(model) = colmap::incomplete_model(folder) {
        let reason = format!("no scene found: {model} lacks cameras or images, .bin or .txt");
        return SceneError::NoScene { path, reason };
    }
    let names = || fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let is_of = |kind: &str| names().any(|name| name.to_string_lossy().to_lowercase().ends_with(kind));
    if let Some((kind, what)) = NOT_READ.into_iter().find(|(kind, _)| is_of(kind)) {
        let hint = what.to_owned();
        return SceneError::Unsupported { path, what: format!("a file {kind}"), hint };
    }
    let folders = ["", "images", "input"].map(|name| folder.join(name));
    let files = folders.into_iter().flat_map(fs::read_dir).flatten().flatten();
    match files.filter(|file| has_extension(&file.path(), &EXTENSIONS)).count() {
        0 => SceneError::NoScene { path, reason: "no scene found".to_owned() },
        photos => SceneError::NoPoses { path, photos },
    }
}
