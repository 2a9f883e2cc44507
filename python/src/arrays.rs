//! numpy arrays as slices of the library's types.

use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2};

use crate::failure::Failure;

/// An array of rows, as it lies in memory.
pub(crate) fn rows<'a, T: Element + 'a, const N: usize>(
    array: &'a PyReadonlyArray2<'_, T>,
    name: &str,
) -> Result<&'a [[T; N]], Failure> {
    let flat = array.as_slice().map_err(|_| not_contiguous(name))?;
    let (rows, rest) = flat.as_chunks::<N>();
    let columns = array.as_array().ncols();
    if columns != N || !rest.is_empty() {
        let text = format!("{name} has {columns} columns, but must have {N}");
        return Err(Failure::new("ShapeError", text));
    }
    Ok(rows)
}

/// An array of numbers, as it lies in memory.
pub(crate) fn flat<'a, T: Element>(
    array: &'a PyReadonlyArray1<'_, T>,
    name: &str,
) -> Result<&'a [T], Failure> {
    array.as_slice().map_err(|_| not_contiguous(name))
}

/// An array that takes as many results as there are questions.
pub(crate) fn room<'a, T: Element>(
    array: &'a mut PyReadwriteArray1<'_, T>,
    length: usize,
) -> Result<&'a mut [T], Failure> {
    let slice = array.as_slice_mut().map_err(|_| not_contiguous("a result"))?;
    check_room(slice.len(), length)?;
    Ok(slice)
}

/// The same for rows.
pub(crate) fn room_for_rows<'a, T: Element, const N: usize>(
    array: &'a mut PyReadwriteArray2<'_, T>,
    length: usize,
) -> Result<&'a mut [[T; N]], Failure> {
    let slice = array.as_slice_mut().map_err(|_| not_contiguous("a result"))?;
    let (rows, rest) = slice.as_chunks_mut::<N>();
    check_room(rows.len() + rest.len(), length)?;
    Ok(rows)
}

fn check_room(room: usize, length: usize) -> Result<(), Failure> {
    match room == length {
        true => Ok(()),
        false => {
            let text = format!("there is room for {room} results, but {length} are asked for");
            Err(Failure::new("ShapeError", text))
        }
    }
}

fn not_contiguous(name: &str) -> Failure {
    Failure::new("ShapeError", format!("{name} must be aligned and contiguous, in the order of C"))
}

/// Room for this many things, or an error.
pub(crate) fn reserved<T: Clone>(length: usize, fill: T) -> Result<Vec<T>, Failure> {
    let mut own = Vec::new();
    let refused = |_| Failure::memory(length.saturating_mul(size_of::<T>()));
    own.try_reserve_exact(length).map_err(refused)?;
    own.resize(length, fill);
    Ok(own)
}
