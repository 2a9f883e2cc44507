//! Packed scenes, traced by the reference of a device's kernels, against all instances asked one after the other.

use splitplane_core::arithmetic::{Arithmetic, Hostile, Strict};
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::scene::packed::{ALWAYS, MIRRORED, PackedInstance, PackedScene};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::layout::{SceneBatch, culling_bits};
use splitplane_core::ray::{Culling, Ray};
use splitplane_core::scene::{
    GeometryId, IgnoredTriangle, InstanceId, SceneHit, SceneOptions, TOP_WIDTH,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};

fn batch(options: &SceneOptions<'_>) -> SceneBatch {
    let ignored = options.ignore.map(|own| [own.instance.0, own.triangle]);
    let [ignored_instance, ignored_triangle] = ignored.unwrap_or([u32::MAX, 0]);
    SceneBatch {
        count: 0,
        culling: culling_bits(options.culling),
        mask: options.mask,
        ignored_instance,
        ignored_triangle,
        any: 0,
        zero: 0,
        way: 0,
    }
}

fn traced<A: Arithmetic>(
    packed: &PackedScene,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Vec<([u32; 6], bool)> {
    let batch = batch(options);
    let one = |ray: &Ray| {
        let hit = packed.trace::<A>(ray, &batch);
        let any = packed.trace::<A>(ray, &SceneBatch { any: 1, ..batch });
        (bytemuck::cast(hit), any.is_hit())
    };
    rays.iter().map(one).collect()
}

fn expected(
    scene: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Vec<([u32; 6], bool)> {
    let one = |ray: &Ray| {
        let hit: SceneHit = scene.scene().answer_by_all(ray, options);
        (bytemuck::cast(hit), scene.scene().answer_by_all(ray, options))
    };
    rays.iter().map(one).collect()
}

/// The sets of options that each scene is asked with.
fn asked(names: &[InstanceId]) -> Vec<SceneOptions<'static>> {
    let all = SceneOptions::default();
    vec![
        all,
        SceneOptions { culling: Culling::Back, ..all },
        SceneOptions { culling: Culling::Front, mask: 0x0f0f_00ff, ..all },
        SceneOptions {
            ignore: Some(IgnoredTriangle { instance: names[3], triangle: 2 }),
            mask: 0x8000_0001,
            ..all
        },
    ]
}

#[test]
fn packed_scenes_give_the_hits_of_all_instances() {
    let mut found = 0;
    for (number, kind) in Kind::ALL.into_iter().enumerate() {
        let (scene, names) = objects::scene(kind, 60, 500 + number as u64);
        let rays = objects::rays(&scene, 1200, 600 + number as u64);
        let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
        let packed = built.scene().packed().unwrap();
        assert_eq!(packed.triangles.len(), built.scene().packed_sizes().triangles);
        for options in asked(&names) {
            let all = expected(&*built, &rays, &options);
            for (which, own) in [
                ("strict", traced::<Strict>(&packed, &rays, &options)),
                ("hostile", traced::<Hostile>(&packed, &rays, &options)),
            ] {
                for (i, ray) in rays.iter().enumerate() {
                    assert_eq!(own[i], all[i], "{kind:?} {which} {ray:?} {options:?}");
                }
            }
            found += all.iter().filter(|(_, any)| *any).count();
        }
    }
    assert!(found > 8_000, "{found}");
}

/// Spheres and capsules, among meshes.
#[test]
fn packed_shapes_give_the_hits_of_all_instances() {
    let mut round = 0;
    for (number, kind) in Kind::ALL.into_iter().enumerate() {
        let (mut scene, names) = objects::scene(kind, 60, 1100 + number as u64);
        let meshes = scene.geometries().count() as u32;
        let rays = objects::rays(&scene, 900, 1200 + number as u64);
        objects::add_shapes(&mut scene, &names, 1300 + number as u64);
        let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
        let packed = built.scene().packed().unwrap();
        assert_eq!(packed.shapes.len(), built.scene().packed_sizes().shapes);
        let mut options = asked(&names);
        options[3].ignore = Some(IgnoredTriangle { instance: names[0], triangle: 2 });
        for options in &options {
            let all = expected(&*built, &rays, options);
            let strict = traced::<Strict>(&packed, &rays, options);
            let hostile = traced::<Hostile>(&packed, &rays, options);
            for (i, ray) in rays.iter().enumerate() {
                assert_eq!(strict[i], all[i], "{kind:?} {ray:?} {options:?}");
                assert_eq!(hostile[i], all[i], "{kind:?} {ray:?} {options:?}");
            }
            round += all.iter().filter(|(hit, any)| *any && hit[4] >= meshes).count();
        }
        if kind != Kind::Ordinary {
            continue;
        }
        let all = expected(&*built, &rays, &options[0]);
        for fault in 0..3 {
            let mut faulty = packed.clone();
            match fault {
                0 => each(&mut faulty, |own| own.opacity = 0),
                1 => each(&mut faulty, |own| own.first_triangle += u32::from(own.opacity != 0)),
                _ => faulty.shapes.iter_mut().flatten().for_each(|word| *word ^= 1),
            }
            if fault == 1 {
                faulty.shapes.push([0; 64]);
            }
            if fault == 2 {
                // Children of nodes stay.
                for (block, whole) in faulty.shapes.iter_mut().zip(&packed.shapes) {
                    block[56..].copy_from_slice(&whole[56..]);
                }
            }
            assert!(traced::<Strict>(&faulty, &rays, &options[0]) != all, "fault {fault}");
        }
    }
    assert!(round > 400, "{round}");
}

/// Opacity masks of all levels, between geometries that have none.
#[test]
fn packed_masks_give_the_hits_of_all_instances() {
    let (mut found, mut without) = (0, 0);
    for (number, kind) in Kind::ALL.into_iter().enumerate() {
        let (mut scene, names) = objects::scene(kind, 60, 800 + number as u64);
        let rays = objects::rays(&scene, 600, 900 + number as u64);
        let build = BuildOptions::default();
        let plain = CpuBackend::new().build_scene(&scene, &build).unwrap();
        objects::mask(&mut scene, 1000 + number as u64);
        let built = CpuBackend::new().build_scene(&scene, &build).unwrap();
        let packed = built.scene().packed().unwrap();
        assert_eq!(packed.references.len(), built.scene().packed_sizes().references);
        for options in asked(&names) {
            let all = expected(&*built, &rays, &options);
            let unmasked = expected(&*plain, &rays, &options);
            without += (0..rays.len()).filter(|&i| all[i] != unmasked[i]).count();
            let strict = traced::<Strict>(&packed, &rays, &options);
            let hostile = traced::<Hostile>(&packed, &rays, &options);
            for (i, ray) in rays.iter().enumerate() {
                assert_eq!(strict[i], all[i], "{kind:?} {ray:?} {options:?}");
                assert_eq!(hostile[i], all[i], "{kind:?} {ray:?} {options:?}");
            }
            found += all.iter().filter(|(_, any)| *any).count();
        }
        // Another level, another first triangle, another place, and a word of cells.
        let has_cells = |own: &&PackedInstance| {
            let geometry = built.scene().geometry(GeometryId(own.sides >> 3)).unwrap();
            geometry.opacity().is_some_and(|mask| !mask.words().is_empty())
        };
        let masked = packed.instances.iter().filter(has_cells);
        let masks: Vec<usize> = masked.map(|own| own.opacity as usize).collect();
        let shift = |scene: &mut PackedScene, by: usize, change: fn(&mut u32)| {
            let mut places = masks.clone();
            places.sort_unstable();
            places.dedup();
            for at in places {
                change(&mut scene.references[at + by]);
            }
        };
        let options = SceneOptions::default();
        let all = expected(&*built, &rays, &options);
        if kind != Kind::Ordinary {
            continue;
        }
        for fault in 0..4 {
            let mut faulty = packed.clone();
            match fault {
                0 => shift(&mut faulty, 0, |level| *level = level.saturating_sub(1)),
                1 => shift(&mut faulty, 1, |first| *first = first.saturating_sub(1)),
                2 => each(&mut faulty, |own| own.opacity = 0),
                _ => shift(&mut faulty, 2, |cells| *cells = !*cells),
            }
            assert!(traced::<Strict>(&faulty, &rays, &options) != all, "fault {fault}");
        }
    }
    assert!(found > 4_000 && without > 1_000, "{found} {without}");
}

/// What is wrong, and what makes it so.
type Fault = (&'static str, fn(&mut PackedScene));

/// Nothing of a packed scene is without effect.
#[test]
fn planted_faults_are_found() {
    let mut never: Vec<&str> = Vec::new();
    let faults: [Fault; 9] = [
        ("boxes without their slack", |scene| {
            for node in &mut scene.box_nodes {
                for slot in 0..TOP_WIDTH {
                    for axis in 0..3 {
                        let middle = 0.5 * (node.lo[axis][slot] + node.hi[axis][slot]);
                        let less = |x: f32| middle + (x - middle) * 0.99;
                        node.lo[axis][slot] = less(node.lo[axis][slot]);
                        node.hi[axis][slot] = less(node.hi[axis][slot]);
                    }
                }
            }
        }),
        ("a child that is lost", |scene| {
            for node in &mut scene.box_nodes {
                node.children[1] = u32::MAX;
            }
        }),
        ("boxes that count everywhere, or nowhere", |scene| {
            for child in scene.box_nodes.iter_mut().flat_map(|node| &mut node.children) {
                *child = if *child == u32::MAX { *child } else { *child & !ALWAYS };
            }
        }),
        ("masks", |scene| each(scene, |own| own.mask ^= 0x00ff_0001)),
        ("reflections", |scene| each(scene, |own| own.sides ^= MIRRORED)),
        ("sides", |scene| each(scene, |own| own.sides ^= 1)),
        ("first triangles", |scene| {
            each(scene, |own| {
                own.first_triangle = own.first_triangle.saturating_sub(1);
            });
        }),
        ("the last bit of inverses", |scene| {
            each(scene, |own| own.inverse[1][2] = own.inverse[1][2].next_up());
        }),
        ("slack of planes", |scene| each(scene, |own| own.slack = -1.0)),
    ];
    let cases = [Kind::Ordinary, Kind::IllConditioned, Kind::Wide].map(|kind| {
        let (scene, names) = objects::scene(kind, 60, 700);
        let rays = objects::rays(&scene, 1200, 701);
        let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
        let packed = built.scene().packed().unwrap();
        let options = asked(&names);
        let all: Vec<_> = options.iter().map(|options| expected(&*built, &rays, options)).collect();
        (packed, rays, options, all)
    });
    for (what, fault) in faults {
        let is_found = cases.iter().any(|(packed, rays, options, all)| {
            let mut faulty = packed.clone();
            fault(&mut faulty);
            faulty != *packed
                && (0..all.len()).any(|i| traced::<Strict>(&faulty, rays, &options[i]) != all[i])
        });
        if !is_found {
            never.push(what);
        }
    }
    assert_eq!(never, [""; 0], "faults that no ray finds");
}

fn each(scene: &mut PackedScene, change: impl Fn(&mut PackedInstance)) {
    scene.instances.iter_mut().for_each(change);
}
