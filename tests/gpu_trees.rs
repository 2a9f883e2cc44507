//! Trees that the device builds are the CPU's, byte for byte, in one submission and one readback.
//!
//! `SPLITPLANE_LONG=1` builds the largest scenes by every preset, and repeats more of the builds.

use std::path::Path;
use std::time::Duration;

use crate::common::long;
use crate::device;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::build::middle::hand_over_limit;
use splitplane_core::config::Preset;
use splitplane_core::kernel::Kernel;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BuildSummary;
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;
use splitplane_wgpu::{DeviceBuild, Effort, Gpu, WgpuBackend};

/// A backend with patience: a device in software takes a minute for the largest scenes when the
/// machine is busy.
fn backend() -> WgpuBackend {
    let gpu = Gpu::clone(&device::gpu()).with_timeout(Duration::from_secs(900));
    WgpuBackend::new(gpu).expect("a backend")
}

fn open(name: &str) -> (String, splitplane_scene::Scene) {
    let spec = format!("builtin:{name}");
    let scene = splitplane_scene::Scene::open(&spec).expect("a built-in scene");
    (spec, scene)
}

/// What does not depend on who builds.
fn facts(summary: &BuildSummary) -> [u32; 5] {
    let BuildSummary { triangles, dropped, snapped, large_levels, small_roots, .. } = *summary;
    [triangles, dropped, snapped, large_levels, small_roots]
}

/// Holds a tree that stayed on the device against the CPU's.
fn check_tree(
    backend: &WgpuBackend,
    built: &DeviceBuild,
    expected: &(KdTree, BuildSummary),
    name: &str,
) {
    let tree = built.tree.read(backend.gpu()).expect("a tree in host memory");
    assert_eq!(tree.digest(), expected.0.digest(), "{name}");
    assert!(tree == expected.0, "{name}: one digest, two trees");
    assert_eq!(facts(&built.summary), facts(&expected.1), "{name}");
}

/// One submission, one readback, nothing repeated. Returns the dispatches.
fn dispatches(effort: Effort, name: &str) -> u32 {
    let Effort { submissions, readbacks, dispatches, repeats, .. } = effort;
    assert_eq!((submissions, readbacks, repeats), (1, 1, 0), "{name}");
    dispatches
}

/// Scenes of more triangles are built once.
fn large() -> usize {
    if long() { 70_000 } else { 40_000 }
}

/// Scenes of more triangles are built by the first preset alone.
const LARGER: usize = 150_000;

/// A scene that fits its capacities: on a fresh backend, again with pooled buffers, and as users of
/// the traits build it.
fn check(mesh: &Mesh<'_>, name: &str) {
    for preset in presets(mesh) {
        check_preset(mesh, preset, &format!("{name}, {}", preset.name()));
    }
}

/// The presets that devices build.
const PRESETS: [Preset; 2] = [Preset::Fast, Preset::Balanced];

/// Those that a mesh is built by here.
fn presets(mesh: &Mesh<'_>) -> impl Iterator<Item = Preset> {
    PRESETS.into_iter().take(if mesh.len() > LARGER && !long() { 1 } else { PRESETS.len() })
}

fn check_preset(mesh: &Mesh<'_>, preset: Preset, name: &str) {
    let options = BuildOptions::from(preset.config());
    let expected = CpuBackend::new().build_tree(mesh, &options).expect("a tree");
    let backend = backend();

    let first = backend.build_on_device(mesh, &options).expect("a tree");
    check_tree(&backend, &first, &expected, name);
    let all = dispatches(first.effort, name);
    backend.recycle(first.tree);

    if mesh.len() <= large() {
        check_rebuild(&backend, mesh, all, &expected, name);
        check_trait(&backend, mesh, &expected, name);
    }
}

