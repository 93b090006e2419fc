//! Network output → α and colour of a layer (paper: "Rendering the MPI").
//!
//! α = sigmoid(logit 0). The view weights are softmax(0, logit 1 … logit V−1) · (d_min/d_i)^p: the
//! implicit zero is the logit of the nearest view, and d is the distance of a view to the target.
//! This is the paper's normalisation by distance, made independent of the unit of length; p is 1,
//! or 1.5 for corrected photos. The colour is normalised by coverage, so that a view that does
//! not cover a pixel does not darken it.
//!
//! All of it is computed in the log domain over the views that cover the pixel: neither extreme
//! logits nor extreme distances give 0/0.

use std::ops::Range;

use crate::simd::{exp, exp_f64};
use crate::warp::{RUN, RunCoverage};

/// Power of (d_min/d_i) for photos of the same exposure and sharpness: they differ mainly by the
/// error that depth makes in pixels, which grows with the distance. Gains 0.12 dB on surface layers
/// where views are weighted by distance alone (docs/design-log/surface-layers.md), 0.06 dB on planes
/// (docs/design-log/planes.md).
pub(super) const CORRECTED_DISTANCE_POWER: f64 = 1.5;

/// Factors of the view weights, from the distances of the views to the target.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceWeights {
    /// log of the factor.
    bias: Vec<f32>,
    /// 1 where d_i = 0, else 0: such a view has all the weight where it covers a pixel.
    coincident: Vec<f32>,
}

impl DistanceWeights {
    /// From the distance of each view's centre to the target's, scene units. A view at distance 0
    /// has all the weight where it covers a pixel; d_min is the least distance of the others, which
    /// are used elsewhere.
    pub fn new(distances: &[f64]) -> Self {
        Self::with_power(distances, 1.0)
    }

    /// As [`Self::new`], but the factors are (d_min/d_i)^power.
    pub fn with_power(distances: &[f64], power: f64) -> Self {
        let nearest = distances.iter().copied().filter(|&d| d > 0.0).fold(f64::INFINITY, f64::min);
        // The logarithm of the quotient: scaling a scene by a power of two does not change a bit.
        let bias = |&d: &f64| if d > 0.0 { (power * (nearest / d).max(f64::MIN_POSITIVE).ln()) as f32 } else { 0.0 };
        let coincident = |&d: &f64| f32::from(u8::from(d == 0.0));
        Self { bias: distances.iter().map(bias).collect(), coincident: distances.iter().map(coincident).collect() }
    }
}

/// One layer of a batch, views nearest first.
#[derive(Debug, Clone, Copy)]
pub struct LayerSamples<'a> {
    /// The network's output, `[V, pixels]`.
    pub logits: &'a [f32],
    /// The homography warped volume, `[3V, pixels]`: RGB in [0, 1], 0 outside the photos.
    pub colour: &'a [f32],
    /// Coverage of each sample, `[V, pixels]`, in [0, 1].
    pub coverage: &'a [f32],
}

/// α and colour of consecutive pixels of a layer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Blended {
    /// Opacity in [0, 1]; 0 where no view covers the pixel.
    pub alpha: Vec<f32>,
    /// Colour per channel, in [0, 1], not multiplied by α.
    pub rgb: [Vec<f32>; 3],
    /// Whether any view covers the pixel.
    pub covered: Vec<bool>,
}

impl Blended {
    /// Buffers for that many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { alpha: vec![0.0; pixels], rgb: std::array::from_fn(|_| vec![0.0; pixels]), covered: vec![false; pixels] }
    }
}

/// Pixels computed together: enough that the compiler keeps loops over them as loops, and
/// vectorises them.
const LANES: usize = 128;

