//! Two executors side by side: the first dispatch after which they differ, by kernel, buffer and
//! index.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use crate::build::schedule::Executor;
use crate::kernel::KernelSet;

/// An executor whose buffers can be read between dispatches.
pub trait Inspect<K: KernelSet>: Executor<K> {
    /// The live bytes of a buffer. Lists that have changed places count as what they now are.
    ///
    /// # Errors
    /// As for [`Executor::dispatch`].
    fn live(&mut self, buffer: K::Buffer) -> Result<Vec<u8>, Self::Error>;
}

/// Runs every step on two executors and compares what each dispatch wrote. Both must begin with
/// fresh buffers, since a kernel may write part of one.
#[derive(Debug)]
pub struct Lockstep<A, B> {
    first: A,
    second: B,
    dispatches: u32,
}

/// Where two executors first differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The kernel that wrote it.
    pub kernel: String,
    /// Dispatches before that one.
    pub dispatch: u32,
    /// The buffer.
    pub buffer: String,
    /// Index of the element.
    pub index: usize,
    /// Word within the element.
    pub word: usize,
    /// What the first executor has there; `None` beyond its end.
    pub first: Option<u32>,
    /// What the second has there.
    pub second: Option<u32>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { kernel, dispatch, buffer, index, word, .. } = self;
        write!(f, "dispatch {dispatch}, {kernel}: {buffer}[{index}] word {word}: ")?;
        let value = |f: &mut fmt::Formatter<'_>, value: Option<u32>| match value {
            Some(bits) => write!(f, "{bits:#010x} ({:?})", f32::from_bits(bits)),
            None => write!(f, "nothing"),
        };
        value(f, self.first)?;
        write!(f, " and ")?;
        value(f, self.second)
    }
}

/// Why two executors did not finish in step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LockstepError<A, B> {
    /// The first executor failed.
    First(A),
    /// The second executor failed.
    Second(B),
    /// They differ.
    Differs(Difference),
}

impl<A: fmt::Display, B: fmt::Display> fmt::Display for LockstepError<A, B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LockstepError::First(error) => error.fmt(f),
            LockstepError::Second(error) => error.fmt(f),
            LockstepError::Differs(difference) => difference.fmt(f),
        }
    }
}

impl<A, B> core::error::Error for LockstepError<A, B>
where
    A: core::error::Error,
    B: core::error::Error,
{
}

impl<A, B> Lockstep<A, B> {
    /// Two executors over the same input, neither of which has done anything yet.
    pub fn new(first: A, second: B) -> Lockstep<A, B> {
        Lockstep { first, second, dispatches: 0 }
    }

    /// How many dispatches were compared.
    pub fn dispatches(&self) -> u32 {
        self.dispatches
    }

    /// The executors.
    pub fn into_inner(self) -> (A, B) {
        (self.first, self.second)
    }
}

impl<K, A, B> Executor<K> for Lockstep<A, B>
where
    K: KernelSet,
    A: Inspect<K>,
    B: Inspect<K>,
{
    type Error = LockstepError<A::Error, B::Error>;

    fn dispatch(&mut self, kernel: K::Kernel) -> Result<(), Self::Error> {
        self.first.dispatch(kernel).map_err(LockstepError::First)?;
        self.second.dispatch(kernel).map_err(LockstepError::Second)?;
        let mut result = Ok(());
        K::written(kernel, &mut |buffer| {
            if result.is_ok() {
                result = self.compare(kernel, buffer);
            }
        });
        self.dispatches += 1;
        result
    }

    fn swap(&mut self, a: K::Buffer, b: K::Buffer) -> Result<(), Self::Error> {
        self.first.swap(a, b).map_err(LockstepError::First)?;
        self.second.swap(a, b).map_err(LockstepError::Second)
    }

    fn pending(&mut self, counter: K::Counter, rounds: u32) -> Result<bool, Self::Error> {
        // Counters were compared; the second is called too, so that both stay in step.
        self.second.pending(counter, rounds).map_err(LockstepError::Second)?;
        self.first.pending(counter, rounds).map_err(LockstepError::First)
    }
}

impl<A, B> Lockstep<A, B> {
    fn compare<K: KernelSet>(
        &mut self,
        kernel: K::Kernel,
        buffer: K::Buffer,
    ) -> Result<(), LockstepError<A::Error, B::Error>>
    where
        A: Inspect<K>,
        B: Inspect<K>,
    {
        let first = self.first.live(buffer).map_err(LockstepError::First)?;
        let second = self.second.live(buffer).map_err(LockstepError::Second)?;
        if first == second {
            return Ok(());
        }
        let word = |bytes: &[u8], at: usize| {
            let bytes = bytes.get(4 * at..4 * at + 4)?;
            Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
        };
        let words = first.len().max(second.len()).div_ceil(4);
        let at = (0..words).find(|&at| word(&first, at) != word(&second, at)).unwrap_or(words);
        let element = (K::element_size(buffer) / 4).max(1);
        Err(LockstepError::Differs(Difference {
            kernel: format!("{kernel:?}"),
            dispatch: self.dispatches,
            buffer: format!("{buffer:?}"),
            index: at / element,
            word: at % element,
            first: word(&first, at),
            second: word(&second, at),
        }))
    }
}
