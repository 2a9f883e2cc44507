//! Frames in flight on a GPU: vertices that stay on the device, the next tree under way while a frame is traced.
//! The pictures are those of the CPU, byte for byte, also after errors and beside other sizes.

use crate::device;
use splitplane::CpuBackend;
use splitplane::gpu::{Gpu, Traffic, WgpuBackend};
use splitplane::render::{Appearance, Light, Material, Outputs, RenderError, RenderSettings, Size};
use splitplane::scene::instanced::geometries;
use splitplane::scene::{Animation, Camera, Change, InstancedScene, Scene, SceneOptions};
use splitplane::tracer::{
    FrameRequest, InstanceTracer, InstancedLook, Moved, RenderBackend, Tracer, TracerError,
};
use splitplane_core::backend::BuildOptions;
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, QueryOptions};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// One test at a time: what crosses is counted for all of a device.
static ONE: Mutex<()> = Mutex::new(());

fn one() -> MutexGuard<'static, ()> {
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A backend on a device of these tests.
fn backend() -> WgpuBackend {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    WgpuBackend::without_selftest(GPU.get_or_init(device::own_gpu).clone())
}

fn traffic(tracer: &Tracer) -> Traffic {
    tracer.traffic().expect("it is on a GPU")
}

/// A frame of an animation: its number and the size of its picture.
type Shot = (usize, [u32; 2]);

fn request(camera: &Camera, [width, height]: [u32; 2]) -> FrameRequest<'static> {
    let size = Size::new(width, height).expect("a size");
    let settings = RenderSettings { depth: 3, ..RenderSettings::default() };
    FrameRequest { settings, ..FrameRequest::new(camera.pinhole(size), size) }
}

fn moved(tracer: &mut Tracer, scene: &Scene, change: Change) {
    let mesh = scene.mesh().expect("a mesh");
    match change {
        Change::Nothing => {}
        Change::Positions => tracer.update_normals(&mesh, &scene.appearance()),
        Change::Everything => {
            tracer.update_appearance(&mesh, &scene.appearance()).expect("an appearance");
        }
    }
}

/// Tree and picture of every shot by the CPU, one after the other.
fn on_cpu(
    scene: &str,
    frames: Option<&Path>,
    camera: &Camera,
    shots: &[Shot],
) -> Vec<(String, Vec<u32>)> {
    let options = BuildOptions::default();
    let (mut scene, mut animation) =
        Animation::open(scene, frames, &SceneOptions::default()).expect("an animation");
    let mesh = scene.mesh().expect("a mesh");
    let mut tracer =
        Tracer::load(CpuBackend::new(), &mesh, &scene.appearance(), &options).expect("a tree");
    let shot = |&(frame, size): &Shot| {
        let change = animation.set(frame, &mut scene).expect("a frame");
        moved(&mut tracer, &scene, change);
        let mesh = scene.mesh().expect("a mesh");
        tracer.rebuild(&mesh, &options).expect("a tree");
        let made = tracer.frame(&mesh, &request(camera, size)).expect("a frame");
        let pixels = made.pixels().expect("pixels").into_owned();
        (tracer.digest().expect("a tree").to_string(), pixels)
    };
    shots.iter().map(shot).collect()
}

/// The same with two frames in flight on the device, and what crossed between two pictures. The names of frames
/// are `name(frame)`.
fn in_flight(
    (scene, frames): (&str, Option<&Path>),
    camera: &Camera,
    shots: &[Shot],
    name: impl Fn(usize) -> Option<u64>,
) -> Vec<(String, Vec<u32>, Traffic)> {
    let options = BuildOptions::default();
    let (mut scene, mut animation) =
        Animation::open(scene, frames, &SceneOptions::default()).expect("an animation");
    let mesh = scene.mesh().expect("a mesh");
    let mut tracer = Tracer::load(backend(), &mesh, &scene.appearance(), &options).expect("a tree");
    let mut build = |tracer: &mut Tracer, scene: &mut Scene, frame: usize| {
        let change = animation.set(frame, scene).expect("a frame");
        moved(tracer, scene, change);
        let mesh = scene.mesh().expect("a mesh");
        tracer.submit_rebuild(&Moved { mesh, name: name(frame) }, &options).expect("a build");
    };
    build(&mut tracer, &mut scene, shots[0].0);
    let mut out = Vec::new();
    let mut before = traffic(&tracer);
    for (number, &(_, size)) in shots.iter().enumerate() {
        tracer.finish_rebuild().expect("a tree");
        let mesh = scene.mesh().expect("a mesh");
        tracer.submit_frame(&mesh, &request(camera, size)).expect("a frame");
        let triangles = tracer.summary().triangles;
        if let Some(&(next, _)) = shots.get(number + 1) {
            build(&mut tracer, &mut scene, next);
        }
        // The old tree is still there.
        assert_eq!(tracer.summary().triangles, triangles);
        let pixels = tracer.finish_frame().expect("a frame").pixels().expect("pixels").into_owned();
        let crossed = traffic(&tracer) - before;
        // The tree is read back here for its name alone: that is not a frame's.
        let digest = tracer.digest().expect("a tree").to_string();
        before = traffic(&tracer);
        out.push((digest, pixels, crossed));
    }
    out
}

