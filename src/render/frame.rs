//! A rendered frame.

use std::time::Duration;

use ndarray::Array2;

use super::composite::Accumulated;
use super::culling::Culled;
use crate::geometry::Camera;
use crate::image::ImageRgb;
use crate::layers::plane_histogram;

/// A rendered target.
#[derive(Debug, Clone)]
pub struct Frame {
    /// RGB in [0, 1], sRGB; black where no view covers any layer.
    pub picture: ImageRgb,
    /// Σ T α δ per pixel, of competing layers Σ w δ, 1/scene unit, `[height, width]`.
    pub disparity: Array2<f32>,
    /// T behind the last layer, `[height, width]`: 0 where any view covers the farthest layer; of competing layers, any layer.
    pub transmittance: Array2<f32>,
    /// Index of the layer with the largest α in the network's output, `None` where all are 0; of competing layers, with the largest
    /// weight, `None` where no view covers any; `[height, width]`.
    pub best_layer: Array2<Option<u32>>,
    /// How many layers were left out.
    pub culled: Culled,
    /// Pixels that no view sees on any layer, by what is known of the photos' own depth: the least hidden views served.
    pub unseen: usize,
    /// Logits of the network that are NaN or infinite: a stray few, or there would be no frame.
    pub logits_not_finite: usize,
    /// Wall time per stage.
    pub times: StageTimes,
}

/// Wall time per stage of one render.
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTimes {
    /// Sampling the views.
    pub warp: Duration,
    /// Running the network.
    pub network: Duration,
    /// Blending and compositing.
    pub composite: Duration,
}

impl Frame {
    /// From the rows of the target, all layers composited.
    pub(super) fn new(gathered: &[Accumulated], target: &Camera, culled: Culled, times: StageTimes) -> Self {
        let shape = (target.height(), target.width());
        let map = |f: fn(&Accumulated) -> &Vec<f64>| {
            let values = gathered.iter().flat_map(|row| f(row).iter().map(|&value| value as f32)).collect();
            Array2::from_shape_vec(shape, values).expect("one value per pixel")
        };
        let pixel = |row: &Accumulated, x: usize| std::array::from_fn::<_, 3, _>(|c| row.rgb[c][x] as f32);
        let rgb = gathered.iter().flat_map(|row| (0..shape.1).flat_map(move |x| pixel(row, x))).collect();
        let best =
            gathered.iter().flat_map(|row| row.best_layer.iter().map(|&best| (best != u32::MAX).then_some(best)));
        Self {
            picture: ImageRgb::new(target.width(), target.height(), rgb).expect("three values per pixel"),
            disparity: map(|row| &row.disparity),
            transmittance: map(|row| &row.transmittance),
            best_layer: Array2::from_shape_vec(shape, best.collect()).expect("one value per pixel"),
            culled,
            unseen: 0,
            logits_not_finite: 0,
            times,
        }
    }

    /// How many pixels have each of `planes` planes, on which the frame was rendered, as their best layer (paper, section "Plane
    /// selection").
    pub(crate) fn plane_histogram(&self, planes: usize) -> Vec<u64> {
        plane_histogram(self.best_layer.iter().map(|best| best.map(|plane| plane as usize)), planes)
    }
}