/// With buffers of an earlier build of as many triangles: the same tree, and levels that the first
/// build recorded in vain are left out. `all` is how many dispatches that one took.
fn check_rebuild(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    all: u32,
    expected: &(KdTree, BuildSummary),
    name: &str,
) {
    let config = expected.0.config;
    let again = backend.build_on_device(mesh, &config.into()).expect("a tree");
    check_tree(backend, &again, expected, name);
    let few = dispatches(again.effort, name);
    // A root that is small, or that the middle stage takes, takes one level and no more.
    let staged = has_middle_stage(config.preset());
    let limit = if staged { hand_over_limit(&config) } else { config.small_node_limit() };
    let one_level = mesh.len() <= limit as usize;
    let recorded = if one_level { 1 } else { config.max_depth + 1 };
    // No level is to spare.
    let levels = if one_level { 1 } else { recorded.min(expected.1.large_levels) };
    let spared = recorded - levels;
    assert!(spared > 0 || one_level, "{name}: too deep for this test");
    let a_level = level_dispatches(config.preset());
    let counted = format!("{name}: {all} and {few} dispatches");
    assert!((all - few).is_multiple_of(a_level), "{counted}");
    // The last levels of the summary are those of the middle stage, where there is one.
    let more = (all - few) / a_level - spared;
    assert!(more == 0 || staged && more < levels, "{counted}");
    // Before and after the levels: three and eleven kernels, what finishes the work of three of these, slices of small roots, and
    // the limits of the triangles.
    assert!(all - a_level * recorded <= 18, "{name}: {all}");
}

/// Whether builds of a preset have a middle stage, unless memory is short.
fn has_middle_stage(preset: Preset) -> bool {
    preset != Preset::Balanced
}

/// Dispatches of a level of the large-node stage.
fn level_dispatches(preset: Preset) -> u32 {
    // Its kernels, and without the middle stage the retry of `allocate_children`.
    if preset == Preset::Balanced { 7 } else { 4 }
}

