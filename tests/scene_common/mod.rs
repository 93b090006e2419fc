//! Writes small scenes into temporary folders, and assertions about scenes.
#![allow(dead_code, reason = "shared by several test binaries, none of which uses all of it")]

use std::fs;
use std::path::Path;

use glam::DVec3;
use liveview::geometry::Camera;
use liveview_scene::{Scene, SceneError, SceneOptions};

/// Writes a picture with a gradient and a pattern, as PNG or JPEG by the extension.
pub(crate) fn picture(path: &Path, width: u32, height: u32) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let colour = |x, y| image::Rgb([(x * 255 / width) as u8, (y * 255 / height) as u8, ((x ^ y) * 8 % 256) as u8]);
    image::RgbImage::from_fn(width, height, colour).save(path).unwrap();
}

/// The checksum of a PNG chunk.
pub(crate) fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
    };
    !bytes.iter().fold(u32::MAX, step)
}

pub(crate) fn write(path: &Path, contents: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, contents).unwrap();
}

pub(crate) fn open(root: &Path) -> Result<Scene, SceneError> {
    Scene::open(root, &SceneOptions::default())
}

/// The message of the error on opening a scene.
pub(crate) fn refusal(root: &Path) -> String {
    open(root).unwrap_err().to_string()
}

/// The notes of a scene, one per line.
pub(crate) fn notes(scene: &Scene) -> String {
    scene.notes.join("\n")
}

/// Asserts that the message contains every part.
pub(crate) fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "\"{part}\" is missing in: {message}");
    }
}

/// Pixel coordinates of a world point, and its depth.
pub(crate) fn project(camera: &Camera, x: f64, y: f64, z: f64) -> [f64; 3] {
    let ray = camera.rotation() * DVec3::new(x, y, z) + camera.translation();
    let pixel = camera.k() * (ray / ray.z);
    [pixel.x, pixel.y, ray.z]
}

pub(crate) fn assert_close(actual: [f64; 3], expected: [f64; 3]) {
    let worst = (0..3).map(|i| (actual[i] - expected[i]).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9, "{actual:?}, expected {expected:?}");
}

/// Writes a `poses_bounds.npy` with these rows.
pub(crate) fn poses_bounds(path: &Path, rows: &[[f64; 17]]) {
    let array = ndarray::Array2::from_shape_fn((rows.len(), 17), |(i, j)| rows[i][j]);
    write(path, liveview_files::npy::bytes(&array));
}

/// A camera at (1, 2, 3), x right, y up, looking along −z: right (1,0,0), down (0,−1,0), backwards
/// (0,0,1). Photos of 64×48 with a focal length of 80.
pub(crate) const LLFF_ROW: [f64; 17] = [
    0.0, 1.0, 0.0, 1.0, 48.0, //
    -1.0, 0.0, 0.0, 2.0, 64.0, //
    0.0, 0.0, 1.0, 3.0, 80.0, //
    1.5, 20.0,
];

/// Writes a `transforms.json` with one frame, `images/a.png`, which is 64×48 and looks along −z
/// from the origin; `from`, a part of its text, is replaced by `to`.
pub(crate) fn transforms(root: &Path, from: &str, to: &str) {
    let text = r#"{
  "fl_x": 50.0, "fl_y": 60.0, "cx": 30.0, "cy": 25.0, "w": 64, "h": 48,
  "frames": [
    {"file_path": "images/a.png",
     "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
  ]
}"#;
    assert!(text.contains(from), "{from}");
    write(&root.join("transforms.json"), text.replace(from, to));
    picture(&root.join("images/a.png"), 64, 48);
}

/// A COLMAP model with one camera and photos named `names`, each of which sees 10 points at depths
/// 2 to 11.
pub(crate) struct Colmap<'a> {
    /// The camera's line in `cameras.txt`, without its number.
    pub(crate) camera: &'a str,
    pub(crate) names: &'a [&'a str],
}

/// A COLMAP model with one photo.
pub(crate) const ONE_PHOTO: Colmap<'_> = Colmap { camera: Colmap::PINHOLE, names: &["a.png"] };

