//! The harness's task `knn`: the k nearest of `points.f32` to each of `queries.f32`, for three k. NAME is
//! `splitplane-points` (axes by widest extent) or `splitplane-points-cycle`.

use std::path::Path;

use serde_json::{Map, Value, json};
use splitplane_core::points::build::PointOptions;
use splitplane_core::points::nearest::{NearestOptions, Neighbour};
use splitplane_core::points::tree::Axes;
use splitplane_cpu::CpuPointTree;

use super::{Clock, builds, read, repeat, write};

/// The numbers of points asked for.
const KS: [usize; 3] = [1, 8, 50];

/// The axes that a name asks for.
fn axes(name: &str) -> Result<Axes, String> {
    match name {
        "splitplane-points" => Ok(Axes::Widest),
        "splitplane-points-cycle" => Ok(Axes::Cycle),
        _ => Err(format!("{name}: for points there are splitplane-points and its -cycle")),
    }
}

pub(super) fn measure(
    name: &str,
    dir: &Path,
    (threads, reps): (usize, usize),
    prefix: &str,
) -> Result<Value, String> {
    let clock = Clock::asked()?;
    let options = PointOptions { axes: axes(name)?, ..PointOptions::default() };
    let points: Vec<[f32; 3]> = read(&dir.join("points.f32"))?;
    let queries: Vec<[f32; 3]> = read(&dir.join("queries.f32"))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| error.to_string())?;
    let build = || pool.install(|| CpuPointTree::build(&points, &options));
    let (built, build_ms) = builds(clock, reps, build)?;
    let mut sets = Map::new();
    for k in KS {
        let options = NearestOptions { k, ..NearestOptions::default() };
        let mut found = vec![Neighbour::NONE; queries.len() * k];
        let mut ask = || pool.install(|| built.nearest(&queries, &mut found, &options));
        ask().map_err(|error| error.to_string())?;
        let knn_s = repeat(clock, reps, || ask().expect("answered before"));
        let ids: Vec<u32> = found.iter().map(|neighbour| neighbour.point).collect();
        write(&format!("{prefix}.k{k}.knn"), bytemuck::cast_slice(&ids))?;
        sets.insert(format!("k{k}"), json!({"queries": queries.len(), "knn_s": knn_s}));
    }
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "clock": clock.name(),
        "build_ms": build_ms,
        "struct_bytes": built.bytes(),
        "build_peak_bytes": built.bytes(),
        "sets": sets,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_how_axes_are_chosen() {
        assert_eq!(axes("splitplane-points"), Ok(Axes::Widest));
        assert_eq!(axes("splitplane-points-cycle"), Ok(Axes::Cycle));
        assert!(axes("splitplane-fast").is_err());
    }
}
