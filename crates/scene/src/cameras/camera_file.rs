//! Cameras from a JSON file.
//!
//! A camera is an object `{"transform_matrix": 4x4 world from camera, OpenGL axes}` or
//! `{"cam_from_world": 3x4 or 4x4, OpenCV axes}`, with `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`
//! (pixels) where they differ from those of the nearest view, w and h together. The file contains
//! one such object or a list of them, a `transforms.json`, or a camera path of nerfstudio's viewer.
//!
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
use serde_json::Value;

use liveview::geometry::{
    Camera, CameraError, Intrinsics, cam_from_opengl_world, nearest_camera, rotation_and_translation,
};
use liveview_files::bounded;

/// The cameras of a file.
#[derive(Debug)]
pub struct CameraFile {
    /// In the order of the file.
    pub cameras: Vec<Camera>,
    /// For a path of nerfstudio's viewer: which axes its poses are assumed to have.
    pub note: Option<String>,
}

/// Reads all cameras of the file. Missing fields are those of the nearest of the `views`. Poses of
/// nerfstudio's viewer are converted from the axes of its training to those of the scene if its
/// `dataparser_transforms.json` is beside the file or in the scene's folder.
///
/// # Errors
///
/// The file, the camera and the field, and what was expected.
///
/// # Panics
///
/// If there are no views.
pub fn read_cameras(path: &Path, views: &[&Camera], scene: &Path) -> Result<CameraFile, String> {
    let file = read_json(path)?;
    let path_frames = file.get("camera_path").and_then(Value::as_array);
    let frames = file.get("frames").and_then(Value::as_array);
    let list = path_frames.or(frames).or(file.as_array());
    let entries = list.map_or_else(|| std::slice::from_ref(&file), Vec::as_slice);
    if entries.is_empty() {
        return Err(format!("{}: the list of cameras is empty; expected at least one", path.display()));
    }
    let axes = path_frames.map(|_| TrainedFromScene::find(path, scene)).transpose()?;
    let read = |entry| match &axes {
        None if frames.is_some() => camera_of_frame(&file, entry, views),
        None => camera_from_json(entry, views),
        Some(None) => nerfstudio_camera(&file, entry),
        Some(Some(axes)) => axes.camera(&nerfstudio_camera(&file, entry)?).map_err(|error| error.to_string()),
    };
    let place = |at: usize| {
        if list.is_some() { format!("{}: camera {at}", path.display()) } else { path.display().to_string() }
    };
    let cameras =
        entries.iter().enumerate().map(|(at, entry)| read(entry).map_err(|reason| format!("{}: {reason}", place(at))));
    let cameras = cameras.collect::<Result<_, _>>()?;
    let note = axes.map(|axes| match axes {
        Some(axes) => format!("converted from nerfstudio's axes to the scene's by {}", axes.file.display()),
        None => "assumed to be in the scene's own axes; if nerfstudio rotated, shifted or scaled the scene, put its \
                 dataparser_transforms.json (beside the model's config.yml) beside this file or in the scene's folder"
            .to_owned(),
    });
    let note = note.map(|note| format!("{}: {note}", path.display()));
    Ok(CameraFile { cameras, note })
}

/// Keys of a camera.
const KEYS: [&str; 8] = ["transform_matrix", "cam_from_world", "fl_x", "fl_y", "cx", "cy", "w", "h"];

/// One camera in the format of such a file. Missing fields are those of the nearest of the `views`.
///
/// # Errors
///
/// The field, and what was expected.
///
/// # Panics
///
/// If there are no views.
pub fn camera_from_json(entry: &Value, views: &[&Camera]) -> Result<Camera, String> {
    let mut keys = entry.as_object().into_iter().flat_map(|entry| entry.keys());
    if let Some(unknown) = keys.find(|key| !KEYS.contains(&key.as_str())) {
        return Err(format!("unknown key \"{unknown}\"; expected {}", KEYS.join(", ")));
    }
    if entry.get("w").is_some() != entry.get("h").is_some() {
        return Err("one of w and h is given; expected both or neither".to_owned());
    }
    let (rotation, translation) = match (entry.get("transform_matrix"), entry.get("cam_from_world")) {
        (Some(matrix), None) => {
            let (axes, centre) = split_matrix(matrix, "transform_matrix", 4)?;
            cam_from_opengl_world(axes, centre)
        }
        (None, Some(matrix)) => split_matrix(matrix, "cam_from_world", 3)?,
        _ => return Err("expected either \"transform_matrix\" or \"cam_from_world\"".to_owned()),
    };
    let centre = -(rotation.transpose() * translation);
    let text = |error: CameraError| error.to_string();
    let like = views[nearest_camera(views, centre)].with_pose(rotation, translation).map_err(text)?;
    let (width, height) = match entry.get("w") {
        Some(_) => (side(entry, "w")?, side(entry, "h")?),
        None => (like.width(), like.height()),
    };
    let sized = like.with_size_scaled(width, height).map_err(text)?;
    let Intrinsics { fx, fy, cx, cy, skew } = sized.intrinsics();
    let number = |key: &str, default: f64| match entry.get(key) {
        None => Ok(default),
        Some(value) => value.as_f64().ok_or_else(|| format!("{key} is {value}; expected a number, in pixels")),
    };
    let fx = number("fl_x", fx)?;
    // As in transforms.json, fl_x alone is used for both.
    let fy = number("fl_y", if entry.get("fl_x").is_some() { fx } else { fy })?;
    let intrinsics = Intrinsics { fx, fy, cx: number("cx", cx)?, cy: number("cy", cy)?, skew };
    Camera::new(intrinsics, sized.width(), sized.height(), rotation, translation).map_err(text)
}

