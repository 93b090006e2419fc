//! Cameras from a JSON file.

use std::path::Path;

use anyhow::{Result, anyhow, bail};
use glam::{DMat3, DVec3};
use liveview::camera::{Camera, Intrinsics};
use liveview::file;
use serde_json::Value;

use super::setup::Photos;

/// The one camera of the file, or the list of them.
pub(super) fn read(path: &Path, photos: &Photos) -> Result<Vec<Camera>> {
    let at = path.display();
    let bytes = file::read(path, file::MAX_JSON_BYTES).map_err(|error| anyhow!("{at}: cannot be read: {error}"))?;
    let file: Value = serde_json::from_slice(&bytes).map_err(|error| anyhow!("{at}: not JSON: {error}"))?;
    let entries = file.as_array().map_or_else(|| std::slice::from_ref(&file), Vec::as_slice);
    if entries.is_empty() {
        bail!("{at}: the list of cameras is empty; expected at least one");
    }
    let place = |index: usize| if file.is_array() { format!("{at}: camera {index}") } else { at.to_string() };
    let cameras = entries.iter().enumerate();
    cameras.map(|(index, entry)| camera(entry, photos).map_err(|error| anyhow!("{}: {error}", place(index)))).collect()
}

fn camera(entry: &Value, photos: &Photos) -> Result<Camera> {
    let (rotation, translation) = match (entry.get("transform_matrix"), entry.get("cam_from_world")) {
        (Some(matrix), None) => {
            // The rows of `cam_from_world` are the columns of world from camera; OpenGL's y and z point the other way.
            let (axes, centre) = split(matrix, "transform_matrix", 4)?;
            let rotation = DMat3::from_rows(axes.x_axis, -axes.y_axis, -axes.z_axis);
            (rotation, -(rotation * centre))
        }
        (None, Some(matrix)) => split(matrix, "cam_from_world", 3)?,
        _ => bail!("expected either \"transform_matrix\" or \"cam_from_world\""),
    };
    let centre = -(rotation.transpose() * translation);
    let like = photos.nearest_view(centre).with_pose(rotation, translation)?;
    let sized = like.with_size_scaled(side(entry, "w", like.width())?, side(entry, "h", like.height())?)?;
    let Intrinsics { fx, fy, cx, cy, skew } = sized.intrinsics();
    let number = |key: &str, default: f64| match entry.get(key) {
        None => Ok(default),
        Some(value) => value.as_f64().ok_or_else(|| anyhow!("{key} is {value}; expected a number, in pixels")),
    };
    let fx = number("fl_x", fx)?;
    // As in transforms.json, fl_x alone stands for both.
    let fy = number("fl_y", if entry.get("fl_x").is_some() { fx } else { fy })?;
    let intrinsics = Intrinsics { fx, fy, cx: number("cx", cx)?, cy: number("cy", cy)?, skew };
    Ok(Camera::new(intrinsics, sized.width(), sized.height(), rotation, translation)?)
}

fn side(entry: &Value, key: &str, default: usize) -> Result<usize> {
    let Some(value) = entry.get(key) else { return Ok(default) };
    let side = value.as_f64().filter(|side| side.fract() == 0.0 && (1.0..=1e6).contains(side));
    Ok(side.ok_or_else(|| anyhow!("{key} is {value}; expected a whole number of pixels"))? as usize)
}

/// The 3×3 part and the last column of a 4×4 matrix, or of one with only `rows` rows.
fn split(matrix: &Value, key: &str, rows: usize) -> Result<(DMat3, DVec3)> {
    let wrong = || {
        anyhow!(
            "{key}: expected {} rows of 4 numbers, a fourth row being 0 0 0 1",
            if rows == 3 { "3 or 4" } else { "4" }
        )
    };
    let row = |row: &Value| -> Option<[f64; 4]> {
        let numbers: Option<Vec<f64>> = row.as_array()?.iter().map(Value::as_f64).collect();
        numbers?.try_into().ok()
    };
    let found: Option<Vec<[f64; 4]>> = matrix.as_array().ok_or_else(wrong)?.iter().map(row).collect();
    let found = found.filter(|found| (rows..=4).contains(&found.len())).ok_or_else(wrong)?;
    if found.get(3).is_some_and(|last| *last != [0.0, 0.0, 0.0, 1.0]) {
        return Err(wrong());
    }
    let column = |i: usize| DVec3::new(found[0][i], found[1][i], found[2][i]);
    Ok((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}
