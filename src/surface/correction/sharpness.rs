//! How much to sharpen each photo before it is warped: bilinear sampling takes detail away, and focus and motion blur differ between
//! photos. What other photos show of the same points says how much is missing.
//!
//! Where a photo corresponds to a pixel of another one ([`super::correspondences`]), let p be that pixel's colour brought to the
//! photo's exposure, s the photo's own bilinear sample and d that of its detail 4t − (its four neighbours). The amount is the least
//! squares solution of p ≈ s + a d, Σ d (p − s) / Σ d², over all channels and all other photos where |p − s| < 0.1; 0 instead of a
//! negative one (no photo is blurred), 0.15 at most, and 0 with fewer than 100 correspondences. They are told from where all that
//! is sampled lies inside.
//!
//! The photo becomes t + a (4t − its four neighbours), of which those outside are the pixel itself, clamped to \[0, 1\].
//!
//! Worth 0.14 dB and 0.002 of SSIM in the mean of the seven scenes of `make evaluate`; alternatives: docs/experiments.md.

use super::correspondences::correspondences;
use super::pair_statistics::{DetailSums, PairStatistics, kept_or};
use crate::surface::fusion::SurfaceView;
use crate::warp::Texture;

/// Differences from which on two photos do not show the same.
const SAME: f32 = 0.1;
/// Most that a photo is sharpened by.
const MOST: f64 = 0.15;
/// Fewest correspondences that an amount is told from.
const ENOUGH: usize = 100;

/// Amounts of sharpening of each view.
pub fn sharpening(views: &[SurfaceView<'_>]) -> Vec<f32> {
    sharpening_with(views, &mut PairStatistics::default())
}

/// As [`sharpening`].
pub(crate) fn sharpening_with(views: &[SurfaceView<'_>], statistics: &mut PairStatistics) -> Vec<f32> {
    let pairs = views.iter().flat_map(|photo| views.iter().map(move |other| (photo, other)));
    let pairs: Vec<_> = pairs.filter(|(photo, other)| !std::ptr::eq(*photo, *other)).collect();
    let key = |&(photo, other): &(&SurfaceView<'_>, &SurfaceView<'_>)| {
        ([photo, other].map(|view| view.view.texture.id()), like_photo(photo, other).map(f32::to_bits))
    };
    let keys: Vec<_> = pairs.iter().map(key).collect();
    let sums = kept_or(&mut statistics.sharpness, &keys, |pair| sums(pairs[pair].0, pairs[pair].1));
    let others = views.len().saturating_sub(1);
    (0..views.len()).map(|photo| amount(&sums[photo * others..][..others])).collect()
}

/// What another photo is multiplied by to have the photo's exposure.
fn like_photo(photo: &SurfaceView<'_>, other: &SurfaceView<'_>) -> [f32; 3] {
    std::array::from_fn(|c| other.gains[c] / photo.gains[c])
}

fn amount(pairs: &[DetailSums]) -> f32 {
    let [mut product, mut square, mut count] = [0.0, 0.0, 0.0];
    for pair in pairs {
        (product, square, count) = (product + pair.product, square + pair.square, count + pair.count as f64);
    }
    if count >= ENOUGH as f64 && square > 0.0 { (product / square).clamp(0.0, MOST) as f32 } else { 0.0 }
}

/// What the pixels of another photo say of a photo.
fn sums(photo: &SurfaceView<'_>, other: &SurfaceView<'_>) -> DetailSums {
    let texture = photo.view.texture;
    let gains = like_photo(photo, other);
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
            if missing.abs() < SAME {
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
    use crate::image::ImageRgb;

    #[test]
    fn samples_and_their_detail_are_those_of_a_paraboloid() {
        // Of x² + y² the detail is −4 everywhere; a bilinear sample is too large by f (1 − f) in each direction.
        let value = |x: usize, y: usize| ((x * x + y * y) as f32) / 128.0;
        let data = (0..64).flat_map(|i| [value(i % 8, i / 8); 3]).collect();
        let texture = Texture::new(&ImageRgb::new(8, 8, data).unwrap());
        let (sample, detail) = sample_and_detail(&texture, 3.25, 4.5);
        let expected = (3.25_f32.powi(2) + 4.5_f32.powi(2) + 0.25 * 0.75 + 0.5 * 0.5) / 128.0;
        assert!((sample[1] - expected).abs() < 1e-6 && (detail[2] + 4.0 / 128.0).abs() < 1e-6);
    }

    #[test]
    fn the_amount_is_the_least_squares_solution_within_its_limits() {
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
