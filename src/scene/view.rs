//! A posed photo, made from what a format declares: intrinsics scaled to the photo's size and to
//! `--width`, the depth range checked.

use std::path::{Path, PathBuf};

use super::declared::{DeclaredSize, DeclaredView, DeclaredViews};
use super::error::SceneError;
use super::options::SceneOptions;
use super::pose_file::abbreviated;
use super::undistort::{Distortion, undistort};
use crate::geometry::{Camera, CameraError, Size};
use crate::image::ImageRgb;
use crate::layers::uniform_disparities;

/// Largest relative difference of declared and actual aspect ratio at which intrinsics are
/// rescaled.
const ASPECT_TOLERANCE: f64 = 0.01;

/// One posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// The photo's path relative to the folder that all photos share: usually its file name.
    pub name: String,
    /// The camera, at the size of the image that [`Scene::load_image`](super::Scene::load_image)
    /// returns.
    pub camera: Camera,
    /// Near and far depth in scene units, if the format has them; 0 < near < far.
    pub depth_range: Option<(f64, f64)>,
    source_name: String,
    path: PathBuf,
    native: Camera,
    distortion: Option<Distortion>,
}

impl View {
    /// The photo's file.
    pub fn image_path(&self) -> &Path {
        &self.path
    }

    /// The camera at the photo's own size.
    pub fn native_camera(&self) -> &Camera {
        &self.native
    }

    /// The model of the lens distortion that [`Scene::load_image`](super::Scene::load_image) removes,
    /// `FULL_OPENCV` or `OPENCV_FISHEYE`, with names and values of its coefficients, all 0 for a
    /// pinhole camera.
    pub fn distortion(&self) -> (&'static str, [(&'static str, f64); 8]) {
        let distortion = self.distortion.unwrap_or_default();
        (if distortion.fisheye { "OPENCV_FISHEYE" } else { "FULL_OPENCV" }, distortion.fields())
    }

    /// The photo's name in its source.
    pub(super) fn source_name(&self) -> &str {
        &self.source_name
    }

    /// See [`Scene::fit`](super::Scene::fit); `root` is the scene folder, for messages.
    pub(super) fn fit(&self, root: &Path, mut photo: ImageRgb) -> Result<ImageRgb, SceneError> {
        let Self { camera, native, path, distortion, .. } = self;
        let (actual, declared) = (photo.size(), native.size());
        if actual != declared {
            let declared_in = root.to_owned();
            return Err(SceneError::ImageSize { path: path.clone(), actual, declared_in, declared });
        }
        if let Some(distortion) = distortion {
            photo = undistort(&photo, native, distortion)?;
        }
        if camera.size() != actual {
            photo = photo.resized(camera.width(), camera.height())?;
        }
        Ok(photo)
    }
}

/// Views by what was changed in them, so that each kind of change gets one note instead of one per
/// view.
#[derive(Default)]
struct Changes {
    rescaled: Vec<String>,
    undistorted: Vec<String>,
    shrunk: Vec<String>,
    invalid_range: Vec<String>,
}

/// The views in order of their names, and the notes.
pub(super) fn from_declared(
    found: DeclaredViews,
    options: &SceneOptions,
) -> Result<(Vec<View>, Vec<String>), SceneError> {
    let DeclaredViews { cameras, views: mut declared, mut notes } = found;
    if declared.is_empty() {
        return Err(SceneError::malformed(cameras, "no views", "at least one"));
    }
    declared.sort_by(|a, b| a.photo.name.cmp(&b.photo.name));
    if let Some(pair) = declared.windows(2).find(|pair| pair[0].photo.name == pair[1].photo.name) {
        let what = format!("\"{}\" is listed twice", pair[0].photo.name);
        return Err(SceneError::malformed(cameras, what, "each photo once"));
    }
    let prefix = shared_folder_len(&declared);
    let mut changes = Changes::default();
    let views = declared
        .into_iter()
        .map(|declared| view(&cameras, declared, prefix, options, &mut changes))
        .collect::<Result<Vec<_>, _>>()?;
    changes.add_notes(&mut notes);
    Ok((views, notes))
}

