//! From what a format declares to a view: the size its intrinsics are for, `--width`, and the depth range.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::files::{Photo, some_of};
use super::undistort::Distortion;
use super::{SceneError, SceneOptions, View};
use crate::geometry::{Camera, CameraError, Intrinsics};
use crate::layers::uniform_disparities;

/// How far declared and actual aspect ratios may part when intrinsics are rescaled.
const ASPECT_TOLERANCE: f64 = 0.01;

/// The size a format's intrinsics are for.
#[derive(Clone, Copy)]
pub(super) enum Size {
    /// The photo's own.
    Actual,
    /// Declared; the photo must have it.
    Exactly(usize, usize),
    /// Declared; a photo resampled to another size is fine, K follows it.
    Scaled(usize, usize),
}

/// One view as its format declares it. The pose is `cam_from_world`, OpenCV axes; intrinsics in pixels of `size`.
pub(super) struct Draft {
    pub(super) photo: Photo,
    pub(super) intrinsics: Intrinsics,
    pub(super) size: Size,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) distortion: Distortion,
    /// Near and far, in scene units; an unusable range becomes a note.
    pub(super) depth_range: Option<(f64, f64)>,
}

/// What a format's reader hands back.
pub(super) struct Drafts {
    /// The file the cameras stand in, for messages.
    pub(super) cameras: PathBuf,
    pub(super) drafts: Vec<Draft>,
    pub(super) notes: Vec<String>,
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
pub(super) fn finish(
    root: &Path,
    found: Drafts,
    options: &SceneOptions,
) -> Result<(Vec<View>, Vec<String>), SceneError> {
    let Drafts { cameras, mut drafts, mut notes } = found;
    if drafts.is_empty() {
        return Err(SceneError::malformed(cameras, "no views", "at least one"));
    }
    drafts.sort_by(|a, b| a.photo.name.cmp(&b.photo.name));
    if let Some(pair) = drafts.windows(2).find(|pair| pair[0].photo.name == pair[1].photo.name) {
        let what = format!("\"{}\" is listed twice", pair[0].photo.name);
        return Err(SceneError::malformed(cameras, what, "each photo once"));
    }
    let shared = shared_folder(&drafts);
    let mut changes = Changes::default();
    let views = drafts
        .into_iter()
        .map(|draft| view(root, &cameras, draft, shared, options, &mut changes))
        .collect::<Result<Vec<_>, _>>()?;
    changes.tell(&mut notes);
    Ok((views, notes))
}

/// Length of the folder part (with its slash) that all photos share.
fn shared_folder(drafts: &[Draft]) -> usize {
    let (Some(first), Some(last)) = (drafts.first(), drafts.last()) else { return 0 };
    // Sorted, so what the first and the last share, all share.
    let same = first.photo.name.bytes().zip(last.photo.name.bytes()).take_while(|(a, b)| a == b).count();
    first.photo.name.as_bytes()[..same].iter().rposition(|&byte| byte == b'/').map_or(0, |slash| slash + 1)
}

fn view(
    root: &Path,
    cameras: &Path,
    draft: Draft,
    shared: usize,
    options: &SceneOptions,
    changes: &mut Changes,
) -> Result<View, SceneError> {
    let image = root.join(&draft.photo.name);
    let name = draft.photo.name[shared..].to_owned();
    let refused = |source: CameraError| SceneError::Camera { path: cameras.to_owned(), image: name.clone(), source };
    let actual = (draft.photo.width, draft.photo.height);
    let declared = match draft.size {
        Size::Actual => actual,
        Size::Exactly(width, height) | Size::Scaled(width, height) => (width, height),
    };
    let may_scale = matches!(draft.size, Size::Scaled(..));
    if declared != actual && !(may_scale && same_shape(declared, actual)) {
        return Err(SceneError::ImageSize { path: image, actual, declared_in: cameras.to_owned(), declared });
    }
    let mut native =
        Camera::new(draft.intrinsics, declared.0, declared.1, draft.rotation, draft.translation).map_err(refused)?;
    if declared != actual {
        native = native.with_size_scaled(actual.0, actual.1).map_err(refused)?;
        changes.rescaled.push(format!("{name} {}x{} → {}x{}", declared.0, declared.1, actual.0, actual.1));
    }
    draft.distortion.check().map_err(refused)?;
    let distortion = Some(draft.distortion).filter(|d| !d.is_none());
    if distortion.is_some() {
        changes.undistorted.push(name.clone());
    }
    let mut camera = native.clone();
    if let Some(width) = options.width.filter(|&width| width < actual.0) {
        let height = (actual.1 as f64 * width as f64 / actual.0 as f64).round().max(1.0) as usize;
        camera = native.with_size_scaled(width, height).map_err(refused)?;
        changes.shrunk.push(format!("{name} {}x{} → {width}x{height}", actual.0, actual.1));
    }
    let usable = |&(near, far): &(f64, f64)| far.is_finite() && uniform_disparities(near, far, 2).is_ok();
    let depth_range = draft.depth_range.filter(usable);
    if let (Some((near, far)), None) = (draft.depth_range, depth_range) {
        changes.no_range.push(format!("{name} ({near:?} to {far:?})"));
    }
    Ok(View { name, camera, depth_range, image, native, distortion })
}

/// Whether one size is the other resampled: equal aspect within 1 %, or within the rounding of one pixel.
fn same_shape(declared: (usize, usize), actual: (usize, usize)) -> bool {
    let [w, h, width, height] = [declared.0, declared.1, actual.0, actual.1].map(|side| side as f64);
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
