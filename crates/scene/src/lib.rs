//! Scenes: photos with known camera poses. The poses are read from a folder in one of nine file formats;
//! the photos come from the same folder or from any other [`PhotoSource`]. Or both are in memory
//! ([`Scene::in_memory`]).
//!
//! | format | recognised by | camera axes, pose | intrinsics |
//! |---|---|---|---|
//! | nerfstudio, instant-ngp, Blender | `transforms.json`, `transforms_train.json` | OpenGL, world from camera | pixels |
//! | COLMAP | `sparse/0`, `sparse` or the folder itself | OpenCV, camera from world | pixels |
//! | LLFF | `poses_bounds.npy` | [down, right, backwards], world from camera | pixels of the full-size photos |
//! | Spaces | `models.json` | OpenCV, angle-axis and centre | pixels of the declared size |
//! | RealEstate10K | `cameras.txt` and `frames/`, or both of one name | OpenCV, camera from world | fractions of width and height |
//! | Metashape | an `.xml` of exported cameras | OpenCV, world from camera | pixels, from the middle |
//! | RealityCapture | a `.csv` of internal and external parameters | OpenGL, angles and centre | 36ths of the larger side |
//! | OpenSfM, ODM | `reconstruction.json`, also in `opensfm` | OpenCV, angle-axis, camera from world | fractions of the larger side |
//! | 3D Gaussian Splatting | `cameras.json` | OpenCV, world from camera | pixels |
//!
//! Each is converted to a [`Camera`]: OpenCV axes, `cam_from_world`, K in
//! pixels with pixel centres at half-integers (as in all formats). If a folder holds several
//! formats, the first one in the table that can be read is. Files are not trusted: counts are checked
//! against the file's length, photos lie inside the folder or beside it, declared sizes must match the photos, and
//! [`liveview_files::bounded`] limits the size of a file.

pub mod cameras;
mod error;
mod formats;
mod photo_folder;
mod photos;
mod scene_file;
mod undistort;
mod unpack;
mod view;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use formats::{READERS, transforms};
use photo_folder::TRANSPARENT;
use photos::PhotoLookup;
use scene_file::{MASK_FOLDERS, mask_note};
use undistort::{Distortion, undistort};
use view::{DeclaredView, DeclaredViews};

pub use error::SceneError;
#[cfg(feature = "fuzzing")]
pub use formats::fuzz;
pub use photo_folder::PhotoFolder;
pub use photos::{Found, ListedPhoto, Photo, PhotoList, PhotoSource, load_photo, save_picture};
pub use scene_file::read_scene_json;
pub use undistort::undistorted;
pub use view::View;

use liveview::geometry::Camera;
use liveview::image::{ImageRgb, WHITE};
use liveview_files::has_extension;
use liveview_files::unfinished::Unfinished;

/// Options for opening a scene.
#[derive(Debug, Clone, Default)]
pub struct SceneOptions {
    /// Photos wider than this, in pixels, are scaled down to it on load, together with their
    /// intrinsics; by default those of more than 2.4 megapixels to that.
    pub width: Option<usize>,
    /// The format to read; by default the first in the table that the folder holds and that can be
    /// read.
    pub format: Option<Format>,
    /// The background of transparent pixels, RGB in [0, 1]; white by default.
    pub background: Option<[f32; 3]>,
    /// Whether photos are turned as their EXIF orientation says.
    pub exif_rotate: bool,
    /// The photo folder inside an LLFF, RealEstate10K or COLMAP scene, or that in place of `images`
    /// in a `transforms.json`; by default the first that holds any of the usual ones (`images`,
    /// `images_2`, …; in the folder of a `poses_bounds.npy` `images_8`, `images_4`, …).
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
    /// Metashape's exported cameras.
    Metashape,
    /// RealityCapture's table of internal and external parameters.
    RealityCapture,
    /// OpenSfM's and ODM's `reconstruction.json`.
    OpenSfm,
    /// 3D Gaussian Splatting's `cameras.json`.
    Gaussians,
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
            Self::RealityCapture => "angles and centre, OpenGL axes; K in 36ths of the photo's larger side",
            Self::OpenSfm => "camera from world, OpenCV axes, angle-axis; K as fractions of the photo's larger side",
            Self::Metashape | Self::Gaussians => {
                "world from camera, OpenCV axes (x right, y down, z forward); K in pixels"
            }
        }
    }
}

/// The name of [`Format`], as `--format` takes it: such as `transforms`, `colmap` or `llff`.
impl FromStr for Format {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let names = || READERS.map(|reader| format!("{:?}", reader.0).to_lowercase());
        let found = names().iter().position(|known| known == name);
        found.map(|at| READERS[at].0).ok_or_else(|| format!("expected one of {}", names().join(", ")))
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
            Self::Metashape => "Metashape's cameras",
            Self::RealityCapture => "RealityCapture's camera parameters",
            Self::OpenSfm => "reconstruction.json (OpenSfM)",
            Self::Gaussians => "cameras.json (3D Gaussian Splatting)",
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
    /// The median distance, in pixels, of tracked points from where the poses show them, where the
    /// format has such points.
    pub reprojection_error: Option<f64>,
    /// The background of transparent pixels, where photos have any.
    background: Option<[f32; 3]>,
    /// The folder that an archive was unpacked to, which is deleted with the scene.
    _unpacked: Option<Arc<Unfinished>>,
}

