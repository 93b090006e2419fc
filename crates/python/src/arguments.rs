//! Arrays as arguments: numpy arrays, and what numpy makes arrays of without a copy, such as torch
//! tensors on the CPU. An exception names the argument, what it is, and what was expected.

use std::error::Error as StdError;
use std::fmt::Display;

use liveview::geometry::MAX_SIDE;
use liveview_scene::Scene;
use ndarray::{Array1, Array2, Dimension};
use numpy::{
    Element, PyArray1, PyArray2, PyArray3, PyArrayDescrMethods, PyReadonlyArray, PyUntypedArray, PyUntypedArrayMethods,
    dtype,
};
use pyo3::PyErr;
use pyo3::call::PyCallArgs;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Any Python object, as an argument or a result.
pub(crate) type Object<'py> = Bound<'py, PyAny>;
/// A map as a result, `[h, w]`.
pub(crate) type Map<'py, T = f32> = Bound<'py, PyArray2<T>>;
/// Maps as a result, `[n, h, w]`.
pub(crate) type Maps<'py, T = f32> = Bound<'py, PyArray3<T>>;

/// The sides that the arguments of one call share, by letter.
#[derive(Default)]
pub(crate) struct Sides(Vec<(char, usize, String)>);

impl Sides {
    /// An array of this type; `shape` names its sides, such as `L 3 H W`: letters are the same in
    /// all arguments. It is contiguous and aligned, by a copy where the argument is not.
    pub(crate) fn array<'py, T: Element, D: Dimension>(
        &mut self,
        name: &str,
        argument: &Object<'py>,
        shape: &str,
    ) -> PyResult<PyReadonlyArray<'py, T, D>> {
        let array = as_array(name, argument)?;
        let (found, expected) = (array.dtype(), dtype::<T>(argument.py()));
        if !found.is_equiv_to(&expected) {
            return Err(kind(name, format!("the array is {found}; expected {expected}")));
        }
        self.check(name, array.shape(), shape)?;
        array.extract().map_err(|error: PyErr| kind(name, error))
    }

    /// Checks the sides of an argument, and remembers those that are new.
    pub(crate) fn check(&mut self, name: &str, found: &[usize], shape: &str) -> PyResult<()> {
        let expected: Vec<&str> = shape.split(' ').collect();
        let wrong =
            |why: String| value(name, format!("the shape is {found:?}; expected [{}]{why}", expected.join(", ")));
        if found.len() != expected.len() {
            return Err(wrong(String::new()));
        }
        for (&side, &word) in found.iter().zip(&expected) {
            if side == 0 {
                return Err(wrong(", no side of 0".to_owned()));
            }
            if let Ok(number) = word.parse::<usize>() {
                if side != number {
                    return Err(wrong(String::new()));
                }
                continue;
            }
            let letter = word.chars().next().unwrap_or_default();
            if matches!(letter.to_ascii_uppercase(), 'H' | 'W') && side > MAX_SIDE {
                return Err(wrong(format!(", {word} at most {MAX_SIDE}")));
            }
            match self.0.iter().find(|(known, ..)| *known == letter) {
                Some((_, known, of)) if *known != side => return Err(wrong(format!(", {word} = {known} as in {of}"))),
                Some(_) => {}
                None => self.0.push((letter, side, name.to_owned())),
            }
        }
        Ok(())
    }

    /// The length of a side that an argument before had; 0 if none had it.
    pub(crate) fn length(&self, letter: char) -> usize {
        self.0.iter().find(|(known, ..)| *known == letter).map_or(0, |(_, length, _)| *length)
    }
}

/// The array that numpy makes of an argument: contiguous, aligned and of numpy's own class.
pub(crate) fn as_array<'py>(name: &str, argument: &Object<'py>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let numpy = argument.py().import("numpy")?;
    if argument.is_instance(&numpy.getattr("ma")?.getattr("MaskedArray")?)? {
        return Err(kind(name, "a masked array; expected one without a mask"));
    }
    let options = PyDict::new(argument.py());
    options.set_item("requirements", ("C", "A", "E"))?;
    let array = numpy.call_method("require", (argument,), Some(&options));
    let array = array.map_err(|error| kind(name, format!("not an array: {error}")))?;
    array.cast_into::<PyUntypedArray>().map_err(|_| kind(name, "not an array"))
}

