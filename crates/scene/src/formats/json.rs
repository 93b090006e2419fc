//! Reads fields of a JSON scene file; errors name the file and the field.

use std::path::Path;

use serde_json::{Map, Value};

use crate::SceneError;
use crate::cameras::json_numbers;
use crate::pose_file::{pixels, text};

/// Parses a file. JSON has no NaN or Infinity: they are errors, which quote the text around them.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Value, SceneError> {
    let text = text(path, bytes)?;
    serde_json::from_str(text).map_err(|error| {
        let line = text.lines().nth(error.line().saturating_sub(1)).unwrap_or_default().as_bytes();
        // serde_json counts columns in bytes.
        let around = error.column().saturating_sub(80).min(line.len())..(error.column() + 20).min(line.len());
        let excerpt = String::from_utf8_lossy(&line[around]);
        SceneError::malformed(path, format!("{error}: `{}`", excerpt.trim()), "JSON, all numbers finite")
    })
}

/// An object's fields; a field that it lacks is looked up in the outer object, which holds the
/// values common to all frames.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a> {
    pub(super) path: &'a Path,
    /// The object's position in the file, such as `frames[3]`, for messages.
    place: &'a str,
    own: &'a Map<String, Value>,
    outer: Option<&'a Map<String, Value>>,
}

impl<'a> Fields<'a> {
    pub(super) fn new(
        path: &'a Path,
        place: &'a str,
        value: &'a Value,
        outer: Option<&'a Map<String, Value>>,
    ) -> Result<Self, SceneError> {
        let own = value
            .as_object()
            .ok_or_else(|| SceneError::malformed(path, format!("{place} is not an object"), "an object"))?;
        Ok(Self { path, place, own, outer })
    }

    /// These fields without those of the outer object.
    pub(super) fn own(self) -> Self {
        Self { outer: None, ..self }
    }

    pub(super) fn get(&self, key: &str) -> Option<&'a Value> {
        self.own.get(key).or_else(|| self.outer?.get(key)).filter(|value| !value.is_null())
    }

    pub(super) fn wrong(&self, key: &str, expected: &str) -> SceneError {
        let found = self.get(key).map_or_else(
            || "is missing".to_owned(),
            |value| format!("is {}", value.to_string().chars().take(60).collect::<String>()),
        );
        SceneError::malformed(self.path, format!("{}: {key} {found}", self.place), expected)
    }

    pub(super) fn optional(&self, key: &str) -> Result<Option<f64>, SceneError> {
        match self.get(key) {
            None => Ok(None),
            Some(value) => value.as_f64().map(Some).ok_or_else(|| self.wrong(key, "a number")),
        }
    }

    pub(super) fn number(&self, key: &str) -> Result<f64, SceneError> {
        self.optional(key)?.ok_or_else(|| self.wrong(key, "a number"))
    }

    pub(super) fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], SceneError> {
        self.get(key).and_then(json_numbers).ok_or_else(|| self.wrong(key, &format!("{N} numbers")))
    }

    pub(super) fn text(&self, key: &str) -> Result<&'a str, SceneError> {
        self.get(key).and_then(Value::as_str).ok_or_else(|| self.wrong(key, "text"))
    }

    /// A width or height in pixels; some programs write it as 540.0.
    pub(super) fn side(&self, key: &str) -> Result<Option<usize>, SceneError> {
        let Some(value) = self.optional(key)? else { return Ok(None) };
        pixels(value).map(Some).ok_or_else(|| self.wrong(key, "a whole number of pixels"))
    }
}
