//! Parts that tests of other packages hold against references of their own. No part of the interface.

pub use crate::build::sweep::clip::clip;
