//! Inputs that are kept, and some of chance, through the functions that fuzzers call.
//!
//! `tests/corpus/TARGET` holds, for each target, inputs that a fuzzer once broke something with and
//! some that reach far; their names say which. Whatever is added there is run.

use crate::common::{is_caught, make_pool};
use splitplane::scene::obj::{ObjError, parse};
use splitplane_core::backend::scene::{
    BuildGeometry, BuiltScene, SceneAccelerator, SceneClosestPoint, SceneClosestPointOptions,
    SceneOverlapOptions, SceneOverlaps, UpdateReport,
};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::cast::{Cast, CastOptions, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Volume};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::report::{BuildSummary, QueryReport};
use splitplane_core::scene::{Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport};
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_fuzz_targets::{
    ALL, Target, build_tree, gltf, nearness, obj, ply, scene_operations, stl,
};
use splitplane_test_support::faulty::{Fault, FaultyBackend};
use splitplane_test_support::random::Random;
use std::collections::BTreeSet;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Inputs of chance for each target.
const RANDOM: u64 = 1500;

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus")
}

/// Up to 600 bytes of chance.
fn chance(seed: u64) -> Vec<u8> {
    let mut random = Random::new(seed);
    (0..random.below(600)).map(|_| random.bits() as u8).collect()
}

/// Runs a target and names the input it fails on.
fn run(name: &str, target: Target, input: &str, bytes: &[u8]) {
    run_any(name, target, input, bytes);
}

/// The same, of any function.
fn run_any(name: &str, target: impl Fn(&[u8]), input: &str, bytes: &[u8]) {
    make_pool();
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| target(bytes))) {
        eprintln!("target {name} fails on {input}: {bytes:?}");
        std::panic::resume_unwind(panic);
    }
}

#[test]
fn kept_inputs_do_no_harm() {
    for (name, target) in ALL {
        let folder = corpus().join(name);
        let mut files: Vec<PathBuf> = fs::read_dir(&folder)
            .unwrap_or_else(|error| panic!("no corpus of {name}: {error}"))
            .map(|entry| entry.expect("a readable folder").path())
            .collect();
        files.sort();
        assert!(!files.is_empty(), "the corpus of {name} is empty");
        for file in files {
            let bytes = fs::read(&file).expect("a readable file");
            run(name, target, &file.display().to_string(), &bytes);
        }
    }
}

/// Bytes of chance get into every corner of a grammar, if not of a program.
#[test]
fn bytes_of_chance_do_no_harm() {
    for (name, target) in ALL {
        for seed in 0..RANDOM {
            run(name, target, &format!("seed {seed}"), &chance(seed));
        }
    }
}

/// No target without a program, no program without a target, no folder of another name.
#[test]
fn targets_programs_and_folders_have_the_same_names() {
    let names = |folder: PathBuf| -> BTreeSet<String> {
        fs::read_dir(folder)
            .expect("a readable folder")
            .filter_map(|entry| Some(entry.ok()?.path().file_stem()?.to_str()?.to_owned()))
            .collect()
    };
    let targets: BTreeSet<String> = ALL.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(targets, names(corpus()));
    assert_eq!(targets, names(corpus().join("../../fuzz/fuzz_targets")));
    let manifest = fs::read_to_string(corpus().join("../../fuzz/Cargo.toml")).expect("a manifest");
    for name in &targets {
        assert!(manifest.contains(&format!("path = \"fuzz_targets/{name}.rs\"")), "{name}");
    }
}

/// A target that fails is seen to fail.
#[test]
#[should_panic(expected = "a planted fault")]
fn a_failing_target_fails() {
    run("planted", |bytes| assert!(bytes.is_empty(), "a planted fault"), "one byte", &[0]);
}

/// Whether a target fails on one of many inputs of chance.
fn is_found(inputs: u64, target: impl Fn(&[u8])) -> bool {
    make_pool();
    (0..inputs).any(|seed| {
        let bytes = chance(seed);
        is_caught(|| target(&bytes))
    })
}

