//! Chosen instances as one mesh, against the scene from which they were baked.

use crate::common::{built, coarse};
use splitplane_core::backend::scene::{SceneAccelerator, SceneAllHitsOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{
    BakeError, BakedTable, GeometryId, IDENTITY, Instance, InstanceId, OpacityMask, Scene,
    SceneError, SceneHit, SceneOptions, translation,
};
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;

fn coarse_rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let mut point = |reach| random.point(reach).map(|x| (x * 256.0).round() / 256.0);
    let mut rays = Vec::new();
    while rays.len() < count {
        let ray = Ray::segment(point(12.0), point(6.0)).with_limits(0.0, f32::INFINITY);
        if ray.direction != [0.0; 3] {
            rays.push(ray);
        }
    }
    rays
}

/// Ten instances that move by exact amounts, some mirrored, some of a mesh with indices.
fn exact_scene() -> (Scene, Vec<InstanceId>) {
    let mut scene = Scene::new();
    let ball = scene.add_mesh(&Mesh::soup(&coarse()).unwrap()).unwrap();
    let boxes = scenes::grid_boxes(2);
    let boxes = scene.add_mesh(&boxes.mesh()).unwrap();
    let mut names = Vec::new();
    for (i, by) in
        [[4.0, 0.0, 0.0], [0.0, -2.0, 0.5], [-4.0, 4.0, 0.25], [0.0, 0.0, -8.0], [2.0; 3]]
            .into_iter()
            .enumerate()
    {
        let geometry = if i == 3 { boxes } else { ball };
        names.push(scene.add_instance(Instance::new(geometry, translation(by))).unwrap());
        let mut mirrored = translation(by.map(|x: f32| x * -0.5));
        mirrored[0][0] = -1.0;
        names.push(scene.add_instance(Instance::new(ball, mirrored)).unwrap());
    }
    (scene, names)
}

fn hits_of(
    scene: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Vec<SceneHit> {
    let mut hits = vec![SceneHit::MISS; rays.len()];
    scene.closest_hits(rays, &mut hits, options).expect("hits");
    hits
}

fn words(hits: &[SceneHit]) -> Vec<[u32; 6]> {
    hits.iter().map(|hit| bytemuck::cast(*hit)).collect()
}

#[test]
fn exact_transforms_give_the_same_hits_bit_for_bit() {
    let (scene, names) = exact_scene();
    // Whole runs, so that ties are decided as before.
    for groups in
        [vec![&names[..]], vec![&names[2..5], &names[6..8]], vec![&names[9..], &names[..1]]]
    {
        let (baked, table) = scene.bake(&groups).unwrap();
        let chosen: usize = groups.iter().map(|group| group.len()).sum();
        assert_eq!(baked.len(), scene.len() - chosen + groups.len());
        let (before, after) = (built(&scene), built(&baked));
        let rays = coarse_rays(6_000, 3);
        let (mut found, mut of_groups) = (0, 0);
        for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
            for culling in [Culling::None, Culling::Back, Culling::Front] {
                let options = SceneOptions { accuracy, culling, ..SceneOptions::default() };
                let expected = hits_of(&*before, &rays, &options);
                let own = hits_of(&*after, &rays, &options);
                let own: Vec<_> = own
                    .iter()
                    .map(|hit| {
                        let original = table.original_hit(hit);
                        of_groups += usize::from(original != *hit);
                        original
                    })
                    .collect();
                assert_eq!(words(&own), words(&expected), "{accuracy:?} {culling:?}");
                found += own.iter().filter(|hit| hit.is_hit()).count();
            }
        }
        assert!(found > 4_000 && of_groups > 500, "{found} {of_groups}");
        // All crossings, with their sides.
        let all = |scene: &dyn SceneAccelerator| {
            scene.all_hits(&rays[..1_000], &SceneAllHitsOptions::default()).unwrap()
        };
        let (before, after) = (all(&*before), all(&*after));
        for ray in 0..1_000 {
            let before: Vec<_> =
                before.of(ray).iter().map(|c| (words(&[c.hit]), c.front)).collect();
            let after = after.of(ray).iter();
            let after: Vec<_> =
                after.map(|c| (words(&[table.original_hit(&c.hit)]), c.front)).collect();
            assert_eq!(before, after);
        }
    }
}

