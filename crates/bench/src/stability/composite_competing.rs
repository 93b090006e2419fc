//! Extreme cases of competing layers: huge logits, ties, thousands of planes, pixels that no layer or a single one covers; expected
//! outputs in float64.

use anyhow::Result;
use liveview::render::{Blended, Competing};
use ndarray::{Array1, Array2, Array3};

use super::case::{Case, Expected, Outputs, Seeded, StageTest, decades};
use super::composite::{BOUND, PIXELS};
use crate::npz::Arrays;

/// L layers: logits 0, disparity and whether any view covers the pixel `[L, pixels]`, colour `[L, 3, pixels]`.
struct CompetingCase {
    logits: Vec<f32>,
    covered: Vec<bool>,
    rgb: Vec<f32>,
    disparity: Vec<f32>,
    scale: f64,
}

impl CompetingCase {
    /// Layers with these logits and coverage, by layer and pixel.
    fn new(
        layers: usize,
        scale: f64,
        logit: impl Fn(usize, usize) -> f32,
        covered: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let at = |i: usize| (i / PIXELS, i % PIXELS);
        let numbers = || 0..layers * PIXELS;
        Self {
            logits: numbers().map(|i| logit(at(i).0, at(i).1)).collect(),
            covered: numbers().map(|i| covered(at(i).0, at(i).1)).collect(),
            rgb: Seeded(13).units(3 * layers * PIXELS),
            disparity: numbers().map(|i| 1.0 / (1.0 + at(i).0 as f32)).collect(),
            scale,
        }
    }

    /// Random logits in ±`by`, and a fifth of the layers not covered.
    fn random(layers: usize, scale: f64, by: f64) -> Self {
        let [units, seen] = [3, 4].map(|seed| Seeded(seed).units(layers * PIXELS));
        let logit = |layer, pixel| (by * (2.0 * f64::from(units[layer * PIXELS + pixel]) - 1.0)) as f32;
        Self::new(layers, scale, logit, |layer, pixel| seen[layer * PIXELS + pixel] > 0.2)
    }

    fn layers(&self) -> usize {
        self.logits.len() / PIXELS
    }

    fn composite(&self, by: f32) -> Outputs<f32> {
        let mut row = Competing::new(PIXELS, self.scale / f64::from(by));
        for layer in 0..self.layers() {
            let span = layer * PIXELS..(layer + 1) * PIXELS;
            let rgb =
                |channel: usize| self.rgb[(3 * layer + channel) * PIXELS..(3 * layer + channel + 1) * PIXELS].to_vec();
            let blended = Blended {
                rgb: std::array::from_fn(rgb),
                covered: self.covered[span.clone()].to_vec(),
                ..Blended::new(PIXELS)
            };
            let logits: Vec<f32> = self.logits[span.clone()].iter().map(|logit| by * logit).collect();
            row.add(layer as u32, &logits, &blended, &self.disparity[span]);
        }
        let row = row.finish();
        let rounded = |values: &[f64]| values.iter().map(|&value| value as f32).collect();
        let frame = row.rgb.iter().flatten().map(|&value| value as f32).collect();
        vec![("frame", frame), ("disparity", rounded(&row.disparity)), ("transmittance", rounded(&row.transmittance))]
    }
}

/// The finite logit that the library uses in place of a logit.
fn finite(logit: f32) -> f64 {
    f64::from(if logit.is_nan() { f32::MIN } else { logit.clamp(f32::MIN, f32::MAX) })
}

