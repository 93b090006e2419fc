//! Pictures in memory, from and to arrays `[h, w, 3]` and pictures of the crate `image`.

use image::imageops::{self, FilterType};
use image::metadata::Orientation;
use image::{DynamicImage, Rgb32FImage, RgbImage};
use ndarray::{Array3, ArrayView3};

use super::ImageError;
use crate::geometry::Size;

/// An sRGB picture: interleaved RGB, f32 in [0, 1], row-major, `data.len() == 3 * width * height`.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageRgb {
    data: Vec<f32>,
    width: usize,
    height: usize,
}

impl ImageRgb {
    /// Wraps interleaved RGB values.
    ///
    /// # Errors
    ///
    /// [`ImageError::Buffer`] unless `data` holds 3 · width · height values.
    pub fn new(width: usize, height: usize, data: Vec<f32>) -> Result<Self, ImageError> {
        check_buffer(data.len(), width, height, 3)?;
        Ok(Self { data, width, height })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

    /// All values, interleaved RGB, row by row.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All values as in [`Self::data`], without a copy.
    pub fn into_data(self) -> Vec<f32> {
        self.data
    }

    /// The pixel in column `x`, row `y`.
    ///
    /// # Panics
    ///
    /// If the pixel is outside the image.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 3] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of a {}x{} image", self.width, self.height);
        let at = 3 * (y * self.width + x);
        [self.data[at], self.data[at + 1], self.data[at + 2]]
    }

    /// The picture scaled to another size (pixels) with a triangle filter, which widens on
    /// downscaling to avoid aliasing.
    ///
    /// # Errors
    ///
    /// [`ImageError::Buffer`] if a side of either size exceeds `u32`.
    pub fn resized(self, width: usize, height: usize) -> Result<Self, ImageError> {
        let refused = ImageError::Buffer { len: self.data.len(), width, height, channels: 3 };
        let sides = [self.width, self.height, width, height].map(u32::try_from);
        let [Ok(across), Ok(down), Ok(new_across), Ok(new_down)] = sides else { return Err(refused) };
        let Some(buffer) = Rgb32FImage::from_raw(across, down, self.data) else { return Err(refused) };
        let scaled = imageops::resize(&buffer, new_across, new_down, FilterType::Triangle);
        Self::new(width, height, scaled.into_raw())
    }

    /// The picture as an EXIF orientation, 1 (as stored) to 8, shows it.
    pub fn turned(self, orientation: u8) -> Self {
        let (width, height) = (self.width as u32, self.height as u32);
        let stored = Rgb32FImage::from_raw(width, height, self.data).expect("3 values for each pixel");
        let mut picture = DynamicImage::ImageRgb32F(stored);
        picture.apply_orientation(Orientation::from_exif(orientation).unwrap_or(Orientation::NoTransforms));
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        Self { data: picture.into_rgb32f().into_raw(), width, height }
    }

    /// The picture as a file of 8 bits holds it: rounded, values outside [0, 1] clamped.
    pub fn in_8_bits(&self) -> Self {
        let data = self.to_rgb8().into_iter().map(|value| f32::from(value) / 255.0).collect();
        Self { data, ..*self }
    }

    /// 8-bit interleaved RGB, rounded; values outside [0, 1] are clamped.
    pub fn to_rgb8(&self) -> Vec<u8> {
        // In f64 the sum is exact; `round` calls a function for each value.
        self.data.iter().map(|value| (f64::from(value.clamp(0.0, 1.0) * 255.0) + 0.5) as u8).collect()
    }

    /// The picture of an array `[h, w, 3]` of sRGB values in [0, 1].
    ///
    /// # Errors
    ///
    /// [`ImageError::Shape`] unless the last side is 3.
    pub fn from_array(array: ArrayView3<'_, f32>) -> Result<Self, ImageError> {
        Self::from_values(array, |value| value)
    }

    /// The picture of an array `[h, w, 3]` of sRGB values from 0 to 255.
    ///
    /// # Errors
    ///
    /// [`ImageError::Shape`] unless the last side is 3.
    pub fn from_array_u8(array: ArrayView3<'_, u8>) -> Result<Self, ImageError> {
        Self::from_values(array, |value| f32::from(value) / 255.0)
    }

    fn from_values<T: Copy>(array: ArrayView3<'_, T>, value: impl Fn(T) -> f32) -> Result<Self, ImageError> {
        let (height, width, channels) = array.dim();
        if channels != 3 {
            return Err(ImageError::Shape { shape: [height, width, channels] });
        }
        Self::new(width, height, array.iter().map(|&one| value(one)).collect())
    }

    /// The picture as an array `[h, w, 3]` of sRGB values in [0, 1], without a copy.
    pub fn as_array(&self) -> ArrayView3<'_, f32> {
        ArrayView3::from_shape((self.height(), self.width(), 3), self.data()).expect("3 values for each pixel")
    }

    /// The picture as an array `[h, w, 3]` of sRGB values from 0 to 255, rounded; values outside
    /// [0, 1] are clamped.
    pub fn to_array_u8(&self) -> Array3<u8> {
        let values = self.to_rgb8();
        Array3::from_shape_vec((self.height(), self.width(), 3), values).expect("3 values for each pixel")
    }
}

/// A picture of the crate `image`, version 0.25.
impl From<&RgbImage> for ImageRgb {
    fn from(picture: &RgbImage) -> Self {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let values = picture.as_raw().iter().map(|&value| f32::from(value) / 255.0).collect();
        Self::new(width, height, values).expect("3 values for each pixel")
    }
}

/// Checks that a buffer's length is width · height · channels.
pub(super) fn check_buffer(len: usize, width: usize, height: usize, channels: usize) -> Result<(), ImageError> {
    let expected = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
    if expected == Some(len) { Ok(()) } else { Err(ImageError::Buffer { len, width, height, channels }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bits_are_rounded_and_clamped() {
        let values = [-0.5, 0.499 / 255.0, 0.501 / 255.0, 127.4 / 255.0, 127.6 / 255.0, 1.5];
        let picture = ImageRgb::new(2, 1, values.to_vec()).unwrap();
        assert_eq!(picture.to_rgb8(), [0, 0, 1, 127, 128, 255]);
        assert_eq!(picture.in_8_bits().data(), [0.0, 0.0, 1.0, 127.0, 128.0, 255.0].map(|value| value / 255.0));
    }
}
