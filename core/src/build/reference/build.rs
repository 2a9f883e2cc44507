//! A tree by the reference executor.

use super::{Budget, ReferenceExecutor};
use crate::backend::BuildOptions;
use crate::build::schedule;
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::report::BuildSummary;
use crate::tree::KdTree;

/// Builds a tree on the calling thread, with nothing but the core: the same bytes as every backend.
///
/// Ignores the layout in the options: it says what queries read, and the reference traversal
/// ([`query::traverse`](crate::query::traverse)) reads the tree itself.
///
/// # Errors
/// A configuration out of range, a limit that binds, a watch that cancels the build, and
/// [`BuildError::PresetNotOnDevice`] for preset `best`, which the schedule does not build.
pub fn build(
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
) -> Result<(KdTree, BuildSummary), BuildError> {
    let BuildOptions { config, max_memory, watch, .. } = *options;
    let budget = Budget::new(max_memory, watch);
    let mut executor = ReferenceExecutor::new(*mesh, config, budget)?;
    let preset = config.preset();
    let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
    schedule::build(&mut executor, planes)?;
    let summary = executor.summary();
    Ok((executor.into_tree(), summary))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use alloc::vec::Vec;
    use core::ops::ControlFlow;
    use std::sync::Mutex;

    use super::*;
    use crate::aabb::Aabb;
    use crate::arithmetic::{Arithmetic, Hostile, Strict};
    use crate::build::schedule::Executor;
    use crate::config::{BuildConfig, Planes, Preset};
    use crate::kernel::{Buffer, Counter, Kernel, TreeBuilder};
    use crate::query::{lines, traverse};
    use crate::random;
    use crate::ray::{Accuracy, Culling, QueryOptions, Ray};
    use crate::tree::KdTreeView;
    use crate::tree::node::KdNode;
    use crate::tree::validate::validate_mesh;
    use crate::triangle::{Triangle, prepare};
    use crate::watch::{Progress, Stage};

    /// Triangles of several kinds: small ones by chance; between whole numbers, so that many lie in planes and some have no
    /// area; strips that all reach through the middle; copies of one.
    fn soup(seed: u64, count: u32) -> Vec<Triangle> {
        let draw = |numbers: [u64; 3]| random::unit(seed, &numbers);
        let triangle = |i: u32| {
            let i = u64::from(i);
            let at = |k: u64| 16.0 * draw([i, 9, k]);
            [0, 1, 2].map(|corner| {
                [0, 1, 2].map(|k| {
                    let part = draw([i, corner, k]);
                    let place = match (seed + i / 64) % 4 {
                        0 | 1 => at(k) + part,
                        2 => (at(k) + 3.0 * part) as i32 as f64,
                        _ if i % 8 == 0 => 5.0 + (corner == k) as u32 as f64,
                        _ => 16.0 * part,
                    };
                    if i % 37 == 36 && corner == 0 { f32::NAN } else { place as f32 }
                })
            })
        };
        (0..count).map(triangle).collect()
    }

    fn configs() -> Vec<BuildConfig> {
        let mut configs = Vec::new();
        for preset in [Preset::Fast, Preset::Balanced] {
            let tuned = preset.config();
            configs.push(tuned);
            let coarse = BuildConfig { clip: false, block_width: 1, ..tuned };
            configs.push(coarse.with_stages(|stages| stages.small_node_limit = 7));
            let mut shallow = BuildConfig { max_depth: 5, ..tuned };
            shallow = shallow.with_stages(|stages| stages.empty_cutoff = 1);
            if let Some(bins) = shallow.bins_mut() {
                *bins = 5;
            }
            configs.push(shallow);
        }
        configs
    }

    fn soups() -> Vec<Vec<Triangle>> {
        let counts = [0, 1, 2, 40, 64, 65, 300, 700];
        counts.into_iter().enumerate().map(|(i, count)| soup(i as u64, count)).collect()
    }

    fn options(config: BuildConfig) -> BuildOptions<'static> {
        BuildOptions { config, ..BuildOptions::default() }
    }

    /// Trees are valid, whatever the mesh, and rays meet in them what they meet in one leaf with all triangles.
    #[test]
    fn trees_lose_nothing() {
        let mut hits = 0;
        for (number, soup) in soups().iter().enumerate() {
            let mesh = Mesh::soup(soup).expect("few triangles");
            let kept: Vec<u32> =
                (0..mesh.len() as u32).filter(|&i| prepare(&soup[i as usize]).kept).collect();
            let all = kept.iter().flat_map(|&i| soup[i as usize]).collect::<Vec<_>>();
            let nodes = [KdNode::leaf(0, kept.len() as u32)];
            let one_leaf = KdTreeView {
                nodes: &nodes,
                references: &kept,
                bounds: if kept.is_empty() { Aabb::EMPTY } else { Aabb::of_points(&all) },
                triangles: mesh.len() as u32,
                config: BuildConfig::default(),
            };
            let scale = lines::scene_scale(&one_leaf, &mesh);
            for config in configs() {
                let (tree, summary) = build(&mesh, &options(config)).expect("memory");
                assert_eq!(validate_mesh(&tree.view(), &mesh), Ok(()), "{number} {config:?}");
                assert_eq!(tree.bounds, one_leaf.bounds);
                let counted = [summary.triangles, summary.dropped].map(|count| count as usize);
                assert_eq!(counted, [mesh.len(), mesh.len() - kept.len()]);
                assert_eq!(lines::scene_scale(&tree.view(), &mesh), scale);
                for i in 0..150u64 {
                    let draw = |what: u64| random::unit(91, &[number as u64, i, what]);
                    let origin = [0, 1, 2].map(|k| (20.0 * draw(k) - 2.0) as f32);
                    // At corners, where cells meet, or anywhere.
                    let aim = match all.get((draw(3) * all.len() as f64) as usize) {
                        Some(corner) if i % 2 == 0 => *corner,
                        _ => [4, 5, 6].map(|k| (16.0 * draw(k)) as f32),
                    };
                    let direction = [0, 1, 2].map(|k| aim[k] - origin[k]);
                    let ray = Ray::new(origin, direction)
                        .with_limits(-0.5, [4.0, 0.7][i as usize % 3 / 2]);
                    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
                        let culling = [Culling::None, Culling::Back][i as usize / 2 % 2];
                        let ignore = kept.get(i as usize % 9).copied();
                        let options =
                            QueryOptions { accuracy, culling, ignore, ..Default::default() };
                        let [found, expected] = [&tree.view(), &one_leaf]
                            .map(|tree| traverse::closest_hit(tree, &mesh, &scale, &ray, &options));
                        assert_eq!(found, expected, "{number} {config:?} {ray:?}");
                        let any = traverse::any_hit(&tree.view(), &mesh, &scale, &ray, &options);
                        assert_eq!(any, expected.is_some(), "{number} {config:?} {ray:?}");
                        hits += u32::from(any);
                    }
                }
            }
        }
        assert!(hits > 2_000, "{hits}");
    }

    /// The digests of trees stay as they are until [`crate::tree::DIGEST_VERSION`] is raised.
    #[test]
    fn trees_stay_the_same() {
        let mut found = Vec::new();
        for config in configs() {
            let mut digests = [0; 8];
            for (digest, soup) in digests.iter_mut().zip(soups()) {
                let mesh = Mesh::soup(&soup).expect("few triangles");
                *digest = build(&mesh, &options(config)).expect("memory").0.digest().0;
            }
            let both = digests.iter().fold(0, |sum, digest| random::hash(sum, &[*digest]));
            found.push(both);
        }
        assert_eq!(found, DIGESTS, "{found:#x?}");
    }

    const DIGESTS: [u64; 6] = [
        0x9851_cd3f_ccdd_4d4a,
        0x7320_6d51_ab5a_1355,
        0x30fe_31e6_83db_820c,
        0xa560_9ece_e204_ada0,
        0xb267_0a88_3d0e_1ef0,
        0x598e_f20c_ae51_372e,
    ];

    fn run<A: Arithmetic>(
        mesh: &Mesh<'_>,
        config: BuildConfig,
        steps: impl FnOnce(&mut ReferenceExecutor<'_, A>) -> Result<(), BuildError>,
    ) -> KdTree {
        let mut executor = ReferenceExecutor::<A>::in_arithmetic(*mesh, config, Budget::default())
            .expect("in range");
        steps(&mut executor).expect("memory");
        executor.into_tree()
    }

    /// Does not look at its counters: makes more rounds than are needed.
    struct Blind<'a, E>(&'a mut E, u32);

    impl<E: Executor<TreeBuilder>> Executor<TreeBuilder> for Blind<'_, E> {
        type Error = E::Error;

        fn dispatch(&mut self, kernel: Kernel) -> Result<(), E::Error> {
            self.0.dispatch(kernel)
        }

        fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), E::Error> {
            self.0.swap(a, b)
        }

        fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, E::Error> {
            Ok(rounds < self.1 || self.0.pending(counter, rounds)?)
        }
    }

    /// More rounds than needed, or stages that ran too early and run again, leave the same tree; so do devices that round
    /// where they may.
    #[test]
    fn other_ways_to_build_give_the_same_tree() {
        for soup in soups() {
            let mesh = Mesh::soup(&soup).expect("few triangles");
            for config in configs() {
                let planes = config.preset().planes().expect("a preset of the schedule");
                let (tree, _) = build(&mesh, &options(config)).expect("memory");
                let hostile = run::<Hostile>(&mesh, config, |e| schedule::build(e, planes));
                assert_eq!(hostile, tree);
                let blind =
                    run::<Strict>(&mesh, config, |e| schedule::build(&mut Blind(e, 12), planes));
                assert_eq!(blind, tree);
                let again = run::<Strict>(&mesh, config, |e| {
                    schedule::build(e, planes)?;
                    schedule::resume(e, planes)
                });
                assert_eq!(again, tree);
            }
        }
    }

    /// With the middle stage the tree is the same, wherever that is not void; and it is void where it must be: too deep for
    /// its nodes to become small, or no plane separates them.
    #[test]
    fn the_middle_stage_gives_the_same_tree() {
        let (mut finished, mut split) = (0, 0);
        let draw = |i: u64, k: u64| random::unit(77, &[i, k]);
        let corner =
            |i, corner: u64| [0, 1, 2].map(|k| 16.0 * draw(i, k) + draw(i, 3 * corner + k));
        let scattered = (0..9_000).map(|i| [1, 2, 3].map(|c| corner(i, c).map(|x| x as f32)));
        for soup in soups().into_iter().chain([soup(4, 6_000), scattered.collect()]) {
            let mesh = Mesh::soup(&soup).expect("few triangles");
            for config in configs() {
                let planes = config.preset().planes().expect("a preset of the schedule");
                if planes == Planes::Binned {
                    continue;
                }
                let (tree, summary) = build(&mesh, &options(config)).expect("memory");
                let executor = ReferenceExecutor::new(mesh, config, Budget::default());
                let mut executor = executor.expect("in range").with_middle_stage();
                schedule::build(&mut executor, planes).expect("memory");
                if executor.is_void() {
                    continue;
                }
                let found = executor.summary();
                assert_eq!(found.large_levels, summary.large_levels);
                assert_eq!(found.small_roots, summary.small_roots);
                let roots = &executor.buffers().middle_roots;
                split += roots.iter().filter(|root| root.nodes > 1).count();
                finished += 1;
                assert_eq!(executor.into_tree(), tree, "{} {config:?}", soup.len());
            }
        }
        assert!(finished >= 20 && split >= 10, "{finished} {split}");
    }

    /// The peak that a build reports is the least limit that it keeps.
    #[test]
    fn builds_keep_their_limit_of_memory() {
        let soup = soup(4, 700);
        let mesh = Mesh::soup(&soup).expect("few triangles");
        for config in configs() {
            let (tree, summary) = build(&mesh, &options(config)).expect("memory");
            let limited = |limit| {
                let max_memory = Some(limit);
                build(&mesh, &BuildOptions { max_memory, ..options(config) })
            };
            assert_eq!(limited(summary.peak_bytes), Ok((tree, summary)));
            for limit in [summary.peak_bytes - 1, summary.peak_bytes / 2, 0] {
                let refused = limited(limit);
                let Err(BuildError::OutOfMemory { needed, limit: told }) = refused else {
                    panic!("{refused:?}");
                };
                assert!(needed > limit && told == limit);
            }
        }
    }

    /// Stages in their order, none beyond its end, the last call at the end of each; and no call after a refusal.
    #[test]
    fn progress_comes_in_order() {
        let soup = soup(4, 3_000);
        let mesh = Mesh::soup(&soup).expect("few triangles");
        let config = BuildConfig::default().with_stages(|stages| stages.small_node_limit = 16);
        let watched = |calls: usize| {
            let told = Mutex::new(Vec::new());
            let watch = |progress: &Progress| {
                let mut told = told.lock().expect("no panic");
                told.push(*progress);
                if told.len() == calls { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let built = build(&mesh, &BuildOptions { watch: Some(&watch), ..options(config) });
            (built.map(|(tree, _)| tree.digest()), told.into_inner().expect("no panic"))
        };
        let (digest, told) = watched(usize::MAX);
        assert_eq!(digest, build(&mesh, &options(config)).map(|(tree, _)| tree.digest()));
        let order = [Stage::Start, Stage::LargeNodes, Stage::SmallNodes, Stage::Output];
        let place = |stage| order.iter().position(|&one| one == stage).expect("a stage of builds");
        for pair in told.windows(2) {
            let (before, after) = (pair[0], pair[1]);
            match place(after.stage) - place(before.stage) {
                0 => assert!(before.done <= after.done && before.total == after.total),
                step => assert!(step == 1 && before.done == before.total || before.total == 0),
            }
        }
        for stage in order {
            assert!(told.iter().any(|progress| progress.stage == stage), "{stage:?}");
        }
        assert!(told.iter().all(|progress| progress.total == 0 || progress.done <= progress.total));
        assert_eq!(told[0], Progress { stage: Stage::Start, done: 0, total: 6_000 });
        for calls in 1..=told.len() {
            let (built, heard) = watched(calls);
            assert_eq!(heard, told[..calls]);
            assert!(matches!(built, Err(BuildError::Cancelled { .. })), "{built:?}");
        }
    }
}