fn compare(cpu: &[(String, Vec<u32>)], gpu: &[(String, Vec<u32>, Traffic)]) {
    assert_eq!(cpu.len(), gpu.len());
    for (number, (cpu, gpu)) in cpu.iter().zip(gpu).enumerate() {
        assert_eq!(cpu.0, gpu.0, "tree {number}");
        assert_eq!(cpu.1, gpu.1, "picture {number}");
    }
}

/// Two rounds: nothing is made after the second frame, and what was shown once is not sent again.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_carousel_in_two_rounds() {
    let _one = one();
    let name = "builtin:carousel:4000";
    let camera = Scene::open(name).expect("a scene").camera.expect("a camera of its own");
    let size = [40, 24];
    let shots: Vec<Shot> = [0, 20, 40, 60, 0, 20, 40, 60].map(|frame| (frame, size)).to_vec();
    let cpu = on_cpu(name, None, &camera, &shots);
    let gpu = in_flight((name, None), &camera, &shots, |frame| Some(frame as u64));
    compare(&cpu, &gpu);
    assert_ne!(cpu[0].1, cpu[1].1, "it moves");
    let (scene, _) = Animation::open(name, None, &SceneOptions::default()).expect("an animation");
    let positions = 12 * scene.positions.len() as u64;
    let normals = 36 * scene.indices.len() as u64;
    // The last frame has no next one beside it.
    for (number, (_, picture, crossed)) in gpu.iter().enumerate().skip(1).take(6) {
        let picture = 4 * picture.len() as u64;
        assert_eq!(crossed.readbacks, 2, "frame {number}");
        assert_eq!(crossed.bytes_down, 256 + 64 + picture, "frame {number}");
        let sent = if number + 1 < 4 { positions } else { 0 };
        let small = crossed.bytes_up - sent - normals;
        assert!(small < 4096, "frame {number}: {crossed:?}");
        // From the third frame on nothing but the keyframe of a frame that is new.
        let made = if number < 2 { 8 } else { u64::from(number + 1 < 4) };
        assert!(crossed.buffers <= made, "frame {number}: {crossed:?}");
    }
    // Positions without a name go another way, to the same pictures.
    let shots = &shots[..3];
    compare(&cpu[..3], &in_flight((name, None), &camera, shots, |_| None));
}

/// Other triangles, more or fewer, other materials, and other sizes of the picture.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_folder_of_frames_that_differ_in_everything() {
    let _one = one();
    let folder = tempfile::tempdir().expect("a folder");
    for (frame, count) in [40, 400, 3, 120, 400].into_iter().enumerate() {
        let mut text = String::new();
        for i in 0..count {
            let [x, y] = [i % 20, i / 20].map(|at| f64::from(at) / 10.0 - 1.0);
            let z = f64::from((i * 7 + frame as i32 * 3) % 11) / 11.0;
            text += &format!("v {x} {y} {z}\nv {} {y} 0\nv {x} {} {z}\n", x + 0.2, y + 0.2);
            text += "f -3 -2 -1\n";
        }
        std::fs::write(folder.path().join(format!("f{frame}.obj")), text).expect("a file");
    }
    let first = folder.path().join("f0.obj");
    let scene = first.to_str().expect("a path");
    let camera = Camera::new([0.0, 0.0, 6.0], [0.0; 3], [0.0, 1.0, 0.0], 40.0).expect("a camera");
    let sizes = [[24, 16], [24, 16], [48, 32], [8, 8], [33, 7], [24, 16], [24, 16], [16, 24]];
    let frames = [0, 1, 2, 3, 4, 1, 0, 4];
    let shots: Vec<Shot> = frames.into_iter().zip(sizes).collect();
    let cpu = on_cpu(scene, Some(folder.path()), &camera, &shots);
    let gpu = in_flight((scene, Some(folder.path())), &camera, &shots, |frame| Some(frame as u64));
    compare(&cpu, &gpu);
    // All under one name: it is noticed that these are others.
    compare(&cpu, &in_flight((scene, Some(folder.path())), &camera, &shots, |_| Some(7)));
}

