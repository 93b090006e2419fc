//! Extreme cameras and planes: a target and one view of it, one thing swept at a time.

use std::borrow::Cow;

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics};
use liveview::image::ImageRgb;

use super::case::{Case, decades};
use super::warp::{BOUND, WarpCase};

/// What the cases start from: a target, one view of it, and how far the things are that they see.
pub(crate) struct TestRig {
    pub(crate) photo: ImageRgb,
    pub(crate) source: Camera,
    pub(crate) target: Camera,
    /// Of a plane amid the scene, scene units.
    pub(crate) depth: f64,
    /// Of all views' centres to the target's, nearest first, scene units.
    pub(crate) distances: Vec<f64>,
}

/// A camera that may turn out to be none.
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

    /// With its principal point on the centre of a pixel amid the picture.
    fn centred(&mut self) {
        self.intrinsics.cx = (self.size.0 / 2) as f64 + 0.5;
        self.intrinsics.cy = (self.size.1 / 2) as f64 + 0.5;
    }

    /// Turned to the right, radians.
    fn turn(&mut self, angle: f64) {
        self.rotation = DMat3::from_rotation_y(-angle) * self.rotation;
    }
}

/// What is swept, before it becomes a case.
struct Swept {
    source: Parts,
    target: Parts,
    depth: f64,
}

impl TestRig {
    fn case<'a>(&'a self, change: impl FnOnce(&mut Swept)) -> WarpCase<'a> {
        let mut swept = Swept { source: Parts::of(&self.source), target: Parts::of(&self.target), depth: self.depth };
        change(&mut swept);
        let camera = |parts: Parts| {
            let Parts { intrinsics, size, rotation, centre } = parts;
            Camera::new(intrinsics, size.0, size.1, rotation, -(rotation * centre))
        };
        WarpCase {
            photo: Cow::Borrowed(&self.photo),
            source: camera(swept.source),
            target: camera(swept.target),
            disparity: 1.0 / swept.depth,
            nothing_seen: false,
            same_as: None,
            meant: None,
        }
    }

    /// The source turned as the target is, and moved from it by `offset`, in the target's axes and units of the depth; the
    /// target's principal point on the centre of a pixel.
    fn aligned(&self, swept: &mut Swept, offset: DVec3) {
        swept.target.centred();
        swept.source.centred();
        swept.source.rotation = self.target.rotation();
        swept.source.centre = swept.target.centre + self.target.rotation().transpose() * offset * self.depth;
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
    // Behind the target, so that however near things are, and however long the baseline, the source sees them.
    let behind = DVec3::new(0.02, -0.01, -0.3);
    let depth = |times: f64| {
        rig.case(|swept| {
            rig.aligned(swept, behind);
            swept.depth *= times;
        })
    };
    let baseline = |times: f64| rig.case(|swept| rig.aligned(swept, behind * times));
    // The longer the lens, the less aside and the less turned, so that as much is seen.
    let focal = |factor: f64| {
        rig.case(|swept| {
            rig.aligned(swept, DVec3::new(0.05, -0.02, 0.0) / factor);
            [&mut swept.source, &mut swept.target].into_iter().for_each(|camera| camera.focal(factor));
            swept.source.turn(0.05 / f64::max(factor, 1.0));
        })
    };
    // Along the axis that both share, which is seen through any lens.
    let source_focal = |factor: f64| {
        rig.case(|swept| {
            rig.aligned(swept, DVec3::new(0.0, 0.0, -0.3));
            swept.source.focal(factor);
        })
    };
    // The point amid the picture is at (gap / 10, 0, gap) from the source: seen however near it is.
    let through_centre = |gap: f64| {
        let case = rig.case(|swept| rig.aligned(swept, DVec3::new(-0.1 * gap, 0.0, 1.0 - gap)));
        WarpCase { nothing_seen: gap == 0.0, ..case }
    };
    let turned = |angle: f64, wider: f64| {
        rig.case(|swept| {
            rig.aligned(swept, DVec3::new(0.05, -0.02, 0.03));
            swept.source.focal(wider);
            swept.source.turn(angle);
        })
    };
    let away = |from: f64| WarpCase { nothing_seen: true, ..turned(std::f64::consts::PI - from, 1.0) };
    // The source looks along the plane, from this far beside the point amid the picture: w changes its sign there.
    let edge_on = |gap: f64| {
        rig.case(|swept| {
            rig.aligned(swept, DVec3::new(-gap, 0.0, 1.0));
            swept.source.turn(std::f64::consts::FRAC_PI_2);
        })
    };
    // The row amid the picture, at the height of both cameras, is not moved by it.
    let skew = |times: f64| {
        rig.case(|swept| {
            rig.aligned(swept, DVec3::new(0.05, 0.0, 0.0));
            swept.source.intrinsics.skew = times * swept.source.intrinsics.fx;
        })
    };
    // A picture far beside its camera's axis, which is turned so that it shows what the target sees.
    let principal_point = |pixels: f64| {
        rig.case(|swept| {
            rig.aligned(swept, DVec3::new(0.0, 0.0, -0.3));
            swept.source.turn((pixels / swept.source.intrinsics.fx).atan());
            swept.source.intrinsics.cx += pixels;
        })
    };
    let unit = |factor: f64| {
        let scaled = rig.case(|swept| {
            [&mut swept.source, &mut swept.target].into_iter().for_each(|camera| camera.centre *= factor);
            swept.depth *= factor;
        });
        WarpCase { same_as: Some(Box::new(rig.case(|_| ()))), ..scaled }
    };
    let powers = (-6..=6).map(|step| 2f64.powi(20 * step));
    let origin = |away: f64| {
        let moved = rig.case(|swept| {
            let by = DVec3::new(0.6, -0.48, 0.64) * away * rig.depth;
            [&mut swept.source, &mut swept.target].into_iter().for_each(|camera| camera.centre += by);
        });
        WarpCase { meant: Some(Box::new(rig.case(|_| ()))), ..moved }
    };
    // Poses are float64 translations: places this far from the origin are known to so much, which a focal length turns into pixels.
    let pose_pixels =
        |away: f64| 8.0 * f64::EPSILON * away * rig.target.intrinsics().fx.max(rig.source.intrinsics().fx);
    let to_infinity = |from, to| decades(from..=to).chain([f64::INFINITY]);
    vec![
        family("depth", to_infinity(-6, 9), depth),
        family("focal length", decades(-6..=6), focal),
        family("source's focal length", decades(-6..=6), source_focal),
        family("plane near a source centre", decades(-15..=0).chain([0.0]), through_centre),
        // Nearer than this, float64 does not tell either where in the photo the point lies.
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
        family("far from the origin", decades(0..=12), origin)
            .into_iter()
            .map(|case| Case { bound: BOUND.max(pose_pixels(case.extreme)), ..case })
            .collect(),
    ]
}
