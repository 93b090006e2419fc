//! Per-view occlusion of samples: a view sees a point unless the view's own depth, at the pixel
//! that the point projects to, is nearer by a margin.
//!
//! Computed together with the samples, from the same positions (docs/design-log/speed.md, "Along a
//! path").

use super::run::{ALL_SEEN, RUN};
use super::sample_positions::SamplePositions;

/// A view's own depth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OwnDepth<'a> {
    /// Disparity of each pixel of its photo, 1/scene unit; below 0 where it is unknown.
    pub(crate) disparity: &'a [f32],
    /// How much nearer than a point it must be to hide the point, 1/scene unit.
    pub(crate) margin: f32,
}

impl OwnDepth<'_> {
    /// Which points of a run the view sees, by bit; located with `PIXELS` ([`SamplePositions::locate`]).
    #[inline(always)]
    pub(super) fn seen(&self, points: &SamplePositions) -> u64 {
        let mut own = [-1.0; RUN];
        for (own, &pixel) in own.iter_mut().zip(&points.pixel) {
            *own = self.disparity.get(pixel as usize).copied().unwrap_or(-1.0);
        }
        let hidden = |i: usize| own[i] - points.disparity[i] >= self.margin;
        if !(0..RUN).fold(false, |any, i| any | hidden(i)) {
            return ALL_SEEN;
        }
        (0..RUN).fold(ALL_SEEN, |seen, i| seen & !(u64::from(hidden(i)) << i))
    }
}