/// Panes of glass one behind the other, so many that the paths of a frame outgrow their queue.
fn panes() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for pane in 0..6u32 {
        let z = -(pane as f32);
        for [x, y] in [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]] {
            positions.push([x, y, z + 0.03 * x]);
        }
        let first = 4 * pane;
        indices.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    (positions, indices)
}

/// The frame is repeated in smaller slices while the next tree is under way: it needs the old one.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_frame_that_is_repeated_has_its_own_tree() {
    let _one = one();
    let (old, indices) = panes();
    let new: Vec<[f32; 3]> = old.iter().map(|&[x, y, z]| [x * 0.1, y * 0.1, z - 2.0]).collect();
    let other: Vec<[f32; 3]> = old.iter().map(|&[x, y, z]| [x * 0.3, y * 0.2, z - 1.0]).collect();
    let [old, new, other] =
        [&old, &new, &other].map(|positions| Mesh::indexed(positions, &indices).expect("a mesh"));
    let glass = [Material::new("glass", [0.0; 3]).with_dielectric(1.5, [1.0; 3])];
    let lights = [Light::Directional { towards: [0.3, 0.4, 1.0], irradiance: [2.0; 3] }];
    let appearance = Appearance { materials: &glass, lights: &lights, ..Appearance::default() };
    let camera = Camera::new([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 40.0).expect("a camera");
    let mut wanted = request(&camera, [24, 16]);
    wanted.settings = RenderSettings { depth: 7, minimum_weight: 0.0, ..wanted.settings };
    let options = BuildOptions::default();
    let picture = |mesh: &Mesh<'_>| {
        let mut tracer =
            Tracer::load(CpuBackend::new(), mesh, &appearance, &options).expect("a tree");
        let made = tracer.frame(mesh, &wanted).expect("a frame");
        made.pixels().expect("pixels").into_owned()
    };
    let [of_old, of_new] = [picture(&old), picture(&new)];
    assert_ne!(of_old, of_new);
    let mut tracer = Tracer::load(backend(), &old, &appearance, &options).expect("a tree");
    tracer.limit_paths(2 * 24 * 16);
    for round in 0..3 {
        let planned = tracer.plan(&wanted).expect("a plan").slices();
        tracer.submit_frame(&old, &wanted).expect("a frame");
        tracer.submit_rebuild(&Moved { mesh: new, name: Some(1) }, &options).expect("a build");
        if round > 0 {
            // Taken before the frame: the frame comes first all the same.
            tracer.finish_rebuild().expect("a tree");
        }
        if round > 1 {
            // This one may use the buffers of the old tree.
            tracer.submit_rebuild(&Moved { mesh: other, name: None }, &options).expect("a build");
            tracer.submit_rebuild(&Moved { mesh: new, name: Some(1) }, &options).expect("a build");
        }
        let made = tracer.finish_frame().expect("a frame");
        assert!(made.stats().plan.slices() > planned, "it was not repeated");
        assert_eq!(made.pixels().expect("pixels"), of_old, "round {round}");
        // This takes the tree that was submitted.
        let made = tracer.frame(&new, &wanted).expect("a frame");
        assert_eq!(made.pixels().expect("pixels"), of_new, "round {round}");
        tracer.rebuild(&old, &options).expect("a tree");
    }
}