fn check_trait(
    backend: &dyn Backend,
    mesh: &Mesh<'_>,
    expected: &(KdTree, BuildSummary),
    name: &str,
) {
    let built = backend.build(mesh, &expected.0.config.into()).expect("a tree");
    assert_eq!(built.tree().digest(), expected.0.digest(), "{name}: through the trait");
    assert!(*built.tree() == expected.0, "{name}: through the trait: one digest, two trees");
    assert_eq!(facts(built.summary()), facts(&expected.1), "{name}: through the trait");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn built_in_scenes() {
    for name in ["cornell", "spheres", "stadium", "city:1000", "city"] {
        let (name, scene) = open(name);
        check(&scene.mesh().expect("a mesh"), &name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
#[cfg_attr(no_scenes, ignore = "no scenes folder; set SPLITPLANE_SCENES")]
fn real_scenes() {
    let names = ["horse", "bunny", "robots", "stadium", "kitchen", "sponza", "dragon"];
    let mut checked = 0;
    for name in names {
        if let Some(scene) = scenes::real(name) {
            check(&scene.mesh(), name);
            checked += 1;
        }
    }
    assert!(checked > 0, "the scenes folder holds none of {names:?}");
}

/// A million triangles, within WebGPU's default limits.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_million_triangles() {
    let limits = wgpu::Limits::default();
    assert!(
        device::gpu().limits().max_storage_buffer_binding_size
            <= limits.max_storage_buffer_binding_size
    );
    let (name, scene) = open("city:1000000");
    let mesh = scene.mesh().expect("a mesh");
    for preset in presets(&mesh) {
        let options = BuildOptions::from(preset.config());
        let expected = CpuBackend::new().build_tree(&mesh, &options).expect("a tree");
        let fresh = backend();
        let built = fresh.build_on_device(&mesh, &options).expect("a tree");
        check_tree(&fresh, &built, &expected, &name);
        dispatches(built.effort, &name);
    }
}

/// Through the trait; in long runs first with buffers of its own and then with those of the first build.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
#[cfg_attr(no_scenes, ignore = "no scenes folder; set SPLITPLANE_SCENES")]
fn a_large_real_scene() {
    let scene = scenes::real("bathroom").expect("bathroom.obj in the scenes folder");
    let options = BuildOptions::default();
    let expected = CpuBackend::new().build_tree(&scene.mesh(), &options).expect("a tree");
    let backend = backend();
    for _ in 0..if long() { 2 } else { 1 } {
        check_trait(&backend, &scene.mesh(), &expected, "bathroom");
    }
}

/// The digest in a snapshot of the CPU's trees: in a file of its own, or in a line of the file of those
/// by `balanced`.
fn pinned(name: &str, preset: Preset) -> Option<String> {
    let name = name.replace(',', "").replace(' ', "-");
    let (file, start) = match preset {
        Preset::Balanced => (preset.name(), format!("{name} digest ")),
        _ => (&*name, "digest ".to_owned()),
    };
    let path = format!("tests/snapshots/suite__trees__{file}.snap");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let text = std::fs::read_to_string(path).ok()?;
    let rest = text.lines().find_map(|line| line.strip_prefix(&*start));
    let digest = rest.and_then(|rest| rest.split_whitespace().next());
    Some(digest.expect("a snapshot of a tree").to_owned())
}

/// The device builds the trees that the snapshots of the CPU pin, one scene at a time with the
/// buffers of the one before; also where the estimated capacity is too low.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn awkward_scenes_have_the_pinned_digests() {
    for preset in PRESETS {
        check_pinned(preset);
    }
}

fn check_pinned(preset: Preset) {
    let options = BuildOptions::from(preset.config());
    let backend = backend();
    let (mut seen, mut repeated) = (0, 0);
    let (mut triangles, mut levels) = (0, 0);
    for scene in scenes::awkward() {
        let Some(pinned) = pinned(&scene.name, preset) else { continue };
        let built = backend.build_on_device(&scene.mesh(), &options);
        let built = built.unwrap_or_else(|error| panic!("{}: {error}", scene.name));
        let tree = built.tree.read(backend.gpu()).expect("a tree in host memory");
        assert_eq!(tree.digest().to_string(), pinned, "{}", scene.name);
        let Effort { submissions, readbacks, repeats, .. } = built.effort;
        assert_eq!(submissions, readbacks, "{}", scene.name);
        // As many levels as the scene before took, if that had as many triangles: when these do not suffice there is a second submission, unless a capacity is exceeded
        // sooner.
        let summary = built.summary;
        // How many of the summary's levels the middle stage takes differs from scene to scene.
        let deeper = summary.triangles == triangles
            && (has_middle_stage(preset) || summary.large_levels > levels);
        let more = submissions - repeats - 1;
        assert!(more <= u32::from(deeper), "{}: {:?}", scene.name, built.effort);
        (triangles, levels) = (summary.triangles, summary.large_levels);
        seen += 1;
        repeated += u32::from(repeats > 0);
    }
    assert!(seen >= 30, "only {seen} snapshots were found");
    assert!(repeated > 0, "no scene outgrew its estimate");
}

/// The comparison sees a tree that differs in one leaf.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
#[should_panic(expected = "left == right")]
fn a_planted_fault_is_seen() {
    let scene = scenes::soup(500, 0.1, 3);
    let kernel = Kernel::EmitSmall;
    let source = splitplane_shaders::KERNELS[kernel as usize].source();
    let place = "put_half(mask.y, first + countOneBits(mask.x), true)";
    let planted = source.replace(place, "put_half(mask.y, first, true)");
    assert!(planted != source, "the text to change is gone");
    let gpu = Gpu::clone(&device::gpu());
    let backend = WgpuBackend::with_replaced_kernel(gpu, kernel, planted);
    let options = BuildOptions::default();
    let expected = CpuBackend::new().build_tree(&scene.mesh(), &options).expect("a tree");
    check_trait(&backend, &scene.mesh(), &expected, "planted");
}
