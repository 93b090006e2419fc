//! The depth of a photo as a file: `<digest>.npz`, a zip archive of uncompressed numpy arrays.
//!
//! | array | type, shape | |
//! |---|---|---|
//! | `key` | uint8 `[32]` | digest of the search's input ([`super::key`]); its hexadecimal form is the file's name |
//! | `pixel` | float32 `[]` | disparity per pixel of parallax, 1/scene unit |
//! | `disparity` | float32 `[h, w]` | of each pixel, 1/scene unit; before other photos confirm it |
//!
//! The archive's checksums cover every byte of the arrays.

use std::error::Error;
use std::io::{Cursor, Read, Seek, Write};

use ndarray::{Array, Array0, Array1, Array2, ArrayView1, Dimension, aview0};
use ndarray_npy::{NpzWriter, ViewElement, WriteNpzError};
use zip::ZipArchive;

use super::key::DepthKey;
use crate::search::PhotoDepth;
use liveview::geometry::MAX_SIDE;
use liveview_files::npy;

/// How far beyond near and far a disparity may lie, as a share of the range between them: the
/// search refines by up to half the distance of two planes, of which there are at least 32.
const RANGE_MARGIN: f64 = 1.0 / 32.0;

/// Largest parallax between near and far, pixels: a multiple of the largest side of a photo.
const MAX_PARALLAX: f64 = 1024.0 * MAX_SIDE as f64;

/// Upper bound of the bytes of a file beside its disparities: headers of the arrays and the
/// archive.
const OVERHEAD: u64 = 4096;

/// What is wrong with a file.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{what}; expected {expected}")]
pub(crate) struct Damage {
    what: String,
    expected: String,
}

fn damage(what: impl Into<String>, expected: impl Into<String>) -> Damage {
    Damage { what: what.into(), expected: expected.into() }
}

/// The text of the error's root cause: the error of an archive may only say "i/o error".
pub(super) fn root_cause(mut error: &dyn Error) -> String {
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

/// Upper bound of the bytes of the file of a depth.
pub(super) fn max_bytes(key: &DepthKey) -> u64 {
    4 * key.size.pixels() as u64 + OVERHEAD
}

pub(super) fn write<W: Write + Seek>(file: W, key: &DepthKey, depth: &PhotoDepth) -> Result<W, WriteNpzError> {
    let mut arrays = NpzWriter::new(file);
    arrays.add_array("key", &ArrayView1::from(&key.digest))?;
    arrays.add_array("pixel", &aview0(&depth.disparity_per_pixel))?;
    arrays.add_array("disparity", &depth.disparity)?;
    arrays.finish()
}

/// The depth of this key, from the bytes of a file. Nothing is unpacked beyond the size given by
/// the key.
pub(super) fn read(bytes: &[u8], key: &DepthKey) -> Result<PhotoDepth, Damage> {
    let broken = |error| damage(format!("no archive: {}", root_cause(&error)), "a complete .npz file");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(broken)?;
    if archive.len() != 3 {
        return Err(damage(format!("{} arrays", archive.len()), "key, pixel and disparity"));
    }
    let stored: Array1<u8> = array(&mut archive, "key", "uint8 of shape [32]", 32)?;
    if stored != ArrayView1::from(&key.digest) {
        return Err(damage("key: of another depth", "that of the file's name"));
    }
    let pixel: Array0<f32> = array(&mut archive, "pixel", "float32 of shape []", 4)?;
    let expected = format!("float32 of shape [{}, {}]", key.size.height, key.size.width);
    let disparity: Array2<f32> = array(&mut archive, "disparity", &expected, 4 * key.size.pixels())?;
    if disparity.dim() != (key.size.height, key.size.width) {
        return Err(damage(format!("disparity: of shape {:?}", disparity.shape()), expected));
    }
    let depth = PhotoDepth { disparity, disparity_per_pixel: pixel.into_scalar() };
    check(&depth, key)?;
    Ok(depth)
}

/// An array of the archive, of at most `size` bytes; row by row, whichever order it was stored in.
fn array<T: ViewElement + Clone, D: Dimension>(
    archive: &mut ZipArchive<Cursor<&[u8]>>,
    name: &str,
    expected: &str,
    size: usize,
) -> Result<Array<T, D>, Damage> {
    let wrong = |what: String| damage(format!("{name}: {what}"), expected);
    let entry = archive.by_name(&format!("{name}.npy")).map_err(|error| wrong(root_cause(&error)))?;
    let (limit, mut bytes) = (size as u64 + OVERHEAD, Vec::new());
    entry.take(limit + 1).read_to_end(&mut bytes).map_err(|error| wrong(root_cause(&error)))?;
    if bytes.len() as u64 > limit {
        return Err(wrong(format!("more than {limit} bytes")));
    }
    Ok(npy::view::<T, D>(&bytes).map_err(wrong)?.as_standard_layout().into_owned())
}

/// Refuses values that no search can have found.
pub(super) fn check(depth: &PhotoDepth, key: &DepthKey) -> Result<(), Damage> {
    let (nearest, farthest) = (1.0 / key.near, 1.0 / key.far);
    let pixel = depth.disparity_per_pixel;
    // The search counts at least one pixel of parallax between near and far.
    let range = ((nearest - farthest) / MAX_PARALLAX) as f32..=(nearest - farthest) as f32;
    if !range.contains(&pixel) {
        let expected = format!("{:e} to {:e}", range.start(), range.end());
        return Err(damage(format!("pixel: {pixel:e}"), expected));
    }
    let margin = RANGE_MARGIN * (nearest - farthest);
    let range = (farthest - margin).max(0.0) as f32..=(nearest + margin) as f32;
    match depth.disparity.indexed_iter().find(|(_, value)| !(value.is_finite() && range.contains(value))) {
        Some(((y, x), value)) => {
            let expected = format!("{} to {}, between far and near", range.start(), range.end());
            Err(damage(format!("disparity: {value} in row {y}, column {x}"), expected))
        }
        None => Ok(()),
    }
}

/// Reads the file of a depth of 7×5 pixels between 2 and 8, the bytes of its key all 7.
#[cfg(fuzzing)]
pub fn read_for_fuzzing(bytes: &[u8]) -> Result<PhotoDepth, String> {
    let size = liveview::geometry::Size::new(7, 5);
    read(bytes, &DepthKey { digest: [7; 32], size, near: 2.0, far: 8.0 })
}
