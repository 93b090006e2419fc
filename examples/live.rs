//! A rig's clip seen from a camera that sways among the others: `cargo run --release --example live`.
//!
//! The frames of each time step go into a session, the pictures to `out/live`.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use liveview::image::{ImageRgb, load};
use liveview::live::{LiveSession, LiveSettings, Policy};
use liveview::network::OrtLibrary;
use liveview::network::OrtNetwork;
use liveview::render::Renderer;
use liveview::scene::{Scene, SceneOptions};

const RIG: &str = "tests/scenes/rig";

fn main() -> Result<(), Box<dyn Error>> {
    // The first frame of each camera carries its pose; all but the held-out one are rendered from.
    let mut scene = Scene::open(RIG.as_ref(), &SceneOptions::default())?;
    scene.views.retain(|view| !view.name.starts_with("target"));
    let (near, far) = scene.views[0].depth_range.ok_or("the rig does not tell its depths")?;
    let cameras: Vec<_> = scene.views.iter().map(|view| view.camera.clone()).collect();
    let middle = cameras[0].clone();

    let network = OrtNetwork::open(&OrtLibrary::load(None)?, "models/liveview_v4.onnx".as_ref(), 2)?;
    let settings = LiveSettings { near, far, policy: Policy::Carried, layers: 2, coarse_planes: None };
    let mut session = LiveSession::new(cameras, vec![Renderer::new(network, 1)], settings)?;

    std::fs::create_dir_all("out/live")?;
    for step in 0.. {
        // A camera that has nothing to show is left out of this step.
        let photo = |view: usize| -> Option<ImageRgb> {
            let folder = scene.views[view].image_path().parent()?;
            load(&folder.join(format!("{step:04}.jpg"))).ok()
        };
        let photos: Vec<_> = (0..scene.views.len()).map(photo).collect();
        if photos.iter().all(Option::is_none) {
            break;
        }
        let sway = DVec3::X * 0.03 * (0.3 * f64::from(step)).sin();
        let target = middle.with_pose(middle.rotation(), middle.translation() + sway)?;
        let shown = session.render(&photos.iter().map(Option::as_ref).collect::<Vec<_>>(), &target)?;
        shown.frame.picture.save(Path::new("out/live").join(format!("{step:04}.png")))?;
        println!("frame {step}: {}, {:.0} ms", shown.taken, 1e3 * shown.times.total().as_secs_f64());
    }
    Ok(())
}
