//! A posed photo, made from what a format declares: intrinsics scaled to the photo's size and to
//! `--width`, the depth range checked.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::pose_file::abbreviated;
use super::{Distortion, Photo, SceneError, SceneOptions};
use liveview::geometry::{Camera, CameraError, Intrinsics, Size};
use liveview::layers::uniform_disparities;

/// One view as its format declares it. The pose is `cam_from_world`, OpenCV axes; intrinsics are in
/// pixels of `size`.
pub(super) struct DeclaredView {
    pub(super) photo: Photo,
    pub(super) intrinsics: Intrinsics,
    pub(super) size: Size,
    /// Whether the photo may be of another size, resampled; K is then scaled accordingly.
    pub(super) may_be_resampled: bool,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) distortion: Distortion,
    /// Near and far depth in scene units; an invalid range is ignored with a note.
    pub(super) depth_range: Option<(f64, f64)>,
}

/// The result of a format's reader.
pub(super) struct DeclaredViews {
    /// The file that holds the cameras, for messages.
    pub(super) cameras: PathBuf,
    pub(super) views: Vec<DeclaredView>,
    pub(super) notes: Vec<String>,
}

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
    /// The photo in its source.
    pub(super) photo: Photo,
    /// At the photo's own size.
    pub(super) native: Camera,
    pub(super) distortion: Distortion,
}

impl View {
    /// The photo's file.
    pub fn image_path(&self) -> &Path {
        &self.photo.path
    }

    /// The camera at the photo's own size.
    pub fn native_camera(&self) -> &Camera {
        &self.native
    }

    /// The model of the lens distortion that [`Scene::load_image`](super::Scene::load_image) removes,
    /// `FULL_OPENCV` or `OPENCV_FISHEYE`, with names and values of its coefficients, all 0 for a
    /// pinhole camera.
    pub fn distortion(&self) -> (&'static str, [(&'static str, f64); 8]) {
        (if self.distortion.fisheye { "OPENCV_FISHEYE" } else { "FULL_OPENCV" }, self.distortion.fields())
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
        return Err(SceneError::NoViews { path: cameras });
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
    let DeclaredView { photo, intrinsics, rotation, translation, distortion, depth_range, .. } = declared;
    let name = photo.name[prefix..].to_owned();
    let refused = |source: CameraError| SceneError::Camera { path: cameras.to_owned(), image: name.clone(), source };
    let (actual, may_scale, declared) = (photo.size, declared.may_be_resampled, declared.size);
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
    if distortion != Distortion::default() {
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
    Ok(View { name, camera, depth_range: usable_range, photo, native, distortion })
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
