//! Extreme cases of the warp, one view on one plane, and the same warp in float64.

use std::borrow::Cow;

use anyhow::Result;
use glam::DVec3;
use liveview::geometry::{Camera, CameraError, PlaneSweep};
use liveview::image::ImageRgb;
use liveview::layers::Layers;
use liveview::warp::{Texture, WarpSource, warp_layers};
use ndarray::Array1;

use super::case::{Expected, Outputs, StageTest};
use crate::npz::Arrays;

/// A pixel is doubtful if its source coordinates move by more than this, in pixels, when the terms of (u, v, w) change in the last bit
/// of float32: every float32 implementation rounds these.
const DOUBTFUL_PIXELS: f64 = 0.01;

/// Error bound of float32 samples of a photo in [0, 1]: about the last bit of their distance in pixels from the middle of a run of
/// pixels, which the warp computes in float64.
pub(super) const BOUND: f64 = 2e-5;

/// One view, warped by one plane of the target.
pub(super) struct WarpCase<'a> {
    pub(super) photo: Cow<'a, ImageRgb>,
    pub(super) source: Result<Camera, CameraError>,
    pub(super) target: Result<Camera, CameraError>,
    /// Disparity, 1/scene unit.
    pub(super) disparity: f64,
    /// Whether the source must cover no pixel.
    pub(super) covers_nothing: bool,
    /// An equivalent rig, whose outputs must be equal to the last bit.
    pub(super) equivalent_rig: Option<Box<WarpCase<'a>>>,
    /// An equivalent rig that float64 represents well, for the expected outputs.
    pub(super) well_conditioned: Option<Box<WarpCase<'a>>>,
}

impl WarpCase<'_> {
    fn cameras(&self) -> Result<(&Camera, &Camera), String> {
        let camera = |camera: &'_ Result<Camera, CameraError>| camera.as_ref().err().map(ToString::to_string);
        match (&self.source, &self.target) {
            (Ok(source), Ok(target)) => Ok((source, target)),
            (source, target) => Err(camera(source).or(camera(target)).unwrap_or_default()),
        }
    }

    /// Whether a point (u, v, w) that is a sum of terms of this size is doubtful.
    fn is_doubtful(&self, size: DVec3, uvw: DVec3) -> bool {
        let last_bit = size * f64::from(f32::EPSILON);
        if uvw.z < -last_bit.z {
            return false;
        }
        // Not doubtful if certainly outside the photo: inside, -1 < u/w < side + 1 for the largest w.
        let w = uvw.z.max(0.0) + last_bit.z;
        let reaches = |at: f64, bit: f64, side: usize| at + bit > -w && at - bit < (side as f64 + 1.0) * w;
        let (width, height) = (self.photo.width(), self.photo.height());
        if !reaches(uvw.x, last_bit.x, width) || !reaches(uvw.y, last_bit.y, height) {
            return false;
        }
        let moved = (last_bit + (uvw / uvw.z).abs() * last_bit.z) / uvw.z.abs();
        // In this form a division by 0 counts as doubtful.
        !(uvw.z > last_bit.z && moved.x.max(moved.y) <= DOUBTFUL_PIXELS)
    }
}

