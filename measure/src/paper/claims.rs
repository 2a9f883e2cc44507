//! What the survey claims in passing and prints no figures for, measured: how build times and the search for a plane grow,
//! how cubic cells are, how evenly rays and space are divided.

use super::ReportError;
use super::fit::{Fit, fit};
use super::rays::FrameRays;
use super::scene::{Placed, Settings};
use super::table::{Cell, Table};
use super::timing::{median, pool, timed};
use rayon::prelude::*;
use serde::Serialize;
use splitplane::scene::Scene;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::lines::Lines;
use splitplane_core::random::unit;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::{KdNode, NodeKind};
use splitplane_cpu::CpuBackend;

const SEED: u64 = 2012;

/// A claim and what was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// The section of the survey.
    pub section: &'static str,
    /// What it claims.
    pub claim: &'static str,
    /// What was measured.
    pub measured: String,
    /// The figure.
    pub value: f64,
    /// Its standard error, for a figure that is fitted.
    pub error: Option<f64>,
    /// The figure that the claim would give.
    pub expected: Option<f64>,
    /// Whether that is a bound from above, as with O(n), not a value.
    pub bound: bool,
    /// In what unit.
    pub unit: &'static str,
}

impl Claim {
    /// Whether it holds: within two standard errors, or without one within a tenth; where it is a bound, being less is as good.
    /// None where nothing is expected.
    pub fn holds(&self) -> Option<bool> {
        let expected = self.expected?;
        let most = self.error.map_or(0.1 * expected.abs(), |error| 2.0 * error);
        let over = self.value - expected;
        Some(over <= most && (self.bound || over >= -most))
    }
}

/// How much is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Amounts {
    /// Triangles of the scenes whose builds are timed, from few to many.
    pub triangles: Vec<usize>,
    /// Builds of small nodes, of which the median counts.
    pub small_builds: usize,
    /// Uniform lines that are followed through a tree.
    pub lines: usize,
    /// Most of a frame's rays that are.
    pub rays: usize,
}

impl Amounts {
    /// Those of a report, or of a quick one.
    pub fn of(quick: bool) -> Amounts {
        let (least, sizes, small_builds, lines, rays) =
            if quick { (2_000, 3, 41, 500, 500) } else { (16_000, 5, 1_001, 20_000, 20_000) };
        let triangles = (0..sizes).map(|size| least << size).collect();
        Amounts { triangles, small_builds, lines, rays }
    }
}

/// Triangles of small nodes.
const SMALL: [usize; 2] = [32, 64];

/// Measures the claims; cells and rays on a scene and its trees.
///
/// # Errors
/// A tree that cannot be built.
pub fn measure(
    placed: &Placed,
    settings: &Settings,
    amounts: &Amounts,
) -> Result<Vec<Claim>, ReportError> {
    let mut out = growth(settings, amounts)?;
    out.push(small_nodes(amounts)?);
    out.extend(shapes(placed, settings, amounts)?);
    Ok(out)
}

/// The claims as a table.
pub fn table(claims: &[Claim]) -> Table {
    let head =
        ["section", "claim", "measured", "found", "standard error", "as claimed", "holds", "unit"];
    let mut table = Table::new(&head);
    for claim in claims {
        table.push(vec![
            claim.section.into(),
            claim.claim.into(),
            claim.measured.as_str().into(),
            Cell::Number(claim.value, 3),
            Cell::number(claim.error, 3),
            Cell::number(claim.expected, 3),
            claim.holds().map_or(Cell::Missing, |holds| if holds { "yes" } else { "no" }.into()),
            claim.unit.into(),
        ]);
    }
    table
}

/// The exponent that times like n log n have over these sizes.
fn of_n_log_n(sizes: &[usize]) -> f64 {
    let point = |&n: &usize| {
        let n = n as f64;
        [n.ln(), (n * n.ln()).ln()]
    };
    fit(&sizes.iter().map(point).collect::<Vec<_>>()).slope
}

