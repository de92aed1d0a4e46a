//! Numbers to and from the arrays of the package.

use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Writes all values into a contiguous array of as many.
pub(super) fn put<T: Element>(array: &Bound<PyAny>, values: &[T]) -> PyResult<()> {
    let buffer = fitting::<T>(array, values.len())?;
    buffer.copy_from_slice(array.py(), values)
}

/// Reads all values from a contiguous array of as many.
pub(super) fn take<T: Element>(array: &Bound<PyAny>, values: &mut [T]) -> PyResult<()> {
    let buffer = fitting::<T>(array, values.len())?;
    buffer.copy_to_slice(array.py(), values)
}

/// The memory of an array that holds so many values.
fn fitting<T: Element>(array: &Bound<PyAny>, values: usize) -> PyResult<PyBuffer<T>> {
    let buffer = PyBuffer::<T>::get(array)?;
    if buffer.item_count() == values && buffer.is_c_contiguous() {
        return Ok(buffer);
    }
    Err(PyValueError::new_err(format!(
        "an array of {} values was given instead of a contiguous one of {values}",
        buffer.item_count()
    )))
}
