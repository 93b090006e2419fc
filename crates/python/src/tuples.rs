//! Results of several arrays: the named tuples of `liveview._tuples`.

use pyo3::call::PyCallArgs;
use pyo3::prelude::*;

/// The named tuple of that class.
pub(crate) fn named<'py>(py: Python<'py>, class: &str, fields: impl PyCallArgs<'py>) -> PyResult<Bound<'py, PyAny>> {
    py.import("liveview._tuples")?.getattr(class)?.call1(fields)
}
