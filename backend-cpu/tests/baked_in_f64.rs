//! Closest and any hits of scenes of many objects against one mesh of everything: no hit is lost, none is farther than it should
//! be, and each is where it should be, but for what the bound on a transform's roundings leaves open.
//!
//! A tree over the mesh, rounded to `f32`, answers first. Where it names another triangle, and for one ray of each hundred
//! whatever it names, all triangles are looked at in `f64`. `SPLITPLANE_LONG=1` casts 10,000,000 rays.

#[path = "common/in_world.rs"]
mod in_world;

use crate::common::{built, long};
use in_world::{Object, World};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray};
use splitplane_core::scene::{Instance, Scene, SceneHit, SceneOptions, WorldBox};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

const KINDS: [Kind; 5] =
    [Kind::Ordinary, Kind::IllConditioned, Kind::Far, Kind::Scales, Kind::Coincident];

/// Of a thousand rays: how many may be answered otherwise than by the rounded mesh, since the bound leaves it open; and how many at
/// least have one right answer. An object that nothing hits would be ten or more of them.
fn limits(kind: Kind) -> (u64, u64) {
    match kind {
        Kind::Ordinary | Kind::Coincident => (2, 800),
        Kind::IllConditioned => (10, 550),
        Kind::Far => (10, 600),
        // Objects of a millionth of the distance of others are smaller than the bound.
        _ => (40, 500),
    }
}

/// A scene that answers all rays from both sides, and in which no box is everywhere.
fn scene(kind: Kind, seed: u64) -> Scene {
    let (mut scene, names) = objects::scene(kind, 60, seed);
    for name in names {
        let mut plain = *scene.instance(name).expect("an instance");
        (plain.mask, plain.culling) = (u32::MAX, Culling::None);
        if kind == Kind::Far {
            // So far that the bound is a hundredth of an object, where it would be half of it.
            plain.transform.iter_mut().for_each(|row| row[3] /= 128.0);
        }
        scene.set_instance(name, plain).expect("an instance");
    }
    let boxes = built(&scene);
    for (name, placement) in boxes.scene().placements() {
        if placement.world_box == Some(WorldBox::EVERYWHERE) {
            scene.remove_instance(name).expect("an instance");
        }
    }
    scene
}

/// Rays at random places of objects and of their boxes, from other objects, from near and from far, and rays in random
/// directions.
fn rays(world: &World, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let full: Vec<_> = world.objects.iter().filter(|own| !own.triangles.is_empty()).collect();
    let place = |random: &mut Random, on_it: bool| {
        let object: &Object = random.pick(&full);
        let transform = &object.instance.transform;
        let size = transform.iter().flat_map(|row| &row[..3]);
        let size = f64::from(size.fold(0.0f32, |m, x| m.max(x.abs())));
        let corners = &object.triangles[random.below(object.triangles.len())];
        let weights = random.barycentric();
        let on = [0, 1, 2].map(|k| (0..3).map(|i| weights[i] * corners[i][k]).sum());
        let Aabb { lo, hi } = object.bounds;
        let inside = [0, 1, 2].map(|k| random.between(f64::from(lo[k]), f64::from(hi[k])));
        (if on_it { on } else { objects::in_world(transform, inside) }, size)
    };
    let mut all = Vec::with_capacity(count);
    while all.len() < count {
        let on_it = random.below(2) == 0;
        let (to, size) = place(&mut random, on_it);
        let d = random.direction();
        let from = |away: f64| [0, 1, 2].map(|k| (to[k] - d[k] * away) as f32);
        let ray = match random.below(5) {
            // None starts on a surface, where the bound says nothing of what is hit.
            0 | 1 => {
                let start = place(&mut random, false).0;
                Ray::segment(start.map(|x| x as f32), to.map(|x| x as f32))
            }
            2 => Ray::new(from(size * random.between(2.0, 100.0)), d.map(|x| x as f32)),
            3 => Ray::new(
                from(size * random.between(0.0, 4.0)),
                random.direction().map(|x| x as f32),
            ),
            _ => {
                let length = 10f64.powf(random.between(-3.0, 3.0));
                Ray::new(from(size * random.between(0.0, 4.0)), d.map(|x| (x * length) as f32))
            }
        };
        let ray = match random.below(6) {
            0 => ray.with_limits(f32::NEG_INFINITY, f32::INFINITY),
            1 => ray.with_limits(0.25, 1.5),
            2 => ray.with_limits(0.0, random.between(0.0, 2.0) as f32),
            _ => ray.with_limits(0.0, f32::INFINITY),
        };
        if ray.direction != [0.0; 3] {
            all.push(ray);
        }
    }
    all
}

