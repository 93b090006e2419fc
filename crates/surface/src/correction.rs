//! Photos brought to the same exposure and sharpness, by the pixels in which they show the same point
//! ([`correspondences`]). What is computed of a pair of photos does not depend on the target
//! ([`PairStatistics`]).
//!
//! # Exposure
//!
//! Gains bring photos of different exposure or white balance to a common exposure between theirs: a
//! factor per colour channel.
//!
//! Over the photo's correspondences with the first photo whose channel
//! lies in \[0.05, 0.95\] in both, the gain is the (upper) median of the first photo's value over
//! the photo's. With fewer than 100 correspondences in any channel all gains of that photo are 1.
//!
//! These gains give all photos the exposure of the first. The exposure of a camera at the target is
//! unknown; the weighted geometric mean of the photos' exposures is the estimate that scores best
//! and that changes smoothly along a path: gain i becomes gᵢ / Π gⱼ^wⱼ with wⱼ the share of photo j
//! in Σ 1/dⱼ, dⱼ its distance from the target (1 for a photo at the target).
//!
//! # Sharpness
//!
//! Each photo is sharpened before it is warped: bilinear sampling removes detail, and focus
//! and motion blur differ between photos. Other photos of the same points show how much is missing.
//!
//! Where a photo corresponds to a pixel of another one, let p be that
//! pixel's colour at the photo's exposure, s the photo's own bilinear sample and d that of its
//! detail 4t − (its four neighbours). The amount is the least squares solution of p ≈ s + a d,
//! Σ d (p − s) / Σ d², over all channels and all other photos where |p − s| < 0.1; at least 0 (no
//! photo is blurred), at most 0.15, and 0 with fewer than 100 correspondences. Correspondences
//! whose samples reach beyond the photo are left out.
//!
//! The photo becomes t + a (4t − its four neighbours), clamped to \[0, 1\]; neighbours outside it
//! are the pixel itself.
//!
//! Measured alternatives: docs/design-log/surface-layers.md.

use std::collections::{BTreeSet, HashMap};
use std::hash::Hash;

use rayon::prelude::*;

use crate::consistency::project;
use crate::fusion::SurfaceView;
use liveview::geometry::PlaneSweep;
use liveview::warp::Texture;

/// Values that are neither dominated by noise nor clipped.
const USABLE_VALUES: std::ops::RangeInclusive<f32> = 0.05..=0.95;
/// Fewest correspondences that give a gain or an amount of sharpening.
const MIN_CORRESPONDENCES: usize = 100;