/// Build times and plane searches against the number of triangles.
fn growth(settings: &Settings, amounts: &Amounts) -> Result<Vec<Claim>, ReportError> {
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
    for preset in Preset::ALL {
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
fn small_nodes(amounts: &Amounts) -> Result<Claim, ReportError> {
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

/// Cells and rays of the scene's trees.
fn shapes(
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
    accelerator: &dyn splitplane_core::backend::Accelerator,
) -> Result<Vec<Ray>, ReportError> {
    let all: Vec<Ray> = rays.camera.iter().chain(&rays.shadow).copied().collect();
    let count = most.min(all.len());
    let chosen: Vec<Ray> = (0..count).map(|i| all[i * all.len() / count]).collect();
    let mut hits = vec![Hit::MISS; chosen.len()];
    accelerator.closest_hits(&chosen, &mut hits, &QueryOptions::default())?;
    let end = |(ray, hit): (&Ray, &Hit)| ray.with_limits(ray.t_min, ray.t_max.min(hit.t));
    Ok(chosen.iter().zip(&hits).map(end).collect())
}

/// How rays go through inner nodes, added up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    /// Visits of inner nodes.
    nodes: u64,
    /// Visits of their children.
    children: u64,
    /// Visits of the child of each node that is visited less.
    lesser: u64,
}

impl Counts {
    fn evenness(self) -> f64 {
        self.lesser as f64 / self.children.max(1) as f64
    }

    fn children(self) -> f64 {
        self.children as f64 / self.nodes.max(1) as f64
    }
}

/// Follows rays through all cells that they meet, by [`Aabb::ray_interval`].
fn follow(tree: &KdTreeView<'_>, rays: &[Ray]) -> Counts {
    // Visits of the left and of the right child, by node.
    let none = || vec![[0u32; 2]; tree.nodes.len()];
    let visits = rays
        .par_iter()
        .fold(none, |mut visits, ray| {
            let mut stack = vec![(0usize, tree.bounds)];
            while let Some((node, cell)) = stack.pop() {
                let Some(NodeKind::Interior { axis, split, right }) =
                    tree.nodes.get(node).map(KdNode::kind)
                else {
                    continue;
                };
                let (mut left_cell, mut right_cell) = (cell, cell);
                left_cell.hi[axis.index()] = split;
                right_cell.lo[axis.index()] = split;
                for (side, (child, cell)) in
                    [(node + 1, left_cell), (right as usize, right_cell)].into_iter().enumerate()
                {
                    if cell.ray_interval(ray).is_some() {
                        visits[node][side] += 1;
                        stack.push((child, cell));
                    }
                }
            }
            visits
        })
        .reduce(none, |mut a, b| {
            for (a, b) in a.iter_mut().zip(b) {
                *a = [a[0] + b[0], a[1] + b[1]];
            }
            a
        });
    let mut counts = Counts::default();
    // A node's visits are those that its parent counts for it; the root has every ray that meets the bounds.
    let mut own = vec![0u64; tree.nodes.len()];
    if let Some(root) = own.first_mut() {
        *root = rays.iter().filter(|ray| tree.bounds.ray_interval(ray).is_some()).count() as u64;
    }
    for (node, [left, right]) in visits.iter().enumerate() {
        let Some(NodeKind::Interior { right: child, .. }) = tree.nodes.get(node).map(KdNode::kind)
        else {
            continue;
        };
        for (child, visits) in [(node + 1, left), (child as usize, right)] {
            if let Some(own) = own.get_mut(child) {
                *own = u64::from(*visits);
            }
        }
        counts.nodes += own[node];
        counts.children += u64::from(*left) + u64::from(*right);
        counts.lesser += u64::from(*left.min(right));
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::worked;

    #[test]
    fn claims_hold_within_their_errors_and_bounds_below_too() {
        let claim = |value, error, expected, bound| Claim {
            section: "",
            claim: "",
            measured: String::new(),
            value,
            error,
            expected,
            bound,
            unit: "",
        };
        assert_eq!(claim(1.19, Some(0.1), Some(1.0), false).holds(), Some(true));
        assert_eq!(claim(1.21, Some(0.1), Some(1.0), true).holds(), Some(false));
        assert_eq!(claim(0.79, Some(0.1), Some(1.0), false).holds(), Some(false));
        assert_eq!(claim(0.79, Some(0.1), Some(1.0), true).holds(), Some(true));
        assert_eq!(claim(2.19, None, Some(2.0), false).holds(), Some(true));
        assert_eq!(claim(2.21, None, Some(2.0), false).holds(), Some(false));
        assert_eq!(claim(2.21, None, None, false).holds(), None);
    }

    #[test]
    fn the_exponent_of_n_log_n() {
        let found = of_n_log_n(&[1 << 10, 1 << 11]);
        assert!((found - (1.0 + (11.0f64 / 10.0).log2())).abs() < 1e-12, "{found}");
    }

    /// Rays through the tree of Figure 8: its root splits x at 4, the children y at 2 and at 8.
    #[test]
    fn visits_by_hand() {
        let tree = worked::figure_8();
        let along = |origin: [f32; 3], direction: [f32; 3]| Ray::new(origin, direction);
        // Through the left child's lower leaf only; through both children of the root, both of them to the upper
        // leaf on the left and the lower on the right.
        let rays =
            [along([1.0, 1.0, -1.0], [0.0, 0.0, 1.0]), along([-1.0, 5.0, 5.0], [1.0, 0.0, 0.0])];
        let counts = follow(&tree, &rays);
        // Inner visits: the root twice, its left child twice, its right child once.
        assert_eq!(counts, Counts { nodes: 5, children: 3 + 2 + 1, lesser: 1 + 1 });
        // A ray that ends before the plane does not cross it.
        let short = rays[1].with_limits(0.0, 3.0);
        assert_eq!(follow(&tree, &[short]), Counts { nodes: 2, children: 2, lesser: 0 });
        assert_eq!(follow(&tree, &[along([0.0, 20.0, 0.0], [1.0, 0.0, 0.0])]).nodes, 0);
    }

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
