//! Arrays of the caller's, by pointer and stride, and single things behind pointers. Nothing is read or written before it has been checked.

use std::ffi::{CStr, c_char};
use std::marker::PhantomData;

use bytemuck::Pod;

use crate::status::{Failure, Status};

/// Checks a pointer to one thing.
pub(crate) fn check<T>(pointer: *const T, what: &str) -> Result<(), Failure> {
    if pointer.is_null() {
        return Err(Failure::new(Status::NullPointer, format!("{what} is NULL")));
    }
    if !pointer.is_aligned() {
        let text = format!("{what} is at {pointer:p}, not a multiple of {}", align_of::<T>());
        return Err(Failure::new(Status::Misaligned, text));
    }
    Ok(())
}

/// Reads one thing.
///
/// # Safety
/// A pointer that passes the check points to a `T`.
pub(crate) unsafe fn read<T: Copy>(pointer: *const T, what: &str) -> Result<T, Failure> {
    check(pointer, what)?;
    // SAFETY: the pointer is aligned and not null; the caller vouches for the rest.
    Ok(unsafe { pointer.read() })
}

/// Writes one thing.
///
/// # Safety
/// A pointer that passes the check points to room for a `T`.
pub(crate) unsafe fn write<T>(pointer: *mut T, value: T, what: &str) -> Result<(), Failure> {
    check(pointer, what)?;
    // SAFETY: the pointer is aligned and not null; the caller vouches for the rest.
    unsafe { pointer.write(value) };
    Ok(())
}

/// Writes one thing, if the caller wants it.
///
/// # Safety
/// As for [`write`].
pub(crate) unsafe fn offer<T>(pointer: *mut T, value: T, what: &str) -> Result<(), Failure> {
    if pointer.is_null() {
        return Ok(());
    }
    // SAFETY: as the caller says.
    unsafe { write(pointer, value, what) }
}

/// Checks a pointer that may be NULL.
pub(crate) fn check_offer<T>(pointer: *const T, what: &str) -> Result<(), Failure> {
    if pointer.is_null() { Ok(()) } else { check(pointer, what) }
}

/// Longest text, its end included.
const LONGEST: usize = 4096;

/// A text.
///
/// # Safety
/// A pointer that is not null points to bytes up to a 0.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a str, Failure> {
    check(pointer, what)?;
    let bad = |how: &str| Failure::new(Status::Text, format!("{what} {how}"));
    // SAFETY: bytes up to a 0 can be read, and none is read behind it.
    let length = (0..LONGEST).find(|&place| unsafe { pointer.add(place).read() } == 0);
    length.ok_or_else(|| bad("has no end within 4096 bytes"))?;
    // SAFETY: there is a 0.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| bad("is not UTF-8"))
}

/// Where the bytes of an array's items are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Places {
    start: usize,
    /// Behind the last item.
    end: usize,
    stride: usize,
    item: usize,
}

impl Places {
    /// Checks that items of type `T` can be there.
    fn new<T>(first: *const T, stride: usize, count: usize, what: &str) -> Result<Places, Failure> {
        let (item, start) = (size_of::<T>(), first.addr());
        if count == 0 {
            return Ok(Places { start, end: start, stride, item });
        }
        check(first, what)?;
        if stride < item || !stride.is_multiple_of(align_of::<T>()) {
            let text = format!(
                "the stride of {what} is {stride} bytes, but must be {item} or more and a multiple of {}",
                align_of::<T>()
            );
            return Err(Failure::new(Status::Stride, text));
        }
        let bytes = (count - 1).checked_mul(stride).and_then(|bytes| bytes.checked_add(item));
        let end = bytes.filter(|&bytes| bytes <= isize::MAX as usize);
        match end.and_then(|bytes| start.checked_add(bytes)) {
            Some(end) => Ok(Places { start, end, stride, item }),
            None => {
                let text = format!("{what}: no memory can hold {count} items {stride} bytes apart");
                Err(Failure::new(Status::Count, text))
            }
        }
    }

    /// Whether two arrays share bytes of items. Items of one may lie between those of the other, where strides are equal.
    fn meets(&self, other: &Places) -> bool {
        if self.start >= other.end || other.start >= self.end {
            return false;
        }
        if self.stride != other.stride {
            return true;
        }
        let stride = self.stride;
        // Where other's item begins within the stride of ours.
        let offset = (other.start % stride + stride - self.start % stride) % stride;
        !(offset >= self.item && offset + other.item <= stride)
    }
}

/// Items that are read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Given<'a, T> {
    first: *const T,
    count: usize,
    pub(crate) places: Places,
    here: PhantomData<&'a T>,
}

