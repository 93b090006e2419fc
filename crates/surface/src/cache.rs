//! Depth maps of photos stored in a folder, so that a later run reads them instead of searching.
//!
//! Each depth map is a separate file, named by a digest of everything that the depth depends on
//! ([`DepthKey`]): a file under the right name is never outdated, scenes share a
//! folder, and any file may be deleted at any time. A file gets its name only when it is complete,
//! so several processes may share a folder: where two find the same depth the last file wins, and
//! both are identical. A held-out photo is part of no key, as it is no photo's neighbour.
//!
//! The digest is the SHA-256 of, in this order and all numbers little-endian: the text `FORMAT`, the program's
//! version, the CPU's architecture (each text after its length in bytes, u64; the same bits come from
//! all vector instructions of one); the constants of the search (`SEARCH_CONSTANTS`, f64); near
//! and far (f64); the number of photos in the list (u64); and for each of them its size (two u64), fx,
//! fy, cx, cy, skew, rotation (rows), translation (f64) and the [`PhotoDigest`]. The list: the photo and
//! its neighbours, nearest first; then each neighbour and its own.
//!
//! The file is `<digest>.npz`, a zip archive of uncompressed numpy arrays.
//!
//! | array | type, shape | |
//! |---|---|---|
//! | `key` | uint8 `[32]` | digest of the search's input ([`DepthKey`]); its hexadecimal form is the file's name |
//! | `pixel` | float32 `[]` | disparity per pixel of parallax, 1/scene unit |
//! | `disparity` | float32 `[h, w]` | of each pixel, 1/scene unit; before other photos confirm it |
//!
//! The archive's checksums cover every byte of the arrays.

use std::error::Error;
use std::fmt::Display;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::{fmt, io};

use ndarray::{Array, Array0, Array1, Array2, ArrayView1, Dimension, aview0};
use sha2::{Digest, Sha256};
use zip::ZipArchive;
use zip::result::ZipResult;

use crate::PhotoDisparity;
use crate::aggregate::{EDGE_CONTRAST, JUMP_PENALTY, STEP_PENALTY};
use crate::photo_depth::{FINE_PER_COARSE, PLANE_SPACING};
use liveview::geometry::{Camera, Intrinsics, MAX_SIDE, Size};
use liveview::warp::Texture;
use liveview_files::atomic::{self, AtomicFile, is_special};
use liveview_files::{bounded, npy};

/// A folder of depth maps.
#[derive(Debug, Clone)]
pub struct DepthCache {
    folder: PathBuf,
}

impl DepthCache {
    /// Opens the folder, which is created if it is missing, and checks that files can be written
    /// there.
    ///
    /// # Errors
    ///
    /// Those of creating them.
    pub fn open(folder: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        AtomicFile::create(&folder.join("depth.npz"))?;
        Ok(Self { folder: folder.to_owned() })
    }

    fn path(&self, key: &DepthKey) -> PathBuf {
        self.folder.join(format!("{key}.npz"))
    }

    /// The depth of this key, if there is a file of it.
    ///
    /// # Errors
    ///
    /// What is wrong with the file, in one line, which names it.
    pub fn load(&self, key: &DepthKey) -> Result<Option<PhotoDisparity>, String> {
        let path = self.path(key);
        let bytes = match bounded::read_regular(&path, 4 * key.size.pixels() as u64 + OVERHEAD) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("{}: cannot be read: {error}", path.display())),
        };
        read(&bytes, key).map(Some).map_err(|damage| format!("{}: {damage}", path.display()))
    }

    /// Stores a depth.
    ///
    /// # Errors
    ///
    /// Why it cannot be written, in one line, which names the file.
    pub fn store(&self, key: &DepthKey, depth: &PhotoDisparity) -> Result<(), String> {
        let path = self.path(key);
        let unwritten = |why: &dyn std::fmt::Display| format!("{}: cannot be written: {why}", path.display());
        check(depth, key).map_err(|damage| unwritten(&damage))?;
        if is_special(&path) {
            return Err(unwritten(&"a pipe or a device; expected a regular file, or none"));
        }
        let bytes = write(key, depth).map_err(|error| unwritten(&root_cause(&error)))?;
        atomic::write(&path, &bytes).map_err(|error| unwritten(&error))
    }
}

/// Kind and version of the files. To be raised with every change of a file's content or of the
/// search's result.
const FORMAT: &str = "liveview photo depth 6";

/// Constants that the search was tuned by.
const SEARCH_CONSTANTS: [f64; 5] =
    [PLANE_SPACING, FINE_PER_COARSE as f64, STEP_PENALTY as f64, JUMP_PENALTY as f64, EDGE_CONTRAST as f64];

/// SHA-256 of a photo's pixels as the search reads them (decoded, undistorted, scaled): RGB as f32,
/// little-endian, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhotoDigest([u8; 32]);

