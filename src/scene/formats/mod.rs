//! One module per format; each reads its files into [`DeclaredViews`].

pub(super) mod colmap;
mod json;
pub(super) mod llff;
pub(super) mod ply;
mod points_range;
pub(super) mod poses_bounds;
pub(super) mod realestate10k;
pub(super) mod spaces;
pub(super) mod transforms;

use std::path::Path;

use super::declared::DeclaredViews;
use super::error::SceneError;
use super::format::Format;
use super::options::SceneOptions;
use super::photos::source::PhotoSource;

/// The formats whose files a folder holds, in order of precedence.
pub(super) fn all_in(root: &Path) -> impl Iterator<Item = Format> {
    Format::ALL.into_iter().filter(move |&format| is_in(format, root))
}

fn is_in(format: Format, root: &Path) -> bool {
    match format {
        Format::Transforms => transforms::file_in(root).is_some(),
        Format::Llff => root.join("poses_bounds.npy").is_file(),
        Format::Spaces => root.join("models.json").is_file(),
        Format::RealEstate10k => root.join("cameras.txt").is_file() && !root.join("images.txt").is_file(),
        Format::Colmap => colmap::model_folder(root).is_some(),
        Format::Memory => false,
    }
}

/// Reads the files of a format in a scene folder; `file` is the one to read, if it was given.
pub(super) fn read(
    format: Format,
    root: &Path,
    file: Option<&Path>,
    photos: &dyn PhotoSource,
    options: &SceneOptions,
) -> Result<DeclaredViews, SceneError> {
    match format {
        Format::Transforms => {
            let file = file.map(Path::to_owned).or_else(|| transforms::file_in(root));
            transforms::open(root, &file.unwrap_or_else(|| root.join("transforms.json")), photos, options)
        }
        Format::Llff => llff::open(root, photos, options),
        Format::Spaces => spaces::open(root, photos, options),
        Format::RealEstate10k => realestate10k::open(root, photos, options),
        Format::Colmap => colmap::open(root, photos, options),
        Format::Memory => Err(SceneError::malformed(root, "no files of a scene", "one of the formats")),
    }
}