/// Gains `[V]` of the views, by channel; `distances` are those of the views from the target, scene
/// units.
pub fn exposure_gains(views: &[SurfaceView<'_>], distances: &[f64]) -> Vec<[f32; 3]> {
    balanced(&gains_to_first(views, &mut PairStatistics::default()), distances)
}

/// Gains of each view that give it the exposure of the first.
pub(crate) fn gains_to_first(views: &[SurfaceView<'_>], statistics: &mut PairStatistics) -> Vec<[f32; 3]> {
    let Some((first, others)) = views.split_first() else { return Vec::new() };
    let pairs: Vec<_> = others.iter().map(|view| [view.view.texture.id(), first.view.texture.id()]).collect();
    let relative = |index: usize| gains(&others[index], first).unwrap_or([1.0; 3]);
    let mut all = vec![[1.0; 3]];
    all.extend(get_or_compute(&mut statistics.gains, &pairs, relative));
    all
}

/// Gains whose weighted geometric mean is 1.
pub(crate) fn balanced(gains: &[[f32; 3]], distances: &[f64]) -> Vec<[f32; 3]> {
    let at_target = distances.contains(&0.0);
    let weight = |d: f64| if at_target { f64::from(u8::from(d == 0.0)) } else { 1.0 / d };
    let total: f64 = distances.iter().map(|&d| weight(d)).sum();
    let mean: [f64; 3] = std::array::from_fn(|c| {
        let sum: f64 = gains.iter().zip(distances).map(|(g, &d)| weight(d) * f64::from(g[c]).ln()).sum();
        (sum / total).exp()
    });
    gains.iter().map(|g| std::array::from_fn(|c| (f64::from(g[c]) / mean[c]) as f32)).collect()
}

fn gains(view: &SurfaceView<'_>, first: &SurfaceView<'_>) -> Option<[f32; 3]> {
    let mut ratios = [(); 3].map(|()| Vec::new());
    for (pixel, other) in correspondences(view, first) {
        let here = view.view.texture.pixel(pixel.0, pixel.1);
        let there = first.view.texture.pixel(other.0 as usize, other.1 as usize);
        for (channel, ratios) in ratios.iter_mut().enumerate() {
            if USABLE_VALUES.contains(&here[channel]) && USABLE_VALUES.contains(&there[channel]) {
                ratios.push(there[channel] / here[channel]);
            }
        }
    }
    let median = |ratios: &mut Vec<f32>| {
        let middle = ratios.len() / 2;
        *ratios.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    ratios.iter().all(|ratios| ratios.len() >= MIN_CORRESPONDENCES).then(|| ratios.each_mut().map(median))
}

/// From this difference on, two photos do not show the same point.
const MAX_DIFFERENCE: f32 = 0.1;
/// Largest amount of sharpening.
const MAX_AMOUNT: f64 = 0.15;
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
    for (pixel, found) in correspondences(other, photo) {
        let (x, y) = (found.0 - 0.5, found.1 - 0.5);
        if !(x >= 1.0 && y >= 1.0 && x < width - 2.0 && y < height - 2.0) {
            continue;
        }
        let shown = other.view.texture.pixel(pixel.0, pixel.1);
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

/// Correspondences are sought at every eighth pixel of every eighth row.
const PIXEL_STEP: usize = 8;
/// Largest difference of the two depths, pixels of parallax of the first photo.
const AGREEMENT_PX: f32 = 2.0;

/// Column and row of a pixel of a photo, and those of the same point in another photo, inside it: pixels, the
/// centre of the first at 0.5.
type Correspondence = ((usize, usize), (f32, f32));

/// Of every eighth pixel of every eighth row, those whose confirmed depth, projected into the other
/// photo, agrees within 2 px (the photo's pixel of parallax) with the confirmed depth of the pixel
/// it falls on.
fn correspondences(view: &SurfaceView<'_>, other: &SurfaceView<'_>) -> Vec<Correspondence> {
    let sweep = PlaneSweep::new(other.view.camera, view.view.camera);
    let (rows, columns) = other.confirmed.disparity.dim();
    let mut found = Vec::new();
    for (y, row) in view.confirmed.disparity.outer_iter().enumerate().step_by(PIXEL_STEP) {
        for x in (0..row.len()).step_by(PIXEL_STEP).filter(|&x| row[x] >= 0.0) {
            let (other_x, other_y, disparity) = project(&sweep, (x, y), row[x]);
            if !(other_x >= 0.0 && other_y >= 0.0 && other_x < columns as f32 && other_y < rows as f32) {
                continue;
            }
            let own = other.confirmed.disparity[(other_y as usize, other_x as usize)];
            if own >= 0.0 && (own - disparity).abs() < AGREEMENT_PX * view.confirmed.disparity_per_pixel {
                found.push(((x, y), (other_x, other_y)));
            }
        }
    }
    found
}

/// Two photos, by their textures' ids.
type Pair = [u64; 2];

/// Σ d (p − s), Σ d² and the number of correspondences.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct DetailSums {
    product: f64,
    pub(crate) square: f64,
    pub(crate) count: usize,
}

/// Statistics of a set of photos whose confirmed depth stays the same.
#[derive(Debug, Clone, Default)]
pub(crate) struct PairStatistics {
    /// Ids of their textures.
    photos: BTreeSet<u64>,
    /// Gains of the first photo that give it the exposure of the second.
    pub(crate) gains: HashMap<Pair, [f32; 3]>,
    /// Missing detail of the first photo by the second, multiplied by gains of these bits.
    pub(crate) sharpness: HashMap<(Pair, [u32; 3]), DetailSums>,
}

impl PairStatistics {
    /// Clears all statistics if they are of another set of photos.
    pub(crate) fn reset_unless_of(&mut self, views: &[SurfaceView<'_>]) {
        let photos: BTreeSet<u64> = views.iter().map(|view| view.view.texture.id()).collect();
        if photos != self.photos {
            *self = Self { photos, ..Self::default() };
        }
    }
}

/// The values of all keys; missing ones are computed, in parallel, and stored.
pub(crate) fn get_or_compute<K: Copy + Eq + Hash + Sync, T: Copy + Send>(
    stored: &mut HashMap<K, T>,
    keys: &[K],
    compute: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let missing: Vec<usize> = (0..keys.len()).filter(|&index| !stored.contains_key(&keys[index])).collect();
    let computed: Vec<T> = missing.par_iter().map(|&index| compute(index)).collect();
    stored.extend(missing.iter().map(|&index| keys[index]).zip(computed));
    keys.iter().map(|key| stored[key]).collect()
}

#[cfg(test)]
mod exposure_tests {
    use super::*;

    #[test]
    fn balanced_weights_by_distance_and_keeps_a_photo_at_the_target() {
        let gains = [[1.0, 1.0, 1.0], [4.0, 1.0, 0.5]];
        let even = balanced(&gains, &[2.0, 2.0]);
        assert!((even[0][0] - 0.5).abs() < 1e-6 && (even[1][0] - 2.0).abs() < 1e-6, "{even:?}");
        assert!((even[0][1] - 1.0).abs() < 1e-6);
        assert_eq!(balanced(&gains, &[0.0, 2.0]), gains);
    }

    #[test]
    fn balanced_weights_are_the_reciprocals_of_the_distances() {
        let found = balanced(&[[1.0; 3], [4.0; 3]], &[1.0, 3.0]);
        let mean = 4_f32.powf(0.25); // shares 3/4 and 1/4
        assert!((found[0][0] - 1.0 / mean).abs() < 1e-6 && (found[1][2] - 4.0 / mean).abs() < 1e-6, "{found:?}");
    }
}

#[cfg(test)]
mod sharpness_tests {
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

#[cfg(test)]
mod pair_statistics_tests {
    use std::sync::atomic::AtomicUsize;
    use std::sync::atomic::Ordering;

    use super::*;

    #[test]
    fn get_or_compute_stored_key_is_not_computed_again() {
        let computed = AtomicUsize::new(0);
        let square = |keys: &[usize], stored: &mut HashMap<usize, usize>| {
            get_or_compute(stored, keys, |index| {
                computed.fetch_add(1, Ordering::Relaxed);
                keys[index] * keys[index]
            })
        };
        let mut stored = HashMap::new();
        assert_eq!(square(&[3, 1, 2], &mut stored), [9, 1, 4]);
        assert_eq!(square(&[2, 4, 3], &mut stored), [4, 16, 9]);
        assert_eq!(computed.into_inner(), 4);
    }
}
