//! The difference of pictures.

use liveview::ImageRgb;

/// Absolute difference of pictures with values in [0, 1].
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelError {
    /// Largest difference of a value.
    pub(crate) max: f64,
    /// Mean difference of all values.
    pub(crate) mean: f64,
}

impl PixelError {
    /// The difference over all pairs of pictures.
    pub(crate) fn between<'a>(pairs: impl Iterator<Item = (&'a ImageRgb, &'a ImageRgb)>) -> Self {
        let values = pairs.flat_map(|(a, b)| a.data().iter().zip(b.data()));
        let (max, sum, count) = values.fold((0.0, 0.0, 0), |(max, sum, count): (f64, f64, usize), (a, b)| {
            let difference = f64::from((a - b).abs());
            (max.max(difference), sum + difference, count + 1)
        });
        Self { max, mean: sum / count as f64 }
    }
}
