//! Network output → α and colour of a layer (paper: "Rendering the MPI").
//!
//! α = sigmoid(logit 0). The view weights are softmax(0, logit 1 … logit V−1), the implicit zero being the nearest view's,
//! times d_min/d_i (the paper's normalisation by distance, made free of units); the colour is normalised by coverage, so
//! that a view that does not see a pixel does not darken it. All in the log domain over the views that cover the pixel:
//! neither extreme logits nor extreme distances ever give 0/0.

use std::ops::Range;

/// What the distances of the views to the target do to their weights.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceWeights {
    /// log(d_min / d_i).
    bias: Vec<f32>,
    /// 1 where d_i = 0, else 0: such a view takes all the weight where it sees anything.
    coincident: Vec<f32>,
}

impl DistanceWeights {
    /// From the distance of each view's centre to the target's, scene units. Where one is 0, d_min is taken over the
    /// others, which serve the pixels that the coincident view does not see.
    pub fn new(distances: &[f64]) -> Self {
        let nearest = distances.iter().copied().filter(|&d| d > 0.0).fold(f64::INFINITY, f64::min);
        // The logarithm of the quotient: a scene in other units, times a power of two, has the same bits.
        let bias = |&d: &f64| if d > 0.0 { (nearest / d).max(f64::MIN_POSITIVE).ln() as f32 } else { 0.0 };
        let coincident = |&d: &f64| f32::from(u8::from(d == 0.0));
        Self { bias: distances.iter().map(bias).collect(), coincident: distances.iter().map(coincident).collect() }
    }
}

/// One layer of a batch: `logits` `[V, pixels]`, `colour` `[3V, pixels]`, `coverage` `[V, pixels]`.
#[derive(Debug, Clone, Copy)]
pub struct LayerSamples<'a> {
    /// What the network gave.
    pub logits: &'a [f32],
    /// The homography warped volume, 0 where nothing is seen.
    pub colour: &'a [f32],
    /// Coverage of each sample.
    pub coverage: &'a [f32],
}

/// A run of a layer's pixels: α and colour.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Blended {
    /// Opacity in [0, 1]; 0 where no view sees the pixel.
    pub alpha: Vec<f32>,
    /// Colour in [0, 1] per channel, straight (not multiplied by α).
    pub rgb: [Vec<f32>; 3],
    /// Whether any view sees the pixel.
    pub covered: Vec<bool>,
}

impl Blended {
    /// Room for `pixels`.
    pub fn new(pixels: usize) -> Self {
        Self { alpha: vec![0.0; pixels], rgb: std::array::from_fn(|_| vec![0.0; pixels]), covered: vec![false; pixels] }
    }
}

/// Pixels computed side by side: enough that loops over them stay loops, which vectorise (at 32 the sums were unrolled
/// into scalars).
const LANES: usize = 128;

impl DistanceWeights {
    /// Blend the pixels of a layer from pixel `from` on, as many as `out` has room for.
    pub fn blend(&self, samples: &LayerSamples<'_>, from: usize, out: &mut Blended) {
        blend_run(self, samples, from, out);
    }

    /// Weights and products in f32; sums and α in f64: in f32 their mean error is float32 torch's own, or a little above.
    #[inline(always)]
    fn blend_lanes(&self, samples: &LayerSamples<'_>, at: usize, out: &mut Blended, run: Range<usize>) {
        let views = self.bias.len();
        let pixels = samples.coverage.len() / views;
        let mut spare = [[0.0; LANES]; 2];
        let [spare, other_spare] = &mut spare;
        let span = |plane: usize| plane * pixels + at..plane * pixels + at + run.len();
        let mut on_top = [0.0; LANES]; // 1 where a coincident view sees the pixel: only such views count there
        for view in (0..views).filter(|&view| self.coincident[view] == 1.0) {
            let coverage = lanes(&samples.coverage[span(view)], spare);
            for i in 0..LANES {
                on_top[i] = if coverage[i] > 0.0 { 1.0 } else { on_top[i] };
            }
        }
        let mut best = [f32::NEG_INFINITY; LANES];
        for view in 0..views {
            let coverage = lanes(&samples.coverage[span(view)], spare);
            let logits = if view == 0 { &ZEROS } else { lanes(&samples.logits[span(view)], other_spare) };
            let (bias, coincident) = (self.bias[view], self.coincident[view]);
            for i in 0..LANES {
                let counts = (coverage[i] > 0.0) & (coincident == on_top[i]);
                let score = if counts { finite(logits[i]) + bias } else { f32::NEG_INFINITY };
                best[i] = if score > best[i] { score } else { best[i] };
            }
        }
        let (mut rgb, mut total) = ([[0.0; LANES]; 3], [0.0; LANES]);
        let mut weights = [0.0; LANES];
        for view in 0..views {
            let coverage = lanes(&samples.coverage[span(view)], spare);
            let logits = if view == 0 { &ZEROS } else { lanes(&samples.logits[span(view)], other_spare) };
            let (bias, coincident) = (self.bias[view], self.coincident[view]);
            for i in 0..LANES {
                let counts = (coverage[i] > 0.0) & (coincident == on_top[i]);
                let weight = exp(finite(logits[i]) - best[i] + bias);
                weights[i] = if counts { weight } else { 0.0 };
            }
            add_products(&mut total, &weights, coverage);
            for (channel, sums) in rgb.iter_mut().enumerate() {
                add_products(sums, &weights, lanes(&samples.colour[span(3 * view + channel)], spare));
            }
        }
        let (opacity, mut alpha) = (lanes(&samples.logits[span(0)], spare), [0.0; LANES]);
        for i in 0..LANES {
            let covered = best[i] > f32::NEG_INFINITY;
            alpha[i] = if covered { (1.0 / (1.0 + exp_f64(-f64::from(opacity[i])))) as f32 } else { 0.0 };
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

/// The nearest view's logits.
const ZEROS: [f32; LANES] = [0.0; LANES];

/// The values, or the last of them, fewer than [`LANES`], before zeros in `spare`: no view covers such a lane.
#[inline(always)]
fn lanes<'a>(values: &'a [f32], spare: &'a mut [f32; LANES]) -> &'a [f32; LANES] {
    if let Ok(values) = values.try_into() {
        return values;
    }
    *spare = ZEROS;
    spare[..values.len()].copy_from_slice(values);
    spare
}

/// Plain loops over lanes, compiled for the vector instructions that the machine has.
#[pulp::with_simd(blend_run = pulp::Arch::new())]
#[inline(always)]
fn blend_run_with<'a, S: pulp::Simd>(
    _simd: S,
    weights: &'a DistanceWeights,
    samples: &'a LayerSamples<'a>,
    from: usize,
    out: &'a mut Blended,
) {
    for start in (0..out.alpha.len()).step_by(LANES) {
        let end = (start + LANES).min(out.alpha.len());
        weights.blend_lanes(samples, from + start, out, start..end);
    }
}

/// An infinite logit as the largest of its sign, so that no two of them make a NaN.
#[inline(always)]
fn finite(logit: f32) -> f32 {
    let logit = if logit < f32::MAX { logit } else { f32::MAX };
    if logit > f32::MIN { logit } else { f32::MIN }
}

/// eˣ to 1e-7 of its value, saturating at x = ±87: 2ᵏ times a polynomial on [-ln 2 / 2, ln 2 / 2], without branches or calls.
#[inline(always)]
fn exp(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it leaves the nearest whole number in the low bits
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4]; // so few bits in the first that its products are exact
    let x = if x < 87.0 { x } else { 87.0 };
    let x = if x > -87.0 { x } else { -87.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let r = (x - (shifted - ROUND) * LN_2[0]) - (shifted - ROUND) * LN_2[1];
    let tail = 1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0)));
    let series = 1.0 + (r + r * r * (0.5 + r * (1.0 / 6.0 + r * tail)));
    series * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
}

