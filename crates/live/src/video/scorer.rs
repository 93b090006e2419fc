//! Scores frames against those of the held-out camera: PSNR, SSIM and flicker.

use liveview::ImageRgb;
use liveview::image::Score;

/// The scores of a frame against its ground truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scores {
    pub(super) score: Score,
    /// Mean |change of the picture − change of the ground truth| since the previous frame, of values in [0, 1].
    pub(super) flicker: Option<f64>,
}

/// Scores the frames of a video.
#[derive(Default)]
pub(super) struct Scorer {
    /// The previous picture and its ground truth.
    previous: Option<(ImageRgb, ImageRgb)>,
}

impl Scorer {
    pub(super) fn score(&mut self, picture: &ImageRgb, truth: ImageRgb) -> Option<Scores> {
        let Some(score) = Score::of(picture, &truth) else {
            self.previous = None; // too small to be scored
            return None;
        };
        let previous = self.previous.as_ref();
        let flicker = previous.map(|(before, truth_before)| flicker([before, picture], [truth_before, &truth]));
        self.previous = Some((picture.clone(), truth));
        Some(Scores { score, flicker })
    }

    /// Starts again after a gap: the next frame has no flicker.
    pub(super) fn restart(&mut self) {
        self.previous = None;
    }
}

fn flicker(pictures: [&ImageRgb; 2], truths: [&ImageRgb; 2]) -> f64 {
    let (width, height) = (truths[1].width(), truths[1].height());
    let (mut sum, mut count) = (0.0, 0.0);
    for y in Score::BORDER..height.saturating_sub(Score::BORDER) {
        let row = 3 * (y * width + Score::BORDER)..3 * ((y + 1) * width - Score::BORDER);
        let [before, now, truth_before, truth] =
            [pictures[0], pictures[1], truths[0], truths[1]].map(|picture| &picture.data()[row.clone()]);
        for i in 0..before.len() {
            sum += f64::from(((now[i] - before[i]) - (truth[i] - truth_before[i])).abs());
            count += 1.0;
        }
    }
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_narrower_than_the_border_are_not_scored() {
        let frame = || ImageRgb::new(28, 60, vec![0.5; 3 * 28 * 60]).unwrap();
        let mut scorer = Scorer::default();
        assert!((0..2).all(|_| scorer.score(&frame(), frame()).is_none()));
    }

    #[test]
    fn flicker_is_the_change_that_the_truth_lacks() {
        let flat = |value: f32| ImageRgb::new(48, 48, vec![value; 3 * 48 * 48]).unwrap();
        let mut scorer = Scorer::default();
        assert!(scorer.score(&flat(0.5), flat(0.4)).unwrap().flicker.is_none());
        let steady = scorer.score(&flat(0.7), flat(0.6)).unwrap().flicker.unwrap();
        let flickers = scorer.score(&flat(0.6), flat(0.6)).unwrap().flicker.unwrap();
        assert!(steady < 1e-6 && (flickers - 0.1).abs() < 1e-6, "{steady} {flickers}");
    }
}
