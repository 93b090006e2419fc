//! Scenes: photos with known camera poses. The poses are read from a folder in one of five file formats;
//! the photos come from the same folder or from any other [`PhotoSource`]. Or both are in memory
//! ([`Scene::in_memory`]).
//!
//! | format | recognised by | camera axes, pose | intrinsics |
//! |---|---|---|---|
//! | nerfstudio, instant-ngp, Blender | `transforms.json`, `transforms_train.json` | OpenGL, world from camera | pixels |
//! | LLFF | `poses_bounds.npy` | [down, right, backwards], world from camera | pixels of the full-size photos |
//! | Spaces | `models.json` | OpenCV, angle-axis and centre | pixels of the declared size |
//! | RealEstate10K | `cameras.txt` and `frames/` | OpenCV, camera from world | fractions of width and height |
//! | COLMAP | `sparse/0`, `sparse` or the folder itself | OpenCV, camera from world | pixels |
//!
//! Each is converted to a [`Camera`]: OpenCV axes, `cam_from_world`, K in
//! pixels with pixel centres at half-integers (as in all five formats). If a folder holds several
//! formats, the first one in the table is read. Files are not trusted: counts are checked against
//! the file's length, paths must stay inside the folder, declared sizes must match the photos, and
//! [`liveview_files::bounded`] limits the size of a file.

pub mod cameras;
mod error;
mod formats;
mod photos;
mod scene_file;
mod undistort;
mod view;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use formats::{READERS, transforms};
use scene_file::{MASK_FOLDERS, mask_note};
use undistort::{Distortion, undistort};
use view::{DeclaredView, DeclaredViews};

pub use error::SceneError;
#[cfg(fuzzing)]
pub use formats::fuzz;
pub use photos::{Found, ListedPhoto, Photo, PhotoFolder, PhotoList, PhotoSource, load_photo, save_picture};
pub use view::View;

use liveview::geometry::Camera;
use liveview::image::ImageRgb;
use liveview_files::has_extension;

/// Options for opening a scene.
#[derive(Debug, Clone, Default)]
pub struct SceneOptions {
    /// Photos wider than this, in pixels, are scaled down to it on load, together with their
    /// intrinsics.
    pub width: Option<usize>,
    /// The photo folder inside an LLFF, RealEstate10K or COLMAP scene, or that in place of `images`
    /// in a `transforms.json`; by default the first that exists of the format's usual ones
    /// (`images_8`, `images_4`, …).
    pub images: Option<String>,
    /// The rig position to read from a Spaces scene, counted from 0.
    pub rig_position: usize,
}

/// The format a scene was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
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
    /// No files: photos and cameras in memory.
    Memory,
}

impl Format {
    /// Its conventions for poses and intrinsics, as text for the user.
    pub fn conventions(self) -> &'static str {
        match self {
            Self::Transforms => "world from camera with OpenGL axes (x right, y up, z backwards); K in pixels of w x h",
            Self::Llff => "world from camera with columns [down, right, backwards]; K in pixels of the declared size",
            Self::Spaces => "axis-angle rotation and camera centre, OpenCV axes; K in pixels of the declared size",
            Self::RealEstate10k => "camera from world, OpenCV axes; K as fractions of width and height",
            Self::Colmap | Self::Memory => "camera from world, OpenCV axes (x right, y down, z forward); K in pixels",
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
            Self::Memory => "photos in memory",
        })
    }
}

/// The pixels of a scene's photos.
#[derive(Debug, Clone)]
enum Pixels {
    Source(Arc<dyn PhotoSource>),
    /// By the photos' names.
    Memory(Arc<BTreeMap<String, ImageRgb>>),
}

/// Photos with known camera poses.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The folder that holds the poses; `memory` if they are in memory.
    pub root: PathBuf,
    /// The format the poses were read from.
    pub format: Format,
    /// At least one view, in byte order of the names.
    pub views: Vec<View>,
    /// Messages for the user: every file or entry that was skipped, every assumption that was made.
    pub notes: Vec<String>,
    pixels: Pixels,
}

impl Scene {
    /// Opens a folder of poses and photos, or a `transforms.json`, whatever its name, with the photos
    /// in its folder. Reads only the headers of the photos, and checks that every camera is valid
    /// and every photo has the declared size.
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the file and the field.
    pub fn open(path: &Path, options: &SceneOptions) -> Result<Self, SceneError> {
        Self::open_with(path, Arc::new(PhotoFolder::new(folder_of(path))), options)
    }

