//! The harness's task `near`: the closest point of the mesh to each of `SET.points`.

use std::path::Path;

use serde_json::{Map, Value, json};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};

use super::{Clock, Plan, Side, builds, read, repeat, write};

/// Points in a box about the scene, and points near its surface.
const SETS: [&str; 2] = ["box", "skin"];

/// Measures the tree that a plan asks for.
pub(super) fn measure(
    (plan, backend, clock): (&Plan, &Side, Clock),
    pool: &rayon::ThreadPool,
    mesh: &Mesh<'_>,
    dir: &Path,
    (reps, prefix): (usize, &str),
) -> Result<Value, String> {
    let options = BuildOptions { layout: plan.layout, ..BuildOptions::from(plan.config) };
    let build = || pool.install(|| backend.build(mesh, &options));
    let (built, build_ms) = builds(clock, reps, build)?;
    let tree = built.accelerator();
    let mut sets = Map::new();
    for set in SETS {
        let points: Vec<[f32; 3]> = read(&dir.join(format!("{set}.points")))?;
        let mut found = vec![ClosestPoint::NONE; points.len()];
        let mut ask = || {
            let options = ClosestPointOptions::default();
            pool.install(|| tree.closest_points(&points, &mut found, &options))
        };
        ask().map_err(|error| error.to_string())?;
        let near_s = repeat(clock, reps, || {
            ask().expect("answered before");
        });
        let records = records(&found);
        write(&format!("{prefix}.{set}.near"), bytemuck::cast_slice(&records))?;
        sets.insert(set.into(), json!({"queries": points.len(), "near_s": near_s}));
    }
    let peak = tree.summary().peak_bytes + tree.query_bytes();
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "clock": clock.name(),
        "build_ms": build_ms,
        "struct_bytes": tree.query_bytes(),
        "build_peak_bytes": peak,
        "sets": sets,
    }))
}

/// Distance and triangle of each answer, as the harness reads them.
fn records(found: &[ClosestPoint]) -> Vec<[u32; 2]> {
    let record = |closest: &ClosestPoint| {
        [(closest.distance_squared.sqrt() as f32).to_bits(), closest.triangle]
    };
    found.iter().map(record).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_distances_and_triangles() {
        let found = [
            ClosestPoint { distance_squared: 6.25, triangle: 7, ..ClosestPoint::NONE },
            ClosestPoint::NONE,
        ];
        let expected = [[2.5f32.to_bits(), 7], [f32::INFINITY.to_bits(), u32::MAX]];
        assert_eq!(records(&found), expected);
    }
}