impl LayerSamples<'_> {
    /// Blends as many pixels as `out` holds, beginning with pixel `from`.
    ///
    /// # Panics
    ///
    /// If the samples hold fewer pixels, or are not of as many views as there are weights.
    pub fn blend(&self, weights: &DistanceWeights, from: usize, out: &mut Blended) {
        blend_run(self, weights, from, &[], out);
    }

    /// Weights and products are f32. Sums and α are f64: in f32 their mean error would be that of
    /// torch's float32, or slightly above.
    #[inline(always)]
    fn blend_lanes(
        &self,
        distance_weights: &DistanceWeights,
        from: usize,
        run_coverage: &[&[RunCoverage]],
        out: &mut Blended,
        run: Range<usize>,
    ) {
        let at = from + run.start;
        let summary = |view: usize| {
            let row = run_coverage.get(view).map(|row| &row[run.start / RUN..run.end.div_ceil(RUN)]);
            row.filter(|row| row.iter().all(|run| *run == row[0])).map_or(RunCoverage::Partial, |row| row[0])
        };
        let views = distance_weights.bias.len();
        let pixels = self.coverage.len() / views;
        let mut spare = [[0.0; LANES]; 2];
        let [spare, other_spare] = &mut spare;
        let span = |plane: usize| plane * pixels + at..plane * pixels + at + run.len();
        let mut by_coincident = [0.0; LANES]; // 1 where a coincident view covers the pixel: only such views are used there
        for view in (0..views).filter(|&view| distance_weights.coincident[view] == 1.0) {
            let Some(coverage) = covered(summary(view), &self.coverage[span(view)], spare) else { continue };
            for i in 0..LANES {
                by_coincident[i] = if coverage[i] > 0.0 { 1.0 } else { by_coincident[i] };
            }
        }
        let mut best = [f32::NEG_INFINITY; LANES];
        for view in 0..views {
            let Some(coverage) = covered(summary(view), &self.coverage[span(view)], spare) else { continue };
            let logits = if view == 0 { &ZEROS } else { lanes(&self.logits[span(view)], other_spare) };
            let (bias, coincident) = (distance_weights.bias[view], distance_weights.coincident[view]);
            for i in 0..LANES {
                let counts = (coverage[i] > 0.0) & (coincident == by_coincident[i]);
                let score = if counts { finite(logits[i]) + bias } else { f32::NEG_INFINITY };
                best[i] = if score > best[i] { score } else { best[i] };
            }
        }
        let (mut rgb, mut total) = ([[0.0; LANES]; 3], [0.0; LANES]);
        let mut weights = [0.0; LANES];
        for view in 0..views {
            let Some(coverage) = covered(summary(view), &self.coverage[span(view)], spare) else { continue };
            let logits = if view == 0 { &ZEROS } else { lanes(&self.logits[span(view)], other_spare) };
            let (bias, coincident) = (distance_weights.bias[view], distance_weights.coincident[view]);
            for i in 0..LANES {
                let counts = (coverage[i] > 0.0) & (coincident == by_coincident[i]);
                let (score, lost) = two_sum(finite(logits[i]), bias);
                let weight = exp(score - best[i] + lost);
                weights[i] = if counts { weight } else { 0.0 };
            }
            add_products(&mut total, &weights, coverage);
            for (channel, sums) in rgb.iter_mut().enumerate() {
                add_products(sums, &weights, lanes(&self.colour[span(3 * view + channel)], spare));
            }
        }
        let (opacity, mut alpha) = (lanes(&self.logits[span(0)], spare), [0.0; LANES]);
        for i in 0..LANES {
            let covered = best[i] > f32::NEG_INFINITY;
            let logit = f64::from(opacity[i]);
            alpha[i] = if covered { (1.0 / (1.0 + exp_f64(-logit))) as f32 } else { 0.0 };
            total[i] = if covered { 1.0 / total[i] } else { 0.0 };
        }
        out.alpha[run.clone()].copy_from_slice(&alpha[..run.len()]);
        for (out, sums) in out.rgb.iter_mut().zip(&rgb) {
            for ((out, sum), per) in out[run.clone()].iter_mut().zip(sums).zip(&total) {
                *out = (sum * per) as f32;
            }
        }
        for (covered, best) in out.covered[run].iter_mut().zip(&best) {
            *covered = *best > f32::NEG_INFINITY;
        }
    }
}

#[inline(always)]
fn add_products(sums: &mut [f64; LANES], weights: &[f32; LANES], values: &[f32; LANES]) {
    for i in 0..LANES {
        sums[i] += f64::from(weights[i] * values[i]);
    }
}

/// The logits of the nearest view.
const ZEROS: [f32; LANES] = [0.0; LANES];

/// Full coverage.
const ONES: [f32; LANES] = [1.0; LANES];

/// Coverage of a run, read from memory only if its summary does not determine it; `None` if it is 0
/// throughout.
#[inline(always)]
fn covered<'a>(summary: RunCoverage, coverage: &'a [f32], spare: &'a mut [f32; LANES]) -> Option<&'a [f32; LANES]> {
    match summary {
        RunCoverage::None => None,
        RunCoverage::All => Some(&ONES),
        RunCoverage::Partial => Some(lanes(coverage, spare)),
    }
}

