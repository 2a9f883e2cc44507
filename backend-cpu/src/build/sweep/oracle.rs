//! The reference for the searches of this module: every plane counted against every reference.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::{BuildConfig, Sweep};
use splitplane_core::layout::Reference;
use splitplane_test_support::random::Random;

use super::cost::{BestSplit, Cell, Split, SplitCosts};

/// The split of least (cost, axis, position) that costs less than `limit`.
pub(super) fn best_split(
    costs: &SplitCosts,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
) -> Option<Split> {
    let mut best = BestSplit::below(limit);
    for axis in 0..3 {
        let faces = |reference: &Reference| [reference.lo[axis], reference.hi[axis]];
        for position in references.iter().flat_map(faces) {
            if !cell.contains(axis, position) {
                continue;
            }
            let mut counts = [0; 3];
            for reference in references {
                let [lo, hi] = faces(reference);
                counts[0] += u32::from(lo < position);
                counts[1] += u32::from(lo == position && hi == position);
                counts[2] += u32::from(hi > position);
            }
            best.consider(costs, cell, axis, position, counts);
        }
    }
    best.split
}

/// Costs of many kinds.
pub(super) fn costs(random: &mut Random) -> [SplitCosts; 2] {
    SplitCosts::both(
        &BuildConfig {
            block_width: random.pick(&[1, 2, 3, 4, 8, 8, 8, 16, 64]),
            traversal_cost: random.pick(&[1, 1, 3, 15]),
            intersection_cost: random.pick(&[2, 2, 4, 20]),
            ..BuildConfig::default()
        },
        &Sweep { empty_bonus: random.pick(&[26, 0, 128, 255]), bad_splits: 0 },
    )
}

/// A cell, and references in it: some planar, some sharing faces, some on its sides.
pub(super) fn node(
    random: &mut Random,
    costs: &SplitCosts,
    count: usize,
) -> (Cell, Vec<Reference>) {
    // Most are of a fair size, some as small or great as numbers are.
    let scales = [1.0, 1.0, 100.0, 1e-6, 1e15, 1e-25, 1e-36, 1e37, 2e38];
    let scales = [0, 1, 2].map(|_| random.pick(&scales));
    let offset = random.pick(&[0.0, 0.0, 0.5, -1.0]);
    let coarse = random.pick(&[0, 4, 30, 1000]);
    let flat = random.below(12);
    let place = |axis: usize, x: f64| {
        let x = if coarse > 0 { (x * f64::from(coarse)).round() / f64::from(coarse) } else { x };
        if axis == flat { offset as f32 } else { ((x + offset) * scales[axis]) as f32 }
    };
    let mut bounds = Aabb::EMPTY;
    let longest = random.pick(&[0.02, 0.2, 1.0]);
    let references: Vec<Reference> = (0..count)
        .map(|triangle| {
            let mut part = Aabb::EMPTY;
            for axis in 0..3 {
                let from = random.unit();
                let to = (from + longest * random.unit()).min(1.0);
                let to = if random.below(6) == 0 { from } else { to };
                let snap = |x: f32| if x.abs() < f32::MIN_POSITIVE { 0.0 } else { x };
                part.lo[axis] = snap(place(axis, from));
                part.hi[axis] = snap(place(axis, to));
                bounds.lo[axis] = bounds.lo[axis].min(part.lo[axis]);
                bounds.hi[axis] = bounds.hi[axis].max(part.hi[axis]);
            }
            Reference::new(&part, triangle as u32)
        })
        .collect();
    (Cell::new(costs, &bounds), references)
}
