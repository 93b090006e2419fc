//! An estimate of the memory that a shot needs, made before any of it is allocated. Measured with
//! `--network none` at 1 and 3 megapixels, it is right within a tenth; what ONNX Runtime needs is
//! unknown, and its failure is an error.

use crate::{LayerSpec, Shot, SynthesisError};
use liveview::Renderer;
use liveview_files::memory;
use liveview_scene::Scene;

/// Bytes per pixel of a photo as a texture.
const TEXTURE_BYTES: usize = 16;
/// Bytes per pixel of the depth of a photo.
const DEPTH_BYTES: usize = 25;
/// Bytes per pixel of the target without its layers: the search, sums in f64, the picture and its
/// file.
const TARGET_BYTES: usize = 250;

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
        photos + shot.target.size().pixels() * TARGET_BYTES + renderer.buffer_bytes(shot.target.size(), layers.count())
    };
    let Some(shot) = shots.iter().max_by_key(|shot| bytes(shot)) else { return Ok(()) };
    memory::check(bytes(shot) as u64).map_err(|source| {
        let photos = shot.views.iter().map(|&view| &scene.views[view]);
        let largest = photos.max_by_key(|view| view.camera.size().pixels());
        let photo = largest.map(|view| format!("{} ({})", view.name, view.camera.size())).unwrap_or_default();
        SynthesisError::Memory { target: shot.name.clone(), size: shot.target.size(), photo, source }
    })
}
