//! nerfstudio's and instant-ngp's `transforms.json`, and `transforms_train.json` of the synthetic NeRF
//! scenes.
//!
//! `transform_matrix` is world from camera with OpenGL camera axes (x right, y up, z backwards),
//! 4×4 or 3×4 (nerfstudio's "Data conventions" page). Negating its second and third columns gives
//! OpenCV's axes. Intrinsics are in pixels of a `w` × `h` image with pixel centres at
//! half-integers, for the whole file or per frame; `camera_angle_x` (horizontal field of view,
//! radians) replaces a missing `fl_x`. Distortion is OpenCV's: k1, k2, k3, p1, p2; of `FULL_OPENCV`
//! also k4 to k6; of a fisheye k1 to k4. `near` and `far` (scene units) are not part of the format
//! but are used if present; else the range is that of the scene's points ([`super::points_range`]).

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde_json::Value;

use super::json::{Fields, parse};
use super::points_range;
use crate::geometry::{Intrinsics, Size, cam_from_opengl_world};
use crate::scene::declared::{DeclaredSize, DeclaredView, DeclaredViews};
use crate::scene::error::SceneError;
use crate::scene::masks;
use crate::scene::options::SceneOptions;
use crate::scene::photos::lookup::PhotoLookup;
use crate::scene::photos::source::PhotoSource;
use crate::scene::pose_file::read_json;
use crate::scene::undistort::Distortion;

/// Its names in a scene folder, in order of precedence, and those of the synthetic scenes' other
/// photos.
const NAMES: [&str; 2] = ["transforms.json", "transforms_train.json"];
const OTHERS: [&str; 2] = ["transforms_test.json", "transforms_val.json"];

/// Camera models that are a pinhole with OpenCV's distortion, and fisheyes. Others are refused if
/// their name contains one of the last.
const PINHOLES: [&str; 7] =
    ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "PERSPECTIVE"];
const FISHEYES: [&str; 3] = ["OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE"];
const REFUSED: [&str; 7] = ["FISHEYE", "EQUIRECT", "SPHER", "ORTHO", "OMNI", "FOV", "VR180"];

/// The file in a scene folder.
pub(super) fn file_in(root: &Path) -> Option<PathBuf> {
    NAMES.map(|name| root.join(name)).into_iter().find(|path| path.is_file())
}

pub(in crate::scene) fn open(
    root: &Path,
    path: &Path,
    photos: &dyn PhotoSource,
    options: &SceneOptions,
) -> Result<DeclaredViews, SceneError> {
    let file = parse(path, &read_json(path)?)?;
    let mut found = declared(path, &file, options.images.as_deref(), photos)?;
    points_range::fill(root, path, &file, &mut found);
    if path.ends_with(NAMES[1]) {
        let others = OTHERS.into_iter().filter(|name| root.join(name).is_file());
        found.notes.extend(others.map(|name| format!("{name}: not read; to read it, give it in place of the folder")));
    }
    Ok(found)
}

#[cfg(fuzzing)]
pub(in crate::scene) fn views(
    path: &Path,
    bytes: &[u8],
    photos: &dyn PhotoSource,
) -> Result<DeclaredViews, SceneError> {
    declared(path, &parse(path, bytes)?, None, photos)
}

/// The views of the file's frames; with photos from `folder` in place of `images`.
fn declared(
    path: &Path,
    file: &Value,
    folder: Option<&str>,
    photos: &dyn PhotoSource,
) -> Result<DeclaredViews, SceneError> {
    let head = Fields::new(path, "the file", file, None)?;
    let frames = head.get("frames").and_then(Value::as_array).ok_or_else(|| head.wrong("frames", "a list"))?;
    let mut lookup = PhotoLookup::new(photos, path);
    let mut notes = Vec::new();
    let mut views = Vec::with_capacity(frames.len());
    for (index, frame) in frames.iter().enumerate() {
        let place = format!("frames[{index}]");
        let frame = Fields::new(path, &place, frame, file.as_object())?;
        views.extend(view(path, frame, folder, &mut lookup, &mut notes)?);
    }
    notes.sort();
    notes.dedup();
    notes.extend(lookup.into_notes(&views)?);
    Ok(DeclaredViews { cameras: path.to_owned(), views, notes })
}

/// A frame's view; `None` if its entry is skipped.
fn view(
    path: &Path,
    frame: Fields<'_>,
    folder: Option<&str>,
    lookup: &mut PhotoLookup<'_>,
    notes: &mut Vec<String>,
) -> Result<Option<DeclaredView>, SceneError> {
    // The photo comes first: a skipped entry is not checked any further.
    let name = file_name(frame, folder);
    let Some(photo) = name.and_then(|name| lookup.find(&name)).transpose() else { return Ok(None) };
    let distortion = distortion(path, frame, notes)?;
    if frame.text("mask_path").is_ok() {
        notes.push(masks::note("mask_path"));
    }
    let photo = photo?;
    let size = match (frame.side("w")?, frame.side("h")?) {
        (Some(width), Some(height)) => DeclaredSize::Scaled(Size::new(width, height)),
        (None, None) => DeclaredSize::Actual,
        (Some(_), None) => return Err(frame.wrong("h", "both w and h, or neither")),
        (None, Some(_)) => return Err(frame.wrong("w", "both w and h, or neither")),
    };
    let Size { width, height } = match size {
        DeclaredSize::Scaled(declared) | DeclaredSize::Exactly(declared) => declared,
        DeclaredSize::Actual => {
            notes.push("w and h are missing: intrinsics are assumed to be for the photos' actual size".to_owned());
            photo.size
        }
    };
    let (rotation, translation) = pose(frame)?;
    Ok(Some(DeclaredView {
        photo,
        intrinsics: intrinsics(frame, width as f64, height as f64)?,
        size,
        rotation,
        translation,
        distortion,
        depth_range: frame.optional("near")?.zip(frame.optional("far")?),
    }))
}

