//! How much to sharpen each photo before it is warped: bilinear sampling removes detail, and focus
//! and motion blur differ between photos. Other photos of the same points show how much is missing.
//!
//! Where a photo corresponds to a pixel of another one ([`super::correspondences`]), let p be that
//! pixel's colour at the photo's exposure, s the photo's own bilinear sample and d that of its
//! detail 4t − (its four neighbours). The amount is the least squares solution of p ≈ s + a d,
//! Σ d (p − s) / Σ d², over all channels and all other photos where |p − s| < 0.1; at least 0 (no
//! photo is blurred), at most 0.15, and 0 with fewer than 100 correspondences. Correspondences
//! whose samples reach beyond the photo are left out.
//!
//! The photo becomes t + a (4t − its four neighbours), clamped to \[0, 1\]; neighbours outside it
//! are the pixel itself.
//!
//! Worth 0.14 dB and 0.002 of SSIM in the mean of the seven scenes of `make evaluate`;
//! alternatives: docs/design-log/surface-layers.md.

use super::correspondences::correspondences;
use super::pair_statistics::{DetailSums, PairStatistics, get_or_compute};
use crate::fusion::SurfaceView;
use liveview::warp::Texture;

/// From this difference on, two photos do not show the same point.
const MAX_DIFFERENCE: f32 = 0.1;
/// Largest amount of sharpening.
const MAX_AMOUNT: f64 = 0.15;
/// Fewest correspondences that give an amount.
const MIN_CORRESPONDENCES: usize = 100;

/// Amount of sharpening `[V]` of the views: the share of their detail to add.
pub fn sharpening(views: &[SurfaceView<'_>]) -> Vec<f32> {
    sharpening_with(views, &mut PairStatistics::default())
}

/// As [`sharpening`], with statistics of the photos from earlier targets.
pub(crate) fn sharpening_with(views: &[SurfaceView<'_>], statistics: &mut PairStatistics) -> Vec<f32> {
    let pairs = views.iter().flat_map(|photo| views.iter().map(move |other| (photo, other)));
    let pairs: Vec<_> = pairs.filter(|(photo, other)| !std::ptr::eq(*photo, *other)).collect();
    let key = |&(photo, other): &(&SurfaceView<'_>, &SurfaceView<'_>)| {
        ([photo, other].map(|view| view.view.texture.id()), relative_gains(photo, other).map(f32::to_bits))
    };
    let keys: Vec<_> = pairs.iter().map(key).collect();
    let sums = get_or_compute(&mut statistics.sharpness, &keys, |pair| sums(pairs[pair].0, pairs[pair].1));
    let others = views.len().saturating_sub(1);
    (0..views.len()).map(|photo| amount(&sums[photo * others..][..others])).collect()
}

/// Gains that give another photo the photo's exposure.
fn relative_gains(photo: &SurfaceView<'_>, other: &SurfaceView<'_>) -> [f32; 3] {
    std::array::from_fn(|c| other.gains[c] / photo.gains[c])
}

fn amount(pairs: &[DetailSums]) -> f32 {
    let [mut product, mut square, mut count] = [0.0, 0.0, 0.0];
    for pair in pairs {
        (product, square, count) = (product + pair.product, square + pair.square, count + pair.count as f64);
    }
    if count >= MIN_CORRESPONDENCES as f64 && square > 0.0 {
        (product / square).clamp(0.0, MAX_AMOUNT) as f32
    } else {
        0.0
    }
}

/// Sums over the correspondences of another photo with a photo.
fn sums(photo: &SurfaceView<'_>, other: &SurfaceView<'_>) -> DetailSums {
    let texture = photo.view.texture;
    let gains = relative_gains(photo, other);
    let (width, height) = (texture.width() as f32, texture.height() as f32);
    let mut sums = DetailSums::default();
    for found in correspondences(other, photo) {
        let (x, y) = (found.other.0 - 0.5, found.other.1 - 0.5);
        if !(x >= 1.0 && y >= 1.0 && x < width - 2.0 && y < height - 2.0) {
            continue;
        }
        let shown = other.view.texture.pixel(found.pixel.0, found.pixel.1);
        let (sample, detail) = sample_and_detail(texture, x, y);
        sums.count += 1;
        for c in 0..3 {
            let missing = shown[c] * gains[c] - sample[c];
            if missing.abs() < MAX_DIFFERENCE {
                sums.product += f64::from(detail[c]) * f64::from(missing);
                sums.square += f64::from(detail[c]) * f64::from(detail[c]);
            }
        }
    }
    sums
}

/// Bilinear samples of a photo and of its detail; (x, y) in px, the centre of the first at 0.
fn sample_and_detail(texture: &Texture, x: f32, y: f32) -> ([f32; 3], [f32; 3]) {
    let (column, row) = (x as usize, y as usize);
    let (across, down) = (x - column as f32, y - row as f32);
    let lerp = |a: [f32; 3], b: [f32; 3], share: f32| std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share);
    // In row `row + j − 1`, between the columns `column + i − 1` and `column + i`.
    let between = |i: usize, j: usize| {
        let [left, right] = [i, i + 1].map(|i| texture.pixel(column + i - 1, row + j - 1));
        lerp(left, right, across)
    };
    let [above, upper, lower, below] = [0, 1, 2, 3].map(|j| between(1, j));
    let sample: [f32; 3] = lerp(upper, lower, down);
    let (above, below): ([f32; 3], [f32; 3]) = (lerp(above, upper, down), lerp(lower, below, down));
    let [left, right]: [[f32; 3]; 2] = [0, 2].map(|i| lerp(between(i, 1), between(i, 2), down));
    (sample, std::array::from_fn(|c| 4.0 * sample[c] - above[c] - below[c] - left[c] - right[c]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use liveview::image::ImageRgb;

    #[test]
    fn sample_and_detail_match_a_paraboloid() {
        // The detail of x² + y² is −4 everywhere; a bilinear sample is too large by f (1 − f) in
        // each direction.
        let value = |x: usize, y: usize| ((x * x + y * y) as f32) / 128.0;
        let data = (0..64).flat_map(|i| [value(i % 8, i / 8); 3]).collect();
        let texture = Texture::new(&ImageRgb::new(8, 8, data).unwrap());
        let (sample, detail) = sample_and_detail(&texture, 3.25, 4.5);
        let expected = (3.25_f32.powi(2) + 4.5_f32.powi(2) + 0.25 * 0.75 + 0.5 * 0.5) / 128.0;
        assert!((sample[1] - expected).abs() < 1e-6 && (detail[2] + 4.0 / 128.0).abs() < 1e-6);
    }

    #[test]
    fn amount_is_the_least_squares_solution_within_its_limits() {
        let sums = |product, count| {
            [DetailSums { product, square: 2.0, count }, DetailSums { product, square: 2.0, count: 0 }]
        };
        assert_eq!(amount(&sums(0.1, 100)), 0.05);
        assert_eq!(amount(&sums(0.1, 99)), 0.0);
        assert_eq!(amount(&sums(-0.1, 100)), 0.0);
        assert_eq!(amount(&sums(9.0, 100)), 0.15);
        assert_eq!(amount(&[DetailSums { count: 100, ..DetailSums::default() }]), 0.0);
    }
}
