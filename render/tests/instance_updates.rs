//! What an update writes of the instances that frames read: no more rows than changed, and the bits of a scene loaded anew.

use crate::common::{ALL, World, along_z};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{
    GeometryId, IDENTITY, Instance, InstanceId, Scene, Transform, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_render::instances::Geometries;
use splitplane_render::scene_data::NONE;
use splitplane_render::tracer::{FrameRequest, InstanceTracer, InstancedLook, ShownUpdate};
use splitplane_render::{Material, RenderSettings, Size};
use std::collections::BTreeSet;

const FLOOR: usize = 0;
const STONE: usize = 1;
const LAMP: usize = 2;
const BALL: usize = 3;
const SHINING: u32 = 2;

/// A scene that is edited, what it looks like, and which rows the edits since the last update concern.
struct Model {
    world: World,
    first_triangles: Vec<u32>,
    scene: Scene,
    materials: Vec<u32>,
    touched: BTreeSet<u32>,
}

/// A repeatable sequence of numbers.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end
    }

    fn place(&mut self) -> Transform {
        let mut part = || self.below(1000) as f32 / 250.0 - 2.0;
        let [x, y, z] = [part(), part(), part()];
        [[0.3, 0.1, 0.0, x], [-0.1, 0.25, 0.05, y], [0.0, 0.02, -0.4, z - 3.0]]
    }
}

impl Model {
    fn new() -> Model {
        let mut world = World {
            materials: vec![
                Material::new("white", [0.8; 3]),
                Material::new("steel", [0.2; 3]).with_mirror([0.6; 3]),
                Material::new("lamp", [0.1; 3]).with_emission([3.0, 2.0, 1.0]),
            ],
            ..World::default()
        };
        let mut first_triangles = Vec::new();
        let mut scene = Scene::new();
        for (material, lo, hi) in [
            (0, [-20.0, -4.0, -20.0], [20.0, -3.0, 20.0]),
            (1, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]),
            (SHINING, [-1.0, -0.1, -1.0], [1.0, 0.1, 1.0]),
        ] {
            let first = world.triangles.len();
            first_triangles.push(first as u32);
            world.block(material, lo, hi);
            scene.add_mesh(&Mesh::soup(&world.triangles[first..]).unwrap()).unwrap();
        }
        first_triangles.push(0);
        let sphere = Sphere { centre: [0.0; 3], radius: 1.0 };
        scene.add_shapes(Shapes::Spheres(vec![sphere])).unwrap();
        Model { world, first_triangles, scene, materials: Vec::new(), touched: BTreeSet::new() }
    }

    fn add(&mut self, geometry: usize, place: Transform, material: u32) {
        let new = Instance::new(GeometryId(geometry as u32), place);
        let name = self.scene.add_instance(new).unwrap().0;
        let there = self.materials.len().max(name as usize + 1);
        self.materials.resize(there, NONE);
        self.materials[name as usize] = material;
        self.touched.insert(name);
    }

    fn names(&self) -> Vec<u32> {
        self.scene.instances().map(|(name, _)| name.0).collect()
    }

    fn move_to(&mut self, name: u32, place: Transform) {
        self.scene.move_instance(InstanceId(name), place).unwrap();
        self.touched.insert(name);
    }

    fn paint(&mut self, name: u32, material: u32) {
        if self.materials[name as usize] != material {
            self.materials[name as usize] = material;
            self.touched.insert(name);
        }
    }

    fn remove(&mut self, name: u32) {
        self.scene.remove_instance(InstanceId(name)).unwrap();
        self.touched.insert(name);
    }

    /// Makes all triangles of a geometry other ones, which no row tells.
    fn stretch(&mut self, geometry: usize, factor: f32) {
        let range = 12 * geometry..12 * geometry + 12;
        self.world.triangles[range.clone()]
            .as_flattened_mut()
            .iter_mut()
            .for_each(|p| p[0] *= factor);
        let mesh = Mesh::soup(&self.world.triangles[range]).unwrap();
        let name = GeometryId(geometry as u32);
        self.scene.replace_mesh(name, &mesh).unwrap();
    }

    fn mesh(&self) -> Mesh<'_> {
        Mesh::soup(&self.world.triangles).unwrap()
    }

    fn look(&self) -> InstancedLook<'_> {
        let (first_triangles, materials) = (&self.first_triangles[..], &self.materials[..]);
        let geometries = Geometries { first_triangles, materials };
        InstancedLook { mesh: self.mesh(), appearance: self.world.appearance(), geometries }
    }

    fn load(&self) -> InstanceTracer {
        let (look, options) = (self.look(), BuildOptions::default());
        InstanceTracer::load(CpuBackend::new(), &self.scene, &look, &options).unwrap()
    }

    /// Updates a tracer, which writes as many rows as there are names touched, and says what it did.
    fn update(&mut self, tracer: &mut InstanceTracer) -> ShownUpdate {
        tracer.update(&self.scene, &self.look(), &BuildOptions::default()).unwrap();
        let update = tracer.last_update();
        let touched = core::mem::take(&mut self.touched);
        assert_eq!(update.rows_written as usize, touched.len(), "{touched:?}");
        update
    }

    /// The bits of a picture, and of the words of the appearance.
    fn picture(&self, tracer: &mut InstanceTracer) -> Vec<u32> {
        let size = Size::new(48, 32).unwrap();
        let camera = along_z([0.0, 0.3, 4.0], size, 0.9);
        let settings =
            RenderSettings { samples: 2, area_samples: 2, depth: 4, ..RenderSettings::default() };
        let request = FrameRequest { settings, outputs: ALL, ..FrameRequest::new(camera, size) };
        tracer.frame(&self.mesh(), &request).unwrap();
        let mut bits: Vec<u32> =
            tracer.radiance().as_flattened().iter().map(|x| x.to_bits()).collect();
        bits.extend(tracer.appearance().words());
        bits
    }
}

