use super::*;
use crate::simd::portable::Portable;
use splitplane_core::arithmetic::Strict;
use splitplane_core::build::split::strictly_inside;
use splitplane_core::sah::{leaf_cost, split_cost};
use splitplane_test_support::random::Random;

/// The stage as the paper has it: every candidate of every triangle, costs by core's functions,
/// counts from masks.
fn by_masks(config: &BuildConfig, root: &SmallRootBuilder, node: &Pending) -> Option<SplitPlane> {
    let extents = Extents::of::<Strict>(&node.cell)?;
    let area = Extents::half_area(extents.cells);
    let count = node.mask.count_ones();
    let mut best = Rank { cost: leaf_cost(config, area, count), axis: 0, position: 0 };
    let mut found = None;
    for axis in 0..3 {
        for triangle in TriangleMask::from_bits(node.mask).iter() {
            let i = triangle as usize;
            for position in [root.faces[axis].lo[i], root.faces[axis].hi[i]] {
                if !strictly_inside(&node.cell, axis, position) {
                    continue;
                }
                let plane = SplitPlane { axis, position };
                let [left, right] = Portable::sides(&root.faces[axis], root.count, position)
                    .map(|side| side & node.mask);
                let offset = extents.offset::<Strict>(node.cell.lo[axis], position);
                let areas = extents.split_areas(axis, offset);
                let cost = split_cost(config, areas, left.count_ones(), right.count_ones());
                let rank = Rank::new(cost, axis, position);
                if rank < best {
                    (best, found) = (rank, Some(plane));
                }
            }
        }
    }
    found
}

#[test]
fn the_same_planes_as_by_masks() {
    let mut random = Random::new(3);
    // A coarse grid, so that planes coincide and triangles are planar.
    let mut next = move || random.below(256) as f32 / 16.0;
    let mut splits = 0;
    for round in 0..400 {
        let count = 1 + (round * 7) % 64;
        let mut root = Box::new(SmallRootBuilder::new());
        let references: Vec<Reference> = (0..count)
            .map(|triangle| {
                let a = [next(), next(), next()];
                let b = [a[0] + next() / 8.0, a[1] + next() / 8.0, a[2]];
                Reference::new(&Aabb { lo: a, hi: b }, triangle)
            })
            .collect();
        root.load(&references);
        let cell = references.iter().fold(Aabb::EMPTY, |c, r| c.union(&r.bounds()));
        for (traversal, intersection, width) in [(1, 4, 16), (3, 2, 1), (1, 1, 4), (1, 8, 7)] {
            let config = BuildConfig {
                traversal_cost: traversal,
                intersection_cost: intersection,
                block_width: width,
                ..BuildConfig::default()
            };
            for mask in [u64::MAX, 0x5555_5555_5555_5555, 0x0f0f_00ff_0000_ffff] {
                let mask = mask & TriangleMask::first(count).bits();
                let node = Pending { mask, cell, depth: 0, parent: u32::MAX };
                let found =
                    root.best_split::<Strict, Portable>(&SmallRootCosts::of(&config), &node);
                assert_eq!(found, by_masks(&config, &root, &node));
                splits += usize::from(found.is_some());
            }
        }
    }
    assert!(splits > 500, "{splits}");
}

#[test]
fn division_by_w_is_exact() {
    for block_width in 1..=64 {
        let costs = SmallRootCosts::of(&BuildConfig { block_width, ..BuildConfig::default() });
        for count in 0..=64 {
            assert_eq!(costs.blocks(count), count.div_ceil(block_width));
        }
    }
}
