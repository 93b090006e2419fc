//! RealityCapture's (RealityScan's) "Internal/External camera parameters", a table: centres, and the angles in degrees
//! that turn OpenGL's axes about z, x and y into the world; f for a sensor 36 wide; the principal point from the middle
//! as a fraction of the photo's larger side; Brown's distortion, of which t1 and t2 are OpenCV's p2 and p1.

use glam::{DMat3, DVec3};
use serde_json::Value;

use crate::photos::PhotoLookup;
use crate::scene_file::{Fields, text};
use crate::{DeclaredView, DeclaredViews, Distortion, SceneError, SceneOptions};
use liveview::geometry::{Intrinsics, cam_from_opengl_world};

pub(super) fn views(bytes: &[u8], _: &SceneOptions, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let text = text(path, bytes)?;
    let mut lines = text.lines().enumerate().skip_while(|(_, line)| !line.starts_with("#name"));
    let header = lines.next().map_or("", |(_, line)| line);
    // Newer versions name some columns otherwise.
    let columns = header.split(',').map(|column| match column.trim() {
        "yaw" => "heading",
        other => other.trim_end_matches("_35mm").trim_end_matches("_norm"),
    });
    for (index, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let words = line.split(',').map(|word| Value::from(word.trim()));
        let row = Value::Object(columns.clone().map(str::to_owned).zip(words).collect());
        let place = format!("line {}", index + 1);
        let row = Fields::new(path, &place, &row, None)?;
        let Some(photo) = lookup.find(row.text("#name")?)? else { continue };
        let k = [row.or_zero("k1")?, row.or_zero("k2")?, row.or_zero("k3")?, row.or_zero("k4")?, 0.0, 0.0];
        let p = [row.or_zero("t2")?, row.or_zero("t1")?];
        if k[3] != 0.0 || k[0] != 0.0 && [k[1], k[2], p[0], p[1]] == [0.0; 4] {
            // A division model has k1 alone, and the file does not name the model.
            let hint = "align with the model Brown3, or export undistorted photos with their cameras";
            let what = format!("the lens of {}, of Brown4 or perhaps a division model,", photo.name);
            return Err(SceneError::unsupported(path, what, hint));
        }
        let [width, height] = [photo.size.width, photo.size.height].map(|side| side as f64);
        let side = width.max(height);
        let f = side * row.number("f")? / 36.0;
        let (cx, cy) = (0.5 * width + side * row.or_zero("px")?, 0.5 * height + side * row.or_zero("py")?);
        let angle = |key: &str| row.number(key).map(f64::to_radians);
        let turned = DMat3::from_rotation_z(-angle("heading")?) * DMat3::from_rotation_x(angle("pitch")?);
        let axes = turned * DMat3::from_rotation_y(angle("roll")?);
        let pose = cam_from_opengl_world(axes, DVec3::new(row.number("x")?, row.number("y")?, row.number("alt")?));
        let size = photo.size;
        let view = DeclaredView::new(photo, (Intrinsics { fx: f, fy: f, cx, cy, skew: 0.0 }, size), pose);
        lookup.views.push(DeclaredView { distortion: Distortion { k, p, ..Distortion::default() }, ..view });
    }
    lookup.finish()
}
