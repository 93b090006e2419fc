//! Photos `[3, h, w]` as arguments.

use liveview::ImageRgb;
use liveview::warp::{SourceView, Texture};
use ndarray::{ArrayView3, Ix3};
use numpy::PyReadonlyArray;
use pyo3::prelude::*;

use crate::arguments::{Sides, items, some};
use crate::camera::camera;
use crate::error::{kind, value};

/// A photo `[3, h, w]` of f32 with any values.
pub(super) fn image(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<ImageRgb> {
    let array: PyReadonlyArray<'_, f32, Ix3> = Sides::default().array(name, argument, "3 h w")?;
    ImageRgb::from_array(interleaved(array.as_array())).map_err(|error| value(name, error))
}

/// `[h, w, 3]` of `[3, h, w]`.
fn interleaved(planes: ArrayView3<'_, f32>) -> ArrayView3<'_, f32> {
    planes.permuted_axes([1, 2, 0])
}

/// A photo and its camera.
pub(super) struct Photo {
    pub(super) texture: Texture,
    pub(super) camera: liveview::Camera,
}

impl Photo {
    /// A photo `[3, h, w]` of values in [0, 1], of its camera's size.
    pub(super) fn new(
        (image_name, argument): (&str, &Bound<'_, PyAny>),
        (camera_name, of): (&str, &Bound<'_, PyAny>),
    ) -> PyResult<Self> {
        let (picture, camera) = (image(image_name, argument)?, camera(camera_name, of)?);
        if let Some(found) = picture.data().iter().find(|value| !(0.0..=1.0).contains(*value)) {
            return Err(value(image_name, format!("a value is {found}; expected values in [0, 1]")));
        }
        if picture.size() != camera.size() {
            let what = format!("the photo is {}; expected {} as {camera_name}", picture.size(), camera.size());
            return Err(value(image_name, what));
        }
        Ok(Self { texture: Texture::new(&picture), camera })
    }

    /// A photo as the reference's `View`: the pair of photo and camera.
    pub(super) fn pair(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (image, camera) = two(name, argument, "photo and camera")?;
        Self::new((&format!("{name}[0]"), &image), (&format!("{name}[1]"), &camera))
    }

    /// As [`Photo::pair`], of a list with one at least.
    pub(super) fn pairs(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<Vec<Self>> {
        some(name, argument)?.iter().map(|(name, pair)| Self::pair(name, pair)).collect()
    }

    pub(super) fn source(&self) -> SourceView<'_> {
        SourceView { camera: &self.camera, texture: &self.texture }
    }
}

/// The two items of a pair.
pub(super) fn two<'py>(
    name: &str,
    argument: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    argument.extract().map_err(|_| kind(name, format!("expected a pair of {what}")))
}

/// Photos and their cameras from two lists of the same length.
pub(super) fn photos(images: (&str, &Bound<'_, PyAny>), cameras: (&str, &Bound<'_, PyAny>)) -> PyResult<Vec<Photo>> {
    let (found, of) = (some(images.0, images.1)?, items(cameras.0, cameras.1)?);
    if found.len() != of.len() {
        return Err(value(cameras.0, format!("{} of them; expected {} as in {}", of.len(), found.len(), images.0)));
    }
    let pairs = found.iter().zip(&of);
    pairs.map(|((name, image), (camera, at))| Photo::new((name, image), (camera, at))).collect()
}
