//! Front-to-back compositing, near → far: C = Σ T α c, T ← T (1 − α), with no epsilon inside the product.
//!
//! Sums and T are f64: in f32 the mean error ties with float32 torch's, and is above it in some cases.

use crate::blend::Blended;

/// What one pixel of the target has gathered so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accumulated {
    /// Σ T α c.
    pub rgb: [f64; 3],
    /// Σ T α δ, 1/scene unit.
    pub disparity: f64,
    /// T: what no layer has covered yet.
    pub transmittance: f64,
    /// Largest α so far and the index of its layer (ties: the nearer); the paper's selection votes with it.
    pub best: (f32, u32),
}

impl Default for Accumulated {
    fn default() -> Self {
        Self { rgb: [0.0; 3], disparity: 0.0, transmittance: 1.0, best: (0.0, u32::MAX) }
    }
}

impl Accumulated {
    /// Add layer `index` at `disparity`, behind all that was added before. The farthest layer is the `background`: its α
    /// is 1 wherever any view covers it, so that any subset of planes yields a full image.
    #[inline]
    pub fn add(&mut self, index: u32, layer: Blended, disparity: f32, background: bool) {
        if layer.alpha > self.best.0 {
            self.best = (layer.alpha, index);
        }
        let alpha = if background && layer.covered { 1.0 } else { f64::from(layer.alpha) };
        let weight = self.transmittance * alpha;
        for (sum, c) in self.rgb.iter_mut().zip(layer.rgb) {
            *sum += weight * f64::from(c);
        }
        self.disparity += weight * f64::from(disparity);
        self.transmittance *= 1.0 - alpha;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittance_worked_by_hand() {
        let mut pixel = Accumulated::default();
        for (index, alpha) in [0.0, 0.3, 0.8, 0.5].into_iter().enumerate() {
            let layer = Blended { alpha, rgb: [1.0; 3], covered: true };
            pixel.add(index as u32, layer, 4.0 - index as f32, false);
        }
        // weights 0, 0.3, 0.56, 0.07
        assert!((pixel.transmittance - 0.07).abs() < 1e-7, "{pixel:?}");
        assert!((pixel.rgb[0] - 0.93).abs() < 1e-7, "{pixel:?}");
        assert!((pixel.disparity - (0.3 * 3.0 + 0.56 * 2.0 + 0.07)).abs() < 1e-6, "{pixel:?}");
        assert_eq!(pixel.best, (0.8, 2));
    }

    #[test]
    fn the_background_fills_what_is_left_only_where_it_is_covered() {
        let layer = Blended { alpha: 0.1, rgb: [0.5; 3], covered: true };
        let mut pixel = Accumulated::default();
        pixel.add(0, layer, 1.0, true);
        assert_eq!((pixel.rgb, pixel.transmittance), ([0.5; 3], 0.0));
        let mut pixel = Accumulated::default();
        pixel.add(0, Blended { alpha: 0.0, covered: false, ..layer }, 1.0, true);
        assert_eq!(pixel.transmittance, 1.0);
    }
}
