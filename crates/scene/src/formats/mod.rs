//! One module per format; each reads its files into [`DeclaredViews`].

mod colmap;
#[cfg(fuzzing)]
pub mod fuzz;
mod llff;
mod points;
mod realestate10k;
mod spaces;
pub(super) mod transforms;

use std::fs;
use std::path::Path;

use super::{DeclaredViews, Format, PhotoSource, SceneError, SceneOptions};

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
pub(super) const READERS: [Reader; 5] = [
    Reader { format: Format::Transforms, is_in: |root| transforms::file_in(root).is_some(), open: transforms::open },
    Reader { format: Format::Llff, is_in: |root| root.join("poses_bounds.npy").is_file(), open: llff::open },
    Reader { format: Format::Spaces, is_in: |root| root.join("models.json").is_file(), open: spaces::open },
    Reader { format: Format::RealEstate10k, is_in: realestate10k::is_in, open: realestate10k::open },
    Reader { format: Format::Colmap, is_in: |root| colmap::model_folder(root).is_some(), open: colmap::open },
];

/// Why no reader opens a folder: what it lacks.
pub(super) fn why_none_reads(folder: &Path) -> String {
    if let Some(model) = colmap::incomplete_model(folder) {
        return format!("no scene found: {model} lacks cameras or images, .bin or .txt");
    }
    let files = [folder.to_owned(), folder.join("images")].into_iter().flat_map(fs::read_dir).flatten().flatten();
    match files.filter(|file| has_extension(&file.path(), &["png", "jpg", "jpeg"])).count() {
        0 => "no scene found".to_owned(),
        photos => format!("no scene found: {photos} photos, but no camera poses (COLMAP can find them)"),
    }
}
