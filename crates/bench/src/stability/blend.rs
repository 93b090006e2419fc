//! Extreme cases of the blend: logits, distances and coverages over all decades of float32; expected outputs in float64.

use anyhow::Result;
use liveview::render::{Blended, DistanceWeights, LayerSamples};
use ndarray::{Array1, Array2};

use super::case::{Case, Expected, Outputs, Seeded, StageTest, decades};
use crate::npz::Arrays;

/// Pixels of each case: not a multiple of those that the blend computes together.
const PIXELS: usize = 301;

/// Error bound of values in [0, 1], from rounded weights, products and quotients.
const BOUND: f64 = 1e-6;

/// The step between denormal numbers: coverages and colours near it have no significant digits.
const DENORMAL_STEP: f64 = 1.4e-45;

/// One layer: logits and coverage `[V, pixels]`, colour `[3V, pixels]`.
struct BlendCase {
    distances: Vec<f64>,
    logits: Vec<f32>,
    colour: Vec<f32>,
    coverage: Vec<f32>,
}

impl BlendCase {
    /// All views cover all pixels, with ordinary logits.
    fn ordinary(distances: &[f64]) -> Self {
        let (mut seeded, views) = (Seeded(7), distances.len());
        let logits = seeded.units(views * PIXELS).into_iter().map(|unit| 8.0 * unit - 4.0).collect();
        let colour = seeded.units(3 * views * PIXELS);
        Self { distances: distances.to_vec(), logits, colour, coverage: vec![1.0; views * PIXELS] }
    }

    /// Sets a view's coverage of each pixel, and multiplies its colour by it.
    fn cover(mut self, view: usize, coverage: impl Fn(usize) -> f32) -> Self {
        for pixel in 0..PIXELS {
            self.coverage[view * PIXELS + pixel] = coverage(pixel);
            (0..3).for_each(|channel| self.colour[(3 * view + channel) * PIXELS + pixel] *= coverage(pixel));
        }
        self
    }

    fn views(&self) -> usize {
        self.distances.len()
    }

    /// α and colour of a pixel.
    fn pixel(&self, pixel: usize) -> (f64, [f64; 3]) {
        let at = |plane: usize| plane * PIXELS + pixel;
        let covering: Vec<usize> = (0..self.views()).filter(|&view| self.coverage[at(view)] > 0.0).collect();
        let coincident: Vec<usize> = covering.iter().copied().filter(|&view| self.distances[view] == 0.0).collect();
        let counted = if coincident.is_empty() { &covering } else { &coincident };
        // Infinite logits count as the largest finite one of their sign.
        let logit = |view: usize| f64::from(self.logits[at(view)].clamp(f32::MIN, f32::MAX));
        // Logits and logarithms of distances are kept separate: added to a large logit, the latter would be lost even in float64.
        let parts = |view: usize| {
            let distance = if coincident.is_empty() { self.distances[view].ln() } else { 0.0 };
            (if view == 0 { 0.0 } else { logit(view) }, distance)
        };
        let over = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0) - (a.1 - b.1);
        let best = counted.iter().map(|&view| parts(view)).reduce(|a, b| if over(b, a) > 0.0 { b } else { a });
        let (mut total, mut rgb) = (0.0, [0.0; 3]);
        for view in counted {
            let weight = best.map_or(0.0, |best| over(parts(*view), best).exp());
            total += weight * f64::from(self.coverage[at(*view)]);
            let colour = (0..3).map(|channel| f64::from(self.colour[at(3 * view + channel)]));
            rgb.iter_mut().zip(colour).for_each(|(sum, colour)| *sum += weight * colour);
        }
        if covering.is_empty() { (0.0, rgb) } else { (1.0 / (1.0 + (-logit(0)).exp()), rgb.map(|sum| sum / total)) }
    }
}

impl StageTest for BlendCase {
    fn stage(&self) -> &'static str {
        "blend"
    }

    fn computed(&self) -> Result<Outputs<f32>, String> {
        let mut out = Blended::new(PIXELS);
        let (logits, colour, coverage) = (&self.logits, &self.colour, &self.coverage);
        let samples = LayerSamples { logits, colour, coverage, logit_shift: 0.0 };
        DistanceWeights::new(&self.distances).blend(&samples, 0, &mut out);
        Ok(vec![("alpha", out.alpha), ("rgb", out.rgb.concat())])
    }

    fn expected(&self) -> Option<Expected> {
        let pixels: Vec<_> = (0..PIXELS).map(|pixel| self.pixel(pixel)).collect();
        let rgb = (0..3).flat_map(|channel| pixels.iter().map(move |(_, rgb)| rgb[channel])).collect();
        let outputs = vec![("alpha", pixels.iter().map(|(alpha, _)| *alpha).collect()), ("rgb", rgb)];
        Some(Expected { outputs, doubtful: vec![false; PIXELS], relative: false })
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        arrays.add("distances", Array1::from_vec(self.distances.clone()))?;
        for (name, values) in [("logits", &self.logits), ("colour", &self.colour), ("coverage", &self.coverage)] {
            arrays.add(name, Array2::from_shape_vec((values.len() / PIXELS, PIXELS), values.clone())?)?;
        }
        Ok(())
    }
}