/// One mesh of everything, rounded, and what its triangles are in the scene.
struct Baked {
    tree: Box<dyn Accelerator>,
    names: Vec<(u32, u32)>,
}

impl Baked {
    fn new(world: &World) -> Baked {
        let (mut triangles, mut names) = (Vec::new(), Vec::new());
        for object in &world.objects {
            for (i, corners) in object.triangles.iter().enumerate() {
                triangles.push(corners.map(|p| p.map(|x| x as f32)));
                names.push((object.name.0, i as u32));
            }
        }
        let mesh = Mesh::soup(&triangles).expect("a mesh");
        let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
        Baked { tree, names }
    }

    fn named(&self, rays: &[Ray]) -> Vec<Option<(u32, u32)>> {
        let mut hits = vec![Hit::MISS; rays.len()];
        self.tree.closest_hits(rays, &mut hits, &QueryOptions::default()).expect("hits");
        let name = |hit: &Hit| hit.is_hit().then(|| self.names[hit.triangle as usize]);
        hits.iter().map(name).collect()
    }
}

type Answers = (Vec<SceneHit>, Vec<bool>);

fn answers(scene: &dyn SceneAccelerator, rays: &[Ray]) -> Answers {
    let options = SceneOptions::default();
    let mut hits = vec![SceneHit::MISS; rays.len()];
    scene.closest_hits(rays, &mut hits, &options).expect("hits");
    let mut any = vec![false; rays.len()];
    scene.any_hits(rays, &mut any, &options).expect("hits");
    (hits, any)
}

/// Counts of rays.
#[derive(Debug, Default)]
struct Tally {
    rays: u64,
    hits: u64,
    /// Right within the bound, though the rounded mesh has another triangle, or a miss in place of a hit.
    open: u64,
    /// Looked at whatever the rounded mesh says, and how many of them have one right answer.
    sampled: u64,
    clear: u64,
    wrong: u64,
    first_wrong: Option<String>,
}

impl Tally {
    fn add(&mut self, world: &World, baked: &Baked, rays: &[Ray], (hits, any): &Answers) {
        for (i, (ray, named)) in rays.iter().zip(baked.named(rays)).enumerate() {
            let hit = &hits[i];
            let named = named.map(|name| world.surface(name));
            let own = hit.is_hit().then(|| world.surface((hit.instance, hit.triangle)));
            let mut right = own == named && (!hit.is_hit() || world.is_on_its_triangle(ray, hit));
            if !right || i % 100 == 0 {
                let (judged, answers) = world.judge(ray, hit);
                self.open += u64::from(own != named && judged);
                if i % 100 == 0 {
                    self.sampled += 1;
                    self.clear += u64::from(answers == 1);
                }
                right = judged;
            }
            self.rays += 1;
            self.hits += u64::from(hit.is_hit());
            if !right || any[i] != hit.is_hit() {
                self.wrong += 1;
                let text = || format!("{ray:?}: {hit:?}, any {}, mesh {named:?}", any[i]);
                self.first_wrong.get_or_insert_with(text);
            }
        }
    }
}

#[test]
fn hits_are_those_of_a_mesh_of_everything_within_the_bound() {
    let (scenes, count) = if long() { (20, 100_000) } else { (2, 4_000) };
    for (number, kind) in KINDS.into_iter().enumerate() {
        let mut tally = Tally::default();
        for round in 0..scenes {
            let seed = 1000 * number as u64 + round;
            let scene = scene(kind, seed);
            let built = built(&scene);
            let world = World::new(&scene, built.scene()).expect("bounds");
            let rays = rays(&world, count, seed + 500);
            let answers = answers(&*built, &rays);
            tally.add(&world, &Baked::new(&world), &rays, &answers);
        }
        println!("{kind:?}: {tally:?}");
        let (open, clear) = limits(kind);
        assert_eq!(tally.wrong, 0, "{kind:?}: {tally:?}");
        assert!(tally.open * 1000 <= open * tally.rays, "{kind:?}: {tally:?}");
        assert!(tally.clear * 1000 >= clear * tally.sampled, "{kind:?}: {tally:?}");
        assert!(3 * tally.hits > tally.rays, "{kind:?}: {tally:?}");
    }
}

