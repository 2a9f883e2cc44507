//! Kernel sets: what a schedule and its executors agree on.
//!
//! A set is declared once, by [`kernel_set!`](crate::kernel_set): its kernels with their grids and
//! what they read and write, its buffers and its uniforms. Everything else follows from that table:
//! names of files, what a device binds and in which order, what may change between two dispatches.
//! Tests hold the shaders to it.
//!
//! [`TreeBuilder`], [`NodeCompressor`], [`RayQueries`], [`PointBuilder`], [`PointQueries`], [`NearQueries`] and [`DeviceChecks`] are declared here; the renderer declares a set of
//! its own.

mod builder;
mod checks;
mod compress;
mod macros;
mod near;
mod point_builder;
mod points;
mod queries;

use core::fmt::Debug;

pub use builder::{
    Buffer, Counter, Kernel, Overflow, SUBTREE_NODES, SUBTREE_WORDS, TreeBuilder, Uniform,
    subtree_slots,
};
pub use checks::{CheckBuffer, CheckCounter, CheckKernel, CheckUniform, DeviceChecks};
pub use compress::{
    CompressBuffer, CompressCounter, CompressKernel, CompressUniform, NodeCompressor,
};
pub use near::{NearBuffer, NearCounter, NearKernel, NearQueries, NearUniform};
pub use point_builder::{PointBuffer, PointBuildUniform, PointBuilder, PointCounter, PointKernel};
pub use points::{
    PointQueries, PointQueryBuffer, PointQueryCounter, PointQueryKernel, PointQueryUniform,
};
pub use queries::{QueryBuffer, QueryCounter, QueryKernel, QueryUniform, RayQueries};

/// A family of kernels that one schedule runs: the tree builder is one, a renderer another. Made by
/// [`kernel_set!`](crate::kernel_set).
pub trait KernelSet: Copy + Debug + PartialEq + 'static {
    /// The kernels.
    type Kernel: Copy + Debug + PartialEq + 'static;
    /// The buffers they exchange.
    type Buffer: Copy + Debug + PartialEq + 'static;
    /// Their inputs, which none of them changes.
    type Uniform: Copy + Debug + PartialEq + 'static;
    /// The numbers that end loops.
    type Counter: Copy + Debug + PartialEq + 'static;

    /// The name of the set.
    const NAME: &'static str;
    /// The kernels, in the order of the schedule: a kernel's index is its number.
    const KERNELS: &'static [KernelRow<Self>];
    /// The buffers: a buffer's index is its number.
    const BUFFERS: &'static [BufferRow<Self>];
    /// The buffers that every kernel binds first.
    const EVERY_KERNEL: &'static [Slot<Self>];
    /// Buffers that change places between two rounds of a loop, all of them before the next round.
    const EXCHANGED: &'static [(Self::Buffer, Self::Buffer)];

    /// The number of a kernel.
    fn kernel_index(kernel: Self::Kernel) -> usize;

    /// The number of a buffer.
    fn buffer_index(buffer: Self::Buffer) -> usize;

    /// The name of a uniform in shaders.
    fn uniform_name(uniform: Self::Uniform) -> &'static str;

    /// A kernel's row in the table.
    fn kernel(kernel: Self::Kernel) -> &'static KernelRow<Self> {
        &Self::KERNELS[Self::kernel_index(kernel)]
    }

    /// A buffer's row in the table.
    fn buffer(buffer: Self::Buffer) -> &'static BufferRow<Self> {
        &Self::BUFFERS[Self::buffer_index(buffer)]
    }

    /// Calls `visit` with every buffer that a kernel writes, counters included.
    fn written(kernel: Self::Kernel, visit: &mut dyn FnMut(Self::Buffer)) {
        for slot in Self::kernel(kernel).slots {
            if let Slot::Storage(binding) = slot
                && binding.access != Access::Read
            {
                visit(binding.buffer);
            }
        }
    }

    /// Bytes of one element of a buffer.
    fn element_size(buffer: Self::Buffer) -> usize {
        Self::buffer(buffer).element_size
    }

    /// The buffer whose storage holds this one on a device.
    fn storage(buffer: Self::Buffer) -> Self::Buffer {
        Self::buffer(buffer).storage
    }

    /// Whether every kernel binds a buffer, so that rows name it only where they write it.
    fn is_bound_by_all(buffer: Self::Buffer) -> bool {
        let same = |slot: &Slot<Self>| matches!(slot, Slot::Storage(held) if held.buffer == buffer);
        Self::EVERY_KERNEL.iter().any(same)
    }

    /// The buffer that a name refers to when the lists of this round and the next have changed
    /// places.
    fn exchanged(buffer: Self::Buffer) -> Self::Buffer {
        let pair = |&(a, b): &(Self::Buffer, Self::Buffer)| match buffer {
            _ if buffer == a => Some(b),
            _ if buffer == b => Some(a),
            _ => None,
        };
        Self::EXCHANGED.iter().find_map(pair).unwrap_or(buffer)
    }

    /// What a device binds for a kernel: the number of a slot is that of its binding. First what
    /// every kernel binds, then the kernel's own; buffers that share a storage
    /// ([`KernelSet::storage`]) are bound once, by its name, in the place of the first of them.
    fn slots(kernel: Self::Kernel) -> impl Iterator<Item = Slot<Self>> {
        let row = Self::kernel(kernel).slots;
        let every = Self::EVERY_KERNEL.iter().map(move |slot| match slot {
            Slot::Storage(binding) => {
                let access = combined::<Self>(row, binding.buffer).unwrap_or(binding.access);
                Slot::Storage(Binding { access, ..*binding })
            }
            uniform => *uniform,
        });
        let own = row.iter().enumerate().filter_map(move |(place, slot)| match slot {
            Slot::Uniform(_) => Some(*slot),
            Slot::Storage(binding) => {
                let buffer = Self::storage(binding.buffer);
                if Self::is_bound_by_all(buffer)
                    || combined::<Self>(&row[..place], buffer).is_some()
                {
                    return None;
                }
                let access = combined::<Self>(row, buffer)?;
                Some(Slot::Storage(Binding { buffer, access }))
            }
        });
        every.chain(own)
    }
}

