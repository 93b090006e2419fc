//! Times of one photo's depth, of what photos confirm and of a target's surface: `cargo run --release --example depth_times`.

use std::time::Instant;

use liveview::mvs::{self, DepthMaps, Settings, SurfaceView};
use liveview::scene::{Scene, SceneOptions};
use liveview::warp::{SourceView, Texture};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let times: usize = std::env::args().nth(1).map_or(Ok(5), |n| n.parse())?;
    let scene = Scene::open("tests/scenes/workshop".as_ref(), &SceneOptions::default())?;
    let textures = (0..7).map(|i| Ok(Texture::new(&scene.load_image(i)?))).collect::<Result<Vec<_>, Failure>>()?;
    let view = |i: usize| SourceView { camera: &scene.views[i].camera, texture: &textures[i] };
    let settings = Settings::default();
    let (near, far) = (1.2, 7.0);
    let neighbours: Vec<_> = (1..5).map(view).collect();
    time("depth of a photo", times, || mvs::photo_depth(&view(0), &neighbours, near, far, &settings));
    let mut maps = DepthMaps::new((0..7).map(|i| scene.views[i].camera.clone()).collect(), near, far, settings.clone());
    let target = &scene.views[7].camera;
    let set = maps.photos_for(target, 4);
    for &i in &set {
        maps.depth(i, view);
    }
    time("what six photos confirm", times, || maps.clone().known(&set));
    let known = maps.known(&set);
    let views: Vec<_> = known.iter().map(|(i, all, known)| SurfaceView { view: view(*i), all, known }).collect();
    time("gains", times, || mvs::exposure_gains(&views, &[1.0; 6]));
    time("surface", times, || mvs::surface(&views, 6, target, near, far, &settings));
    let plain = Settings { searched: false, second: false, ..settings };
    time("surface without a search in holes", times, || mvs::surface(&views, 6, target, near, far, &plain));
    Ok(())
}

fn time<T>(name: &str, times: usize, f: impl Fn() -> T) {
    let once = || {
        let started = Instant::now();
        std::hint::black_box(f());
        started.elapsed().as_secs_f64() * 1e3
    };
    let mut all: Vec<f64> = (0..times).map(|_| once()).collect();
    all.sort_by(f64::total_cmp);
    println!("{name}: {:.1} ms (least {:.1})", all[all.len() / 2], all[0]);
}
