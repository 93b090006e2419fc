//! Posed photos from a folder, in whichever of five formats it holds.
//!
//! | format | recognised by | camera axes, pose | intrinsics |
//! |---|---|---|---|
//! | nerfstudio, instant-ngp | `transforms.json` | OpenGL, world from camera | pixels |
//! | LLFF | `poses_bounds.npy` | [down, right, backwards], world from camera | pixels of the full-size photos |
//! | Spaces | `models.json` | OpenCV, angle-axis and centre | pixels of the declared size |
//! | RealEstate10K | `cameras.txt` and `frames/` | OpenCV, camera from world | fractions of width and height |
//! | COLMAP | `sparse/0`, `sparse` or the folder itself | OpenCV, camera from world | pixels |
//!
//! All become [`Camera`]s: OpenCV axes, `cam_from_world`, K in pixels with pixel centres at half-integers, which all five
//! formats share. Where several lie in one folder, the first of the table is read. Nothing in a file is trusted: counts are
//! checked against the file's length, paths must stay in the folder, sizes must be those of the photos, and no file may be larger
//! than [`crate::fs::bounded`] says.

mod draft;
mod error;
mod files;
mod find;
mod formats;
#[cfg(fuzzing)]
pub mod fuzz;
mod undistort;

use std::fmt;
use std::path::{Path, PathBuf};

use draft::Drafts;
pub use error::SceneError;
use formats::{colmap, llff, realestate10k, spaces, transforms};
use undistort::Distortion;

use crate::geometry::Camera;
use crate::image::{self, ImageRgb};

/// The format a scene was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// nerfstudio / instant-ngp `transforms.json`.
    Transforms,
    /// LLFF `poses_bounds.npy`.
    Llff,
    /// DeepView Spaces `models.json`.
    Spaces,
    /// RealEstate10K `cameras.txt` with `frames/`.
    RealEstate10k,
    /// COLMAP sparse model, binary or text.
    Colmap,
}

impl Format {
    const ALL: [Self; 5] = [Self::Transforms, Self::Llff, Self::Spaces, Self::RealEstate10k, Self::Colmap];

    fn is_in(self, root: &Path) -> bool {
        match self {
            Self::Transforms => root.join("transforms.json").is_file(),
            Self::Llff => root.join("poses_bounds.npy").is_file(),
            Self::Spaces => root.join("models.json").is_file(),
            Self::RealEstate10k => root.join("cameras.txt").is_file() && !root.join("images.txt").is_file(),
            Self::Colmap => colmap::model_folder(root).is_some(),
        }
    }

    fn open(self, root: &Path, options: &SceneOptions) -> Result<Drafts, SceneError> {
        match self {
            Self::Transforms => transforms::open(root, options),
            Self::Llff => llff::open(root, options),
            Self::Spaces => spaces::open(root, options),
            Self::RealEstate10k => realestate10k::open(root, options),
            Self::Colmap => colmap::open(root, options),
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Transforms => "transforms.json (nerfstudio, instant-ngp)",
            Self::Llff => "LLFF poses_bounds.npy",
            Self::Spaces => "Spaces models.json",
            Self::RealEstate10k => "RealEstate10K",
            Self::Colmap => "COLMAP",
        })
    }
}

/// How to open a scene.
#[derive(Debug, Clone, Default)]
pub struct SceneOptions {
    /// Photos wider than this many pixels are scaled down on load, their intrinsics with them.
    pub width: Option<usize>,
    /// Folder of the photos inside an LLFF, RealEstate10K or COLMAP scene, instead of the usual search (`images_8`, `images_4`, …).
    pub images: Option<String>,
    /// Which rig position of a Spaces scene, counted from 0.
    pub rig_position: usize,
}

/// One posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// The photo's path below the folder that all photos share: usually its file name.
    pub name: String,
    /// The camera, at the size [`Scene::load_image`] returns.
    pub camera: Camera,
    /// Near and far depth, in scene units, where the format tells them; 0 < near < far.
    pub depth_range: Option<(f64, f64)>,
    image: PathBuf,
    native: Camera,
    distortion: Option<Distortion>,
}

impl View {
    /// Path of the photo.
    pub fn image_path(&self) -> &Path {
        &self.image
    }

    /// The camera at the photo's own size.
    pub fn native_camera(&self) -> &Camera {
        &self.native
    }

    /// Name and value of the coefficients of OpenCV's lens distortion, which [`Scene::load_image`] undoes; all 0 for none.
    pub fn distortion(&self) -> [(&'static str, f64); 5] {
        self.distortion.unwrap_or_default().fields()
    }
}

/// The posed photos of a folder.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The folder.
    pub root: PathBuf,
    /// What it was read as.
    pub format: Format,
    /// At least one, in byte order of their names.
    pub views: Vec<View>,
    /// Everything that was skipped or assumed, by name, for the user to read.
    pub notes: Vec<String>,
}

impl Scene {
    /// Opens a folder. Only the headers of the photos are read; every camera is valid and every photo has the right size.
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the file and the field.
    pub fn open(path: &Path, options: &SceneOptions) -> Result<Self, SceneError> {
        let no_scene = |reason: &str| SceneError::NoScene { path: path.to_owned(), reason: reason.to_owned() };
        if !path.exists() {
            return Err(no_scene("does not exist"));
        }
        if !path.is_dir() {
            return Err(no_scene("is not a folder"));
        }
        let mut found = Format::ALL.into_iter().filter(|format| format.is_in(path));
        let format = found.next().ok_or_else(|| no_scene("no scene found"))?;
        let (views, mut notes) = draft::finish(path, format.open(path, options)?, options)?;
        notes.extend(found.map(|other| format!("the folder also holds {other}: not read, {format} comes first")));
        Ok(Self { root: path.to_owned(), format, views, notes })
    }

    /// Decodes the photo of a view: distortion undone, then scaled down to the size of its camera.
    ///
    /// # Errors
    ///
    /// [`SceneError::Image`] if the file is damaged or cut short; [`SceneError::ImageSize`] if it changed since `open`.
    ///
    /// # Panics
    ///
    /// If there is no view `index`.
    pub fn load_image(&self, index: usize) -> Result<ImageRgb, SceneError> {
        self.fit(index, image::load(&self.views[index].image)?)
    }

    /// A photo of the view's camera, made that of [`View::camera`]: distortion undone, then scaled down.
    ///
    /// # Errors
    ///
    /// [`SceneError::ImageSize`] if it has another size than the view's own photo.
    ///
    /// # Panics
    ///
    /// If there is no view `index`.
    pub fn fit(&self, index: usize, mut photo: ImageRgb) -> Result<ImageRgb, SceneError> {
        let View { camera, native, image, distortion, .. } = &self.views[index];
        let (actual, declared) = ((photo.width(), photo.height()), (native.width(), native.height()));
        if actual != declared {
            let declared_in = self.root.clone();
            return Err(SceneError::ImageSize { path: image.clone(), actual, declared_in, declared });
        }
        if let Some(distortion) = distortion {
            photo = undistort::undistort(&photo, native, distortion)?;
        }
        if (camera.width(), camera.height()) != actual {
            photo = photo.resized(camera.width(), camera.height())?;
        }
        Ok(photo)
    }
}
