//! Statistics of lists of numbers and of pictures.

use liveview::ImageRgb;

/// The value below which a share `part` (0 to 1) of the values lies; NaN if there are none. Sorts them.
pub fn percentile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    quantile(values, part)
}

/// The same of a sorted list, linearly between ranks, as NumPy does.
pub fn quantile(sorted: &[f64], part: f64) -> f64 {
    let at = part * sorted.len().saturating_sub(1) as f64;
    match (sorted.get(at.floor() as usize), sorted.get(at.ceil() as usize)) {
        // Depths may be infinite, and infinity less infinity is no number.
        (Some(low), Some(high)) if low == high => *low,
        (Some(low), Some(high)) => low + at.fract() * (high - low),
        _ => f64::NAN,
    }
}

/// Absolute difference of pictures, of values in [0, 1].
#[derive(Debug, Clone, Copy)]
pub struct PixelError {
    /// Of any value.
    pub max: f64,
    /// Over all values.
    pub mean: f64,
}

impl PixelError {
    /// Over all values of all pairs of pictures.
    pub fn between<'a>(pairs: impl Iterator<Item = (&'a ImageRgb, &'a ImageRgb)>) -> Self {
        let values = pairs.flat_map(|(a, b)| a.data().iter().zip(b.data()));
        let (max, sum, count) = values.fold((0.0, 0.0, 0), |(max, sum, count): (f64, f64, usize), (a, b)| {
            let apart = f64::from((a - b).abs());
            (max.max(apart), sum + apart, count + 1)
        });
        Self { max, mean: sum / count as f64 }
    }
}

/// Share (0 to 1) of the elements that a condition holds for.
pub fn share<T>(all: &[T], is: impl Fn(&T) -> bool) -> f64 {
    all.iter().filter(|&one| is(one)).count() as f64 / all.len().max(1) as f64
}