/// Every triangle of every instance once, by the corners that it has in the world.
fn check_table(scene: &Scene, baked: &Scene, table: &BakedTable, groups: &[&[InstanceId]]) {
    let mut seen = std::collections::BTreeSet::new();
    for (name, instance) in baked.instances() {
        let mesh = baked.geometry(instance.geometry).unwrap().clone();
        if mesh.shapes().is_some() {
            continue;
        }
        let mesh = mesh.mesh();
        let is_group = table.groups().any(|own| own == (name, instance.geometry));
        assert_eq!(is_group, groups.iter().any(|group| group.iter().min() == Some(&name)));
        if is_group {
            assert_eq!(instance.transform, IDENTITY);
        }
        for triangle in 0..mesh.len() as u32 {
            let original = table.original(name, triangle);
            assert_eq!(original.is_some(), is_group);
            let (old, geometry, number) = original.unwrap_or((name, instance.geometry, triangle));
            assert!(seen.insert((old, number)));
            let before = scene.instance(old).unwrap();
            assert_eq!(before.geometry, geometry);
            assert_eq!(
                (before.mask, before.id, before.culling),
                (instance.mask, instance.id, instance.culling)
            );
            let corners = scene.geometry(geometry).unwrap().mesh().triangle(number as usize);
            let expected = match is_group {
                true => corners.map(|p| {
                    objects::in_world(&before.transform, p.map(f64::from)).map(|x| x as f32)
                }),
                false => corners,
            };
            assert_eq!(mesh.triangle(triangle as usize), expected, "{name:?} {triangle}");
        }
    }
    let all = scene.instances().map(|(_, own)| scene.geometry(own.geometry).unwrap().mesh().len());
    assert_eq!(seen.len(), all.sum::<usize>());
}

#[test]
fn the_table_names_every_triangle() {
    let (scene, names) = exact_scene();
    let shuffled = [names[7], names[2], names[4], names[3]];
    let groups: [&[InstanceId]; 4] = [&names[8..9], &shuffled, &[], &names[..2]];
    let (baked, table) = scene.bake(&groups).unwrap();
    check_table(&scene, &baked, &table, &groups);
    assert!(table.bytes() < 400, "{}", table.bytes());
    // What is not a group's is no business of the table.
    assert_eq!(table.original(names[9], 0), None);
    // Nor is what the group does not have.
    for (name, geometry) in table.groups() {
        let triangles = baked.geometry(geometry).unwrap().mesh().len() as u32;
        assert!(table.original(name, triangles - 1).is_some());
        assert_eq!([triangles, u32::MAX].map(|beyond| table.original(name, beyond)), [None; 2]);
    }
    assert_eq!(table.original_hit(&SceneHit::MISS), SceneHit::MISS);
    // A geometry whose last instance went is gone, others stay and share their arrays.
    assert_eq!(baked.geometries().count(), 2 + 3);
    let ball = GeometryId(0);
    assert!(std::sync::Arc::ptr_eq(scene.geometry(ball).unwrap(), baked.geometry(ball).unwrap()));
    let (all, table) = scene.bake(&[&names]).unwrap();
    assert_eq!(all.geometries().count(), 1);
    check_table(&scene, &all, &table, &[&names]);
    // Baked again, and edited: a description like any other.
    let (mut again, _) = all.bake(&[&names[..1]]).unwrap();
    again.move_instance(names[0], translation([1.0; 3])).unwrap();
    let geometry = again.instance(names[0]).unwrap().geometry;
    let next = again.add_instance(Instance::in_place(geometry)).unwrap();
    assert!(next != names[0] && names.contains(&next), "{next:?}");
}

