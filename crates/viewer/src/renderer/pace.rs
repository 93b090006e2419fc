//! How large the pictures of a moving viewpoint are: as large as the frame rate allows.

use std::collections::VecDeque;
use std::time::Duration;

use super::source::BUDGET;

/// Scales of the target's sides, the best first.
const SCALES: [f64; 3] = [1.0, 0.75, 0.5];
/// The last pictures, of which the median counts: one that had to wait for the depth of a photo changes nothing.
const LAST: usize = 5;

/// Times of the last pictures: seconds whatever the size (finding the surface, which the photos' size decides), and seconds per pixel.
#[derive(Debug, Default)]
pub(super) struct Pace {
    last: VecDeque<(f64, f64)>,
}

impl Pace {
    /// Records that a picture of so many pixels took so long, `fixed` of it whatever its size.
    pub(super) fn note(&mut self, pixels: usize, took: Duration, fixed: Duration) {
        let rest = took.saturating_sub(fixed).as_secs_f64();
        self.last.push_back((fixed.as_secs_f64(), rest / pixels as f64));
        if self.last.len() > LAST {
            self.last.pop_front();
        }
    }

    /// The largest scale at which a target of so many pixels is expected to fit the budget, else the smallest.
    pub(super) fn scale(&self, pixels: usize) -> f64 {
        let median = |of: fn(&(f64, f64)) -> f64| {
            let mut values: Vec<f64> = self.last.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        };
        let (fixed, per_pixel) = (median(|times| times.0), median(|times| times.1));
        let fits = |scale: &f64| fixed + per_pixel * pixels as f64 * scale * scale <= BUDGET.as_secs_f64();
        SCALES.into_iter().find(fits).unwrap_or(SCALES[SCALES.len() - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: usize = 10_000;

    fn after(pace: &mut Pace, pixels: usize, milliseconds: u64, fixed: u64) -> f64 {
        for _ in 0..LAST {
            pace.note(pixels, Duration::from_millis(milliseconds), Duration::from_millis(fixed));
        }
        pace.scale(PIXELS)
    }

    #[test]
    fn the_size_follows_the_time_and_one_slow_picture_changes_nothing() {
        let mut pace = Pace::default();
        assert_eq!(pace.scale(PIXELS), 1.0);
        for (milliseconds, scale) in [(50, 1.0), (80, 0.75), (150, 0.5), (3000, 0.5), (20, 1.0)] {
            assert_eq!(after(&mut pace, PIXELS, milliseconds, 0), scale, "{milliseconds} ms");
        }
        pace.note(PIXELS, Duration::from_secs(2), Duration::from_secs(1));
        assert_eq!(pace.scale(PIXELS), 1.0);
    }

    #[test]
    fn what_the_size_does_not_change_is_taken_as_it_is() {
        // A quarter of the pixels in 25 ms: 100 ms for all of them, or 40 where 20 of the 25 are fixed.
        let mut pace = Pace::default();
        assert_eq!(after(&mut pace, PIXELS / 4, 25, 0), 0.5);
        assert_eq!(after(&mut pace, PIXELS / 4, 25, 20), 1.0);
    }
}