/// Length in bytes of the folder prefix (with its slash) that all photos share; `declared` is
/// sorted by name.
fn shared_folder_len(declared: &[DeclaredView]) -> usize {
    let (Some(first), Some(last)) = (declared.first(), declared.last()) else { return 0 };
    let same = first.photo.name.bytes().zip(last.photo.name.bytes()).take_while(|(a, b)| a == b).count();
    first.photo.name.as_bytes()[..same].iter().rposition(|&byte| byte == b'/').map_or(0, |slash| slash + 1)
}

fn view(
    cameras: &Path,
    declared: DeclaredView,
    prefix: usize,
    options: &SceneOptions,
    changes: &mut Changes,
) -> Result<View, SceneError> {
    let DeclaredView { photo, intrinsics, size, rotation, translation, distortion, depth_range } = declared;
    let name = photo.name[prefix..].to_owned();
    let refused = |source: CameraError| SceneError::Camera { path: cameras.to_owned(), image: name.clone(), source };
    let actual = photo.size;
    let declared = match size {
        DeclaredSize::Actual => actual,
        DeclaredSize::Exactly(declared) | DeclaredSize::Scaled(declared) => declared,
    };
    let may_scale = matches!(size, DeclaredSize::Scaled(..));
    if declared != actual && !(may_scale && same_aspect(declared, actual)) {
        return Err(SceneError::ImageSize { path: photo.path, actual, declared_in: cameras.to_owned(), declared });
    }
    let mut native =
        Camera::new(intrinsics, declared.width, declared.height, rotation, translation).map_err(refused)?;
    if declared != actual {
        native = native.with_size_scaled(actual.width, actual.height).map_err(refused)?;
        changes.rescaled.push(format!("{name} {declared} → {actual}"));
    }
    distortion.check().map_err(refused)?;
    let distortion = Some(distortion).filter(|d| !d.is_zero());
    if distortion.is_some() {
        changes.undistorted.push(name.clone());
    }
    let mut camera = native.clone();
    if let Some(width) = options.width.filter(|&width| width < actual.width) {
        let height = (actual.height as f64 * width as f64 / actual.width as f64).round().max(1.0) as usize;
        camera = native.with_size_scaled(width, height).map_err(refused)?;
        changes.shrunk.push(format!("{name} {actual} → {width}x{height}"));
    }
    let usable = |&(near, far): &(f64, f64)| far.is_finite() && uniform_disparities(near, far, 2).is_ok();
    let usable_range = depth_range.filter(usable);
    if let (Some((near, far)), None) = (depth_range, usable_range) {
        changes.invalid_range.push(format!("{name} ({near:?} to {far:?})"));
    }
    let (source_name, path) = (photo.name, photo.path);
    Ok(View { name, camera, depth_range: usable_range, source_name, path, native, distortion })
}

/// Whether one size can be the other resampled: aspect ratios equal within 1 %, or heights within
/// one pixel.
fn same_aspect(declared: Size, actual: Size) -> bool {
    let [w, h, width, height] = [declared.width, declared.height, actual.width, actual.height].map(|side| side as f64);
    let expected = h * width / w;
    (height / expected - 1.0).abs() <= ASPECT_TOLERANCE || (height - expected).abs() <= 1.0
}

impl Changes {
    fn add_notes(&self, notes: &mut Vec<String>) {
        let changes = [
            ("intrinsics scaled from the declared to the actual image size", &self.rescaled),
            ("photos undistorted on load (edge pixels repeated)", &self.undistorted),
            ("photos and intrinsics scaled down on load", &self.shrunk),
        ];
        for (change, names) in changes {
            match names.as_slice() {
                [] => {}
                [name] => notes.push(format!("{change}: {name}")),
                [name, ..] => notes.push(format!("{change}: {} views, such as {name}", names.len())),
            }
        }
        if !self.invalid_range.is_empty() {
            let names = abbreviated(&self.invalid_range);
            notes.push(format!("depth range ignored, expected 0 < near < far within float32's range: {names}"));
        }
    }
}
