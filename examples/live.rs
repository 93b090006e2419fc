//! A live session: the clip of a camera rig, seen from a viewpoint that sways between the cameras.
//!
//! `cargo run --release --example live [-- FOLDER [WIDTH]]`, with ONNX Runtime's library in
//! `ORT_DYLIB_PATH`.

use std::error::Error;
use std::path::{Path, PathBuf};

use liveview::glam::DVec3;
use liveview::image::{ImageRgb, load};
use liveview::network::{ExecutionProvider, OrtLibrary, OrtNetwork};
use liveview::render::Renderer;
use liveview_live::session::{LiveSession, LiveSettings};
use liveview_synthesizer::{Scene, SceneOptions};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let out = PathBuf::from(args.next().unwrap_or_else(|| "out/live".to_owned()));
    std::fs::create_dir_all(&out)?;
    let width = args.next().map(|width| width.parse()).transpose()?;
    let options = SceneOptions { width, ..SceneOptions::default() };

    // The first frame of each camera has its pose. The held-out camera is not used.
    let mut scene = Scene::open(Path::new("tests/scenes/rig"), &options)?;
    scene.views.retain(|view| !view.name.starts_with("target"));
    let (near, far) = scene.views[0].depth_range.ok_or("the rig has no depth range")?;
    let cameras: Vec<_> = scene.views.iter().map(|view| view.camera.clone()).collect();
    let middle = cameras[0].clone();

    let library = OrtLibrary::load(ExecutionProvider::Cpu, None)?;
    let network = OrtNetwork::open(&library, Path::new("models/liveview_v4.onnx"), 2)?;
    let alpha = network.card().alpha(None);
    let mut session =
        LiveSession::new(cameras, vec![Renderer::new(Box::new(network), alpha, 1)], LiveSettings::new(near, far))?;

    for step in 0.. {
        // A camera without a photo is left out of this step.
        let photo = |view: usize| -> Option<ImageRgb> {
            let folder = scene.views[view].image_path().parent()?;
            scene.fit(view, load(&folder.join(format!("{step:04}.jpg"))).ok()?).ok()
        };
        let photos: Vec<_> = (0..scene.views.len()).map(photo).collect();
        if photos.iter().all(Option::is_none) {
            break;
        }
        let sway = DVec3::X * 0.03 * (0.3 * f64::from(step)).sin();
        let target = middle.with_pose(middle.rotation(), middle.translation() + sway)?;
        let shown = session.render(&photos.iter().map(Option::as_ref).collect::<Vec<_>>(), &target)?;
        shown.frame.picture().save(out.join(format!("{step:04}.png")))?;
        println!("frame {step}: layers {}, {:.0} ms", shown.layer_source, 1e3 * shown.times.total().as_secs_f64());
    }
    Ok(())
}
