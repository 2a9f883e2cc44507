//! Packed scenes whose geometries change places one by one, as on a device: after each of random edits the hits of all instances asked one after the other.
//! Planted faults in what is put where are found.

use std::panic::{AssertUnwindSafe, catch_unwind};

use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::scene::packed::{PackedPlaces, PackedScene, Unpackable};
use splitplane_core::backend::scene::{BuiltScene, GeometryChange};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::layout::SceneBatch;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{SceneHit, SceneOptions};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::edits::edit;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

const BATCH: SceneBatch = SceneBatch {
    count: 0,
    culling: 0,
    mask: u32::MAX,
    ignored_instance: u32::MAX,
    ignored_triangle: 0,
    any: 0,
    zero: 0,
    way: 0,
};

/// What goes wrong with the first geometry that changed in an update.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// Its nodes are not sent.
    StaleNodes,
    /// Its references are not sent.
    StaleReferences,
    /// Its triangles are not sent.
    StaleTriangles,
    /// Its shapes are not sent.
    StaleShapes,
    /// Its references are sent to one place too far.
    ShiftedReferences,
    /// Its triangles are sent to one place too far.
    ShiftedTriangles,
    /// Its triangles are sent to a range that another geometry has.
    Overlap,
    /// Instances are told the places of before.
    OldPlaces,
    /// Instances are told roots off by one.
    Roots,
}

const FAULTS: [Fault; 9] = [
    Fault::StaleNodes,
    Fault::StaleReferences,
    Fault::StaleTriangles,
    Fault::StaleShapes,
    Fault::ShiftedReferences,
    Fault::ShiftedTriangles,
    Fault::Overlap,
    Fault::OldPlaces,
    Fault::Roots,
];

/// What a device would hold.
#[derive(Default)]
struct Mirror {
    places: PackedPlaces,
    arrays: PackedScene,
}

impl Mirror {
    fn update(&mut self, scene: &BuiltScene, changes: &[GeometryChange], fault: Option<Fault>) {
        let places = self.places.after(changes).expect("places");
        let before = self.arrays.clone();
        self.arrays.fit(&places);
        for change in changes.iter().filter(|change| change.sizes.is_some()) {
            let piece = scene.packed_piece(change.geometry, &places).expect("a piece");
            self.arrays.put(&piece);
        }
        scene.pack_instances(&mut self.arrays, &places).expect("instances");
        if let Some(fault) = fault {
            self.plant(fault, scene, changes, &before, &places);
        }
        self.places = places;
    }

    fn plant(
        &mut self,
        fault: Fault,
        scene: &BuiltScene,
        changes: &[GeometryChange],
        before: &PackedScene,
        places: &PackedPlaces,
    ) {
        match fault {
            Fault::OldPlaces => {
                scene.pack_instances(&mut self.arrays, &self.places).expect("instances");
            }
            Fault::Roots => self.arrays.instances.iter_mut().for_each(|own| own.root += 1),
            _ => {}
        }
        let changed = changes.iter().find_map(|own| Some((own.geometry, own.sizes?)));
        let Some((geometry, sizes)) = changed else { return };
        let [node, reference, triangle, block] = places.firsts(geometry).expect("a place");
        let arrays = &mut self.arrays;
        match fault {
            Fault::StaleNodes => stale(&mut arrays.nodes, &before.nodes, node, sizes.nodes),
            Fault::StaleReferences => {
                stale(&mut arrays.references, &before.references, reference, sizes.references);
            }
            Fault::StaleTriangles => {
                stale(&mut arrays.triangles, &before.triangles, triangle, sizes.triangles);
            }
            Fault::StaleShapes => stale(&mut arrays.shapes, &before.shapes, block, sizes.shapes),
            Fault::ShiftedReferences => shift(&mut arrays.references, reference, sizes.references),
            Fault::ShiftedTriangles => shift(&mut arrays.triangles, triangle, sizes.triangles),
            Fault::Overlap => {
                let mut others = scene.geometries().filter(|(name, _)| *name != geometry);
                let other = others.find(|(_, own)| !own.mesh().mesh().is_empty());
                let Some((name, own)) = other else { return };
                let [_, _, other, _] = places.firsts(name).expect("a place");
                let count = own.mesh().mesh().len().min(sizes.triangles);
                arrays.triangles.copy_within(triangle..triangle + count, other);
            }
            Fault::OldPlaces | Fault::Roots => {}
        }
    }

    fn hits(&self, rays: &[Ray]) -> Vec<[u32; 6]> {
        let hit = |ray| bytemuck::cast(self.arrays.trace::<Strict>(ray, &BATCH));
        rays.iter().map(hit).collect()
    }
}

/// What was there before, as far as there was something.
fn stale<T: Copy>(is: &mut [T], was: &[T], first: usize, count: usize) {
    let end = (first + count).min(was.len()).max(first);
    is[first..end].copy_from_slice(was.get(first..end).unwrap_or(&[]));
}

