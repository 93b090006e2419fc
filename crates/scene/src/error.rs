//! Errors on opening or reading a scene.

use std::io;
use std::path::{Path, PathBuf};

use liveview::geometry::{CameraError, Size};
use liveview::image::ImageError;

/// Why a scene was refused. Every message names the file, the field and what was expected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The path is neither a folder nor a `transforms.json`, or the folder holds none of the formats.
    #[error("{}: {reason}; expected a transforms.json, or a folder with one of: transforms.json, \
             transforms_train.json (Blender), poses_bounds.npy, models.json (Spaces), \
             cameras.txt with frames/ (RealEstate10K), sparse/0 (COLMAP), cameras that Metashape or RealityCapture exports, \
             reconstruction.json (OpenSfM), cameras.json (3D Gaussian Splatting)", path.display())]
    NoScene {
        /// The path given.
        path: PathBuf,
        /// Why it is not a scene.
        reason: String,
    },
    /// The folder holds photos, and none of the formats.
    #[error("{}: no scene found: {photos} photos, but no camera poses", path.display())]
    NoPoses {
        /// The folder.
        path: PathBuf,
        /// How many photos there are.
        photos: usize,
    },
    /// A file or folder cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A field is missing or holds an unexpected value, such as a path that leaves the scene folder;
    /// or a photo needs more memory than is available.
    #[error("{}: {what}; expected {expected}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The field and its value.
        what: String,
        /// The expected value.
        expected: String,
    },
    /// A file lists no view, or none whose photo there is.
    #[error("{}: no views; expected at least one", path.display())]
    NoViews {
        /// The file.
        path: PathBuf,
    },
    /// A feature of the format that is not implemented, such as a panoramic camera model.
    #[error("{}: {what} is not supported; {hint}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature, by its name in the file.
        what: String,
        /// The supported alternatives, or a way to convert the scene.
        hint: String,
    },
    /// A view's camera is invalid.
    #[error("{}: camera of {image}: {source}", path.display())]
    Camera {
        /// The file that declares the camera.
        path: PathBuf,
        /// The photo it belongs to.
        image: String,
        /// The cause.
        source: CameraError,
    },
    /// Photos that a scene file lists do not exist.
    #[error("{}: missing image, listed in {}; expected it in the scene folder", path.display(), listed_in.display())]
    MissingImage {
        /// The first of them.
        path: PathBuf,
        /// The file that lists it.
        listed_in: PathBuf,
    },
    /// A photo's size differs from the size its intrinsics are declared for.
    #[error("{}: the image is {actual}; {} declares {declared}, expected equal sizes",
            path.display(), declared_in.display())]
    ImageSize {
        /// The photo.
        path: PathBuf,
        /// Its size in pixels.
        actual: Size,
        /// The file that declares another size.
        declared_in: PathBuf,
        /// The declared size.
        declared: Size,
    },
    /// A photo's declared size is that of the photo as its EXIF orientation turns it.
    #[error("{}: the image is {actual}, the poses are for {declared}: its EXIF orientation turns it, and it was not \
             turned on load", path.display())]
    Oriented {
        /// The photo.
        path: PathBuf,
        /// Its size in pixels, as stored.
        actual: Size,
        /// The declared size.
        declared: Size,
    },
    /// No view or several views have that name; the message lists the closest names.
    #[error("{0}")]
    UnknownView(String),
    /// A photo cannot be decoded.
    #[error(transparent)]
    Image(#[from] ImageError),
}

impl SceneError {
    pub(super) fn malformed(path: impl Into<PathBuf>, what: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), what: what.into(), expected: expected.into() }
    }

    pub(super) fn unsupported(path: &Path, what: String, hint: &str) -> Self {
        Self::Unsupported { path: path.to_owned(), what, hint: hint.to_owned() }
    }
}
