//! Depth first: the trees of the schedule, with the lower levels built in cache.
//!
//! The schedule goes level by level, as devices must: every level reads and writes all references in memory, and all
//! threads wait for the last one. Here
//! the levels run on the twin until nodes have few references ([`caps::hand_over_limit`]); a task then takes one such node,
//! keeps its references as a structure of arrays, and builds its subtree depth first, left before right, writing
//! nodes in preorder. What becomes of a node depends on its references, its cell, its depth and whether it
//! was inseparable, never on its neighbours, so the subtree is the one that the levels give. The one exception
//! is the caps on references and nodes, which bind in the order of levels. Where they might bind, the build is void
//! ([`caps::Caps`]), and the twin alone runs the schedule.

mod caps;
mod cut;
mod executor;
mod subtree;
mod task_scratch;
#[cfg(test)]
mod tests;

pub(super) use executor::{DepthFirstExecutor, DepthFirstScratch};
