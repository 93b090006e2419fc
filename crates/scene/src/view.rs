//! A posed photo, made from what a format declares: intrinsics scaled to the photo's size and to
//! `--width`, the depth range checked. Views are found by name.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use unicode_normalization::UnicodeNormalization;

use crate::photo_folder::ORIENTED;
use crate::photos::note_left_out;
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
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    pub(crate) distortion: Distortion,
    /// Near and far depth in scene units; an invalid range is ignored with a note.
    pub(crate) depth_range: Option<(f64, f64)>,
}

impl DeclaredView {
    /// Without distortion and depth range; intrinsics of a photo of that size, `cam_from_world`.
    pub(crate) fn new(
        photo: Photo,
        (intrinsics, size): (Intrinsics, Size),
        (rotation, translation): (DMat3, DVec3),
    ) -> Self {
        Self { photo, intrinsics, size, rotation, translation, distortion: Distortion::default(), depth_range: None }
    }
}

/// `cam_from_world` of a camera with these axes, in the columns OpenCV's, and this centre, in the world.
pub(crate) fn seen_from(axes: DMat3, centre: DVec3) -> (DMat3, DVec3) {
    (axes.transpose(), -(axes.transpose() * centre))
}

/// A rotation from its axis times its angle in radians.
pub(crate) fn rotation_about(angle_axis: DVec3) -> DMat3 {
    let angle = angle_axis.length();
    // The threshold of the code of the data set Spaces.
    if angle < 1e-7 { DMat3::IDENTITY } else { DMat3::from_axis_angle(angle_axis / angle, angle) }
}

/// The result of a format's reader.
#[derive(Default)]
pub(crate) struct DeclaredViews {
    /// The file that holds the cameras, for messages.
    pub(crate) cameras: PathBuf,
    pub(crate) views: Vec<DeclaredView>,
    pub(crate) notes: Vec<String>,
    /// Names of the photos that are targets only ([`View::held_out`]).
    pub(crate) held_out: Vec<String>,
    /// Median reprojection error of tracked points, pixels.
    pub(crate) reprojection_error: Option<f64>,
}

/// Photos of more pixels are reduced to as many by default, with which a picture takes some 2 GB of memory.
const MAX_PIXELS: f64 = 2.4e6;

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
    /// Whether it is a target only, and no picture may be rendered from it: a photo of Blender's
    /// `transforms_test.json`.
    pub held_out: bool,
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
    /// `FULL_OPENCV`, `OPENCV_FISHEYE` or `DIVISION`, with names and values of its coefficients, all 0
    /// for a pinhole camera.
    pub fn distortion(&self) -> (&'static str, [(&'static str, f64); 8]) {
        let model = match self.distortion {
            Distortion { division: true, .. } => "DIVISION",
            Distortion { fisheye: true, .. } => "OPENCV_FISHEYE",
            _ => "FULL_OPENCV",
        };
        (model, self.distortion.fields())
    }
}

/// Views by what was changed in them, so that each kind of change gets one note instead of one per
/// view.
#[derive(Default)]
struct Changes {
    rescaled: Vec<String>,
    undistorted: Vec<String>,
    shrunk: Vec<String>,
    bounded: Vec<String>,
    unscaled: Vec<String>,
    invalid_range: Vec<String>,
}

