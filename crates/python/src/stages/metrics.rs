//! `liveview_ref.reference.image.metrics`.

use liveview::ImageRgb;
use pyo3::prelude::*;

use super::photo;
use crate::error::value;
use crate::work::compute;

/// Peak signal-to-noise ratio of pictures [3, h, w], dB; infinite for equal ones.
#[pyfunction]
pub(crate) fn psnr(py: Python<'_>, image: &Bound<'_, PyAny>, truth: &Bound<'_, PyAny>) -> PyResult<f64> {
    let (found, truth) = pair(image, truth)?;
    compute(py, || Ok(liveview_synthesizer::psnr(&found, &truth, 0)))
}

/// Structural similarity of pictures [3, h, w] of at least 11 x 11 pixels.
#[pyfunction]
pub(crate) fn ssim(py: Python<'_>, image: &Bound<'_, PyAny>, truth: &Bound<'_, PyAny>) -> PyResult<f64> {
    let (found, truth) = pair(image, truth)?;
    if found.width().min(found.height()) < 11 {
        return Err(value("image", format!("the picture is {}; expected at least 11x11", found.size())));
    }
    compute(py, || Ok(liveview_synthesizer::ssim(&found, &truth, 0)))
}

/// Two pictures of one size.
fn pair(found: &Bound<'_, PyAny>, truth: &Bound<'_, PyAny>) -> PyResult<(ImageRgb, ImageRgb)> {
    let (found, truth) = (photo::image("image", found)?, photo::image("truth", truth)?);
    let differ = || value("truth", format!("the picture is {}; expected {} as image", truth.size(), found.size()));
    if found.size() == truth.size() { Ok((found, truth)) } else { Err(differ()) }
}
