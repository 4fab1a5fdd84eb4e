//! NumPy arrays: views of memory that a world owns, and numbers taken from whatever Python has.
//!
//! The only module with `unsafe` code. A view is an array over the memory of one of a world's lists
//! (positions, velocities, ...), not a copy. Three things keep it valid:
//!
//! * Its base object is a [`Lease`], which holds a reference to the world: the memory lives as long as the
//!   array.
//! * Steps write into the lists in place and never replace them (`views_stay_where_they_are` in
//!   tests/test_world.py).
//! * Whatever would make the lists longer or shorter is refused while there is a lease: see
//!   [`Leases::refuse_resize`].
//!
//! While one thread steps a world, another that writes into its arrays races with it, as with any NumPy
//! array.

#![allow(unsafe_code)]

use graintrain::math::{Mat3, Quat, Vec3};
use numpy::ndarray::{ArrayView, IxDyn, ShapeBuilder, StrideShape};
use numpy::{Complex64, Element, PyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyBufferError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts the arrays that look into a world's memory.
#[derive(Clone, Default)]
pub struct Leases(Arc<AtomicUsize>);

impl Leases {
    /// A base object for an array that looks into the memory of `owner`.
    fn lease(&self, owner: Py<PyAny>) -> Lease {
        self.0.fetch_add(1, Ordering::AcqRel);
        Lease { _owner: owner, count: Arc::clone(&self.0) }
    }

    /// `BufferError` while there are arrays that a change of the number of bodies would leave without memory.
    pub fn refuse_resize(&self) -> PyResult<()> {
        match self.0.load(Ordering::Acquire) {
            0 => Ok(()),
            count => Err(PyBufferError::new_err(format!(
                "the number of bodies cannot change while {count} arrays look into the world's memory: delete them (del x) or keep copies \
                 of them (x = world.positions.copy())"
            ))),
        }
    }
}

/// Base object of a view: keeps the owner of the memory alive, and counts.
#[pyclass(frozen, module = "graintrain")]
struct Lease {
    _owner: Py<PyAny>,
    count: Arc<AtomicUsize>,
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.count.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Things that are so many numbers in a row in memory.
///
/// # Safety
/// The type is `repr(C)` and consists of `Self::SHAPE.product()` values of type f64 and nothing else.
pub unsafe trait Numbers {
    /// Shape of one thing.
    const SHAPE: &'static [usize];
}

// SAFETY: one f64.
unsafe impl Numbers for f64 {
    const SHAPE: &'static [usize] = &[];
}
// SAFETY: glam's DVec3 is repr(C) { x, y, z }.
unsafe impl Numbers for Vec3 {
    const SHAPE: &'static [usize] = &[3];
}
// SAFETY: glam's DQuat is repr(C) { x, y, z, w }.
unsafe impl Numbers for Quat {
    const SHAPE: &'static [usize] = &[4];
}
// SAFETY: glam's DMat3 is repr(C) { x_axis, y_axis, z_axis }, three DVec3.
unsafe impl Numbers for Mat3 {
    const SHAPE: &'static [usize] = &[3, 3];
}

/// An array over a world's list; `owner` is the world, of which `list` is a part that stays where it is while
/// there are leases.
pub fn writable<'py, T: Numbers>(
    owner: &Bound<'py, PyAny>,
    leases: &Leases,
    list: &mut [T],
) -> PyResult<Bound<'py, PyAny>> {
    const { assert!(size_of::<T>().is_multiple_of(size_of::<f64>())) };
    let shape: Vec<usize> = std::iter::once(list.len()).chain(T::SHAPE.iter().copied()).collect();
    let lease = Bound::new(owner.py(), leases.lease(owner.clone().unbind()))?;
    // SAFETY: by the contract of `Numbers` the list is that many f64; the lease keeps its memory where it is
    // and alive.
    let array = unsafe {
        let view = ArrayView::from_shape_ptr(IxDyn(&shape), list.as_mut_ptr().cast::<f64>().cast_const());
        PyArray::borrow_from_array(&view, lease.into_any())
    };
    Ok(array.into_any())
}

/// As [`writable`], for numbers that belong together with others and are not to be set one by one.
pub fn readable<'py, T: Numbers>(
    owner: &Bound<'py, PyAny>,
    leases: &Leases,
    list: &mut [T],
) -> PyResult<Bound<'py, PyAny>> {
    locked(writable(owner, leases, list)?)
}

/// A read-only array over a field of the items of a slice that `owner`, an object that never changes, holds:
/// `field` gives the first number of the first item, items are `size_of::<T>()` apart, and the field has
/// `width` numbers (0: a scalar).
pub fn field<'py, T, E: Element>(
    owner: Bound<'py, PyAny>,
    items: &[T],
    field: fn(&T) -> &E,
    width: usize,
) -> PyResult<Bound<'py, PyAny>> {
    const { assert!(size_of::<T>().is_multiple_of(size_of::<E>())) };
    let stride = size_of::<T>() / size_of::<E>();
    let (shape, strides) = match width {
        0 => (vec![items.len()], vec![stride]),
        width => (vec![items.len(), width], vec![stride, 1]),
    };
    let first = items.first().map_or(std::ptr::NonNull::<E>::dangling().as_ptr().cast_const(), |item| {
        std::ptr::from_ref(field(item))
    });
    let shape: StrideShape<IxDyn> = IxDyn(&shape).strides(IxDyn(&strides));
    // SAFETY: `field` points into the items, whose owner is the base object and never changes; callers give
    // the width of the field.
    let array = unsafe { PyArray::borrow_from_array(&ArrayView::from_shape_ptr(shape, first), owner) };
    locked(array.into_any())
}

