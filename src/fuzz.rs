//! Entry points of the fuzz targets in `tests/fuzz`.

use std::path::Path;

use ort::value::{Shape, SymbolicDimensions, TensorElementType, ValueType};

use crate::network::{self, ModelCard, NetworkError};

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
