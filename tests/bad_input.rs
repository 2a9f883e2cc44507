//! Ten thousand generated inputs, most of them bad in one way or more: meshes, configurations,
//! limits, rays and options. Nothing panics or hangs, every refusal is of the right type and says
//! what and where, and what is answered is right by the exact oracle.

use splitplane::{
    Accelerator, Accuracy, Backend, BackendKind, BuildConfig, BuildError, BuildOptions,
    ConfigError, CpuBackend, Culling, Hit, Mesh, MeshError, Preset, QueryError, QueryOptions, Ray,
};
use splitplane_core::tree::validate::validate_mesh;
use splitplane_test_support::exact::is_dropped;
use splitplane_test_support::judge::Judge;
use splitplane_test_support::oracle::{Oracle, OracleHit, ValidRay, snap};
use splitplane_test_support::random::Random;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Cases of the suite.
const CASES: u64 = 10_000;
/// A case takes about a millisecond; one that takes so long hangs.
const HANGS: Duration = Duration::from_secs(600);

const ODD: [f32; 20] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    -0.0,
    0.0,
    1e-45,
    -1e-45,
    1e-40,
    -3e-39,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    f32::MAX,
    f32::MIN,
    1e38,
    -2e38,
    1e-30,
    1e30,
    1e19,
    16_777_216.0,
    2.75e11,
];

/// How often each kind of outcome came up: a suite in which one never does proves less than it says.
type Tally = BTreeMap<&'static str, u64>;

/// Ends the process when a case does not end; names the case when it panics.
struct Watchdog {
    case: Arc<AtomicU64>,
}

impl Watchdog {
    const OVER: u64 = u64::MAX;

    fn start() -> Watchdog {
        let case = Arc::new(AtomicU64::new(0));
        let watched = Arc::clone(&case);
        std::thread::spawn(move || {
            let mut last = watched.load(Ordering::Relaxed);
            let mut since = std::time::Instant::now();
            loop {
                std::thread::sleep(Duration::from_millis(200));
                let now = watched.load(Ordering::Relaxed);
                if now == Watchdog::OVER {
                    return;
                }
                if now != last {
                    (last, since) = (now, std::time::Instant::now());
                } else if since.elapsed() > HANGS {
                    eprintln!("case {now} hangs");
                    std::process::abort();
                }
            }
        });
        Watchdog { case }
    }

    fn enter(&self, case: u64) {
        self.case.store(case, Ordering::Relaxed);
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("in case {}", self.case.load(Ordering::Relaxed));
        }
        self.case.store(Watchdog::OVER, Ordering::Relaxed);
    }
}

/// A number: mostly of a coarse grid, sometimes odd, as `odd` in 256 say.
fn number(random: &mut Random, odd: usize) -> f32 {
    if random.below(256) < odd {
        return match random.below(4) {
            0 => f32::from_bits(random.bits()),
            _ => random.pick(&ODD),
        };
    }
    match random.below(4) {
        0 => random.between(-2.0, 2.0) as f32,
        _ => (random.below(17) as f32 - 8.0) * 0.25,
    }
}

fn point(random: &mut Random, odd: usize) -> [f32; 3] {
    [(); 3].map(|()| number(random, odd))
}

/// Arrays of a mesh, some without triangles or vertices, some with indices that are out of range.
struct Arrays {
    positions: Vec<[f32; 3]>,
    indices: Option<Vec<[u32; 3]>>,
}

impl Arrays {
    fn new(random: &mut Random) -> Arrays {
        let odd = random.pick(&[0, 4, 4, 30, 256]);
        let scale = random.pick(&[1.0, 1.0, 1.0, 1e-38, 1e-30, 1e-19, 1e19, 1e30, 1e38]);
        let vertices = random.pick(&[0, 1, 3, 4, 8, 20, 20, 20]);
        let mut positions: Vec<[f32; 3]> =
            (0..vertices).map(|_| point(random, odd).map(|x| x * scale)).collect();
        if random.below(3) == 0 {
            positions.truncate(positions.len() / 3 * 3);
            return Arrays { positions, indices: None };
        }
        let triangles = random.pick(&[0, 1, 2, 10, 30, 30, 200]);
        let bound = vertices.max(1);
        let mut indices: Vec<[u32; 3]> =
            (0..triangles).map(|_| [(); 3].map(|()| random.below(bound) as u32)).collect();
        if triangles > 0 && random.below(8) == 0 {
            let (at, corner) = (random.below(triangles), random.below(3));
            indices[at][corner] =
                random.pick(&[vertices as u32, u32::MAX, 1 << 31, vertices as u32 + 1]);
        }
        if random.below(16) == 0 {
            // All the same.
            let first = indices.first().copied();
            indices.iter_mut().for_each(|face| *face = first.unwrap_or(*face));
        }
        Arrays { positions, indices: Some(indices) }
    }