/// One place too far, over what is there.
fn shift<T: Copy>(is: &mut [T], first: usize, count: usize) {
    let end = (first + count).min(is.len().saturating_sub(1)).max(first);
    is.copy_within(first..end, first + 1);
}

#[derive(Default, Debug)]
struct Seen {
    hits: usize,
    /// Updates in which some geometries changed and most stayed.
    partly: usize,
    /// The most free entries of any array.
    free: usize,
    /// Geometries that changed and stayed where they were.
    stayed: usize,
}

/// Random edits from a seed; an error at the first hit that is wrong.
fn run(seed: u64, fault: Option<Fault>, seen: &mut Seen) -> Result<(), String> {
    let (cpu, options) = (CpuBackend::new(), BuildOptions::default());
    let mut random = Random::new(seed);
    let (mut scene, names) = objects::scene(Kind::Ordinary, 12, seed);
    if seed.is_multiple_of(2) {
        objects::add_shapes(&mut scene, &names, seed);
    }
    let (mut built, mut mirror) = (BuiltScene::default(), Mirror::default());
    for step in 0..24 {
        let mut changes = Vec::new();
        let mut build =
            |mesh: &Mesh<'_>, options: &BuildOptions<'_>| Backend::build(&cpu, mesh, options);
        built
            .update_after(&scene, &options, &mut build, &mut |becoming| {
                changes = becoming.changes.to_vec();
                Ok(())
            })
            .expect("an update");
        let before = mirror.places.clone();
        mirror.update(&built, &changes, fault);
        let [ends, used] = [mirror.places.ends(), mirror.places.used()];
        let own = built.packed_sizes();
        assert_eq!(
            [used.nodes, used.references, used.triangles, used.shapes],
            [own.nodes, own.references, own.triangles, own.shapes]
        );
        let stays = |own: &&GeometryChange| {
            let first = before.firsts(own.geometry);
            first.is_some() && first == mirror.places.firsts(own.geometry)
        };
        seen.stayed += changes.iter().filter(stays).count();
        seen.partly += usize::from((1..=3).contains(&changes.len()));
        seen.free = seen.free.max(ends.references - used.references);
        let rays = objects::rays(&scene, 60, seed ^ step << 8);
        let hits = mirror.hits(&rays);
        for (ray, hit) in rays.iter().zip(hits) {
            let all: SceneHit = built.answer_by_all(ray, &SceneOptions::default());
            if hit != bytemuck::cast::<SceneHit, [u32; 6]>(all) {
                return Err(format!("{seed}, {step}, {ray:?}: {all:?}"));
            }
            seen.hits += usize::from(all.is_hit());
        }
        for _ in 0..1 + random.below(3) {
            edit(&mut scene, &mut random);
        }
    }
    Ok(())
}

#[test]
fn hits_are_those_of_all_instances_wherever_geometries_lie() {
    let mut seen = Seen::default();
    for seed in 0..12 {
        run(seed, None, &mut seen).unwrap_or_else(|wrong| panic!("{wrong}"));
    }
    println!("{seen:?}");
    assert!(seen.hits > 5_000 && seen.partly > 100 && seen.stayed > 20, "{seen:?}");
    assert!(seen.free > 100, "{seen:?}");
}

#[test]
fn planted_faults_are_found() {
    let found = |fault| {
        (0..12).any(|seed| {
            // What is wrong may lead out of the arrays.
            let run = || run(seed, Some(fault), &mut Seen::default());
            catch_unwind(AssertUnwindSafe(run)).map_or(true, |outcome| outcome.is_err())
        })
    };
    let never: Vec<Fault> = FAULTS.into_iter().filter(|fault| !found(*fault)).collect();
    assert_eq!(never, [], "faults that no ray finds");
}

/// All pieces together are the packed scene.
#[test]
fn pieces_need_a_place_of_their_size() {
    let (scene, _) = objects::scene(Kind::Ordinary, 12, 5);
    let cpu = CpuBackend::new();
    let built = cpu.build_scene(&scene, &BuildOptions::default()).expect("a scene");
    let built = built.scene();
    let (name, _) = built.geometries().next().expect("a geometry");
    let places = PackedPlaces::of(built).expect("places");
    let all = built.packed().expect("a packed scene");
    let mut pieces = PackedScene::default();
    pieces.fit(&places);
    for (name, _) in built.geometries() {
        pieces.put(&built.packed_piece(name, &places).expect("a piece"));
    }
    built.pack_instances(&mut pieces, &places).expect("instances");
    assert!(pieces == all);
    let sizes = places.used();
    for sizes in [None, Some(sizes)] {
        let other = places.after(&[GeometryChange { geometry: name, sizes }]).expect("places");
        let error = built.packed_piece(name, &other).unwrap_err();
        assert_eq!(error, Unpackable::NoPlace { geometry: name.0 });
    }
}
