//! Tiles that a neighbour does not see: they cost what an unseen cell costs, without samples.

use std::ops::Range;

use glam::{DVec2, DVec3};

use crate::geometry::PlaneSweep;
use crate::warp::WarpSource;

/// Distance from the neighbour's photo from which on a position is outside, pixels: a sample half a
/// pixel outside has a share of the photo, and positions are rounded by some millionths.
const MARGIN: f64 = 1.0;

/// Whether the neighbour sees none of these columns and rows at any disparity from one to the
/// other (1/scene unit). The corners lie in front of it and beyond the same side of its photo; so
/// do all points between them. May be false where it sees none.
#[inline(always)]
pub(super) fn is_unseen(
    neighbour: &WarpSource<'_>,
    columns: &Range<usize>,
    rows: &Range<usize>,
    disparities: [f32; 2],
) -> bool {
    let PlaneSweep { homography_at_infinity: homography, epipole } = neighbour.sweep;
    let (mut least, mut most) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for column in [columns.start, columns.end] {
        for row in [rows.start, rows.end] {
            let corner = homography * DVec3::new(column as f64, row as f64, 1.0);
            for disparity in disparities {
                let at = corner + epipole * f64::from(disparity);
                if at.z <= 0.0 || at.z.is_nan() {
                    return false;
                }
                let at = DVec2::new(at.x / at.z, at.y / at.z);
                (least, most) = (least.min(at), most.max(at));
            }
        }
    }
    let (width, height) = (neighbour.texture.width() as f64, neighbour.texture.height() as f64);
    most.x < -MARGIN || most.y < -MARGIN || least.x > width + MARGIN || least.y > height + MARGIN
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::image::ImageRgb;
    use crate::warp::Texture;

    #[test]
    fn only_what_lies_beyond_one_side_at_all_disparities_is_unseen() {
        let texture = Texture::new(&ImageRgb::new(40, 30, vec![0.5; 3 * 40 * 30]).unwrap());
        let sweep = |homography, epipole| PlaneSweep { homography_at_infinity: homography, epipole };
        let unseen = |homography, epipole, disparities| {
            is_unseen(&WarpSource::new(&texture, sweep(homography, epipole)), &(0..20), &(0..10), disparities)
        };
        for (x, y) in [(100.0, 0.0), (-100.0, 0.0), (0.0, 100.0), (0.0, -100.0)] {
            let epipole = DVec3::new(x, y, 0.0);
            assert!(unseen(DMat3::IDENTITY, epipole, [0.5, 0.5]), "{x} {y}");
            assert!(!unseen(DMat3::IDENTITY, epipole, [0.01, 0.5]), "{x} {y}: seen at one end");
        }
        // Beyond the left side at one end and the right side at the other: seen between.
        let shifted = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -60.0, 0.0, 1.0]);
        assert!(!unseen(shifted, DVec3::X, [0.0, 200.0]));
        assert!(unseen(shifted, DVec3::X, [0.0, 10.0]));
        // Half a pixel outside is in reach of a sample.
        assert!(!unseen(DMat3::IDENTITY, DVec3::X, [40.5, 40.5]));
        assert!(unseen(DMat3::IDENTITY, DVec3::X, [41.5, 41.5]));
        // Behind the neighbour, or partly so.
        let behind = DMat3::from_cols_array(&[1.0, 0.0, 0.1, 0.0, 1.0, 0.0, -60.0, 0.0, -1.0]);
        assert!(!unseen(behind, DVec3::ZERO, [0.0, 0.0]));
        assert!(!unseen(DMat3::IDENTITY, DVec3::NAN, [1.0, 1.0]));
    }
}