/// Backends with a fault are found out, one without is not.
#[test]
fn faulty_backends_are_found() {
    let cpu = CpuBackend::new();
    assert!(!is_found(3000, |bytes| build_tree::run_on(bytes, &cpu)));
    for fault in [
        Fault::Leak,
        Fault::HigherIndexWins,
        Fault::OpenInterval,
        Fault::NoCulling,
        Fault::NoIgnore,
        Fault::WrongDistance,
        Fault::SecondHit,
        Fault::ForgetsLast,
        Fault::WrongWeights,
        Fault::Unstable,
        Fault::LosesReference,
        Fault::CountsNothing,
        Fault::Phantom,
    ] {
        let faulty = FaultyBackend::new(CpuBackend::new(), fault);
        assert!(is_found(20_000, |bytes| build_tree::run_on(bytes, &faulty)), "{fault:?}");
    }
}

/// Takes the last entry off lists that stand one after the other.
fn lose_last<T>(entries: &mut Vec<T>, starts: &mut [usize]) {
    entries.pop();
    for start in starts {
        *start = entries.len().min(*start);
    }
}

/// A scene with a fault.
struct FaultyScene(Box<dyn SceneAccelerator>, SceneFault);

#[derive(Clone, Copy, Debug, PartialEq)]
enum SceneFault {
    /// No update does anything after the first few instances.
    Stale,
    /// Ignores masks.
    Unmasked,
    /// Names the wrong instance where there are several.
    Misnamed,
    /// What touches the last triangle in a list does not meet it.
    Lossy,
}

impl SceneAccelerator for FaultyScene {
    fn scene(&self) -> &BuiltScene {
        self.0.scene()
    }

    fn update_by(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        if self.1 == SceneFault::Stale && scene.len() > 3 {
            return Ok(UpdateReport::default());
        }
        self.0.update_by(scene, options, build)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        let mask = if self.1 == SceneFault::Unmasked { u32::MAX } else { options.mask };
        let report = self.0.closest_hits(rays, hits, &SceneOptions { mask, ..*options });
        for hit in hits.iter_mut().filter(|hit| hit.is_hit()) {
            hit.instance ^= u32::from(self.1 == SceneFault::Misnamed);
        }
        report
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.0.any_hits(rays, occluded, options)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let mask = if self.1 == SceneFault::Unmasked { u32::MAX } else { options.mask };
        let report =
            self.0.closest_points(points, closest, &SceneClosestPointOptions { mask, ..*options });
        for found in closest.iter_mut().filter(|found| found.is_some()) {
            found.instance ^= u32::from(self.1 == SceneFault::Misnamed);
        }
        report
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        let mut found = self.0.overlaps(volumes, options)?;
        if self.1 == SceneFault::Lossy {
            lose_last(&mut found.triangles, &mut found.starts);
        }
        Ok(found)
    }
}

/// Scenes with a fault are found out by edits of chance.
#[test]
fn faulty_scenes_are_found() {
    let backend = CpuBackend::new();
    for fault in [SceneFault::Stale, SceneFault::Unmasked, SceneFault::Misnamed] {
        let faulty = |scene| -> Box<dyn SceneAccelerator> { Box::new(FaultyScene(scene, fault)) };
        let run = |bytes: &[u8]| {
            scene_operations::run_on(bytes, &backend, faulty);
        };
        assert!(is_found(4000, run), "{fault:?}");
    }
}

/// A tree with a fault in what it finds near.
struct FaultyNearness(Box<dyn Accelerator>, NearFault);

#[derive(Clone, Copy, Debug, PartialEq)]
enum NearFault {
    /// Does not see triangle 0 where it is the closest one.
    PassesOver,
    /// Distances err by a part in 2^20 of them.
    Inexact,
    /// What touches the last triangle in a list does not meet it.
    Loses,
    /// Impacts are a float late.
    Late,
    /// Looks no farther than the first triangle that a cast meets.
    MeetsAny,
}

impl Accelerator for FaultyNearness {
    fn tree(&self) -> &KdTree {
        self.0.tree()
    }

    fn summary(&self) -> &BuildSummary {
        self.0.summary()
    }

