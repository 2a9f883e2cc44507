//! Edits of a scene in any order, brought up to date after some of them: what comes out is what a scene built from
//! nothing is, and the same as a list of what should be there.

use core::ops::ControlFlow;
use std::collections::{BTreeMap, BTreeSet};

use crate::source::Source;
use splitplane_core::backend::scene::{SceneAccelerator, TopUpdate};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{
    GeometryId, IDENTITY, Instance, InstanceId, OpacityMask, Scene, SceneError, SceneHit,
    SceneOptions, Transform,
};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::random::Random;

thread_local! {
    static BACKEND: CpuBackend = CpuBackend::new();
}

/// Edits of one input.
const EDITS: usize = 40;
/// Instances of one scene, but for those that come as a crowd.
const INSTANCES: usize = 24;

/// What updates came across: sequences that reach nothing test nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reached {
    /// Updates that came to their end.
    pub updates: u64,
    /// Most instances of a scene.
    pub instances: usize,
    /// Instances that changed.
    pub changed: u64,
    /// Updates that gave several nodes of the tree over instances new boxes.
    pub refits: u64,
    /// Updates that built this tree anew although no instance had come or gone, since it was worn.
    pub worn: u64,
    /// Updates that were cancelled first.
    pub cancelled: u64,
}

impl Reached {
    /// Both together.
    pub fn and(self, other: Reached) -> Reached {
        Reached {
            updates: self.updates + other.updates,
            instances: self.instances.max(other.instances),
            changed: self.changed + other.changed,
            refits: self.refits + other.refits,
            worn: self.worn + other.worn,
            cancelled: self.cancelled + other.cancelled,
        }
    }
}

/// Bytes as edits, for the CPU backend.
pub fn run(data: &[u8]) {
    reached(data);
}

/// The same, and what was reached.
pub fn reached(data: &[u8]) -> Reached {
    crate::single_thread();
    BACKEND.with(|backend| run_on(data, backend, |scene| scene))
}