    /// The mesh, or the error it must be.
    fn mesh(&self, tally: &mut Tally) -> Option<Mesh<'_>> {
        let Some(indices) = &self.indices else {
            return Some(Mesh::soup(self.positions.as_chunks::<3>().0).expect("few triangles"));
        };
        let vertices = self.positions.len();
        let corners = indices
            .iter()
            .enumerate()
            .flat_map(|(triangle, face)| face.iter().map(move |&vertex| (triangle, vertex)));
        let bad = corners.clone().find(|&(_, vertex)| vertex as usize >= vertices);
        match (Mesh::indexed(&self.positions, indices), bad) {
            (Ok(mesh), None) => Some(mesh),
            (Err(error), Some((triangle, vertex))) => {
                assert_eq!(error, MeshError::IndexOutOfRange { triangle, vertex, vertices });
                says(&error, &[&format!("triangle {triangle}"), &vertex.to_string()]);
                *tally.entry("index out of range").or_default() += 1;
                None
            }
            (found, expected) => panic!("{found:?} where {expected:?} was expected"),
        }
    }
}

/// A message names what is wrong.
fn says(error: &dyn std::error::Error, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "`{message}` does not name {part}");
    }
    assert!(message.len() < 300 && !message.contains('\n'), "{message}");
}

type Field = (&'static str, fn(&mut BuildConfig) -> Option<&mut u32>);

const FIELDS: [Field; 11] = [
    ("traversal_cost", |c| Some(&mut c.traversal_cost)),
    ("intersection_cost", |c| Some(&mut c.intersection_cost)),
    ("block_width", |c| Some(&mut c.block_width)),
    ("max_depth", |c| Some(&mut c.max_depth)),
    ("references_per_triangle", |c| Some(&mut c.references_per_triangle)),
    ("small_node_limit", |c| Some(&mut c.stages_mut()?.small_node_limit)),
    ("empty_cutoff", |c| Some(&mut c.stages_mut()?.empty_cutoff)),
    ("nodes_per_triangle", |c| Some(&mut c.stages_mut()?.nodes_per_triangle)),
    ("bins", BuildConfig::bins_mut),
    ("empty_bonus", |c| Some(&mut c.sweep_mut()?.empty_bonus)),
    ("bad_splits", |c| Some(&mut c.sweep_mut()?.bad_splits)),
];

fn options(random: &mut Random) -> BuildOptions<'static> {
    let mut config = random.pick(&Preset::ALL).config();
    if random.below(2) == 0 {
        let limit = 1 + random.below(8) as u32;
        if let Some(stages) = config.stages_mut() {
            stages.small_node_limit = limit;
        }
        config.block_width = 1 + random.below(4) as u32;
    }
    config.clip = random.below(4) > 0;
    if random.below(3) == 0 {
        let (_, field) = random.pick(&FIELDS);
        let value = random.bits();
        let near = random.below(70) as u32;
        let values = [0, 1, 65, 97, 256, 1368, u32::MAX, value, near, near];
        if let Some(field) = field(&mut config) {
            *field = random.pick(&values);
        }
    }
    if random.below(64) == 0 {
        // Each in its range, together too much for 32 bits.
        (config.intersection_cost, config.block_width) = (100 + random.below(600) as u32, 1);
        if let Some(stages) = config.stages_mut() {
            stages.small_node_limit = 64;
        }
    }
    let small = random.below(60_000) as u64;
    let limits = [None, None, None, None, Some(0), Some(1), Some(small), Some(u64::MAX)];
    BuildOptions { config, max_memory: random.pick(&limits), ..BuildOptions::default() }
}

