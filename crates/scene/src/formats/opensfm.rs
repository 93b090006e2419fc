//! OpenSfM's and ODM's `reconstruction.json`, a list of models: `cameras` by name, and by photo `shots`, whose `rotation`
//! (axis times angle in radians) and `translation` are camera from world, OpenCV's axes. Focal lengths and the principal
//! point are fractions of the photo's larger side, the point from the middle (opensfm.org/docs/geometry.html).

use glam::DVec3;
use serde_json::Value;

use crate::photos::PhotoLookup;
use crate::scene_file::{Fields, parse};
use crate::view::rotation_about;
use crate::{DeclaredView, DeclaredViews, Distortion, SceneError, SceneOptions};
use liveview::geometry::Intrinsics;

/// The file in a folder; ODM's is in a folder of its own beside that of the photos.
pub(super) const NAMES: [&str; 2] = ["reconstruction.json", "opensfm/reconstruction.json"];

pub(super) fn views(bytes: &[u8], _: &SceneOptions, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let file = parse(path, bytes)?;
    let models = file.as_array().map_or(&[][..], Vec::as_slice);
    let photos = |model: &&Value| model.get("shots").and_then(Value::as_object).map_or(0, |shots| shots.len());
    let Some(model) = models.iter().max_by_key(photos) else {
        return Err(SceneError::malformed(path, "the file holds no model", "a list of models"));
    };
    if models.len() > 1 {
        lookup.note(format!("of {} models the largest is read, of {} photos", models.len(), photos(&model)));
    }
    let model = Fields::new(path, "the model", model, None)?;
    let (cameras, shots) = (model.object("cameras")?, model.object("shots")?);
    for (name, shot) in shots {
        let shot = Fields::new(path, name, shot, None)?;
        let Some(photo) = lookup.find(name)? else { continue };
        let of = shot.text("camera")?;
        let camera = cameras.get(of).ok_or_else(|| shot.wrong("camera", "the name of one of cameras"))?;
        let camera = Fields::new(path, of, camera, None)?;
        let kind = camera.get("projection_type").and_then(Value::as_str).unwrap_or("perspective");
        if !["perspective", "simple_radial", "radial", "brown", "fisheye", "fisheye_opencv"].contains(&kind) {
            let hint = "export undistorted photos and their cameras: `opensfm undistort`";
            return Err(SceneError::unsupported(path, format!("the lens {kind} of {of}"), hint));
        }
        let fx = camera.optional("focal_x")?.map_or_else(|| camera.number("focal"), Ok)?;
        let fy = camera.optional("focal_y")?.unwrap_or(fx);
        let size = camera.size()?;
        let [width, height] = [size.width, size.height].map(|side| side as f64);
        let side = width.max(height);
        let (cx, cy) = (0.5 * width + side * camera.or_zero("c_x")?, 0.5 * height + side * camera.or_zero("c_y")?);
        let intrinsics = Intrinsics { fx: side * fx, fy: side * fy, cx, cy, skew: 0.0 };
        let k = [camera.or_zero("k1")?, camera.or_zero("k2")?, camera.or_zero("k3")?, camera.or_zero("k4")?, 0.0, 0.0];
        let p = if kind == "brown" { [camera.or_zero("p1")?, camera.or_zero("p2")?] } else { [0.0; 2] };
        let rotation = rotation_about(DVec3::from_array(shot.numbers("rotation")?));
        let pose = (rotation, DVec3::from_array(shot.numbers("translation")?));
        let view = DeclaredView::new(photo, (intrinsics, size), pose);
        lookup.views.push(DeclaredView {
            distortion: Distortion { fisheye: kind.starts_with("fisheye"), division: false, k, p },
            ..view
        });
    }
    lookup.finish()
}
