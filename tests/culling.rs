//! Layers are left out only where that is exact or within the certified bound, whatever the network says.

mod double;

use std::sync::Arc;
use std::sync::atomic::Ordering;

use double::{Scrambler, camera, photo};
use glam::{DMat3, DVec3};
use liveview::geometry::Camera;
use liveview::layers::Layers;
use liveview::render::{Accumulated, Blended, Culled, Culling, Frame, Renderer};
use liveview::warp::{SourceView, Texture};
use proptest::prelude::*;

/// Columns and rows of the target; its padded rows are longer.
const SIZE: (usize, usize) = (20, 16);

/// Two wide photos that see every pixel of the target on every layer.
struct Wide {
    cameras: [Camera; 2],
    photos: [Texture; 2],
}

impl Wide {
    const PHOTO: (usize, usize) = (80, 64);

    fn new(seed: u32) -> Self {
        let cameras = [-0.1, 0.15].map(|x| camera(Self::PHOTO, DMat3::IDENTITY, DVec3::new(x, 0.05, 0.0)));
        Self { cameras, photos: [photo(Self::PHOTO, seed), photo(Self::PHOTO, !seed)] }
    }

    fn render(&self, layers: &Layers, opacity: f32, batch: usize, culling: Culling) -> (Frame, usize) {
        render(&self.cameras, &self.photos, layers, opacity, batch, culling)
    }
}

/// The frame, and how many layers the network has seen.
fn render(
    cameras: &[Camera; 2],
    photos: &[Texture; 2],
    layers: &Layers,
    opacity: f32,
    batch: usize,
    culling: Culling,
) -> (Frame, usize) {
    let views: Vec<_> = cameras.iter().zip(photos).map(|(camera, texture)| SourceView { camera, texture }).collect();
    let network = Scrambler::new(opacity);
    let layers_inferred = Arc::clone(&network.layers);
    let mut renderer = Renderer::new(Box::new(network), batch);
    renderer.set_culling(culling);
    let frame = renderer.render(&views, &camera(SIZE, DMat3::IDENTITY, DVec3::ZERO), layers).unwrap();
    (frame, layers_inferred.load(Ordering::Relaxed))
}

fn assert_same(a: &Frame, b: &Frame) {
    assert_eq!(a.picture.data(), b.picture.data());
    assert_eq!(a.disparity, b.disparity);
    assert_eq!(a.transmittance, b.transmittance);
    assert_eq!(a.best_layer, b.best_layer);
}

fn furthest_apart(a: &Frame, b: &Frame) -> f64 {
    a.picture.data().iter().zip(b.picture.data()).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}

/// Layers are left out behind a transmittance alone.
fn behind(transmittance: f64) -> Culling {
    let mut culling = Culling::NONE;
    culling.transmittance = transmittance;
    culling
}

#[test]
fn layers_that_no_view_covers_are_left_out_to_the_bit_the_farthest_too() {
    // From the sides, across the target's axis: both see what lies about 2 in front of it, neither what is near or far.
    let turned = [1.0, -1.0].map(|side| (side, DMat3::from_rotation_y(side * std::f64::consts::FRAC_PI_2)));
    let cameras = turned.map(|(side, rotation)| camera(SIZE, rotation, DVec3::new(side, 0.0, 2.0)));
    let photos = [photo(SIZE, 1), photo(SIZE, 2)];
    let layers = Layers::planes(&[10.0, 0.6, 0.5, 0.45, 0.01, 0.0]).unwrap();
    let (dense, all) = render(&cameras, &photos, &layers, 0.0, 1, Culling::NONE);
    assert_eq!((dense.culled, all), (Culled::default(), 6));
    assert!(dense.transmittance.iter().any(|&t| t < 0.9), "the middle layers show");
    for batch in [1, 2, 5] {
        let (frame, inferred) = render(&cameras, &photos, &layers, 0.0, batch, Culling::default());
        assert_same(&dense, &frame);
        assert_eq!((frame.culled.uncovered, inferred, frame.culled.opaque), (3, 3, 0));
    }
}

proptest! {
    #[test]
    fn what_is_left_out_as_hidden_changes_no_channel_by_more_than_tau(
        seed in any::<u32>(), opacity in -2.0_f32..6.0, count in 1_usize..9, batch in 1_usize..4, tau in 0.0..0.7,
    ) {
        let layers = Layers::uniform(1.0, 8.0, count).unwrap();
        let scene = Wide::new(seed);
        let (dense, _) = scene.render(&layers, opacity, 1, Culling::NONE);
        let (exact, all) = scene.render(&layers, opacity, batch, Culling::default());
        assert_same(&dense, &exact);
        prop_assert_eq!((exact.culled, all), (Culled::default(), count));

        let (frame, inferred) = scene.render(&layers, opacity, batch, behind(tau));
        let Culled { uncovered, opaque, transmittance } = frame.culled;
        prop_assert_eq!(inferred + opaque + uncovered, count);
        prop_assert!(opaque == 0 || transmittance < tau, "{:?}", frame.culled);
        let apart = furthest_apart(&dense, &frame);
        prop_assert!(apart <= transmittance + 1e-6, "{} apart, {:?}", apart, frame.culled);
    }

    /// Drop the planes back to front and telescope: each changes the pixel by at most its own weight.
    #[test]
    fn planes_of_known_alpha_change_a_pixel_by_at_most_the_sum_of_their_weights(
        planes in prop::collection::vec((0.0_f32..1.0, 0.0_f32..1.0, any::<bool>()), 2..12),
    ) {
        prop_assume!(planes.iter().any(|plane| plane.2));
        let composite = |planes: &[&(f32, f32, bool)]| {
            let mut row = Accumulated::new(1);
            let mut weights = Vec::new();
            for (k, &&(alpha, grey, _)) in planes.iter().enumerate() {
                let layer = Blended { alpha: vec![alpha], rgb: std::array::from_fn(|_| vec![grey]), covered: vec![true] };
                let before = row.transmittance[0];
                row.add(k as u32, &layer, &[0.0], k + 1 == planes.len());
                weights.push(before - row.transmittance[0]);
            }
            (row.rgb[0][0], weights)
        };
        let (full, weights) = composite(&planes.iter().collect::<Vec<_>>());
        let (kept, _) = composite(&planes.iter().filter(|plane| plane.2).collect::<Vec<_>>());
        let bound: f64 = planes.iter().zip(&weights).filter(|(plane, _)| !plane.2).map(|(_, weight)| weight).sum();
        prop_assert!((full - kept).abs() <= bound + 1e-12, "{} apart, bound {}", (full - kept).abs(), bound);
    }
}

#[test]
fn an_opaque_front_spares_the_network_the_rest() {
    let layers = Layers::uniform(1.0, 8.0, 8).unwrap();
    let (frame, inferred) = Wide::new(3).render(&layers, 12.0, 1, behind(0.01));
    assert_eq!((inferred, frame.culled.opaque), (1, 7), "{:?}", frame.culled);
    assert!(frame.culled.transmittance > 0.0);
}
