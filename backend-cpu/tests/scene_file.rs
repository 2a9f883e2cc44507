//! Scene files: what is written comes back, and what was altered is refused.

use core::ops::ControlFlow;

use splitplane_core::backend::scene::{SceneAccelerator, TopUpdate, write_file};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::scene::file::{GeometryFault, MAGIC, SceneFile, SceneFileError};
use splitplane_core::scene::{
    GeometryId, Instance, InstanceId, Scene, SceneBuildError, SceneHit, SceneOptions, translation,
};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::digest::Xxh64;
use splitplane_core::tree::file::FileError;
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::forge::{Forgery, forge};
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;

const HEAD: usize = 64;
const CHECKSUM: usize = 56;

/// Bytes at an address that is a multiple of four.
#[derive(Clone)]
struct Words(Vec<u32>);

impl Words {
    fn of(bytes: &[u8]) -> Words {
        assert_eq!(bytes.len() % 4, 0);
        Words(bytes.chunks(4).map(|word| u32::from_ne_bytes(word.try_into().unwrap())).collect())
    }

    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }

    /// With the checksum that it has to have.
    fn sealed(mut self) -> Words {
        let mut state = Xxh64::new(1);
        state.write(&self.bytes()[..CHECKSUM]);
        state.write(&self.bytes()[HEAD..]);
        let sum = state.finish();
        (self.0[14], self.0[15]) = (sum as u32, (sum >> 32) as u32);
        self
    }
}

fn traced(accelerator: &dyn SceneAccelerator, rays: &[Ray]) -> Vec<SceneHit> {
    answers(accelerator, rays, Accuracy::default())
}

fn answers(scene: &dyn SceneAccelerator, rays: &[Ray], accuracy: Accuracy) -> Vec<SceneHit> {
    let mut hits = vec![SceneHit::MISS; rays.len()];
    let options = SceneOptions { accuracy, ..SceneOptions::default() };
    scene.closest_hits(rays, &mut hits, &options).expect("hits");
    hits
}

/// Some names are free, one mesh has indices, and one instance sees one side only.
fn scene_with_gaps() -> (Scene, GeometryId) {
    let mut scene = Scene::new();
    let meshes = [scenes::sphere(6, [0.0; 3], 0.4), scenes::soup(30, 0.3, 5), scenes::one()];
    let [ball, gone, one] = meshes.map(|mesh| scene.add_mesh(&mesh.mesh()).unwrap());
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]];
    let indexed = Mesh::indexed(&positions, &[[0, 1, 2], [2, 1, 3]]).unwrap();
    let indexed = scene.add_mesh(&indexed).unwrap();
    let mut names = Vec::new();
    for (place, geometry) in [ball, one, indexed, ball, indexed, ball].into_iter().enumerate() {
        let transform = translation([place as f32, 0.25, -0.5]);
        names.push(scene.add_instance(Instance::new(geometry, transform)).unwrap());
    }
    let front =
        Instance { culling: Culling::Front, id: 77, mask: 5, ..*scene.instance(names[3]).unwrap() };
    scene.set_instance(names[3], front).unwrap();
    scene.remove_instance(names[1]).unwrap();
    scene.remove_instance(names[4]).unwrap();
    scene.remove_geometry(gone).unwrap();
    (scene, gone)
}

#[test]
fn what_is_written_comes_back() {
    let backend = CpuBackend::new();
    let mut all: Vec<Scene> = Kind::ALL.map(|kind| objects::scene(kind, 30, 3).0).into();
    all.extend([Scene::new(), scene_with_gaps().0]);
    for (preset, scene) in Preset::ALL.into_iter().cycle().zip(&all) {
        let built = backend.build_scene(scene, &preset.into()).unwrap();
        let words = Words::of(&write_file(built.scene()).unwrap());
        let file = SceneFile::parse(words.bytes()).unwrap();
        assert_eq!(file.digest(), built.scene().digest());
        let instances: Vec<_> = scene.instances().map(|(name, one)| (name, *one)).collect();
        assert_eq!(file.instances().collect::<Vec<_>>(), instances);
        let layout = QueryLayout::Compact;
        for options in [LoadOptions::default(), LoadOptions { layout, ..Default::default() }] {
            let (described, loaded) = backend.load_scene(&file, &options).unwrap();
            assert_eq!(loaded.scene().digest(), built.scene().digest());
            assert_eq!(described.len(), scene.len());
            for ((name, mesh), (same, own)) in described.geometries().zip(scene.geometries()) {
                assert_eq!(name, same);
                assert_eq!(mesh.mesh().arrays(), own.mesh().arrays());
            }
            if !scene.is_empty() {
                let rays = objects::rays(scene, 500, 4);
                assert!(traced(&*loaded, &rays) == traced(&*built, &rays));
            }
            assert_eq!(write_file(loaded.scene()).unwrap(), words.bytes());
        }
    }
}