/// The same, with what is built given through `fault`.
pub fn run_on(
    data: &[u8],
    backend: &dyn Backend,
    fault: impl Fn(Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator>,
) -> Reached {
    let source = &mut Source::new(data);
    let options = BuildOptions::default();
    let mut scene = Scene::new();
    let mut model = Model::default();
    let built = backend.build_scene(&scene, &options).expect("an empty scene");
    let mut built = fault(built);
    let mut reached = Reached::default();
    for _ in 0..EDITS {
        edit(source, &mut scene, &mut model);
        model.check(&scene);
        if source.once_in(4) || source.is_empty() {
            update(source, backend, (&scene, &mut model), &mut built, &mut reached);
        }
        if source.is_empty() {
            break;
        }
    }
    update(source, backend, (&scene, &mut model), &mut built, &mut reached);
    reached
}

/// What should be there.
#[derive(Default)]
struct Model {
    /// Triangles; none for shapes.
    geometries: BTreeMap<u32, Vec<[[f32; 3]; 3]>>,
    /// Those that consist of shapes.
    shapes: BTreeSet<u32>,
    instances: BTreeMap<u32, Instance>,
    /// Whether instances came or went since the last update.
    other_instances: bool,
}

impl Model {
    fn check(&self, scene: &Scene) {
        let instances: Vec<_> = scene.instances().map(|(name, own)| (name.0, *own)).collect();
        let expected: Vec<_> = self.instances.iter().map(|(&name, &own)| (name, own)).collect();
        assert_eq!(instances, expected);
        assert_eq!(scene.len(), expected.len());
        let geometries: Vec<u32> = scene.geometries().map(|(name, _)| name.0).collect();
        assert_eq!(geometries, self.geometries.keys().copied().collect::<Vec<_>>());
    }
}

fn triangles(source: &mut Source<'_>) -> Vec<[[f32; 3]; 3]> {
    let count = source.below(9);
    (0..count).map(|_| [(); 3].map(|()| [(); 3].map(|()| source.number()))).collect()
}

fn shapes(source: &mut Source<'_>) -> Shapes {
    let count = source.below(9);
    if source.once_in(2) {
        let sphere =
            |_| Sphere { centre: [(); 3].map(|()| source.number()), radius: source.number() };
        return Shapes::Spheres((0..count).map(sphere).collect());
    }
    let capsule = |_| Capsule {
        ends: [(); 2].map(|()| [(); 3].map(|()| source.number())),
        radius: source.number(),
    };
    Shapes::Capsules((0..count).map(capsule).collect())
}

pub(crate) fn transform(source: &mut Source<'_>) -> Transform {
    let mut out = IDENTITY;
    match source.below(4) {
        0 => {}
        1 => out.iter_mut().for_each(|row| row[3] = source.step()),
        2 => {
            for (axis, row) in out.iter_mut().enumerate() {
                (row[axis], row[3]) = (source.number(), source.step());
            }
        }
        _ => out.iter_mut().for_each(|row| *row = [(); 4].map(|()| source.number())),
    }
    out
}

fn instance(source: &mut Source<'_>, geometry: GeometryId) -> Instance {
    Instance {
        mask: source.pick(&[u32::MAX, 1, 2, 3, 0]),
        id: source.below(100) as u32,
        culling: source.pick(&[Culling::None, Culling::Back, Culling::Front]),
        ..Instance::new(geometry, transform(source))
    }
}

/// A mesh of a few small triangles, and instances of it about the origin until there are `count` in all. A few bytes make a tree of
/// several levels so, which edits one by one would never reach.
fn crowd(random: &mut Random, count: usize, scene: &mut Scene, model: &mut Model) {
    let mut around = |size: f64| (size * (random.unit() - 0.5)) as f32;
    let small: Vec<_> = (0..4).map(|_| [(); 3].map(|()| [(); 3].map(|()| around(1.0)))).collect();
    let name = scene.add_mesh(&Mesh::soup(&small).expect("a mesh")).expect("a name");
    model.geometries.insert(name.0, small);
    while model.instances.len() < count {
        let mut transform = IDENTITY;
        transform.iter_mut().for_each(|row| row[3] = around(6.0));
        let own = Instance::new(name, transform);
        model.instances.insert(scene.add_instance(own).expect("a name").0, own);
    }
    model.other_instances = true;
}

/// Moves one in `part` instances by up to `reach`.
fn stir(random: &mut Random, part: usize, reach: f64, scene: &mut Scene, model: &mut Model) {
    for (&name, own) in &mut model.instances {
        if random.below(part) > 0 {
            continue;
        }
        let mut to = own.transform;
        to.iter_mut().for_each(|row| row[3] += (reach * (random.unit() - 0.5)) as f32);
        match scene.move_instance(InstanceId(name), to) {
            Ok(()) => own.transform = to,
            Err(error) => refusal(name, &to, error),
        }
    }
}

/// Whether a transform is refused, and for what.
fn refusal(name: u32, transform: &Transform, error: SceneError) {
    let finite = transform.iter().flatten().all(|x| x.is_finite());
    match error {
        SceneError::NonFiniteTransform { instance, row, column } => {
            assert!(instance == name && !transform[row][column].is_finite());
        }
        SceneError::SingularTransform { instance } => assert!(finite && instance == name),
        error => panic!("{error}"),
    }
    crate::check_message(&error.to_string(), &format!("instance {name} "));
}

/// One edit, of both.
fn edit(source: &mut Source<'_>, scene: &mut Scene, model: &mut Model) {
    // Names that are there, and some that are not.
    let name = |source: &mut Source<'_>, most: usize| source.below(most + 1) as u32;
    let geometry = GeometryId(name(source, scene.geometry_names()));
    let one = InstanceId(name(source, scene.instance_names()));
    let is_there = model.instances.get(&one.0).copied();
    match source.below(13) {
        0 => {
            let triangles = triangles(source);
            let added = scene.add_mesh(&Mesh::soup(&triangles).expect("a mesh"));
            assert!(model.geometries.insert(added.expect("a name").0, triangles).is_none());
        }
        1 => {
            let triangles = triangles(source);
            let replaced = scene.replace_mesh(geometry, &Mesh::soup(&triangles).expect("a mesh"));
            let is_mesh = !model.shapes.contains(&geometry.0);
            assert_eq!(replaced.is_ok(), is_mesh && model.geometries.contains_key(&geometry.0));
            if replaced.is_ok() {
                model.geometries.insert(geometry.0, triangles);
            }
        }
        2 => {
            let used = model.instances.values().filter(|own| own.geometry == geometry).count();
            match scene.remove_geometry(geometry) {
                Ok(()) => {
                    assert!(used == 0 && model.geometries.remove(&geometry.0).is_some());
                    model.shapes.remove(&geometry.0);
                }
                Err(SceneError::GeometryInUse { instances, instance, .. }) => {
                    assert_eq!(instances as usize, used);
                    assert_eq!(model.instances[&instance].geometry, geometry);
                }
                Err(error) => {
                    assert_eq!(error, SceneError::UnknownGeometry { geometry: geometry.0 });
                    assert!(!model.geometries.contains_key(&geometry.0));
                }
            }
        }
        3 => match scene.remove_instance(one) {
            Ok(()) => {
                model.other_instances = true;
                assert!(model.instances.remove(&one.0).is_some());
            }
            Err(error) => {
                assert_eq!(error, SceneError::UnknownInstance { instance: one.0 });
                assert!(is_there.is_none());
            }
        },
        4 => {
            let to = transform(source);
            match (scene.move_instance(one, to), is_there) {
                (Ok(()), Some(was)) => {
                    model.instances.insert(one.0, Instance { transform: to, ..was });
                }
                (Err(error), Some(_)) => refusal(one.0, &to, error),
                (moved, None) => {
                    assert_eq!(moved, Err(SceneError::UnknownInstance { instance: one.0 }));
                }
            }
        }
        5 => {
            let mask = source.bits();
            let masked = scene.set_mask(one, mask);
            assert_eq!(masked.is_ok(), is_there.is_some());
            model.instances.entry(one.0).and_modify(|own| own.mask = mask);
        }
        6 => {
            let set = shapes(source);
            if source.once_in(2) {
                let added = scene.add_shapes(set).expect("a name").0;
                assert!(model.geometries.insert(added, Vec::new()).is_none());
                assert!(model.shapes.insert(added));
            } else {
                let replaced = scene.replace_shapes(geometry, set);
                assert_eq!(replaced.is_ok(), model.shapes.contains(&geometry.0));
            }
        }
        7 => {
            let triangles = model.geometries.get(&geometry.0).map_or(0, Vec::len);
            let (bits, level) = (source.bits(), source.below(3) as u32);
            let is_opaque =
                |triangle, [u, _]: [f32; 2]| bits >> (triangle % 32) & 1 != 0 || u > 0.5;
            let mask = OpacityMask::new(triangles, level, is_opaque).expect("memory");
            let set = scene.set_opacity(geometry, Some(mask));
            let is_mesh = !model.shapes.contains(&geometry.0);
            assert_eq!(set.is_ok(), is_mesh && model.geometries.contains_key(&geometry.0));
        }
        8 => {
            let (seed, count) = (source.long(), source.pick(&[10, 24, 70, 200]));
            crowd(&mut Random::new(seed), count, scene, model);
        }
        9 => {
            let (seed, part) = (source.long(), source.pick(&[1, 2, 16]));
            let reach = source.pick(&[0.25, 2.0, 64.0]);
            stir(&mut Random::new(seed), part, reach, scene, model);
        }
        _ if model.instances.len() < INSTANCES => {
            let own = instance(source, geometry);
            let next = scene.instance_names() as u32;
            match scene.add_instance(own) {
                Ok(name) => {
                    model.other_instances = true;
                    assert!(model.instances.insert(name.0, own).is_none());
                }
                Err(SceneError::UnknownGeometry { .. }) => {
                    assert!(!model.geometries.contains_key(&geometry.0));
                }
                Err(
                    error @ (SceneError::NonFiniteTransform { instance, .. }
                    | SceneError::SingularTransform { instance }),
                ) => {
                    assert!(instance <= next && !model.instances.contains_key(&instance));
                    refusal(instance, &own.transform, error);
                }
                Err(error) => panic!("{error}"),
            }
        }
        _ => {}
    }
}

/// Brings the scene up to date, maybe after a call that is cancelled, and holds it to one that is built from nothing.
fn update(
    source: &mut Source<'_>,
    backend: &dyn Backend,
    (scene, model): (&Scene, &mut Model),
    built: &mut Box<dyn SceneAccelerator>,
    reached: &mut Reached,
) {
    let options = BuildOptions::default();
    if source.once_in(3) {
        let before = built.scene().digest();
        let stop = |_: &Progress| ControlFlow::Break(());
        let cancelled = BuildOptions { watch: Some(&stop), ..options };
        if backend.update_scene(built, scene, &cancelled).is_err() {
            assert_eq!(built.scene().digest(), before);
            reached.cancelled += 1;
        }
    }
    let report = backend.update_scene(built, scene, &options).expect("an update");
    let others = core::mem::take(&mut model.other_instances);
    *reached = reached.and(Reached {
        updates: 1,
        instances: scene.len(),
        changed: report.instances_changed.into(),
        refits: u64::from(report.top == TopUpdate::Refitted && report.top_nodes_changed > 1),
        worn: u64::from(report.top == TopUpdate::Rebuilt && !others),
        cancelled: 0,
    });
    let fresh = backend.build_scene(scene, &options).expect("a scene");
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    let rays: Vec<Ray> = (0..12)
        .map(|_| {
            let mut point = || [(); 3].map(|()| source.step());
            Ray::segment(point(), point()).with_limits(-1.0, f32::INFINITY)
        })
        .collect();
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        let query = SceneOptions { accuracy, mask: 1, ..SceneOptions::default() };
        let of = |scene: &dyn SceneAccelerator| {
            let mut hits = vec![SceneHit::MISS; rays.len()];
            scene.closest_hits(&rays, &mut hits, &query).expect("hits");
            hits
        };
        let (hits, expected) = (of(&**built), of(&*fresh));
        let same = |a: &[SceneHit], b: &[SceneHit]| {
            bytemuck::cast_slice::<_, u8>(a) == bytemuck::cast_slice::<_, u8>(b)
        };
        assert!(same(&hits, &expected), "{hits:?} {expected:?}");
        for (ray, hit) in rays.iter().zip(&hits) {
            let by_all: SceneHit = built.scene().answer_by_all(ray, &query);
            assert!(same(&[by_all], &[*hit]), "{ray:?} {hit:?} {by_all:?}");
            assert_eq!(built.any_hit(ray, &query), hit.is_hit(), "{ray:?}");
        }
    }
}