fn locked(array: Bound<'_, PyAny>) -> PyResult<Bound<'_, PyAny>> {
    array.getattr("flags")?.setattr("writeable", false)?;
    Ok(array)
}

/// A contiguous array of these numbers that Python owns.
pub fn owned<'py, T: Element>(
    py: Python<'py>,
    numbers: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray::from_vec(py, numbers).reshape(IxDyn(shape))
}

/// Numbers of an array-like of any shape, in C order, with the shape. `what` names them in messages.
pub fn numbers(what: &str, object: &Bound<'_, PyAny>) -> PyResult<(Vec<f64>, Vec<usize>)> {
    numbers_of(what, object, "float64")
}

/// Numbers of the type that NumPy calls `dtype`.
fn numbers_of<T: Element + Copy>(
    what: &str,
    object: &Bound<'_, PyAny>,
    dtype: &str,
) -> PyResult<(Vec<T>, Vec<usize>)> {
    let py = object.py();
    let numpy = py.import("numpy")?;
    let wrong = |error: PyErr| {
        PyTypeError::new_err(format!("{what}: expected numbers ({dtype}), {}", error.value(py)))
    };
    let array = numpy.call_method1("ascontiguousarray", (object, dtype)).map_err(wrong)?;
    // A scalar becomes an array of one number there; its shape is to be that of the scalar.
    let shape: Vec<usize> = numpy.call_method1("shape", (object,))?.extract()?;
    let array: PyReadonlyArrayDyn<'_, T> = array.extract()?;
    Ok((array.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?.to_vec(), shape))
}

/// Numbers of an array-like of a given shape; `None` stands for any length.
pub fn shaped(what: &str, object: &Bound<'_, PyAny>, shape: &[Option<usize>]) -> PyResult<Vec<f64>> {
    let (numbers, found) = numbers(what, object)?;
    let fits = found.len() == shape.len()
        && found.iter().zip(shape).all(|(found, wanted)| wanted.is_none_or(|wanted| wanted == *found));
    if fits {
        return Ok(numbers);
    }
    let side = |wanted: &Option<usize>| wanted.map_or("n".to_string(), |n| n.to_string());
    let comma = if shape.len() == 1 { "," } else { "" };
    let wanted = shape.iter().map(side).collect::<Vec<_>>().join(", ");
    let found = tuple(&found);
    Err(PyValueError::new_err(format!("{what} has the shape {found}, expected ({wanted}{comma})")))
}

/// Three numbers.
pub fn vector(what: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec3> {
    Ok(Vec3::from_slice(&shaped(what, object, &[Some(3)])?))
}

/// Four numbers (x, y, z, w), normalised if they are so to 1e-6.
pub fn quaternion(what: &str, object: &Bound<'_, PyAny>) -> PyResult<Quat> {
    let q = Quat::from_slice(&shaped(what, object, &[Some(4)])?);
    if is_unit(q) { Ok(q.normalize()) } else { Err(no_rotation(what, q)) }
}

/// Whether a quaternion has the length 1 to 1e-6.
pub fn is_unit(q: Quat) -> bool {
    (q.length() - 1.0).abs() <= 1e-6
}

/// `ValueError` for a quaternion that is not of unit length.
pub fn no_rotation(what: &str, q: Quat) -> PyErr {
    let length = q.length();
    PyValueError::new_err(format!(
        "{what} is no rotation: the length of the quaternion (x, y, z, w) is {length}, expected 1"
    ))
}

/// Rows of three numbers.
pub fn vectors(what: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec<Vec3>> {
    let numbers = shaped(what, object, &[None, Some(3)])?;
    Ok(numbers.chunks_exact(3).map(Vec3::from_slice).collect())
}

/// Complex numbers of an array-like of any shape, in C order, with the shape.
pub fn complex_numbers(what: &str, object: &Bound<'_, PyAny>) -> PyResult<(Vec<Complex64>, Vec<usize>)> {
    numbers_of(what, object, "complex128")
}

/// Rows of `width` numbers of an array-like of integers that are not negative, one row after the other.
pub fn indices(what: &str, object: &Bound<'_, PyAny>, width: usize) -> PyResult<Vec<usize>> {
    let numpy = object.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (object,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let empty = shape.contains(&0);
    if !(kind == "i" || kind == "u" || empty) {
        return Err(PyTypeError::new_err(format!(
            "{what}: expected integers, got an array of kind '{kind}'"
        )));
    }
    if shape.len() != 2 || shape[1] != width {
        return Err(PyValueError::new_err(format!(
            "{what} has the shape {}, expected (n, {width})",
            tuple(&shape)
        )));
    }
    let array = numpy.call_method1("ascontiguousarray", (array, "int64"))?;
    let array: PyReadonlyArrayDyn<'_, i64> = array.extract()?;
    let numbers = array.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
    let digit = |&number: &i64| {
        usize::try_from(number)
            .map_err(|_| PyValueError::new_err(format!("{what} has the index {number}, expected at least 0")))
    };
    numbers.iter().map(digit).collect()
}

/// A shape as Python writes it.
fn tuple(shape: &[usize]) -> String {
    match shape {
        [only] => format!("({only},)"),
        shape => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}