/// The camera of a frame of a `transforms.json`.
fn camera_of_frame(file: &Value, frame: &Value, views: &[&Camera]) -> Result<Camera, String> {
    let field = |key: &str| frame.get(key).or_else(|| file.get(key)).filter(|value| !value.is_null());
    let fields = KEYS.iter().filter_map(|key| Some(((*key).to_owned(), field(key)?.clone())));
    let camera = camera_from_json(&Value::Object(fields.collect()), views)?;
    match field("camera_angle_x").and_then(Value::as_f64).filter(|_| field("fl_x").is_none()) {
        Some(angle) => camera.with_field_of_view(angle.to_degrees()).map_err(|error| error.to_string()),
        None => Ok(camera),
    }
}

/// The JSON of a file.
pub(crate) fn read_json(path: &Path) -> Result<Value, String> {
    let bytes = bounded::read(path, bounded::MAX_JSON_BYTES);
    let bytes = bytes.map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
    serde_json::from_slice(bounded::without_byte_order_mark(&bytes))
        .map_err(|error| format!("{}: not JSON: {error}", path.display()))
}

/// As [`split_json_matrix`], with an error for `key`.
fn split_matrix(matrix: &Value, key: &str, rows: usize) -> Result<(DMat3, DVec3), String> {
    let count = if rows == 3 { "3 or 4" } else { "4" };
    let wrong = || format!("{key}: expected {count} rows of 4 numbers, a fourth row being 0 0 0 1");
    split_json_matrix(matrix, rows).ok_or_else(wrong)
}

/// A width or height in pixels.
pub(crate) fn side(of: &Value, key: &str) -> Result<usize, String> {
    let side = of.get(key).and_then(Value::as_f64).filter(|side| side.fract() == 0.0 && (1.0..=1e6).contains(side));
    Ok(side.ok_or_else(|| format!("{key} is {}; expected a whole number of pixels", shown(of, key)))? as usize)
}

/// The value of a field, for messages.
pub(crate) fn shown(of: &Value, key: &str) -> String {
    of.get(key).map_or_else(|| "missing".to_owned(), Value::to_string)
}

/// The numbers of a JSON list of that length.
pub(crate) fn json_numbers<const N: usize>(list: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = list.as_array()?.iter().map(Value::as_f64).collect();
    numbers?.try_into().ok()
}

/// The 3×3 part and the last column of a 4×4 matrix; the last row may be missing where `rows` is 3.
pub(crate) fn split_json_matrix(matrix: &Value, rows: usize) -> Option<(DMat3, DVec3)> {
    let list = matrix.as_array()?;
    // Some programs write the numbers in one row.
    let flat = || list.chunks(4).map(|row| json_numbers(&Value::from(row))).collect();
    let mut found: Vec<[f64; 4]> = list.iter().map(json_numbers).collect::<Option<_>>().or_else(flat)?;
    if found.len() == 3 && rows == 3 {
        found.push([0.0, 0.0, 0.0, 1.0]);
    }
    rotation_and_translation(found.try_into().ok()?).ok()
}

/// What nerfstudio writes beside a model.
const FILE: &str = "dataparser_transforms.json";

/// `x_trained = scale (rotation x_scene + translation)`.
#[derive(Debug)]
struct TrainedFromScene {
    rotation: DMat3,
    translation: DVec3,
    scale: f64,
    /// The file that it was read from.
    pub(crate) file: PathBuf,
}

impl TrainedFromScene {
    /// Reads the file beside a camera path, or the one in the scene's folder; `None` without
    /// either.
    ///
    /// # Errors
    ///
    /// The file, the field and what was expected.
    pub(crate) fn find(path: &Path, scene: &Path) -> Result<Option<Self>, String> {
        let mut files = [path.with_file_name(FILE), scene.join(FILE)].into_iter();
        let Some(file) = files.find(|file| file.is_file()) else { return Ok(None) };
        let applied = scene.join("transforms.json");
        let of_scene = if applied.is_file() { read_json(&applied)? } else { Value::Null };
        let given = read_json(&file)?;
        if given.get("transform").is_none() {
            return Err(format!("{}: expected \"transform\" and \"scale\"", file.display()));
        }
        let r = similarity(&given, "transform", "scale").map_err(|reason| format!("{}: {reason}", file.display()))?;
        let a = similarity(&of_scene, "applied_transform", "applied_scale");
        let a = a.map_err(|reason| format!("{}: {reason}", applied.display()))?;
        let rotation = r.0 * a.0.transpose();
        let (scale, translation) = (r.2 / a.2, r.1 - rotation * a.1);
        Ok(Some(Self { rotation, translation, scale, file }))
    }

    /// Converts a camera from the axes of the training to those of the scene.
    pub(crate) fn camera(&self, trained: &Camera) -> Result<Camera, CameraError> {
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

/// The camera of one of the frames of a path.
fn nerfstudio_camera(file: &Value, frame: &Value) -> Result<Camera, String> {
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
            let refused = TrainedFromScene::find(&path, &scene).unwrap_err();
            let (file, reason) = refused.split_once(": ").unwrap();
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
        let camera = nerfstudio_camera(&file, &file["camera_path"][0]).unwrap();
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
            let error = nerfstudio_camera(&file, &wrong).unwrap_err();
            assert!(error.contains(key) && error.contains(word), "{error}");
        }
        for (key, value) in
            [("camera_type", json!("fisheye")), ("render_width", json!(0)), ("render_height", json!(null))]
        {
            let mut wrong = file.clone();
            wrong[key] = value;
            let error = nerfstudio_camera(&wrong, &file["camera_path"][0]).unwrap_err();
            assert!(error.contains(key), "{error}");
        }
    }
}
