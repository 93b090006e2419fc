//! What a photo's depth depends on, as a digest.
//!
//! SHA-256 of, in this order and all numbers little-endian: the text [`FORMAT`], the program's version, the CPU's architecture and
//! vector instructions (which round differently), the [`Settings`] as their `Debug` text (each text after its length in bytes, u64);
//! near and far (f64); the number of photos (u64); and for the photo itself and each of its neighbours, nearest first, its size (two
//! u64), fx, fy, cx, cy, skew, rotation (rows), translation (f64) and the [`PhotoDigest`].
//!
//! The `Debug` text names every setting and writes every number so that no other reads back as it, whatever settings come and go; a
//! format that lists them here would have to be kept in step. What the search computes from the same settings is not in it: that is what
//! the version in [`FORMAT`] is for.

use std::fmt;

use sha2::{Digest, Sha256};

use crate::geometry::{Camera, Intrinsics, Size};
use crate::surface::Settings;
use crate::warp::Texture;

/// Kind and version of the files. To be raised with every change of what a file holds or of what the search finds.
const FORMAT: &str = "liveview photo depth 1";

/// SHA-256 of a photo's pixels as they are matched (decoded, undistorted, scaled): RGB as f32, little-endian, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PhotoDigest([u8; 32]);

impl PhotoDigest {
    pub(crate) fn new(photo: &Texture) -> Self {
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

/// What identifies the depth of a photo, and what a depth must be like to be it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DepthKey {
    pub(super) digest: [u8; 32],
    pub(super) size: Size,
    pub(super) near: f64,
    pub(super) far: f64,
}

impl DepthKey {
    /// Of the depth of the first photo, searched among the others, nearest first.
    ///
    /// # Panics
    ///
    /// Without a photo.
    pub(crate) fn new(photos: &[(&Camera, PhotoDigest)], (near, far): (f64, f64), settings: &Settings) -> Self {
        let mut hash = Sha256::new();
        let machine = format!("{} {:?}", std::env::consts::ARCH, crate::simd::arch());
        for text in [FORMAT, env!("CARGO_PKG_VERSION"), &machine, &format!("{settings:?}")] {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text);
        }
        [near, far].iter().for_each(|depth| hash.update(depth.to_le_bytes()));
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

/// The digest in hexadecimal: the file's name without its ending.
impl fmt::Display for DepthKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.digest.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}