/// Instances come, go, move, are painted and get other triangles, with lamps among them and without: six updates of each of four sequences.
#[test]
fn random_updates_write_what_changed_and_have_the_bits_of_a_fresh_load() {
    let (mut kept, mut searched) = (0, 0);
    for seed in 0..4 {
        let mut numbers = Numbers(seed);
        let mut model = Model::new();
        model.add(FLOOR, IDENTITY, NONE);
        for geometry in [STONE, LAMP, BALL, STONE, BALL, STONE, STONE, STONE] {
            model.add(geometry, numbers.place(), NONE);
        }
        let mut tracer = model.load();
        model.touched.clear();
        let mut before = model.picture(&mut tracer);
        for step in 0..6 {
            // Every second step edits stones alone.
            let of_stones = step % 2 == 0;
            for _ in 0..2 {
                let names = model.names();
                let is_stone = |name: &u32| {
                    let own = model.scene.instance(InstanceId(*name)).unwrap().geometry;
                    own.0 as usize == STONE && model.materials[*name as usize] != SHINING
                };
                let names: Vec<u32> =
                    names.into_iter().filter(|name| !of_stones || is_stone(name)).collect();
                let name = names[numbers.below(names.len())];
                match numbers.below(if of_stones { 3 } else { 6 }) {
                    0 => model.move_to(name, numbers.place()),
                    1 => model.add(STONE, numbers.place(), 1),
                    2 => model.stretch(STONE, 0.8),
                    3 => model.paint(name, [0, 1, SHINING, NONE][numbers.below(4)]),
                    4 => model.add([LAMP, BALL][numbers.below(2)], numbers.place(), SHINING),
                    _ if name != 0 => model.remove(name),
                    _ => model.stretch(LAMP, 1.25),
                }
            }
            let update = model.update(&mut tracer);
            *(if update.emitters_searched { &mut searched } else { &mut kept }) += 1;
            let updated = model.picture(&mut tracer);
            assert!(updated == model.picture(&mut model.load()), "seed {seed}, step {step}");
            assert!(updated != before || update.rows_written == 0, "seed {seed}, step {step}");
            before = updated;
        }
    }
    assert!(kept >= 6 && searched >= 6, "{kept} {searched}");
}

/// One of ten thousand moves: one row is written. Where it does not shine, emitters stay as they are, with a lamp in the scene too.
#[test]
fn one_of_ten_thousand_is_one_row() {
    for lamps in [0, 1] {
        let mut model = Model::new();
        for _ in 0..lamps {
            model.add(LAMP, translation([0.0, 2.5, -3.0]), NONE);
        }
        for number in 0..10_000 - lamps {
            let [x, z] = [number % 100, number / 100].map(|at| at as f32);
            let place = [
                [0.03, 0.0, 0.0, 0.1 * x - 5.0],
                [0.0, 0.03, 0.0, -1.0],
                [0.0, 0.0, 0.03, -0.1 * z],
            ];
            model.add(STONE, place, NONE);
        }
        let mut tracer = model.load();
        model.touched.clear();
        assert_eq!(tracer.last_update().rows_written, 10_000);
        let revision = tracer.appearance().revision();
        model.move_to(5_000, translation([0.2, 0.1, 0.0]));
        let update = model.update(&mut tracer);
        assert_eq!((update.rows_written, update.emitters_searched), (1, false), "{lamps}");
        assert_eq!(tracer.appearance().revision(), revision);
        assert!(model.picture(&mut tracer) == model.picture(&mut model.load()), "{lamps}");
        // Nothing changed: nothing is written.
        let update = model.update(&mut tracer);
        assert_eq!((update.rows_written, update.emitters_searched), (0, false), "{lamps}");
        // What shines, and what begins to, is searched for.
        model.paint(9_999, SHINING);
        let update = model.update(&mut tracer);
        assert_eq!((update.rows_written, update.emitters_searched), (1, true), "{lamps}");
        assert!(model.picture(&mut tracer) == model.picture(&mut model.load()), "{lamps}");
    }
}

