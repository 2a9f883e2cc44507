//! What a file of a built scene shows has the names that queries say.

use splitplane::objects::{Instance, InstanceId, Scene, translation, write_file};
use splitplane::scene::InstancedScene;
use splitplane::{Backend, BuildOptions, CpuBackend, Mesh};

/// Names that are free stay free, so that those behind them are what they were.
#[test]
fn names_behind_free_ones_stay() {
    let triangle = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let mesh = Mesh::soup(&triangle).unwrap();
    let folder = tempfile::tempdir().unwrap();
    // By which geometries and instances go: none, the first, some in the middle.
    for (geometries, instances) in
        [(&[][..], &[][..]), (&[0], &[0, 4]), (&[1, 2], &[1, 2, 5]), (&[], &[3])]
    {
        let mut scene = Scene::new();
        let named: Vec<_> = (0..4).map(|_| scene.add_mesh(&mesh).unwrap()).collect();
        let mut placed = Vec::new();
        for i in 0..7u32 {
            // Those that stay are of geometries that stay.
            let geometry = if instances.contains(&i) { named[i as usize % 4] } else { named[3] };
            let at = translation([i as f32, 0.0, 0.0]);
            placed.push(scene.add_instance(Instance::new(geometry, at)).unwrap());
        }
        for &gone in instances {
            scene.remove_instance(InstanceId(gone)).unwrap();
        }
        for &gone in geometries {
            scene.remove_geometry(named[gone]).unwrap();
        }
        let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
        let path = folder.path().join("saved.scene");
        std::fs::write(&path, write_file(built.scene()).unwrap()).unwrap();
        let shown = InstancedScene::open(&path).unwrap().describe().unwrap();
        let instances = |scene: &Scene| -> Vec<_> {
            scene.instances().map(|(name, own)| (name, *own)).collect()
        };
        assert_eq!(instances(&shown), instances(&scene));
        let geometries = |scene: &Scene| -> Vec<_> {
            scene.geometries().map(|(name, own)| (name, own.mesh().len())).collect()
        };
        assert_eq!(geometries(&shown), geometries(&scene));
        assert_eq!(placed.len(), 7);
    }
}
