//! Guessed pixels of a picture along the surface: those that show a surface which no two photos confirm
//! ([`liveview_surface::Surface::guessed`]). Where they are many, the reason why most of them are, and what helps.

use glam::{DVec2, DVec3};

use crate::{Plan, SceneViews, Shot};
use liveview::geometry::{Camera, PlaneSweep};
use liveview::{Frame, ImageRgb};
use liveview_surface::parallax::is_covered;

/// The share of guessed pixels from which on the reason is given (docs/design-log/view-choice.md).
const MANY: f64 = 0.15;
/// Every so-many-th row and column is looked at.
const STEP: usize = 4;
/// A pixel has no texture if no neighbour at that many pixels differs by more, in [0, 1].
const FLAT: (usize, f32) = (3, 8.0 / 255.0);

/// Why many pixels of a picture are guessed, and what helps; `None` if they are few, or its layers do not
/// follow the surface.
pub fn advice(views: &SceneViews, shot: &Shot, plan: &Plan, frame: &Frame) -> Option<String> {
    let surface = &plan.surface.as_ref().filter(|found| found.surface.guessed_share() >= MANY)?.surface;
    let photos: Vec<usize> = shot.photos().collect();
    let photos: Vec<(&Camera, PlaneSweep)> =
        views.cameras(&photos).map(|camera| (camera, PlaneSweep::new(camera, &shot.target))).collect();
    let picture = frame.picture();
    let [mut unseen, mut flat, mut apart] = [0; 3];
    let (width, height) = (picture.width(), picture.height());
    for (y, x) in (0..height).step_by(STEP).flat_map(|y| (0..width).step_by(STEP).map(move |x| (y, x))) {
        if surface.guessed[(y, x)] {
            let (pixel, disparity) = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5), surface.disparity[(y, x)]);
            let shows = |(camera, sweep): &&(&Camera, PlaneSweep)| is_covered(camera, sweep, pixel, disparity.into());
            let kind = match photos.iter().filter(shows).count() {
                0 | 1 => &mut unseen,
                _ if is_flat(&picture, x, y) => &mut flat,
                _ => &mut apart,
            };
            *kind += 1;
        }
    }
    let most = unseen.max(flat).max(apart);
    Some(if most == unseen {
        "too few photos show it: take more of what lies there".to_owned()
    } else if most == flat {
        "too little texture to tell its depth".to_owned()
    } else {
        let [one, other] = views.names(&opposite(views, shot))[..] else { return None };
        format!("the photos are too far apart: take more from between {one} and {other}")
    })
}

/// Whether a pixel looks like its neighbours.
fn is_flat(picture: &ImageRgb, x: usize, y: usize) -> bool {
    let (reach, most) = FLAT;
    let (right, below) = ((x + reach).min(picture.width() - 1), (y + reach).min(picture.height() - 1));
    let here = picture.pixel(x, y);
    let neighbours = [(x.saturating_sub(reach), y), (right, y), (x, y.saturating_sub(reach)), (x, below)];
    let differs = |(x, y)| picture.pixel(x, y).iter().zip(here).any(|(a, b)| (a - b).abs() > most);
    !neighbours.into_iter().any(differs)
}

/// The nearest view, and the one that lies most on the other side of the target.
fn opposite(views: &SceneViews, shot: &Shot) -> Vec<usize> {
    let centres: Vec<DVec3> =
        views.cameras(&shot.views).map(|camera| (camera.centre() - shot.target.centre()).normalize_or_zero()).collect();
    let cosine = |&view: &usize| centres[view].dot(centres[0]);
    let other = (1..centres.len()).min_by(|a, b| cosine(a).total_cmp(&cosine(b)));
    std::iter::once(0).chain(other).map(|index| shot.views[index]).collect()
}
