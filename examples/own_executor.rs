//! A custom executor: the build schedule on plain threads, with nothing of splitplane but its
//! core. `cargo run --example own_executor`
//!
//! The core says what each kernel does to one item of its grid (`reference::kernels`); an executor says
//! where the buffers lie and who works on which items. This one is held to the reference, dispatch by
//! dispatch, which is also how to find a mistake in an executor that has kernels of its own.

use std::sync::Mutex;
use std::thread;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::build::lockstep::{Inspect, Lockstep};
use splitplane_core::build::reference::kernels::Lists;
use splitplane_core::build::reference::{Budget, Buffers, Parts, ReferenceExecutor, kernels as k};
use splitplane_core::build::schedule::Executor;
use splitplane_core::build::{reference, schedule};
use splitplane_core::config::{BuildConfig, CHUNK, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_core::layout::{Chunk, LargeNode};
use splitplane_core::mesh::Mesh;

/// One build over one mesh, by scoped threads.
struct Threads<'a> {
    mesh: Mesh<'a>,
    config: BuildConfig,
    buffers: Buffers,
    budget: Budget<'a>,
    bounds: Aabb,
}

/// Works on all items of a grid. Each thread takes the next item when it has done one.
fn each<I>(grid: I, work: impl Fn(I::Item) + Sync)
where
    I: Iterator<Item: Send> + Send,
{
    let grid = Mutex::new(grid);
    let next = || grid.lock().ok()?.next();
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(item) = next() {
                    work(item);
                }
            });
        }
    });
}

/// Fills a buffer with what a kernel gives for each item.
fn fill<T: Send>(buffer: &mut [T], kernel: impl Fn(usize) -> T + Sync) {
    each(buffer.iter_mut().enumerate(), |(item, out)| *out = kernel(item));
}

/// The first step of two kernels.
fn name_chunks(nodes: &[LargeNode], chunks: &mut [Chunk]) {
    let mut parts = Parts::new(chunks);
    let own = nodes.iter().map(|node| parts.take(k::chunks_of(node))).enumerate();
    each(own, |(node, chunks)| k::name_chunks(node, nodes, chunks));
}

