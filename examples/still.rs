//! A still picture: a held-out view of the example scene, rendered from its other photos.
//!
//! `cargo run --release --example still [-- FOLDER [WIDTH]]`

use std::error::Error;
use std::path::PathBuf;

use liveview::{Options, Synthesizer, Target};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = PathBuf::from(args.next().unwrap_or_else(|| "out/still".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let mut options = Options::default();
    options.scene.width = args.next().map(|width| width.parse()).transpose()?;

    let mut synthesizer = Synthesizer::open("tests/scenes/workshop", &options)?;
    let frame = synthesizer.render(&Target::held_out("target_0"))?;
    frame.inpainted().save(folder.join("target_0.png"))?;
    Ok(())
}
