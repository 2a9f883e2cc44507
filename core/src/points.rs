//! Points: a kd-tree of 1 to 4 dimensions, its nearest neighbours, and what lies within a radius.
//!
//! [`tree`] is the tree and [`build`] the serial builder that defines its bytes; [`distance`] says which point is closer;
//! [`nearest`] answers queries, one at a time, and is what faster ones are held to; [`lists`] holds what is within a radius of many; [`parts`] gives nodes and cells to whoever draws or
//! prints a tree.

pub mod build;
pub mod collect;
pub mod distance;
pub mod lists;
pub mod nearest;
pub mod parts;
pub mod tree;
