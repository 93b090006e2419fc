//! nerfstudio's and instant-ngp's `transforms.json`, and `transforms_train.json` of the synthetic NeRF
//! scenes.
//!
//! `transform_matrix` is world from camera with OpenGL camera axes (x right, y up, z backwards),
//! 4×4 or 3×4 (nerfstudio's "Data conventions" page). Negating its second and third columns gives
//! OpenCV's axes. Intrinsics are in pixels of a `w` × `h` image with pixel centres at
//! half-integers, for the whole file or per frame; `camera_angle_x` (horizontal field of view,
//! radians) or instant-ngp's `x_fov` (degrees) replaces a missing `fl_x`. Distortion is OpenCV's: k1, k2, k3, p1, p2; of `FULL_OPENCV`
//! also k4 to k6; of a fisheye k1 to k4. `near` and `far` (scene units) are not part of the format
//! but are used if present.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::cameras::camera_file::split_json_matrix;
use crate::photos::PhotoLookup;
use crate::scene_file::{Fields, mask_note, parse, read_json};
use crate::undistort::{FISHEYES, PINHOLES};
use crate::{DeclaredView, DeclaredViews, Distortion, SceneError, SceneOptions};
use liveview::geometry::{Intrinsics, Size, cam_from_opengl_world};

/// Its names in a scene folder, in order of precedence, and those of the synthetic scenes' targets.
pub(super) const NAMES: [&str; 2] = ["transforms.json", "transforms_train.json"];
const TARGETS: [&str; 2] = ["transforms_test.json", "transforms_val.json"];

/// Camera models are refused if their name contains one of these, unless they are [`FISHEYES`].
const REFUSED: [&str; 7] = ["FISHEYE", "EQUIRECT", "SPHER", "ORTHO", "OMNI", "FOV", "VR180"];

/// Flags of panoramas.
const PANORAMAS: [&str; 4] = ["is_latlong", "latlong", "equirectangular", "is_equirectangular"];

/// Reads a file in a scene folder, whatever its name. Of the synthetic scenes, the photos of `transforms_train.json` are
/// sources and those of another file are targets.
pub(crate) fn open(options: &SceneOptions, lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let (path, photos) = (lookup.listed_in, lookup.photos);
    let read = |path: &Path| {
        views(&parse(path, &read_json(path)?)?, options.images.as_deref(), PhotoLookup::new(photos, path))
    };
    let train = path.with_file_name(NAMES[1]);
    let targets = if path == train { path.with_file_name(TARGETS[0]) } else { path.to_owned() };
    if !train.is_file() || !targets.is_file() || !TARGETS.iter().any(|name| targets.ends_with(name)) {
        return read(path);
    }
    let (mut found, name) = (read(&train)?, targets.file_name().unwrap_or_default().to_string_lossy());
    match read(&targets) {
        Ok(mut targets) => {
            targets.views.retain(|target| found.views.iter().all(|view| view.photo.name != target.photo.name));
            let count = targets.views.len();
            found.notes.push(format!("the {count} photos of {name} are targets only, rendered from the others"));
            found.held_out = targets.views.iter().map(|view| view.photo.name.clone()).collect();
            found.views.extend(targets.views);
        }
        Err(error) if path == targets => return Err(error),
        Err(error) => found.notes.push(format!("{name} is not read: {error}")),
    }
    Ok(found)
}

/// The views of the file's frames; with photos from `folder` in place of `images`.
pub(super) fn views(
    file: &Value,
    folder: Option<&str>,
    mut lookup: PhotoLookup<'_>,
) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let head = Fields::new(path, "the file", file, None)?;
    let frames = head.get("frames").and_then(Value::as_array).ok_or_else(|| head.wrong("frames", "a list"))?;
    let times: BTreeSet<String> = frames.iter().filter_map(|frame| Some(frame.get("time")?.to_string())).collect();
    if times.len() > 1 {
        let what = format!("a moving scene, with frames of {} different times,", times.len());
        let hint = "keep the frames of one `time`, or remove `time` if nothing moves";
        return Err(SceneError::unsupported(path, what, hint));
    }
    for (index, frame) in frames.iter().enumerate() {
        let place = format!("frames[{index}]");
        let frame = Fields::new(path, &place, frame, file.as_object())?;
        add_view(frame, folder, &mut lookup)?;
    }
    lookup.finish()
}

/// Adds a frame's view, unless its entry is skipped.
fn add_view(frame: Fields<'_>, folder: Option<&str>, lookup: &mut PhotoLookup<'_>) -> Result<(), SceneError> {
    // The photo comes first: a skipped entry is not checked any further.
    let name = file_name(frame, folder);
    let Some(photo) = name.and_then(|name| lookup.find(&name)).transpose() else { return Ok(()) };
    let distortion = distortion(frame, lookup)?;
    if frame.text("mask_path").is_ok() {
        lookup.note(mask_note("mask_path"));
    }
    let photo = photo?;
    let size = match (frame.side("w")?, frame.side("h")?) {
        (Some(width), Some(height)) => Size::new(width, height),
        (None, None) => {
            lookup.note("w and h are missing: intrinsics are assumed to be for the photos' actual size".to_owned());
            photo.size
        }
        (Some(_), None) => return Err(frame.wrong("h", "both w and h, or neither")),
        (None, Some(_)) => return Err(frame.wrong("w", "both w and h, or neither")),
    };
    let pose = frame.get("transform_matrix").and_then(|matrix| split_json_matrix(matrix, 3));
    let Some((axes, centre)) = pose else {
        let error = frame.wrong("transform_matrix", "4 rows of 4 numbers, the last 0 0 0 1 (not transposed)");
        lookup.leave_out(&photo.name, error);
        return Ok(());
    };
    let (rotation, translation) = cam_from_opengl_world(axes, centre);
    let depth_range = frame.optional("near")?.zip(frame.optional("far")?);
    let view = DeclaredView::new(photo, (intrinsics(frame, size)?, size), (rotation, translation));
    lookup.views.push(DeclaredView { distortion, depth_range, ..view });
    Ok(())
}

