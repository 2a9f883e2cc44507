//! The middle stage: where the levels hand nodes over to it, and the regions of memory that it works in.
//!
//! A node of at most [`hand_over_limit`] references is finished down to T by itself, all its levels in one go. The
//! finished tree is in preorder, so it does not matter to it in which list a node stands or when it is split.
//!
//! Each such node, a *middle root*, has regions of its own for what it makes. Where they begin follows from the places of
//! the roots, so that nothing must be allocated. A root that outgrows them makes the build void: it is repeated without
//! the stage. So do the caps of the configuration where they might bind, since they bind level by level, and nodes that
//! the levels could not split ([`Overflow::MiddleStage`](crate::kernel::Overflow::MiddleStage)).

use crate::config::BuildConfig;

/// Most references of a middle root, where T is not small.
pub const MOST_REFERENCES: u32 = 2048;
/// Most nodes of one level of a middle root.
pub const ACTIVE_NODES: u32 = 96;
/// Most references of one level of a middle root.
pub const LEVEL_REFERENCES: u32 = 8192;
/// Most nodes that a split large node emits: six cuts and a split, two nodes each.
pub const MOST_EMITTED: u32 = 14;
/// The successor of the last leaf of a middle root.
pub const NO_NODE: u32 = u32::MAX;

/// Most references of a node that is handed over: 64 T, at most [`MOST_REFERENCES`].
pub const fn hand_over_limit(config: &BuildConfig) -> u32 {
    let limit = 64 * config.small_node_limit();
    if limit < MOST_REFERENCES { limit } else { MOST_REFERENCES }
}

/// Where the regions of a middle root begin, or how long they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// References of its leaves: eight for each of the root's, and 256.
    pub references: u32,
    /// Nodes: one for two references, and 128.
    pub nodes: u32,
    /// Leaves, and twice the nodes of a level: one for four references, and 64.
    pub leaves: u32,
}

impl Region {
    /// Where the regions of root `index` begin, whose references begin at `first`. The next ones begin behind them. For the
    /// roots of a list in all: how long the regions of that many roots with this many references are. At most `u32::MAX`.
    pub const fn start(first: u32, index: u32) -> Region {
        Region {
            references: first.saturating_mul(8).saturating_add(index.saturating_mul(256)),
            nodes: (first / 2).saturating_add(index.saturating_mul(128)),
            leaves: (first / 4).saturating_add(index.saturating_mul(64)),
        }
    }

    /// How much the regions of a root of `count` references hold.
    pub const fn of(count: u32) -> Region {
        Region::start(count, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_do_not_overlap() {
        let (mut first, mut before) = (0, Region::start(0, 0));
        for (index, count) in (0..).zip([1, 64, 3, 4096, 7, 9, 1023, 65]) {
            let (start, length) = (Region::start(first, index), Region::of(count));
            assert_eq!(start, before);
            let next = Region::start(first + count, index + 1);
            assert_eq!(start.references + length.references, next.references);
            assert!(start.nodes + length.nodes <= next.nodes);
            assert!(start.leaves + length.leaves <= next.leaves);
            (first, before) = (first + count, next);
        }
    }

    /// With a small T less is handed over, so that the nodes of a level fit.
    #[test]
    fn small_t_hands_over_less() {
        for t in 1..=64 {
            let config = BuildConfig::default().with_stages(|stages| stages.small_node_limit = t);
            let limit = hand_over_limit(&config);
            assert!(t <= limit && limit <= MOST_REFERENCES, "{t}");
            assert!(limit.div_ceil(t + 1) <= ACTIVE_NODES, "{t}");
        }
    }
}
