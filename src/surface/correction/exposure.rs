//! Gains that bring photos of different exposure or white balance to one that lies between theirs: a factor per colour channel.
//!
//! Over the photo's correspondences with the first one ([`super::correspondences`]) whose channel lies in \[0.05, 0.95\] in both
//! photos, the gain is the (upper) median of the first photo's value over the photo's. With fewer than 100 of them in any channel
//! all gains of that photo are 1.
//!
//! So far all photos have become like the first. What a camera at the target would have seen is unknown; the weighted geometric
//! mean of the photos' exposures is the guess that scores best and that changes smoothly along a path: gain i becomes
//! gᵢ / Π gⱼ^wⱼ with wⱼ the share of photo j in Σ 1/dⱼ, dⱼ its distance from the target (where a photo is at the target: all of it).

use super::correspondences::{Correspondence, correspondences};
use super::pair_statistics::{PairStatistics, kept_or};
use crate::surface::fusion::SurfaceView;

/// Values that are neither lost in noise nor clipped.
const USABLE: std::ops::RangeInclusive<f32> = 0.05..=0.95;
/// Fewest correspondences that a gain is told from.
const ENOUGH: usize = 100;

/// Gains of each view, by channel; `distances` are those of the views from the target, scene units.
pub fn exposure_gains(views: &[SurfaceView<'_>], distances: &[f64]) -> Vec<[f32; 3]> {
    balanced(&gains_to_first(views, &mut PairStatistics::default()), distances)
}

/// Gains of each view that make it like the first.
pub(crate) fn gains_to_first(views: &[SurfaceView<'_>], statistics: &mut PairStatistics) -> Vec<[f32; 3]> {
    let Some((first, others)) = views.split_first() else { return Vec::new() };
    let pairs: Vec<_> = others.iter().map(|view| [view.view.texture.id(), first.view.texture.id()]).collect();
    let like_first = |index: usize| gains(&others[index], first).unwrap_or([1.0; 3]);
    let mut all = vec![[1.0; 3]];
    all.extend(kept_or(&mut statistics.gains, &pairs, like_first));
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
            if USABLE.contains(&here[channel]) && USABLE.contains(&there[channel]) {
                ratios.push(there[channel] / here[channel]);
            }
        }
    }
    let median = |ratios: &mut Vec<f32>| {
        let middle = ratios.len() / 2;
        *ratios.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    ratios.iter().all(|ratios| ratios.len() >= ENOUGH).then(|| ratios.each_mut().map(median))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_balanced_by_nearness_and_a_photo_at_the_target_keeps_its_own() {
        let gains = [[1.0, 1.0, 1.0], [4.0, 1.0, 0.5]];
        let even = balanced(&gains, &[2.0, 2.0]);
        assert!((even[0][0] - 0.5).abs() < 1e-6 && (even[1][0] - 2.0).abs() < 1e-6, "{even:?}");
        assert!((even[0][1] - 1.0).abs() < 1e-6);
        assert_eq!(balanced(&gains, &[0.0, 2.0]), gains);
    }
}
