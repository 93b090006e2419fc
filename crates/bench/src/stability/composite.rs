//! Extreme cases of the composite: stiff opacities and thousands of planes; expected outputs in float64.

use anyhow::Result;
use liveview::render::{Accumulated, Blended};
use ndarray::{Array1, Array2, Array3};

use super::case::{Case, Expected, Outputs, Seeded, StageTest, decades};
use crate::npz::Arrays;

/// Pixels of each case.
pub(super) const PIXELS: usize = 67;

/// Error bound: sums in float64, rounded to float32 once.
pub(super) const BOUND: f64 = 1.2e-7;

/// L layers: α and disparity `[L, pixels]`, colour `[L, 3, pixels]`.
struct CompositeCase {
    alpha: Vec<f32>,
    rgb: Vec<f32>,
    disparity: Vec<f32>,
    /// Whether the farthest layer is covered, so that its α counts as 1.
    background: bool,
    /// Composite this many layers and the rest separately, then combine the two.
    split: Option<usize>,
    /// Whether errors are relative to the largest value, which is small.
    relative: bool,
}

impl CompositeCase {
    /// Layers with these opacities (by layer and pixel), whose depths span a factor of `ratio`.
    fn new(layers: usize, ratio: f64, alpha: impl Fn(usize, usize) -> f32) -> Self {
        let at = |i: usize| (i / PIXELS, i % PIXELS);
        // Disparities evenly from 1 to 1 / ratio.
        let share = |layer: usize| layer as f64 / (layers.max(2) - 1) as f64;
        let disparity = |layer: usize| (1.0 + share(layer) * (1.0 / ratio - 1.0)) as f32;
        Self {
            alpha: (0..layers * PIXELS).map(|i| alpha(at(i).0, at(i).1)).collect(),
            rgb: Seeded(11).units(layers * 3 * PIXELS),
            disparity: (0..layers * PIXELS).map(|i| disparity(at(i).0)).collect(),
            background: true,
            split: None,
            relative: false,
        }
    }

    fn layers(&self) -> usize {
        self.alpha.len() / PIXELS
    }

    fn add(&self, row: &mut Accumulated, layer: usize) {
        let span = layer * PIXELS..(layer + 1) * PIXELS;
        let rgb =
            |channel: usize| self.rgb[(3 * layer + channel) * PIXELS..(3 * layer + channel + 1) * PIXELS].to_vec();
        let blended = Blended {
            alpha: self.alpha[span.clone()].to_vec(),
            rgb: std::array::from_fn(rgb),
            covered: vec![self.background; PIXELS],
        };
        row.add(layer as u32, &blended, &self.disparity[span], layer + 1 == self.layers());
    }
}

impl StageTest for CompositeCase {
    fn stage(&self) -> &'static str {
        "composite"
    }

    fn computed(&self) -> Result<Outputs<f32>, String> {
        let (mut front, mut behind) = (Accumulated::new(PIXELS), Accumulated::new(PIXELS));
        let split = self.split.unwrap_or(0);
        (0..split).for_each(|layer| self.add(&mut front, layer));
        (split..self.layers()).for_each(|layer| self.add(&mut behind, layer));
        let through = front.transmittance;
        let together = |front: &[f64], behind: &[f64]| -> Vec<f32> {
            let terms = front.iter().zip(behind).zip(&through);
            terms.map(|((front, behind), through)| (front + through * behind) as f32).collect()
        };
        let rgb = (0..3).flat_map(|c| together(&front.rgb[c], &behind.rgb[c])).collect();
        let disparity = together(&front.disparity, &behind.disparity);
        let transmittance = together(&[0.0; PIXELS], &behind.transmittance);
        Ok(vec![("frame", rgb), ("disparity", disparity), ("transmittance", transmittance)])
    }

    fn expected(&self) -> Option<Expected> {
        let mut frame = vec![0.0; 3 * PIXELS];
        let (mut disparity, mut transmittance) = (vec![0.0; PIXELS], vec![1.0; PIXELS]);
        for layer in 0..self.layers() {
            let opaque = self.background && layer + 1 == self.layers();
            for pixel in 0..PIXELS {
                let alpha = if opaque { 1.0 } else { f64::from(self.alpha[layer * PIXELS + pixel]) };
                let weight = transmittance[pixel] * alpha;
                let colour = |channel: usize| f64::from(self.rgb[(3 * layer + channel) * PIXELS + pixel]);
                (0..3).for_each(|channel| frame[channel * PIXELS + pixel] += weight * colour(channel));
                disparity[pixel] += weight * f64::from(self.disparity[layer * PIXELS + pixel]);
                transmittance[pixel] *= 1.0 - alpha;
            }
        }
        let outputs = vec![("frame", frame), ("disparity", disparity), ("transmittance", transmittance)];
        Some(Expected { outputs, doubtful: vec![false; PIXELS], relative: self.relative })
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        let layers = self.layers();
        arrays.add("alpha", Array2::from_shape_vec((layers, PIXELS), self.alpha.clone())?)?;
        arrays.add("maps", Array2::from_shape_vec((layers, PIXELS), self.disparity.clone())?)?;
        arrays.add("rgb", Array3::from_shape_vec((layers, 3, PIXELS), self.rgb.clone())?)?;
        arrays.add("background", Array1::from_vec(vec![u8::from(self.background)]))
    }
}

