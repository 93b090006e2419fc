//! Skipping uncovered layers does not change the frame, whatever logits the network gives.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use glam::{DMat3, DVec3};
use liveview::geometry::Camera;
use liveview::layers::Layers;
use liveview::network::Alpha;
use liveview::render::{Accumulated, Blended, Frame, RenderRequest, Renderer};
use liveview::warp::{SourceView, Texture};
use proptest::prelude::*;

use crate::synthetic::{PseudorandomNetwork, camera, photo};

/// Columns and rows of the target, before padding.
const SIZE: (usize, usize) = (20, 16);

/// Two photos and their cameras.
struct Rig {
    cameras: [Camera; 2],
    photos: [Texture; 2],
}

impl Rig {
    /// The frame, and the number of layers that the network was run on.
    fn render(&self, layers: &Layers, opacity: f32, batch: usize, skip_uncovered: bool) -> (Frame, usize) {
        let views = self.cameras.iter().zip(&self.photos);
        let views: Vec<_> = views.map(|(camera, texture)| SourceView { camera, texture }).collect();
        let network = PseudorandomNetwork::new(opacity);
        let layers_inferred = Arc::clone(&network.layers);
        let mut renderer = Renderer::new(Box::new(network), Alpha::Independent, batch);
        renderer.set_skip_uncovered(skip_uncovered);
        let target = camera(SIZE, DMat3::IDENTITY, DVec3::ZERO);
        let frame = renderer.render(RenderRequest::new(&views, &target, layers)).unwrap();
        (frame, layers_inferred.load(Ordering::Relaxed))
    }
}

fn assert_same(a: &Frame, b: &Frame) {
    assert_eq!(a.raw().data(), b.raw().data());
    assert_eq!(a.disparity, b.disparity);
    assert_eq!(a.transmittance, b.transmittance);
    assert_eq!(a.best_layer, b.best_layer);
}

#[test]
fn frame_with_uncovered_layers_skipped_has_the_same_bits() {
    // The cameras look from the left and right across the target's axis. Both cover depths of about
    // 2, and neither covers the nearest or the farthest layers.
    let turned = [1.0, -1.0].map(|side| (side, DMat3::from_rotation_y(side * FRAC_PI_2)));
    let cameras = turned.map(|(side, rotation)| camera(SIZE, rotation, DVec3::new(side, 0.0, 2.0)));
    let rig = Rig { cameras, photos: [photo(SIZE, 1), photo(SIZE, 2)] };
    let layers = Layers::planes(&[10.0, 0.6, 0.5, 0.45, 0.01, 0.0]).unwrap();
    let (dense, all) = rig.render(&layers, 0.0, 1, false);
    assert_eq!((dense.uncovered_layers, all), (0, 6));
    assert!(dense.transmittance.iter().any(|&t| t < 0.9), "the middle layers are covered");
    for batch in [1, 2, 5] {
        let (frame, inferred) = rig.render(&layers, 0.0, batch, true);
        assert_same(&dense, &frame);
        assert_eq!((frame.uncovered_layers, inferred), (3, 3));
    }
}

proptest! {
    #[test]
    fn covered_layers_are_never_skipped(
        seed in any::<u32>(), opacity in -2.0_f32..6.0, count in 1_usize..9, batch in 1_usize..4,
    ) {
        // These photos are so wide that they cover every pixel of the target on every layer.
        const PHOTO: (usize, usize) = (80, 64);
        let cameras = [-0.1, 0.15].map(|x| camera(PHOTO, DMat3::IDENTITY, DVec3::new(x, 0.05, 0.0)));
        let rig = Rig { cameras, photos: [photo(PHOTO, seed), photo(PHOTO, !seed)] };
        let layers = Layers::uniform(1.0, 8.0, count).unwrap();
        let (dense, _) = rig.render(&layers, opacity, 1, false);
        let (exact, inferred) = rig.render(&layers, opacity, batch, true);
        assert_same(&dense, &exact);
        prop_assert_eq!((exact.uncovered_layers, inferred), (0, count));
    }

    /// Removing a plane, farther ones before nearer ones, changes the pixel by at most the plane's
    /// weight in the composite of all planes.
    #[test]
    fn pixel_without_some_planes_changes_by_at_most_the_sum_of_their_weights(
        planes in prop::collection::vec((0.0_f32..1.0, 0.0_f32..1.0, any::<bool>()), 2..12),
    ) {
        prop_assume!(planes.iter().any(|plane| plane.2));
        let composite = |planes: &[&(f32, f32, bool)]| {
            let mut row = Accumulated::new(1);
            let mut weights = Vec::new();
            for (k, &&(alpha, grey, _)) in planes.iter().enumerate() {
                let rgb = std::array::from_fn(|_| vec![grey]);
                let layer = Blended { alpha: vec![alpha], rgb, covered: vec![true] };
                let before = row.transmittance[0];
                row.add(k as u32, &layer, &[0.0], k + 1 == planes.len());
                weights.push(before - row.transmittance[0]);
            }
            (row.rgb[0][0], weights)
        };
        let (full, weights) = composite(&planes.iter().collect::<Vec<_>>());
        let (kept, _) = composite(&planes.iter().filter(|plane| plane.2).collect::<Vec<_>>());
        let bound: f64 = planes.iter().zip(&weights).filter(|(plane, _)| !plane.2).map(|(_, weight)| weight).sum();
        prop_assert!((full - kept).abs() <= bound + 1e-12, "difference {}, bound {bound}", (full - kept).abs());
    }
}