/// A loaded scene is edited like any other: nothing is made anew that did not change, and free names are given again.
#[test]
fn a_loaded_scene_can_be_edited() {
    let backend = CpuBackend::new();
    let (scene, gone) = scene_with_gaps();
    let built = backend.build_scene(&scene, &Preset::Best.into()).unwrap();
    let words = Words::of(&write_file(built.scene()).unwrap());
    let file = SceneFile::parse(words.bytes()).unwrap();
    let (mut scene, mut loaded) = backend.load_scene(&file, &LoadOptions::default()).unwrap();
    let options = BuildOptions::default();
    let report = backend.update_scene(&mut *loaded, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, report.instances_compared), (0, 0));
    assert_eq!(report.top, TopUpdate::Kept);
    assert_eq!(scene.instance(InstanceId(3)).unwrap().id, 77);
    assert!(scene.instance(InstanceId(1)).is_err() && scene.geometry(gone).is_err());

    scene.move_instance(InstanceId(0), translation([0.0, 3.0, 0.0])).unwrap();
    let report = backend.update_scene(&mut *loaded, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, report.instances_compared), (0, 1));
    assert_eq!(scene.add_mesh(&scenes::one().mesh()), Ok(gone));
    for name in [1, 4, 6] {
        assert_eq!(scene.add_instance(Instance::in_place(gone)), Ok(InstanceId(name)));
    }
    backend.update_scene(&mut *loaded, &scene, &options).unwrap();
    assert_eq!(loaded.scene().placements().count(), 7);
    let used = scene.remove_geometry(GeometryId(0)).unwrap_err().to_string();
    assert!(used.contains("has 3 instances"), "{used}");
}

/// Every word altered in several ways: the checksum finds it, and with the right checksum something else does.
#[test]
fn what_was_altered_is_refused() {
    let backend = CpuBackend::new();
    let built = backend.build_scene(&scene_with_gaps().0, &Preset::Fast.into()).unwrap();
    let words = Words::of(&write_file(built.scene()).unwrap());
    let mut random = Random::new(11);
    let mut errors = std::collections::BTreeMap::<String, usize>::new();
    for at in 0..words.0.len() {
        for change in [1, 0x8000_0000, 1 << random.below(32), random.bits() | 1] {
            let mut altered = words.clone();
            altered.0[at] ^= change;
            assert!(SceneFile::parse(altered.bytes()).is_err(), "word {at}");
            if (14..16).contains(&at) {
                continue;
            }
            let error = SceneFile::parse(altered.sealed().bytes()).expect_err("a forgery");
            let kind = format!("{error:?}");
            let kind = kind.split([' ', '(']).next().unwrap().to_owned();
            *errors.entry(kind).or_default() += 1;
        }
    }
    for kind in ["Magic", "Version", "Length", "Records", "Geometry", "Instance", "Digest"] {
        assert!(errors.get(kind).is_some_and(|&count| count > 1), "{kind}: {errors:?}");
    }
    let bytes = words.bytes();
    for length in 0..bytes.len() {
        assert!(SceneFile::parse(&bytes[..length]).is_err(), "{length} bytes");
    }
    assert_eq!(SceneFile::parse(b"splitkd\n and more").unwrap_err(), SceneFileError::Magic);
    let mut shifted = vec![0; bytes.len() + 1];
    let at = usize::from(shifted.as_ptr().align_offset(4) == 0);
    shifted[at..at + bytes.len()].copy_from_slice(bytes);
    let parsed = SceneFile::parse(&shifted[at..at + bytes.len()]);
    assert_eq!(parsed.unwrap_err(), SceneFileError::Alignment);
}

/// Heads that claim more than there is: an error before any memory is asked for.
#[test]
fn bombs_are_refused() {
    let names = [1u32, 1 << 16, 1 << 28, (1 << 28) + 1, u32::MAX];
    let sizes = [0u64, 1, 3, 1 << 20, 1 << 32, u64::MAX / 12, u64::MAX];
    for geometries in names {
        for instances in names {
            for size in sizes {
                let mut words = Words(vec![0; 16 + 8 * 16]);
                words.0[..2].copy_from_slice(bytemuck::cast_slice(&MAGIC[..]));
                let length = 4 * words.0.len() as u32;
                words.0[2..10].copy_from_slice(&[1, 64, geometries, instances, 0, 0, length, 0]);
                for record in words.0[16..].chunks_mut(8) {
                    let size = [size as u32, (size >> 32) as u32];
                    record.copy_from_slice(&[2, 0, size[0], size[1], size[0], size[1], 0, 0]);
                }
                let error = SceneFile::parse(words.sealed().bytes()).unwrap_err();
                let expected = matches!(
                    error,
                    SceneFileError::Records
                        | SceneFileError::Geometry { .. }
                        | SceneFileError::Digest
                );
                assert!(expected, "{error}");
            }
        }
    }
}

