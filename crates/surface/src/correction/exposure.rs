//! Gains that bring photos of different exposure or white balance to a common exposure between
//! theirs: a factor per colour channel.
//!
//! Over the photo's correspondences with the first photo ([`super::correspondences`]) whose channel
//! lies in \[0.05, 0.95\] in both, the gain is the (upper) median of the first photo's value over
//! the photo's. With fewer than 100 correspondences in any channel all gains of that photo are 1.
//!
//! These gains give all photos the exposure of the first. The exposure of a camera at the target is
//! unknown; the weighted geometric mean of the photos' exposures is the estimate that scores best
//! and that changes smoothly along a path: gain i becomes gᵢ / Π gⱼ^wⱼ with wⱼ the share of photo j
//! in Σ 1/dⱼ, dⱼ its distance from the target (1 for a photo at the target).

use super::correspondences::{Correspondence, correspondences};
use super::pair_statistics::{PairStatistics, get_or_compute};
use crate::fusion::SurfaceView;

/// Values that are neither dominated by noise nor clipped.
const USABLE_VALUES: std::ops::RangeInclusive<f32> = 0.05..=0.95;
/// Fewest correspondences that give a gain.
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
    for Correspondence { pixel, other } in correspondences(view, first) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balanced_weights_by_distance_and_keeps_a_photo_at_the_target() {
        let gains = [[1.0, 1.0, 1.0], [4.0, 1.0, 0.5]];
        let even = balanced(&gains, &[2.0, 2.0]);
        assert!((even[0][0] - 0.5).abs() < 1e-6 && (even[1][0] - 2.0).abs() < 1e-6, "{even:?}");
        assert!((even[0][1] - 1.0).abs() < 1e-6);
        assert_eq!(balanced(&gains, &[0.0, 2.0]), gains);
    }
}
