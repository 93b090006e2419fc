//! A network of one's own in place of the model: anything that gives logits of a layer's colours. No ONNX Runtime is needed.
//!
//! `cargo run --release --example own_network [-- FOLDER [WIDTH]]`

use std::error::Error;
use std::path::{Path, PathBuf};

use liveview::ndarray::{ArrayView4, ArrayViewMut4};
use liveview::network::{NetworkError, PlaneNetwork};
use liveview::render::Renderer;
use liveview::{LayerSpec, Scene, SceneOptions, SceneViews, Synthesizer, Target};

/// Opaque where the views agree on the colour: the oldest idea of stereo.
struct Agreement;

impl PlaneNetwork for Agreement {
    fn views(&self) -> usize {
        4
    }

    /// The first logit is that of the layer's opacity; where the others are 0, the nearer views weigh more, and no more.
    fn infer(&mut self, hwv: ArrayView4<'_, f32>, mut logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
        logits.fill(0.0);
        let (layers, channels, height, width) = hwv.dim();
        for layer in 0..layers {
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let apart = |c: usize| (hwv[[layer, c, y, x]] - hwv[[layer, c % 3, y, x]]).abs();
                logits[[layer, 0, y, x]] = 4.0 - 8.0 * (3..channels).map(apart).sum::<f32>();
            }
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = PathBuf::from(args.next().unwrap_or_else(|| "out/own_network".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let mut options = SceneOptions::default();
    options.width = args.next().map(|width| width.parse()).transpose()?;

    // The depth range is the scene's own, and one layer goes through the network at once.
    let photos = SceneViews::new(Scene::open(Path::new("tests/scenes/workshop"), &options)?, None, None);
    let mut synthesizer = Synthesizer::new(photos, Renderer::new(Box::new(Agreement), 1), LayerSpec::guided(4));
    let frame = synthesizer.render(&Target::held_out("target_0"))?;
    frame.picture.save(folder.join("target_0.png"))?;
    Ok(())
}
