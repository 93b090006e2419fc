//! The library's errors as Python exceptions.

use std::error::Error as StdError;
use std::fmt::Display;

use pyo3::PyErr;
use pyo3::exceptions::{PyTypeError, PyValueError};

pyo3::create_exception!(
    liveview,
    Error,
    pyo3::exceptions::PyRuntimeError,
    "What the library refuses or cannot do: a scene, a model, a target. The text is the library's."
);

/// The exception of an error of the library.
pub(crate) fn library(error: impl StdError) -> PyErr {
    Error::new_err(error.to_string())
}

/// The exception of an argument whose value is refused.
pub(crate) fn value(argument: &str, what: impl Display) -> PyErr {
    PyValueError::new_err(format!("{argument}: {what}"))
}

/// The exception of an argument of another type.
pub(crate) fn kind(argument: &str, what: impl Display) -> PyErr {
    PyTypeError::new_err(format!("{argument}: {what}"))
}
