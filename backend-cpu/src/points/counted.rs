//! What searches visit, counted: piles of points in one place, and queries from which all points
//! are equally far, cost no more than other points do.

use std::collections::HashMap;

use splitplane_core::points::build::PointOptions;
use splitplane_core::points::collect::Collector;
use splitplane_core::points::distance::NOTHING;
use splitplane_core::points::nearest::walk;
use splitplane_core::points::tree::Axes;

use super::few::Few;
use super::search::{NO_FRAMES, Visitor};
use super::tree::CpuPointTree;
use crate::simd::{InstructionSet, Simd};

/// Counts blocks, or the parts of them that fit a vector.
struct Counted<V> {
    visitor: V,
    blocks: u64,
}

impl<V: Visitor> Visitor for Counted<V> {
    const ONE: bool = V::ONE;
    fn stop(&self) -> u64 {
        self.visitor.stop()
    }
    fn visit(&mut self, key: u64) {
        self.visitor.visit(key);
    }
    unsafe fn visit_lanes<S: Simd>(
        &mut self,
        distances: *const f32,
        points: *const u32,
        near: u32,
    ) {
        self.blocks += 1;
        // SAFETY: the caller's contract.
        unsafe { self.visitor.visit_lanes::<S>(distances, points, near) }
    }
}

struct Kept(Collector);

impl Visitor for Kept {
    fn stop(&self) -> u64 {
        self.0.stop()
    }
    fn visit(&mut self, key: u64) {
        self.0.add(key);
    }
}

const COUNT: usize = 1 << 14;
const KS: [usize; 4] = [1, 8, 20, 100];

/// Numbers between -1 and 1.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
    fn point(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

/// A name, points, and queries.
type Case = (String, Vec<[f32; 3]>, Vec<[f32; 3]>);

fn cases() -> Vec<Case> {
    let mut numbers = Numbers(7);
    let scattered: Vec<[f32; 3]> = (0..COUNT).map(|_| numbers.point()).collect();
    let mut queries: Vec<[f32; 3]> = (0..40).map(|_| numbers.point()).collect();
    queries.extend((0..20).map(|_| numbers.point().map(|x| x * 1e-3)));
    queries.extend([[0.0; 3], [0.5, -0.25, 0.125], [1.5, 1.5, 1.5]]);
    let mut cases = Vec::new();
    // Of each 10 points so many are in one place, or so near that no distance tells.
    for (places, size) in [(1, 0.0), (1, 1e-33), (20, 0.0)] {
        for tenths in [0, 2, 5, 9, 10] {
            let mut points = scattered.clone();
            for (i, point) in points.iter_mut().enumerate() {
                if i * 7 % 10 < tenths {
                    let place = (i / 10 % places) as f32 / 20.0;
                    // Against the order of indices.
                    *point = [place - size * i as f32, place, -place];
                }
            }
            cases.push((
                format!("{tenths}0 % in {places} places of {size}"),
                points,
                queries.clone(),
            ));
        }
    }
    let far = |size: f32| [[size, size, size], [size, 0.0, 0.0], [0.0, -size, size], [size; 3]];
    let mut sorted = scattered;
    sorted.sort_by(|a, b| b[0].total_cmp(&a[0]));
    for size in [1e9, 1e19, 1e30] {
        cases.push((format!("from {size}"), sorted.clone(), far(size).to_vec()));
    }
    cases
}

#[test]
fn searches_visit_few_blocks_however_many_points_tie() {
    let mut scattered = HashMap::new();
    for (name, points, queries) in cases() {
        for axes in [Axes::Widest, Axes::Cycle] {
            let options = PointOptions { axes, ..PointOptions::default() };
            let mut check = |search: String, k: usize, visited: u64| {
                let blocks = visited / queries.len() as u64;
                let first = *scattered.entry((search.clone(), k)).or_insert(blocks);
                // From afar the indices alone decide, which stand in no order.
                let factor = if name.starts_with("from") { 6 } else { 2 };
                let most = factor * first.max(12 + k as u64 / 4);
                assert!(blocks <= most, "{name}, {search}, k = {k}: {blocks} blocks, not {most}");
            };
            for set in InstructionSet::available() {
                let tree = CpuPointTree::build(&points, &options).unwrap();
                let tree = tree.with_instruction_set(set);
                for k in KS {
                    let blocks = queries.iter().map(|&query| by_vectors(&tree, query, k)).sum();
                    check(format!("{set:?}, {axes:?}"), k, blocks);
                }
            }
            let tree = CpuPointTree::build(&points, &options).unwrap();
            for k in KS {
                let visited: u64 = queries.iter().map(|&query| by_reference(&tree, query, k)).sum();
                check(format!("reference, {axes:?}"), k, visited / 16);
            }
        }
    }
}

fn by_vectors(tree: &CpuPointTree<3>, query: [f32; 3], k: usize) -> u64 {
    if k <= 8 {
        let mut counted = Counted { visitor: Few::new(k, NOTHING), blocks: 0 };
        tree.search(query, &mut counted, &mut { NO_FRAMES });
        return counted.blocks;
    }
    let mut kept = Collector::new(k, COUNT).unwrap();
    kept.begin(NOTHING);
    let mut counted = Counted { visitor: Kept(kept), blocks: 0 };
    tree.search(query, &mut counted, &mut { NO_FRAMES });
    counted.blocks
}

fn by_reference(tree: &CpuPointTree<3>, query: [f32; 3], k: usize) -> u64 {
    let mut kept = Collector::new(k, COUNT).unwrap();
    kept.begin(NOTHING);
    let mut visited = 0;
    walk(tree.tree(), query, NOTHING, |key| {
        visited += 1;
        if key < kept.stop() {
            kept.add(key);
        }
        kept.stop()
    });
    visited
}
