//! The depth of a photo where other photos confirm it.

use ndarray::Array2;

use crate::surface::search::PhotoDepth;

/// Disparities of a photo that other photos confirm.
#[derive(Debug, Clone)]
pub struct ConfirmedDepth {
    /// 1/scene unit, `[h, w]`; −1 where nothing confirms it.
    pub disparity: Array2<f32>,
    /// Disparity that is worth one pixel of parallax ([`PhotoDepth::pixel`]).
    pub pixel: f32,
}

impl ConfirmedDepth {
    /// Of what a search found, what is confirmed.
    pub fn new(found: &PhotoDepth, confirmed: &Array2<bool>) -> Self {
        let keep = |&disparity: &f32, &confirmed: &bool| if confirmed { disparity } else { -1.0 };
        let disparity = ndarray::Zip::from(&found.disparity).and(confirmed).map_collect(keep);
        Self { disparity, pixel: found.pixel }
    }
}
