//! Kernel sets that devices run: the shader of every kernel.

use std::borrow::Cow;
use std::fmt::Debug;

use splitplane_core::kernel::KernelSet;
use splitplane_shaders::Part;

/// A kernel set whose kernels have shaders.
pub trait DeviceSet: KernelSet {
    /// What the text of a kernel depends on, in addition to the kernel.
    type Variant: Copy + Debug;

    /// The shader of a kernel.
    fn text(kernel: Self::Kernel, variant: &Self::Variant) -> Text;

    /// The shader that finishes what a kernel's own leaves to it: run right after it, over the same bindings and
    /// with the same workgroups. Together they are the kernel.
    fn retry(_kernel: Self::Kernel, _variant: &Self::Variant) -> Option<Text> {
        None
    }

    /// Whether a uniform is a list of blocks, of which each dispatch takes one by a dynamic offset.
    fn is_list_of_blocks(_uniform: Self::Uniform) -> bool {
        false
    }
}

/// A shader: its name, and the parts that it is joined from.
#[derive(Clone, Debug)]
pub struct Text {
    /// For messages.
    pub name: &'static str,
    /// The parts; they tell one variant of a kernel from another.
    pub parts: Cow<'static, [Part]>,
}
