//! A limit of memory means the same to updates of scenes that block and to those that do not.

use crate::common;
use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::{BuiltScene, SceneAccelerator};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{Instance, Scene, SceneBuildError};
use splitplane_test_support::scenes;
use splitplane_wgpu::query::WgpuScene;
use splitplane_wgpu::{Gpu, WgpuBackend};

/// Triangles of the meshes: each build takes more than the one before, so that a limit may end any of them.
const TRIANGLES: [usize; 3] = [300, 500, 600];

fn mesh(scene: &mut Scene, triangles: usize, seed: u64) {
    let name = scene.add_mesh(&scenes::soup(triangles, 0.2, seed).mesh()).expect("a geometry");
    scene.add_instance(Instance::in_place(name)).expect("an instance");
}

/// So many spheres.
fn row(spheres: usize) -> Shapes {
    let sphere = |i: usize| Sphere { centre: [i as f32, 0.0, 0.5], radius: 0.25 };
    Shapes::Spheres((0..spheres).map(sphere).collect())
}

/// A scene of three meshes, with so many spheres behind the first, where there are any.
fn scene(seed: u64, spheres: usize) -> Scene {
    let mut scene = Scene::new();
    mesh(&mut scene, TRIANGLES[0], seed);
    if spheres > 0 {
        let name = scene.add_shapes(row(spheres)).expect("a geometry");
        scene.add_instance(Instance::in_place(name)).expect("an instance");
    }
    mesh(&mut scene, TRIANGLES[1], seed + 1);
    mesh(&mut scene, TRIANGLES[2], seed + 2);
    scene
}

/// What an update is told, the scene's digest after it, and what it holds on the device.
type Told = (Result<u32, SceneBuildError>, splitplane_core::tree::digest::Digest, Option<String>);

/// Two scenes, one of which is updated without blocking. Each has a backend of its own: what a build is given goes by the builds of that backend before
/// it, and these are the same.
struct Both {
    backends: [WgpuBackend; 2],
    blocking: WgpuScene,
    yielding: WgpuScene,
}

impl Both {
    fn new(scene: &Scene) -> Both {
        let backends = [(); 2].map(|()| WgpuBackend::without_selftest(Gpu::clone(&common::gpu())));
        let options = BuildOptions::default();
        let blocking = backends[0].build_wgpu_scene(scene, &options).expect("a scene");
        let yielding = pollster::block_on(backends[1].build_scene_async(scene, &options));
        Both { yielding: yielding.expect("a scene"), blocking, backends }
    }

    /// Both become this scene.
    fn set(&mut self, scene: &Scene) {
        for (told, ..) in self.update(scene, None) {
            told.expect("an update");
        }
    }

    fn update(&mut self, scene: &Scene, max_memory: Option<u64>) -> [Told; 2] {
        let Both { backends: [backend, other], blocking, yielding } = self;
        let options = BuildOptions { max_memory, ..BuildOptions::default() };
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| {
            splitplane_core::backend::Backend::build(backend, mesh, options)
        };
        let one = blocking.update_by(scene, &options, &mut build);
        let other = pollster::block_on(other.update_scene_async(yielding, scene, &options));
        [(one, &*blocking), (other, &*yielding)].map(|(told, scene)| {
            let built = told.map(|report| report.geometries_built);
            (built, scene.scene().digest(), scene.placed_by_cpu().map(Into::into))
        })
    }
}

/// Bytes of all geometries: the device's arrays, and the nodes and references of the host's copies.
fn bytes_of_geometries(scene: &BuiltScene) -> u64 {
    let bytes = scene.geometries().map(|(_, own)| {
        let tree = own.accelerator().tree();
        own.accelerator().query_bytes() + (8 * tree.nodes.len() + 4 * tree.references.len()) as u64
    });
    bytes.sum()
}

