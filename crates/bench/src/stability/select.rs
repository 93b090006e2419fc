//! Extreme cases of the plane selection, with nothing or too much to choose from; expected outputs by counting.

use anyhow::Result;
use liveview::layers::{plane_histogram, select_planes};
use liveview::render::{Accumulated, Blended};
use ndarray::{Array1, Array2};

use super::case::{Case, Expected, Outputs, Seeded, StageTest};
use crate::npz::Arrays;

/// Pixels per case.
const PIXELS: usize = 67;

/// α of D planes `[D, pixels]`, of which `count` are to be selected.
struct SelectCase {
    alpha: Vec<f32>,
    count: usize,
}

impl SelectCase {
    fn planes(&self) -> usize {
        self.alpha.len() / PIXELS
    }
}

/// The histogram, and whether each plane was selected (1) or not (0); one "pixel" for each plane.
fn outputs<T: From<f32>>(histogram: impl Iterator<Item = T>, selected: &[usize], planes: usize) -> Outputs<T> {
    let chosen = (0..planes).map(|plane| T::from(f32::from(u8::from(selected.contains(&plane)))));
    vec![("histogram", histogram.collect()), ("selected", chosen.collect())]
}

impl StageTest for SelectCase {
    fn stage(&self) -> &'static str {
        "select"
    }

    fn computed(&self) -> Result<Outputs<f32>, String> {
        let mut row = Accumulated::new(PIXELS);
        for (plane, alpha) in self.alpha.chunks(PIXELS).enumerate() {
            let layer = Blended { alpha: alpha.to_vec(), ..Blended::new(PIXELS) };
            row.add(plane as u32, &layer, &[0.0; PIXELS], plane + 1 == self.planes());
        }
        let best = row.best_layer.iter().map(|&best| (best != u32::MAX).then_some(best as usize));
        let histogram = plane_histogram(best, self.planes());
        let selected = select_planes(&histogram, self.count);
        Ok(outputs(histogram.iter().map(|&votes| votes as f32), &selected, self.planes()))
    }

    fn expected(&self) -> Option<Expected> {
        let planes = self.planes();
        let mut votes = vec![0_u32; planes];
        for pixel in 0..PIXELS {
            let alpha = |plane: usize| self.alpha[plane * PIXELS + pixel];
            let best = (0..planes).fold(0, |best, plane| if alpha(plane) > alpha(best) { plane } else { best });
            votes[best] += u32::from(alpha(best) > 0.0);
        }
        // A plane is selected if fewer than `count` planes have a fuller bin, or an equally full one and are nearer.
        let before = |a: usize, b: usize| votes[a] > votes[b] || votes[a] == votes[b] && a < b;
        let chosen = |plane: &usize| (0..planes).filter(|&other| before(other, *plane)).count() < self.count;
        let selected: Vec<usize> = (0..planes).filter(chosen).collect();
        let outputs = outputs(votes.iter().map(|&votes| f64::from(votes)), &selected, planes);
        Some(Expected { outputs, doubtful: vec![false; planes], relative: false })
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        arrays.add("alpha", Array2::from_shape_vec((self.planes(), PIXELS), self.alpha.clone())?)?;
        arrays.add("count", Array1::from_vec(vec![self.count as i64]))
    }
}

pub(super) fn families<'a>() -> Vec<Vec<Case<'a>>> {
    let random = |planes: usize| Seeded(planes as u64).units(planes * PIXELS);
    let coarse = random(8).into_iter().map(|alpha| (alpha * 3.0).floor() / 3.0).collect();
    let one_bin = (0..8 * PIXELS).map(|i| f32::from(u8::from(i / PIXELS == 5))).collect();
    let named = [
        ("ties between bins and between α", coarse, 3),
        ("all α equal", vec![0.5; 8 * PIXELS], 3),
        ("all α 0", vec![0.0; 8 * PIXELS], 3),
        ("denormal α", vec![f32::from_bits(1); 8 * PIXELS], 3),
        ("one plane", random(1), 1),
        ("more requested than there are", random(8), 20),
        ("all but one bin empty", one_bin, 3),
        ("4,096 planes", random(4096), 16),
    ];
    let named = named.map(|(name, alpha, count)| (name, SelectCase { alpha, count }));
    vec![Case::listed("selection", 0.0, named)]
}
