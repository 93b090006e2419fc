//! Undistorts photos.
//!
//! The models are OpenCV's (also COLMAP's `OPENCV`, `FULL_OPENCV` and `OPENCV_FISHEYE`, nerfstudio's
//! and instant-ngp's): for a pinhole ray (x, y, 1) with r² = x² + y², the photo shows that ray at
//!
//! ```text
//! x' = x s + 2 p1 x y + p2 (r² + 2 x²),    s = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
//! y' = y s + p1 (r² + 2 y²) + 2 p2 x y
//! ```
//!
//! or, by a fisheye, with θ = atan r, at
//!
//! ```text
//! (x', y') = (x, y) (θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹) / r
//! ```
//!
//! or, by a division model, at the (x', y') of the smaller radius r' for which r = r' / (1 + k1 r'²).
//!
//! The result is the pinhole image with the same K and size. Each of its pixels samples the photo
//! bilinearly at its distorted position, so the model need not be inverted. Positions outside the
//! photo take the nearest edge pixel.

use rayon::prelude::*;

use liveview::geometry::{Camera, CameraError, Intrinsics};
use liveview::image::ImageRgb;

/// The camera models that are read, by COLMAP's names: pinholes with OpenCV's distortion, fisheyes, and division
/// models.
pub(super) const PINHOLES: [&str; 6] =
    ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"];
pub(super) const FISHEYES: [&str; 5] =
    ["OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE"];
pub(super) const DIVISIONS: [&str; 2] = ["SIMPLE_DIVISION", "DIVISION"];

/// Coefficients of a model. They apply to rays, so they are independent of the image size.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Distortion {
    /// Whether the model is the fisheye's, which has k1 to k4 only.
    pub(super) fisheye: bool,
    /// Whether it is a division model, which has k1 only.
    pub(super) division: bool,
    /// k1 to k6.
    pub(super) k: [f64; 6],
    /// p1 and p2.
    pub(super) p: [f64; 2],
}

impl Distortion {
    /// Of up to eight coefficients of OpenCV's, in its order.
    pub(super) fn from_opencv(given: &[f64], fisheye: bool) -> Self {
        let mut coefficients = [0.0; 8];
        coefficients[..given.len()].copy_from_slice(given);
        let [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients;
        match fisheye {
            // A fisheye has k3 and k4 in place of p1 and p2.
            true => Self { fisheye, k: [k1, k2, p1, p2, 0.0, 0.0], ..Self::default() },
            false => Self { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2], ..Self::default() },
        }
    }

