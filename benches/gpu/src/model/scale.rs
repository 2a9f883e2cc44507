//! Counts of a scene too large to be counted, from those of two smaller ones of its kind.
//!
//! Each count is taken to grow by a power of the number of triangles, found from the two; and to be spread evenly over
//! the dispatches of a kernel.

use crate::count::build::CountedBuild;
use crate::count::tally::{Counted, Tally};

/// The power of `n` by which a count grows from `few` to `many`; zero where there is nothing to grow.
pub(crate) fn exponent(few: f64, many: f64, growth: f64) -> f64 {
    if few > 0.0 && many > 0.0 { (many / few).ln() / growth.ln() } else { 0.0 }
}

/// The counts of `triangles` triangles.
pub(crate) fn scaled(small: &CountedBuild, large: &CountedBuild, triangles: u64) -> CountedBuild {
    let growth = large.triangles as f64 / small.triangles as f64;
    let further = triangles as f64 / large.triangles as f64;
    let grown = |few: u64, many: u64| -> u64 {
        let power = exponent(few as f64, many as f64, growth);
        (many as f64 * further.powf(power)).round() as u64
    };
    let kernels = large.kernels.iter().map(|kernel| {
        let many = kernel.all();
        let found = small.kernels.iter().find(|other| other.kernel == kernel.kernel);
        let few = found.map_or(many, Counted::all);
        let dispatches = grown(few.dispatches, many.dispatches).max(1);
        let each = |of: fn(&Tally) -> u64| grown(of(&few), of(&many)) / dispatches;
        let one = Tally {
            dispatches: 1,
            workgroups: each(|of| of.workgroups),
            busy: each(|of| of.busy),
            rounds: each(|of| of.rounds),
            operations: each(|of| of.operations),
            loads: each(|of| of.loads),
            in_step: each(|of| of.in_step),
            busy_operations: each(|of| of.busy_operations),
            busy_loads: each(|of| of.busy_loads),
            busy_in_step: each(|of| of.busy_in_step),
            barriers: each(|of| of.barriers),
            longest_rounds: each(|of| of.longest_rounds),
            longest_operations: each(|of| of.longest_operations),
            longest_loads: each(|of| of.longest_loads),
            longest_barriers: each(|of| of.longest_barriers),
            read: each(|of| of.read),
            written: each(|of| of.written),
        };
        Counted { dispatches: vec![one; dispatches as usize], ..kernel.clone() }
    });
    let kernels = kernels.collect();
    let mut rebuild = large.rebuild;
    rebuild.dispatches =
        grown(small.rebuild.dispatches.into(), large.rebuild.dispatches.into()) as u32;
    CountedBuild { triangles, kernels, rebuild }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(triangles: u64, dispatches: usize, one: Tally) -> CountedBuild {
        let kernel =
            Counted { kernel: "k", text: "k", lanes: 64, dispatches: vec![one; dispatches] };
        CountedBuild { triangles, kernels: vec![kernel], rebuild: Default::default() }
    }

    /// Four times the triangles: bytes four times, rounds twice, dispatches the same. Sixteen times more triangles
    /// still: 16 times the bytes, 4 times the rounds.
    #[test]
    fn counts_grow_by_their_powers() {
        let few = Tally { dispatches: 1, read: 100, rounds: 10, ..Tally::default() };
        let many = Tally { dispatches: 1, read: 400, rounds: 20, ..Tally::default() };
        let found = scaled(&build(1000, 5, few), &build(4000, 5, many), 64_000).all();
        assert_eq!((found.dispatches, found.read, found.rounds), (5, 5 * 6400, 5 * 80));
        assert_eq!(exponent(10.0, 20.0, 4.0), 0.5);
        assert_eq!(exponent(0.0, 20.0, 4.0), 0.0);
    }
}
