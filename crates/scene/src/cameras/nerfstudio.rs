//! Nerfstudio's camera paths: `{"camera_type": "perspective", "render_width", "render_height",
//! "camera_path": [{"camera_to_world": 16 numbers, row by row, OpenGL axes, "fov": vertical field
//! of view in degrees}, …]}`.
//!
//! The poses are in the axes of nerfstudio's training: those of the scene, rotated, shifted and
//! scaled, or the scene's own if nothing was (`--orientation-method none --center-method none
//! --auto-scale-poses False`).
//!
//! `dataparser_transforms.json`, which nerfstudio writes beside a model's `config.yml`, gives the
//! transform: `x_trained = scale · (transform · x)`, `transform` 3×4. Nerfstudio includes in these
//! two the `applied_transform` (3×4) and `applied_scale` of `transforms.json`, where present (its
//! `nerfstudio_dataparser.py`). For a point of the scene, x_trained = scale / applied_scale ·
//! (transform · applied_transform⁻¹ · x_scene).

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, CameraError, Intrinsics, cam_from_opengl_world};
use serde_json::Value;

use super::camera_json::{CameraFileError, read_json, shown, side, split_matrix};
use super::json_numbers;

const FILE: &str = "dataparser_transforms.json";

/// `x_trained = scale (rotation x_scene + translation)`.
#[derive(Debug)]
pub(super) struct TrainedFromScene {
    rotation: DMat3,
    translation: DVec3,
    scale: f64,
    /// The file that it was read from.
    pub(super) file: PathBuf,
}

impl TrainedFromScene {
    /// Reads the file beside a camera path, or the one in the scene's folder; `None` without
    /// either.
    ///
    /// # Errors
    ///
    /// The file, the field and what was expected.
    pub(super) fn find(path: &Path, scene: &Path) -> Result<Option<Self>, CameraFileError> {
        let mut files = [path.with_file_name(FILE), scene.join(FILE)].into_iter();
        let Some(file) = files.find(|file| file.is_file()) else { return Ok(None) };
        let applied = scene.join("transforms.json");
        let of_scene = if applied.is_file() { read_json(&applied)? } else { Value::Null };
        let given = read_json(&file)?;
        if given.get("transform").is_none() {
            let reason = "expected \"transform\" and \"scale\"".to_owned();
            return Err(CameraFileError { path: file, index: None, reason });
        }
        let refused = |path: &Path, reason| CameraFileError { path: path.to_owned(), index: None, reason };
        let r = similarity(&given, "transform", "scale").map_err(|reason| refused(&file, reason))?;
        let a = similarity(&of_scene, "applied_transform", "applied_scale");
        let a = a.map_err(|reason| refused(&applied, reason))?;
        let rotation = r.0 * a.0.transpose();
        let (scale, translation) = (r.2 / a.2, r.1 - rotation * a.1);
        Ok(Some(Self { rotation, translation, scale, file }))
    }

    /// Converts a camera from the axes of the training to those of the scene.
    pub(super) fn camera(&self, trained: &Camera) -> Result<Camera, CameraError> {
        let centre = self.rotation.transpose() * (trained.centre() / self.scale - self.translation);
        let rotation = trained.rotation() * self.rotation;
        trained.with_pose(rotation, -(rotation * centre))
    }
}