/// The items of a list, or the parts of an array, with their names.
pub(crate) fn items<'py>(name: &str, argument: &Object<'py>) -> PyResult<Vec<(String, Object<'py>)>> {
    let found = argument.try_iter().map_err(|_| kind(name, "expected a list or an array"))?;
    let found = found.enumerate().map(|(index, item)| Ok((format!("{name}[{index}]"), item?)));
    found.collect()
}

/// As [`items`], at least one.
pub(crate) fn some<'py>(name: &str, argument: &Object<'py>) -> PyResult<Vec<(String, Object<'py>)>> {
    let found = items(name, argument)?;
    if found.is_empty() { Err(value(name, "there are none; expected at least one")) } else { Ok(found) }
}

/// Numbers of any type as f64, `shape` as [`Sides::array`] takes it.
fn numbers<'py>(name: &str, argument: &Object<'py>, shape: &str) -> PyResult<Object<'py>> {
    let array = as_array(name, argument)?;
    let found = array.dtype();
    if !matches!(found.kind(), b'f' | b'i' | b'u') {
        return Err(kind(name, format!("the array is {found}; expected numbers")));
    }
    Sides::default().check(name, array.shape(), shape)?;
    array.call_method1("astype", ("float64",))
}

/// A vector of numbers.
pub(crate) fn vector(name: &str, argument: &Object<'_>, shape: &str) -> PyResult<Array1<f64>> {
    use numpy::PyArrayMethods;
    Ok(numbers(name, argument, shape)?.cast_into::<PyArray1<f64>>()?.to_owned_array())
}

/// A matrix of numbers, row by row.
pub(crate) fn matrix<const R: usize, const C: usize>(name: &str, argument: &Object<'_>) -> PyResult<[[f64; C]; R]> {
    use numpy::PyArrayMethods;
    let found = numbers(name, argument, &format!("{R} {C}"))?.cast_into::<PyArray2<f64>>()?;
    let found: Array2<f64> = found.to_owned_array();
    Ok(std::array::from_fn(|row| std::array::from_fn(|column| found[[row, column]])))
}

/// A number of pixels, layers or views.
pub(crate) fn whole(name: &str, argument: &Object<'_>) -> PyResult<usize> {
    argument.extract().map_err(|_| kind(name, format!("{argument}; expected a whole number of at least 0")))
}

/// Distances, scene units: finite, at least 0.
pub(crate) fn distances(name: &str, argument: &Object<'_>, shape: &str) -> PyResult<Array1<f64>> {
    let found = vector(name, argument, shape)?;
    match found.iter().find(|distance| !(distance.is_finite() && **distance >= 0.0)) {
        Some(wrong) => Err(value(name, format!("a distance is {wrong}; expected finite numbers of at least 0"))),
        None => Ok(found),
    }
}

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

/// Refuses an argument unless it is as expected.
pub(crate) fn expect(argument: &str, found: impl Display, is_right: bool, expected: &str) -> PyResult<()> {
    if is_right { Ok(()) } else { Err(value(argument, format!("{found}; expected {expected}"))) }
}

/// A field of an argument, which is to be of a class that has it.
pub(crate) fn field<'py>(argument: &str, of: &Object<'py>, field: &str, class: &str) -> PyResult<Object<'py>> {
    of.getattr(field).map_err(|_| kind(argument, format!("it has no {field}; expected {class}")))
}

/// The exception of an argument of another type.
pub(crate) fn kind(argument: &str, what: impl Display) -> PyErr {
    PyTypeError::new_err(format!("{argument}: {what}"))
}

/// Index of the view that an argument names, or is the index of.
pub(crate) fn view_index(scene: &Scene, name: &str, argument: &Object<'_>) -> PyResult<usize> {
    if let Ok(text) = argument.extract::<String>() {
        return scene.view_index(&text).map_err(library);
    }
    let count = scene.views.len();
    let index: isize = argument.extract().map_err(|_| kind(name, "expected the name of a view, or its index"))?;
    let found = if index < 0 { index + count as isize } else { index };
    let found = usize::try_from(found).ok().filter(|&found| found < count);
    found.ok_or_else(|| value(name, format!("there is no view {index}; expected one of {count}")))
}

/// The named tuple of that class.
pub(crate) fn named<'py>(py: Python<'py>, class: &str, fields: impl PyCallArgs<'py>) -> PyResult<Object<'py>> {
    py.import("liveview._tuples")?.getattr(class)?.call1(fields)
}
