//! Two ways to render a held-out photo, side by side with it: along the surface without a network, and
//! on the paper's planes with an exported model that ONNX Runtime runs; what each costs.
//!
//! `cargo run --release --example two_ways [-- FOLDER [WIDTH]]`, with ONNX Runtime's library in
//! `ORT_DYLIB_PATH`.

use std::time::Instant;

use liveview_synthesizer::colormap::side_by_side;
use liveview_synthesizer::{LayerSpec, Options, Synthesizer, Target};
use liveview_synthesizer::{Score, psnr};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "out".to_owned()));
    let mut options = Options::default();
    options.scene.width = std::env::args().nth(2).map(|width| width.parse()).transpose()?;
    let mut pictures = Vec::new();
    for (way, layers) in [("no network", None), ("ONNX Runtime", Some(LayerSpec::PAPER))] {
        options.layers = layers;
        let mut synthesizer = Synthesizer::open("tests/scenes/workshop", &options)?;
        let truth = synthesizer.scene().load_image(synthesizer.scene().view_index("target_0")?)?;
        let started = Instant::now();
        let picture = synthesizer.render(&Target::held_out("target_0"))?.picture();
        let (seconds, score) = (started.elapsed().as_secs_f64(), psnr(&picture, &truth, Score::BORDER));
        println!("{}, {way}: {score:.2} dB, first picture in {seconds:.2} s", synthesizer.layers());
        pictures.extend([truth, picture]);
    }
    std::fs::create_dir_all(&folder)?;
    Ok(side_by_side(&[&pictures[0], &pictures[1], &pictures[3]]).save(folder.join("two_ways.png"))?)
}
