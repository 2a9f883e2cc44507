//! Vertices that a kernel moves by transforms: the CPU's bits, trees of the moved mesh, and errors that say what is wrong.

use crate::common::{self, untested_backend as backend};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::moved::{MoveError, move_vertices};
use splitplane_core::scene::{IDENTITY, Transform, translation};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;
use splitplane_wgpu::device::readback::read;
use splitplane_wgpu::{DeviceMesh, Gpu, MovedMesh, MovedMeshError, WgpuBackend};

/// Vertices at rest in groups, and poses.
struct Case {
    positions: Vec<[f32; 3]>,
    indices: Option<Vec<[u32; 3]>>,
    group_of: Vec<u32>,
    poses: Vec<Vec<Transform>>,
}

impl Case {
    fn new(mesh: &Mesh<'_>, groups: u32, seed: u64) -> Case {
        let (positions, indices) = mesh.arrays();
        let group_of = (0..positions.len() as u32).map(|v| (v / 7) % groups).collect();
        let mut random = Random::new(seed);
        let mut poses = Vec::new();
        for pose in 0..3u32 {
            let mut one = Vec::new();
            for group in 0..groups {
                let mut rows = [[0.0f32; 4]; 3];
                rows.iter_mut().flatten().for_each(|m| *m = random.signed());
                // Numbers of all magnitudes, those below the least normal one and zeros among them.
                match (pose + group) % 4 {
                    0 => rows[1].iter_mut().for_each(|m| *m *= 1e-38),
                    1 => rows[2][3] = 1e30,
                    2 => rows[0] = [0.0, -0.0, 1e-40, -1e-45],
                    _ => {}
                }
                one.push(rows);
            }
            poses.push(one);
        }
        let (positions, indices) = (positions.to_vec(), indices.map(<[_]>::to_vec));
        Case { positions, indices, group_of, poses }
    }

    fn mesh<'a>(&'a self, positions: &'a [[f32; 3]]) -> Mesh<'a> {
        match &self.indices {
            Some(indices) => Mesh::indexed(positions, indices).expect("a mesh"),
            None => Mesh::soup(positions.as_chunks::<3>().0).expect("a mesh"),
        }
    }

    fn on(&self, backend: &WgpuBackend) -> MovedMesh {
        let mesh = self.mesh(&self.positions);
        backend.moved_mesh(&mesh, &self.group_of, self.poses[0].len()).expect("a mesh that moves")
    }

    fn expected(&self, pose: &[Transform]) -> Vec<[f32; 3]> {
        let mut moved = vec![[0.0; 3]; self.positions.len()];
        move_vertices(&self.positions, &self.group_of, pose, &mut moved).expect("vertices");
        moved
    }

    /// The first vertex that a device moves elsewhere.
    fn first_difference(&self, backend: &WgpuBackend, moved: &mut MovedMesh) -> Option<usize> {
        self.poses.iter().find_map(|pose| {
            let mesh = moved.place(pose).expect("vertices");
            let bytes = 12 * u64::from(mesh.vertices);
            let found = read(backend.gpu(), mesh.positions, 0, bytes).expect("positions");
            let expected = self.expected(pose);
            let expected: &[u8] = bytemuck::cast_slice(&expected);
            expected.chunks_exact(12).zip(found.chunks_exact(12)).position(|(a, b)| a != b)
        })
    }
}