/// Rotation, translation and scale; those of the identity where a key is missing.
fn similarity(of: &Value, matrix: &str, scale: &str) -> Result<(DMat3, DVec3, f64), String> {
    let given = of.get(matrix).map(|given| split_matrix(given, matrix, 3)).transpose()?;
    let (rotation, translation) = given.unwrap_or((DMat3::IDENTITY, DVec3::ZERO));
    let deviation = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
    if !deviation.iter().all(|value| value.abs() < 1e-3) || rotation.determinant() < 0.0 {
        return Err(format!("{matrix}: expected a rotation in its first three columns"));
    }
    let factor = of.get(scale).map_or(Some(1.0), Value::as_f64).filter(|factor| factor.is_finite() && *factor > 0.0);
    let factor = factor.ok_or_else(|| format!("{scale} is {}; expected a number above 0", of[scale]))?;
    Ok((rotation, translation, factor))
}

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
    let matrix: Option<[f64; 16]> = frame.get("camera_to_world").and_then(json_numbers);
    let Some(m) = matrix.filter(|m| m[12..] == [0.0, 0.0, 0.0, 1.0]) else {
        return Err("camera_to_world: expected 16 numbers, the last four being 0 0 0 1".to_owned());
    };
    let column = |i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
    let (rotation, translation) = cam_from_opengl_world(DMat3::from_cols(column(0), column(1), column(2)), column(3));
    let focal = 0.5 * height as f64 / (0.5 * fov).to_radians().tan();
    let k = Intrinsics { fx: focal, fy: focal, cx: 0.5 * width as f64, cy: 0.5 * height as f64, skew: 0.0 };
    Camera::new(k, width, height, rotation, translation).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use serde_json::json;
    use tempfile::tempdir;

    use super::*;

    #[test]
    fn camera_converts_from_trained_axes_to_scene_axes() {
        let root = tempdir().unwrap();
        let (path, scene) = (root.path().join("path.json"), root.path().join("scene"));
        fs::create_dir(&scene).unwrap();
        assert!(TrainedFromScene::find(&path, &scene).unwrap().is_none());
        // A quarter turn about z and a shift, then a scale; before that ns-process-data swapped
        // axes.
        let transform = json!([[0, -1, 0, 0.5], [1, 0, 0, -2], [0, 0, 1, 3]]);
        fs::write(scene.join(FILE), json!({ "transform": transform, "scale": 0.25 }).to_string()).unwrap();
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let trained = |x: DVec3| 0.25 * DVec3::new(-x.y + 0.5, x.x - 2.0, x.z + 3.0);
        let centre = DVec3::new(1.0, 2.0, 3.0);
        let (applied, factor) = (json!([[1, 0, 0, 0.1], [0, 0, 1, 0.2], [0, -1, 0, 0.3]]), 2.0);
        for (of_scene, expected) in [
            (json!({}), centre),
            (json!({ "applied_transform": applied }), DVec3::new(1.1, 3.2, -1.7)),
            // By hand: 0.125 (T x_scene) of nerfstudio's, T = transform · applied_transform⁻¹.
            (json!({ "applied_transform": applied, "applied_scale": factor }), DVec3::new(0.1, 9.2, -3.2)),
            (json!({ "applied_scale": factor }), DVec3::new(0.0, 3.5, 9.0)),
        ] {
            fs::write(scene.join("transforms.json"), of_scene.to_string()).unwrap();
            let axes = TrainedFromScene::find(&path, &scene).unwrap().unwrap();
            let camera = Camera::new(k, 64, 48, DMat3::IDENTITY, -trained(centre)).unwrap();
            let back = axes.camera(&camera).unwrap();
            assert!(back.centre().abs_diff_eq(expected, 1e-12), "{of_scene}: {}", back.centre());
            // Forward is z of the trained axes: z before, y after the swap.
            let forward = if of_scene.get("applied_transform").is_none() { DVec3::Z } else { DVec3::Y };
            assert!(back.forward().abs_diff_eq(forward, 1e-12), "{}", back.forward());
        }
        // The file beside the path takes precedence.
        fs::write(root.path().join(FILE), json!({ "transform": transform }).to_string()).unwrap();
        assert_eq!(TrainedFromScene::find(&path, &scene).unwrap().unwrap().file, root.path().join(FILE));
        for (wrong, word) in [
            (json!({}), "\"transform\" and \"scale\""),
            (json!({ "transform": [[1, 0, 0, 0]] }), "transform"),
            (json!({ "transform": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]] }), "rotation"),
            (json!({ "transform": transform, "scale": 0 }), "scale is 0"),
        ] {
            fs::write(root.path().join(FILE), wrong.to_string()).unwrap();
            let CameraFileError { path: file, reason, .. } = TrainedFromScene::find(&path, &scene).unwrap_err();
            assert!(file.ends_with(FILE) && reason.contains(word), "{reason}");
        }
    }

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