    pub(super) fn fields(&self) -> [(&'static str, f64); 8] {
        let ([k1, k2, k3, k4, k5, k6], [p1, p2]) = (self.k, self.p);
        [("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4), ("k5", k5), ("k6", k6), ("p1", p1), ("p2", p2)]
    }

    pub(super) fn check(&self) -> Result<(), CameraError> {
        let wrong = self.fields().into_iter().find(|(_, value)| !value.is_finite());
        wrong.map_or(Ok(()), |(field, value)| Err(CameraError::NotFinite { field: field.to_owned(), value }))
    }

    /// The point (x', y') at z = 1 where the photo shows the pinhole ray (x, y, 1).
    #[inline(always)]
    pub(super) fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let Self { fisheye, division, k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] } = *self;
        let r2 = x * x + y * y;
        if division {
            // Of the two solutions the one that is 1 at r = 0; rays beyond the model are not bent.
            let root = 1.0 - 4.0 * k1 * r2;
            let scale = if root >= 0.0 { 2.0 / (1.0 + root.sqrt()) } else { 1.0 };
            return (x * scale, y * scale);
        }
        if fisheye {
            let (r, theta) = (r2.sqrt(), r2.sqrt().atan());
            let theta2 = theta * theta;
            let bent = theta * (1.0 + theta2 * (k1 + theta2 * (k2 + theta2 * (k3 + theta2 * k4))));
            // Straight ahead, θ / r is 1.
            let scale = if r > 0.0 { bent / r } else { 1.0 };
            return (x * scale, y * scale);
        }
        let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }
}

/// The photo as a pinhole camera with its K shows it. `coefficients` are up to eight of OpenCV's, in its order: k1, k2,
/// p1, p2, then k3 to k6; of a `fisheye` k1 to k4.
///
/// # Errors
///
/// [`CameraError`] if one is not finite.
///
/// # Panics
///
/// If the camera has another size, or there are more coefficients.
pub fn undistorted(
    photo: &ImageRgb,
    camera: &Camera,
    coefficients: &[f64],
    fisheye: bool,
) -> Result<ImageRgb, CameraError> {
    assert_eq!(photo.size(), camera.size(), "the camera's size");
    let distortion = Distortion::from_opencv(coefficients, fisheye);
    distortion.check()?;
    Ok(undistort(photo, camera, &distortion))
}

/// Pixels of a row whose positions are computed before they are sampled.
const RUN: usize = 64;

/// The pinhole image of `camera` from a distorted photo of the same size and K.
pub(super) fn undistort(photo: &ImageRgb, camera: &Camera, distortion: &Distortion) -> ImageRgb {
    let (width, height) = (photo.width(), photo.height());
    let mut data = vec![0.0_f32; photo.data().len()];
    let rows = data.par_chunks_mut(3 * width).enumerate();
    rows.for_each(|(row, pixels)| undistort_row(photo, &camera.intrinsics(), distortion, row, pixels));
    ImageRgb::new(width, height, data).expect("as many values as the photo has")
}

#[pulp::with_simd(undistort_row = liveview::simd::arch())]
#[inline(always)]
fn undistort_row_with<'a, S: pulp::Simd>(
    _simd: S,
    photo: &'a ImageRgb,
    camera: &'a Intrinsics,
    distortion: &'a Distortion,
    row: usize,
    pixels: &'a mut [f32],
) {
    let Intrinsics { fx, fy, cx, cy, skew } = *camera;
    let (right, bottom) = ((photo.width() - 1) as f64, (photo.height() - 1) as f64);
    // `max` before `min`: `clamp` would keep NaN, this turns it into 0.
    let clamped = |at: f64, last: f64| (at - 0.5).max(0.0).min(last);
    let y = (row as f64 + 0.5 - cy) / fy;
    // Positions apart from samples: their arithmetic vectorises.
    let mut positions = [(0.0, 0.0); RUN];
    for (run, pixels) in pixels.chunks_mut(3 * RUN).enumerate() {
        for (i, position) in positions.iter_mut().enumerate() {
            let x = (f64::from((run * RUN + i) as i32) + 0.5 - cx - skew * y) / fx;
            let (x, y) = distortion.distort(x, y);
            *position = (clamped(fx * x + skew * y + cx, right), clamped(fy * y + cy, bottom));
        }
        for (pixel, &(u, v)) in pixels.chunks_exact_mut(3).zip(&positions) {
            pixel.copy_from_slice(&sample(photo, u, v));
        }
    }
}