impl StageTest for WarpCase<'_> {
    fn stage(&self) -> &'static str {
        "warp"
    }

    fn computed(&self) -> Result<Outputs<f32>, String> {
        let (source, target) = self.cameras()?;
        let size = target.size();
        let layers = Layers::planes(&[self.disparity]).map_err(|error| error.to_string())?;
        let pixels = size.pixels();
        let (mut disparity, mut colour, mut coverage) = (vec![0.0; pixels], vec![0.0; 3 * pixels], vec![0.0; pixels]);
        layers.as_slice()[0].fill(size.width, &mut disparity);
        let texture = Texture::new(&self.photo);
        let view = WarpSource::new(&texture, PlaneSweep::new(source, target));
        warp_layers(&disparity, &[view], size, &mut colour, &mut coverage);
        Ok(vec![("colour", colour), ("coverage", coverage)])
    }

    fn must_cover(&self) -> bool {
        !self.covers_nothing
    }

    fn equivalent(&self) -> Option<Result<Outputs<f32>, String>> {
        Some(self.equivalent_rig.as_ref()?.computed())
    }

    fn expected(&self) -> Option<Expected> {
        if let Some(well_conditioned) = &self.well_conditioned {
            return well_conditioned.expected();
        }
        let (source, target) = self.cameras().ok()?;
        let (height, width) = (target.height(), target.width());
        let mut outputs = vec![("colour", vec![0.0; 3 * height * width]), ("coverage", vec![0.0; height * width])];
        let mut doubtful = vec![false; height * width];
        // The precision of the pixels' disparities.
        let disparity = f64::from(self.disparity as f32);
        for (i, doubtful) in doubtful.iter_mut().enumerate() {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let terms = uvw_terms(source, target, (x, y), disparity);
            let uvw: DVec3 = terms.into_iter().sum();
            let at = uvw / uvw.z;
            *doubtful = self.is_doubtful(terms.into_iter().map(DVec3::abs).sum(), uvw);
            if uvw.z > 0.0 && at.is_finite() {
                let sample = bilinear(&self.photo, at.x, at.y);
                (0..3).for_each(|c| outputs[0].1[c * height * width + i] = sample[c]);
                outputs[1].1[i] = sample[3];
            }
        }
        Some(Expected { outputs, doubtful, relative: false })
    }

    fn write(&self, arrays: &mut Arrays) -> Result<()> {
        let (source, target) = self.cameras().map_err(anyhow::Error::msg)?;
        arrays.add_camera("view0", source)?;
        arrays.add_image("view0.image", &self.photo)?;
        arrays.add_camera("target", target)?;
        arrays.add("target.size", Array1::from_vec(vec![target.width() as i64, target.height() as i64]))?;
        arrays.add("disparities", Array1::from_vec(vec![f64::from(self.disparity as f32)]))?;
        // Marks that the expected outputs are those of other cameras.
        if self.well_conditioned.is_some() { arrays.add("meant", Array1::from_vec(vec![1_u8])) } else { Ok(()) }
    }
}

/// The terms of x, y, 1 and the disparity, whose sum is the homogeneous source pixel (u, v, w) of a target pixel. Computed from rays and
/// poses, without [`PlaneSweep`], so that they share no fault.
fn uvw_terms(source: &Camera, target: &Camera, (x, y): (f64, f64), disparity: f64) -> [DVec3; 4] {
    // K⁻¹ p, by substitution from below.
    let ray = |p: DVec3| {
        let k = target.intrinsics();
        let down = (p.y - k.cy * p.z) / k.fy;
        DVec3::new((p.x - k.skew * down - k.cx * p.z) / k.fx, down, p.z)
    };
    // From the target's axes to those of the world and of the source.
    let turned = |v: DVec3| source.rotation() * (target.rotation().transpose() * v);
    let projected = |v: DVec3| {
        let k = source.intrinsics();
        DVec3::new(k.fx * v.x + k.skew * v.y + k.cx * v.z, k.fy * v.y + k.cy * v.z, v.z)
    };
    let shift = source.translation() - turned(target.translation());
    let rays = [DVec3::X * x, DVec3::Y * y, DVec3::Z].map(|p| turned(ray(p)));
    [rays[0], rays[1], rays[2], shift * disparity].map(projected)
}

/// RGB and coverage at a point of the photo (pixel centres at halves), zeros outside.
fn bilinear(photo: &ImageRgb, x: f64, y: f64) -> [f64; 4] {
    let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
    let (across, down) = (x - 0.5 - left, y - 0.5 - top);
    let mut sum = [0.0; 4];
    for (column, row, weight) in [
        (left, top, (1.0 - across) * (1.0 - down)),
        (left + 1.0, top, across * (1.0 - down)),
        (left, top + 1.0, (1.0 - across) * down),
        (left + 1.0, top + 1.0, across * down),
    ] {
        if column >= 0.0 && row >= 0.0 && column < photo.width() as f64 && row < photo.height() as f64 {
            let [red, green, blue] = photo.pixel(column as usize, row as usize).map(f64::from);
            [red, green, blue, 1.0].into_iter().zip(&mut sum).for_each(|(value, sum)| *sum += weight * value);
        }
    }
    sum
}
