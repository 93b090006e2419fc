//! The frame does not depend on how it was computed: threads, batch size, run.

use std::path::Path;

use liveview::guide::{CoarsePass, RangeMap};
use liveview::layers::{Layers, padded};
use liveview::models;
use liveview::network::OrtNetwork;
use liveview::render::{Frame, Renderer, warp_sources};
use liveview::runtime::Runtime;
use liveview::scene::{Scene, SceneOptions};
use liveview::stops::Stops;
use liveview::views::{SourceView, choose_views};
use liveview::warp::Texture;

/// Frames on [0, 1] may differ by this much between thread counts and batch sizes.
const TOLERANCE: f32 = 1e-6;

fn render(threads: usize, batch: usize) -> Frame {
    render_stopped(threads, batch, |range| Layers::guided(range, 5).unwrap(), Stops::default())
}

/// The example scene's first held-out view, small, on a pool of `threads` and with the engine on as many.
fn render_stopped(threads: usize, batch: usize, layers: fn(&RangeMap) -> Layers, stops: Stops) -> Frame {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenes/workshop");
    let scene = Scene::open(&root, &SceneOptions { width: Some(200), ..SceneOptions::default() }).unwrap();
    let held_out = scene.view_index("target_0").unwrap();
    let target = &scene.views[held_out].camera;
    let others: Vec<usize> = (0..scene.views.len()).filter(|&view| view != held_out).collect();
    let cameras: Vec<_> = others.iter().map(|&view| &scene.views[view].camera).collect();
    let nearest = choose_views(&cameras, target, 4).unwrap();
    let photos: Vec<_> = nearest.iter().map(|&i| Texture::new(&scene.load_image(others[i]).unwrap())).collect();
    let views: Vec<_> =
        nearest.iter().zip(&photos).map(|(&i, texture)| SourceView { camera: cameras[i], texture }).collect();
    let network = OrtNetwork::open(&Runtime::load(None).unwrap(), &models::find(4).unwrap(), threads).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let size = (padded(target.height()), padded(target.width()));
        let pass = CoarsePass { near: 1.0, far: 8.0, planes: None };
        let range = pass.search(&warp_sources(&views, target), size).unwrap().range;
        let layers = layers(&range);
        let mut renderer = Renderer::new(network, batch);
        renderer.set_stops(stops);
        renderer.render(&views, target, &layers).unwrap()
    })
}

#[test]
fn threads_and_batch_size_do_not_show() {
    let first = render(1, 1);
    for (threads, batch) in [(1, 3), (2, 1), (2, 2), (3, 5)] {
        let other = render(threads, batch);
        let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let picture = apart(first.picture.data(), other.picture.data());
        let disparity = apart(first.disparity.as_slice().unwrap(), other.disparity.as_slice().unwrap());
        assert!(picture <= TOLERANCE, "{threads} threads, batch {batch}: pictures differ by {picture:.1e}");
        assert!(disparity <= TOLERANCE, "{threads} threads, batch {batch}: disparities differ by {disparity:.1e}");
    }
}

#[test]
fn two_runs_are_the_same_to_the_bit() {
    let (first, second) = (render(2, 2), render(2, 2));
    assert_eq!(first.picture.data(), second.picture.data());
    assert_eq!(first.disparity, second.disparity);
    assert_eq!(first.best_layer, second.best_layer);
}

#[test]
fn the_last_planes_left_out_change_a_pixel_by_no_more_than_what_it_had_left() {
    let planes = |_: &RangeMap| Layers::uniform(1.0, f64::INFINITY, 16).unwrap();
    let dense = render_stopped(2, 1, planes, Stops::NONE);
    let exact = render_stopped(2, 1, planes, Stops::default());
    assert_eq!(dense.picture.data(), exact.picture.data());
    let stopped = render_stopped(2, 1, planes, Stops { transmittance: 0.9, ..Stops::default() });
    assert!(stopped.left_out.opaque > 0 && stopped.left_out.transmittance < 0.9, "{:?}", stopped.left_out);
    let pairs = dense.picture.data().iter().zip(stopped.picture.data());
    for (i, (a, b)) in pairs.enumerate() {
        let left = stopped.transmittance.as_slice().unwrap()[i / 3];
        assert!((a - b).abs() <= left + TOLERANCE, "{} apart where {left} was left", (a - b).abs());
    }
}