impl Executor<TreeBuilder> for Threads<'_> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        self.buffers.make_room(kernel, &mut self.budget)?;
        let (mesh, config, b) = (&self.mesh, &self.config, &mut self.buffers);
        let active = b.count(Counter::ActiveNodes);
        let input_chunks = b.count(Counter::InputChunks);
        let chunks = b.count(Counter::Chunks);
        let top = b.count(Counter::TopNodes);
        let small = b.count(Counter::SmallRoots);
        match kernel {
            Kernel::TriangleBounds => {
                let triangles = b.triangles.chunks_mut(CHUNK as usize);
                let outputs = triangles.zip(&mut b.chunk_counts).zip(&mut b.chunk_bounds);
                each(outputs.enumerate(), |(chunk, ((triangles, counts), bounds))| {
                    (*counts, *bounds) = k::triangle_bounds(chunk, mesh, triangles);
                });
            }
            Kernel::ScanTriangles => {
                (b.active_nodes[0], b.top_nodes[0]) =
                    k::scan_triangles(&b.chunk_bounds, &mut b.chunk_counts, &mut b.counters);
                self.bounds = b.active_nodes[0].cell();
            }
            Kernel::GatherReferences => {
                let kept = b.count(Counter::ActiveReferences);
                let mut parts = Parts::new(&mut b.references);
                let part = |chunk| (chunk, parts.take(k::gathered(chunk, &b.chunk_counts, kept)));
                each((0..input_chunks).map(part), |(chunk, references)| {
                    k::gather_references(chunk, &b.triangles, references);
                });
            }
            Kernel::SplitMedian => {
                name_chunks(&b.active_nodes[..active], &mut b.chunks);
                fill(&mut b.decisions[..active], |node| {
                    let (nodes, bounds) = (&b.active_nodes, &b.chunk_bounds);
                    k::split_median::<Strict>(config, node, nodes, bounds, &b.references)
                });
            }
            Kernel::NodeBounds => {
                name_chunks(&b.active_nodes[..active], &mut b.chunks);
                fill(&mut b.node_bounds[..active], |node| {
                    k::node_bounds(node, &b.active_nodes, &b.chunk_bounds)
                });
            }
            Kernel::BinReferences => fill(&mut b.chunk_bins[..chunks], |chunk| {
                let (chunks, bounds) = (&b.chunks, &b.node_bounds);
                k::bin_references::<Strict>(config, chunk, chunks, bounds, &b.references)
            }),
            Kernel::SplitBinned => fill(&mut b.decisions[..active], |node| {
                let (nodes, bounds) = (&b.active_nodes, &b.node_bounds);
                k::split_binned::<Strict>(config, node, nodes, bounds, &b.chunk_bins)
            }),
            Kernel::ClassifyReferences => {
                let outputs = b.reference_sides.iter_mut().zip(&mut b.chunk_counts).enumerate();
                each(outputs.take(chunks), |(chunk, (sides, counts))| {
                    let (chunks, decisions) = (&b.chunks, &b.decisions);
                    let (references, triangles) = (&b.references, &b.triangles);
                    (*sides, *counts) = k::classify_references::<Strict>(
                        config, chunk, chunks, decisions, references, triangles,
                    );
                });
                for chunk in 0..chunks {
                    k::count_children(
                        chunk,
                        b.chunk_counts[chunk],
                        &mut b.chunks,
                        &mut b.decisions,
                    );
                }
            }
            Kernel::AllocateChildren => {
                let mut lists = Lists {
                    next_nodes: &mut b.next_nodes,
                    small_roots: &mut b.small_roots,
                    top_nodes: &mut b.top_nodes,
                    level_starts: &mut b.level_starts,
                };
                let (nodes, decisions) = (&b.active_nodes[..active], &mut b.decisions);
                k::allocate_children(config, nodes, decisions, &mut lists, &mut b.counters);
            }
            Kernel::ScatterReferences => {
                let (chunks, decisions) = (&b.chunks[..chunks], &b.decisions);
                let (next, small) = (&mut b.next_references, &mut b.small_references);
                let sides = &b.reference_sides;
                let children = k::destinations(config, chunks, decisions, sides, next, small);
                let (references, triangles) = (&b.references, &b.triangles);
                let outputs = children.zip(&mut b.chunk_bounds).enumerate();
                each(outputs, |(chunk, (children, bounds))| {
                    *bounds = k::scatter_references::<Strict>(
                        config, chunk, chunks, decisions, references, triangles, sides, children,
                    );
                });
            }
            Kernel::BuildSmall => fill(&mut b.small_sizes[..small], |root| {
                k::build_small::<Strict>(config, root, &b.small_roots, &b.small_references)
            }),
            // This executor hands nothing over.
            Kernel::BuildMiddle
            | Kernel::ScanMiddle
            | Kernel::PlaceMiddle
            | Kernel::MeasureMiddle
            | Kernel::EmitMiddle => {}
            Kernel::SubtreeSizes => {
                let (nodes, sizes) = (&b.top_nodes[..top], &b.small_sizes);
                k::subtree_sizes(nodes, sizes, &mut b.top_sizes);
            }
            Kernel::PreorderAddresses => {
                let (sizes, addresses) = (&b.top_sizes, &mut b.top_addresses);
                k::preorder_addresses(&b.top_nodes[..top], sizes, addresses, &mut b.counters);
            }
            Kernel::EmitTop => {
                for node in 0..top {
                    if let Some((at, emitted)) = k::emit_top(node, &b.top_nodes, &b.top_addresses) {
                        b.nodes[at] = emitted;
                    }
                    let address = k::small_address(node, &b.top_nodes, &b.top_addresses);
                    if let Some((root, address)) = address {
                        b.small_addresses[root] = address;
                    }
                }
            }
            Kernel::EmitSmall => {
                // In the order of the output, so that it can be divided.
                let address = |root: usize| b.small_addresses[root];
                let mut roots: Vec<usize> = (0..small).collect();
                roots.sort_unstable_by_key(|&root| address(root).nodes);
                let mut nodes = Parts::new(&mut b.nodes);
                let mut references = Parts::new(&mut b.leaf_references);
                let part = |root| {
                    let (at, size): (_, _) = (address(root), b.small_sizes[root]);
                    let range = |first: u32, count: u32| first as usize..(first + count) as usize;
                    let nodes = nodes.take(range(at.nodes, size.nodes));
                    (root, nodes, references.take(range(at.references, size.references)))
                };
                each(roots.into_iter().map(part), |(root, nodes, references)| {
                    let (roots, from) = (&b.small_roots, &b.small_references);
                    let addresses = &b.small_addresses;
                    k::emit_small::<Strict>(
                        config, root, roots, from, addresses, nodes, references,
                    );
                });
            }
        }
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        self.buffers.swap(a, b)
    }

    fn pending(&mut self, counter: Counter, _rounds: u32) -> Result<bool, BuildError> {
        Ok(self.buffers.count(counter) > 0)
    }
}

impl Inspect<TreeBuilder> for Threads<'_> {
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, BuildError> {
        self.buffers.copy_live(buffer)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (positions, triangles) = hills(80);
    let mesh = Mesh::indexed(&positions, &triangles)?;
    for preset in [Preset::Fast, Preset::Balanced] {
        let config = preset.config();
        let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
        let buffers = Buffers::new(mesh.len() as u32);
        let own = Threads { mesh, config, buffers, budget: Budget::default(), bounds: Aabb::EMPTY };
        let expected = ReferenceExecutor::new(mesh, config, Budget::default())?;

        // An error here names kernel, buffer and element.
        let mut lockstep = Lockstep::new(own, expected);
        schedule::build(&mut lockstep, planes)?;
        let dispatches = lockstep.dispatches();
        let (own, _) = lockstep.into_inner();
        let tree = own.buffers.into_tree(own.bounds, config);

        let (expected, _) = reference::build(&mesh, &config.into())?;
        if tree.digest() != expected.digest() {
            return Err("the trees differ".into());
        }
        let (name, nodes) = (preset.name(), tree.nodes.len());
        println!("{name}: digest {}, {nodes} nodes, {dispatches} dispatches alike", tree.digest());
    }
    Ok(())
}

/// A ground with hills, so many squares on a side: any heights will do.
fn hills(side: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let row = side + 1;
    let height = |x: u32, z: u32| ((x * x + 3 * z * z + 5 * x * z) % 17) as f32 / 8.0;
    let positions = (0..row * row)
        .map(|i| [(i % row) as f32, height(i % row, i / row), (i / row) as f32])
        .collect();
    let triangles = (0..side * side)
        .flat_map(|i| {
            let a = i / side * row + i % side;
            [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]]
        })
        .collect();
    (positions, triangles)
}
