//! The frames of a path around the example scene, as PNG files.
//!
//! `cargo run --release --example path [-- FOLDER [WIDTH]]`; a video of them:
//! `ffmpeg -framerate 12 -i FOLDER/frame_%04d.png path.mp4`

use std::path::PathBuf;

use liveview_synthesizer::{Options, Synthesizer, Targets};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let folder = PathBuf::from(args.next().unwrap_or_else(|| "out/path".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let mut options = Options::default();
    options.scene.width = args.next().map(|width| width.parse()).transpose()?;

    let mut synthesizer = Synthesizer::open("tests/scenes/workshop", &options)?;
    let targets = Targets::path(synthesizer.scene(), "circle:12".parse()?)?;
    for frame in synthesizer.frames(targets)? {
        let (shot, frame) = frame?;
        frame.picture().save(folder.join(format!("{}.png", shot.name)))?;
    }
    Ok(())
}