/// Builds, or checks why not.
fn build(
    backend: &dyn Backend,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    tally: &mut Tally,
) -> Option<Box<dyn Accelerator>> {
    let mut count = |what| *tally.entry(what).or_default() += 1;
    let accelerator = match (backend.build(mesh, options), options.config.validate()) {
        (Ok(accelerator), Ok(())) => accelerator,
        (Err(BuildError::Config(error)), Err(expected)) => {
            assert_eq!(error, expected);
            match error {
                ConfigError::OutOfRange { field, value, least, most } => {
                    let (_, get) = FIELDS.iter().find(|(name, _)| *name == field).expect(field);
                    assert_eq!(get(&mut options.config.clone()).copied(), Some(value));
                    assert!(value < least || value > most);
                    let words = [field, &value.to_string(), &least.to_string(), &most.to_string()];
                    says(&BuildError::Config(error), &words);
                    count("configuration out of range");
                }
                ConfigError::CostTooLarge { sum, most } => {
                    assert!(sum > u64::from(most));
                    let words = ["traversal_cost", "intersection_cost", &sum.to_string()];
                    says(&BuildError::Config(error), &words);
                    count("cost too large");
                }
                other => panic!("{other}"),
            }
            return None;
        }
        (Err(error @ BuildError::OutOfMemory { needed, limit }), Ok(())) => {
            assert!(Some(limit) == options.max_memory && needed > limit);
            says(&error, &[&needed.to_string(), &limit.to_string()]);
            count("out of memory");
            return None;
        }
        (Ok(_), Err(error)) => panic!("built, though {error}"),
        (Err(error), expected) => panic!("refused: {error}; expected {expected:?}"),
    };
    let summary = *accelerator.summary();
    let corners = |i: usize| mesh.triangle(i).map(|corner| corner.map(snap));
    let dropped = (0..mesh.len()).filter(|&i| is_dropped(&corners(i))).count();
    assert_eq!((summary.triangles as usize, summary.dropped as usize), (mesh.len(), dropped));
    assert!(options.max_memory.is_none_or(|limit| summary.peak_bytes <= limit));
    let valid = validate_mesh(&accelerator.tree().view(), mesh);
    assert_eq!(valid, Ok(()));
    count("built");
    if dropped > 0 {
        count("built without some triangles");
    }
    Some(accelerator)
}

fn ray(random: &mut Random, mesh: &Mesh<'_>) -> Ray {
    let odd = random.pick(&[0, 0, 8, 64, 256]);
    let mut ray = Ray::new(point(random, odd), point(random, odd));
    if !mesh.is_empty() && random.below(2) == 0 {
        let corners = mesh.triangle(random.below(mesh.len()));
        let weights = random.pick(&[[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.25, 0.5, 0.25]]);
        let scale = corners[0].iter().fold(1e-30f32, |m, x| m.max(x.abs())).min(1e38);
        ray.origin = ray.origin.map(|x| x * scale);
        ray.direction = [0, 1, 2]
            .map(|k| (0..3).map(|i| weights[i] * corners[i][k]).sum::<f32>() - ray.origin[k]);
    }
    if random.below(4) == 0 {
        let axis = random.below(3);
        ray.direction[axis] = random.pick(&[0.0, -0.0, 1e-40, -1e-45, f32::MIN_POSITIVE, 1e30]);
    }
    match random.below(6) {
        0 => ray.with_limits(number(random, 64), number(random, 64)),
        1 => ray.with_limits(random.pick(&ODD), random.pick(&ODD)),
        _ => ray,
    }
}