/// Bilinear sample at a position in pixels, the centre of the first at 0 and of the last inside.
#[inline(always)]
fn sample(photo: &ImageRgb, u: f64, v: f64) -> [f32; 3] {
    let (data, stride) = (photo.data(), 3 * photo.width());
    let (left, top) = (u as usize, v as usize);
    let (a, b) = ((u - left as f64) as f32, (v - top as f64) as f32);
    let across = if left + 1 < photo.width() { 3 } else { 0 };
    let down = if top + 1 < photo.height() { stride } else { 0 };
    let at = top * stride + 3 * left;
    let texel = |at: usize| -> &[f32; 3] { data[at..].first_chunk().expect("a pixel of the photo") };
    let [nw, ne, sw, se] = [at, at + across, at + down, at + down + across].map(texel);
    std::array::from_fn(|c| {
        let upper = nw[c] * (1.0 - a) + ne[c] * a;
        let lower = sw[c] * (1.0 - a) + se[c] * a;
        upper * (1.0 - b) + lower * b
    })
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    const LENS: Distortion =
        Distortion { fisheye: false, division: false, k: [0.06, -0.08, 0.01, 0.0, 0.0, 0.0], p: [-0.001, 0.0002] };

    fn camera() -> Camera {
        let k = Intrinsics { fx: 60.0, fy: 50.0, cx: 31.0, cy: 26.0, skew: 2.0 };
        Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap()
    }

    /// A photo whose colours are its pixel coordinates: a bilinear sample of it equals the sampled
    /// position.
    fn coordinates() -> ImageRgb {
        let pixel = |i: usize| [(i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5, 1.0];
        ImageRgb::new(64, 48, (0..64 * 48).flat_map(pixel).collect()).unwrap()
    }

    #[test]
    fn undistorted_pixel_samples_photo_at_distorted_ray() {
        let camera = camera();
        let pinhole = undistort(&coordinates(), &camera, &LENS);
        let mut inside = 0;
        for (x, y) in (0..48).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let ray = camera.k_inverse() * DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
            let (a, b) = LENS.distort(ray.x, ray.y);
            let expected = camera.k() * DVec3::new(a, b, 1.0);
            let [u, v, _] = pinhole.pixel(x, y).map(f64::from);
            // Outside the photo its edge pixels are repeated.
            let clamped = (expected.x.clamp(0.5, 63.5), expected.y.clamp(0.5, 47.5));
            assert!(
                (u - clamped.0).abs() < 1e-5 && (v - clamped.1).abs() < 1e-5,
                "({x}, {y}): ({u}, {v}), {clamped:?}"
            );
            inside += usize::from(clamped == (expected.x, expected.y));
        }
        assert!(inside > 2500, "{inside}");
    }

    #[test]
    fn distort_matches_values_worked_out_by_hand() {
        let lens =
            Distortion { fisheye: false, division: false, k: [0.1, 0.01, 0.001, 0.0, 0.0, 0.0], p: [0.02, 0.03] };
        // r² = 5: radial = 1 + 0.5 + 0.25 + 0.125 = 1.875.
        // x' = 1.875 + 2·0.02·2 + 0.03·(5 + 2) = 2.165; y' = 3.75 + 0.02·(5 + 8) + 2·0.03·2 = 4.13.
        let (x, y) = lens.distort(1.0, 2.0);
        assert!((x - 2.165).abs() < 1e-12 && (y - 4.13).abs() < 1e-12, "{x} {y}");
    }

    #[test]
    fn distort_matches_opencv() {
        // Of `cv2.projectPoints` and `cv2.fisheye.distortPoints`, OpenCV 5.0.
        let full =
            Distortion { fisheye: false, division: false, k: [0.1, -0.05, 0.01, 0.2, -0.04, 0.006], p: [0.02, 0.03] };
        let fisheye = Distortion { fisheye: true, division: false, k: [0.1, -0.05, 0.02, 0.01, 0.0, 0.0], p: [0.0; 2] };
        for (lens, expected) in [
            (full, (0.402_539_537_034_274_9, -0.291_279_652_775_706_17)),
            (fisheye, (0.378_116_257_789_375_96, -0.283_587_193_342_031_9)),
        ] {
            let (x, y) = lens.distort(0.4, -0.3);
            assert!((x - expected.0).abs() < 1e-14 && (y - expected.1).abs() < 1e-14, "{x} {y}");
        }
        assert_eq!(fisheye.distort(0.0, 0.0), (0.0, 0.0));
    }

    #[test]
    fn division_model_is_inverted() {
        for k1 in [-0.2, 0.1] {
            let lens = Distortion { division: true, k: [k1, 0.0, 0.0, 0.0, 0.0, 0.0], ..Distortion::default() };
            let (x, y) = lens.distort(0.4, -0.3);
            let scale = 1.0 / (1.0 + k1 * (x * x + y * y));
            assert!((x * scale - 0.4).abs() < 1e-14 && (y * scale + 0.3).abs() < 1e-14, "{k1}: {x} {y}");
        }
    }

    #[test]
    fn zero_distortion_keeps_the_photo() {
        let photo = coordinates();
        let same = undistort(&photo, &camera(), &Distortion::default());
        let worst = photo.data().iter().zip(same.data()).fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn huge_coefficients_give_finite_pixels() {
        let k = [1e300, -1e300, 1e308, 1e300, 0.0, -1e308];
        for huge in [[false, false], [true, false], [false, true]].map(|[fisheye, division]| Distortion {
            fisheye,
            division,
            k,
            p: [1e300, f64::MAX],
        }) {
            let image = undistort(&coordinates(), &camera(), &huge);
            assert!(image.data().iter().all(|v| v.is_finite()));
        }
    }
}
