//! Nerfstudio's camera paths: `{"camera_type": "perspective", "render_width", "render_height",
//! "camera_path": [{"camera_to_world": 16 numbers, row by row, OpenGL axes, "fov": vertical field
//! of view in degrees}, …]}`.
//!
//! The poses are in the axes of nerfstudio's training ([`super::nerfstudio_axes`]). These are the
//! scene's own if nothing was rotated, shifted or scaled (`--orientation-method none
//! --center-method none --auto-scale-poses False`).

use glam::{DMat3, DVec3};
use serde_json::Value;

use super::camera::{Camera, Intrinsics};
use super::pose::cam_from_opengl_world;

/// The frames of a path, if the file is one.
pub(super) fn frames(file: &Value) -> Option<&Vec<Value>> {
    file.get("camera_path")?.as_array()
}

/// The camera of one of the frames of a path.
pub(super) fn camera(file: &Value, frame: &Value) -> Result<Camera, String> {
    if let Some(kind) = file.get("camera_type").filter(|kind| *kind != "perspective") {
        return Err(format!("camera_type is {kind}; expected \"perspective\""));
    }
    let [width, height] = [side(file, "render_width")?, side(file, "render_height")?];
    let fov = frame.get("fov").and_then(Value::as_f64).filter(|fov| (0.0..180.0).contains(fov) && *fov > 0.0);
    let fov = fov.ok_or_else(|| format!("fov is {}; expected degrees above 0 and below 180", shown(frame, "fov")))?;
    let numbers = frame.get("camera_to_world").and_then(Value::as_array);
    let numbers: Option<Vec<f64>> = numbers.and_then(|list| list.iter().map(Value::as_f64).collect());
    let matrix: Option<[f64; 16]> = numbers.and_then(|list| list.try_into().ok());
    let Some(m) = matrix.filter(|m| m[12..] == [0.0, 0.0, 0.0, 1.0]) else {
        return Err("camera_to_world: expected 16 numbers, the last four being 0 0 0 1".to_owned());
    };
    let column = |i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
    let (rotation, translation) = cam_from_opengl_world(DMat3::from_cols(column(0), column(1), column(2)), column(3));
    let focal = 0.5 * height as f64 / (0.5 * fov).to_radians().tan();
    let k = Intrinsics { fx: focal, fy: focal, cx: 0.5 * width as f64, cy: 0.5 * height as f64, skew: 0.0 };
    Camera::new(k, width, height, rotation, translation).map_err(|error| error.to_string())
}

fn side(file: &Value, key: &str) -> Result<usize, String> {
    let side = file.get(key).and_then(Value::as_f64).filter(|side| side.fract() == 0.0 && (1.0..=1e6).contains(side));
    Ok(side.ok_or_else(|| format!("{key} is {}; expected a whole number of pixels", shown(file, key)))? as usize)
}

fn shown(of: &Value, key: &str) -> String {
    of.get(key).map_or_else(|| "missing".to_owned(), Value::to_string)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn camera_has_the_pose_and_intrinsics_of_the_frame() {
        // At (1, 2, 3), rotated by 90 degrees about y: it faces -x.
        let frame = json!({
            "camera_to_world": [0, 0, 1, 1, 0, 1, 0, 2, -1, 0, 0, 3, 0, 0, 0, 1], "fov": 90, "aspect": 2
        });
        let file =
            json!({ "camera_type": "perspective", "render_width": 64, "render_height": 32, "camera_path": [frame] });
        let camera = camera(&file, &frames(&file).unwrap()[0]).unwrap();
        assert!(camera.centre().abs_diff_eq(DVec3::new(1.0, 2.0, 3.0), 1e-12));
        assert!(camera.forward().abs_diff_eq(-DVec3::X, 1e-12), "{}", camera.forward());
        let Intrinsics { fx, fy, cx, cy, .. } = camera.intrinsics();
        // A vertical field of view of 90 degrees.
        assert!((fx - 16.0).abs() < 1e-9 && fy == fx && (cx, cy) == (32.0, 16.0));
        for (key, value, word) in [
            ("fov", json!(180), "below 180"),
            ("fov", json!("wide"), "below 180"),
            ("camera_to_world", json!([1, 2]), "16 numbers"),
        ] {
            let mut wrong = file["camera_path"][0].clone();
            wrong[key] = value;
            let error = self::camera(&file, &wrong).unwrap_err();
            assert!(error.contains(key) && error.contains(word), "{error}");
        }
        for (key, value) in
            [("camera_type", json!("fisheye")), ("render_width", json!(0)), ("render_height", json!(null))]
        {
            let mut wrong = file.clone();
            wrong[key] = value;
            let error = self::camera(&wrong, &file["camera_path"][0]).unwrap_err();
            assert!(error.contains(key), "{error}");
        }
    }
}