/// The number of the geometry whose build a limit ended, and the numbers that are told.
fn refused(told: &Result<u32, SceneBuildError>) -> Option<(u32, [u64; 2])> {
    match told {
        Ok(_) => None,
        Err(SceneBuildError::Geometry {
            geometry,
            error: BuildError::OutOfMemory { needed, limit },
        }) => Some((*geometry, [*needed, *limit])),
        Err(error) => panic!("{error}"),
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn both_kinds_of_update_accept_and_refuse_the_same() {
    let (old, new) = (scene(1, 0), scene(11, 0));
    let mut both = Both::new(&old);
    let held = both.blocking.scene().bytes();
    let mut seen = [0; 4];
    let mut compare = |both: &mut Both, limit: u64| {
        let [one, other] = both.update(&new, Some(limit));
        assert_eq!(one, other, "{limit}");
        match refused(&one.0) {
            Some((geometry, [needed, told])) => {
                assert!(needed > limit && told == limit, "{needed} {told} {limit}");
                seen[geometry as usize] += 1;
            }
            None => {
                seen[3] += 1;
                let new = bytes_of_geometries(both.blocking.scene());
                assert!(held + new <= limit, "{held} + {new} > {limit}");
                both.set(&old);
            }
        }
        one.0.is_ok()
    };
    // The least limit that is enough; on the way there all others are compared.
    let (mut little, mut enough) = (held, 1 << 26);
    while enough - little > 1 {
        let middle = (little + enough) / 2;
        if compare(&mut both, middle) { enough = middle } else { little = middle }
    }
    // Below it any of the three is the first for which it is not enough.
    for step in 1..=16 {
        compare(&mut both, enough - step * (enough - held) / 16);
    }
    for step in [1, 256, 4096] {
        assert!(!compare(&mut both, enough - step));
        assert!(compare(&mut both, enough + step));
    }
    assert!(seen.iter().all(|&times| times > 0), "{seen:?}");
}

/// Without blocking, shapes are built after all meshes: what they leave too little room for is refused then.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn no_kind_of_update_holds_more_than_its_limit_beside_shapes() {
    let (old, new) = (scene(1, 900), scene(11, 1000));
    let mut both = Both::new(&old);
    let held = both.blocking.scene().bytes();
    let all = {
        both.set(&new);
        let all = bytes_of_geometries(both.blocking.scene());
        assert_eq!(all, bytes_of_geometries(both.yielding.scene()));
        both.set(&old);
        held + all
    };
    let mut seen = [[0; 2]; 2];
    let most = 8 * all;
    for limit in (0..16).map(|step| held + step * (most - held) / 16).chain([all - 1, all, most]) {
        for (kind, (told, ..)) in both.update(&new, Some(limit)).into_iter().enumerate() {
            seen[kind][usize::from(told.is_ok())] += 1;
            match refused(&told) {
                Some((_, [needed, told])) => assert!(needed > limit && told == limit),
                None => assert!(all <= limit, "{all} > {limit}"),
            }
        }
        both.set(&old);
    }
    assert!(seen.iter().flatten().all(|&times| times > 0), "{seen:?}");
}

/// Here no build needs more beside its tree than the spheres take that are built last, so that the meshes' builds leave the limit to the sum of all.
/// Nothing is placed: what is placed would be counted anew.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn meshes_that_were_built_count_beside_the_shapes_built_after_them() {
    let mut scene = Scene::new();
    scene.add_shapes(row(16_000)).expect("a geometry");
    for seed in 0..60 {
        scene.add_mesh(&scenes::soup(500, 0.2, seed).mesh()).expect("a geometry");
    }
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let build = |max_memory| {
        let options = BuildOptions { max_memory, ..BuildOptions::default() };
        pollster::block_on(backend.build_scene_async(&scene, &options))
    };
    let all = build(None).expect("a scene").scene().bytes();
    assert_eq!(build(Some(all)).expect("a scene").scene().bytes(), all);
    let error = BuildError::OutOfMemory { needed: all, limit: all - 1 };
    let refused = Some(SceneBuildError::Geometry { geometry: 60, error });
    assert_eq!(build(Some(all - 1)).err(), refused);
}
