//! Your own network in place of the model: anything that computes logits from the colours of a
//! layer. It needs no ONNX Runtime. (`liveview_synthesizer::ViewAgreement` is the default.)
//!
//! `cargo run --release --example own_network [-- FOLDER [WIDTH]]`

use std::error::Error;
use std::path::{Path, PathBuf};

use liveview::ndarray::{ArrayView4, ArrayViewMut4};
use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::Renderer;
use liveview_synthesizer::{LayerSpec, Scene, SceneOptions, SceneViews, Synthesizer, Target};

/// Layers are opaque where the views agree on the colour.
struct ColourDifference;

impl PlaneNetwork for ColourDifference {
    fn views(&self) -> usize {
        4
    }

    /// Logit 0 is the opacity; the other logits are 0, so that views are weighted by their distance
    /// alone.
    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
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
    let options =
        SceneOptions { width: args.next().map(|width| width.parse()).transpose()?, ..SceneOptions::default() };

    // The depth range is that of the scene; one layer at a time goes through the network.
    let photos = SceneViews::new(Scene::open(Path::new("tests/scenes/workshop"), &options)?, None, None);
    let mut synthesizer = Synthesizer::new(
        photos,
        Renderer::new(Box::new(ColourDifference), Alpha::Independent, 1),
        LayerSpec::guided(4),
    );
    let frame = synthesizer.render(&Target::held_out("target_0"))?;
    frame.picture().save(folder.join("target_0.png"))?;
    Ok(())
}
