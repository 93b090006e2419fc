//! A posed photo, and how it comes from what a format declares: the size its intrinsics are for, `--width`, the depth range.

use std::path::{Path, PathBuf};

use super::declared::{DeclaredSize, DeclaredView, DeclaredViews};
use super::error::SceneError;
use super::options::SceneOptions;
use super::pose_file::some_of;
use super::undistort::{Distortion, undistort};
use crate::geometry::{Camera, CameraError, Size};
use crate::image::ImageRgb;
use crate::layers::uniform_disparities;

/// How far declared and actual aspect ratios may part when intrinsics are rescaled.
const ASPECT_TOLERANCE: f64 = 0.01;

/// One posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// The photo's path below the folder that all photos share: usually its file name.
    pub name: String,
    /// The camera, at the size [`Scene::load_image`](super::Scene::load_image) returns.
    pub camera: Camera,
    /// Near and far depth, in scene units, where the format tells them; 0 < near < far.
    pub depth_range: Option<(f64, f64)>,
    /// What the source calls the photo.
    photo: String,
    image: PathBuf,
    native: Camera,
    distortion: Option<Distortion>,
}

impl View {
    /// The file that the photo comes from.
    pub fn image_path(&self) -> &Path {
        &self.image
    }

    /// The camera at the photo's own size.
    pub fn native_camera(&self) -> &Camera {
        &self.native
    }

    /// Name and value of the coefficients of OpenCV's lens distortion, which [`Scene::load_image`](super::Scene::load_image)
    /// undoes; all 0 for none.
    pub fn distortion(&self) -> [(&'static str, f64); 5] {
        self.distortion.unwrap_or_default().fields()
    }

    /// What the source calls the photo.
    pub(super) fn photo(&self) -> &str {
        &self.photo
    }

    /// See [`Scene::fit`](super::Scene::fit); `root` is the scene's, for messages.
    pub(super) fn fit(&self, root: &Path, mut photo: ImageRgb) -> Result<ImageRgb, SceneError> {
        let Self { camera, native, image, distortion, .. } = self;
        let (actual, declared) = (photo.size(), native.size());
        if actual != declared {
            let declared_in = root.to_owned();
            return Err(SceneError::ImageSize { path: image.clone(), actual, declared_in, declared });
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

/// What happened to the views of a scene, told once and not per view.
#[derive(Default)]
struct Changes {
    rescaled: Vec<String>,
    undistorted: Vec<String>,
    shrunk: Vec<String>,
    no_range: Vec<String>,
}

/// Views in name order, and the notes.
pub(super) fn views(found: DeclaredViews, options: &SceneOptions) -> Result<(Vec<View>, Vec<String>), SceneError> {
    let DeclaredViews { cameras, views: mut declared, mut notes } = found;
    if declared.is_empty() {
        return Err(SceneError::malformed(cameras, "no views", "at least one"));
    }
    declared.sort_by(|a, b| a.photo.name.cmp(&b.photo.name));
    if let Some(pair) = declared.windows(2).find(|pair| pair[0].photo.name == pair[1].photo.name) {
        let what = format!("\"{}\" is listed twice", pair[0].photo.name);
        return Err(SceneError::malformed(cameras, what, "each photo once"));
    }
    let shared = shared_folder(&declared);
    let mut changes = Changes::default();
    let views = declared
        .into_iter()
        .map(|declared| view(&cameras, declared, shared, options, &mut changes))
        .collect::<Result<Vec<_>, _>>()?;
    changes.tell(&mut notes);
    Ok((views, notes))
}

/// Length of the folder part (with its slash) that all photos share.
fn shared_folder(declared: &[DeclaredView]) -> usize {
    let (Some(first), Some(last)) = (declared.first(), declared.last()) else { return 0 };
    // Sorted, so what the first and the last share, all share.
    let same = first.photo.name.bytes().zip(last.photo.name.bytes()).take_while(|(a, b)| a == b).count();
    first.photo.name.as_bytes()[..same].iter().rposition(|&byte| byte == b'/').map_or(0, |slash| slash + 1)
}

fn view(
    cameras: &Path,
    declared: DeclaredView,
    shared: usize,
    options: &SceneOptions,
    changes: &mut Changes,
) -> Result<View, SceneError> {
    let DeclaredView { photo, intrinsics, size, rotation, translation, distortion, depth_range } = declared;
    let name = photo.name[shared..].to_owned();
    let refused = |source: CameraError| SceneError::Camera { path: cameras.to_owned(), image: name.clone(), source };
    let actual = photo.size;
    let declared = match size {
        DeclaredSize::Actual => actual,
        DeclaredSize::Exactly(declared) | DeclaredSize::Scaled(declared) => declared,
    };
    let may_scale = matches!(size, DeclaredSize::Scaled(..));
    if declared != actual && !(may_scale && same_shape(declared, actual)) {
        return Err(SceneError::ImageSize { path: photo.path, actual, declared_in: cameras.to_owned(), declared });
    }
    let mut native =
        Camera::new(intrinsics, declared.width, declared.height, rotation, translation).map_err(refused)?;
    if declared != actual {
        native = native.with_size_scaled(actual.width, actual.height).map_err(refused)?;
        changes.rescaled.push(format!("{name} {declared} → {actual}"));
    }
    distortion.check().map_err(refused)?;
    let distortion = Some(distortion).filter(|d| !d.is_none());
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
        changes.no_range.push(format!("{name} ({near:?} to {far:?})"));
    }
    let (photo, image) = (photo.name, photo.path);
    Ok(View { name, camera, depth_range: usable_range, photo, image, native, distortion })
}

/// Whether one size is the other resampled: equal aspect within 1 %, or within the rounding of one pixel.
fn same_shape(declared: Size, actual: Size) -> bool {
    let [w, h, width, height] = [declared.width, declared.height, actual.width, actual.height].map(|side| side as f64);
    let expected = h * width / w;
    (height / expected - 1.0).abs() <= ASPECT_TOLERANCE || (height - expected).abs() <= 1.0
}

impl Changes {
    fn tell(&self, notes: &mut Vec<String>) {
        let told = [
            ("intrinsics scaled with the image, from the declared to the actual size", &self.rescaled),
            ("lens distortion undone on load (edges held)", &self.undistorted),
            ("images scaled down on load, intrinsics with them", &self.shrunk),
        ];
        for (what, names) in told {
            match names.as_slice() {
                [] => {}
                [name] => notes.push(format!("{what}: {name}")),
                [name, ..] => notes.push(format!("{what}: {} views, such as {name}", names.len())),
            }
        }
        if !self.no_range.is_empty() {
            let names = some_of(&self.no_range);
            notes.push(format!("depth range left out, not 0 < near < far of ordinary size: {names}"));
        }
    }
}