/// The name of a frame's photo; in `folder` in place of `images`.
fn file_name(frame: Fields<'_>, folder: Option<&str>) -> Result<String, SceneError> {
    let name = frame.text("file_path")?;
    let Some(folder) = folder else { return Ok(name.to_owned()) };
    let rest = name.strip_prefix("./").unwrap_or(name).strip_prefix("images/");
    let rest =
        rest.ok_or_else(|| frame.wrong("file_path", &format!("a photo in images/, to take that in {folder}/")))?;
    Ok(format!("{folder}/{rest}"))
}

/// The distortion; an error for a camera model that is not read.
fn distortion(frame: Fields<'_>, lookup: &mut PhotoLookup<'_>) -> Result<Distortion, SceneError> {
    let refuse = |what: String| {
        let hint = "undistort the photos first (expected a pinhole, OpenCV's k1, k2, k3, p1, p2, FULL_OPENCV or \
                    OPENCV_FISHEYE)";
        Err(SceneError::unsupported(frame.path, what, hint))
    };
    let model = frame.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
    let upper = model.to_uppercase();
    let mut fisheye = FISHEYES.contains(&upper.as_str());
    if !fisheye && !PINHOLES.contains(&upper.as_str()) && upper != "PERSPECTIVE" {
        if REFUSED.iter().any(|refused| upper.contains(refused)) {
            return refuse(format!("camera_model {model}"));
        }
        lookup.note(format!("camera_model {model} is unknown: assumed to be a pinhole with k1, k2, k3, p1, p2"));
    }
    let is_set = |flag: &&str| match frame.get(flag) {
        Some(Value::String(text)) => !["", "0"].contains(&text.as_str()) && !text.eq_ignore_ascii_case("false"),
        Some(value) => *value != Value::Bool(false) && value.as_f64() != Some(0.0),
        None => false,
    };
    fisheye |= is_set(&"is_fisheye");
    if let Some(flag) = PANORAMAS.iter().find(|flag| is_set(flag)) {
        return refuse(format!("{flag}: a panorama"));
    }
    if frame.get("ftheta_p0").is_some() {
        return refuse("ftheta_p0: an f-theta lens".to_owned());
    }
    // Of other models, nerfstudio's k4 is not OpenCV's.
    let without: &[&str] = match upper.as_str() {
        _ if fisheye => &["k5", "k6", "p1", "p2"],
        "FULL_OPENCV" => &[],
        _ => &["k4", "k5", "k6"],
    };
    for key in without {
        let value = frame.or_zero(key)?;
        if value != 0.0 {
            return refuse(format!("distortion {key} = {value}{}", if fisheye { " of a fisheye" } else { "" }));
        }
    }
    let [k1, k2, k3, k4, k5, k6] = ["k1", "k2", "k3", "k4", "k5", "k6"].map(|key| frame.or_zero(key));
    Ok(Distortion {
        fisheye,
        division: false,
        k: [k1?, k2?, k3?, k4?, k5?, k6?],
        p: [frame.or_zero("p1")?, frame.or_zero("p2")?],
    })
}

/// The intrinsics; a frame's own `fl_x` or `camera_angle_x` takes precedence over both of the
/// file's.
fn intrinsics(frame: Fields<'_>, size: Size) -> Result<Intrinsics, SceneError> {
    let (width, height) = (size.width as f64, size.height as f64);
    let focal = |[length, angle, degrees]: [&str; 3], side: f64| -> Result<Option<f64>, SceneError> {
        for fields in [frame.own(), frame] {
            if let Some(focal) = fields.optional(length)? {
                return Ok(Some(focal));
            }
            let degrees = fields.optional(degrees)?;
            if let Some(angle) = fields.optional(angle)?.or(degrees.map(f64::to_radians)) {
                return Ok(Some(0.5 * side / (0.5 * angle).tan()));
            }
        }
        Ok(None)
    };
    let fx = focal(["fl_x", "camera_angle_x", "x_fov"], width)?
        .ok_or_else(|| frame.wrong("fl_x", "a focal length in pixels, or camera_angle_x in radians"))?;
    let fy = focal(["fl_y", "camera_angle_y", "y_fov"], height)?.unwrap_or(fx);
    let cx = frame.optional("cx")?.unwrap_or(0.5 * width);
    let cy = frame.optional("cy")?.unwrap_or(0.5 * height);
    Ok(Intrinsics { fx, fy, cx, cy, skew: 0.0 })
}
