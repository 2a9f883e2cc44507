//! Parts that tests of other packages hold against references of their own. No part of the interface.

pub use crate::build::sweep::clip::clip;

use crate::CpuAccelerator;

/// Whether the blocks of an accelerator's layout have their corners written out. No answer depends on it.
pub fn writes_corners_out(accelerator: &CpuAccelerator) -> bool {
    accelerator.parts().0.is_written()
}
