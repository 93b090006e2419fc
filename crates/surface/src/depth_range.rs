//! The depth range of a scene whose files do not give one: from what small copies of its photos
//! confirm of each other.
//!
//! Photos come in groups of neighbours. The depth of each is searched among the others of its group
//! ([`photo_depth()`]) over the widest range that is possible; what they confirm of it
//! ([`crate::consistency`]) is kept. Of all these disparities, sorted, the range goes from the one at
//! 0.5 % of them to the one at 99.5 % (rounded down to an index), a tenth wider near and 15 % wider
//! far; infinite where that is below 1/10,000 of the nearest, so that a
//! search has planes where there is something (docs/design-log/ordinary-scenes.md).

use rayon::prelude::*;

use crate::consistency::confirmed_by;
use crate::{PhotoDisparity, photo_depth};
use liveview::warp::SourceView;

/// Share of the confirmed disparities left out at either end.
const OUTLIERS: f64 = 0.005;
/// How much wider the range is than the disparities in it: of the nearest and of the farthest.
const MARGINS: (f64, f64) = (1.1, 0.85);
/// Share of the nearest disparity below which the farthest counts as infinity.
const INFINITY: f64 = 1e-4;
/// Confirmed pixels that a range needs, as many as a small photo has in a corner.
const MIN_CONFIRMED: usize = 500;

/// Near and far (scene units; far may be infinite) of photos in groups of neighbours, searched from
/// `near` to `far`; `None` if they confirm too little.
pub fn depth_range(groups: &[Vec<SourceView<'_>>], near: f64, far: f64) -> Option<(f64, f64)> {
    range_of(groups.iter().flat_map(|group| confirmed_disparities(group, near, far)).collect(), (near, far))
}

/// Near and far (scene units) of confirmed disparities (1/scene unit), within the range that was
/// searched; `None` if there are too few.
pub fn range_of(mut disparities: Vec<f32>, (near, far): (f64, f64)) -> Option<(f64, f64)> {
    if disparities.len() < MIN_CONFIRMED {
        return None;
    }
    disparities.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| f64::from(disparities[((disparities.len() - 1) as f64 * share) as usize]);
    let (farthest, nearest) = (at(OUTLIERS) * MARGINS.1, at(1.0 - OUTLIERS) * MARGINS.0);
    let found_far = if farthest < INFINITY * nearest { f64::INFINITY } else { 1.0 / farthest };
    Some((near.max(1.0 / nearest), far.min(found_far))).filter(|(near, far)| near < far)
}

/// The disparities of a group's photos that the others of the group confirm.
fn confirmed_disparities(group: &[SourceView<'_>], near: f64, far: f64) -> Vec<f32> {
    let others = |photo: usize| (0..group.len()).filter(move |&other| other != photo);
    let depth = |photo: usize| {
        let neighbours: Vec<_> = others(photo).map(|other| group[other]).collect();
        photo_depth(&group[photo], &neighbours, near, far)
    };
    let depths: Vec<PhotoDisparity> = (0..group.len()).map(depth).collect();
    let of_photo = |photo: usize| {
        let map = |photo: usize| (group[photo].camera, &depths[photo]);
        let confirmed = confirmed_by(map(photo), others(photo).map(map)).disparity;
        confirmed.into_iter().filter(|&disparity| disparity >= 0.0).collect::<Vec<f32>>()
    };
    (0..group.len()).into_par_iter().flat_map_iter(of_photo).collect()
}
