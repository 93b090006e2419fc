//! Reads pose files, checks the photo names they hold, and reads the fields of JSON; errors name the file and
//! the field.

use std::borrow::Cow;
use std::path::{Component, Path};

use serde_json::{Map, Value};

use crate::SceneError;
use crate::cameras::camera_file::json_numbers;
use liveview::geometry::Size;
use liveview_files::bounded;

/// Reads a file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_up_to(bounded::MAX_BYTES, path)
}

/// Reads a JSON file.
pub(crate) fn read_json(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_up_to(bounded::MAX_JSON_BYTES, path)
}

fn read_up_to(limit: u64, path: &Path) -> Result<Vec<u8>, SceneError> {
    bounded::read(path, limit).map_err(|source| SceneError::Read { path: path.to_owned(), source })
}

/// The text of a file, UTF-8 or (as PowerShell writes it) UTF-16, without a byte order mark.
pub(crate) fn text<'a>(path: &Path, bytes: &'a [u8]) -> Result<Cow<'a, str>, SceneError> {
    if let [0xFF, 0xFE, pairs @ ..] = bytes {
        let units = pairs.as_chunks().0.iter().map(|&pair| u16::from_le_bytes(pair));
        let text: Result<String, _> = char::decode_utf16(units).collect();
        return text.map(Cow::Owned).map_err(|error| SceneError::malformed(path, error.to_string(), "UTF-16"));
    }
    std::str::from_utf8(bounded::without_byte_order_mark(bytes))
        .map(Cow::Borrowed)
        .map_err(|error| SceneError::malformed(path, format!("byte {} is not text", error.valid_up_to()), "UTF-8"))
}

/// A declared width or height; `None` unless it is a whole number of pixels.
pub(crate) fn pixels(value: f64) -> Option<usize> {
    (value.fract() == 0.0 && (1.0..=1e9).contains(&value)).then_some(value as usize)
}

/// `name` without `./`; an error if it points outside the scene folder. Symbolic links are
/// followed, since only the folder's owner can create them, not a scene file.
pub(crate) fn safe_name(listed_in: &Path, name: &str) -> Result<String, SceneError> {
    let refuse = || {
        let what = format!("the path \"{name}\" leaves the scene folder");
        SceneError::malformed(listed_in, what, "a relative path without \"..\"")
    };
    let mut parts = Vec::new();
    for component in Path::new(name).components() {
        match component {
            Component::Normal(part) => parts.push(part.to_str().ok_or_else(refuse)?),
            Component::CurDir => {}
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => return Err(refuse()),
        }
    }
    if parts.is_empty() { Err(refuse()) } else { Ok(parts.join("/")) }
}

/// A listed path; an absolute one, of Unix or of Windows (`C:/…`), from below the root of its disk.
pub(crate) fn below_root(listed: &str) -> &str {
    let drive = listed.get(1..2) == Some(":") && listed.starts_with(|first: char| first.is_ascii_alphabetic());
    let path = if drive { &listed[2..] } else { listed };
    path.trim_start_matches('/')
}

/// The names as a list for a note; of a long list the first few and the number of others.
pub(crate) fn abbreviated(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().checked_sub(SHOWN) {
        Some(more) if more > 0 => format!("{shown} and {more} more"),
        _ => shown,
    }
}

/// Brackets within each other that json5, which would overflow its stack, may parse: as many as serde_json allows.
const MAX_NESTING: usize = 128;

/// The largest number of brackets that are open at once.
fn nesting(text: &str) -> usize {
    let mut open = 0_usize;
    let opened = text.bytes().map(|byte| {
        match byte {
            b'[' | b'{' => open += 1,
            b']' | b'}' => open = open.saturating_sub(1),
            _ => {}
        }
        open
    });
    opened.max().unwrap_or(0)
}

/// Reads a JSON file of a scene, or one that people and other programs changed: UTF-16, comments, NaN.
///
/// # Errors
///
/// [`SceneError::Read`]; [`SceneError::Malformed`] for what is not JSON.
pub fn read_scene_json(path: &Path) -> Result<Value, SceneError> {
    parse(path, &read_json(path)?)
}