impl Scene {
    /// Opens a folder of poses and photos, such a folder in another or in a zip archive, or a
    /// `transforms.json`, whatever its name, with the photos in its folder. Reads only the headers of the photos, and checks that every camera is valid
    /// and every photo has the declared size.
    ///
    /// # Errors
    ///
    /// [`SceneError`], naming the file and the field.
    pub fn open(path: &Path, options: &SceneOptions) -> Result<Self, SceneError> {
        if has_extension(path, &["zip"]) && path.is_file() {
            let folder = unpack::unpack(path)?;
            let scene = Self::open(folder.path(), options)?;
            return Ok(Self { _unpacked: Some(Arc::new(folder)), ..scene });
        }
        let inner = formats::folder_within(path);
        let folder = inner.as_deref().unwrap_or(path);
        let photos = PhotoFolder::with_options(folder_of(folder), options);
        let mut scene = Self::open_with(folder, Arc::new(photos), options)?;
        scene.notes.extend(inner.map(|inner| format!("the scene is in the folder {}", inner.display())));
        Ok(scene)
    }

    /// The views that are targets only ([`View::held_out`]).
    pub fn held_out(&self) -> Vec<usize> {
        (0..self.views.len()).filter(|&view| self.views[view].held_out).collect()
    }

    /// These views, then those that are targets only.
    pub fn with_held_out(&self, mut views: Vec<usize>) -> Vec<usize> {
        let more: Vec<usize> = self.held_out().into_iter().filter(|view| !views.contains(view)).collect();
        views.extend(more);
        views
    }

    /// The background that transparent pixels of the photos are composited on; `None` if there are
    /// none.
    pub fn background(&self) -> Option<[f32; 3]> {
        self.background
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
        let mut notes = Vec::new();
        let of = |found: DeclaredViews| {
            let error = found.reprojection_error;
            Ok((view::from_declared(found, options, false)?, error))
        };
        let (format, ((views, of_views), reprojection_error)) = if path.is_file() {
            if !has_extension(path, &["json"]) {
                return Err(no_scene("is not a folder"));
            }
            (Format::Transforms, transforms::open(options, PhotoLookup::new(&*photos, path)).and_then(of)?)
        } else {
            let is_wanted =
                |format: Format| options.format.is_none_or(|wanted| wanted == format) && photos.supports(format);
            let readers = READERS.into_iter().filter(|reader| is_wanted(reader.0));
            let (mut read, mut failed) = (None, None);
            for (reader, file) in readers.filter_map(|reader| (reader.1)(root).map(|file| (reader, file))) {
                let format = reader.0;
                if let Some((first, _)) = read {
                    notes.push(format!(
                        "the folder also holds {format}: its poses are not read, {first} takes precedence"
                    ));
                    continue;
                }
                match reader.read(options, PhotoLookup::new(&*photos, &file)).and_then(of) {
                    Ok(views) => read = Some((format, views)),
                    Err(error) => {
                        notes.push(format!("{format} is not read: {error}"));
                        failed = failed.or(Some(error));
                    }
                }
            }
            let none = || match options.format {
                Some(format) => no_scene(&format!("holds no {format}")),
                None => formats::why_none_reads(root),
            };
            read.ok_or_else(|| failed.unwrap_or_else(none))?
        };
        notes.splice(0..0, of_views);
        notes.extend(MASK_FOLDERS.into_iter().filter(|folder| root.join(folder).is_dir()).map(mask_note));
        let is_transparent = views.iter().any(|view| view.photo.ignored.contains(&TRANSPARENT));
        let background = is_transparent.then(|| options.background.unwrap_or(WHITE));
        let pixels = Pixels::Source(photos);
        let root = root.to_owned();
        Ok(Self { root, format, views, notes, pixels, reprojection_error, background, _unpacked: None })
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
            let photo = Photo { name: name.clone(), path, size: picture.size(), ignored: Vec::new() };
            let pose = (camera.rotation(), camera.translation());
            declared.push(DeclaredView::new(photo, (camera.intrinsics(), camera.size()), pose));
            pictures.insert(name, picture);
        }
        let declared = DeclaredViews { cameras: root.clone(), views: declared, ..DeclaredViews::default() };
        let (views, notes) = view::from_declared(declared, options, true)?;
        let pixels = Pixels::Memory(Arc::new(pictures));
        let (format, reprojection_error) = (Format::Memory, None);
        Ok(Self { root, format, views, notes, pixels, reprojection_error, background: None, _unpacked: None })
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
            photo = undistort(&photo, native, distortion);
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
