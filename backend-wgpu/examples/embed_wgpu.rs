//! Rays traced from a host's own compute shader: the host owns the device, has a tree built there, and
//! its shader calls `closest_hit` and `any_hit` to shade a picture, which is printed as text. Its function `accept_hit` decides which hits
//! count: the sides of the pyramid are grates.

use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_shaders::{TriangleTest, filtered_traversal};
use splitplane_wgpu::{Gpu, WgpuBackend};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 24;

/// The host's shader, without the traversal. Its own resources are in group 1.
const SHADER: &str = "
// Asked by the traversal for each hit that would be the best so far. The floor is solid.
fn accept_hit(hit: Hit) -> bool {
    return hit.triangle < 2u || fract(5.0 * hit.v) < 0.6;
}

@group(1) @binding(0) var<storage, read_write> picture: array<f32>;

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= 64u || id.y >= 24u { return; }
    // A camera above, looking down at a slant.
    let x = (f32(id.x) + 0.5) / 32.0 - 1.0;
    let y = 1.0 - (f32(id.y) + 0.5) / 12.0;
    let ray = Ray(vec3<f32>(0.0, 3.0, 5.0), 0.0, vec3<f32>(1.2 * x, 0.8 * y - 0.6, -1.0), GREATEST);
    let hit = closest_hit(ray, default_options());
    var light = 0.0;
    if is_hit(hit) {
        // A shadow ray to the lamp; it must not meet the surface it starts on.
        let place = ray.origin + hit.t * ray.direction;
        let lamp = vec3<f32>(5.0, 4.0, 2.0) - place;
        let shadow = Ray(place, 0.0, lamp, 1.0);
        let hidden = any_hit(shadow, QueryOptions(CULL_NONE, hit.triangle));
        let corners = corners_of(hit.triangle);
        let normal = normalize(cross(corners.b - corners.a, corners.c - corners.a));
        light = select(0.2 + 0.8 * abs(dot(normal, normalize(lamp))), 0.1, hidden);
    }
    picture[id.y * 64u + id.x] = light;
}";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The host's own device.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))?;

    // A floor and a pyramid.
    let positions = [
        [-4.0, 0.0, -6.0],
        [4.0, 0.0, -6.0],
        [4.0, 0.0, 3.0],
        [-4.0, 0.0, 3.0],
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
        [-1.0, 0.0, -1.0],
        [0.0, 2.0, 0.0],
    ];
    let indices = [[0, 2, 1], [0, 3, 2], [4, 5, 8], [5, 6, 8], [6, 7, 8], [7, 4, 8]];
    let mesh = Mesh::indexed(&positions, &indices)?;

    // The tree is built on the host's device and stays there. Each frame may poll whether it is
    // done; here there is nothing else to do.
    let backend = WgpuBackend::new(Gpu::borrow(device.clone(), queue.clone()))?;
    let mut build = backend.submit_build(&mesh, &BuildOptions::default())?;
    let tree = loop {
        match build.poll()? {
            Some(built) => break built.tree,
            None => std::thread::yield_now(),
        }
    };

    // The traversal's text comes first; its bindings are the first four of group 0.
    let traversal = filtered_traversal(0, 0, TriangleTest::Watertight);
    let source = traversal.ok_or("the watertight test takes a filter")? + SHADER;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("shade"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("shade"),
        layout: None,
        module: &module,
        entry_point: Some("shade"),
        compilation_options: Default::default(),
        cache: None,
    });
    let bytes = u64::from(WIDTH * HEIGHT) * 4;
    let buffer = |usage| {
        let label = Some("picture");
        device.create_buffer(&wgpu::BufferDescriptor {
            label,
            size: bytes,
            usage,
            mapped_at_creation: false,
        })
    };
    let picture = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let readback = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(index),
            entries,
        })
    };
    let scene = group(0, &tree.bind_group_entries(0));
    let own =
        group(1, &[wgpu::BindGroupEntry { binding: 0, resource: picture.as_entire_binding() }]);

    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &scene, &[]);
        pass.set_bind_group(1, &own, &[]);
        pass.dispatch_workgroups(WIDTH.div_ceil(8), HEIGHT.div_ceil(8), 1);
    }
    encoder.copy_buffer_to_buffer(&picture, 0, &readback, 0, bytes);
    queue.submit([encoder.finish()]);

    readback.map_async(wgpu::MapMode::Read, .., |result| result.expect("a mapped buffer"));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let light = bytemuck::pod_collect_to_vec::<u8, f32>(&readback.get_mapped_range(..)?);
    for row in light.chunks(WIDTH as usize) {
        let shade = |light: &f32| char::from(b" .:-=+*#%@"[(light * 9.99) as usize % 10]);
        println!("{}", row.iter().map(shade).collect::<String>());
    }
    // The next build reuses the tree's buffers.
    backend.recycle(tree);
    Ok(())
}