/// Parses a file, JSON or with what people and Python add: comments, commas after the last value, NaN and Infinity,
/// which become null. Errors quote the text around them.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Value, SceneError> {
    let text = text(path, bytes)?;
    let parsed = serde_json::from_str(&text).or_else(|error| match nesting(&text) {
        ..=MAX_NESTING => json5::from_str(&text).map_err(|_| error),
        _ => Err(error),
    });
    parsed.map_err(|error: serde_json::Error| {
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
pub(crate) struct Fields<'a> {
    pub(crate) path: &'a Path,
    /// The object's position in the file, such as `frames[3]`, for messages.
    place: &'a str,
    own: &'a Map<String, Value>,
    outer: Option<&'a Map<String, Value>>,
}

impl<'a> Fields<'a> {
    pub(crate) fn new(
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
    pub(crate) fn own(self) -> Self {
        Self { outer: None, ..self }
    }

    pub(crate) fn get(&self, key: &str) -> Option<&'a Value> {
        self.own.get(key).or_else(|| self.outer?.get(key)).filter(|value| !value.is_null())
    }

    pub(crate) fn wrong(&self, key: &str, expected: &str) -> SceneError {
        let found = self.get(key).map_or_else(
            || "is missing".to_owned(),
            |value| format!("is {}", value.to_string().chars().take(60).collect::<String>()),
        );
        SceneError::malformed(self.path, format!("{}: {key} {found}", self.place), expected)
    }

    /// The number, 0 without one.
    pub(crate) fn or_zero(&self, key: &str) -> Result<f64, SceneError> {
        Ok(self.optional(key)?.unwrap_or(0.0))
    }

    pub(crate) fn optional(&self, key: &str) -> Result<Option<f64>, SceneError> {
        match self.get(key) {
            None => Ok(None),
            Some(value) => {
                let number = value.as_f64().or_else(|| value.as_str()?.trim().parse().ok());
                number.map(Some).ok_or_else(|| self.wrong(key, "a number"))
            }
        }
    }

    pub(crate) fn number(&self, key: &str) -> Result<f64, SceneError> {
        self.optional(key)?.ok_or_else(|| self.wrong(key, "a number"))
    }

    pub(crate) fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], SceneError> {
        self.get(key).and_then(json_numbers).ok_or_else(|| self.wrong(key, &format!("{N} numbers")))
    }

    pub(crate) fn text(&self, key: &str) -> Result<&'a str, SceneError> {
        self.get(key).and_then(Value::as_str).ok_or_else(|| self.wrong(key, "text"))
    }

    pub(crate) fn object(&self, key: &str) -> Result<&'a Map<String, Value>, SceneError> {
        self.get(key).and_then(Value::as_object).ok_or_else(|| self.wrong(key, "an object"))
    }

    /// `width` and `height`.
    pub(crate) fn size(&self) -> Result<Size, SceneError> {
        match (self.side("width")?, self.side("height")?) {
            (Some(width), Some(height)) => Ok(Size::new(width, height)),
            _ => Err(self.wrong("width", "width and height in pixels")),
        }
    }

    /// A width or height in pixels; some programs write it as 540.0.
    pub(crate) fn side(&self, key: &str) -> Result<Option<usize>, SceneError> {
        let Some(value) = self.optional(key)? else { return Ok(None) };
        pixels(value).map(Some).ok_or_else(|| self.wrong(key, "a whole number of pixels"))
    }
}

/// Folders of masks that COLMAP, nerfstudio and gsplat write.
pub(crate) const MASK_FOLDERS: [&str; 5] = ["masks", "masks_2", "masks_4", "masks_8", "mask"];

/// The note on masks that a scene holds in the folder or field `name`.
pub(crate) fn mask_note(name: &str) -> String {
    format!("{name}: masks are not supported, masked pixels are used like all others")
}
