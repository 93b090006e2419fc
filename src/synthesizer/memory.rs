//! What a shot takes of memory, before any of it is taken. Measured with `--network none` at 1 and 3 megapixels, within a tenth below and
//! above; what ONNX Runtime takes is not known, and its failure is an error.

use super::error::SynthesisError;
use super::target::Shot;
use crate::fs::memory;
use crate::layers::LayerSpec;
use crate::render::Renderer;
use crate::scene::Scene;

/// Bytes per pixel of a photo as a texture.
const TEXTURE: usize = 16;
/// Of a photo with its depth.
const DEPTH: usize = 25;
/// Of the target, but for its layers: the search, sums in f64, the picture and its file.
const TARGET: usize = 250;

/// Refuses the shots of which one takes more memory than can be had.
pub(super) fn check(
    scene: &Scene,
    renderer: &Renderer,
    layers: &LayerSpec,
    shots: &[Shot],
) -> Result<(), SynthesisError> {
    let with_depth = layers.kind() == "surface";
    let bytes = |shot: &Shot| {
        let photo = |&view: &usize| scene.views[view].camera.size().pixels();
        let views: usize = shot.views.iter().chain(&shot.helpers).map(photo).sum();
        let photos = views * if with_depth { TEXTURE + DEPTH } else { TEXTURE };
        photos + shot.target.size().pixels() * TARGET + renderer.buffer_bytes(shot.target.size(), layers.count())
    };
    let Some(shot) = shots.iter().max_by_key(|shot| bytes(shot)) else { return Ok(()) };
    memory::check(bytes(shot) as u64).map_err(|source| {
        let photos = shot.views.iter().map(|&view| &scene.views[view]);
        let largest = photos.max_by_key(|view| view.camera.size().pixels());
        let photo = largest.map(|view| format!("{} ({})", view.name, view.camera.size())).unwrap_or_default();
        SynthesisError::Memory { target: shot.name.clone(), size: shot.target.size(), photo, source }
    })
}
