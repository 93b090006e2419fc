//! Reading the fields of a JSON file of cameras, with errors that name the field.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde_json::Value;

use liveview::geometry::rotation_and_translation;
use liveview_files::bounded;

/// Why a file of cameras was refused.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {reason}", path.display(), index.map(|index| format!(": camera {index}")).unwrap_or_default())]
pub struct CameraFileError {
    /// The file.
    pub path: PathBuf,
    /// Which camera of its list.
    pub index: Option<usize>,
    /// What is wrong, and what was expected.
    pub reason: String,
}

/// The JSON of a file.
pub(super) fn read_json(path: &Path) -> Result<Value, CameraFileError> {
    let failed = |reason| CameraFileError { path: path.to_owned(), index: None, reason };
    let bytes = bounded::read_text(path, bounded::MAX_JSON_BYTES);
    let bytes = bytes.map_err(|error| failed(format!("cannot be read: {error}")))?;
    serde_json::from_slice(&bytes).map_err(|error| failed(format!("not JSON: {error}")))
}

/// As [`split_json_matrix`], with an error for `key`.
pub(super) fn split_matrix(matrix: &Value, key: &str, rows: usize) -> Result<(DMat3, DVec3), String> {
    let count = if rows == 3 { "3 or 4" } else { "4" };
    let wrong = || format!("{key}: expected {count} rows of 4 numbers, a fourth row being 0 0 0 1");
    split_json_matrix(matrix, rows).ok_or_else(wrong)
}

/// A width or height in pixels.
pub(super) fn side(of: &Value, key: &str) -> Result<usize, String> {
    let side = of.get(key).and_then(Value::as_f64).filter(|side| side.fract() == 0.0 && (1.0..=1e6).contains(side));
    Ok(side.ok_or_else(|| format!("{key} is {}; expected a whole number of pixels", shown(of, key)))? as usize)
}

/// The value of a field, for messages.
pub(super) fn shown(of: &Value, key: &str) -> String {
    of.get(key).map_or_else(|| "missing".to_owned(), Value::to_string)
}

/// The numbers of a JSON list of that length.
pub(crate) fn json_numbers<const N: usize>(list: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = list.as_array()?.iter().map(Value::as_f64).collect();
    numbers?.try_into().ok()
}

/// The 3×3 part and the last column of a 4×4 matrix; the last row may be missing where `rows` is 3.
pub(crate) fn split_json_matrix(matrix: &Value, rows: usize) -> Option<(DMat3, DVec3)> {
    let mut found: Vec<[f64; 4]> = matrix.as_array()?.iter().map(json_numbers).collect::<Option<_>>()?;
    if found.len() == 3 && rows == 3 {
        found.push([0.0, 0.0, 0.0, 1.0]);
    }
    rotation_and_translation(found.try_into().ok()?).ok()
}
