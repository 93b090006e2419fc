//! A network without trained weights, and cameras and photos for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics};
use liveview::image::ImageRgb;
use liveview::network::{NetworkError, PlaneNetwork};
use liveview::warp::Texture;
use ndarray::{ArrayView4, ArrayViewMut4};

/// Gives pseudorandom logits that depend only on the pixel's colours.
pub(crate) struct PseudorandomNetwork {
    /// The mean of the logits of α.
    opacity: f32,
    /// Number of layers inferred so far.
    pub(crate) layers: Arc<AtomicUsize>,
}

impl PseudorandomNetwork {
    pub(crate) fn new(opacity: f32) -> Self {
        Self { opacity, layers: Arc::default() }
    }
}

impl PlaneNetwork for PseudorandomNetwork {
    fn views(&self) -> usize {
        2
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        self.layers.fetch_add(hwv.dim().0, Ordering::Relaxed);
        for ((n, v, y, x), logit) in logits.indexed_iter_mut() {
            let pixel = (0..6).map(|c| (37 * (c + v) + 1) as f32 * hwv[[n, c, y, x]]).sum::<f32>();
            *logit = 4.0 * pixel.sin() + if v == 0 { self.opacity } else { 0.0 };
        }
        Ok(())
    }
}

/// A camera with a focal length of 20 pixels and the principal point in the middle.
pub(crate) fn camera(size: (usize, usize), rotation: DMat3, centre: DVec3) -> Camera {
    let (cx, cy) = (size.0 as f64 / 2.0, size.1 as f64 / 2.0);
    let intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx, cy, skew: 0.0 };
    Camera::new(intrinsics, size.0, size.1, rotation, -(rotation * centre)).unwrap()
}

/// A photo of white noise.
pub(crate) fn photo(size: (usize, usize), seed: u32) -> Texture {
    let value = |i: u32| (i.wrapping_add(seed).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
    Texture::new(&ImageRgb::new(size.0, size.1, (0..3 * (size.0 * size.1) as u32).map(value).collect()).unwrap())
}
