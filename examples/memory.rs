//! A scene in memory: photos of the crate `image`, cameras from K and a 4×4 matrix with OpenGL's axes
//! (`Camera::from_opencv` takes OpenCV's).
//!
//! `cargo run --release --example memory [-- FOLDER]`

use liveview::geometry::Size;
use liveview::{Camera, ImageRgb, Options, Scene, Synthesizer, Target};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = Options::default();
    options.scene.width = Some(168);
    let rig: serde_json::Value = serde_json::from_slice(&std::fs::read("tests/scenes/rig/transforms.json")?)?;
    let mut photos = Vec::new();
    for frame in rig["frames"].as_array().ok_or("no frames")? {
        let (name, focal) = (frame["file_path"].as_str().ok_or("no name")?, frame["fl_x"].as_f64().ok_or("no fl_x")?);
        let photo = ImageRgb::from(&image::open(format!("tests/scenes/rig/{name}"))?.to_rgb8());
        let k = [[focal, 0.0, 252.0], [0.0, focal, 176.0], [0.0, 0.0, 1.0]];
        let world_from_cam = serde_json::from_value(frame["transform_matrix"].clone())?;
        photos.push((name.to_owned(), photo, Camera::from_opengl(k, world_from_cam, Size::new(504, 352))?));
    }
    let mut synthesizer = Synthesizer::with_scene(Scene::in_memory(photos, &options.scene)?, &options)?;
    let frame = synthesizer.render(&Target::held_out("target/0000.jpg"))?;
    Ok(frame.inpainted().save(format!("{}/target.png", std::env::args().nth(1).as_deref().unwrap_or(".")))?)
}
