//! Extreme cameras and planes: a target and one view, with one quantity varied at a time.

use std::borrow::Cow;

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics};
use liveview::image::ImageRgb;

use super::case::{Case, decades};
use super::warp::{BOUND, WarpCase};

/// The rig that the cases are derived from: a target, one view, and the depth of the scene.
pub(crate) struct TestRig {
    pub(crate) photo: ImageRgb,
    pub(crate) source: Camera,
    pub(crate) target: Camera,
    /// Depth of a plane in the middle of the scene, scene units.
    pub(crate) depth: f64,
    /// Distances of all views' centres to the target's, nearest first, scene units.
    pub(crate) distances: Vec<f64>,
}

/// The parameters of a camera, not validated yet.
#[derive(Clone, Copy)]
struct Parts {
    intrinsics: Intrinsics,
    size: (usize, usize),
    rotation: DMat3,
    /// In the world, scene units.
    centre: DVec3,
}

impl Parts {
    fn of(camera: &Camera) -> Self {
        let size = (camera.width(), camera.height());
        Self { intrinsics: camera.intrinsics(), size, rotation: camera.rotation(), centre: camera.centre() }
    }

    fn focal(&mut self, factor: f64) {
        self.intrinsics.fx *= factor;
        self.intrinsics.fy *= factor;
    }

    /// Moves the principal point to the centre of a pixel in the middle of the picture.
    fn centred(&mut self) {
        self.intrinsics.cx = (self.size.0 / 2) as f64 + 0.5;
        self.intrinsics.cy = (self.size.1 / 2) as f64 + 0.5;
    }

    /// Turns the camera to the right, radians.
    fn turn(&mut self, angle: f64) {
        self.rotation = DMat3::from_rotation_y(-angle) * self.rotation;
    }
}

/// The cameras and the depth of a case.
struct VariedCase {
    source: Parts,
    target: Parts,
    depth: f64,
}

impl TestRig {
    fn case<'a>(&'a self, change: impl FnOnce(&mut VariedCase)) -> WarpCase<'a> {
        let mut varied =
            VariedCase { source: Parts::of(&self.source), target: Parts::of(&self.target), depth: self.depth };
        change(&mut varied);
        let camera = |parts: Parts| {
            let Parts { intrinsics, size, rotation, centre } = parts;
            Camera::new(intrinsics, size.0, size.1, rotation, -(rotation * centre))
        };
        WarpCase {
            photo: Cow::Borrowed(&self.photo),
            source: camera(varied.source),
            target: camera(varied.target),
            disparity: 1.0 / varied.depth,
            covers_nothing: false,
            equivalent_rig: None,
            well_conditioned: None,
        }
    }

    /// Gives the source the target's rotation, and moves it from the target by `offset`, in the target's axes and in units of the
    /// depth. Both principal points are on the centre of a pixel.
    fn aligned(&self, varied: &mut VariedCase, offset: DVec3) {
        varied.target.centred();
        varied.source.centred();
        varied.source.rotation = self.target.rotation();
        varied.source.centre = varied.target.centre + self.target.rotation().transpose() * offset * self.depth;
    }
}

/// A family of warps.
fn family<'a>(
    name: &'static str,
    extremes: impl IntoIterator<Item = f64>,
    case: impl Fn(f64) -> WarpCase<'a>,
) -> Vec<Case<'a>> {
    let case = |extreme: f64| Case::new(name, extreme, format!("{extreme:.0e}"), case(extreme), BOUND);
    extremes.into_iter().map(case).collect()
}

