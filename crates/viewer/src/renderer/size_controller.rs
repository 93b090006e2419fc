//! Chooses the size of pictures in motion: as large as the frame rate allows.

use std::collections::VecDeque;
use std::time::Duration;

use super::source::MOTION_BUDGET;

/// Scales of the target's sides, the largest first.
const SCALES: [f64; 3] = [1.0, 0.75, 0.5];
/// Pixels, at most, of the first picture in motion, before any time is known.
const FIRST_PIXELS: f64 = 200_000.0;
/// Number of recent pictures whose median counts: a single one that waits for the depth of a photo changes nothing.
const RECENT_PICTURES: usize = 5;

/// Times of recent pictures: seconds that do not depend on the picture's size (searching the photos' depth), and seconds per pixel.
#[derive(Debug, Default)]
pub(super) struct SizeController {
    recent: VecDeque<(f64, f64)>,
}

impl SizeController {
    /// Records the time of a picture; `fixed`: the part of it that does not depend on the size.
    pub(super) fn record(&mut self, pixels: usize, took: Duration, fixed: Duration) {
        let variable = took.saturating_sub(fixed).as_secs_f64();
        self.recent.push_back((fixed.as_secs_f64(), variable / pixels as f64));
        if self.recent.len() > RECENT_PICTURES {
            self.recent.pop_front();
        }
    }

    /// The largest scale at which a target of `pixels` at full size is expected to fit the budget, else the smallest.
    pub(super) fn scale(&self, pixels: usize) -> f64 {
        let median = |of: fn(&(f64, f64)) -> f64| {
            let mut values: Vec<f64> = self.recent.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        };
        let (fixed, per_pixel) = (median(|times| times.0), median(|times| times.1));
        let fits = |scale: &f64| {
            let pixels = pixels as f64 * scale * scale;
            if self.recent.is_empty() {
                pixels <= FIRST_PIXELS
            } else {
                fixed + per_pixel * pixels <= MOTION_BUDGET.as_secs_f64()
            }
        };
        SCALES.into_iter().find(fits).unwrap_or(SCALES[SCALES.len() - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: usize = 10_000;

    fn scale_after(controller: &mut SizeController, pixels: usize, milliseconds: u64, fixed: u64) -> f64 {
        for _ in 0..RECENT_PICTURES {
            controller.record(pixels, Duration::from_millis(milliseconds), Duration::from_millis(fixed));
        }
        controller.scale(PIXELS)
    }

    #[test]
    fn scale_follows_the_median_time() {
        let mut controller = SizeController::default();
        assert_eq!((controller.scale(PIXELS), controller.scale(540 * 960)), (1.0, 0.5));
        for (milliseconds, scale) in [(50, 1.0), (80, 0.75), (150, 0.5), (3000, 0.5), (20, 1.0)] {
            assert_eq!(scale_after(&mut controller, PIXELS, milliseconds, 0), scale, "{milliseconds} ms");
        }
        controller.record(PIXELS, Duration::from_secs(2), Duration::from_secs(1));
        assert_eq!(controller.scale(PIXELS), 1.0);
    }

    #[test]
    fn fixed_time_does_not_scale_with_the_size() {
        // A quarter of the pixels in 25 ms: 100 ms for all of them, or 40 ms where 20 of the 25 are fixed.
        let mut controller = SizeController::default();
        assert_eq!(scale_after(&mut controller, PIXELS / 4, 25, 0), 0.5);
        assert_eq!(scale_after(&mut controller, PIXELS / 4, 25, 20), 1.0);
    }
}
