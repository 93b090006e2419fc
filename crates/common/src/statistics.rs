//! Statistics of numbers.

/// A quantile (`fraction` from 0 to 1) of the values, which it sorts; NaN if there are none.
pub fn quantile(values: &mut [f64], fraction: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    quantile_of_sorted(values, fraction)
}

/// A quantile (`fraction` from 0 to 1) of sorted values, interpolated linearly between ranks as in
/// NumPy; NaN if there are none.
pub fn quantile_of_sorted(sorted: &[f64], fraction: f64) -> f64 {
    let at = fraction * sorted.len().saturating_sub(1) as f64;
    match (sorted.get(at.floor() as usize), sorted.get(at.ceil() as usize)) {
        // Depths may be infinite, and infinity minus infinity is NaN.
        (Some(low), Some(high)) if low == high => *low,
        (Some(low), Some(high)) => low + at.fract() * (high - low),
        _ => f64::NAN,
    }
}
