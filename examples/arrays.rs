//! Arrays in, arrays out: photos `[h, w, 3]` of u8, pictures `[h, w, 3]` of u8 and f32.
//!
//! `cargo run --release --example arrays [-- FOLDER]`

use liveview::ImageRgb;
use liveview::ndarray::Array3;
use liveview_synthesizer::{Options, Scene, Synthesizer, Target};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = Options::default();
    options.scene.width = Some(168);
    // These arrays and cameras come from a folder; yours come from anywhere.
    let folder = Scene::open("tests/scenes/workshop".as_ref(), &options.scene)?;
    let mut photos = Vec::new();
    for (index, view) in folder.views.iter().enumerate() {
        let array: Array3<u8> = folder.load_image(index)?.to_array_u8();
        photos.push((view.name.clone(), ImageRgb::from_array_u8(array.view())?, view.camera.clone()));
    }
    let mut synthesizer = Synthesizer::with_scene(Scene::in_memory(photos, &options.scene)?, &options)?;
    let picture = synthesizer.render(&Target::held_out("target_0"))?.picture();
    let brighter = picture.as_array().mapv(|value| value.powf(0.98));
    let file = format!("{}/target_0.png", std::env::args().nth(1).as_deref().unwrap_or("."));
    Ok(ImageRgb::from_array(brighter.view())?.save(file)?)
}
