//! One module per format; each reads its files into [`DeclaredViews`].

mod colmap;
#[cfg(feature = "fuzzing")]
pub mod fuzz;
mod gaussians;
mod llff;
mod metashape;
mod opensfm;
mod realestate10k;
mod realitycapture;
mod spaces;
pub(super) mod transforms;

use std::fs;
use std::path::{Path, PathBuf};

use super::{DeclaredViews, Format, SceneError, SceneOptions};
use crate::photo_folder::EXTENSIONS;
use crate::photos::PhotoLookup;
use crate::scene_file::{read, read_json};

use liveview_files::has_extension;

/// How the files of a format are recognised and read.
pub(super) struct Reader(pub(super) Format, pub(super) Find, Open);

/// The file of a format in a folder; of COLMAP the folder itself.
type Find = fn(&Path) -> Option<PathBuf>;

/// The views of a file, given its bytes.
type Views = fn(&[u8], &SceneOptions, PhotoLookup<'_>) -> Result<DeclaredViews, SceneError>;

/// How it is read.
enum Open {
    /// Given its bytes; it is all that is read.
    Alone(Views),
    /// With others.
    WithOthers(fn(&SceneOptions, PhotoLookup<'_>) -> Result<DeclaredViews, SceneError>),
}

impl Reader {
    /// Reads the file that was found.
    pub(super) fn read(&self, options: &SceneOptions, photos: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
        match self.2 {
            Open::Alone(views) if has_extension(photos.listed_in, &["json"]) => {
                views(&read_json(photos.listed_in)?, options, photos)
            }
            Open::Alone(views) => views(&read(photos.listed_in)?, options, photos),
            Open::WithOthers(open) => open(options, photos),
        }
    }
}

/// The readers, in order of precedence.
pub(super) const READERS: [Reader; 9] = [
    Reader(Format::Transforms, |root| file(root, &transforms::NAMES), Open::WithOthers(transforms::open)),
    Reader(Format::Colmap, colmap::model_in, Open::WithOthers(colmap::open)),
    Reader(Format::Llff, |root| file(root, &["poses_bounds.npy"]), Open::WithOthers(llff::open)),
    Reader(Format::Spaces, |root| file(root, &["models.json"]), Open::Alone(spaces::views)),
    Reader(Format::RealEstate10k, realestate10k::file_in, Open::WithOthers(realestate10k::open)),
    Reader(Format::Metashape, |root| file_with(root, "xml", b"<chunk"), Open::Alone(metashape::views)),
    Reader(Format::RealityCapture, |root| file_with(root, "csv", b",pitch,roll,f"), Open::Alone(realitycapture::views)),
    Reader(Format::OpenSfm, |root| file(root, &opensfm::NAMES), Open::Alone(opensfm::views)),
    Reader(Format::Gaussians, |root| file(root, &["cameras.json"]), Open::Alone(gaussians::views)),
];

/// Files of formats that are not read, the beginning of a file's name or its extension: which programs' they are, and what
/// converts them.
const NOT_READ: [(&str, &str); 8] = [
    ("keyframes", "Polycam's raw data: `ns-process-data polycam` converts it"),
    (
        "cameras_sphere.npz",
        "NeuS, DTU: K and pose of each photo (OpenCV's decomposeProjectionMatrix of world_mat) belong into a transforms.json",
    ),
    (".csv", "RealityCapture (RealityScan): export \"Internal/External camera parameters\" there"),
    (".out", "Bundler: export \"COLMAP\" in the program that wrote it"),
    (".nvm", "VisualSfM: open it in Meshroom or COLMAP, or export \"COLMAP\""),
    (".psx", "a Metashape project: File, Export, Export Cameras (.xml)"),
    (".rcproj", "a RealityCapture project: export \"COLMAP\" there"),
    (".sfm", "Meshroom: its node ConvertSfMFormat writes other formats"),
];

/// The first of these files that a folder holds.
fn file(root: &Path, names: &[&str]) -> Option<PathBuf> {
    names.iter().map(|name| root.join(name)).find(|path| path.is_file())
}

/// The file of this extension in a folder whose beginning holds `word`.
fn file_with(root: &Path, extension: &str, word: &[u8]) -> Option<PathBuf> {
    let mut files = fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path());
    let holds = |bytes: Vec<u8>| bytes.windows(word.len()).take(4096).any(|part| part == word);
    files.find(|path| has_extension(path, &[extension]) && path.is_file() && read(path).is_ok_and(holds))
}

/// The only folder in a folder, if this holds a scene and the outer one holds none.
pub(super) fn folder_within(path: &Path) -> Option<PathBuf> {
    let is_scene = |folder: &Path| READERS.iter().any(|reader| (reader.1)(folder).is_some());
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
    let mut models = colmap::MODEL_FOLDERS.into_iter().filter(|name| !name.is_empty());
    if let Some(model) = models.find(|name| folder.join(name).is_dir()) {
        let reason = format!("no scene found: {model} lacks cameras or images, .bin or .txt");
        return SceneError::NoScene { path, reason };
    }
    let names = || fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let is_of = |kind: &str| names().any(|name| name.to_string_lossy().to_lowercase().ends_with(kind));
    if let Some((kind, what)) = NOT_READ.into_iter().find(|(kind, _)| is_of(kind)) {
        return SceneError::unsupported(folder, format!("a file {kind}"), what);
    }
    let folders = ["", "images", "input"].map(|name| folder.join(name));
    let files = folders.into_iter().flat_map(fs::read_dir).flatten().flatten();
    match files.filter(|file| has_extension(&file.path(), &EXTENSIONS)).count() {
        0 => SceneError::NoScene { path, reason: "no scene found".to_owned() },
        photos => SceneError::NoPoses { path, photos },
    }
}
