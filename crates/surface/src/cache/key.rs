//! Everything that a photo's depth depends on, as a digest.
//!
//! SHA-256 of, in this order and all numbers little-endian: the text [`FORMAT`], the program's
//! version, the CPU's architecture and vector instructions, which round differently (each text
//! after its length in bytes, u64); the constants of the search ([`SEARCH_CONSTANTS`], f64); near
//! and far (f64); the number of photos in the list (u64); and for each of them its size (two u64), fx,
//! fy, cx, cy, skew, rotation (rows), translation (f64) and the [`PhotoDigest`]. The list: the photo and
//! its neighbours, nearest first; then each neighbour and its own.

use std::fmt;

use sha2::{Digest, Sha256};

use crate::search::cell_search::PLANE_SPACING;
use crate::search::penalties::{EDGE_CONTRAST, JUMP_PENALTY, STEP_PENALTY};
use crate::search::photo_depth::FINE_PER_COARSE;
use liveview::geometry::{Camera, Intrinsics, Size};
use liveview::warp::Texture;

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
    pub(super) digest: [u8; 32],
    pub(super) size: Size,
    pub(super) near: f64,
    pub(super) far: f64,
}

impl DepthKey {
    /// Of the depth of the first of the listed photos, searched from near to far (scene units).
    ///
    /// # Panics
    ///
    /// Without a photo.
    pub fn new(photos: &[(&Camera, PhotoDigest)], (near, far): (f64, f64)) -> Self {
        let mut hash = Sha256::new();
        let machine = format!("{} {:?}", std::env::consts::ARCH, liveview::simd::arch());
        for text in [FORMAT, env!("CARGO_PKG_VERSION"), &machine] {
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
