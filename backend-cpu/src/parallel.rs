//! Parallel loops over slices, on the threads of the calling pool.
//!
//! The names are rayon's and mean the same. Rayon compiles some dozen functions for every loop; these compile the body
//! alone, and hand out its parts by index from one loop over rayon's range.

use core::marker::PhantomData;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};
use splitplane_float_state::Standard;

/// Calls `body` with each index below `count`, in the default floating-point state whatever that of the pool's threads
/// is. A task has at least `least` indices, and at most `most`.
#[inline(never)]
fn for_each_index(count: usize, least: usize, most: usize, body: &(dyn Fn(usize) + Sync)) {
    let indices = (0..count).into_par_iter().with_min_len(least).with_max_len(most);
    indices.for_each(|index| {
        let _state = Standard::set();
        body(index);
    });
}

/// Something that tasks take apart.
///
/// # Safety
/// Parts of different indices must be usable on different threads at once.
pub(crate) unsafe trait Parallel: Sized + Sync {
    /// What a task gets.
    type Part;

    /// How many parts there are.
    fn count(&self) -> usize;

    /// The part of an index below [`Parallel::count`].
    ///
    /// # Safety
    /// Each index may be taken once.
    unsafe fn part(&self, index: usize) -> Self::Part;

    /// The least and the most parts of a task.
    fn grain(&self) -> [usize; 2] {
        [1, usize::MAX]
    }

    /// Pairs of parts of equal index, as many as the shorter one has.
    fn zip<O: IntoParallel>(self, other: O) -> Zip<Self, O::Parallel> {
        Zip(self, other.into_parallel())
    }

    /// Parts with their indices before them.
    fn enumerate(self) -> Enumerate<Self> {
        Enumerate(self)
    }

    /// At least so many parts a task.
    fn with_min_len(self, least: usize) -> Grain<Self> {
        Grain { parts: self, grain: [least, usize::MAX] }
    }

    /// At most so many parts a task.
    fn with_max_len(self, most: usize) -> Grain<Self> {
        Grain { parts: self, grain: [1, most] }
    }

    /// Calls `body` with every part.
    fn for_each(self, body: impl Fn(Self::Part) + Sync) {
        let [least, most] = self.grain();
        for_each_index(self.count(), least, most, &|index| {
            // SAFETY: the loop gives each index below the count once.
            body(unsafe { self.part(index) });
        });
    }

    /// Calls `body` with every part until one call fails; returns one of the errors.
    fn try_for_each<E: Send>(
        self,
        body: impl Fn(Self::Part) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        let (failed, first) = (AtomicBool::new(false), Mutex::new(None));
        self.for_each(|part| {
            if !failed.load(Relaxed)
                && let Err(error) = body(part)
            {
                failed.store(true, Relaxed);
                *first.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
        });
        first.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
    }

    /// Joins what `body` returns for all parts to `start`, in no particular order.
    fn try_reduce<R: Send, E: Send>(
        self,
        start: R,
        body: impl Fn(Self::Part) -> Result<R, E> + Sync,
        join: impl Fn(&mut R, R) -> Result<(), E> + Sync,
    ) -> Result<R, E> {
        let all = Mutex::new(start);
        self.try_for_each(|part| {
            let one = body(part)?;
            join(&mut all.lock().unwrap_or_else(PoisonError::into_inner), one)
        })?;
        Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// [`Parallel::try_reduce`] that cannot fail.
    fn reduce<R: Send>(
        self,
        start: R,
        body: impl Fn(Self::Part) -> R + Sync,
        join: impl Fn(&mut R, R) + Sync,
    ) -> R {
        let all = Mutex::new(start);
        self.for_each(|part| {
            let one = body(part);
            join(&mut all.lock().unwrap_or_else(PoisonError::into_inner), one);
        });
        all.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// What `body` returns for each part, in the order of the parts.
    fn collect<R: Send>(self, body: impl Fn(Self::Part) -> R + Sync) -> Vec<R> {
        let mut all: Vec<Option<R>> = Vec::new();
        all.resize_with(self.count(), || None);
        self.zip(&mut all).for_each(|(part, out)| *out = Some(body(part)));
        all.into_iter().flatten().collect()
    }

    /// What `body` returns for each part, in the order of the parts, or one of its errors.
    fn try_collect<R: Send, E: Send>(
        self,
        body: impl Fn(Self::Part) -> Result<R, E> + Sync,
    ) -> Result<Vec<R>, E> {
        let mut all: Vec<Option<R>> = Vec::new();
        all.resize_with(self.count(), || None);
        self.zip(&mut all).try_for_each(|(part, out)| {
            *out = Some(body(part)?);
            Ok(())
        })?;
        Ok(all.into_iter().flatten().collect())
    }
}

/// Elements of a slice.
#[derive(Clone, Copy)]
pub(crate) struct Each<'a, T>(&'a [T]);

// SAFETY: shared references.
unsafe impl<'a, T: Sync> Parallel for Each<'a, T> {
    type Part = &'a T;

    fn count(&self) -> usize {
        self.0.len()
    }

    unsafe fn part(&self, index: usize) -> &'a T {
        &self.0[index]
    }
}

/// Chunks of a slice, of which the last may be shorter.
#[derive(Clone, Copy)]
pub(crate) struct Chunks<'a, T>(&'a [T], usize);

