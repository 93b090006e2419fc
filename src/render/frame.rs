//! A rendered frame.

use std::time::Duration;

use ndarray::{Array2, Axis, Zip};
use rayon::prelude::*;

use super::composite::Accumulated;
use crate::geometry::Camera;
use crate::image::{ImageRgb, inpaint_uncovered};
use crate::layers::plane_histogram;

/// A rendered target.
#[derive(Debug, Clone)]
pub struct Frame {
    pub(super) raw: ImageRgb,
    /// Disparity, 1/scene unit, `[height, width]`: Σ T α δ, of competing layers Σ w δ.
    pub disparity: Array2<f32>,
    /// T behind the last layer, `[height, width]`: 0 where any view covers the farthest layer; with
    /// competing layers, 0 where any view covers any layer.
    pub transmittance: Array2<f32>,
    /// Index of the layer with the largest α, `None` where all are 0; of competing layers, of the
    /// one with the largest weight, `None` where no view covers any; `[height, width]`.
    pub best_layer: Array2<Option<u32>>,
    /// How far the colour of each pixel is trusted, 0 to 1, `[height, width]`, where that is known: what is
    /// not is filled from around in [`Self::picture`].
    pub confidence: Option<Array2<f32>>,
    /// Layers that were skipped because no view covers them.
    pub uncovered_layers: usize,
    /// Pixels that some view covers, and that are occluded in every view on every layer by the photos'
    /// own depth; they are rendered as if no view were occluded there.
    pub occluded_pixels: usize,
    /// Logits of the network that are NaN or infinite: at most one in 10,000.
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
    /// Blending and compositing, up to the frame.
    pub composite: Duration,
}

impl Frame {
    /// From the rows of the target, all layers composited; counts and times are 0.
    pub(super) fn new(rows: &[Accumulated], target: &Camera) -> Self {
        let (shape, width) = ((target.height(), target.width()), target.width());
        let pixels = shape.0 * width;
        let (mut rgb, mut best_layer) = (vec![0.0; 3 * pixels], vec![None; pixels]);
        let [mut disparity, mut transmittance] = [(); 2].map(|()| vec![0.0; pixels]);
        let lines = rgb.par_chunks_mut(3 * width).zip(best_layer.par_chunks_mut(width));
        let lines = lines.zip(disparity.par_chunks_mut(width)).zip(transmittance.par_chunks_mut(width));
        rows.par_iter().zip(lines).for_each(|(row, (((rgb, best_layer), disparity), transmittance))| {
            let [red, green, blue] = &row.rgb;
            for (((to, &red), &green), &blue) in rgb.as_chunks_mut().0.iter_mut().zip(red).zip(green).zip(blue) {
                *to = [red as f32, green as f32, blue as f32];
            }
            for (to, values) in [(disparity, &row.disparity), (transmittance, &row.transmittance)] {
                to.iter_mut().zip(values).for_each(|(to, &value)| *to = value as f32);
            }
            for (to, &best) in best_layer.iter_mut().zip(&row.best_layer) {
                *to = (best != u32::MAX).then_some(best);
            }
        });
        let map = |values| Array2::from_shape_vec(shape, values).expect("one value per pixel");
        Self {
            raw: ImageRgb::new(width, shape.0, rgb).expect("three values per pixel"),
            disparity: map(disparity),
            transmittance: map(transmittance),
            best_layer: Array2::from_shape_vec(shape, best_layer).expect("one value per pixel"),
            confidence: None,
            uncovered_layers: 0,
            occluded_pixels: 0,
            logits_not_finite: 0,
            times: StageTimes::default(),
        }
    }

    /// The picture, sRGB in [0, 1], with pixels inpainted ([`inpaint_uncovered`]) as far as they are not covered,
    /// or not trusted ([`Self::confidence`]).
    pub fn picture(&self) -> ImageRgb {
        let Some(confidence) = &self.confidence else { return inpaint_uncovered(&self.raw, &self.transmittance) };
        let mut trusted = self.raw.as_array().to_owned();
        trusted.lanes_mut(Axis(2)).into_iter().zip(confidence).for_each(|(mut rgb, &share)| rgb *= share);
        let left = |&transmittance: &f32, &share: &f32| 1.0 - share * (1.0 - transmittance);
        let trusted = ImageRgb::new(self.raw.width(), self.raw.height(), trusted.into_raw_vec_and_offset().0);
        let left = Zip::from(&self.transmittance).and(confidence).map_collect(left);
        inpaint_uncovered(&trusted.expect("three values per pixel"), &left)
    }

    /// The picture as it was composited: black where no view covers any layer.
    pub fn raw(&self) -> &ImageRgb {
        &self.raw
    }

    /// Depth along the optical axis, scene units, `[height, width]`: 1 / [`Self::disparity`], infinite where
    /// that is 0.
    pub fn depth(&self) -> Array2<f32> {
        self.disparity.mapv(f32::recip)
    }

    /// The share of the picture that no view covers: the mean transmittance, in [0, 1].
    pub fn uncovered_share(&self) -> f64 {
        let sum: f64 = self.transmittance.iter().map(|&t| f64::from(t)).sum();
        sum / self.transmittance.len().max(1) as f64
    }

    /// For each of the `planes` planes that the frame was rendered on, the number of pixels of
    /// which it is the best layer (paper, section "Plane selection").
    pub fn plane_histogram(&self, planes: usize) -> Vec<u64> {
        plane_histogram(self.best_layer.iter().map(|best| best.map(|plane| plane as usize)), planes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_that_is_not_trusted_is_filled_from_around() {
        let intrinsics = crate::geometry::Intrinsics { fx: 1.0, fy: 1.0, cx: 1.5, cy: 0.5, skew: 0.0 };
        let target = Camera::new(intrinsics, 3, 1, glam::DMat3::IDENTITY, glam::DVec3::ZERO).unwrap();
        let rgb = [(); 3].map(|()| vec![0.25, 1.0, 0.5]);
        let row = Accumulated { rgb, transmittance: vec![0.0; 3], ..Accumulated::new(3) };
        let mut frame = Frame::new(&[row], &target);
        assert_eq!(frame.picture().data(), frame.raw().data());
        frame.confidence = Some(ndarray::arr2(&[[1.0, 0.0, 1.0]]));
        let [left, filled, right] = [0, 1, 2].map(|x| frame.picture().pixel(x, 0)[0]);
        assert!((left, right) == (0.25, 0.5) && (0.26..0.49).contains(&filled), "{left} {filled} {right}");
    }
}
