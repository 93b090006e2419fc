//! Rounding and clamping in fewer instructions than the standard library's.

/// Nearest integer (halves to even) of a number whose absolute value is below 2^22: `as` would
/// check for overflow.
#[inline(always)]
pub(crate) fn round_to_i32(x: f32) -> i32 {
    const OFFSET: f32 = 12_582_912.0; // 1.5 * 2^23: the bits of whole numbers around it are consecutive
    (x + OFFSET).to_bits().wrapping_sub(OFFSET.to_bits()) as i32
}

/// `x` clamped to [low, high]: two instructions, where `f32::max` and `min` take eight.
#[inline(always)]
pub(super) fn clamp(x: f32, low: f32, high: f32) -> f32 {
    let x = if x > low { x } else { low };
    if x < high { x } else { high }
}

/// `x` clamped to [0, high], NaN to 0: two instructions, where `f64::max` and `min` take eight.
#[inline(always)]
pub(super) fn clamp_from_zero(x: f64, high: f64) -> f64 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < high { x } else { high }
}
