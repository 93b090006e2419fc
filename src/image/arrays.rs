//! Pictures from and to arrays `[h, w, 3]` and pictures of the crate `image`.

use image::RgbImage;
use ndarray::{Array3, ArrayView3};

use super::error::ImageError;
use super::rgb::ImageRgb;

impl ImageRgb {
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
