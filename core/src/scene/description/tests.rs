use super::*;
use crate::scene::transform::translation;

const TRIANGLE: [[[f32; 3]; 3]; 1] = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];

#[test]
fn edits_are_checked_and_named() {
    let mesh = Mesh::soup(&TRIANGLE).unwrap();
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&mesh).unwrap();
    let first = scene.add_instance(Instance::in_place(geometry)).unwrap();
    let second = scene.add_instance(Instance::in_place(geometry)).unwrap();
    assert_eq!((first, second, scene.len()), (InstanceId(0), InstanceId(1), 2));

    let mut bad = IDENTITY;
    bad[1][3] = f32::NAN;
    assert_eq!(
        scene.move_instance(second, bad),
        Err(SceneError::NonFiniteTransform { instance: 1, row: 1, column: 3 })
    );
    let flat = [[1.0, 0.0, 0.0, 0.0]; 3];
    let error = Err(SceneError::SingularTransform { instance: 2 });
    assert_eq!(scene.add_instance(Instance::new(geometry, flat)), error);
    let error = Err(SceneError::UnknownGeometry { geometry: 9 });
    assert_eq!(scene.add_instance(Instance::in_place(GeometryId(9))), error);
    assert_eq!(scene.len(), 2);

    let in_use = SceneError::GeometryInUse { geometry: 0, instances: 2, instance: 0 };
    assert_eq!(scene.remove_geometry(geometry), Err(in_use));
    scene.remove_instance(first).unwrap();
    let gone = SceneError::UnknownInstance { instance: 0 };
    assert_eq!(scene.move_instance(first, IDENTITY), Err(gone));
    assert_eq!(scene.remove_instance(first), Err(gone));
    // The name is given again.
    assert_eq!(scene.add_instance(Instance::in_place(geometry)), Ok(first));
    for instance in [first, second] {
        scene.remove_instance(instance).unwrap();
    }
    scene.remove_geometry(geometry).unwrap();
    assert!(scene.is_empty() && scene.geometries().next().is_none());
    let error = Err(SceneError::UnknownGeometry { geometry: 0 });
    assert_eq!(scene.replace_mesh(geometry, &mesh), error);
    assert_eq!(scene.add_mesh(&mesh), Ok(geometry));
}

#[test]
fn changes_are_known_for_as_long_as_it_pays() {
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&Mesh::soup(&TRIANGLE).unwrap()).unwrap();
    let all: Vec<_> =
        (0..100).map(|_| scene.add_instance(Instance::in_place(geometry)).unwrap()).collect();
    let then = scene.edits();
    assert_eq!(scene.changes_since(&then), Changes::These(&[]));
    scene.set_mask(all[7], 1).unwrap();
    scene.move_instance(all[3], translation([1.0, 0.0, 0.0])).unwrap();
    assert_eq!(scene.changes_since(&then), Changes::These(&[all[7], all[3]]));
    assert_eq!(Scene::new().changes_since(&then), Changes::Unknown);
    for _ in 0..2 {
        all.iter().for_each(|&one| scene.set_mask(one, 2).unwrap());
    }
    assert_eq!(scene.changes_since(&then), Changes::Unknown);
    assert!(scene.log.kept.len() <= 100);
}