/// After an update that is refused because of the look, and after one whose scene cannot be built, the next one leaves nothing out.
#[test]
fn an_update_after_one_that_failed_leaves_nothing_out() {
    let mut model = Model::new();
    model.add(FLOOR, IDENTITY, NONE);
    model.add(STONE, translation([-1.0, 0.0, -3.0]), NONE);
    model.add(LAMP, translation([0.0, 2.5, -3.0]), NONE);
    let mut tracer = model.load();
    for refuses in [false, true] {
        let to = if refuses { 1.5 } else { 0.75 };
        model.move_to(1, translation([to, 0.0, -3.0]));
        model.move_to(2, translation([to, 2.0, -3.0]));
        let whole = model.look();
        let few = Geometries { first_triangles: &[], ..whole.geometries };
        let none = BuildOptions { max_memory: Some(1), ..BuildOptions::default() };
        let failed = if refuses {
            let look = InstancedLook { geometries: few, ..whole };
            tracer.update(&model.scene, &look, &BuildOptions::default()).unwrap_err().to_string()
        } else {
            model.stretch(STONE, 0.5);
            tracer.update(&model.scene, &model.look(), &none).unwrap_err().to_string()
        };
        assert!(failed.contains(if refuses { "geometry 0" } else { "limit of 1" }), "{failed}");
        tracer.update(&model.scene, &model.look(), &BuildOptions::default()).unwrap();
        // A refused look leaves unknown what was written: all rows are.
        assert_eq!(tracer.last_update().rows_written, if refuses { 3 } else { 2 });
        assert!(model.picture(&mut tracer) == model.picture(&mut model.load()), "{refuses}");
    }
}

/// A geometry with another number of triangles moves all that follow among the triangles of all, and shapes that go move those that follow
/// among the shapes: instances that nobody edited have other rows.
#[test]
fn rows_follow_geometries_that_are_elsewhere() {
    let mut model = Model::new();
    let sphere = Sphere { centre: [0.0, 0.5, 0.0], radius: 0.5 };
    let small = model.scene.add_shapes(Shapes::Spheres(vec![sphere])).unwrap();
    model.first_triangles.push(0);
    model.add(FLOOR, IDENTITY, NONE);
    model.add(STONE, translation([-2.0, 0.0, -3.0]), NONE);
    model.add(LAMP, translation([0.0, 2.5, -3.0]), NONE);
    model.add(BALL, translation([2.0, 0.0, -3.0]), 1);
    model.add(small.0 as usize, translation([0.0, 0.0, -2.0]), SHINING);
    let mut tracer = model.load();
    // All but the last two triangles of the stone.
    let range = 12 * STONE..12 * STONE + 10;
    let fewer = Mesh::soup(&model.world.triangles[range.clone()]).unwrap();
    model.scene.replace_mesh(GeometryId(STONE as u32), &fewer).unwrap();
    model.world.triangles.drain(range.end..range.end + 2);
    model.world.material_of.drain(range.end..range.end + 2);
    model.first_triangles[LAMP] -= 2;
    model.touched = (0..5).collect();
    assert!(model.update(&mut tracer).emitters_searched);
    assert!(model.picture(&mut tracer) == model.picture(&mut model.load()));
    model.remove(3);
    model.scene.remove_geometry(GeometryId(BALL as u32)).unwrap();
    model.touched = [0, 1, 2, 4].into();
    assert!(model.update(&mut tracer).emitters_searched);
    assert!(model.picture(&mut tracer) == model.picture(&mut model.load()));
}

/// Other triangles of a geometry are no row. Where its instances shine, the list of what shines is made anew.
#[test]
fn other_triangles_are_no_row() {
    let mut model = Model::new();
    model.add(FLOOR, IDENTITY, NONE);
    model.add(STONE, translation([-1.0, 0.0, -3.0]), NONE);
    model.add(LAMP, translation([0.0, 2.5, -3.0]), NONE);
    let mut tracer = model.load();
    model.touched.clear();
    let mut before = model.picture(&mut tracer);
    for geometry in [STONE, LAMP, STONE] {
        model.stretch(geometry, 0.5);
        let update = model.update(&mut tracer);
        assert_eq!((update.rows_written, update.emitters_searched), (0, geometry == LAMP));
        let updated = model.picture(&mut tracer);
        assert!(updated == model.picture(&mut model.load()) && updated != before, "{geometry}");
        before = updated;
    }
}
