use crate::build::middle::MOST_EMITTED;
use crate::config::BuildConfig;
use crate::kernel::{Counter, Overflow};
use crate::layout::{Counters, MiddleRoot};

/// Gives the leaves of every middle root their places in the small list, and their references among those of the small
/// roots, in the order of the roots. That list takes the place of what was handed over.
///
/// Where a root has outgrown its region, or a cap of the configuration might have bound, the build is void: every list is
/// empty, and [`Counter::Overflow`] says [`Overflow::MiddleStage`]. A cap compares what is alive at a time; that is never more
/// than all references and nodes ever made, which are compared here.
///
/// While nodes are active the levels have more to hand over, and nothing is done.
pub fn scan_middle(config: &BuildConfig, middle_roots: &mut [MiddleRoot], counters: &mut Counters) {
    if counters[Counter::ActiveNodes] > 0 {
        return;
    }
    let kept = counters[Counter::Triangles] - counters[Counter::Dropped];
    let mut made = u64::from(kept) + u64::from(counters[Counter::Growth]);
    let mut nodes = u64::from(counters[Counter::TopNodes]);
    let (mut leaves, mut references) = (0, 0);
    let (mut levels, mut outgrown) = (counters[Counter::Levels], 0);
    for root in middle_roots.iter_mut() {
        (root.first_leaf, root.first_reference) = (leaves, references);
        leaves += root.leaves;
        references += root.references;
        made += u64::from(root.growth);
        nodes += u64::from(root.nodes.saturating_sub(1));
        levels = levels.max(root.levels);
        outgrown |= root.outgrown;
    }
    let triangles = counters[Counter::Triangles];
    if outgrown != 0
        || made > u64::from(config.reference_cap(triangles))
        || nodes + u64::from(MOST_EMITTED) > u64::from(config.node_cap(triangles))
    {
        *counters = Counters::default();
        counters[Counter::Overflow] = Overflow::MiddleStage as u32;
        return;
    }
    counters[Counter::MiddleLevels] = levels;
    counters[Counter::SmallRoots] = leaves;
    counters[Counter::SmallReferences] = references;
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    fn roots() -> [MiddleRoot; 3] {
        let root = |nodes, leaves, references, growth| MiddleRoot {
            levels: leaves,
            nodes,
            leaves,
            references,
            growth,
            ..MiddleRoot::zeroed()
        };
        [root(3, 2, 90, 20), root(1, 1, 5, 0), root(9, 4, 200, 50)]
    }

    fn scanned(roots: &mut [MiddleRoot], change: impl Fn(&mut Counters)) -> Counters {
        let mut counters = Counters::default();
        counters[Counter::Triangles] = 100;
        counters[Counter::TopNodes] = 7;
        counters[Counter::Levels] = 2;
        counters[Counter::SmallRoots] = roots.len() as u32;
        counters[Counter::MiddleRoots] = roots.len() as u32;
        change(&mut counters);
        scan_middle(&BuildConfig::default(), roots, &mut counters);
        counters
    }

    #[test]
    fn leaves_follow_one_another() {
        let mut found = roots();
        let counters = scanned(&mut found, |_| ());
        assert_eq!(
            found.map(|root| (root.first_leaf, root.first_reference)),
            [(0, 0), (2, 90), (3, 95)]
        );
        let count = |counter| counters[counter];
        assert_eq!((count(Counter::SmallRoots), count(Counter::SmallReferences)), (7, 295));
        assert_eq!((count(Counter::MiddleRoots), count(Counter::MiddleLevels)), (3, 4));
        let waiting = scanned(&mut roots(), |counters| counters[Counter::ActiveNodes] = 1);
        assert_eq!((waiting[Counter::MiddleLevels], waiting[Counter::SmallRoots]), (0, 3));
    }

    /// At the caps all is well; one more, or a root that has outgrown its region, and the build is void.
    #[test]
    fn what_might_be_capped_is_void() {
        // 8 references a triangle and 4,096 more, 4 nodes and 4,096 more.
        let (growth, top) = (8 * 100 + 4096 - 100 - 70, 4 * 100 + 4096 - 14 - 10);
        for (growth, top, outgrown, void) in
            [(growth, top, 0, 0), (growth + 1, 1, 0, 1), (1, top + 1, 0, 1), (0, 1, 1, 1)]
        {
            let mut middle = roots();
            middle[1].outgrown = outgrown;
            let counters = scanned(&mut middle, |counters| {
                counters[Counter::Growth] = growth;
                counters[Counter::TopNodes] = top;
            });
            assert_eq!(counters[Counter::Overflow], void * Overflow::MiddleStage as u32);
            assert_eq!(counters[Counter::TopNodes], (1 - void) * top);
        }
    }
}