/// The views in order of their names, and the notes. Unless `all` are needed, the few that are not usable are left
/// out.
pub(crate) fn from_declared(
    found: DeclaredViews,
    options: &SceneOptions,
    all: bool,
) -> Result<(Vec<View>, Vec<String>), SceneError> {
    let DeclaredViews { cameras, views: mut declared, mut notes, held_out, .. } = found;
    if declared.is_empty() {
        return Err(SceneError::NoViews { path: cameras });
    }
    declared.sort_by(|a, b| a.photo.name.cmp(&b.photo.name));
    let mut twice = Vec::new();
    declared.dedup_by(|next, view| {
        let is_same = !all && view.photo.name == next.photo.name;
        let is_same = is_same && (view.rotation, view.translation) == (next.rotation, next.translation);
        twice.extend(is_same.then(|| next.photo.name.clone()));
        is_same
    });
    if let Some(pair) = declared.windows(2).find(|pair| pair[0].photo.name == pair[1].photo.name) {
        let what = format!("\"{}\" is listed twice", pair[0].photo.name);
        return Err(SceneError::malformed(cameras, what, "each photo once"));
    }
    if !twice.is_empty() {
        notes.push(format!("listed twice with the same pose, read once: {}", abbreviated(&twice)));
    }
    let prefix = shared_folder_len(&declared);
    let (mut changes, mut views, mut left_out) = (Changes::default(), Vec::new(), Vec::new());
    for declared in declared {
        let name = declared.photo.name.clone();
        match view(&cameras, declared, prefix, (options, !all), &mut changes) {
            Ok(view) => views.push(View { held_out: held_out.contains(&name), ..view }),
            Err(error) if all => return Err(error),
            Err(error) => left_out.push((name, error)),
        }
    }
    notes.extend(note_left_out(left_out, views.len())?);
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
    (options, may_scale): (&SceneOptions, bool),
    changes: &mut Changes,
) -> Result<View, SceneError> {
    let DeclaredView { photo, intrinsics, rotation, translation, distortion, depth_range, .. } = declared;
    let name: String = photo.name[prefix..].nfc().collect();
    let refused = |source: CameraError| SceneError::Camera { path: cameras.to_owned(), image: name.clone(), source };
    let (actual, declared) = (photo.size, declared.size);
    if declared != actual && !(may_scale && same_aspect(declared, actual)) {
        if photo.ignored.contains(&ORIENTED) && same_aspect(declared, Size::new(actual.height, actual.width)) {
            return Err(SceneError::Oriented { path: photo.path, actual, declared });
        }
        return Err(SceneError::ImageSize { path: photo.path, actual, declared_in: cameras.to_owned(), declared });
    }
    let posed = |rotation, translation| Camera::new(intrinsics, declared.width, declared.height, rotation, translation);
    // Some programs leave the scale of the scene in the axes.
    let scale = rotation.determinant().cbrt();
    let unscaled = |error| {
        if scale <= 0.0 {
            return Err(error);
        }
        let unscaled = posed(rotation * scale.recip(), translation / scale).map_err(|_| error);
        unscaled.inspect(|_| changes.unscaled.push(format!("{name} (by {scale:.4})")))
    };
    let mut native = posed(rotation, translation).or_else(unscaled).map_err(refused)?;
    if declared != actual {
        native = native.with_size_scaled(actual.width, actual.height).map_err(refused)?;
        changes.rescaled.push(format!("{name} {declared} → {actual}"));
    }
    distortion.check().map_err(refused)?;
    if distortion != Distortion::default() {
        changes.undistorted.push(name.clone());
    }
    let mut camera = native.clone();
    let excess = actual.pixels() as f64 / MAX_PIXELS;
    let most = if excess > 1.0 { (actual.width as f64 / excess.sqrt()) as usize } else { usize::MAX };
    let width = options.width.unwrap_or(most).max(1);
    if width < actual.width {
        let height = (actual.height as f64 * width as f64 / actual.width as f64).round().max(1.0) as usize;
        camera = native.with_size_scaled(width, height).map_err(refused)?;
        if options.width.is_some() {
            changes.shrunk.push(format!("{name} {actual} → {width}x{height}"));
        } else {
            let gigabytes = 2.0 * excess;
            changes.bounded.push(format!(
                "{name} {actual} → {width}x{height} (width {} would take some {gigabytes:.0} GB and {excess:.0} times as long)",
                actual.width
            ));
        }
    }
    let usable = |&(near, far): &(f64, f64)| far.is_finite() && uniform_disparities(near, far, 2).is_ok();
    let usable_range = depth_range.filter(usable);
    if let (Some((near, far)), None) = (depth_range, usable_range) {
        changes.invalid_range.push(format!("{name} ({near:?} to {far:?})"));
    }
    Ok(View { name, camera, depth_range: usable_range, held_out: false, photo, native, distortion })
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
            ("large photos scaled down, so that a picture takes some 2 GB of memory", &self.bounded),
            ("scaled axes of the pose normalised", &self.unscaled),
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

/// Index of the view with this name, this name without extension, file name, file name without extension, timestamp
/// (RealEstate10K's files may have `us` after it), or end of that name after a space or a sign.
pub(crate) fn index_of(views: &[View], name: &str) -> Result<usize, SceneError> {
    let name: &str = &name.strip_prefix("./").unwrap_or(name).nfc().collect::<String>();
    let stem = |view: &View| Path::new(&view.name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let ends =
        |stem: String| stem.strip_suffix(name).is_some_and(|rest| rest.ends_with(|c: char| !c.is_alphanumeric()));
    let is_named: [&dyn Fn(&View) -> bool; 6] = [
        &|view| view.name == name,
        &|view| Path::new(&view.name).with_extension("") == Path::new(name),
        &|view| Path::new(&view.name).file_name() == Some(name.as_ref()),
        &|view| stem(view).as_deref() == Some(name),
        &|view| stem(view).is_some_and(|stem| stem.strip_suffix("us") == Some(name)),
        &|view| !name.is_empty() && stem(view).is_some_and(ends),
    ];
    let unknown = |reason: &str, closest: Vec<&str>| {
        let (count, closest) = (views.len(), closest.join(", "));
        SceneError::UnknownView(format!("{reason} \"{name}\" among the {count} views; closest: {closest}"))
    };
    for is_named in is_named {
        let matches: Vec<usize> = (0..views.len()).filter(|&view| is_named(&views[view])).collect();
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
    closest.sort_by_key(|view| strsim::levenshtein(view, name));
    closest.truncate(LISTED_NAMES);
    Err(unknown("no view is named", closest))
}
