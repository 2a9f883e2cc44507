//! Where the levels hand over to tasks, and whether the caps of the schedule might bind below.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

use splitplane_core::config::BuildConfig;

/// Tasks for each thread: enough that threads do not wait long for the last tasks.
const TASKS: usize = 8;
/// Fewest references of a task. With fewer, more levels run on the twin, and the tasks save less than that costs.
const LEAST: usize = 1024;
/// Most references of a task: columns of this length fit the last level of cache of most machines.
const MOST: usize = 1 << 17;

/// Most references of a node that one task builds.
pub(super) fn hand_over_limit(references: usize, threads: usize) -> u32 {
    (references / (TASKS * threads)).clamp(LEAST, MOST) as u32
}

/// Whether a cap on references or nodes might have bound. A cap of the schedule compares what is alive level by level;
/// that is never more than all references and nodes ever made, which is what is counted here.
#[derive(Debug, Default)]
pub(super) struct Caps {
    /// References of the root, and those that splits added.
    references: AtomicU64,
    /// Nodes of the large-node stage.
    nodes: AtomicU64,
    most: [u64; 2],
    exceeded: AtomicBool,
}

impl Caps {
    /// The caps of a configuration, with what the levels have made so far.
    pub(super) fn new(config: &BuildConfig, triangles: u32, references: u64, nodes: u64) -> Caps {
        let caps = Caps {
            references: AtomicU64::new(0),
            nodes: AtomicU64::new(0),
            most: [config.reference_cap(triangles), config.node_cap(triangles)].map(u64::from),
            exceeded: AtomicBool::new(false),
        };
        caps.add(references, nodes);
        caps
    }

    pub(super) fn add(&self, references: u64, nodes: u64) {
        let references = self.references.fetch_add(references, Relaxed) + references;
        let nodes = self.nodes.fetch_add(nodes, Relaxed) + nodes;
        // A node may emit up to 14 at once.
        if references > self.most[0] || nodes + 14 > self.most[1] {
            self.exceeded.store(true, Relaxed);
        }
    }

    /// Whether the build is void.
    pub(super) fn exceeded(&self) -> bool {
        self.exceeded.load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However many references a task takes, each root is within its bounds.
    #[test]
    fn tasks_are_neither_too_small_nor_too_large() {
        assert_eq!(hand_over_limit(0, 1), LEAST as u32);
        assert_eq!(hand_over_limit(1 << 20, 4), 1 << 15);
        assert_eq!(hand_over_limit(1 << 28, 1), MOST as u32);
        let caps = Caps::new(&BuildConfig::default(), 100, 0, 0);
        caps.add(4096 + 800, 0);
        assert!(!caps.exceeded());
        caps.add(1, 0);
        assert!(caps.exceeded());
    }
}