pub(super) fn families(rig: &TestRig) -> Vec<Vec<Case<'_>>> {
    // Behind the target: the source covers the plane at any depth and any baseline.
    let behind = DVec3::new(0.02, -0.01, -0.3);
    let depth = |times: f64| {
        rig.case(|varied| {
            rig.aligned(varied, behind);
            varied.depth *= times;
        })
    };
    let baseline = |times: f64| rig.case(|varied| rig.aligned(varied, behind * times));
    // The longer the focal length, the smaller the offset and the rotation, so that the source covers as much.
    let focal = |factor: f64| {
        rig.case(|varied| {
            rig.aligned(varied, DVec3::new(0.05, -0.02, 0.0) / factor);
            [&mut varied.source, &mut varied.target].into_iter().for_each(|camera| camera.focal(factor));
            varied.source.turn(0.05 / f64::max(factor, 1.0));
        })
    };
    // Offset along the common optical axis, which any focal length covers.
    let source_focal = |factor: f64| {
        rig.case(|varied| {
            rig.aligned(varied, DVec3::new(0.0, 0.0, -0.3));
            varied.source.focal(factor);
        })
    };
    // The point in the middle of the picture is at (gap / 10, 0, gap) in the source: covered however near it is.
    let through_centre = |gap: f64| {
        let case = rig.case(|varied| rig.aligned(varied, DVec3::new(-0.1 * gap, 0.0, 1.0 - gap)));
        WarpCase { covers_nothing: gap == 0.0, ..case }
    };
    let turned = |angle: f64, wider: f64| {
        rig.case(|varied| {
            rig.aligned(varied, DVec3::new(0.05, -0.02, 0.03));
            varied.source.focal(wider);
            varied.source.turn(angle);
        })
    };
    let away = |from: f64| WarpCase { covers_nothing: true, ..turned(std::f64::consts::PI - from, 1.0) };
    // The source looks along the plane, from this distance beside the point in the middle of the picture: w changes its sign there.
    let edge_on = |gap: f64| {
        rig.case(|varied| {
            rig.aligned(varied, DVec3::new(-gap, 0.0, 1.0));
            varied.source.turn(std::f64::consts::FRAC_PI_2);
        })
    };
    // Skew does not move the row in the middle of the picture, at the height of both cameras.
    let skew = |times: f64| {
        rig.case(|varied| {
            rig.aligned(varied, DVec3::new(0.05, 0.0, 0.0));
            varied.source.intrinsics.skew = times * varied.source.intrinsics.fx;
        })
    };
    // A picture far off its camera's optical axis; the camera is turned so that it covers what the target shows.
    let principal_point = |pixels: f64| {
        rig.case(|varied| {
            rig.aligned(varied, DVec3::new(0.0, 0.0, -0.3));
            varied.source.turn((pixels / varied.source.intrinsics.fx).atan());
            varied.source.intrinsics.cx += pixels;
        })
    };
    let unit = |factor: f64| {
        let scaled = rig.case(|varied| {
            [&mut varied.source, &mut varied.target].into_iter().for_each(|camera| camera.centre *= factor);
            varied.depth *= factor;
        });
        WarpCase { equivalent_rig: Some(Box::new(rig.case(|_| ()))), ..scaled }
    };
    let powers = (-6..=6).map(|step| 2f64.powi(20 * step));
    let origin = |away: f64| {
        let moved = rig.case(|varied| {
            let by = DVec3::new(0.6, -0.48, 0.64) * away * rig.depth;
            [&mut varied.source, &mut varied.target].into_iter().for_each(|camera| camera.centre += by);
        });
        WarpCase { well_conditioned: Some(Box::new(rig.case(|_| ()))), ..moved }
    };
    // The rounding error of float64 positions this far from the origin, in pixels by the focal length.
    let pose_pixels =
        |away: f64| 8.0 * f64::EPSILON * away * rig.target.intrinsics().fx.max(rig.source.intrinsics().fx);
    let to_infinity = |from, to| decades(from..=to).chain([f64::INFINITY]);
    vec![
        family("depth", to_infinity(-6, 9), depth),
        family("focal length", decades(-6..=6), focal),
        family("source's focal length", decades(-6..=6), source_focal),
        family("plane near a source centre", decades(-15..=0).chain([0.0]), through_centre),
        // At smaller gaps, float64 does not determine the position in the photo either.
        family("plane seen edge-on", decades(-10..=0), edge_on),
        family("vanishing line, before 90°", decades(-3..=0), |from| {
            turned(std::f64::consts::FRAC_PI_2 - from, 0.125)
        }),
        family("vanishing line, beyond 90°", decades(-3..=-1), |from| {
            turned(std::f64::consts::FRAC_PI_2 + from, 0.125)
        }),
        family("facing away", [1.0, 1e-3, 0.0], away),
        family("baseline", decades(-16..=9), baseline),
        family("skew", decades(-6..=6), skew),
        family("far principal point", decades(0..=7), principal_point),
        family("scene unit", powers, unit)
            .into_iter()
            .map(|case| Case { name: format!("2^{}", case.extreme.log2()), ..case })
            .collect(),
        // Ten times further, a last bit of the positions in float64 is more than a step of an 8-bit photo (1/256): no useful bound.
        family("far from the origin", decades(0..=10), origin)
            .into_iter()
            .map(|case| Case { bound: BOUND.max(pose_pixels(case.extreme)), ..case })
            .collect(),
    ]
}
