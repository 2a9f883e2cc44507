//! Meshes that are on the device already: the same trees as from host memory.

use crate::common;
use splitplane_core::backend::BuildOptions;
use splitplane_core::error::BuildError;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;
use splitplane_wgpu::{DeviceMesh, Gpu, WgpuBackend};
use wgpu::BufferUsages as Usage;

/// A buffer with these bytes, which can be copied from.
fn filled(gpu: &Gpu, bytes: &[u8]) -> wgpu::Buffer {
    let usage = Usage::COPY_SRC | Usage::COPY_DST;
    let buffer = gpu.buffer("mesh", bytes.len() as u64, usage).expect("a buffer");
    gpu.queue().write_buffer(&buffer, 0, bytes);
    buffer
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_same_tree_as_from_host_memory() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let gpu = backend.gpu();
    let options = BuildOptions::default();
    let mut repeats = 0;
    // The last one outgrows the capacity estimated for it: the mesh must outlast the repeat.
    for scene in [scenes::grid_boxes(4), scenes::soup(3000, 0.3, 8), scenes::fan(20_000)] {
        let mesh = scene.mesh();
        let (expected, _) = CpuBackend::new().build_tree(&mesh, &options).expect("a tree");
        let (positions, indices) = mesh.arrays();
        let count = mesh.len() as u32;
        let own = || (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let indices: Vec<[u32; 3]> = indices.map_or_else(own, <[_]>::to_vec);
        let soup: Vec<[[f32; 3]; 3]> = (0..mesh.len()).map(|i| mesh.triangle(i)).collect();
        let vertices = filled(gpu, bytemuck::cast_slice(positions));
        let named = filled(gpu, bytemuck::cast_slice(&indices));
        let loose = filled(gpu, bytemuck::cast_slice(&soup));
        let triangles = mesh.len() as u32;
        let forms = [
            DeviceMesh {
                positions: &vertices,
                vertices: positions.len() as u32,
                indices: Some(&named),
                triangles,
            },
            DeviceMesh { positions: &loose, vertices: 3 * triangles, indices: None, triangles },
        ];
        for form in forms {
            let mut pending = backend.submit_build_from(&form, &options).expect("a build");
            // Overwritten at once, as the next frame of an engine does.
            gpu.queue().write_buffer(form.positions, 0, &[0xff; 36]);
            let built = pending.wait().expect("a tree");
            let tree = built.tree.read(gpu).expect("a tree in host memory");
            assert_eq!(tree.digest(), expected.digest(), "{}", scene.name);
            repeats += built.effort.repeats;
        }
    }
    assert!(repeats > 0);
}

/// On the CPU such a mesh is refused when it is made; here nobody has looked at the indices.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn triangles_that_name_no_vertex_are_dropped_and_counted() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let gpu = backend.gpu();
    let scene = scenes::grid_boxes(3);
    let mesh = scene.mesh();
    let (positions, indices) = mesh.arrays();
    let mut indices = indices.expect("indexed").to_vec();
    let vertices = positions.len() as u32;
    for (triangle, vertex) in [(5, vertices), (17, u32::MAX), (30, 0x5555_5556)] {
        indices[triangle][1] = vertex;
    }
    let (buffer, named) =
        (filled(gpu, bytemuck::cast_slice(positions)), filled(gpu, bytemuck::cast_slice(&indices)));
    let triangles = indices.len() as u32;
    let form = DeviceMesh { positions: &buffer, vertices, indices: Some(&named), triangles };
    let built = backend.submit_build_from(&form, &BuildOptions::default()).unwrap().wait().unwrap();
    assert_eq!(built.summary.dropped, 3);
    let tree = built.tree.read(gpu).unwrap();
    assert!([5, 17, 30].iter().all(|triangle| !tree.references.contains(triangle)));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn counts_that_do_not_fit_are_refused() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let gpu = backend.gpu();
    let buffer = filled(gpu, &[0; 360]);
    let uncopied = gpu.buffer("mesh", 360, Usage::STORAGE).expect("a buffer");
    let good = DeviceMesh { positions: &buffer, vertices: 30, indices: None, triangles: 10 };
    for (bad, text) in [
        (DeviceMesh { vertices: 31, ..good }, "372 are needed"),
        (DeviceMesh { triangles: 11, ..good }, "need 33 positions"),
        (DeviceMesh { indices: Some(&buffer), triangles: 31, ..good }, "indices has 360 bytes"),
        (DeviceMesh { positions: &uncopied, ..good }, "COPY_SRC"),
        (DeviceMesh { triangles: u32::MAX, ..good }, "4294967295 triangles"),
    ] {
        let error = backend.submit_build_from(&bad, &BuildOptions::default()).unwrap_err();
        let BuildError::InvalidMesh { reason } = &error else { panic!("{error}") };
        assert!(reason.contains(text), "{reason}");
    }
    // All its triangles have equal corners: an empty tree, and all counted.
    let built = backend.submit_build_from(&good, &BuildOptions::default()).unwrap().wait().unwrap();
    assert_eq!(built.summary.dropped, 10);
}