impl StageTest for CompetingCase {
    fn stage(&self) -> &'static str {
        "composite_competing"
    }

    fn computed(&self) -> Result<Outputs<f32>, String> {
        Ok(self.composite(1.0))
    }

    /// Logits twice as large at half the scale, if that does not overflow.
    fn equivalent(&self) -> Option<Result<Outputs<f32>, String>> {
        let small = self.logits.iter().all(|logit| logit.abs() < f32::MAX / 2.0);
        small.then(|| Ok(self.composite(2.0)))
    }

    fn expected(&self) -> Option<Expected> {
        let (mut frame, mut disparity) = (vec![0.0; 3 * PIXELS], vec![0.0; PIXELS]);
        let mut transmittance = vec![1.0; PIXELS];
        for pixel in 0..PIXELS {
            let covered = || (0..self.layers()).map(|layer| layer * PIXELS + pixel).filter(|&i| self.covered[i]);
            let top = covered().map(|i| finite(self.logits[i])).fold(f64::NEG_INFINITY, f64::max);
            let weight = |i: usize| ((finite(self.logits[i]) - top) * self.scale).exp();
            let total: f64 = covered().map(weight).sum();
            for i in covered() {
                let (layer, weight) = (i / PIXELS, weight(i) / total);
                let colour = |channel: usize| f64::from(self.rgb[(3 * layer + channel) * PIXELS + pixel]);
                (0..3).for_each(|channel| frame[channel * PIXELS + pixel] += weight * colour(channel));
                disparity[pixel] += weight * f64::from(self.disparity[i]);
                transmittance[pixel] = 0.0;
            }
        }
        let outputs = vec![("frame", frame), ("disparity", disparity), ("transmittance", transmittance)];
        Some(Expected { outputs, doubtful: vec![false; PIXELS], relative: false })
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        let layers = self.layers();
        let covered = self.covered.iter().map(|&covered| u8::from(covered)).collect();
        arrays.add("logits", Array2::from_shape_vec((layers, PIXELS), self.logits.clone())?)?;
        arrays.add("covered", Array2::from_shape_vec((layers, PIXELS), covered)?)?;
        arrays.add("maps", Array2::from_shape_vec((layers, PIXELS), self.disparity.clone())?)?;
        arrays.add("rgb", Array3::from_shape_vec((layers, 3, PIXELS), self.rgb.clone())?)?;
        arrays.add("alpha_scale", Array1::from_vec(vec![self.scale]))
    }
}

pub(super) fn families<'a>() -> Vec<Vec<Case<'a>>> {
    let case = |family: &'static str, extreme: f64, test| {
        let name = if (1.0..1e5).contains(&extreme) { extreme.to_string() } else { format!("{extreme:.0e}") };
        Case::new(family, extreme, name, test, BOUND)
    };
    let all = |_: usize, _: usize| true;
    let line = |layers: usize, step: f32| CompetingCase::new(layers, 1.0, move |layer, _| step * layer as f32, all);
    let special = [f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, f32::MAX, f32::MIN];
    let named = vec![
        ("no layer covers", CompetingCase::new(9, 1.0, |layer, _| layer as f32, |_, _| false)),
        ("one layer covers", CompetingCase::new(9, 1.0, |_, _| -1e38, |layer, pixel| layer == pixel % 9)),
        ("all alike", CompetingCase::new(64, 2.0, |_, _| 0.3, all)),
        ("ties of two", CompetingCase::new(64, 2.0, |layer, _| (layer / 2) as f32, all)),
        ("nearer to farther ever larger", line(2000, 0.25)),
        ("ever smaller", line(2000, -0.25)),
        ("±infinity, ±0, ±largest", CompetingCase::new(36, 1.0, |layer, pixel| special[(layer + pixel) % 6], all)),
        (
            "some not a number",
            CompetingCase::new(8, 1.0, |layer, pixel| if (layer + pixel) % 3 == 0 { f32::NAN } else { 0.5 }, all),
        ),
        ("none a number", CompetingCase::new(8, 1.0, |_, _| f32::NAN, all)),
    ];
    vec![
        decades((-6..=38).step_by(4))
            .map(|by| case("competing logits ±", by, CompetingCase::random(32, 2.0, by)))
            .collect(),
        decades(-4..=4).map(|scale| case("scale of competing", scale, CompetingCase::random(32, scale, 5.0))).collect(),
        (0..=12)
            .step_by(2)
            .map(|power| 1 << power)
            .map(|n| case("number of competing", f64::from(n), CompetingCase::random(n as usize, 1.0, 4.0)))
            .collect(),
        Case::listed("special competing", BOUND, named),
    ]
}
