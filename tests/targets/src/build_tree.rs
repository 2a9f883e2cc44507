//! Meshes of any floats under any configuration: trees that are sound, the same every time, and
//! whose answers the exact oracle accepts.

use crate::source::Source;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::{Builder, Preset, Stages};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::{Mesh, MeshError};
use splitplane_core::query::all_hits::{AllHitsOptions, Crossing};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::tree::digest::Digest;
use splitplane_core::tree::validate::validate_mesh;
use splitplane_core::triangle::prepare;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::judge::Judge;
use splitplane_test_support::oracle::{Oracle, OracleHit};

thread_local! {
    static BACKEND: CpuBackend = CpuBackend::new();
}

/// Rays of a batch: more than are under way at a time.
const BATCH: usize = 40;

/// Bytes as a mesh, a configuration and rays, for the CPU backend.
pub fn run(data: &[u8]) {
    crate::single_thread();
    BACKEND.with(|backend| on(data, backend, Some(backend)));
}

/// The same for any backend, such as one with a fault.
pub fn run_on(data: &[u8], backend: &dyn Backend) {
    on(data, backend, None);
}

/// `cpu` is the backend by its own type, if that is what it is.
fn on(data: &[u8], backend: &dyn Backend, cpu: Option<&CpuBackend>) {
    let mut source = Source::new(data);
    let options = options(&mut source);
    let soup = source.once_in(3);
    let (positions, indices) = arrays(&mut source, soup);
    let triangles: Vec<[[f32; 3]; 3]>;
    let mesh = if soup {
        triangles = positions.as_chunks::<3>().0.to_vec();
        Mesh::soup(&triangles)
    } else {
        Mesh::indexed(&positions, &indices)
    };
    match mesh {
        Ok(mesh) => build(backend, cpu, &mesh, &options, &mut source),
        Err(error) => {
            let bad = |corners: &[u32; 3]| corners.iter().any(|&c| c as usize >= positions.len());
            let first = indices.iter().position(bad).expect("an index out of range");
            let MeshError::IndexOutOfRange { triangle, vertex, vertices } = error else {
                panic!("{error}");
            };
            assert_eq!((triangle, vertices), (first, positions.len()));
            assert!(indices[first].contains(&vertex) && vertex as usize >= vertices);
            crate::check_message(&error.to_string(), &format!("triangle {triangle} "));
        }
    }
}

fn knobs(stages: &mut Stages) -> [&mut u32; 3] {
    [&mut stages.small_node_limit, &mut stages.empty_cutoff, &mut stages.nodes_per_triangle]
}

