//! An update writes the rows of instances that changed, and shows what a load of the same scene shows.

mod common;

use std::collections::BTreeSet;

use common::{ALL, World, along_z};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{IDENTITY, Instance, InstanceId, Scene, translation};
use splitplane_cpu::CpuBackend;
use splitplane_render::instances::Geometries;
use splitplane_render::scene_data::NONE;
use splitplane_render::tracer::{FrameRequest, InstanceTracer, InstancedLook};
use splitplane_render::{Material, RenderSettings, Size};

/// Numbers below `end`, by a generator of Lehmer's.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0 * 48_271 % 0x7fff_ffff;
        self.0 as usize % end
    }

    fn place(&mut self) -> [f32; 3] {
        [0; 3].map(|_| self.below(1000) as f32 * 0.003 - 1.5)
    }
}

/// A scene with a description, and materials of its instances by name.
struct Stage {
    world: World,
    first_triangles: Vec<u32>,
    scene: Scene,
    materials: Vec<u32>,
}

impl Stage {
    /// A floor, a stone, a lamp and two balls, and so many stones more.
    fn new(stones: usize) -> Stage {
        let materials = vec![
            Material::new("white", [0.8; 3]),
            Material::new("lamp", [0.0; 3]).with_emission([3.0, 2.0, 1.0]),
            Material::new("red", [0.8, 0.1, 0.1]),
        ];
        let mut world = World { materials, ..World::default() };
        let (mut scene, mut first_triangles) = (Scene::new(), Vec::new());
        for (material, lo, hi) in [
            (0, [-20.0, -3.0, -20.0], [20.0, -2.0, 20.0]),
            (2, [-0.3, -0.3, -0.3], [0.3, 0.4, 0.2]),
            (1, [-1.0, 3.0, -3.0], [1.0, 3.1, -1.0]),
        ] {
            let first = world.triangles.len();
            first_triangles.push(first as u32);
            world.block(material, lo, hi);
            scene.add_mesh(&Mesh::soup(&world.triangles[first..]).unwrap()).unwrap();
        }
        let ball = |x| Sphere { centre: [x, 0.0, 0.0], radius: 0.3 };
        scene.add_shapes(Shapes::Spheres(vec![ball(0.0), ball(0.5)])).unwrap();
        first_triangles.push(0);
        let mut own = Stage { world, first_triangles, scene, materials: Vec::new() };
        for geometry in 0..4 {
            own.add(geometry, [0.0; 3]);
        }
        let mut random = Random(7);
        for _ in 0..stones {
            own.add(1, random.place());
        }
        own
    }

    fn add(&mut self, geometry: usize, place: [f32; 3]) -> u32 {
        let (name, _) = self.scene.geometries().nth(geometry).unwrap();
        let transform = if place == [0.0; 3] { IDENTITY } else { translation(place) };
        let name = self.scene.add_instance(Instance::new(name, transform)).unwrap().0;
        let names = self.materials.len().max(name as usize + 1);
        self.materials.resize(names, NONE);
        name
    }

    fn look(&self) -> InstancedLook<'_> {
        InstancedLook {
            mesh: Mesh::soup(&self.world.triangles).unwrap(),
            appearance: self.world.appearance(),
            geometries: Geometries {
                first_triangles: &self.first_triangles,
                materials: &self.materials,
            },
        }
    }

    fn load(&self) -> InstanceTracer {
        let options = BuildOptions::default();
        InstanceTracer::load(CpuBackend::new(), &self.scene, &self.look(), &options).unwrap()
    }

    /// Updates, and says how many rows were written.
    fn update(&self, tracer: &mut InstanceTracer) -> u64 {
        tracer.update(&self.scene, &self.look(), &BuildOptions::default()).unwrap();
        tracer.rows_written()
    }

    fn picture(&self, tracer: &mut InstanceTracer) -> Vec<u32> {
        let size = Size::new(64, 48).unwrap();
        let settings =
            RenderSettings { samples: 1, area_samples: 2, depth: 4, ..RenderSettings::default() };
        let camera = along_z([0.0, 0.3, 5.0], size, 0.7);
        let request = FrameRequest { settings, outputs: ALL, ..FrameRequest::new(camera, size) };
        tracer.frame(&self.look().mesh, &request).unwrap();
        tracer.radiance().as_flattened().iter().map(|part| part.to_bits()).collect()
    }
}

#[test]
fn updates_at_random_write_what_changed_and_show_what_a_load_shows() {
    let (mut stage, mut random) = (Stage::new(20), Random(11));
    let mut tracer = stage.load();
    assert_eq!(tracer.rows_written(), 24);
    let mut pictures = BTreeSet::new();
    for round in 0..12 {
        let mut changed = BTreeSet::new();
        let mut are_all = false;
        for _ in 0..1 + random.below(4) {
            let names: Vec<u32> = stage.scene.instances().map(|(name, _)| name.0).collect();
            let name = names[random.below(names.len())];
            let place = random.place();
            match random.below(5) {
                0 => {
                    stage.scene.remove_instance(InstanceId(name)).unwrap();
                    changed.insert(name);
                }
                1 => {
                    let geometry = 1 + random.below(3);
                    changed.insert(stage.add(geometry, place));
                }
                2 => {
                    let becomes = random.below(3) as u32;
                    if stage.materials[name as usize] != becomes {
                        changed.insert(name);
                    }
                    stage.materials[name as usize] = becomes;
                }
                _ => {
                    stage.scene.move_instance(InstanceId(name), translation(place)).unwrap();
                    changed.insert(name);
                }
            }
        }
        if round % 4 == 2 {
            // The numbers of its triangles stay, so no row changes.
            let first = stage.first_triangles[1] as usize;
            let end = stage.first_triangles[2] as usize;
            for corner in stage.world.triangles[first..end].as_flattened_mut() {
                corner[1] *= 1.25;
            }
            let (name, _) = stage.scene.geometries().nth(1).unwrap();
            let mesh = Mesh::soup(&stage.world.triangles[first..end]).unwrap();
            stage.scene.replace_mesh(name, &mesh).unwrap();
        }
        if round % 4 == 3 {
            // A geometry more: rows are made again.
            stage.first_triangles.push(stage.world.triangles.len() as u32);
            let first = stage.world.triangles.len();
            stage.world.block(2, [-0.1; 3], [0.1; 3]);
            stage.scene.add_mesh(&Mesh::soup(&stage.world.triangles[first..]).unwrap()).unwrap();
            are_all = true;
        }
        let written = stage.update(&mut tracer);
        let expected = if are_all { stage.scene.len() } else { changed.len() };
        assert_eq!(written, expected as u64, "round {round}");
        let picture = stage.picture(&mut tracer);
        let mut loaded = stage.load();
        assert!(picture == stage.picture(&mut loaded), "round {round}");
        pictures.insert(picture);
    }
    assert!(pictures.len() > 6, "{} pictures", pictures.len());
}

#[test]
fn one_of_very_many_that_moves_is_one_row() {
    for stones in [100, 10_000] {
        let mut stage = Stage::new(stones);
        let mut tracer = stage.load();
        assert_eq!(tracer.rows_written(), stones as u64 + 4);
        stage.scene.move_instance(InstanceId(50), translation([0.5, 0.25, 0.0])).unwrap();
        assert_eq!(stage.update(&mut tracer), 1);
        assert_eq!(stage.update(&mut tracer), 0);
        stage.materials[60] = 2;
        assert_eq!(stage.update(&mut tracer), 1);
        // Another description is not known.
        let other = Stage::new(stones);
        assert_eq!(other.update(&mut tracer), stones as u64 + 4);
    }
}
