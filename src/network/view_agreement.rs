//! Logits from how well the views agree on a pixel's colour: no network is needed.

use ndarray::{ArrayView2, ArrayView4, ArrayViewMut2, ArrayViewMut4, Axis};
use rayon::prelude::*;

use super::alpha::Alpha;
use super::error::NetworkError;
use super::plane_network::PlaneNetwork;
#[cfg(feature = "surface")]
use crate::layers::LayerSpec;

/// Sum over the channels of the squared difference of two colours whose agreement is 1/2: 0.08 in
/// each channel.
const HALF_AGREEMENT: f32 = (3.0 * 0.08 * 0.08_f64) as f32;

/// Logit of full agreement.
const STRENGTH: f32 = 2.0;

/// Logits from how well the views agree on a pixel's colour; not in the paper.
///
/// A view that shows something else, because the surface is hidden from it, gets a lower weight;
/// where layers compete ([`super::Alpha::Competing`]), so does a layer that the views disagree on.
/// The agreement of a view is the mean, over the views that have a colour (itself included), of
/// 1 / (1 + (difference / 0.08)²), where the difference is the root mean square over the channels.
/// Logit 0 is twice the mean agreement of the views; logit v is twice the agreement of view v less
/// that of the first view. A view is black where it does not see the layer, and is left out there.
///
/// Along a surface it is the baseline that a network has to beat
/// (docs/design-log/surface-layers-limits.md).
#[derive(Debug, Clone, Copy)]
pub struct ViewAgreement {
    /// V.
    pub views: usize,
}

#[cfg(feature = "surface")]
impl ViewAgreement {
    /// The layers that it recommends: three along the surface, which soften its edges. Agreement
    /// says little about which of several distant layers is the right one.
    pub const LAYERS: LayerSpec = LayerSpec::Surface(3);
}

impl PlaneNetwork for ViewAgreement {
    fn views(&self) -> usize {
        self.views
    }

    fn infer(&mut self, hwv: ArrayView4<'_, f32>, mut logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
        for (hwv, mut logits) in hwv.outer_iter().zip(logits.outer_iter_mut()) {
            let rows: Vec<_> = hwv.axis_iter(Axis(1)).zip(logits.axis_iter_mut(Axis(1))).collect();
            rows.into_par_iter().for_each(|(hwv, logits)| row_logits(hwv, logits));
        }
        Ok(())
    }

    fn name(&self) -> String {
        "view agreement".to_owned()
    }

    #[cfg(feature = "surface")]
    fn recommended_layers(&self) -> Result<LayerSpec, NetworkError> {
        Ok(Self::LAYERS)
    }

    fn alpha(&self) -> Alpha {
        Alpha::Competing { scale: 1.0 }
    }

    fn predicts_opacity(&self) -> bool {
        false
    }
}

/// Logits `[V, w]` of a row `[3V, w]` of a layer.
fn row_logits(hwv: ArrayView2<'_, f32>, mut logits: ArrayViewMut2<'_, f32>) {
    let (views, width) = logits.dim();
    if logits.is_empty() {
        return;
    }
    let channels = |view: usize| -> [&[f32]; 3] {
        std::array::from_fn(|c| hwv.index_axis_move(Axis(0), 3 * view + c).to_slice().expect("standard layout"))
    };
    let (mut shown, mut agreement) = (vec![0.0_f32; width], vec![0.0_f32; views * width]);
    for (view, agreement) in agreement.chunks_exact_mut(width).enumerate() {
        let [r, g, b] = channels(view);
        for x in 0..width {
            shown[x] += has_colour([r[x], g[x], b[x]]);
        }
        for other in 0..views {
            let [or, og, ob] = channels(other);
            for x in 0..width {
                let (own, others) = ([r[x], g[x], b[x]], [or[x], og[x], ob[x]]);
                let squares: f32 = own.iter().zip(&others).map(|(a, b)| (a - b) * (a - b)).sum();
                let difference = squares / HALF_AGREEMENT;
                agreement[x] += has_colour(own) * has_colour(others) / (1.0 + difference);
            }
        }
    }
    for x in 0..width {
        let count = shown[x].max(1.0);
        let strength = STRENGTH / count;
        let sum: f32 = (0..views).map(|view| agreement[view * width + x]).sum();
        logits[[0, x]] = strength * sum / count;
        for view in 1..views {
            logits[[view, x]] = strength * (agreement[view * width + x] - agreement[x]);
        }
    }
}

/// 1, or 0 for black.
fn has_colour([r, g, b]: [f32; 3]) -> f32 {
    f32::from(u8::from(r + g + b > 0.0))
}

#[cfg(test)]
mod tests {
    use ndarray::{Array4, ArrayViewD};

    use super::*;

    /// Logits of one pixel, from the grey of each view.
    fn logits(greys: &[f32]) -> Vec<f32> {
        let hwv: Vec<f32> = greys.iter().flat_map(|&grey| [grey; 3]).collect();
        let hwv = ArrayViewD::from_shape(vec![1, hwv.len(), 1, 1], &hwv).unwrap();
        let mut logits = Array4::zeros((1, greys.len(), 1, 1));
        ViewAgreement { views: greys.len() }.infer(hwv.into_dimensionality().unwrap(), logits.view_mut()).unwrap();
        logits.into_raw_vec_and_offset().0
    }

    #[test]
    fn logits_of_agreeing_views_are_equal_and_of_a_differing_view_lower() {
        assert_eq!(logits(&[0.5; 4]), [STRENGTH, 0.0, 0.0, 0.0]);
        let found = logits(&[0.5, 0.5, 0.58, 0.5]);
        assert!((found[2] - STRENGTH * (2.5 - 3.5) / 4.0).abs() < 1e-5, "{found:?}");
        assert_eq!(found[1], 0.0);
        assert!((found[0] - STRENGTH * (3.0 * 3.5 + 2.5) / 16.0).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn black_views_are_left_out() {
        assert_eq!(logits(&[0.5, 0.0, 0.5])[..], [STRENGTH, -STRENGTH, 0.0]);
        assert_eq!(logits(&[0.0; 3]), [0.0; 3]);
        assert_eq!(logits(&[0.7]), [STRENGTH]);
    }
}