/// The name of a frame's photo; in `folder` in place of `images`.
fn file_name<'a>(frame: Fields<'a>, folder: Option<&str>) -> Result<Cow<'a, str>, SceneError> {
    let name = frame.text("file_path")?;
    let Some(folder) = folder else { return Ok(name.into()) };
    let rest = name.strip_prefix("./").unwrap_or(name).strip_prefix("images/");
    let rest =
        rest.ok_or_else(|| frame.wrong("file_path", &format!("a photo in images/, to take that in {folder}/")))?;
    Ok(format!("{folder}/{rest}").into())
}

/// The distortion; an error for a camera model that is not read.
fn distortion(path: &Path, frame: Fields<'_>, notes: &mut Vec<String>) -> Result<Distortion, SceneError> {
    let refuse = |what: String| {
        let hint = "undistort the photos first (expected a pinhole, OpenCV's k1, k2, k3, p1, p2, FULL_OPENCV or \
                    OPENCV_FISHEYE)"
            .to_owned();
        Err(SceneError::Unsupported { path: path.to_owned(), what, hint })
    };
    let model = frame.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
    let upper = model.to_uppercase();
    let mut fisheye = FISHEYES.contains(&upper.as_str());
    if !fisheye && !PINHOLES.contains(&upper.as_str()) {
        if REFUSED.iter().any(|refused| upper.contains(refused)) {
            return refuse(format!("camera_model {model}"));
        }
        notes.push(format!("camera_model {model} is unknown: assumed to be a pinhole with k1, k2, k3, p1, p2"));
    }
    fisheye |= frame.get("is_fisheye").is_some_and(|flag| *flag != Value::Bool(false));
    // Of other models, nerfstudio's k4 is not OpenCV's.
    let without: &[&str] = match upper.as_str() {
        _ if fisheye => &["k5", "k6", "p1", "p2"],
        "FULL_OPENCV" => &[],
        _ => &["k4", "k5", "k6"],
    };
    let coefficient = |key| Ok::<f64, SceneError>(frame.optional(key)?.unwrap_or(0.0));
    for key in without {
        let value = coefficient(key)?;
        if value != 0.0 {
            return refuse(format!("distortion {key} = {value}{}", if fisheye { " of a fisheye" } else { "" }));
        }
    }
    let [k1, k2, k3, k4, k5, k6] = ["k1", "k2", "k3", "k4", "k5", "k6"].map(coefficient);
    Ok(Distortion { fisheye, k: [k1?, k2?, k3?, k4?, k5?, k6?], p: [coefficient("p1")?, coefficient("p2")?] })
}

/// The intrinsics; a frame's own `fl_x` or `camera_angle_x` takes precedence over both of the
/// file's.
fn intrinsics(frame: Fields<'_>, width: f64, height: f64) -> Result<Intrinsics, SceneError> {
    let focal = |length: &str, angle: &str, side: f64| -> Result<Option<f64>, SceneError> {
        for fields in [frame.own(), frame] {
            if let Some(focal) = fields.optional(length)? {
                return Ok(Some(focal));
            }
            if let Some(angle) = fields.optional(angle)? {
                return Ok(Some(0.5 * side / (0.5 * angle).tan()));
            }
        }
        Ok(None)
    };
    let fx = focal("fl_x", "camera_angle_x", width)?
        .ok_or_else(|| frame.wrong("fl_x", "a focal length in pixels, or camera_angle_x in radians"))?;
    let fy = focal("fl_y", "camera_angle_y", height)?.unwrap_or(fx);
    let cx = frame.optional("cx")?.unwrap_or(0.5 * width);
    let cy = frame.optional("cy")?.unwrap_or(0.5 * height);
    Ok(Intrinsics { fx, fy, cx, cy, skew: 0.0 })
}

/// `cam_from_world`, OpenCV axes.
fn pose(frame: Fields<'_>) -> Result<(DMat3, DVec3), SceneError> {
    const KEY: &str = "transform_matrix";
    let wrong = || frame.wrong(KEY, "4 rows of 4 numbers, the last 0 0 0 1");
    let rows = frame.get(KEY).and_then(Value::as_array).ok_or_else(wrong)?;
    let row = |row: &Value| -> Option<[f64; 4]> {
        let values: Option<Vec<f64>> = row.as_array()?.iter().map(Value::as_f64).collect();
        values?.try_into().ok()
    };
    let rows = rows.iter().map(row).collect::<Option<Vec<_>>>().ok_or_else(wrong)?;
    let (rows, last) = match rows.as_slice() {
        [a, b, c] => ([a, b, c], &[0.0, 0.0, 0.0, 1.0]),
        [a, b, c, last] => ([a, b, c], last),
        _ => return Err(wrong()),
    };
    if *last != [0.0, 0.0, 0.0, 1.0] {
        return Err(wrong());
    }
    let column = |i: usize| DVec3::new(rows[0][i], rows[1][i], rows[2][i]);
    Ok(cam_from_opengl_world(DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}
