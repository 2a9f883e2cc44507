//! A tree of points on whatever backend.

use splitplane_core::error::QueryError;
use splitplane_core::report::QueryReport;

use super::{NearestOptions, Neighbour, NeighbourLists, PointTree};

#[cfg(feature = "cpu")]
mod each;

/// A tree of points and the backend that answers for it: see [`Engine::points`](crate::backend::Engine::points). Answers are the same on every backend, bit for bit.
#[derive(Debug)]
#[non_exhaustive]
pub enum AnyPointTree<const N: usize> {
    /// On the cores of this machine.
    #[cfg(feature = "cpu")]
    Cpu(splitplane_cpu::CpuPointTree<N>),
    /// On a GPU.
    #[cfg(feature = "wgpu")]
    Wgpu(splitplane_wgpu::WgpuPointTree<N>),
}

impl<const N: usize> AnyPointTree<N> {
    /// The tree itself, in host memory.
    pub fn tree(&self) -> &PointTree<N> {
        match self {
            #[cfg(feature = "cpu")]
            AnyPointTree::Cpu(tree) => tree.tree(),
            #[cfg(feature = "wgpu")]
            AnyPointTree::Wgpu(tree) => tree.tree(),
        }
    }

    /// Bytes of the tree and of what searches it, on a device too.
    pub fn bytes(&self) -> u64 {
        match self {
            #[cfg(feature = "cpu")]
            AnyPointTree::Cpu(tree) => tree.bytes(),
            #[cfg(feature = "wgpu")]
            AnyPointTree::Wgpu(tree) => tree.bytes(),
        }
    }

    /// The k nearest points of each query, k records each, least (distance, index) first; [`Neighbour::NONE`] where there is
    /// no further one. After an error `found` holds the answers to some of the queries, and nothing says which.
    ///
    /// # Errors
    /// `found` not of k times as many records as there are queries, more memory than allowed or than the system has, a watch that
    /// cancels the batch, or a device that fails.
    pub fn nearest(
        &self,
        queries: &[[f32; N]],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        match self {
            #[cfg(feature = "cpu")]
            AnyPointTree::Cpu(tree) => {
                tree.nearest(queries, found, options).map(|()| QueryReport::default())
            }
            #[cfg(feature = "wgpu")]
            AnyPointTree::Wgpu(tree) => tree.nearest(queries, found, options),
        }
    }

    /// The points within [`NearestOptions::max_distance`] of a query, least (distance, index) first; k does not count.
    ///
    /// # Errors
    /// More memory than allowed, or than the system has.
    pub fn within(
        &self,
        query: [f32; N],
        options: &NearestOptions<'_>,
    ) -> Result<Vec<Neighbour>, QueryError> {
        match self {
            #[cfg(feature = "cpu")]
            AnyPointTree::Cpu(tree) => tree.within(query, options),
            #[cfg(feature = "wgpu")]
            AnyPointTree::Wgpu(tree) => tree.within(query, options),
        }
    }

    /// The same for each query of a batch.
    ///
    /// # Errors
    /// More memory than allowed or than the system has, a watch that cancels the batch, or a device that fails.
    pub fn within_each(
        &self,
        queries: &[[f32; N]],
        options: &NearestOptions<'_>,
    ) -> Result<NeighbourLists, QueryError> {
        match self {
            #[cfg(feature = "cpu")]
            AnyPointTree::Cpu(tree) => tree.within_each(queries, options),
            #[cfg(feature = "wgpu")]
            AnyPointTree::Wgpu(tree) => tree.within_each(queries, options),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::BackendKind;
    use crate::QueryError;
    use crate::backend::OpenOptions;
    use crate::points::{KeptBytes, NearestOptions, Neighbour, NeighbourLists, PointOptions};

    #[test]
    #[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
    #[cfg(all(feature = "cpu", feature = "wgpu"))]
    fn backends_give_the_same() {
        let cloud: Vec<[f32; 2]> = (0..3000u32)
            .map(|i| [i.wrapping_mul(2_654_435_761) >> 12, i * i % 977].map(|x| x as f32))
            .collect();
        let queries: Vec<[f32; 2]> = cloud.iter().step_by(9).map(|p| [p[0] + 0.5, p[1]]).collect();
        let options = NearestOptions { k: 4, max_distance: 20_000.0, ..NearestOptions::default() };
        let answers = [BackendKind::Cpu, BackendKind::Wgpu].map(|kind| {
            let engine = kind.open_engine(&OpenOptions::default()).expect("a backend").engine;
            let tree = engine.points(&cloud, &PointOptions::default()).expect("a tree");
            let mut found = vec![Neighbour::NONE; 4 * queries.len()];
            tree.nearest(&queries, &mut found, &options).expect("answers");
            let lists = tree.within_each(&queries, &options).expect("answers");
            let one = tree.within(queries[7], &options).expect("an answer");
            assert_eq!(lists.of(7), one);
            assert!(tree.bytes() > 0);
            let kept = KeptBytes { list: 8, neighbour: 16 };
            let each = |max_memory| {
                let mut shown = NeighbourLists::default();
                let limited = NearestOptions { max_memory, ..options };
                tree.for_each_within(&queries, &limited, kept, |list| {
                    shown.push(list.iter().copied(), None)
                })
                .map(|_| shown)
            };
            let shown = each(None).expect("answers");
            assert_eq!((&shown.starts, &shown.found), (&lists.starts, &lists.found));
            // Little more than what is kept is enough, since parts become smaller; less is not.
            let kept = (8 * queries.len() + 16 * lists.found.len()) as u64;
            let little = each(Some(kept + 100_000)).expect("answers in small parts");
            assert_eq!(little.found, lists.found);
            let error = each(Some(kept - 1)).expect_err("too little memory");
            assert!(matches!(error, QueryError::OutOfMemory { .. }), "{error}");
            (tree.tree().digest(), found, lists.starts, lists.found)
        });
        assert!(answers[0] == answers[1]);
        assert!(!answers[0].3.is_empty());
    }
}
