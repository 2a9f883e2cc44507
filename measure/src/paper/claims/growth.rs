//! How build times and the search for a plane grow with the number of triangles.

use super::{Amounts, Claim, SEED};
use crate::paper::ReportError;
use crate::paper::fit::{Fit, fit};
use crate::paper::scene::Settings;
use crate::paper::timing::{median, pool, timed};
use splitplane::scene::Scene;
use splitplane_core::backend::BuildOptions;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::mesh::Mesh;
use splitplane_core::random::unit;
use splitplane_cpu::CpuBackend;

/// Triangles of small nodes.
const SMALL: [usize; 2] = [32, 64];

/// The exponent that times like n log n have over these sizes.
fn of_n_log_n(sizes: &[usize]) -> f64 {
    let point = |&n: &usize| {
        let n = n as f64;
        [n.ln(), (n * n.ln()).ln()]
    };
    fit(&sizes.iter().map(point).collect::<Vec<_>>()).slope
}

/// Build times and plane searches against the number of triangles.
pub(super) fn growth(settings: &Settings, amounts: &Amounts) -> Result<Vec<Claim>, ReportError> {
    let scenes: Result<Vec<Scene>, _> = amounts
        .triangles
        .iter()
        .map(|triangles| Scene::open(format!("builtin:city:{triangles}")))
        .collect();
    let scenes = scenes?;
    let sizes: Vec<usize> = scenes.iter().map(|scene| scene.indices.len()).collect();
    let over = format!("{} to {} triangles of builtin:city", sizes[0], sizes[sizes.len() - 1]);
    let exponent = |config: BuildConfig,
                    threads: usize|
     -> Result<(f64, Option<f64>, f64), ReportError> {
        let (pool, backend) = (pool(threads)?, CpuBackend::new());
        let mut points = Vec::new();
        for scene in &scenes {
            let mesh = scene.mesh()?;
            let options = settings.build_with(config);
            let mut times = Vec::new();
            for round in 0..=settings.repeat {
                let (built, ms) = pool.install(|| timed(|| backend.build_tree(&mesh, &options)));
                built?;
                if round > 0 {
                    times.push(ms);
                }
            }
            points.push([(scene.indices.len() as f64).ln(), median(times).ln()]);
        }
        let Fit { slope, error, .. } = fit(&points);
        Ok((slope, error, points.last().map_or(0.0, |point| point[1].exp())))
    };
    let mut out = Vec::new();
    // One of each builder.
    for preset in [Preset::Fast, Preset::Balanced, Preset::Best] {
        let (value, error, _) = exponent(preset.config(), settings.threads)?;
        out.push(Claim {
            section: "2.2.2, reference 12",
            claim: "a tree is built in O(n log n)",
            measured: format!(
                "exponent of the build time of preset {} in n, {}, {over}",
                preset.name(),
                match settings.threads {
                    1 => "one thread".to_owned(),
                    threads => format!("{threads} threads"),
                }
            ),
            value,
            error,
            expected: Some(of_n_log_n(&sizes)),
            bound: true,
            unit: "exponent",
        });
    }
    let split_once = |preset: Preset| exponent(BuildConfig { max_depth: 1, ..preset.config() }, 1);
    let median_ms = split_once(Preset::Fast)?.2;
    for (preset, way, expected) in [
        (Preset::Balanced, "bins, one pass", 1.0),
        (Preset::Best, "all planes, sorted before", of_n_log_n(&sizes)),
    ] {
        let (value, error, ms) = split_once(preset)?;
        out.push(Claim {
            section: "2.2.2, 3.2",
            claim: "the cost of every candidate plane takes long in large nodes, so medians split them",
            measured: format!(
                "time of a build that splits once by preset {} ({way}) over that by the median (preset fast), one thread, {} triangles",
                preset.name(),
                sizes[sizes.len() - 1]
            ),
            value: ms / median_ms,
            error: None,
            expected: None,
            bound: false,
            unit: "ratio",
        });
        out.push(Claim {
            section: "2.2.2, 3.2",
            claim: "the cost must be computed for every candidate plane",
            measured: format!(
                "exponent of the time to find the root's plane and split once by preset {} ({way}), one thread, {over}",
                preset.name()
            ),
            value,
            error,
            expected: Some(expected),
            bound: true,
            unit: "exponent",
        });
    }
    Ok(out)
}

/// A split of a small node of twice as many triangles.
pub(super) fn small_nodes(amounts: &Amounts) -> Result<Claim, ReportError> {
    let config = BuildConfig { max_depth: 1, ..BuildConfig::default() };
    let options = BuildOptions { config, ..BuildOptions::default() };
    let backend = CpuBackend::new();
    let one = pool(1)?;
    let mut times = Vec::new();
    for count in SMALL {
        let at = |triangle: usize, corner: usize, axis: usize| {
            let part = |number: usize| unit(SEED, &[triangle as u64, number as u64]);
            (part(axis) + 0.05 * part(3 + 3 * corner + axis)) as f32
        };
        let corner = |i: usize| -> [f32; 3] { std::array::from_fn(|axis| at(i / 3, i % 3, axis)) };
        let positions: Vec<[f32; 3]> = (0..3 * count).map(corner).collect();
        let triangle = |i: usize| [3 * i as u32, 3 * i as u32 + 1, 3 * i as u32 + 2];
        let indices: Vec<[u32; 3]> = (0..count).map(triangle).collect();
        let mesh = Mesh::indexed(&positions, &indices)?;
        let mut own = Vec::new();
        for _ in 0..amounts.small_builds {
            let (built, ms) = one.install(|| timed(|| backend.build_tree(&mesh, &options)));
            built?;
            own.push(ms);
        }
        times.push(median(own));
    }
    Ok(Claim {
        section: "3.2",
        claim: "the best plane of a small node is found in O(n), its triangles sorted in O(1)",
        measured: format!(
            "time of a build that splits once, {} triangles over {}, on one thread, all other work of a build included",
            SMALL[1], SMALL[0]
        ),
        value: times[1] / times[0],
        error: None,
        expected: Some(SMALL[1] as f64 / SMALL[0] as f64),
        bound: true,
        unit: "ratio",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponent_of_n_log_n() {
        let found = of_n_log_n(&[1 << 10, 1 << 11]);
        assert!((found - (1.0 + (11.0f64 / 10.0).log2())).abs() < 1e-12, "{found}");
    }
}