/// Random scenes of turned, sheared, far and mirrored instances: all of the table, again.
#[test]
fn tables_of_random_scenes() {
    for (seed, kind) in
        [Kind::Ordinary, Kind::IllConditioned, Kind::Far, Kind::Scales].into_iter().enumerate()
    {
        let (mut scene, names) = objects::scene(kind, 40, seed as u64);
        for name in &names {
            let own = *scene.instance(*name).unwrap();
            let plain = Instance { mask: 7, id: 1, culling: Culling::Back, ..own };
            scene.set_instance(*name, plain).unwrap();
        }
        let groups: [&[InstanceId]; 2] = [&names[5..20], &names[25..33]];
        let (baked, table) = scene.bake(&groups).unwrap();
        check_table(&scene, &baked, &table, &groups);
    }
}

/// A baked group stands in several places, in two levels: hits know the part, in which house of which row.
#[test]
fn baked_groups_may_have_instances_and_be_baked_again() {
    let mut parts = Scene::new();
    let mesh = scenes::grid_boxes(1);
    let brick = parts.add_mesh(&mesh.mesh()).unwrap();
    let wall: Vec<_> = [0.0, 2.0, 4.0]
        .map(|x| parts.add_instance(Instance::new(brick, translation([x, 0.0, 0.0]))).unwrap())
        .to_vec();
    let alone = parts.add_instance(Instance::new(brick, translation([0.0, 64.0, 0.0]))).unwrap();
    let (mut houses, of_house) = parts.bake(&[&wall, &[alone]]).unwrap();
    let (first, house) = of_house.groups().next().unwrap();
    assert_eq!(first, wall[0]);
    let mut row = vec![first];
    for z in [8.0, 16.0] {
        row.push(houses.add_instance(Instance::new(house, translation([0.0, 0.0, z]))).unwrap());
    }
    // Names that baking freed were given again; a group's triangles lie in the order of names.
    row.sort_unstable();
    let (mut street, of_row) = houses.bake(&[&row]).unwrap();
    let (_, whole) = of_row.groups().next().unwrap();
    let other = street.add_instance(Instance::new(whole, translation([0.0, 128.0, 0.0]))).unwrap();
    let triangles = mesh.mesh().len() as u32;
    // Hits say which row, by the instance, and have what names the rest.
    let built = built(&street);
    for (name, y) in [(row[0], 0.0), (other, 128.0)] {
        let middle =
            [0, 1, 2].map(|k| mesh.mesh().triangle(0).map(|p| p[k]).iter().sum::<f32>() / 3.0);
        let to = [middle[0], middle[1] + y, middle[2]];
        let ray = Ray::segment(to.map(|x| x - 16.0), to).with_limits(0.0, f32::INFINITY);
        let hit = built.closest_hit(&ray, &SceneOptions::default()).expect("a hit");
        assert_eq!((hit.instance, hit.geometry), (name.0, whole.0));
        assert!(of_row.original_part(whole, hit.triangle).is_some());
    }
    // Every triangle of the street, by the order in which things were baked.
    let all = 9 * triangles;
    for triangle in 0..all {
        let (in_row, own_house, rest) = of_row.original_part(whole, triangle).unwrap();
        assert_eq!((in_row, own_house), (row[(triangle / (3 * triangles)) as usize], house));
        let (in_wall, own, rest) = of_house.original_part(house, rest).unwrap();
        let place = (triangle / triangles % 3) as usize;
        assert_eq!((in_wall, own, rest), (wall[place], brick, triangle % triangles));
    }
    assert_eq!(of_row.original_part(whole, all), None);
    assert_eq!(of_row.original_part(GeometryId(brick.0 + 100), 0), None);
    let (_, second) = of_house.groups().nth(1).unwrap();
    assert_eq!(of_house.original_part(second, 1), Some((alone, brick, 1)));
}

