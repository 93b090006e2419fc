//! Entry points of the fuzz targets in `tests/fuzz`. Only cargo-fuzz compiles this module.

use std::io::Cursor;
use std::path::Path;

use ort::value::{Shape, SymbolicDimensions, TensorElementType, ValueType};

use crate::image::{self, ImageError, ImageRgb};
use crate::network::{self, ModelCard, NetworkError};
pub use crate::scene::fuzz as scene;
use crate::surface::PhotoDepth;
use crate::surface::cache::read_for_fuzzing;

/// Decodes a PNG or JPEG of at most 4096 pixels; `None` for a larger one.
///
/// # Errors
///
/// The errors of [`image::load`].
pub fn image(bytes: &[u8]) -> Result<Option<ImageRgb>, ImageError> {
    let path = Path::new("photo");
    let size = image::header_of(path, Cursor::new(bytes))?.size;
    if size.pixels() > 1 << 12 { Ok(None) } else { image::decode(path, bytes).map(Some) }
}

/// Reads a cached depth file of a photo of 7×5 pixels, with depths of 2 to 8 scene units.
///
/// # Errors
///
/// The message says what is wrong and what was expected.
pub fn depth(bytes: &[u8]) -> Result<PhotoDepth, String> {
    read_for_fuzzing(bytes).map_err(|damage| damage.to_string())
}

/// Checks a model's metadata, and the names and shapes of its input and output.
///
/// # Errors
///
/// [`NetworkError::Unfit`].
pub fn model(
    entry: impl Fn(&str) -> Option<String>,
    input: (&str, &[i64]),
    output: (&str, &[i64]),
) -> Result<ModelCard, NetworkError> {
    let path = Path::new("model.onnx");
    let dtype = |shape: &[i64]| ValueType::Tensor {
        ty: TensorElementType::Float32,
        shape: Shape::new(shape.iter().copied()),
        dimension_symbols: SymbolicDimensions::empty(shape.len()),
    };
    let card = network::read_card(path, entry)?;
    network::check_outlets(path, &[(input.0, &dtype(input.1))], "hwv", 3 * card.views)?;
    network::check_outlets(path, &[(output.0, &dtype(output.1))], "logits", card.views)?;
    Ok(card)
}
