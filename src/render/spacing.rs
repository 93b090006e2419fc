//! Parallax between planes, which decides how opaque each of them is ([`Alpha::PerPixel`]).
//!
//! Where planes are a tenth of a pixel apart, ten of them show the same surface, and each should
//! take a tenth of the opacity; where they are a pixel apart, one should take all of it. A network
//! that sees one plane at a time (the paper's) cannot know which. So its logit 0 is that of a plane
//! that is followed by a pixel of parallax, and the odds α/(1 − α) of a plane are multiplied by the
//! pixels to the next one: the logarithm of these pixels is added to logit 0. Volume renderers
//! correct opacity for the distance between samples in the same way (Engel et al., Real-Time Volume
//! Graphics, 2006).
//!
//! [`Alpha::PerPixel`]: crate::network::Alpha::PerPixel

use crate::geometry::parallax::widest_parallax_between;
use crate::geometry::{PlaneSweep, Size};
use crate::layers::{Layer, Layers};

/// Lower limit of the parallax to the next plane, pixels.
const MIN_PARALLAX: f64 = 1e-3;

/// Pixels of parallax from each plane to the next behind it, at most `max_spacing`, on a padded
/// target of that size. It is measured in the view where the two planes are farthest apart, as the
/// median over the target's corners and centre, where both planes are in front of the view. The
/// last plane has the parallax of the one before it, a single plane has `max_spacing`. `None` if
/// some layer is not a plane.
pub(super) fn spacing(sweeps: &[PlaneSweep], size: Size, layers: &Layers, max_spacing: f64) -> Option<Vec<f64>> {
    let disparity = |layer: &Layer| if let Layer::Plane(disparity) = layer { Some(*disparity) } else { None };
    let disparities: Vec<f64> = layers.as_slice().iter().map(disparity).collect::<Option<_>>()?;
    let to_next =
        |pair: &[f64]| widest_parallax_between(sweeps, size, (pair[0], pair[1])).max(MIN_PARALLAX).min(max_spacing);
    let mut found: Vec<f64> = disparities.windows(2).map(to_next).collect();
    found.push(found.last().copied().unwrap_or(max_spacing));
    Some(found)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use ndarray::Array2;

    use super::*;

    const SIZE: Size = Size::new(64, 48);

    /// A view beside the target: a plane moves by 50 pixels per unit of disparity.
    fn beside() -> PlaneSweep {
        PlaneSweep { homography_at_infinity: DMat3::IDENTITY, epipole: DVec3::new(50.0, 0.0, 0.0) }
    }

    fn of(disparities: &[f64]) -> Vec<f64> {
        spacing(&[beside()], SIZE, &Layers::planes(disparities).unwrap(), 3.0).unwrap()
    }

    #[test]
    fn spacing_is_the_parallax_to_the_next_plane_within_limits() {
        let found = of(&[1.0, 0.98, 0.96, 0.5, 0.49, 0.49, 0.48]);
        let expected = [1.0, 1.0, 3.0, 0.5, MIN_PARALLAX, 0.5, 0.5];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn view_with_the_largest_parallax_is_measured() {
        let sweeps = [0.1, 1.0, 0.5].map(|by| PlaneSweep { epipole: by * beside().epipole, ..beside() });
        let planes = Layers::planes(&[0.04, 0.02, 0.0]).unwrap();
        assert_eq!(spacing(&sweeps, SIZE, &planes, 3.0).unwrap(), of(&[0.04, 0.02, 0.0]));
    }

    #[test]
    fn coincident_and_extreme_planes_have_a_spacing() {
        assert_eq!(of(&[0.7]), [3.0]);
        assert_eq!(of(&[0.0, 0.0]), [MIN_PARALLAX; 2]);
        for extreme in [&[f64::from(f32::MAX), 1.0, 0.0][..], &[1e-300, 5e-324, 0.0], &[1.0 + f64::EPSILON, 1.0]] {
            assert!(
                of(extreme).iter().all(|pixels| (MIN_PARALLAX..=3.0).contains(pixels)),
                "{extreme:?}: {:?}",
                of(extreme)
            );
        }
    }

    #[test]
    fn planes_behind_a_view_do_not_change_the_others() {
        // A view 0.5 in front of the target: the plane at disparity 4 is behind it.
        let ahead = PlaneSweep { epipole: DVec3::new(0.0, 0.0, -0.5), ..beside() };
        let of = |disparities: &[f64]| spacing(&[ahead], SIZE, &Layers::planes(disparities).unwrap(), 3.0).unwrap();
        assert_eq!(of(&[4.0, 0.2, 0.19, 0.0]), [MIN_PARALLAX, of(&[0.2, 0.19])[0], 3.0, 3.0]);
        let (near, far) = (of(&[0.9, 0.89])[0], of(&[0.2, 0.19])[0]);
        assert!(near > 2.0 * far && far > 0.1, "{near} {far}");
    }

    #[test]
    fn maps_have_no_spacing() {
        let maps = Layers::maps(vec![Array2::zeros((24, 32))]).unwrap();
        assert_eq!(spacing(&[beside()], SIZE, &maps, 3.0), None);
    }
}