    /// Opens a folder of poses, or a `transforms.json`, and takes the photos from `photos`; the
    /// folder need not hold any photo.
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the file and the field; any error of the photo source.
    pub fn open_with(path: &Path, photos: Arc<dyn PhotoSource>, options: &SceneOptions) -> Result<Self, SceneError> {
        let no_scene = |reason: &str| SceneError::NoScene { path: path.to_owned(), reason: reason.to_owned() };
        if !path.exists() {
            return Err(no_scene("does not exist"));
        }
        let root = folder_of(path);
        let (format, declared, others) = if path.is_file() {
            if !has_extension(path, &["json"]) {
                return Err(no_scene("is not a folder"));
            }
            (Format::Transforms, transforms::open_file(root, path, &*photos, options)?, Vec::new())
        } else {
            let readers = READERS.into_iter().filter(|reader| (reader.is_in)(root));
            let mut readers = readers.filter(|reader| photos.supports(reader.format));
            let reader = readers.next().ok_or_else(|| no_scene(&formats::why_none_reads(root)))?;
            (reader.format, (reader.open)(root, &*photos, options)?, readers.map(|other| other.format).collect())
        };
        let (views, mut notes) = view::from_declared(declared, options)?;
        for other in others {
            notes.push(format!("the folder also holds {other}: its poses are not read, {format} takes precedence"));
        }
        notes.extend(MASK_FOLDERS.into_iter().filter(|folder| root.join(folder).is_dir()).map(mask_note));
        Ok(Self { root: root.to_owned(), format, views, notes, pixels: Pixels::Source(photos) })
    }

    /// A scene of photos in memory: name, photo and camera of each. Names are unique; `/` in them
    /// divides folders, as in paths. The depth range is found from the photos, or given with the
    /// scene ([`View::depth_range`]).
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the photo: no photo, a name twice, another size than the camera's,
    /// values outside [0, 1].
    pub fn in_memory(
        photos: impl IntoIterator<Item = (String, ImageRgb, Camera)>,
        options: &SceneOptions,
    ) -> Result<Self, SceneError> {
        let root = PathBuf::from("memory");
        let (mut pictures, mut declared) = (BTreeMap::new(), Vec::new());
        for (name, picture, camera) in photos {
            if let Some(value) = picture.data().iter().find(|value| !(0.0..=1.0).contains(*value)) {
                let what = format!("a value of the photo is {value}");
                return Err(SceneError::malformed(name, what, "values in [0, 1]"));
            }
            let path = PathBuf::from(&name);
            declared.push(DeclaredView {
                photo: Photo { name: name.clone(), path, size: picture.size(), ignored: Vec::new() },
                intrinsics: camera.intrinsics(),
                size: camera.size(),
                may_be_resampled: false,
                rotation: camera.rotation(),
                translation: camera.translation(),
                distortion: Distortion::default(),
                depth_range: None,
            });
            pictures.insert(name, picture);
        }
        let declared = DeclaredViews { cameras: root.clone(), views: declared, notes: Vec::new() };
        let (views, notes) = view::from_declared(declared, options)?;
        Ok(Self { root, format: Format::Memory, views, notes, pixels: Pixels::Memory(Arc::new(pictures)) })
    }

    /// Index of the view with this name, file name, file name without extension, or name in the
    /// photo source (`images/1.png`).
    ///
    /// # Errors
    ///
    /// [`SceneError::UnknownView`] if no view or several views match; it lists the closest names.
    pub fn view_index(&self, name: &str) -> Result<usize, SceneError> {
        let by_source_name =
            || self.views.iter().position(|view| view.photo.name == name.strip_prefix("./").unwrap_or(name));
        view::index_of(&self.views, name).or_else(|unknown| by_source_name().ok_or(unknown))
    }

    /// Decodes the photo of a view, undistorts it and scales it down to the size of the view's
    /// camera.
    ///
    /// # Errors
    ///
    /// [`SceneError::Image`] if the file is damaged or truncated; [`SceneError::ImageSize`] if its
    /// size changed since `open`; any other error of the photo source.
    ///
    /// # Panics
    ///
    /// If there is no view `index`.
    pub fn load_image(&self, index: usize) -> Result<ImageRgb, SceneError> {
        let name = &self.views[index].photo.name;
        let missing = || SceneError::MissingImage { path: name.into(), listed_in: "memory".into() };
        let photo = match &self.pixels {
            Pixels::Source(photos) => photos.load(name)?,
            Pixels::Memory(photos) => photos.get(name).cloned().ok_or_else(missing)?,
        };
        self.fit(index, photo)
    }

    /// Undistorts a photo taken by the view's camera and scales it down to the size of
    /// [`View::camera`].
    ///
    /// # Errors
    ///
    /// [`SceneError::ImageSize`] if its size differs from that of the view's own photo.
    ///
    /// # Panics
    ///
    /// If there is no view `index`.
    pub fn fit(&self, index: usize, mut photo: ImageRgb) -> Result<ImageRgb, SceneError> {
        let View { camera, native, distortion, photo: Photo { path, .. }, .. } = &self.views[index];
        let (actual, declared) = (photo.size(), native.size());
        if actual != declared {
            let (path, declared_in) = (path.clone(), self.root.clone());
            return Err(SceneError::ImageSize { path, actual, declared_in, declared });
        }
        if *distortion != Distortion::default() {
            photo = undistort(&photo, native, distortion)?;
        }
        if camera.size() != actual {
            photo = photo.resized(camera.width(), camera.height())?;
        }
        Ok(photo)
    }
}

/// The folder of a scene: that of the file, if it is given by one.
fn folder_of(path: &Path) -> &Path {
    if !path.is_file() {
        return path;
    }
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
