//! Competing layers: the weights of a pixel are the softmax of scale · logit 0 over the layers that
//! cover it ([`Alpha::Competing`]).
//!
//! One pass over the layers in any order and in constant memory, as in online softmax (Milakov and
//! Gimelshein, 2018): it keeps the largest logit so far, and sums of terms e^(scale · (logit −
//! largest)) that are rescaled when a larger one follows. Sums are f64: their mean error is 1.1e-8,
//! the rounding to f32, for 16 to 4,096 layers; that of f32 sums grows from 4e-8 to 4e-7, that of
//! compensated sums is 2.2e-8.
//!
//! [`Alpha::Competing`]: crate::network::Alpha::Competing

use super::blend::Blended;
use super::composite::{Accumulated, CompositeRow};
use crate::simd::exp_f64;
use crate::warp::clamp;

/// Sums over the layers so far, for one row of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct Competing {
    scale: f64,
    /// Largest logit of a layer that covers the pixel, −∞ before the first.
    top: Vec<f32>,
    /// Σ e^(scale · (logit − top)).
    total: Vec<f64>,
    /// Σ e^(scale · (logit − top)) times colour, and times disparity.
    sums: Accumulated,
}

impl Competing {
    /// An empty composite for a row of that many pixels; logits are multiplied by `scale`, positive
    /// and finite.
    pub fn new(pixels: usize, scale: f64) -> Self {
        let (top, total) = (vec![f32::NEG_INFINITY; pixels], vec![0.0; pixels]);
        Self { scale, top, total, sums: Accumulated::new(pixels) }
    }

    /// Adds layer `index` at `disparity` (1/scene unit). `logits` are the network's logits 0, at
    /// least one per pixel. An infinite logit is replaced by the largest finite one of its sign,
    /// and NaN by the least finite one: such a layer is visible only where there is no other, as if
    /// its α were 0.
    pub fn add(&mut self, index: u32, logits: &[f32], layer: &Blended, disparity: &[f32]) {
        add_row(self, index, logits, layer, disparity);
    }

    /// The weight of a layer among all that were added, for each pixel; `logits` and `covered` are
    /// those that it was added with.
    pub fn weights<'a>(&'a self, logits: &'a [f32], covered: &'a [bool]) -> impl Iterator<Item = f64> + 'a {
        let sums = self.top.iter().zip(&self.total);
        sums.zip(logits.iter().zip(covered)).map(|((&top, total), (&logit, &covered))| {
            let below = f64::from(clamp(logit, f32::MIN, f32::MAX)) - f64::from(top);
            if covered { exp_f64(below * self.scale) / total } else { 0.0 }
        })
    }

    /// The weighted means of colour and disparity, and the layer of the largest weight (ties: the
    /// nearer) with its weight; T is 0 where any layer covers the pixel, else 1.
    pub fn finish(self) -> Accumulated {
        let Self { top, total, sums: mut row, .. } = self;
        for ((((&total, top), best), left), disparity) in
            total.iter().zip(&top).zip(&mut row.best_alpha).zip(&mut row.transmittance).zip(&mut row.disparity)
        {
            if *top > f32::NEG_INFINITY {
                (*best, *left) = ((1.0 / total) as f32, 0.0);
                *disparity /= total;
            }
        }
        for sums in &mut row.rgb {
            let covered = sums.iter_mut().zip(&total).filter(|(_, total)| **total > 0.0);
            covered.for_each(|(sum, total)| *sum /= total);
        }
        row
    }
}

/// Simple loops over the pixels, compiled for the vector instructions of this processor.
#[pulp::with_simd(add_row = crate::simd::arch())]
#[inline(always)]
fn add_row_with<'a, S: pulp::Simd>(
    _simd: S,
    row: &'a mut Competing,
    index: u32,
    logits: &'a [f32],
    layer: &'a Blended,
    disparity: &'a [f32],
) {
    let pixels = row.top.len();
    let (mut kept, mut terms) = (vec![0.0; pixels], vec![0.0; pixels]);
    let state = row.top.iter_mut().zip(&mut row.total).zip(&mut row.sums.best_layer);
    let inputs = logits.iter().zip(&layer.covered);
    for (((top, total), best), ((&logit, &covered), (kept, term))) in
        state.zip(inputs.zip(kept.iter_mut().zip(&mut terms)))
    {
        let logit = clamp(logit, f32::MIN, f32::MAX);
        let above = f64::from(logit) - f64::from(*top);
        // One exponential is enough: the larger of the two terms is 1.
        let less = exp_f64(-above.abs() * row.scale);
        let leads = above > 0.0;
        (*kept, *term) = if leads { (less, 1.0) } else { (1.0, less) };
        (*kept, *term) = if covered { (*kept, *term) } else { (1.0, 0.0) };
        *total = *total * *kept + *term;
        *best = if covered & (leads | ((above == 0.0) & (index < *best))) { index } else { *best };
        *top = if covered & leads { logit } else { *top };
    }
    let [red, green, blue] = &mut row.sums.rgb;
    let channels = [red, green, blue, &mut row.sums.disparity].into_iter();
    for (sums, values) in channels.zip([&layer.rgb[0], &layer.rgb[1], &layer.rgb[2], disparity]) {
        let weights = kept.iter().zip(&terms).zip(values);
        sums.iter_mut()
            .zip(weights)
            .for_each(|(sum, ((kept, term), &value))| *sum = *sum * kept + term * f64::from(value));
    }
}