fn case<'a>(family: &'static str, extreme: f64, name: String, test: CompositeCase) -> Case<'a> {
    Case::new(family, extreme, name, test, BOUND)
}

pub(super) fn families<'a>() -> Vec<Vec<Case<'a>>> {
    let almost = 1.0 - f32::EPSILON / 2.0;
    // The first layer is black, there is no background, and errors are relative: the picture is what shows through the first layer.
    let stiff = |layers: usize, alpha: &dyn Fn(usize) -> f32| {
        let case = CompositeCase::new(layers, 4.0, |layer, _| alpha(layer));
        let mut case = CompositeCase { background: false, relative: true, ..case };
        case.rgb[..3 * PIXELS].fill(0.0);
        case.disparity[..PIXELS].fill(0.0);
        case
    };
    let first = |left: f64| ((1.0 - left) as f32).min(almost);
    let opaque_then_faint = |first: f32| stiff(1001, &|layer| if layer == 0 { first } else { 1e-3 });
    // Few enough layers that the remaining transmittance is a float32 number.
    let alternating = |faint: f64| stiff(8, &|layer| if layer % 2 == 0 { faint } else { 1.0 - faint } as f32);
    let many = |layers: usize| {
        let unit = Seeded(5).units(PIXELS);
        CompositeCase::new(layers, 4.0, |layer, pixel| (unit[(pixel + layer) % PIXELS] * 4.0 / layers as f32).min(1.0))
    };
    let ratio =
        |ratio: f64| CompositeCase::new(64, ratio, |layer, pixel| if (layer + pixel) % 3 == 0 { 0.1 } else { 0.01 });
    let special = [0.0, -0.0, f32::from_bits(1), f32::MIN_POSITIVE, almost, 1.0];
    let mut named = vec![
        (
            "0, -0, denormal, 1 - 2⁻²⁴, 1",
            CompositeCase::new(36, 4.0, |layer, pixel| special[(pixel / 6usize.pow(layer as u32 % 2) + layer) % 6]),
        ),
        ("all transparent", CompositeCase { background: false, ..CompositeCase::new(64, 4.0, |_, _| 0.0) }),
        ("all opaque", CompositeCase::new(64, 4.0, |_, _| 1.0)),
        ("one plane", CompositeCase::new(1, 1.0, |_, _| 0.25)),
        ("composited in two parts", CompositeCase { split: Some(20), ..ratio(4.0) }),
        ("all at one disparity", CompositeCase::new(64, 1.0, |layer, _| 1.0 / (2 + layer) as f32)),
    ];
    // All white: the frame is the sum of the weights, which is 1 minus the remaining transmittance.
    let mut white = CompositeCase { background: false, ..many(1024) };
    white.rgb.fill(1.0);
    named.push(("white, without background", white));
    vec![
        decades(-8..=0)
            .map(first)
            .map(|first| (1.0 - f64::from(first), first))
            .map(|(left, first)| {
                case("1,000 faint behind opaque", left, format!("T {left:.0e}"), opaque_then_faint(first))
            })
            .collect(),
        decades(-10..=-1)
            .map(|faint| case("alternating α, 1 - α", faint, format!("α {faint:.0e}"), alternating(faint)))
            .collect(),
        (0..=12)
            .step_by(2)
            .map(|power| 1 << power)
            .map(|n| case("number of planes", n as f64, format!("{n}"), many(n)))
            .collect(),
        decades(0..=12).map(|by| case("far / near", by, format!("{by:.0e}"), ratio(by))).collect(),
        Case::listed("special composites", BOUND, named),
    ]
}