fn case<'a>(family: &'static str, extreme: f64, name: String, test: BlendCase) -> Case<'a> {
    Case::new(family, extreme, name, test, BOUND)
}

/// All families, from the distances of an ordinary rig.
pub(super) fn families<'a>(distances: &[f64]) -> Vec<Vec<Case<'a>>> {
    // No distance is 0: that is a separate case.
    let farthest = distances.iter().fold(f64::MIN_POSITIVE, |far, &d| far.max(d));
    let distances: Vec<f64> = distances.iter().map(|d| d.max(1e-3 * farthest)).collect();
    let ordinary = || BlendCase::ordinary(&distances);
    let views = distances.len();
    let logits = |times: f64| {
        let mut blend = ordinary();
        // Half of the logits are near the same large number, to test differences of large logits.
        let large = (4.0 * times).min(f64::from(f32::MAX)) as f32;
        for (i, logit) in blend.logits.iter_mut().enumerate() {
            let offset = if i % 2 == 0 { large } else { 0.0 };
            *logit = if offset > 0.0 { *logit + offset } else { (f64::from(*logit) * times) as f32 };
        }
        blend
    };
    // Far views whose logits compensate for their distance.
    let far = |ratio: f64| {
        let mut blend = ordinary();
        blend.distances = (0..views).map(|view| distances[0] * ratio.powf(view as f64 / (views - 1) as f64)).collect();
        for view in 1..views {
            let compensation = (blend.distances[view] / blend.distances[0]).ln() as f32;
            blend.logits[view * PIXELS..(view + 1) * PIXELS].iter_mut().for_each(|logit| *logit += compensation);
        }
        blend
    };
    let near = |distance: f64| {
        let mut blend = ordinary();
        blend.distances[0] = distance;
        blend.cover(0, |pixel| if pixel % 3 == 0 { 0.0 } else { 1.0 })
    };
    let thin = |coverage: f64| {
        (0..views).fold(ordinary(), |blend, view| {
            blend.cover(view, |pixel| if pixel % (view + 2) == 0 { coverage as f32 } else { 0.0 })
        })
    };
    let infinite = |mut blend: BlendCase| {
        for (i, logit) in blend.logits.iter_mut().enumerate().filter(|(i, _)| i % 4 != 0) {
            *logit = if i % 4 == 1 { f32::INFINITY } else { f32::NEG_INFINITY };
        }
        blend
    };
    let zeros = || BlendCase { logits: vec![0.0; views * PIXELS], ..ordinary() };
    let mut two_coincide = ordinary();
    two_coincide.distances[..2].fill(0.0);
    let all_covered =
        |coverage: fn(usize) -> f32| (0..views).fold(ordinary(), |blend, view| blend.cover(view, coverage));
    let special = [
        ("all logits equal", zeros()),
        ("infinite logits", infinite(ordinary())),
        ("infinite logits, coincident view", infinite(near(0.0))),
        ("target on a view", near(0.0)),
        ("two views coincide with the target", two_coincide.cover(0, |pixel| f32::from(u8::from(pixel % 2 == 0)))),
        ("no view covers any pixel", all_covered(|_| 0.0)),
        ("one pixel is covered", all_covered(|pixel| f32::from(u8::from(pixel == 150)))),
    ];
    // Logarithms of ratios are stored as float32: the larger, the coarser.
    let of_ratio = |ratio: f64, case: Case<'a>| {
        let last_bit = ratio.ln().abs() * f64::from(f32::EPSILON) / 2.0;
        Case { bound: BOUND + last_bit, ..case }
    };
    vec![
        decades((-6..=4).chain([8, 16, 30, 38]))
            .map(|by| case("logits", by, format!("times {by:.0e}"), logits(by)))
            .collect(),
        decades((0..=30).step_by(3))
            .map(|by| of_ratio(by, case("ratio of distances", by, format!("{by:.0e}"), far(by))))
            .collect(),
        decades((-30..=0).step_by(3))
            .map(|by| of_ratio(by / distances[0], case("nearest view's distance", by, format!("{by:.0e}"), near(by))))
            .collect(),
        decades((-40..=0).step_by(4))
            .map(|by| Case {
                bound: BOUND + 4.0 * DENORMAL_STEP / by,
                ..case("coverage", by, format!("{by:.0e}"), thin(by))
            })
            .collect(),
        Case::listed("special blends", BOUND, special),
    ]
}