/// The access of all of these slots together to a storage; `None` where none of them names it.
fn combined<K: KernelSet>(slots: &[Slot<K>], storage: K::Buffer) -> Option<Access> {
    let accesses = slots.iter().filter_map(|slot| match slot {
        Slot::Storage(binding) if K::storage(binding.buffer) == storage => Some(binding.access),
        _ => None,
    });
    accesses.reduce(|a, b| if a == b { a } else { Access::ReadWrite })
}

/// A kernel's row in the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelRow<K: KernelSet> {
    /// The kernel.
    pub kernel: K::Kernel,
    /// The name of its file.
    pub name: &'static str,
    /// What its workgroups represent.
    pub grid: Grid<K::Counter>,
    /// What it reads and writes in addition to [`KernelSet::EVERY_KERNEL`], in the order of
    /// bindings. It names what every kernel binds only to say that it writes that.
    pub slots: &'static [Slot<K>],
}

/// A buffer's row in the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BufferRow<K: KernelSet> {
    /// The buffer.
    pub buffer: K::Buffer,
    /// Its name in shaders.
    pub name: &'static str,
    /// Bytes of one element.
    pub element_size: usize,
    /// The counter that holds the number of live elements; `None` for a fixed length.
    pub live: Option<K::Counter>,
    /// The buffer whose storage holds this one on a device.
    pub storage: K::Buffer,
}

/// The resource at a binding of a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slot<K: KernelSet> {
    /// A uniform, which no kernel changes.
    Uniform(K::Uniform),
    /// A buffer.
    Storage(Binding<K::Buffer>),
}

/// The number of workgroups of a dispatch. Grids are fixed on devices; each workgroup loops until
/// the counter is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid<C> {
    /// One workgroup for everything.
    One,
    /// One workgroup for each counted item.
    Each(C),
    /// One invocation for each counted item, with this many per workgroup.
    Invocations(C, u32),
    /// The same, or fewer: an invocation takes several items, as many invocations apart as there are. For kernels that find little to do
    /// among many items, and whose invocations cost much to start.
    Few(C, u32),
}

impl<C> Grid<C> {
    /// The number of workgroups for this many items.
    pub const fn workgroups(&self, things: u32) -> u32 {
        match self {
            Grid::One => 1,
            Grid::Each(_) => things,
            Grid::Invocations(_, width) | Grid::Few(_, width) => things.div_ceil(*width),
        }
    }
}

/// What a kernel does with a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Reads.
    Read,
    /// Writes every live element. It reads only those that it has written itself.
    Write,
    /// Writes some elements, or parts of them, and keeps the rest; reads none.
    Scatter,
    /// Reads and writes.
    ReadWrite,
}

/// A buffer and what a kernel does with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding<B> {
    /// The buffer.
    pub buffer: B,
    /// The access.
    pub access: Access,
}

#[cfg(test)]
mod tests;
