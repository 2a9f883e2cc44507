//! The bytes that each dispatch of a build must move at the least, from the table of kernels and the counters.
//!
//! The live elements of every list that a kernel reads or writes, once each. Of lists that are appended to, what is
//! new. Left out is what is reached by index and only for some elements: corners by kernels that do not go through the
//! triangles, references by kernels that do not go through chunks. Of lists whose length no counter tells, such as the pool of the
//! middle stage, shaders count what they read and write (`count/rewrite.rs`), each time that they do: an upper
//! bound, since a word that several invocations read at once counts for each.

use splitplane::core::kernel::{Access, Buffer, Counter, Grid, Kernel, KernelSet, TreeBuilder};
use splitplane::core::layout::Counters;

/// Bytes read and written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Moved {
    pub read: u64,
    pub written: u64,
}

/// Counts a build, dispatch after dispatch.
#[derive(Debug)]
pub(crate) struct Ledger {
    input: u64,
    /// How many elements each list has that were written.
    written: Vec<(Buffer, u64)>,
}

impl Ledger {
    /// For a mesh of this many bytes.
    pub(crate) fn new(input: u64) -> Ledger {
        Ledger { input, written: Vec::new() }
    }

    fn written(&mut self, buffer: Buffer) -> &mut u64 {
        let place = self.written.iter().position(|(held, _)| *held == buffer);
        let place = place.unwrap_or_else(|| {
            self.written.push((buffer, 0));
            self.written.len() - 1
        });
        &mut self.written[place].1
    }

    /// Lists that change places.
    pub(crate) fn swap(&mut self, a: Buffer, b: Buffer) {
        let (of_a, of_b) = (*self.written(a), *self.written(b));
        *self.written(a) = of_b;
        *self.written(b) = of_a;
    }

    /// A dispatch that left these counters.
    pub(crate) fn dispatch(&mut self, kernel: Kernel, counters: &Counters) -> Moved {
        let mut moved = Moved::default();
        for binding in kernel.bindings() {
            let buffer = binding.buffer;
            if buffer == Buffer::Input {
                moved.read += self.input;
                continue;
            }
            let Some(counter) = buffer.live() else { continue };
            let (size, live) = (buffer.element_size() as u64, u64::from(counters[counter]));
            match binding.access {
                Access::Read if is_by_index(kernel, buffer) => {}
                Access::Read => moved.read += size * live,
                Access::Write => {
                    *self.written(buffer) = live;
                    moved.written += size * live;
                }
                Access::ReadWrite => {
                    moved.read += size * live;
                    moved.written += size * live;
                }
                Access::Scatter => {
                    let new = live.saturating_sub(*self.written(buffer));
                    // One invocation writes one element.
                    let new = match kernel.grid() {
                        Grid::Invocations(items, _) | Grid::Few(items, _) => {
                            new.min(counters[items].into())
                        }
                        _ => new,
                    };
                    if new > 0 {
                        *self.written(buffer) += new;
                        moved.written += size * new;
                    } else {
                        // A part of each element.
                        moved.read += size * live;
                        moved.written += size * live;
                    }
                }
            }
        }
        moved
    }
}

/// Whether shaders count what they read and write of the list of this name.
pub(crate) fn is_counted_by_shaders(name: &str) -> bool {
    TreeBuilder::BUFFERS.iter().any(|row| {
        let other = matches!(row.buffer, Buffer::Input | Buffer::Counters);
        row.name == name && row.live.is_none() && !other
    })
}

/// Whether a kernel reads only some elements of a list, by index.
fn is_by_index(kernel: Kernel, buffer: Buffer) -> bool {
    let (Grid::Each(items) | Grid::Invocations(items, _) | Grid::Few(items, _)) = kernel.grid()
    else {
        return false;
    };
    match buffer {
        Buffer::Triangles => !matches!(items, Counter::Triangles | Counter::InputChunks),
        Buffer::References | Buffer::NextReferences => {
            !matches!(items, Counter::Chunks | Counter::InputChunks | Counter::ActiveReferences)
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kernel that reads the mesh, by hand.
    #[test]
    fn bytes_follow_the_table() {
        let mut counters = Counters::at_start(1000);
        counters[Counter::TopNodes] = 1;
        let mut ledger = Ledger::new(500);
        // Bounds of triangles: the mesh is read; nine floats a triangle, and for each of four chunks counts and bounds.
        let chunk = Buffer::ChunkCounts.element_size() + Buffer::ChunkBounds.element_size();
        let reads_mesh =
            |kernel: &Kernel| kernel.bindings().any(|binding| binding.buffer == Buffer::Input);
        let first = Kernel::ALL.into_iter().find(reads_mesh).expect("a kernel reads the mesh");
        let moved = ledger.dispatch(first, &counters);
        assert_eq!(moved.read, 500);
        assert!(moved.written >= 36_000 + 4 * chunk as u64, "{moved:?}");
    }

    /// What is appended counts once; what is written over counts as read and written.
    #[test]
    fn appended_lists_count_what_is_new() {
        let appends = |kernel: &Kernel| {
            let mut scattered = kernel.bindings().filter(|b| b.access == Access::Scatter);
            scattered.any(|b| b.buffer == Buffer::SmallReferences)
        };
        let kernel = Kernel::ALL.into_iter().find(appends).expect("a kernel that appends");
        let mut counters = Counters::default();
        let mut ledger = Ledger::new(0);
        let mut of = |references: u32| {
            counters[Counter::SmallReferences] = references;
            ledger.dispatch(kernel, &counters)
        };
        let size = Buffer::SmallReferences.element_size() as u64;
        assert_eq!(of(10).written, 10 * size);
        assert_eq!(of(25).written, 15 * size);
        let again = of(25);
        assert_eq!((again.read, again.written), (25 * size, 25 * size));
    }
}