fn cases() -> Vec<Case> {
    let tiny = scenes::zeros_and_subnormals();
    vec![
        Case::new(&scenes::grid_boxes(4).mesh(), 5, 1),
        // More workgroups than one.
        Case::new(&scenes::soup(2_000, 0.1, 8).mesh(), 64, 2),
        Case::new(&tiny.mesh(), 3, 3),
    ]
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn vertices_have_the_bits_of_the_cpus() {
    let backend = backend();
    for case in cases() {
        let mut moved = case.on(&backend);
        assert_eq!(case.first_difference(&backend, &mut moved), None);
    }
}

/// Poses in a row, each moved and built before the last one is done: every tree is that of its pose, and of a pose no more is sent than its
/// transforms.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn trees_of_moved_vertices() {
    // A device of its own, whose traffic no other test adds to.
    let [(device, queue), _] = common::host_devices(&wgpu::Limits::default());
    let backend = WgpuBackend::without_selftest(Gpu::borrow(device, queue));
    let options = BuildOptions::default();
    for mut case in cases() {
        // Rigid, so that triangles keep their shapes.
        let groups = case.poses[0].len();
        let pose = |by: f32| (0..groups).map(|g| translation([by, g as f32, -by])).collect();
        case.poses = vec![pose(0.25), pose(-3.0), vec![IDENTITY; groups]];
        let mut moved = case.on(&backend);
        let before = backend.gpu().traffic();
        let mut pending = Vec::new();
        for pose in &case.poses {
            let placed = moved.place(pose).expect("vertices");
            pending.push(backend.submit_build_from(&placed, &options).expect("a build"));
        }
        let uploaded = (backend.gpu().traffic() - before).bytes_up;
        let of_poses = 3 * (48 * groups as u64 + 4096);
        assert!(uploaded <= of_poses, "{uploaded} bytes were sent");
        for (mut pending, pose) in pending.into_iter().zip(&case.poses) {
            let built = pending.wait().expect("a tree");
            let expected = case.expected(pose);
            let (expected, _) =
                CpuBackend::new().build_tree(&case.mesh(&expected), &options).expect("a tree");
            assert!(built.tree.read(backend.gpu()).expect("a tree") == expected);
        }
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_does_not_fit_is_refused() {
    let backend = backend();
    let case = &cases()[0];
    let mesh = case.mesh(&case.positions);
    let refused =
        |group_of: &[u32], groups: usize| match backend.moved_mesh(&mesh, group_of, groups) {
            Err(MovedMeshError::Move(error)) => error,
            other => panic!("{other:?}"),
        };
    let vertices = case.positions.len();
    let what = "groups";
    assert_eq!(refused(&[0], 1), MoveError::Counts { what, found: 1, vertices });
    let error = refused(&case.group_of, 4);
    assert_eq!(error, MoveError::Group { vertex: 28, group: 4, transforms: 4 });
    let mut moved = case.on(&backend);
    let mut refused = |transforms: &[Transform]| match moved.place(transforms) {
        Err(MovedMeshError::Move(error)) => error,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&[IDENTITY; 4]), MoveError::Transforms { found: 4, groups: 5 });
    let mut far = [IDENTITY; 5];
    far[3][1][3] = f32::INFINITY;
    assert_eq!(refused(&far), MoveError::Transform { transform: 3 });
    // Nothing has happened to it.
    assert_eq!(case.first_difference(&backend, &mut moved), None);
    // More than one binding holds.
    let [(device, queue), _] = common::host_devices(&wgpu::Limits {
        max_storage_buffer_binding_size: 4096,
        ..wgpu::Limits::default()
    });
    let short = WgpuBackend::without_selftest(Gpu::borrow(device, queue));
    let error = short.moved_mesh(&mesh, &case.group_of, 5).expect_err("a limit");
    assert!(error.to_string().contains("positions at rest needs"), "{error}");
    // No vertex at all.
    let mut none = backend.moved_mesh(&scenes::none().mesh(), &[], 0).expect("an empty mesh");
    let DeviceMesh { vertices, triangles, .. } = none.place(&[]).expect("nothing to move");
    assert_eq!((vertices, triangles), (0, 0));
}

/// Another order of operations, subnormal numbers that count, the wrong transform: each is seen.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let shader = splitplane_shaders::find("move_vertices").expect("a shader").source();
    let backend = backend();
    for (from, to) in [
        (
            "snapped_product(m.x, x), snapped_product(m.y, y)",
            "snapped_product(m.z, z), snapped_product(m.y, y)",
        ),
        ("snap(rest_positions[3u * vertex + 1u])", "rest_positions[3u * vertex + 2u]"),
        ("3u * vertex_groups[vertex]", "3u * (vertex_groups[vertex] / 2u)"),
        ("vertex >= vertex_count.count", "vertex + 1u >= vertex_count.count"),
    ] {
        let planted = shader.replace(from, to);
        assert!(planted != shader, "the text to change is gone: {from}");
        let seen = cases().iter().any(|case| {
            let mut moved = case.on(&backend);
            moved.replace_kernel(Some(planted.clone()));
            case.first_difference(&backend, &mut moved).is_some()
        });
        assert!(seen, "{to}");
    }
}