// SAFETY: shared references.
unsafe impl<'a, T: Sync> Parallel for Chunks<'a, T> {
    type Part = &'a [T];

    fn count(&self) -> usize {
        self.0.len().div_ceil(self.1)
    }

    unsafe fn part(&self, index: usize) -> &'a [T] {
        let start = index * self.1;
        &self.0[start..self.0.len().min(start + self.1)]
    }
}

/// Chunks of a slice to write to, of which the last may be shorter.
pub(crate) struct ChunksMut<'a, T> {
    start: *mut T,
    length: usize,
    chunk: usize,
    borrow: PhantomData<&'a mut [T]>,
}

// SAFETY: shared by tasks only to take parts, which do not overlap.
unsafe impl<T: Send> Sync for ChunksMut<'_, T> {}

// SAFETY: chunks do not overlap, and may be sent.
unsafe impl<'a, T: Send> Parallel for ChunksMut<'a, T> {
    type Part = &'a mut [T];

    fn count(&self) -> usize {
        self.length.div_ceil(self.chunk)
    }

    unsafe fn part(&self, index: usize) -> &'a mut [T] {
        let start = index * self.chunk;
        assert!(start < self.length, "chunk {index} of {}", self.count());
        let length = self.chunk.min(self.length - start);
        // SAFETY: within the slice, which is borrowed; by the caller's contract no chunk is taken twice.
        unsafe { core::slice::from_raw_parts_mut(self.start.add(start), length) }
    }
}

/// Elements of a slice to write to.
pub(crate) struct EachMut<'a, T>(ChunksMut<'a, T>);

// SAFETY: chunks of one element.
unsafe impl<'a, T: Send> Parallel for EachMut<'a, T> {
    type Part = &'a mut T;

    fn count(&self) -> usize {
        self.0.length
    }

    unsafe fn part(&self, index: usize) -> &'a mut T {
        // SAFETY: the caller's contract.
        unsafe { &mut self.0.part(index)[0] }
    }
}

/// See [`Parallel::zip`].
pub(crate) struct Zip<A, B>(A, B);

// SAFETY: that of both.
unsafe impl<A: Parallel, B: Parallel> Parallel for Zip<A, B> {
    type Part = (A::Part, B::Part);

    fn count(&self) -> usize {
        self.0.count().min(self.1.count())
    }

    unsafe fn part(&self, index: usize) -> (A::Part, B::Part) {
        // SAFETY: the caller's contract; neither has fewer parts.
        unsafe { (self.0.part(index), self.1.part(index)) }
    }

    fn grain(&self) -> [usize; 2] {
        self.0.grain()
    }
}

/// See [`Parallel::enumerate`].
pub(crate) struct Enumerate<A>(A);

// SAFETY: that of the parts.
unsafe impl<A: Parallel> Parallel for Enumerate<A> {
    type Part = (usize, A::Part);

    fn count(&self) -> usize {
        self.0.count()
    }

    unsafe fn part(&self, index: usize) -> (usize, A::Part) {
        // SAFETY: the caller's contract.
        (index, unsafe { self.0.part(index) })
    }

    fn grain(&self) -> [usize; 2] {
        self.0.grain()
    }
}

/// See [`Parallel::with_min_len`].
pub(crate) struct Grain<A> {
    parts: A,
    grain: [usize; 2],
}

// SAFETY: that of the parts.
unsafe impl<A: Parallel> Parallel for Grain<A> {
    type Part = A::Part;

    fn count(&self) -> usize {
        self.parts.count()
    }

    unsafe fn part(&self, index: usize) -> A::Part {
        // SAFETY: the caller's contract.
        unsafe { self.parts.part(index) }
    }

    fn grain(&self) -> [usize; 2] {
        self.grain
    }
}

/// What [`Parallel::zip`] takes.
pub(crate) trait IntoParallel {
    /// Its parts.
    type Parallel: Parallel;

    /// Its parts.
    fn into_parallel(self) -> Self::Parallel;
}

impl<P: Parallel> IntoParallel for P {
    type Parallel = P;

    fn into_parallel(self) -> P {
        self
    }
}