/// All instances but one: to find that their geometry is still needed must not take a step for each of them.
#[test]
fn baking_nearly_all_of_very_many_ends() {
    let mut scene = Scene::new();
    let mesh = Mesh::soup(&[[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]).unwrap();
    let geometry = scene.add_mesh(&mesh).unwrap();
    let all: Vec<_> = (0..500_000u32)
        .map(|i| {
            let at = translation([i as f32, 0.0, 0.0]);
            scene.add_instance(Instance::new(geometry, at)).unwrap()
        })
        .collect();
    let (moving, standing) = all.split_last().unwrap();
    let (baked, table) = scene.bake(&[standing]).unwrap();
    assert_eq!((baked.len(), baked.instance(*moving).unwrap().geometry), (2, geometry));
    assert_eq!(table.original(all[0], 499_998), Some((all[499_998], geometry, 0)));
    // And groups of one each, the last first.
    let groups: Vec<&[InstanceId]> = standing[..200_000].chunks(1).rev().collect();
    let (baked, table) = scene.bake(&groups).unwrap();
    assert_eq!(baked.len(), all.len());
    assert!(table.groups().map(|(name, _)| name).eq(standing[..200_000].iter().copied()));
}

#[test]
fn what_cannot_be_baked_is_named() {
    let (mut scene, names) = exact_scene();
    let bake = |scene: &Scene, group: &[InstanceId]| scene.bake(&[group]).map(|_| ()).unwrap_err();
    let twice = [names[1], names[2], names[1]];
    assert_eq!(bake(&scene, &twice), BakeError::Twice { instance: names[1].0 });
    let two = scene.bake(&[&names[..3], &names[2..]]).map(|_| ()).unwrap_err();
    assert_eq!(two, BakeError::Twice { instance: names[2].0 });
    let unknown = SceneError::UnknownInstance { instance: 99 };
    assert_eq!(bake(&scene, &[names[0], InstanceId(99)]), BakeError::Scene(unknown));
    let plain = *scene.instance(names[4]).unwrap();
    for (what, other) in [
        ("mask", Instance { mask: 1, ..plain }),
        ("number", Instance { id: 5, ..plain }),
        ("culling", Instance { culling: Culling::Front, ..plain }),
    ] {
        scene.set_instance(names[4], other).unwrap();
        let (instance, first) = (names[4].0, names[1].0);
        let error = bake(&scene, &[names[4], names[3], names[1]]);
        assert_eq!(error, BakeError::Differs { instance, first, what });
        // Alone it differs from none, and keeps what it has.
        let (baked, _) = scene.bake(&[&names[4..5]]).unwrap();
        let own = baked.instance(names[4]).unwrap();
        assert_eq!((own.mask, own.id, own.culling), (other.mask, other.id, other.culling));
    }
    scene.set_instance(names[4], plain).unwrap();
    let spheres = Shapes::Spheres(vec![Sphere { centre: [0.0; 3], radius: 1.0 }]);
    let round = scene.add_shapes(spheres).unwrap();
    let round = scene.add_instance(Instance::in_place(round)).unwrap();
    assert_eq!(bake(&scene, &[names[0], round]), BakeError::Shapes { instance: round.0 });
    let mesh = scenes::soup(40, 0.5, 1);
    let masked = scene.add_mesh(&mesh.mesh()).unwrap();
    scene.set_opacity(masked, Some(OpacityMask::new(40, 0, |_, _| true).unwrap())).unwrap();
    let masked = scene.add_instance(Instance::in_place(masked)).unwrap();
    assert_eq!(bake(&scene, &[masked]), BakeError::Opacity { instance: masked.0 });
    // Others may have them.
    scene.bake(&[&names]).unwrap();
    // Beyond the greatest number; what was not finite before is none of it.
    let far =
        [[[0.0; 3], [1e30, 0.0, 0.0], [0.0, 1.0, 0.0]], [[f32::INFINITY; 3], [0.0; 3], [1.0; 3]]];
    let ok = [far[1], far[1]];
    let [far, ok] = [far, ok].map(|mesh| scene.add_mesh(&Mesh::soup(&mesh).unwrap()).unwrap());
    let wide = [[1e12, 0.0, 0.0, 0.0], [0.0, 1e12, 0.0, 0.0], [0.0, 0.0, 1e12, 0.0]];
    let [far, ok] = [far, ok].map(|name| scene.add_instance(Instance::new(name, wide)).unwrap());
    assert_eq!(bake(&scene, &[far]), BakeError::TooFar { instance: far.0, triangle: 0 });
    scene.bake(&[&[ok]]).unwrap();
}

/// A mesh of many instances is refused before memory is taken for it.
#[test]
fn a_limit_is_kept_before_anything_is_baked() {
    let (scene, names) = exact_scene();
    let groups: [&[InstanceId]; 3] = [&names[2..5], &[], &names[6..8]];
    let needed = scene.baked_bytes(&groups).unwrap();
    let (baked, table) = scene.bake_within(&groups, needed).unwrap();
    // What it says is what the arrays and the table have.
    let arrays = table.groups().map(|(_, geometry)| {
        let mesh = baked.geometry(geometry).unwrap().mesh();
        let (positions, indices) = mesh.arrays();
        size_of_val(positions) + size_of_val(indices.expect("indices"))
    });
    // 12 bytes an instance, 32 a group.
    assert_eq!(needed, (arrays.sum::<usize>() + 5 * 12 + 2 * 40) as u64);
    let refused = scene.bake_within(&groups, needed - 1).map(|_| ()).unwrap_err();
    assert_eq!(refused, BakeError::OutOfMemory { needed, limit: needed - 1 });
    // A hundred thousand instances of ten thousand triangles: 48 GB, or more triangles than a mesh has.
    let mut scene = Scene::new();
    let large = scene.add_mesh(&scenes::soup(10_000, 0.1, 1).mesh()).unwrap();
    let names: Vec<_> =
        (0..100_000).map(|_| scene.add_instance(Instance::in_place(large)).unwrap()).collect();
    let error = scene.bake(&[&names]).map(|_| ()).unwrap_err();
    assert!(matches!(error, BakeError::TooMany { .. }), "{error}");
    let groups: Vec<_> = names.chunks(1_000).collect();
    let refused = scene.bake_within(&groups, 1 << 30).map(|_| ()).unwrap_err();
    assert!(matches!(refused, BakeError::OutOfMemory { needed, .. } if needed > 40 << 30));
    let unknown = SceneError::UnknownInstance { instance: 100_000 };
    let error = scene.baked_bytes(&[&[InstanceId(100_000)]]).unwrap_err();
    assert_eq!(error, BakeError::Scene(unknown));
}

/// Roundings give an area to a triangle that had none: it is hit afterwards, as the documentation says.
#[test]
fn a_triangle_without_area_may_get_one() {
    // On one line: each corner is the sum of those before it. A translation rounds each by itself.
    let line = [[0.1, 0.1, 0.0], [0.2, 0.2, 0.0], [0.4, 0.4, 0.0]];
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&Mesh::soup(&[line]).unwrap()).unwrap();
    let moved = translation([0.5, 0.0, 0.0]);
    let name = scene.add_instance(Instance::new(geometry, moved)).unwrap();
    let area = |scene: &Scene| {
        let (_, mesh) = scene.geometries().next().unwrap();
        let [a, b, c] = mesh.mesh().triangle(0).map(|p| p.map(f64::from));
        let sides = [b, c].map(|p| [p[0] - a[0], p[1] - a[1]]);
        sides[0][0] * sides[1][1] - sides[0][1] * sides[1][0]
    };
    assert_eq!(area(&scene), 0.0);
    let (baked, _) = scene.bake(&[&[name]]).unwrap();
    assert_ne!(area(&baked), 0.0);
}
