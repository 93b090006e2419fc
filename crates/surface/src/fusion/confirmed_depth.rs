//! The depth of a photo where other photos confirm it.

use ndarray::Array2;

use crate::search::PhotoDepth;

/// Disparities of a photo that other photos confirm.
#[derive(Debug, Clone)]
pub struct ConfirmedDepth {
    /// 1/scene unit, `[h, w]`; −1 where it is not confirmed.
    pub disparity: Array2<f32>,
    /// Disparity that moves a point by one pixel ([`PhotoDepth::disparity_per_pixel`]).
    pub disparity_per_pixel: f32,
}

impl ConfirmedDepth {
    /// The confirmed pixels (`[h, w]`) of a depth map.
    pub fn new(depth: &PhotoDepth, confirmed: &Array2<bool>) -> Self {
        let keep = |&disparity: &f32, &confirmed: &bool| if confirmed { disparity } else { -1.0 };
        let disparity = ndarray::Zip::from(&depth.disparity).and(confirmed).map_collect(keep);
        Self { disparity, disparity_per_pixel: depth.disparity_per_pixel }
    }

    /// Share of the pixels that are confirmed, 0 to 1.
    pub fn share(&self) -> f64 {
        let confirmed = self.disparity.iter().filter(|&&disparity| disparity >= 0.0).count();
        confirmed as f64 / self.disparity.len().max(1) as f64
    }
}
