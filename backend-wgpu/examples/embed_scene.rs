//! Rays through a scene of many objects from a host's own compute shader: pyramids that stand on a floor, one of them mirrored, and balls. The host's function
//! `accept_hit` makes grates of the pyramids and leaves one instance out. The picture is printed as text, and the hits of its rays are compared with those of the
//! CPU with such a filter.

use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{Instance, Scene, SceneHit, SceneOptions, translation};
use splitplane_cpu::CpuBackend;
use splitplane_shaders::filtered_scene_traversal;
use splitplane_wgpu::{Gpu, WgpuBackend};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 24;
/// The floor, and a pyramid that is not seen.
const FLOOR: u32 = 0;
const HIDDEN: u32 = 3;

/// The host's shader, without the traversal. Its own resources are in group 1; a stage has eight buffers under WebGPU's default limits, and the scene takes six.
const SHADER: &str = "
// Asked by the traversal for each hit that would be the best so far.
fn accept_hit(hit: SceneHit) -> bool {
    return hit.instance != 3u && (hit.geometry != 1u || hit.v < 0.25 || hit.v > 0.5);
}

struct Seen { hit: array<u32, 6>, light: f32 }
@group(1) @binding(0) var<storage, read> cameras: array<vec4<u32>>;
@group(1) @binding(1) var<storage, read_write> seen: array<Seen>;

@compute @workgroup_size(64)
fn look(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= arrayLength(&seen) { return; }
    let ray = ray_of_words(cameras[2u * i], cameras[2u * i + 1u]);
    let hit = scene_closest_hit(ray, default_scene_options());
    var light = 0.0;
    if is_scene_hit(hit) {
        // A shadow ray to the lamp, from a little before the surface; it must not meet the triangle that it starts on.
        let place = ray.origin + 0.999 * hit.t * ray.direction;
        let lamp = vec3<f32>(5.0, 6.0, 4.0) - place;
        let options = SceneOptions(CULL_NONE, 0xffffffffu, hit.instance, hit.triangle);
        let hidden = scene_any_hit(Ray(place, 0.0, lamp, 1.0), options);
        let shade = array<f32, 3>(0.45, 0.7, 0.95);
        light = select(shade[min(hit.geometry, 2u)], 0.2, hidden);
    }
    seen[i] = Seen(scene_hit_words(hit), light);
}";

