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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Buffer, Counter, Kernel, TreeBuilder};

    /// Two dispatches, then a broken executor: holds what it is given, and says what it was asked.
    #[derive(Debug, Default)]
    struct Held {
        contents: Vec<(Buffer, Vec<u32>)>,
        asked: Vec<String>,
        pending: bool,
        fails: bool,
    }

    impl Held {
        fn ask(&mut self, what: String) -> Result<(), u32> {
            self.asked.push(what);
            if self.fails { Err(self.asked.len() as u32) } else { Ok(()) }
        }
    }

    impl Executor<TreeBuilder> for Held {
        type Error = u32;

        fn dispatch(&mut self, kernel: Kernel) -> Result<(), u32> {
            self.ask(format!("{kernel:?}"))
        }

        fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), u32> {
            self.ask(format!("{a:?} {b:?}"))
        }

        fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, u32> {
            self.ask(format!("{counter:?} {rounds}"))?;
            Ok(self.pending)
        }
    }

    impl Inspect<TreeBuilder> for Held {
        fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, u32> {
            let held = self.contents.iter().find(|(name, _)| *name == buffer);
            Ok(held.map_or(Vec::new(), |(_, words)| bytemuck::cast_slice(words).to_vec()))
        }
    }

    /// A kernel and a buffer of several words an element that it writes.
    fn written() -> (Kernel, Buffer, u32) {
        let written = |kernel: Kernel| {
            let mut found = None;
            TreeBuilder::written(kernel, &mut |buffer| {
                let words = TreeBuilder::element_size(buffer) as u32 / 4;
                if words > 2 && buffer != Buffer::Counters {
                    found = Some((kernel, buffer, words));
                }
            });
            found
        };
        Kernel::ALL.into_iter().find_map(written).expect("a kernel that writes such a buffer")
    }

    #[test]
    fn differences_are_placed_by_element_and_word() {
        let (kernel, buffer, words) = written();
        let good: Vec<u32> = (100..100 + 4 * words).collect();
        for at in 0..good.len() {
            for (second, value) in [
                (
                    good.iter().enumerate().map(|(i, &x)| if i < at { x } else { !x }).collect(),
                    Some(!good[at]),
                ),
                (good[..at].to_vec(), None),
            ] {
                let held = |words: Vec<u32>| Held {
                    contents: Vec::from([(buffer, words)]),
                    ..Held::default()
                };
                let mut lockstep = Lockstep::new(held(good.clone()), held(good.clone()));
                assert_eq!(lockstep.dispatch(kernel), Ok(()));
                lockstep.second = held(second);
                let expected = Difference {
                    kernel: format!("{kernel:?}"),
                    dispatch: 1,
                    buffer: format!("{buffer:?}"),
                    index: at / words as usize,
                    word: at - at / words as usize * words as usize,
                    first: Some(good[at]),
                    second: value,
                };
                assert_eq!(lockstep.dispatch(kernel), Err(LockstepError::Differs(expected)));
                assert_eq!(lockstep.dispatches(), 2);
            }
        }
    }

    /// Only what a kernel writes is compared after it.
    #[test]
    fn other_buffers_are_not_compared() {
        let (_, buffer, _) = written();
        for kernel in Kernel::ALL {
            let held = |word| Held {
                contents: Vec::from([(buffer, Vec::from([word]))]),
                ..Held::default()
            };
            let mut writes = false;
            TreeBuilder::written(kernel, &mut |one| writes |= one == buffer);
            let mut lockstep = Lockstep::new(held(1), held(2));
            assert_eq!(lockstep.dispatch(kernel).is_err(), writes, "{kernel:?}");
        }
    }

    #[test]
    fn both_do_every_step() {
        let (a, b) = (Buffer::ActiveNodes, Buffer::NextNodes);
        for (first, second) in [(true, false), (false, true)] {
            let held = |pending| Held { pending, ..Held::default() };
            let mut lockstep = Lockstep::new(held(first), held(second));
            assert_eq!(lockstep.dispatch(Kernel::ScanTriangles), Ok(()));
            assert_eq!(lockstep.swap(a, b), Ok(()));
            // They agree where they work; the first one's answer counts.
            assert_eq!(lockstep.pending(Counter::ActiveNodes, 3), Ok(first));
            let (first, second) = lockstep.into_inner();
            assert_eq!(first.asked, ["ScanTriangles", "ActiveNodes NextNodes", "ActiveNodes 3"]);
            assert_eq!(first.asked, second.asked);
        }
    }

    #[test]
    fn errors_tell_whose_they_are() {
        let pair = |first_fails: bool| {
            let held = |fails| Held { fails, ..Held::default() };
            Lockstep::new(held(first_fails), held(!first_fails))
        };
        let (first, second) = (LockstepError::First(1), LockstepError::Second(1));
        for (fails, error) in [(true, first), (false, second)] {
            assert_eq!(pair(fails).dispatch(Kernel::ScanTriangles), Err(error.clone()));
            assert_eq!(
                pair(fails).swap(Buffer::ActiveNodes, Buffer::NextNodes),
                Err(error.clone())
            );
            assert_eq!(pair(fails).pending(Counter::ActiveNodes, 0), Err(error));
        }
    }
}
