//! Runs: the pixels of a row that the warp computes together; rounding and clamping of their positions in
//! fewer instructions than the standard library's.

use std::ops::Range;

/// Pixels of a run: enough that the compiler keeps loops over them as loops, and vectorises them.
pub const RUN: usize = 64;

/// All pixels of a run, as bits.
pub(crate) const ALL_SEEN: u64 = u64::MAX;

/// What is known about the coverage of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum RunCoverage {
    /// Nothing: any values in [0, 1].
    #[default]
    Partial,
    /// 0 throughout: every sample lies outside the photo.
    None,
    /// 1 throughout: every sample lies between the centres of four pixels.
    All,
}

/// A run of some rows of a layer.
pub(super) struct Run {
    /// Index among the runs of these rows.
    pub(super) index: usize,
    /// Index of its first pixel among those of these rows.
    pub(super) first: usize,
    /// Number of pixels, at most [`RUN`].
    pub(super) len: usize,
}

impl Run {
    pub(super) fn span(&self) -> Range<usize> {
        self.first..self.first + self.len
    }

    /// A bit for each of its pixels.
    pub(super) fn bits(&self) -> u64 {
        ALL_SEEN >> (RUN - self.len)
    }
}

/// Nearest integer (halves to even) of a number whose absolute value is below 2^22: `as` would
/// check for overflow.
#[inline(always)]
pub fn round_to_i32(x: f32) -> i32 {
    const OFFSET: f32 = 12_582_912.0; // 1.5 * 2^23: the bits of whole numbers around it are consecutive
    (x + OFFSET).to_bits().wrapping_sub(OFFSET.to_bits()) as i32
}

/// `x` clamped to [low, high], NaN to `low`: two instructions, where `f32::max` and `min` take eight.
#[inline(always)]
pub(crate) fn clamp(x: f32, low: f32, high: f32) -> f32 {
    let x = if x > low { x } else { low };
    if x < high { x } else { high }
}

/// `x` clamped to [0, high], NaN to 0: two instructions, where `f64::max` and `min` take eight.
#[inline(always)]
pub(super) fn clamp_from_zero(x: f64, high: f64) -> f64 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < high { x } else { high }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_hold_a_bit_for_each_pixel() {
        let run = |len| Run { index: 0, first: 7, len };
        assert_eq!((run(64).bits(), run(3).bits(), run(1).span()), (u64::MAX, 0b111, 7..8));
    }

    #[test]
    fn numbers_are_rounded_and_clamped() {
        let rounded = [-2.5, -0.51, -0.5, 0.49, 1.5, 2.5, 4_000_000.0].map(round_to_i32);
        assert_eq!(rounded, [-2, -1, 0, 0, 2, 2, 4_000_000]);
        assert_eq!(
            [-3.0, -1.0, 0.5, 2.0, 9.0, f32::NAN].map(|x| clamp(x, -1.0, 2.0)),
            [-1.0, -1.0, 0.5, 2.0, 2.0, -1.0]
        );
        assert_eq!(
            [-3.0, 0.0, 0.5, 2.0, 9.0, f64::NAN].map(|x| clamp_from_zero(x, 2.0)),
            [0.0, 0.0, 0.5, 2.0, 2.0, 0.0]
        );
    }
}