/// eˣ to 3e-10 of its value, saturating: 2ᵏ times a polynomial on [-ln 2 / 2, ln 2 / 2], without branches or calls.
#[inline(always)]
fn exp_f64(x: f64) -> f64 {
    const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: adding it leaves the nearest whole number in the low bits
    let x = if x < 700.0 { x } else { 700.0 };
    let x = if x > -700.0 { x } else { -700.0 };
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let r = x - (shifted - ROUND) * std::f64::consts::LN_2;
    let tail = 1.0 / 720.0 + r * (1.0 / 5040.0 + r * (1.0 / 40320.0));
    let series = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * tail)))));
    series * f64::from_bits((shifted.to_bits() << 52).wrapping_add(1023 << 52))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One pixel: α, colour and whether it is covered.
    fn blend(distances: &[f64], logits: &[f32], coverage: &[f32]) -> (f32, [f32; 3], bool) {
        let grey: Vec<f32> = coverage.iter().enumerate().flat_map(|(v, c)| [c * (v + 1) as f32 / 10.0; 3]).collect();
        let mut out = Blended::new(1);
        DistanceWeights::new(distances).blend(&LayerSamples { logits, colour: &grey, coverage }, 0, &mut out);
        (out.alpha[0], std::array::from_fn(|c| out.rgb[c][0]), out.covered[0])
    }

    #[test]
    fn equal_logits_weigh_by_inverse_distance() {
        let (alpha, rgb, _) = blend(&[1.0, 3.0], &[0.0, 0.0], &[1.0, 1.0]);
        assert_eq!(alpha, 0.5);
        assert!((rgb[0] - (0.75 * 0.1 + 0.25 * 0.2)).abs() < 1e-7, "{rgb:?}");
    }

    #[test]
    fn a_view_that_sees_little_does_not_darken() {
        let (_, rgb, _) = blend(&[1.0, 1.0], &[0.0, 0.0], &[1e-6, 0.0]);
        assert!((rgb[0] - 0.1).abs() < 1e-7, "{rgb:?}");
    }

    #[test]
    fn a_coincident_view_takes_all_and_the_others_serve_what_it_does_not_see() {
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
    fn a_pixel_that_no_view_covers_is_transparent() {
        assert_eq!(blend(&[1.0, 2.0], &[9.0, 0.0], &[0.0, 0.0]), (0.0, [0.0; 3], false));
    }

    #[test]
    fn the_exponentials_are_the_librarys() {
        for x in (-7000..=7000).map(|i| f64::from(i) / 10.0) {
            assert!((exp_f64(x) / x.exp() - 1.0).abs() < 4e-10, "exp({x}) is {}, not {}", exp_f64(x), x.exp());
        }
        for x in (-8700..=8700).map(|i| i as f32 / 100.0) {
            let (found, expected) = (exp(x), f64::from(x).exp());
            assert!((f64::from(found) / expected - 1.0).abs() < 1.2e-7, "exp({x}) is {found}, not {expected}");
        }
        assert_eq!((exp_f64(0.0), exp_f64(-1e300)), (1.0, exp_f64(-700.0)));
        assert_eq!((exp(0.0), exp(-1e30), exp(f32::NEG_INFINITY)), (1.0, exp(-87.0), exp(-87.0)));
    }
}