/// Trees that lose triangles, with all digests as they should be: loading finds them. And trees of other meshes.
#[test]
fn forged_trees_are_refused() {
    let backend = CpuBackend::new();
    let mesh = scenes::sphere(6, [0.0; 3], 0.4);
    let (mut honest, mut forged, mut other) = (Scene::new(), 0, 0);
    let ball = honest.add_mesh(&mesh.mesh()).unwrap();
    honest.add_instance(Instance::in_place(ball)).unwrap();
    let options = BuildOptions::default();
    let mut random = Random::new(5);
    for round in 0..4 * Forgery::ALL.len() {
        let (mut tree, _) = backend.build_tree(&mesh.mesh(), &options).unwrap();
        let before = tree.digest();
        forge(&mut tree, &mesh.mesh(), Forgery::ALL[round % Forgery::ALL.len()], &mut |n| {
            random.below(n)
        });
        if tree.digest() == before {
            continue;
        }
        let liar = Liar(CpuBackend::new(), tree);
        let built = liar.build_scene(&honest, &options).unwrap();
        let words = Words::of(&write_file(built.scene()).unwrap());
        match SceneFile::parse(words.bytes()) {
            Ok(file) => match backend.load_scene(&file, &LoadOptions::default()) {
                Ok((_, loaded)) => {
                    let rays = objects::rays(&honest, 300, 1);
                    let right = backend.build_scene(&honest, &options).unwrap();
                    // A tree with other bounds is another tree, with other slack: exact hits are the mesh's alone.
                    let [found, expected] =
                        [&*loaded, &*right].map(|scene| answers(scene, &rays, Accuracy::Exact));
                    assert!(found == expected);
                }
                Err(SceneBuildError::Geometry {
                    geometry: 0,
                    error: BuildError::WrongMesh { .. },
                }) => forged += 1,
                Err(error) => panic!("{error}"),
            },
            Err(SceneFileError::Geometry {
                geometry: 0,
                fault: GeometryFault::Tree(FileError::Tree(_)),
            }) => forged += 1,
            Err(error) => panic!("{error}"),
        }
    }
    // A mesh of as many triangles, in the place of the other.
    let built = backend.build_scene(&honest, &options).unwrap();
    let words = Words::of(&write_file(built.scene()).unwrap());
    let first = (HEAD + 32 + 64) / 4;
    for at in [first, first + 7] {
        let mut moved = words.clone();
        moved.0[at] = 0.125f32.to_bits();
        let error = SceneFile::parse(moved.sealed().bytes()).unwrap_err();
        let fault = GeometryFault::OtherMesh;
        other += usize::from(error == SceneFileError::Geometry { geometry: 0, fault });
    }
    assert!(forged > 10 && other == 2, "{forged} {other}");
}

/// A backend whose trees are not those of its meshes.
struct Liar(CpuBackend, KdTree);

/// What it builds.
struct Lie(Box<dyn Accelerator>, KdTree);

impl Accelerator for Lie {
    fn tree(&self) -> &KdTree {
        &self.1
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
}

impl Backend for Liar {
    fn describe(&self) -> BackendInfo {
        self.0.describe()
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(Lie(self.0.build(mesh, options)?, self.1.clone())))
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.0.load(mesh, tree, options)
    }
}

/// Limits and a watch end loading with an error that says so.
#[test]
fn loading_is_limited_and_can_be_cancelled() {
    let backend = CpuBackend::new();
    let (scene, _) = objects::scene(Kind::Ordinary, 40, 5);
    let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let words = Words::of(&write_file(built.scene()).unwrap());
    let file = SceneFile::parse(words.bytes()).unwrap();
    for max_memory in [0, 1000, built.scene().bytes() / 2] {
        let options = LoadOptions { max_memory: Some(max_memory), ..Default::default() };
        let Err(error) = backend.load_scene(&file, &options) else { panic!("{max_memory}") };
        assert!(error.to_string().contains(&max_memory.to_string()), "{error}");
    }
    let watch = |_: &Progress| ControlFlow::Break(());
    let options = LoadOptions { watch: Some(&watch), ..Default::default() };
    let Err(error) = backend.load_scene(&file, &options) else { panic!("not cancelled") };
    assert!(error.to_string().contains("cancelled"), "{error}");
}