/// A preset, some of its knobs turned to any value.
pub(crate) fn options(source: &mut Source<'_>) -> BuildOptions<'static> {
    let mut config = source.pick(&Preset::ALL).config();
    // Few triangles make large nodes only where small ones are smaller still.
    let limit = source.pick(&[64, 1, 2, 3, 8]);
    if let Some(stages) = config.stages_mut() {
        stages.small_node_limit = limit;
    }
    config.block_width = source.pick(&[config.block_width, 1, 4]);
    for _ in 0..source.below(4) {
        let value = match source.below(3) {
            0 => source.count(),
            _ => source.below(70) as u32,
        };
        let mut fields = vec![
            &mut config.traversal_cost,
            &mut config.intersection_cost,
            &mut config.block_width,
            &mut config.max_depth,
            &mut config.references_per_triangle,
        ];
        match &mut config.builder {
            Builder::Median(stages) => fields.extend(knobs(stages)),
            Builder::Binned { stages, bins } => {
                fields.extend(knobs(stages));
                fields.push(bins);
            }
            Builder::Sweep(sweep) => fields.extend([&mut sweep.empty_bonus, &mut sweep.bad_splits]),
            _ => {}
        }
        let which = source.below(fields.len());
        for (i, field) in fields.into_iter().enumerate() {
            if i == which {
                *field = value;
            }
        }
    }
    config.clip = !source.once_in(4);
    let max_memory = match source.below(16) {
        13 => Some(u64::from(source.count())),
        14 => Some(source.below(40_000) as u64),
        15 => Some(source.pick(&[0, 1, u64::MAX])),
        _ => None,
    };
    BuildOptions { config, max_memory, ..BuildOptions::default() }
}

/// Positions from a small palette of numbers, so that many are equal, and indices.
pub(crate) fn arrays(source: &mut Source<'_>, soup: bool) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let palette: Vec<f32> = (0..1 + source.below(6)).map(|_| source.number()).collect();
    let of_palette = source.pick(&[2, 8, 1]);
    let scale = match source.below(8) {
        0..5 => 1.0,
        _ => (source.below(250) as f32 - 125.0).exp2(),
    };
    let count = 1 + source.below(30);
    let mut positions: Vec<[f32; 3]> = (0..count)
        .map(|_| {
            [(); 3].map(|()| match source.once_in(of_palette) {
                true if of_palette < 8 => source.pick(&palette),
                _ => source.step() * scale,
            })
        })
        .collect();
    let mut indices: Vec<[u32; 3]> =
        (0..source.below(40)).map(|_| [(); 3].map(|()| source.below(count) as u32)).collect();
    if source.once_in(16) && !indices.is_empty() {
        let at = source.below(indices.len());
        indices[at][source.below(3)] = source.count();
    }
    // Sometimes many times the same, moved a little: more than one small root, or all coincident.
    if source.once_in(12) {
        let step = [(); 3].map(|()| source.step() * scale);
        let (first, faces) = (positions.clone(), indices.clone());
        for copy in 1..1 + source.below(8) as u32 {
            let moved = |p: &[f32; 3]| [0, 1, 2].map(|k| p[k] + step[k] * copy as f32);
            positions.extend(first.iter().map(moved));
            let shift = copy.wrapping_mul(first.len() as u32);
            indices.extend(faces.iter().map(|face| face.map(|corner| corner.wrapping_add(shift))));
        }
    }
    if soup {
        positions.truncate(positions.len() / 3 * 3);
    }
    (positions, indices)
}

fn build(
    backend: &dyn Backend,
    cpu: Option<&CpuBackend>,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    source: &mut Source<'_>,
) {
    let built = backend.build(mesh, options);
    let accelerator = match (built, options.config.validate()) {
        (Ok(accelerator), Ok(())) => accelerator,
        (Err(BuildError::Config(error)), Err(expected)) => {
            assert_eq!(error, expected);
            crate::check_message(&BuildError::Config(error).to_string(), "must be");
            return;
        }
        (Err(error @ BuildError::OutOfMemory { needed, limit }), Ok(())) => {
            assert_eq!(Some(limit), options.max_memory);
            assert!(needed > limit, "{error}");
            crate::check_message(&error.to_string(), &limit.to_string());
            // Without the limit it goes on.
            let options = BuildOptions { max_memory: None, ..*options };
            backend.build(mesh, &options).map(drop).expect("no limit");
            return;
        }
        (Ok(_), Err(error)) => panic!("built, though {error}"),
        (Err(error), _) => panic!("refused: {error}"),
    };
    if let Err(violation) = validate_mesh(&accelerator.tree().view(), mesh) {
        panic!("{violation}");
    }
    let summary = accelerator.summary();
    assert!(options.max_memory.is_none_or(|limit| summary.peak_bytes <= limit));
    let kept = (0..mesh.len()).filter(|&i| prepare(&mesh.triangle(i)).kept).count();
    assert_eq!(summary.triangles as usize - summary.dropped as usize, kept);
    ask(accelerator.as_ref(), mesh, source);
    let digest = accelerator.tree().digest();
    let free = BuildOptions { max_memory: None, ..*options };
    let again = match cpu {
        Some(backend) => rebuild(backend, mesh, &free),
        None => backend.build(mesh, &free).expect("as before").tree().digest(),
    };
    assert_eq!(again, digest, "another tree the second time");
}

/// The digest of a tree built into memory that held another one.
fn rebuild(backend: &CpuBackend, mesh: &Mesh<'_>, options: &BuildOptions<'_>) -> Digest {
    let other = [[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let other = Mesh::soup(&other).expect("one triangle");
    let mut accelerator = backend.build_accelerator(&other, options).expect("one triangle");
    backend.rebuild_accelerator(&mut accelerator, mesh, options).expect("as before");
    accelerator.tree().digest()
}

/// Rays of all kinds, by batch and one by one, against the oracle.
fn ask(accelerator: &dyn Accelerator, mesh: &Mesh<'_>, source: &mut Source<'_>) {
    let oracle = Oracle::new(mesh);
    let judge = Judge::new(mesh, &oracle);
    let rays: Vec<Ray> = (0..1 + source.below(5)).map(|_| ray(source, mesh)).collect();
    let options = QueryOptions {
        accuracy: source.pick(&[Accuracy::Watertight, Accuracy::Exact, Accuracy::Fast]),
        culling: source.pick(&[Culling::None, Culling::Back, Culling::Front]),
        ignore: match source.below(4) {
            0 => Some(source.below(mesh.len() + 2) as u32),
            1 => Some(source.count()),
            _ => None,
        },
        ..QueryOptions::default()
    };
    let batch: Vec<Ray> = rays.iter().copied().cycle().take(BATCH).collect();
    let (mut hits, mut any) = (vec![Hit::MISS; BATCH], vec![false; BATCH]);
    let report = accelerator.closest_hits(&batch, &mut hits, &options).expect("lengths are equal");
    assert_eq!(report, QueryReport::default());
    let report = accelerator.any_hits(&batch, &mut any, &options).expect("lengths are equal");
    assert_eq!(report, QueryReport::default());
    for (i, ray) in batch.iter().enumerate() {
        let hit = hits[i].some();
        if i >= rays.len() {
            assert_eq!((hits[i], any[i]), (hits[i % rays.len()], any[i % rays.len()]));
            continue;
        }
        assert_eq!(accelerator.closest_hit(ray, &options), hit, "one by one: {ray:?} {options:?}");
        assert_eq!(accelerator.any_hit(ray, &options), any[i], "one by one: {ray:?} {options:?}");
        assert_eq!(any[i], hit.is_some(), "{ray:?} {options:?}");
        match options.accuracy {
            Accuracy::Watertight => {
                if let Err(wrong) = judge.closest(ray, &options, hit) {
                    panic!("{wrong}");
                }
            }
            Accuracy::Exact => is_exact(&oracle, ray, &options, hit),
            // It may miss, and its distances err more; but what it hits is there.
            _ => {
                if let Some(hit) = hit {
                    let there = (hit.triangle as usize) < mesh.len();
                    assert!(there && options.ignore != Some(hit.triangle));
                    assert!(hit.t >= ray.t_min && hit.t <= ray.t_max, "{hit:?} {ray:?}");
                }
            }
        }
    }
    let QueryOptions { culling, ignore, .. } = options;
    let crossings = AllHitsOptions { culling, ignore, ..AllHitsOptions::default() };
    let all = accelerator.all_hits(&rays, &crossings).expect("the CPU does not fail");
    assert_eq!(all.starts.len(), rays.len() + 1);
    for (i, ray) in rays.iter().enumerate() {
        are_all(&oracle, ray, &options, all.of(i));
    }
}

/// What the documents say becomes of an exact distance.
fn rounds_to(exact: f64, t: f32) -> bool {
    let rounded = (exact as f32).clamp(f32::MIN, f32::MAX);
    let snapped = if rounded.abs() < f32::MIN_POSITIVE { 0.0 } else { rounded };
    // The oracle's own distance is rounded, by less than half a unit of a float.
    [snapped, rounded.next_up(), rounded.next_down()].contains(&t)
        || (t == 0.0 && rounded.abs() <= f32::MIN_POSITIVE)
}

/// The hit is the one that real arithmetic gives.
fn is_exact(oracle: &Oracle, ray: &Ray, options: &QueryOptions<'_>, hit: Option<Hit>) {
    let expected = oracle.closest_with(ray, options);
    match (&expected, hit) {
        (OracleHit::Miss, None) => {}
        (OracleHit::Hit { t, triangles, .. }, Some(hit))
            if triangles.first() == Some(&hit.triangle) && rounds_to(*t, hit.t) => {}
        _ => panic!("{hit:?} where {expected:?} was expected\n  {ray:?}\n  {options:?}"),
    }
}

/// All crossings, in order, each of a triangle that the ray meets; those within triangles are all
/// there.
fn are_all(oracle: &Oracle, ray: &Ray, options: &QueryOptions<'_>, found: &[Crossing]) {
    let expected = oracle.crossings(ray, options);
    let within: Vec<_> = expected
        .iter()
        .filter(|c| c.compare_limit(ray.t_min).is_ge() && c.compare_limit(ray.t_max).is_le())
        .collect();
    for pair in found.windows(2) {
        assert!(pair[0].hit.t <= pair[1].hit.t, "{found:?} is not in order\n  {ray:?}");
        assert!(pair[0].hit.triangle != pair[1].hit.triangle);
    }
    for crossing in found {
        let hit = crossing.hit;
        assert!(options.ignore != Some(hit.triangle));
        let Some(exact) = oracle.t_of(ray, hit.triangle) else {
            panic!("{hit:?} is none\n  {ray:?}\n  {options:?}");
        };
        assert!(rounds_to(exact, hit.t), "{hit:?} should be at {exact}\n  {ray:?}");
    }
    for inner in within.iter().filter(|crossing| !crossing.on_edge) {
        let same = |c: &&Crossing| c.hit.triangle == inner.triangle;
        let Some(crossing) = found.iter().find(same) else {
            panic!("{} at {} is missed\n  {ray:?}\n  {options:?}", inner.triangle, inner.t);
        };
        assert_eq!(crossing.front, inner.front, "{crossing:?} {ray:?}");
    }
}

/// A ray of any floats, or one at a corner, along an edge or through the middle of a triangle.
fn ray(source: &mut Source<'_>, mesh: &Mesh<'_>) -> Ray {
    let mut ray = Ray::new([(); 3].map(|()| source.number()), [(); 3].map(|()| source.number()));
    if !mesh.is_empty() && !source.once_in(3) {
        let [a, b, c] = mesh.triangle(source.below(mesh.len()));
        let target = match source.below(4) {
            0 => a,
            1 => [0, 1, 2].map(|k| 0.5 * a[k] + 0.5 * b[k]),
            2 => [0, 1, 2].map(|k| 0.25 * a[k] + 0.5 * b[k] + 0.25 * c[k]),
            _ => {
                ray.origin = b;
                c
            }
        };
        let away = [0, 1, 2].map(|k| target[k] - ray.origin[k]);
        // What overflows is a ray as well.
        ray.direction = away;
    }
    if source.once_in(4) {
        ray.direction[source.below(3)] =
            source.pick(&[0.0, -0.0, 1e-40, -1e-39, f32::MIN_POSITIVE]);
    }
    if source.once_in(4) {
        ray = ray.with_limits(source.number(), source.number());
    }
    if source.once_in(8) {
        ray.t_max = source.pick(&[1.0, 0.5, f32::MAX, 2.0]);
    }
    ray
}