/// A COLMAP model with two photos, one of them in a subfolder.
pub(crate) const TWO_PHOTOS: Colmap<'_> = Colmap { camera: Colmap::PINHOLE, names: &["b.png", "sub/a.png"] };

impl Colmap<'_> {
    pub(crate) const PINHOLE: &'static str = "PINHOLE 64 48 50 60 30 25";

    pub(crate) fn points() -> Vec<[f64; 3]> {
        (0..10).map(|i| [0.1 * f64::from(i), -0.05 * f64::from(i), 2.0 + f64::from(i)]).collect()
    }

    /// Pose of photo `i` (quaternion w x y z, translation): rotated about y and shifted.
    pub(crate) fn pose(i: usize) -> [f64; 7] {
        let half = 0.05 * i as f64;
        [half.cos(), 0.0, half.sin(), 0.0, 0.2 * i as f64, 0.1, 0.0]
    }

    /// The keypoints of photo `i` and the ids of their points: one without a point, then all points
    /// as the pinhole camera sees them.
    fn keypoints(i: usize) -> Vec<([f64; 2], i64)> {
        let [w, _, y, _, tx, ty, tz] = Self::pose(i);
        let (sin, cos) = (2.0 * w * y, w * w - y * y);
        let seen = Self::points().into_iter().zip(1..).map(|([a, b, c], id)| {
            let [x, y, z] = [cos * a + sin * c + tx, b + ty, cos * c - sin * a + tz];
            ([50.0 * x / z + 30.0, 60.0 * y / z + 25.0], id)
        });
        std::iter::once(([3.5, 4.5], -1)).chain(seen).collect()
    }

    pub(crate) fn write_text(&self, folder: &Path) {
        write(&folder.join("cameras.txt"), format!("# cameras\n1 {}\n", self.camera));
        let mut images = "# two lines per image\n".to_owned();
        for (i, name) in self.names.iter().enumerate() {
            let pose = Self::pose(i).map(|x| x.to_string()).join(" ");
            images += &format!("{} {pose} 1 {name}\n", i + 1);
            for ([u, v], id) in Self::keypoints(i) {
                images += &format!("{u} {v} {id} ");
            }
            images += "\n";
        }
        write(&folder.join("images.txt"), images);
        let point = |([x, y, z], id): ([f64; 3], usize)| format!("{id} {x} {y} {z} 255 255 255 0.5 1 0 2 0\n");
        write(&folder.join("points3D.txt"), Self::points().into_iter().zip(1..).map(point).collect::<String>());
    }

    /// Supports the camera [`Colmap::PINHOLE`] only.
    pub(crate) fn write_binary(&self, folder: &Path) {
        assert_eq!(self.camera, Self::PINHOLE, "the only camera that can be written as binary");
        let mut cameras = Bytes::default().u64(1).u32(1).u32(1).u64(64).u64(48);
        for parameter in [50.0, 60.0, 30.0, 25.0] {
            cameras = cameras.f64(parameter);
        }
        write(&folder.join("cameras.bin"), cameras.0);
        let mut images = Bytes::default().u64(self.names.len() as u64);
        for (i, name) in self.names.iter().enumerate() {
            images = images.u32(i as u32 + 1);
            for number in Self::pose(i) {
                images = images.f64(number);
            }
            images = images.u32(1).text(name).u64(Self::keypoints(i).len() as u64);
            for ([u, v], id) in Self::keypoints(i) {
                images = images.f64(u).f64(v).u64(id as u64);
            }
        }
        write(&folder.join("images.bin"), images.0);
        let mut points = Bytes::default().u64(Self::points().len() as u64);
        for ([x, y, z], id) in Self::points().into_iter().zip(1..) {
            points = points.u64(id).f64(x).f64(y).f64(z);
            points.0.extend([255; 3]);
            points = points.f64(0.5).u64(2).u32(1).u32(0).u32(2).u32(0);
        }
        write(&folder.join("points3D.bin"), points.0);
    }
}

/// Little-endian fields in a row.
#[derive(Default)]
pub(crate) struct Bytes(pub(crate) Vec<u8>);

impl Bytes {
    pub(crate) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn f64(mut self, value: f64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn text(mut self, value: &str) -> Self {
        self.0.extend(value.as_bytes());
        self.0.push(0);
        self
    }
}