/// A floor, five pyramids and three balls.
fn describe() -> Result<Scene, Box<dyn std::error::Error>> {
    let mut scene = Scene::new();
    let plane = [[-6.0, 0.0, -6.0], [6.0, 0.0, -6.0], [6.0, 0.0, 4.0], [-6.0, 0.0, 4.0]];
    let floor = scene.add_mesh(&Mesh::indexed(&plane, &[[0, 2, 1], [0, 3, 2]])?)?;
    let corners =
        [[-0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [0.5, 0.0, -0.5], [-0.5, 0.0, -0.5], [0.0, 1.5, 0.0]];
    let sides = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    let pyramid = scene.add_mesh(&Mesh::indexed(&corners, &sides)?)?;
    let ball = Sphere { centre: [0.0, 0.4, 0.0], radius: 0.4 };
    let ball = scene.add_shapes(Shapes::Spheres(vec![ball]))?;
    scene.add_instance(Instance::new(floor, translation([0.0; 3])))?;
    for k in 0..5u8 {
        let mut place = translation([1.5 * f32::from(k) - 3.0, 0.0, 0.0]);
        if k == 1 {
            place[0][0] = -1.0;
        }
        scene.add_instance(Instance::new(pyramid, place))?;
    }
    for x in [-2.25, 0.0, 2.25] {
        scene.add_instance(Instance::new(ball, translation([x, 0.0, 1.5])))?;
    }
    Ok(scene)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The host's own device.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))?;

    // The scene is built on the host's device and stays there. After each update the host asks for its bindings again.
    let backend = WgpuBackend::new(Gpu::borrow(device.clone(), queue.clone()))?;
    let description = describe()?;
    let built = backend.build_wgpu_scene(&description, &BuildOptions::default())?;
    let bindings = built.bindings()?;

    // The traversal's text comes first; its bindings are the first seven of group 0.
    let source = filtered_scene_traversal(0, 0) + SHADER;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("look"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("look"),
        layout: None,
        module: &module,
        entry_point: Some("look"),
        compilation_options: Default::default(),
        cache: None,
    });

    // A camera above, looking down at a slant.
    let ray = |i: u32| {
        let x = ((i % WIDTH) as f32 + 0.5) / 32.0 - 1.0;
        let y = 1.0 - ((i / WIDTH) as f32 + 0.5) / 12.0;
        Ray::new([0.0, 2.5, 5.0], [0.9 * x, 0.5 * y - 0.4, -1.0])
    };
    let rays: Vec<Ray> = (0..WIDTH * HEIGHT).map(ray).collect();
    // Six words of a hit's record, and the light.
    let seen_bytes = rays.len() as u64 * 28;
    let buffer = |label, size, usage| {
        let label = Some(label);
        device.create_buffer(&wgpu::BufferDescriptor {
            label,
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    use wgpu::BufferUsages as Usage;
    let cameras = buffer("rays", size_of_val(&rays[..]) as u64, Usage::STORAGE | Usage::COPY_DST);
    let seen = buffer("seen", seen_bytes, Usage::STORAGE | Usage::COPY_SRC);
    let readback = buffer("read back", seen_bytes, Usage::MAP_READ | Usage::COPY_DST);
    queue.write_buffer(&cameras, 0, bytemuck::cast_slice(&rays));
    let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(index),
            entries,
        })
    };
    let scene = group(0, &bindings.bind_group_entries(0));
    let own = [(0, &cameras), (1, &seen)].map(|(binding, buffer)| wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    });
    let own = group(1, &own);

    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &scene, &[]);
        pass.set_bind_group(1, &own, &[]);
        pass.dispatch_workgroups((rays.len() as u32).div_ceil(64), 1, 1);
    }
    encoder.copy_buffer_to_buffer(&seen, 0, &readback, 0, seen_bytes);
    queue.submit([encoder.finish()]);
    readback.map_async(wgpu::MapMode::Read, .., |result| result.expect("a mapped buffer"));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let words = bytemuck::pod_collect_to_vec::<u8, u32>(&readback.get_mapped_range(..)?);

    // The picture.
    for row in words.chunks(7 * WIDTH as usize) {
        let shade = |seen: &[u32]| {
            let light = f32::from_bits(seen[6]);
            char::from(b" .:-=+*#%@"[(light * 9.99) as usize % 10])
        };
        println!("{}", row.chunks(7).map(shade).collect::<String>());
    }

    // The same on the CPU, by its own filter.
    let grate = |hit: &SceneHit| {
        hit.instance != HIDDEN && (hit.geometry != 1 || hit.v < 0.25 || hit.v > 0.5)
    };
    let options = SceneOptions { filter: Some(&grate), ..SceneOptions::default() };
    let on_cpu = CpuBackend::new().build_scene(&description, &BuildOptions::default())?;
    let mut hits = vec![SceneHit::MISS; rays.len()];
    on_cpu.closest_hits(&rays, &mut hits, &options)?;
    let same = |(seen, hit): &(&[u32], &SceneHit)| {
        let words: [u32; 6] = bytemuck::cast(**hit);
        seen[..6] == words
    };
    let equal = words.chunks(7).zip(&hits).filter(same).count();
    let objects = hits.iter().filter(|hit| hit.is_hit() && hit.instance != FLOOR).count();
    println!("{equal} of {} hits are the CPU's, bit for bit; {objects} are of objects", rays.len());
    if equal < rays.len() {
        return Err("a hit differs".into());
    }
    Ok(())
}
