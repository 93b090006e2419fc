//! A video along a path around the example scene: each frame as a PNG, and all of them in a y4m
//! file, which video players read.
//!
//! `cargo run --release --example path [-- FOLDER [WIDTH]]`

use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use liveview::ImageRgb;
use liveview_synthesizer::{Options, Synthesizer, Targets};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = PathBuf::from(args.next().unwrap_or_else(|| "out/path".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let mut options = Options::default();
    options.scene.width = args.next().map(|width| width.parse()).transpose()?;

    let mut synthesizer = Synthesizer::open("tests/scenes/workshop", &options)?;
    let targets = Targets::path(synthesizer.scene(), "circle:12".parse()?)?;
    let size = targets.list[0].camera.size();
    let mut video = BufWriter::new(File::create(folder.join("path.y4m"))?);
    writeln!(video, "YUV4MPEG2 W{} H{} F12:1 Ip A1:1 C444", size.width, size.height)?;
    for frame in synthesizer.frames(targets)? {
        let (shot, frame) = frame?;
        let picture = frame.picture();
        picture.save(folder.join(format!("{}.png", shot.name)))?;
        write_frame(&mut video, &picture)?;
    }
    Ok(video.flush()?)
}

/// Y, Cb and Cr of BT.601, in the limited range that players expect.
fn write_frame(video: &mut impl Write, picture: &ImageRgb) -> std::io::Result<()> {
    const FROM_RGB: [[f32; 4]; 3] =
        [[16.0, 65.481, 128.553, 24.966], [128.0, -37.797, -74.203, 112.0], [128.0, 112.0, -93.786, -18.214]];
    writeln!(video, "FRAME")?;
    for [offset, red, green, blue] in FROM_RGB {
        let value = |rgb: &[f32]| (offset + red * rgb[0] + green * rgb[1] + blue * rgb[2]).round() as u8;
        video.write_all(&picture.data().chunks_exact(3).map(value).collect::<Vec<_>>())?;
    }
    Ok(())
}
