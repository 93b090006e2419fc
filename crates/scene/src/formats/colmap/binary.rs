//! COLMAP's binary files, little-endian. Every count is checked against the rest of the file before
//! memory is allocated for it.

use std::ffi::CStr;
use std::path::Path;

use glam::DVec3;

use crate::SceneError;
use crate::formats::colmap::{MODELS, Model, ModelFormat, Registered, lens, rotation};
use liveview::geometry::Size;

pub(in crate::formats) const FORMAT: ModelFormat =
    ModelFormat { extension: "bin", cameras: read_cameras, images: read_images, points: read_points };

fn read_cameras(path: &Path, bytes: &[u8], model: &mut Model) -> Result<(), SceneError> {
    let mut input = Input { path, bytes, at: 0 };
    for _ in 0..input.count("cameras", 24)? {
        let (id, number) = (input.u32("camera id")?, input.u32("camera model")?);
        let size = Size::new(input.side("camera width")?, input.side("camera height")?);
        let &(name, parameters) = MODELS
            .get(number as usize)
            .ok_or_else(|| input.wrong(&format!("camera {id} has model number {number}"), "0 to 17"))?;
        let parameters = (0..parameters).map(|_| input.f64("camera parameters")).collect::<Result<Vec<_>, _>>()?;
        if model.lenses.insert(id, lens(path, name, size, &parameters)?).is_some() {
            return Err(input.wrong(&format!("camera {id} is listed twice"), "each camera once"));
        }
    }
    input.end("camera")
}

fn read_images(path: &Path, bytes: &[u8], model: &mut Model) -> Result<(), SceneError> {
    let mut input = Input { path, bytes, at: 0 };
    for _ in 0..input.count("images", 73)? {
        input.u32("image id")?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = input.f64("image pose")?;
        }
        let [w, x, y, z, t @ ..] = numbers;
        let camera = input.u32("image camera id")?;
        let name = input.name()?;
        let mut tracked = Vec::new();
        for _ in 0..input.count("keypoints", 24)? {
            let (u, v, point) = (input.f64("keypoint")?, input.f64("keypoint")?, input.u64("keypoint")?);
            // All bits set: a keypoint without a 3D point.
            if point != u64::MAX {
                tracked.push((u, v, point));
            }
        }
        let translation = DVec3::from_array(t);
        model.images.push(Registered { name, camera, rotation: rotation([w, x, y, z]), translation, tracked });
    }
    input.end("image")
}

fn read_points(path: &Path, bytes: &[u8], model: &mut Model) -> Result<(), SceneError> {
    let mut input = Input { path, bytes, at: 0 };
    for _ in 0..input.count("points", 51)? {
        let id = input.u64("point id")?;
        let position = DVec3::new(input.f64("point")?, input.f64("point")?, input.f64("point")?);
        input.take::<11>("point colour and error")?;
        for _ in 0..input.count("track", 8)? {
            input.u64("track")?;
        }
        if model.points.insert(id, position).is_some() {
            return Err(input.wrong(&format!("point {id} is listed twice"), "each point once"));
        }
    }
    input.end("point")
}

/// Reads the fields of a file in order.
struct Input<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl Input<'_> {
    fn wrong(&self, what: &str, expected: &str) -> SceneError {
        SceneError::malformed(self.path, format!("byte {}: {what}", self.at), expected)
    }

    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], SceneError> {
        let Some(found) = self.bytes[self.at..].first_chunk::<N>() else {
            return Err(self.wrong(&format!("the file ends inside {what}"), "a complete file"));
        };
        self.at += N;
        Ok(*found)
    }

    fn u32(&mut self, what: &str) -> Result<u32, SceneError> {
        Ok(u32::from_le_bytes(self.take(what)?))
    }

    fn u64(&mut self, what: &str) -> Result<u64, SceneError> {
        Ok(u64::from_le_bytes(self.take(what)?))
    }

    fn f64(&mut self, what: &str) -> Result<f64, SceneError> {
        Ok(f64::from_le_bytes(self.take(what)?))
    }

    fn side(&mut self, what: &str) -> Result<usize, SceneError> {
        let value = self.u64(what)?;
        usize::try_from(value).map_err(|_| self.wrong(&format!("{what} is {value}"), "a number of pixels"))
    }

    /// A count of records of at least `smallest` bytes each.
    fn count(&mut self, what: &str, smallest: u64) -> Result<u64, SceneError> {
        let count = self.u64(what)?;
        let room = (self.bytes.len() - self.at) as u64 / smallest;
        if count > room {
            return Err(self
                .wrong(&format!("{count} {what} are declared"), &format!("at most the {room} that fit in the file")));
        }
        Ok(count)
    }

    /// Checks that the file ends after the last record.
    fn end(&self, what: &str) -> Result<(), SceneError> {
        let left = self.bytes.len() - self.at;
        if left == 0 {
            return Ok(());
        }
        Err(self.wrong(&format!("{left} bytes after the last declared {what}"), "the end of the file"))
    }

    /// A zero-terminated text.
    fn name(&mut self) -> Result<String, SceneError> {
        let name = CStr::from_bytes_until_nul(&self.bytes[self.at..]);
        let name = name.map_err(|_| self.wrong("an unterminated image name", "a zero byte"))?;
        let text = name.to_str().map_err(|_| self.wrong("an invalid image name", "UTF-8"))?.to_owned();
        self.at += name.count_bytes() + 1;
        Ok(text)
    }
}