impl<'a, T: Sync> IntoParallel for &'a [T] {
    type Parallel = Each<'a, T>;

    fn into_parallel(self) -> Each<'a, T> {
        Each(self)
    }
}

impl<'a, T: Sync> IntoParallel for &'a Vec<T> {
    type Parallel = Each<'a, T>;

    fn into_parallel(self) -> Each<'a, T> {
        Each(self)
    }
}

impl<'a, T: Send> IntoParallel for &'a mut [T] {
    type Parallel = EachMut<'a, T>;

    fn into_parallel(self) -> EachMut<'a, T> {
        EachMut(self.par_chunks_mut(1))
    }
}

impl<'a, T: Send> IntoParallel for &'a mut Vec<T> {
    type Parallel = EachMut<'a, T>;

    fn into_parallel(self) -> EachMut<'a, T> {
        EachMut(self.par_chunks_mut(1))
    }
}

/// The parts of a slice.
pub(crate) trait ParallelSlice<T> {
    /// Its elements.
    fn par_iter<'a>(&'a self) -> Each<'a, T>
    where
        T: 'a;

    /// Its elements, to write to.
    fn par_iter_mut<'a>(&'a mut self) -> EachMut<'a, T>
    where
        T: 'a;

    /// Chunks of so many elements, which must be more than none.
    fn par_chunks<'a>(&'a self, chunk: usize) -> Chunks<'a, T>
    where
        T: 'a;

    /// The same, to write to.
    fn par_chunks_mut<'a>(&'a mut self, chunk: usize) -> ChunksMut<'a, T>
    where
        T: 'a;
}

impl<T> ParallelSlice<T> for [T] {
    fn par_iter<'a>(&'a self) -> Each<'a, T>
    where
        T: 'a,
    {
        Each(self)
    }

    fn par_iter_mut<'a>(&'a mut self) -> EachMut<'a, T>
    where
        T: 'a,
    {
        EachMut(self.par_chunks_mut(1))
    }

    fn par_chunks<'a>(&'a self, chunk: usize) -> Chunks<'a, T>
    where
        T: 'a,
    {
        assert!(chunk > 0, "chunks have elements");
        Chunks(self, chunk)
    }

    fn par_chunks_mut<'a>(&'a mut self, chunk: usize) -> ChunksMut<'a, T>
    where
        T: 'a,
    {
        assert!(chunk > 0, "chunks have elements");
        let (start, length) = (self.as_mut_ptr(), self.len());
        ChunksMut { start, length, chunk, borrow: PhantomData }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_is_taken_once_with_its_partners() {
        for count in [0, 1, 2, 7, 1000] {
            let numbers: Vec<usize> = (0..count).collect();
            for chunk in [1, 3, 64] {
                let mut taken = vec![0; count];
                let mut chunks = vec![usize::MAX; count.div_ceil(chunk)];
                let parts = numbers.par_chunks(chunk).zip(taken.par_chunks_mut(chunk));
                let parts = parts.zip(&mut chunks).enumerate().with_min_len(2);
                parts.for_each(|(index, ((numbers, taken), own))| {
                    assert_eq!(numbers.len(), taken.len());
                    assert_eq!(numbers[0], index * chunk);
                    *own = index;
                    taken.iter_mut().for_each(|times| *times += 1);
                });
                assert!(taken.iter().all(|&times| times == 1));
                assert!(chunks.iter().enumerate().all(|(index, &own)| own == index));
            }
        }
    }

    #[test]
    fn the_shorter_side_of_a_zip_counts() {
        let (some, mut more) = ([1; 5], [0; 9]);
        more.par_iter_mut().zip(&some[..]).for_each(|(more, &some)| *more = some);
        assert_eq!(more, [1, 1, 1, 1, 1, 0, 0, 0, 0]);
    }

    #[test]
    fn results_are_in_order_and_an_error_ends_the_loop() {
        let numbers: Vec<u32> = (0..500).collect();
        let doubled = numbers.par_iter().with_max_len(1).collect(|&number| 2 * number);
        assert!(doubled.iter().zip(&numbers).all(|(doubled, number)| *doubled == 2 * number));
        let sum = numbers.par_chunks(7).reduce(
            0,
            |some| some.iter().sum::<u32>(),
            |all, some| *all += some,
        );
        assert_eq!(sum, 499 * 500 / 2);
        let odd = |&number: &u32| if number == 250 { Err(number) } else { Ok(number) };
        assert_eq!(numbers.par_iter().try_collect(odd), Err(250));
        assert_eq!(numbers[..250].par_iter().try_collect(odd), Ok(numbers[..250].to_vec()));
        let joined = numbers.par_iter().try_reduce(0, odd, |all, one| {
            *all += one;
            Ok(())
        });
        assert_eq!(joined, Err(250));
    }
}
