//! A posed photo, made from what a format declares: intrinsics scaled to the photo's size and to
//! `--width`, the depth range checked. Views are found by name.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use crate::scene_file::abbreviated;
use crate::{Distortion, Photo, SceneError, SceneOptions};
use liveview::geometry::{Camera, CameraError, Intrinsics, Size};
use liveview::layers::uniform_disparities;

/// One view as its format declares it. The pose is `cam_from_world`, OpenCV axes; intrinsics are in
/// pixels of `size`.
pub(crate) struct DeclaredView {
    pub(crate) photo: Photo,
    pub(crate) intrinsics: Intrinsics,
    pub(crate) size: Size,
    /// Whether the photo may be of another size, resampled; K is then scaled accordingly.
    pub(crate) may_be_resampled: bool,
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    pub(crate) distortion: Distortion,
    /// Near and far depth in scene units; an invalid range is ignored with a note.
    pub(crate) depth_range: Option<(f64, f64)>,
}

/// The result of a format's reader.
pub(crate) struct DeclaredViews {
    /// The file that holds the cameras, for messages.
    pub(crate) cameras: PathBuf,
    pub(crate) views: Vec<DeclaredView>,
    pub(crate) notes: Vec<String>,
}

/// Largest relative difference of declared and actual aspect ratio at which intrinsics are
/// rescaled.
const ASPECT_TOLERANCE: f64 = 0.01;

/// One posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// The photo's path relative to the folder that all photos share: usually its file name.
    pub name: String,
    /// The camera, at the size of the image that [`Scene::load_image`](crate::Scene::load_image)
    /// returns.
    pub camera: Camera,
    /// Near and far depth in scene units, if the format has them; 0 < near < far.
    pub depth_range: Option<(f64, f64)>,
    /// The photo in its source.
    pub(crate) photo: Photo,
    /// At the photo's own size.
    pub(crate) native: Camera,
    pub(crate) distortion: Distortion,
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

    /// The model of the lens distortion that [`Scene::load_image`](crate::Scene::load_image) removes,
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
pub(crate) fn from_declared(
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

/// Number of similar names that an error lists.
const LISTED_NAMES: usize = 3;

/// Index of the view with this name, file name, or file name without extension.
pub(crate) fn index_of(views: &[View], name: &str) -> Result<usize, SceneError> {
    let names: [fn(&Path) -> Option<&OsStr>; 3] = [|path| Some(path.as_os_str()), Path::file_name, Path::file_stem];
    let unknown = |reason: &str, closest: Vec<&str>| {
        let (count, closest) = (views.len(), closest.join(", "));
        SceneError::UnknownView(format!("{reason} \"{name}\" among the {count} views; closest: {closest}"))
    };
    for name_of in names {
        let is_named = |&view: &usize| name_of(views[view].name.as_ref()) == Some(name.as_ref());
        let matches: Vec<usize> = (0..views.len()).filter(is_named).collect();
        match matches.as_slice() {
            [] => {}
            [index] => return Ok(*index),
            several => {
                let closest = several.iter().take(LISTED_NAMES).map(|&view| views[view].name.as_str()).collect();
                return Err(unknown("several views are named", closest));
            }
        }
    }
    let mut closest: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    closest.sort_by_key(|view| edit_distance(view, name));
    closest.truncate(LISTED_NAMES);
    Err(unknown("no view is named", closest))
}

/// Levenshtein distance, to suggest names similar to a misspelt one.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.bytes().enumerate() {
            let above = row[j + 1];
            row[j + 1] = (diagonal + usize::from(x != y)).min(above + 1).min(row[j] + 1);
            diagonal = above;
        }
    }
    row[b.len()]
}