/// Rays in a batch, one by one and with space for more or fewer answers.
fn ask(accelerator: &dyn Accelerator, mesh: &Mesh<'_>, random: &mut Random, tally: &mut Tally) {
    let mut count = |what| *tally.entry(what).or_default() += 1;
    let rays: Vec<Ray> = (0..random.pick(&[0, 1, 3, 3])).map(|_| ray(random, mesh)).collect();
    // Rays are prepared 16 at a time, so 34 are two full groups and a short one.
    let batch: Vec<Ray> =
        if rays.is_empty() { Vec::new() } else { rays.iter().copied().cycle().take(34).collect() };
    let any_index = random.bits();
    let near = random.below(mesh.len() + 2) as u32;
    let options = QueryOptions {
        accuracy: random.pick(&[Accuracy::Watertight, Accuracy::Exact, Accuracy::Fast]),
        culling: random.pick(&[Culling::None, Culling::Back, Culling::Front]),
        ignore: random.pick(&[None, None, Some(near), Some(u32::MAX), Some(any_index)]),
        ..QueryOptions::default()
    };
    let (mut hits, mut any) = (vec![Hit::MISS; batch.len()], vec![false; batch.len()]);
    let results = random.below(3 * batch.len() + 2);
    if results != batch.len() {
        let expected = QueryError::LengthMismatch { rays: batch.len(), results };
        let room = &mut vec![Hit::MISS; results];
        let error = accelerator.closest_hits(&batch, room, &options).expect_err("lengths differ");
        assert_eq!(error, expected);
        assert!(room.iter().all(|hit| !hit.is_hit()), "answers in spite of an error");
        let room = &mut vec![false; results];
        assert_eq!(accelerator.any_hits(&batch, room, &options).expect_err("as well"), expected);
        says(&error, &[&format!("{} rays", batch.len()), &format!("{results} results")]);
        count("lengths differ");
    }
    accelerator.closest_hits(&batch, &mut hits, &options).expect("equal lengths");
    accelerator.any_hits(&batch, &mut any, &options).expect("equal lengths");
    let oracle = Oracle::new(mesh);
    let judge = Judge::new(mesh, &oracle);
    for (i, ray) in rays.iter().enumerate() {
        let hit = hits[i].some();
        assert_eq!(accelerator.closest_hit(ray, &options), hit, "{ray:?} {options:?}");
        assert_eq!(accelerator.any_hit(ray, &options), hit.is_some(), "{ray:?} {options:?}");
        assert_eq!(any[i], hit.is_some(), "{ray:?} {options:?}");
        if ValidRay::new(ray).is_none() {
            assert_eq!(hit, None);
            count("ray that can hit nothing");
        }
        if hit.is_some() {
            count("hit");
        }
        match options.accuracy {
            Accuracy::Watertight => {
                if let Err(wrong) = judge.closest(ray, &options, hit) {
                    panic!("{wrong}");
                }
            }
            Accuracy::Exact => {
                let triangle = match oracle.closest_with(ray, &options) {
                    OracleHit::Miss => None,
                    OracleHit::Hit { triangles, .. } => triangles.first().copied(),
                };
                assert_eq!(hit.map(|hit| hit.triangle), triangle, "{ray:?} {options:?}");
            }
            // It may lose rays.
            _ => {}
        }
    }
}

#[test]
fn ten_thousand_bad_inputs() {
    let backend = BackendKind::Cpu.open().expect("the CPU is there").backend;
    let watchdog = Watchdog::start();
    let mut tally = Tally::new();
    for case in 0..CASES {
        watchdog.enter(case);
        let mut random = Random::new(case);
        let options = options(&mut random);
        let arrays = Arrays::new(&mut random);
        let Some(mesh) = arrays.mesh(&mut tally) else { continue };
        let Some(accelerator) = build(backend.as_ref(), &mesh, &options, &mut tally) else {
            continue;
        };
        ask(accelerator.as_ref(), &mesh, &mut random, &mut tally);
    }
    eprintln!("{tally:?}");
    for (what, least) in [
        ("index out of range", 500),
        ("configuration out of range", 500),
        ("cost too large", 10),
        ("out of memory", 500),
        ("lengths differ", 2000),
        ("built", 4000),
        ("built without some triangles", 1500),
        ("ray that can hit nothing", 500),
        ("hit", 500),
    ] {
        assert!(tally.get(what).is_some_and(|count| *count >= least), "{what}: {tally:?}");
    }
}

/// A limit of exactly what a build takes is enough, one byte less is not, and neither changes trees.
#[test]
fn the_limit_of_memory_is_exact() {
    for case in 0..200 {
        let mut random = Random::new(case);
        let positions: Vec<[f32; 3]> = (0..60).map(|_| point(&mut random, 2)).collect();
        let mesh = Mesh::soup(positions.as_chunks::<3>().0).expect("a few triangles");
        let mut config = random.pick(&Preset::ALL).config();
        if let Some(stages) = config.stages_mut() {
            stages.small_node_limit = random.pick(&[4, 64]);
        }
        let build = |max_memory| {
            // A new backend each time: kept memory counts.
            CpuBackend::new()
                .build(&mesh, &BuildOptions { config, max_memory, ..BuildOptions::default() })
        };
        let free = build(None).expect("no limit");
        let peak = free.summary().peak_bytes;
        let enough = build(Some(peak)).expect("just enough");
        assert_eq!(enough.tree().digest(), free.tree().digest());
        let error = build(Some(peak - 1)).err().expect("one byte short");
        assert_eq!(error, BuildError::OutOfMemory { needed: peak, limit: peak - 1 }, "case {case}");
    }
}

/// More triangles than a tree can hold, in memory that is never touched.
#[test]
fn too_many_triangles_are_refused() {
    let triangles = splitplane_core::mesh::MAX_TRIANGLES + 1;
    let indices = vec![[0u32; 3]; triangles];
    let error = Mesh::indexed(&[[0.0; 3]], &indices).expect_err("too many");
    assert_eq!(error, MeshError::TooManyTriangles { triangles });
    says(&error, &[&triangles.to_string()]);
}