/// The values; if there are fewer than [`LANES`] of them, a copy in `spare` followed by zeros.
#[inline(always)]
fn lanes<'a>(values: &'a [f32], spare: &'a mut [f32; LANES]) -> &'a [f32; LANES] {
    if let Ok(values) = values.try_into() {
        return values;
    }
    *spare = ZEROS;
    spare[..values.len()].copy_from_slice(values);
    spare
}

/// As [`LayerSamples::blend`] for a row. `run_coverage` summarises its coverage: for each view,
/// one [`RunCoverage`] per run; or it is empty. Simple loops over lanes, compiled for the vector
/// instructions of this processor.
#[pulp::with_simd(blend_run = crate::simd::wide_arch())]
#[inline(always)]
pub(super) fn blend_run_with<'a, S: pulp::Simd>(
    _simd: S,
    samples: &'a LayerSamples<'a>,
    weights: &'a DistanceWeights,
    from: usize,
    run_coverage: &'a [&'a [RunCoverage]],
    out: &'a mut Blended,
) {
    for start in (0..out.alpha.len()).step_by(LANES) {
        let end = (start + LANES).min(out.alpha.len());
        samples.blend_lanes(weights, from, run_coverage, out, start..end);
    }
}

/// a + b in f32, and its rounding error (Knuth's two-sum): keeps small differences of large logits,
/// or of the logits of distant views.
#[inline(always)]
fn two_sum(a: f32, b: f32) -> (f32, f32) {
    let sum = a + b;
    let from_b = sum - a;
    (sum, (a - (sum - from_b)) + (b - from_b))
}

