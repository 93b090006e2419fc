//! Posed photos: the poses from a folder, in whichever of five formats it holds, the photos from the same folder or from any
//! other [`PhotoSource`].
//!
//! | format | recognised by | camera axes, pose | intrinsics |
//! |---|---|---|---|
//! | nerfstudio, instant-ngp | `transforms.json` | OpenGL, world from camera | pixels |
//! | LLFF | `poses_bounds.npy` | [down, right, backwards], world from camera | pixels of the full-size photos |
//! | Spaces | `models.json` | OpenCV, angle-axis and centre | pixels of the declared size |
//! | RealEstate10K | `cameras.txt` and `frames/` | OpenCV, camera from world | fractions of width and height |
//! | COLMAP | `sparse/0`, `sparse` or the folder itself | OpenCV, camera from world | pixels |
//!
//! All become [`Camera`](crate::geometry::Camera)s: OpenCV axes, `cam_from_world`, K in pixels with pixel centres at
//! half-integers, which all five formats share. Where several lie in one folder, the first of the table is read. Nothing in a
//! file is trusted: counts are checked against the file's length, paths must stay in the folder, sizes must be those of the
//! photos, and no file may be larger than [`crate::fs::bounded`] says.

mod declared;
mod error;
mod format;
mod formats;
#[cfg(fuzzing)]
pub mod fuzz;
mod options;
mod photo_folder;
mod photo_lookup;
mod photo_source;
mod pose_file;
mod undistort;
mod view;
mod view_names;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use error::SceneError;
pub use format::Format;
pub use options::SceneOptions;
pub use photo_folder::PhotoFolder;
pub use photo_source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
pub use view::View;

use crate::image::ImageRgb;

/// Posed photos.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The folder of the poses.
    pub root: PathBuf,
    /// What it was read as.
    pub format: Format,
    /// At least one, in byte order of their names.
    pub views: Vec<View>,
    /// Everything that was skipped or assumed, by name, for the user to read.
    pub notes: Vec<String>,
    photos: Arc<dyn PhotoSource>,
}

/// Folders of masks, as COLMAP, nerfstudio and gsplat have them.
const MASKS: [&str; 5] = ["masks", "masks_2", "masks_4", "masks_8", "mask"];

/// That masks which are named so are not read.
fn masks_note(name: &str) -> String {
    format!("{name}: not read, what a mask leaves out of a photo counts like the rest of it")
}

impl Scene {
    /// Opens a folder of poses and photos. Only the headers of the photos are read; every camera is valid and every photo has the
    /// right size.
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the file and the field.
    pub fn open(path: &Path, options: &SceneOptions) -> Result<Self, SceneError> {
        Self::open_with(path, Arc::new(PhotoFolder::new(path)), options)
    }

    /// Opens a folder of poses, whose photos come from elsewhere: for `photos` the folder need not hold any.
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the file and the field; what the source refuses.
    pub fn open_with(path: &Path, photos: Arc<dyn PhotoSource>, options: &SceneOptions) -> Result<Self, SceneError> {
        let no_scene = |reason: &str| SceneError::NoScene { path: path.to_owned(), reason: reason.to_owned() };
        if !path.exists() {
            return Err(no_scene("does not exist"));
        }
        if !path.is_dir() {
            return Err(no_scene("is not a folder"));
        }
        let mut found = formats::all_in(path).filter(|&format| photos.serves(format));
        let format = found.next().ok_or_else(|| no_scene("no scene found"))?;
        let (views, mut notes) = view::views(formats::read(format, path, &*photos, options)?, options)?;
        notes.extend(found.map(|other| format!("the folder also holds {other}: not read, {format} comes first")));
        notes.extend(MASKS.into_iter().filter(|folder| path.join(folder).is_dir()).map(masks_note));
        Ok(Self { root: path.to_owned(), format, views, notes, photos })
    }

    /// Index of the view with this name, file name, file name without extension, or name as its source has it (`images/1.png`).
    ///
    /// # Errors
    ///
    /// [`SceneError::UnknownView`] if none or several match, listing the closest names.
    pub fn view_index(&self, name: &str) -> Result<usize, SceneError> {
        let names: Vec<&str> = self.views.iter().map(|view| view.name.as_str()).collect();
        let listed = || self.views.iter().position(|view| view.photo() == name.strip_prefix("./").unwrap_or(name));
        view_names::index_of(&names, name).or_else(|unknown| listed().ok_or(unknown))
    }

    /// Decodes the photo of a view: distortion undone, then scaled down to the size of its camera.
    ///
    /// # Errors
    ///
    /// [`SceneError::Image`] if the file is damaged or cut short; [`SceneError::ImageSize`] if it changed since `open`; what
    /// else the source refuses.
    ///
    /// # Panics
    ///
    /// If there is no view `index`.
    pub fn load_image(&self, index: usize) -> Result<ImageRgb, SceneError> {
        self.fit(index, self.photos.load(self.views[index].photo())?)
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
    pub fn fit(&self, index: usize, photo: ImageRgb) -> Result<ImageRgb, SceneError> {
        self.views[index].fit(&self.root, photo)
    }
}