impl PhotoDigest {
    /// Of a photo.
    pub fn new(photo: &Texture) -> Self {
        let mut hash = Sha256::new();
        let mut row = Vec::with_capacity(12 * photo.width());
        for y in 0..photo.height() {
            row.clear();
            row.extend((0..photo.width()).flat_map(|x| photo.pixel(x, y)).flat_map(f32::to_le_bytes));
            hash.update(&row);
        }
        Self(hash.finalize().into())
    }
}

/// Identifies the depth of a photo, and bounds its size and values.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthKey {
    digest: [u8; 32],
    size: Size,
    near: f64,
    far: f64,
}

impl DepthKey {
    /// Of the depth of the first of the listed photos, searched from near to far (scene units).
    ///
    /// # Panics
    ///
    /// Without a photo.
    pub fn new(photos: &[(&Camera, PhotoDigest)], (near, far): (f64, f64)) -> Self {
        let mut hash = Sha256::new();
        for text in [FORMAT, env!("CARGO_PKG_VERSION"), std::env::consts::ARCH] {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text);
        }
        SEARCH_CONSTANTS.iter().chain(&[near, far]).for_each(|number| hash.update(number.to_le_bytes()));
        hash.update((photos.len() as u64).to_le_bytes());
        for (camera, digest) in photos {
            [camera.width(), camera.height()].iter().for_each(|&side| hash.update((side as u64).to_le_bytes()));
            let Intrinsics { fx, fy, cx, cy, skew } = camera.intrinsics();
            let rotation = camera.rotation().transpose().to_cols_array();
            let numbers = [fx, fy, cx, cy, skew].into_iter().chain(rotation).chain(camera.translation().to_array());
            numbers.for_each(|number| hash.update(number.to_le_bytes()));
            hash.update(digest.0);
        }
        Self { digest: hash.finalize().into(), size: photos[0].0.size(), near, far }
    }
}

/// The digest in hexadecimal: the file's name without its extension.
impl fmt::Display for DepthKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.digest.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// How far beyond near and far a disparity may lie, as a share of the range between them: the
/// search refines by up to half the distance of two planes, of which there are at least 32.
const RANGE_MARGIN: f64 = 1.0 / 32.0;

/// Largest parallax between near and far, pixels: a multiple of the largest side of a photo.
const MAX_PARALLAX: f64 = 1024.0 * MAX_SIDE as f64;

/// Upper bound of the bytes of a file beside its disparities: headers of the arrays and the
/// archive.
const OVERHEAD: u64 = 4096;

/// What is wrong with a file.
fn damage(what: impl Display, expected: impl Display) -> String {
    format!("{what}; expected {expected}")
}

/// The text of the error's root cause: the error of an archive may only say "i/o error".
fn root_cause(mut error: &dyn Error) -> String {
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

/// The bytes of the file of a depth.
fn write(key: &DepthKey, depth: &PhotoDisparity) -> ZipResult<Vec<u8>> {
    npy::npz([
        ("key", npy::bytes(&ArrayView1::from(&key.digest))),
        ("pixel", npy::bytes(&aview0(&depth.disparity_per_pixel))),
        ("disparity", npy::bytes(&depth.disparity)),
    ])
}

/// The depth of this key, from the bytes of a file. Nothing is unpacked beyond the size given by
/// the key.
fn read(bytes: &[u8], key: &DepthKey) -> Result<PhotoDisparity, String> {
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
    let depth = PhotoDisparity { disparity, disparity_per_pixel: pixel.into_scalar() };
    check(&depth, key)?;
    Ok(depth)
}

/// An array of the archive, of at most `size` bytes; row by row, whichever order it was stored in.
fn array<T: npy::Element, D: Dimension>(
    archive: &mut ZipArchive<Cursor<&[u8]>>,
    name: &str,
    expected: &str,
    size: usize,
) -> Result<Array<T, D>, String> {
    let wrong = |what: String| damage(format!("{name}: {what}"), expected);
    let entry = archive.by_name(&format!("{name}.npy")).map_err(|error| wrong(root_cause(&error)))?;
    let (limit, mut bytes) = (size as u64 + OVERHEAD, Vec::new());
    entry.take(limit + 1).read_to_end(&mut bytes).map_err(|error| wrong(root_cause(&error)))?;
    if bytes.len() as u64 > limit {
        return Err(wrong(format!("more than {limit} bytes")));
    }
    npy::read(&bytes).map_err(wrong)
}

/// Refuses values that no search can have found.
fn check(depth: &PhotoDisparity, key: &DepthKey) -> Result<(), String> {
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
///
/// # Errors
///
/// What is damaged.
#[cfg(feature = "fuzzing")]
pub fn read_for_fuzzing(bytes: &[u8]) -> Result<PhotoDisparity, String> {
    let size = liveview::geometry::Size::new(7, 5);
    read(bytes, &DepthKey { digest: [7; 32], size, near: 2.0, far: 8.0 }).map_err(|damage| damage.to_string())
}