/// Replaces an infinite logit by the largest finite one of its sign, so that the difference of two
/// is not NaN.
#[inline(always)]
fn finite(logit: f32) -> f32 {
    let logit = if logit < f32::MAX { logit } else { f32::MAX };
    if logit > f32::MIN { logit } else { f32::MIN }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One pixel: α, colour and whether it is covered.
    fn blend(distances: &[f64], logits: &[f32], coverage: &[f32]) -> (f32, [f32; 3], bool) {
        let grey: Vec<f32> = coverage.iter().enumerate().flat_map(|(v, c)| [c * (v + 1) as f32 / 10.0; 3]).collect();
        let mut out = Blended::new(1);
        let samples = LayerSamples { logits, colour: &grey, coverage };
        samples.blend(&DistanceWeights::new(distances), 0, &mut out);
        (out.alpha[0], std::array::from_fn(|c| out.rgb[c][0]), out.covered[0])
    }

    #[test]
    fn equal_logits_are_weighted_by_inverse_distance() {
        let (alpha, rgb, _) = blend(&[1.0, 3.0], &[0.0, 0.0], &[1.0, 1.0]);
        assert_eq!(alpha, 0.5);
        assert!((rgb[0] - (0.75 * 0.1 + 0.25 * 0.2)).abs() < 1e-7, "{rgb:?}");
    }

    #[test]
    fn low_coverage_does_not_darken_the_colour() {
        let (_, rgb, _) = blend(&[1.0, 1.0], &[0.0, 0.0], &[1e-6, 0.0]);
        assert!((rgb[0] - 0.1).abs() < 1e-7, "{rgb:?}");
    }

    #[test]
    fn coincident_view_has_all_weight_where_it_covers_the_pixel() {
        assert_eq!(blend(&[0.0, 1.0], &[0.0, 50.0], &[1.0, 1.0]).1, [0.1; 3]);
        assert_eq!(blend(&[0.0, 1.0], &[0.0, 50.0], &[0.0, 1.0]).1, [0.2; 3]);
    }

    #[test]
    fn extreme_logits_and_distances_stay_finite() {
        assert_eq!(blend(&[1e-30, 1e30], &[-1e4, 1e4], &[1.0, 1.0]), (0.0, [0.2; 3], true));
        assert_eq!(blend(&[1e-30, 1.0], &[1e4, -1e4], &[0.0, 1.0]), (1.0, [0.2; 3], true));
        let infinity = f32::INFINITY;
        assert_eq!(blend(&[1.0; 3], &[-infinity, infinity, infinity], &[1.0; 3]).1, [0.25; 3]);
    }

    #[test]
    fn uncovered_pixel_is_transparent() {
        assert_eq!(blend(&[1.0, 2.0], &[9.0, 0.0], &[0.0, 0.0]), (0.0, [0.0; 3], false));
    }

    #[test]
    fn differences_of_logits_far_apart_from_0_are_kept() {
        // Steps of f32 are 1/16 there: the weights are those of the distances alone, 1/2 and 1/3.
        let (_, rgb, _) = blend(&[1.0, 2.0, 3.0], &[0.0, 1e6, 1e6], &[0.0, 1.0, 1.0]);
        assert!((rgb[0] - (0.2 / 2.0 + 0.3 / 3.0) / (1.0 / 2.0 + 1.0 / 3.0)).abs() < 1e-6, "{rgb:?}");
    }

    #[test]
    fn factors_are_powers_of_the_relative_distance() {
        let weights = DistanceWeights::with_power(&[0.0, 2.0, 4.0], 1.5);
        assert_eq!((&weights.bias[..2], &weights.coincident[..]), (&[0.0, 0.0][..], &[1.0, 0.0, 0.0][..]));
        assert!((weights.bias[2] - 1.5 * 0.5_f32.ln()).abs() < 1e-6, "{weights:?}");
        assert_eq!(DistanceWeights::new(&[2.0, 4.0]), DistanceWeights::with_power(&[2.0, 4.0], 1.0));
    }

    /// Three views over more pixels than are computed together, with summaries of their coverage and without.
    #[test]
    fn rows_equal_their_definition_whatever_is_known_of_their_coverage() {
        let (views, pixels, from, count) = (3, 700, 64, 330_usize);
        let noise = |at: usize| ((at as u32).wrapping_mul(2_654_435_761) >> 20) as f32 / 4096.0;
        let kind = |view: usize, pixel: usize| (pixel / RUN + 2 * view) % 4;
        let coverage: Vec<f32> = (0..views * pixels)
            .map(|at| match kind(at / pixels, at % pixels) {
                0 => 0.0,
                1 | 2 => 1.0,
                _ => (noise(at) - 0.3).max(0.0),
            })
            .collect();
        let logits: Vec<f32> = (0..views * pixels).map(|at| 8.0 * noise(at + 5) - 4.0).collect();
        let colour: Vec<f32> = (0..3 * views * pixels)
            .map(|at| noise(at + 9) * coverage[at / (3 * pixels) * pixels + at % pixels])
            .collect();
        let samples = LayerSamples { logits: &logits, colour: &colour, coverage: &coverage };
        for distances in [[1.0, 2.0, 3.0], [0.0, 1.0, 1.5]] {
            let weights = DistanceWeights::new(&distances);
            let known: Vec<Vec<RunCoverage>> = (0..views)
                .map(|view| {
                    (0..count.div_ceil(RUN))
                        .map(|run| {
                            [RunCoverage::None, RunCoverage::All, RunCoverage::Partial, RunCoverage::Partial]
                                [kind(view, from + run * RUN)]
                        })
                        .collect()
                })
                .collect();
            let known: Vec<&[RunCoverage]> = known.iter().map(Vec::as_slice).collect();
            let [mut plain, mut out] = [Blended::new(count), Blended::new(count)];
            samples.blend(&weights, from, &mut plain);
            blend_run(&samples, &weights, from, &known, &mut out);
            assert_eq!(plain, out);
            for i in 0..count {
                let at = |view: usize| view * pixels + from + i;
                let covers = |view: &usize| coverage[at(*view)] > 0.0;
                let coincident = (0..views).filter(covers).any(|view| distances[view] == 0.0);
                let weight = |view: usize| {
                    let logit = if view == 0 { 0.0 } else { f64::from(logits[at(view)]) };
                    let nearest = distances.iter().copied().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
                    let factor = if distances[view] == 0.0 { 1.0 } else { nearest / distances[view] };
                    if coincident == (distances[view] == 0.0) && covers(&view) { logit.exp() * factor } else { 0.0 }
                };
                let total: f64 = (0..views).map(|view| weight(view) * f64::from(coverage[at(view)])).sum();
                assert_eq!(out.covered[i], total > 0.0, "{i}");
                let alpha = if total > 0.0 { 1.0 / (1.0 + (-f64::from(logits[at(0)])).exp()) } else { 0.0 };
                assert!((f64::from(out.alpha[i]) - alpha).abs() < 1e-6, "{i}");
                for c in 0..3 {
                    let sum: f64 = (0..views)
                        .map(|view| weight(view) * f64::from(colour[(3 * view + c) * pixels + from + i]))
                        .sum();
                    let expected = if total > 0.0 { sum / total } else { 0.0 };
                    assert!(
                        (f64::from(out.rgb[c][i]) - expected).abs() < 1e-6,
                        "{i}: {}, not {expected}",
                        out.rgb[c][i]
                    );
                }
            }
        }
    }
}
