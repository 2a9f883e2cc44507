//! Kernel sets that devices run: the shader of every kernel.

use std::borrow::Cow;
use std::fmt::Debug;

use splitplane_core::kernel::{KernelSet, Slot};
use splitplane_shaders::Part;

/// A kernel set whose kernels have shaders.
pub trait DeviceSet: KernelSet {
    /// What the text of a kernel depends on, in addition to the kernel.
    type Variant: Copy + Debug;

    /// Whether the shaders of [`DeviceSet::retry`] do with fewer workgroups than the kernels: an invocation takes several items, as many
    /// apart as there are invocations.
    const FEW_RETRIES: bool = false;

    /// The shader of a kernel.
    fn text(kernel: Self::Kernel, variant: &Self::Variant) -> Text;

    /// The shader that finishes what a kernel's own leaves to it: run right after it, over the same bindings and
    /// with the same workgroups. Together they are the kernel.
    fn retry(_kernel: Self::Kernel, _variant: &Self::Variant) -> Option<Text> {
        None
    }

    /// The shader that follows both, likewise over the same bindings and with the same workgroups.
    fn settle(_kernel: Self::Kernel, _variant: &Self::Variant) -> Option<Text> {
        None
    }

    /// What a kernel binds in a variant: as its table says, or with lists that go on in further bindings.
    fn bindings(kernel: Self::Kernel, _variant: &Self::Variant) -> Vec<Bound<Self>> {
        as_declared::<Self>(kernel).collect()
    }

    /// What a kernel's own shader binds where that is not what its other shaders bind: other buffers under the same numbers, of
    /// the same kinds. `None` where all of them bind the same.
    fn own_bindings(_kernel: Self::Kernel, _variant: &Self::Variant) -> Option<Vec<Bound<Self>>> {
        None
    }

    /// Whether a uniform is a list of blocks, of which each dispatch takes one by a dynamic offset.
    fn is_list_of_blocks(_uniform: Self::Uniform) -> bool {
        false
    }
}

/// A binding of a kernel in one of its variants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound<K: KernelSet> {
    /// Its number.
    pub binding: u32,
    /// What is bound.
    pub slot: Slot<K>,
    /// Which part of a list that several bindings hold; 0 for what one binding holds.
    pub part: u32,
}

/// What the table of a set says that a kernel binds.
pub fn as_declared<K: KernelSet>(kernel: K::Kernel) -> impl Iterator<Item = Bound<K>> {
    (0..).zip(K::slots(kernel)).map(|(binding, slot)| Bound { binding, slot, part: 0 })
}

/// What a kernel binds where these lists, if it binds them, go on in second bindings, behind all others.
pub fn with_continued<K: KernelSet>(
    kernel: K::Kernel,
    is_continued: impl Fn(K::Buffer) -> bool,
) -> Vec<Bound<K>> {
    let mut bound: Vec<Bound<K>> = as_declared::<K>(kernel).collect();
    let first = bound.len() as u32;
    let lists: Vec<Slot<K>> = bound
        .iter()
        .map(|bound| bound.slot)
        .filter(|slot| matches!(slot, Slot::Storage(storage) if is_continued(storage.buffer)))
        .collect();
    let more = (first..).zip(lists);
    bound.extend(more.map(|(binding, slot)| Bound { binding, slot, part: 1 }));
    bound
}

/// A shader: its name, and the parts that it is joined from.
#[derive(Clone, Debug)]
pub struct Text {
    /// For messages.
    pub name: &'static str,
    /// The parts; they tell one variant of a kernel from another.
    pub parts: Cow<'static, [Part]>,
}
