//! 3D Gaussian Splatting's `cameras.json`, a list of cameras: axes and centre in the world (OpenCV's), focal lengths in
//! pixels of width × height, the principal point in the middle.

use glam::{DMat3, DVec3};
use serde_json::Value;

use crate::photos::PhotoLookup;
use crate::scene_file::{Fields, parse};
use crate::view::seen_from;
use crate::{DeclaredView, DeclaredViews, SceneError, SceneOptions};
use liveview::geometry::Intrinsics;

pub(super) fn views(bytes: &[u8], _: &SceneOptions, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let file = parse(path, bytes)?;
    let cameras =
        file.as_array().ok_or_else(|| SceneError::malformed(path, "the file is no list", "a list of cameras"))?;
    for (index, camera) in cameras.iter().enumerate() {
        let place = format!("[{index}]");
        let camera = Fields::new(path, &place, camera, None)?;
        let Some(photo) = lookup.find(camera.text("img_name")?)? else { continue };
        let size = camera.size()?;
        let (cx, cy) = (0.5 * size.width as f64, 0.5 * size.height as f64);
        let intrinsics = Intrinsics { fx: camera.number("fx")?, fy: camera.number("fy")?, cx, cy, skew: 0.0 };
        let rows: Option<Vec<DVec3>> = camera.get("rotation").and_then(Value::as_array).and_then(|rows| {
            rows.iter().map(|row| crate::cameras::camera_file::json_numbers(row).map(DVec3::from_array)).collect()
        });
        let Some(&[x, y, z]) = rows.as_deref() else { return Err(camera.wrong("rotation", "3 rows of 3 numbers")) };
        let pose = seen_from(DMat3::from_rows(x, y, z), DVec3::from_array(camera.numbers("position")?));
        lookup.views.push(DeclaredView::new(photo, (intrinsics, size), pose));
    }
    lookup.finish()
}