/// What fails is told by its type, and spoils neither the frame before nor the one after.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn errors_on_the_way() {
    let _one = one();
    let name = "builtin:carousel:4000";
    let camera = Scene::open(name).expect("a scene").camera.expect("a camera of its own");
    let cpu = on_cpu(name, None, &camera, &[(0, [24, 16]), (30, [24, 16])]);
    let (mut scene, mut animation) =
        Animation::open(name, None, &SceneOptions::default()).expect("an animation");
    let options = BuildOptions::default();
    let small = request(&camera, [24, 16]);
    let (mesh, appearance) = (scene.mesh().expect("a mesh"), scene.appearance());
    let mut tracer = Tracer::load(backend(), &mesh, &appearance, &options).expect("a tree");
    assert_eq!(tracer.finish_frame().unwrap_err(), TracerError::NothingSubmitted);
    tracer.submit_frame(&mesh, &small).expect("a frame");
    let little = BuildOptions { max_memory: Some(1000), ..options };
    let error = tracer.submit_rebuild(&Moved { mesh, name: Some(0) }, &little).unwrap_err();
    assert!(matches!(error, TracerError::Build(BuildError::OutOfMemory { .. })), "{error}");
    let made = tracer.finish_frame().expect("the frame before");
    assert_eq!(made.pixels().expect("pixels"), cpu[0].1);
    let error = made.radiance().unwrap_err();
    assert!(matches!(error, TracerError::NotRequested { .. }), "{error}");
    assert_eq!(tracer.finish_frame().unwrap_err(), TracerError::NothingSubmitted);
    let query = QueryOptions { accuracy: Accuracy::Exact, ..QueryOptions::default() };
    let exact = FrameRequest { query, ..small };
    let error = tracer.submit_frame(&mesh, &exact).unwrap_err();
    assert_eq!(error, TracerError::Render(RenderError::ExactOnDevice));
    assert_eq!(tracer.finish_frame().unwrap_err(), TracerError::NothingSubmitted);
    // Another number of triangles than the appearance has.
    let (few, indices) = panes();
    let other = Mesh::indexed(&few, &indices).expect("a mesh");
    tracer.submit_rebuild(&Moved { mesh: other, name: Some(9) }, &options).expect("a build");
    let error = tracer.submit_frame(&other, &small).unwrap_err();
    assert!(matches!(error, TracerError::Render(RenderError::WrongMesh { .. })), "{error}");
    // The one after, with all outputs.
    let change = animation.set(30, &mut scene).expect("a frame");
    moved(&mut tracer, &scene, change);
    let mesh = scene.mesh().expect("a mesh");
    tracer.submit_rebuild(&Moved { mesh, name: Some(30) }, &options).expect("a build");
    let outputs = Outputs { radiance: true, first_hits: true, ..Outputs::PIXELS };
    tracer.submit_frame(&mesh, &FrameRequest { outputs, ..small }).expect("a frame");
    let made = tracer.finish_frame().expect("a frame");
    assert_eq!(made.pixels().expect("pixels"), cpu[1].1);
    let [radiance, hits] =
        [made.radiance().expect("radiance").len(), made.first_hits().expect("first hits").len()];
    assert_eq!([radiance, hits], [24 * 16; 2]);
    let mut same = Tracer::load(CpuBackend::new(), &mesh, &scene.appearance(), &options).unwrap();
    let of_cpu = same.frame(&mesh, &FrameRequest { outputs, ..small }).expect("a frame");
    assert_eq!(made.radiance().expect("radiance"), of_cpu.radiance().expect("radiance"));
    assert_eq!(made.first_hits().expect("hits"), of_cpu.first_hits().expect("hits"));
    let [a, b] = [tracer.tree_size(), same.tree_size()];
    assert_eq!((a.nodes, a.references), (b.nodes, b.references));
    // On the CPU the calls are the same.
    assert_eq!(same.finish_frame().unwrap_err(), TracerError::NothingSubmitted);
    same.submit_rebuild(&Moved { mesh, name: None }, &options).expect("a build");
    same.submit_frame(&mesh, &small).expect("a frame");
    assert!(same.is_frame_done());
    assert_eq!(same.finish_frame().expect("a frame").pixels().expect("pixels"), cpu[1].1);
}

/// Scenes of instances: the device answers rays, and the pictures are the CPU's. What the CPU does for it is counted: nothing.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn instances_look_alike_on_both_backends() {
    let _one = one();
    for (name, frames) in [("builtin:forest:30", 1), ("builtin:flock:20", 2)] {
        let mut scene = InstancedScene::open_with(name, &SceneOptions::default()).expect("a scene");
        let camera = scene.placement(1.5, 1).camera;
        let request = request(&camera, [24, 16]);
        let numbers = scene.numbers();
        let mut described = scene.describe().expect("a description");
        let options = BuildOptions::default();
        let look = |scene: &InstancedScene| -> (Vec<u32>, u64) {
            let mesh = scene.parts.mesh().expect("a mesh");
            let shown = InstancedLook {
                mesh,
                appearance: scene.parts.appearance(),
                geometries: geometries(&numbers),
            };
            let now = scene.describe().expect("a description");
            let both = [CpuBackend::new().into(), RenderBackend::from(backend())];
            let [of_cpu, of_gpu] = both.map(|backend: RenderBackend| {
                let mut tracer =
                    InstanceTracer::load(backend, &now, &shown, &options).expect("a scene");
                let stats = tracer.frame(&mesh, &request).expect("a frame");
                (tracer.pixels().to_vec(), stats)
            });
            assert!(of_cpu.0 == of_gpu.0, "{name}");
            assert_eq!(of_cpu.1.placed_by_cpu, 0);
            assert_eq!(of_gpu.1.placed_by_cpu, 0);
            (of_cpu.0, of_gpu.1.rays())
        };
        let mut pictures = Vec::new();
        for frame in 0..frames {
            scene.set(frame * 5, &mut described).expect("a frame");
            pictures.push(look(&scene));
        }
        let colours: std::collections::BTreeSet<u32> = pictures[0].0.iter().copied().collect();
        assert!(colours.len() > 50 && pictures[0].1 > 24 * 16, "{name} shows nothing");
        assert!(frames == 1 || pictures[0].0 != pictures[1].0, "{name} does not move");
    }
}
