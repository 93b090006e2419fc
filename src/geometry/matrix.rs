//! Matrices in JSON.

use glam::{DMat3, DVec3};
use serde_json::Value;

/// The 3×3 part and the last column of a 4×4 matrix; the last row may be missing where `rows` is 3.
pub(super) fn split(matrix: &Value, key: &str, rows: usize) -> Result<(DMat3, DVec3), String> {
    let wrong = || {
        format!(
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
