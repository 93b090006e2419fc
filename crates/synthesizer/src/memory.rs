//! Estimates of the memory that a shot, a search and a video need, made before any of it is allocated. Measured with
//! `--network none` at 1 and 3 megapixels, it is right within a tenth; what ONNX Runtime needs is
//! unknown, and its failure is an error.

use crate::{LayerSpec, Shot, SynthesisError};
use liveview::Renderer;
use liveview::geometry::{Camera, Size};
use liveview_files::memory::{self, MemoryError};
use liveview_scene::{Scene, View};
use liveview_surface::search_bytes;

/// Bytes per pixel of a photo as a texture.
const TEXTURE_BYTES: usize = 16;
/// Bytes per pixel of the depth of a photo.
const DEPTH_BYTES: usize = 25;
/// Bytes per pixel of the target without its layers: the search, sums in f64, the picture and its
/// file.
const TARGET_BYTES: usize = 250;

/// Bytes of the process besides: ONNX Runtime, what the pictures' files take.
const OTHER_BYTES: usize = 48 << 20;

/// Refuses the shots if one of them needs more memory than is available.
pub(super) fn check(
    scene: &Scene,
    renderer: &Renderer,
    (layers, with_depth): (&LayerSpec, bool),
    shots: &[Shot],
) -> Result<(), SynthesisError> {
    let bytes = |shot: &Shot| {
        let photo = |&view: &usize| scene.views[view].camera.size().pixels();
        let views: usize = shot.views.iter().chain(&shot.helpers).map(photo).sum();
        let photos = views * if with_depth { TEXTURE_BYTES + DEPTH_BYTES } else { TEXTURE_BYTES };
        let target = shot.target.size().pixels() * TARGET_BYTES;
        OTHER_BYTES + photos + target + renderer.buffer_bytes(shot.target.size(), layers.count())
    };
    let Some(shot) = shots.iter().max_by_key(|shot| bytes(shot)) else { return Ok(()) };
    memory::check(bytes(shot) as u64, rayon::current_num_threads()).map_err(|source| {
        let photos = shot.views.iter().map(|&view| &scene.views[view]);
        let largest = photos.max_by_key(|view| view.camera.size().pixels());
        let photo = largest.map(|view| format!("{} ({})", view.name, view.camera.size())).unwrap_or_default();
        let what = format!("{}: a picture of {} from photos such as {photo}", shot.name, shot.target.size());
        let expected = "a smaller target, smaller photos or fewer layers at once";
        SynthesisError::Memory(format!("{what} {source}; expected {expected}"))
    })
}

/// Refuses a search for a photo's depth among others that needs more memory than is available; `searched` are
/// their views, the photo's first.
pub(crate) fn check_search(scene: &Scene, searched: &[usize], range: (f64, f64)) -> Result<(), SynthesisError> {
    let cameras: Vec<&Camera> = searched.iter().map(|&view| &scene.views[view].camera).collect();
    let photos: usize = cameras.iter().map(|camera| camera.size().pixels() * TEXTURE_BYTES).sum();
    let bytes = photos + search_bytes(&cameras, range);
    memory::check(bytes as u64, rayon::current_num_threads()).map_err(|source| {
        let View { name, camera, .. } = &scene.views[searched[0]];
        let what = format!("{name}: the search for the depth of {}", camera.size());
        SynthesisError::Memory(format!("{what} {source}; expected smaller photos"))
    })
}

/// Bytes per pixel of a rig's cameras: photos of two time steps, what is known of their depth, the search.
const RIG_BYTES: usize = 270;

/// Refuses a video from so many pixels of a rig's cameras that needs more memory than is available, on so many
/// threads of its own.
///
/// # Errors
///
/// [`MemoryError`].
pub fn check_video(cameras: &[&Camera], target: Size, threads: usize) -> Result<(), MemoryError> {
    let pixels: usize = cameras.iter().map(|camera| camera.size().pixels()).sum();
    let bytes = pixels * RIG_BYTES + target.pixels() * TARGET_BYTES;
    memory::check(bytes as u64, threads + rayon::current_num_threads())
}
