//! Network output → α and colour of a layer (paper: "Rendering the MPI").
//!
//! α = sigmoid(logit 0). The view weights are softmax(0, logit 1 … logit V−1), the implicit zero being the nearest view's,
//! times d_min/d_i (the paper's normalisation by distance, made free of units); the colour is normalised by coverage, so
//! that a view that does not see a pixel does not darken it. All in the log domain over the views that cover the pixel:
//! neither extreme logits nor extreme distances ever give 0/0.

/// What the distances of the views to the target do to their weights.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceWeights {
    /// log(d_min / d_i).
    bias: Vec<f32>,
    /// d_i = 0: such a view takes all the weight where it sees anything.
    coincident: Vec<bool>,
    any_coincident: bool,
}

impl DistanceWeights {
    /// From the distance of each view's centre to the target's, scene units. Where one is 0, d_min is taken over the
    /// others, which serve the pixels that the coincident view does not see.
    pub fn new(distances: &[f64]) -> Self {
        let nearest = distances.iter().copied().filter(|&d| d > 0.0).fold(f64::INFINITY, f64::min);
        let bias = |&d: &f64| if d > 0.0 { (nearest.ln() - d.ln()) as f32 } else { 0.0 };
        let coincident: Vec<bool> = distances.iter().map(|&d| d == 0.0).collect();
        let any_coincident = coincident.contains(&true);
        Self { bias: distances.iter().map(bias).collect(), coincident, any_coincident }
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

/// A layer's pixel: α and colour; `covered` if any view sees it, else α = 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Blended {
    /// Opacity in [0, 1].
    pub alpha: f32,
    /// Colour in [0, 1], straight (not multiplied by α).
    pub rgb: [f32; 3],
    /// Whether any view sees the pixel.
    pub covered: bool,
}

impl DistanceWeights {
    /// Blend pixel `at` of a layer.
    #[inline]
    pub fn blend(&self, samples: &LayerSamples<'_>, at: usize) -> Blended {
        let views = self.bias.len();
        let pixels = samples.coverage.len() / views;
        let coverage = |view: usize| samples.coverage[view * pixels + at];
        let on_top = self.any_coincident && (0..views).any(|v| self.coincident[v] && coverage(v) > 0.0);
        let eligible = |&v: &usize| coverage(v) > 0.0 && (!self.any_coincident || self.coincident[v] == on_top);
        let score = |v: usize| self.bias[v] + if v == 0 { 0.0 } else { samples.logits[v * pixels + at] };
        let top = (0..views).filter(eligible).map(score).fold(f32::NEG_INFINITY, f32::max);
        if top == f32::NEG_INFINITY {
            return Blended::default();
        }
        let (mut rgb, mut total) = ([0.0; 3], 0.0);
        for view in (0..views).filter(eligible) {
            let behind = score(view) - top;
            let weight = if behind == 0.0 { 1.0 } else { f64::from(behind.exp()) };
            total += weight * f64::from(coverage(view));
            for (c, sum) in rgb.iter_mut().enumerate() {
                *sum += weight * f64::from(samples.colour[(3 * view + c) * pixels + at]);
            }
        }
        Blended { alpha: sigmoid(samples.logits[at]), rgb: rgb.map(|sum| (sum / total) as f32), covered: true }
    }
}

/// 1 / (1 + e⁻ˣ); saturates, never overflows to NaN. Only e⁻ˣ is f32: a mean error below float32 torch's takes that.
fn sigmoid(x: f32) -> f32 {
    (1.0 / (1.0 + f64::from((-x).exp()))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blend(distances: &[f64], logits: &[f32], coverage: &[f32]) -> Blended {
        let grey: Vec<f32> = coverage.iter().enumerate().flat_map(|(v, c)| [c * (v + 1) as f32 / 10.0; 3]).collect();
        DistanceWeights::new(distances).blend(&LayerSamples { logits, colour: &grey, coverage }, 0)
    }

    #[test]
    fn equal_logits_weigh_by_inverse_distance() {
        let out = blend(&[1.0, 3.0], &[0.0, 0.0], &[1.0, 1.0]);
        assert_eq!(out.alpha, 0.5);
        assert!((out.rgb[0] - (0.75 * 0.1 + 0.25 * 0.2)).abs() < 1e-7, "{out:?}");
    }

    #[test]
    fn a_view_that_sees_little_does_not_darken() {
        let out = blend(&[1.0, 1.0], &[0.0, 0.0], &[1e-6, 0.0]);
        assert!((out.rgb[0] - 0.1).abs() < 1e-7, "{out:?}");
    }

    #[test]
    fn a_coincident_view_takes_all_and_the_others_serve_what_it_does_not_see() {
        assert_eq!(blend(&[0.0, 1.0], &[0.0, 50.0], &[1.0, 1.0]).rgb, [0.1; 3]);
        assert_eq!(blend(&[0.0, 1.0], &[0.0, 50.0], &[0.0, 1.0]).rgb, [0.2; 3]);
    }

    #[test]
    fn extreme_logits_and_distances_stay_finite() {
        let out = blend(&[1e-30, 1e30], &[-1e4, 1e4], &[1.0, 1.0]);
        assert_eq!((out.alpha, out.rgb), (0.0, [0.2; 3]));
        let out = blend(&[1e-30, 1.0], &[1e4, -1e4], &[0.0, 1.0]);
        assert_eq!((out.alpha, out.rgb), (1.0, [0.2; 3]));
    }

    #[test]
    fn a_pixel_that_no_view_covers_is_transparent() {
        assert_eq!(blend(&[1.0, 2.0], &[9.0, 0.0], &[0.0, 0.0]), Blended::default());
    }
}