/// A part of the instances as two meshes: each hit is, by the names that the table gives back, one of the scene from which they were baked.
#[test]
fn chosen_instances_are_baked_within_the_bound() {
    for (number, kind) in KINDS.into_iter().enumerate() {
        let scene = scene(kind, 300 + number as u64);
        let unbaked = built(&scene);
        let world = World::new(&scene, unbaked.scene()).expect("bounds");
        // One number for all, as a group needs.
        let mut names = Vec::new();
        let (mut same, _) = scene.bake(&[]).expect("a scene");
        for (name, instance) in scene.instances() {
            same.set_instance(name, Instance { id: 0, ..*instance }).expect("an instance");
            names.push(name);
        }
        let third = names.len() / 3;
        // Instances that coincide go together: else roundings would decide between them.
        let groups: &[&[_]] = match kind {
            Kind::Coincident => &[&names],
            _ => &[&names[..third], &names[2 * third..]],
        };
        let (baked, table) = same.bake(groups).expect("a scene");
        assert!(baked.len() < scene.len() / 2);
        let rays = rays(&world, 4_000, 900 + number as u64);
        let (hits, any) = answers(&*built(&baked), &rays);
        let hits: Vec<_> = hits.iter().map(|hit| table.original_hit(hit)).collect();
        let whole = Baked::new(&world);
        let mut tally = Tally::default();
        tally.add(&world, &whole, &rays, &(hits.clone(), any.clone()));
        println!("{kind:?}: {tally:?}");
        assert_eq!(tally.wrong, 0, "{kind:?}: {tally:?}");
        assert!(3 * tally.hits > tally.rays, "{kind:?}: {tally:?}");
        // Seen to fail: a table that is off by one triangle.
        let shifted = hits.iter().map(|hit| match hit.is_hit() {
            true => SceneHit { triangle: hit.triangle ^ 1, ..*hit },
            false => *hit,
        });
        let mut wrong = Tally::default();
        wrong.add(&world, &whole, &rays, &(shifted.collect(), any));
        assert!(2 * wrong.wrong > tally.hits, "{kind:?}: {wrong:?}");
    }
}

/// What is wrong in a scene or in its answers is seen, in each kind of scene.
#[test]
fn faults_are_found() {
    for (number, kind) in KINDS.into_iter().enumerate() {
        let again = || scene(kind, 70 + number as u64);
        let scene = again();
        let right = built(&scene);
        let world = World::new(&scene, right.scene()).expect("bounds");
        let (baked, rays) = (Baked::new(&world), rays(&world, 4_000, 80));
        let own = answers(&*right, &rays);
        let wrong = |answers: &Answers| {
            let mut tally = Tally::default();
            tally.add(&world, &baked, &rays, answers);
            tally.wrong
        };
        assert_eq!(wrong(&own), 0, "{kind:?}");
        let with = |change: &dyn Fn(&mut Instance, f64)| {
            // Of the instance that is hit most.
            let hits = |name: u32| own.0.iter().filter(|hit| hit.instance == name).count();
            let object = world.objects.iter().max_by_key(|object| hits(object.name.0));
            let object = object.expect("an object");
            let (mut scene, mut becomes) = (again(), object.instance);
            change(&mut becomes, object.bound(&rays[0]));
            scene.set_instance(object.name, becomes).expect("an instance");
            wrong(&answers(&*built(&scene), &rays))
        };
        let moved = with(&|own, bound| own.transform[0][3] += 4.0 * bound as f32);
        let unseen = with(&|own, _| own.mask = 0);
        println!("{kind:?}: moved {moved}, unseen {unseen}");
        // Most rays that hit it are near to no edge.
        assert!(moved > 10, "{kind:?}: an instance that is moved by a few bounds: {moved}");
        assert!(unseen > 10, "{kind:?}: an instance that nothing hits: {unseen}");

        let each = |change: &dyn Fn(usize, &mut SceneHit)| {
            let mut changed = own.clone();
            let found = changed.0.iter_mut().enumerate().filter(|(_, hit)| hit.is_hit());
            // Every fiftieth hit.
            found.step_by(50).for_each(|(i, hit)| change(i, hit));
            for (any, hit) in changed.1.iter_mut().zip(&changed.0) {
                *any = hit.is_hit();
            }
            wrong(&changed)
        };
        let hits = own.0.iter().filter(|hit| hit.is_hit()).count().div_ceil(50) as u64;
        let lost = each(&|_, hit| *hit = SceneHit::MISS);
        let behind = each(&|i, hit| {
            let ray = rays[i].with_limits(hit.t + hit.t.abs() * 1e-3, f32::INFINITY);
            *hit = right.closest_hit(&ray, &SceneOptions::default()).unwrap_or(*hit);
        });
        let distances = each(&|_, hit| hit.t *= 1.0 + 2f32.powi(-8));
        let weights = each(&|_, hit| hit.u = (hit.u - 0.125).abs());
        for (what, found) in
            [("lost", lost), ("behind", behind), ("distances", distances), ("weights", weights)]
        {
            println!("{kind:?}: {what} {found} of {hits}");
            assert!(3 * found > hits && found <= hits, "{kind:?}: {what}, {found} of {hits}");
        }
        let mut changed = own.clone();
        changed.1[7] ^= true;
        assert_eq!(wrong(&changed), 1, "{kind:?}: any hits");
    }
}