    fn query_bytes(&self) -> u64 {
        self.0.query_bytes()
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.0.closest_hit(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.0.any_hit(ray, options)
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.0.all_hits(rays, options)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let blind = self.1 == NearFault::PassesOver && options.ignore.is_none();
        let ignore = if blind { Some(0) } else { options.ignore };
        let options = ClosestPointOptions { ignore, ..*options };
        let report = self.0.closest_points(points, closest, &options);
        for found in closest.iter_mut().filter(|_| self.1 == NearFault::Inexact) {
            found.distance_squared *= 1.0 + 2f64.powi(-19);
        }
        report
    }

    fn impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let report = self.0.impacts(casts, impacts, options);
        for (cast, found) in casts.iter().zip(impacts).filter(|(_, found)| found.is_some()) {
            match self.1 {
                NearFault::Late => found.t = found.t.next_up(),
                NearFault::MeetsAny => {
                    let options = CastOptions { ignore: Some(found.triangle), ..*options };
                    let mut behind = [Impact::NONE];
                    self.0.impacts(&[*cast], &mut behind, &options)?;
                    if behind[0].is_some() {
                        *found = behind[0];
                    }
                }
                _ => {}
            }
        }
        report
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        let mut found = self.0.overlaps(volumes, options)?;
        if self.1 == NearFault::Loses {
            lose_last(&mut found.triangles, &mut found.starts);
        }
        Ok(found)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.overlaps_any(volumes, found, options)
    }
}

/// Trees with a fault in what they find near are found out.
#[test]
fn faulty_nearness_is_found() {
    assert!(!is_found(500, |bytes| nearness::run_on(bytes, |tree| tree, |scene| scene)));
    for fault in [
        NearFault::PassesOver,
        NearFault::Inexact,
        NearFault::Loses,
        NearFault::Late,
        NearFault::MeetsAny,
    ] {
        let faulty = |tree| -> Box<dyn Accelerator> { Box::new(FaultyNearness(tree, fault)) };
        assert!(is_found(2000, |b| nearness::run_on(b, faulty, |scene| scene)), "{fault:?}");
    }
    for fault in [SceneFault::Unmasked, SceneFault::Misnamed, SceneFault::Lossy] {
        let faulty = |scene| -> Box<dyn SceneAccelerator> { Box::new(FaultyScene(scene, fault)) };
        assert!(is_found(2000, |b| nearness::run_on(b, |tree| tree, faulty)), "{fault:?}");
    }
}

/// Readers with a fault are found out.
#[test]
fn faulty_readers_are_found() {
    let faults: [obj::Reader; 5] = [
        // One triangle less, another order of corners, another line, no line, another vertex.
        |text, name| {
            let mut scene = parse(text, name)?;
            scene.indices.pop();
            scene.material_of.pop();
            Ok(scene)
        },
        |text, name| {
            let mut scene = parse(text, name)?;
            scene.indices.iter_mut().for_each(|face| face.rotate_left(1));
            Ok(scene)
        },
        |text, name| {
            parse(text, name).map_err(|error| ObjError { line: error.line.map(|l| l + 1), ..error })
        },
        |text, name| parse(text, name).map_err(|error| ObjError { line: None, ..error }),
        |text, name| {
            let mut scene = parse(text, name)?;
            scene.positions[0][1] += 1.0;
            Ok(scene)
        },
    ];
    // One triangle less, and another order of corners.
    assert!(is_found(3000, |bytes| ply::run_on(bytes, |bytes, path| {
        let mut scene = splitplane::scene::ply::parse(bytes, path)?;
        scene.indices.pop();
        scene.material_of.pop();
        Ok(scene)
    })));
    assert!(is_found(3000, |bytes| stl::run_on(bytes, |bytes, path| {
        let mut scene = splitplane::scene::stl::parse(bytes, path)?;
        scene.indices.iter_mut().for_each(|face| face.rotate_left(1));
        Ok(scene)
    })));
    // A vertex elsewhere.
    assert!(is_found(3000, |bytes| gltf::run_on(bytes, |bytes, path, options| {
        let mut scene = splitplane::scene::gltf::parse(bytes, path, options)?;
        scene.parts.positions[0][1] = 0.125;
        Ok(scene)
    })));
    assert!(!is_found(3000, |bytes| obj::run_on(bytes, parse)));
    for (i, fault) in faults.into_iter().enumerate() {
        assert!(is_found(3000, |bytes| obj::run_on(bytes, fault)), "fault {i}");
    }
}