// SAFETY: the memory can be read from any thread.
unsafe impl<T: Sync> Send for Given<'_, T> {}
// SAFETY: as above.
unsafe impl<T: Sync> Sync for Given<'_, T> {}

impl<'a, T: Pod> Given<'a, T> {
    /// # Safety
    /// What passes the checks is memory that can be read, and that nobody writes, for `'a`.
    pub(crate) unsafe fn new(
        first: *const T,
        stride: usize,
        count: usize,
        what: &str,
    ) -> Result<Given<'a, T>, Failure> {
        let places = Places::new(first, stride, count, what)?;
        Ok(Given { first, count, places, here: PhantomData })
    }

    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn stride(&self) -> usize {
        self.places.stride
    }

    pub(crate) fn first(&self) -> *const T {
        self.first
    }

    #[inline]
    pub(crate) fn at(&self, place: usize) -> T {
        assert!(place < self.count, "an item is not there");
        // SAFETY: the item is there, aligned, and any bytes are a T.
        unsafe { self.first.byte_add(place * self.places.stride).read() }
    }

    /// The items as a slice, where there is nothing between them.
    pub(crate) fn packed(&self) -> Option<&'a [T]> {
        if self.count == 0 {
            return Some(&[]);
        }
        // SAFETY: so many items lie one after the other, and nobody writes them.
        (self.places.stride == size_of::<T>())
            .then(|| unsafe { std::slice::from_raw_parts(self.first, self.count) })
    }

    /// The items side by side: as they are, or copied into `copy`.
    pub(crate) fn beside<'b>(&self, copy: &'b mut Vec<T>) -> Result<&'b [T], Failure>
    where
        'a: 'b,
    {
        if let Some(packed) = self.packed() {
            return Ok(packed);
        }
        reserve(copy, self.count)?;
        copy.extend((0..self.count).map(|place| self.at(place)));
        Ok(copy)
    }
}

/// Items that are written.
#[derive(Debug)]
pub(crate) struct Wanted<'a, T> {
    first: *mut T,
    count: usize,
    places: Places,
    here: PhantomData<&'a mut T>,
}

// SAFETY: the memory can be written from any thread.
unsafe impl<T: Send> Send for Wanted<'_, T> {}

impl<T: Copy> Wanted<'_, T> {
    /// # Safety
    /// What passes the checks is memory that can be written, and that nobody else reads or writes, for `'a`.
    pub(crate) unsafe fn new(
        first: *mut T,
        stride: usize,
        count: usize,
        what: &str,
    ) -> Result<Self, Failure> {
        let places = Places::new(first, stride, count, what)?;
        Ok(Wanted { first, count, places, here: PhantomData })
    }

    /// Refuses an array that is read and shares bytes with this one.
    pub(crate) fn apart_from(&self, given: &Places) -> Result<(), Failure> {
        if self.places.meets(given) {
            let text = "the array of answers shares bytes with one that is read";
            return Err(Failure::new(Status::Overlap, text));
        }
        Ok(())
    }

    #[inline]
    pub(crate) fn set(&mut self, place: usize, value: T) {
        assert!(place < self.count, "an item is not there");
        // SAFETY: there is room for the item, aligned.
        unsafe { self.first.byte_add(place * self.places.stride).write(value) };
    }

    pub(crate) fn fill(&mut self, value: T) {
        for place in 0..self.count {
            self.set(place, value);
        }
    }

    /// The items as a slice, where there is nothing between them. What is in them has to be `T`s: any bytes are, or they were filled.
    pub(crate) fn packed(&mut self) -> Option<&mut [T]> {
        if self.count == 0 {
            return Some(&mut []);
        }
        // SAFETY: so many items lie one after the other, and nobody else reads or writes them.
        (self.places.stride == size_of::<T>())
            .then(|| unsafe { std::slice::from_raw_parts_mut(self.first, self.count) })
    }
}

/// Room for so many more.
pub(crate) fn reserve<T>(list: &mut Vec<T>, more: usize) -> Result<(), Failure> {
    let bytes = more.saturating_mul(size_of::<T>());
    list.try_reserve_exact(more).map_err(|_| Failure::memory(bytes))
}

/// So many of one thing.
pub(crate) fn filled<T: Clone>(count: usize, value: T) -> Result<Vec<T>, Failure> {
    let mut list = Vec::new();
    reserve(&mut list, count)?;
    list.resize(count, value);
    Ok(list)
}

/// Points of three coordinates.
///
/// # Safety
/// As for [`Given::new`].
pub(crate) unsafe fn points<'a>(
    first: *const f32,
    stride: usize,
    count: usize,
) -> Result<Given<'a, [f32; 3]>, Failure> {
    // SAFETY: as the caller says.
    unsafe { Given::new(first.cast(), stride, count, "points") }
}