impl CompositeRow for Competing {
    fn add_layer(&mut self, index: u32, _last: bool, logits: &[f32], blended: &Blended, disparity: &[f32]) {
        self.add(index, logits, blended, disparity);
    }

    fn finish(self) -> Accumulated {
        Self::finish(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One pixel: layers of (logit, grey, covered), the nearest at disparity 1, the others each
    /// half as far from 0.
    fn composite(scale: f64, layers: &[(f32, f32, bool)]) -> Accumulated {
        let mut row = Competing::new(1, scale);
        for (index, &(logit, grey, covered)) in layers.iter().enumerate() {
            let layer = Blended { alpha: vec![0.0], rgb: std::array::from_fn(|_| vec![grey]), covered: vec![covered] };
            row.add(index as u32, &[logit], &layer, &[0.5_f32.powi(index as i32)]);
        }
        row.finish()
    }

    #[test]
    fn softmax_equals_the_hand_calculation() {
        let row = composite(2.0, &[(0.0, 0.25, true), (9.0, 1.0, false), (0.5 * 3_f32.ln(), 0.75, true)]);
        // Weights 1/4 and 3/4; the layer between covers nothing.
        assert!((row.rgb[1][0] - 0.625).abs() < 1e-7, "{row:?}");
        assert!((row.disparity[0] - (0.25 + 0.75 * 0.25)).abs() < 1e-7, "{row:?}");
        assert!((row.best_alpha[0] - 0.75).abs() < 1e-7, "{row:?}");
        assert_eq!((row.best_layer[0], row.transmittance[0]), (2, 0.0));
    }

    #[test]
    fn weights_of_layers_are_those_of_the_composite() {
        let layers = [(f32::NAN, true), (9.0, false), (0.5 * 3_f32.ln(), true), (0.0, true)];
        let mut row = Competing::new(1, 2.0);
        for (index, (logit, covered)) in layers.into_iter().enumerate() {
            let layer = Blended { alpha: vec![0.0], rgb: std::array::from_fn(|_| vec![0.5]), covered: vec![covered] };
            row.add(index as u32, &[logit], &layer, &[0.5]);
        }
        for ((logit, covered), expected) in layers.into_iter().zip([0.0, 0.0, 0.75, 0.25]) {
            let found: Vec<f64> = row.weights(&[logit], &[covered]).collect();
            assert!((found[0] - expected).abs() < 1e-7, "{logit}: {found:?}");
        }
    }

    #[test]
    fn uncovered_pixel_stays_empty_and_a_single_layer_has_all_weight() {
        let empty = composite(1.0, &[(5.0, 0.0, false), (f32::NAN, 0.0, false)]);
        assert_eq!(empty, Accumulated::new(1));
        for logit in [-1e38, 0.0, f32::INFINITY, f32::NAN] {
            let row = composite(2.0, &[(3.0, 0.5, false), (logit, 0.3, true)]);
            assert_eq!(
                (row.rgb[0][0], row.best_layer[0], row.transmittance[0]),
                (f64::from(0.3_f32), 1, 0.0),
                "{logit}"
            );
        }
    }

    #[test]
    fn extreme_equal_and_nan_logits_are_composited() {
        let first = |layers: &[(f32, f32, bool)]| composite(4.0, layers).rgb[0][0] as f32;
        let of = |logits: [f32; 3]| first(&[(logits[0], 1.0, true), (logits[1], 0.0, true), (logits[2], 0.0, true)]);
        let infinity = f32::INFINITY;
        assert_eq!([of([3e38, -3e38, 0.0]), of([-3e38, 0.0, 3e38])], [1.0, 0.0]);
        assert_eq!([of([infinity, infinity, -infinity]), of([-3e38; 3])], [0.5, 1.0 / 3.0]);
        assert_eq!([of([f32::NAN, 0.0, 0.0]), of([0.0, f32::NAN, -infinity])], [0.0, 1.0]);
        let tied = composite(1.0, &[(1.0, 0.0, true), (2.0, 0.0, true), (2.0, 0.0, true)]);
        assert_eq!(tied.best_layer, [1]);
    }

    #[test]
    fn sums_of_many_layers_are_as_precise_as_the_exponential() {
        let (layers, logit) = (4096, -1.1_f32);
        let behind = (1..layers).map(|_| (logit, 0.0, true));
        let row = composite(1.0, &std::iter::once((0.0, 1.0, true)).chain(behind).collect::<Vec<_>>());
        let expected = 1.0 / (1.0 + f64::from(layers - 1) * f64::from(logit).exp());
        assert!((row.rgb[0][0] / expected - 1.0).abs() < 1e-9, "{} {expected}", row.rgb[0][0]);
    }
}
