//! How cubic cells are, and how evenly they divide rays and space.

use super::visits::follow;
use super::{Amounts, Claim, SEED};
use crate::paper::ReportError;
use crate::paper::rays::FrameRays;
use crate::paper::scene::{Placed, Settings};
use crate::paper::timing::{median, pool};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend};
use splitplane_core::config::Preset;
use splitplane_core::query::lines::Lines;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;
use splitplane_cpu::CpuBackend;

/// Cells and rays of the scene's trees.
pub(super) fn shapes(
    placed: &Placed,
    settings: &Settings,
    amounts: &Amounts,
) -> Result<Vec<Claim>, ReportError> {
    let mesh = placed.scene.mesh()?;
    let name = &placed.scene.name;
    let pool = pool(settings.threads)?;
    let mut out = Vec::new();
    for preset in [Preset::Fast, Preset::Best] {
        let options = settings.build(preset);
        let accelerator = pool.install(|| CpuBackend::new().build(&mesh, &options))?;
        let tree = accelerator.tree().view();
        let of = format!("preset {} on `{name}`", preset.name());
        let (aspect, cubeness, root) = cubic(&tree);
        for (what, value, root) in [
            (
                "longest over shortest side of leaves with triangles, the median",
                aspect,
                format!("; of the root {root:.2}"),
            ),
            (
                "surface of the cube of a leaf's volume over the leaf's, the mean",
                cubeness,
                String::new(),
            ),
        ] {
            out.push(Claim {
                section: "3.2",
                claim: "medians and the heuristic strive for cubic nodes",
                measured: format!("{what}, {of}{root}"),
                value,
                error: None,
                expected: Some(1.0),
                bound: false,
                unit: "ratio",
            });
        }
        let (lines, frame) = pool.install(|| {
            let lines = Lines::through(&tree.bounds, SEED);
            let lines: Vec<Ray> = (0..amounts.lines as u64)
                .filter_map(|number| lines.map(|lines| lines.line(number)))
                .collect();
            let rays =
                FrameRays::of(&placed.scene, &placed.camera, settings.size, accelerator.as_ref())?;
            Ok::<_, ReportError>((lines, up_to_hits(&rays, amounts.rays, accelerator.as_ref())?))
        })?;
        for (what, rays) in [
            ("uniform lines that pass through everything", &lines),
            ("camera and shadow rays up to what they hit", &frame),
        ] {
            let visits = pool.install(|| follow(&tree, rays));
            out.push(Claim {
                section: "2.2.2",
                claim: "a ray goes to either child with nearly equal chance",
                measured: format!(
                    "share of visits of children that go to the less visited one, {what}, {of}"
                ),
                value: visits.evenness(),
                error: None,
                expected: Some(0.5),
                bound: false,
                unit: "part",
            });
            out.push(Claim {
                section: "2.2.1",
                claim: "every comparison cuts the space to search roughly in half: a ray goes on in one of two children",
                measured: format!("children that a ray visits at an inner node, {what}, {of}"),
                value: visits.children(),
                error: None,
                expected: Some(1.0),
                bound: false,
                unit: "children",
            });
        }
    }
    Ok(out)
}

/// Of leaves with triangles: the median ratio of the longest to the shortest side, and the mean ratio of the surface of a cube
/// of a leaf's volume to its own, 1 for cubes. And that ratio of sides of the root. Flat cells are left out.
fn cubic(tree: &KdTreeView<'_>) -> (f64, f64, f64) {
    let sides = |cell: &Aabb| -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(cell.hi[axis]) - f64::from(cell.lo[axis]))
    };
    let aspect = |[x, y, z]: [f64; 3]| x.max(y).max(z) / x.min(y).min(z);
    let (mut aspects, mut cubeness) = (Vec::new(), Vec::new());
    tree.walk(|_, kind, cell, _| {
        let [x, y, z] = sides(cell);
        if matches!(kind, NodeKind::Leaf { count, .. } if count > 0) && x.min(y).min(z) > 0.0 {
            aspects.push(aspect([x, y, z]));
            let cube = 3.0 * (x * y * z).cbrt().powi(2);
            cubeness.push(cube / (x * y + y * z + z * x));
        }
    });
    let mean = cubeness.iter().sum::<f64>() / cubeness.len().max(1) as f64;
    (median(aspects), mean, aspect(sides(&tree.bounds)))
}

/// Rays of a frame, evenly drawn, that end where they hit.
fn up_to_hits(
    rays: &FrameRays,
    most: usize,
    accelerator: &dyn Accelerator,
) -> Result<Vec<Ray>, ReportError> {
    let all: Vec<Ray> = rays.camera.iter().chain(&rays.shadow).copied().collect();
    let count = most.min(all.len());
    let chosen: Vec<Ray> = (0..count).map(|i| all[i * all.len() / count]).collect();
    let mut hits = vec![Hit::MISS; chosen.len()];
    accelerator.closest_hits(&chosen, &mut hits, &QueryOptions::default())?;
    let end = |(ray, hit): (&Ray, &Hit)| ray.with_limits(ray.t_min, ray.t_max.min(hit.t));
    Ok(chosen.iter().zip(&hits).map(end).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::worked;
    use splitplane_core::config::BuildConfig;
    use splitplane_core::tree::node::KdNode;

    #[test]
    fn cubes_are_cubic() {
        let (aspect, cubeness, root) = cubic(&worked::figure_8());
        assert_eq!((aspect, cubeness, root), (0.0, 0.0, 1.0), "it has no triangles in its leaves");
        let one = [KdNode::leaf(0, 1)];
        let slab = |z: f32| KdTreeView {
            nodes: &one,
            references: &[0],
            bounds: Aabb { lo: [0.0; 3], hi: [2.0, 2.0, z] },
            triangles: 1,
            config: BuildConfig::default(),
        };
        assert_eq!(cubic(&slab(2.0)), (1.0, 1.0, 1.0));
        let (aspect, cubeness, _) = cubic(&slab(16.0));
        // Volume 64, a cube of 4 with a half surface of 48; its own is 4 + 32 + 32.
        assert!((aspect - 8.0).abs() < 1e-12 && (cubeness - 48.0 / 68.0).abs() < 1e-12);
    }
}
