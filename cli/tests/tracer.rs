//! Scenes that move, on the GPU: trees, pictures and memory against the CPU's.

use splitplane::render::{RenderError, RenderSettings, Size};
use splitplane::scene::{Animation, Placement, SceneOptions};
use splitplane::tracer::{FrameRequest, Tracer, TracerError};
use splitplane::{Accuracy, BackendKind, BuildOptions, OpenOptions, QueryOptions};

fn open(kind: BackendKind) -> Tracer {
    let options = OpenOptions { default_limits: true, ..OpenOptions::default() };
    Tracer::open(kind, &options).expect("the tests on a GPU need one, or a software Vulkan").0
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_that_are_rebuilt_on_the_gpu_are_those_of_the_cpu() {
    let options = SceneOptions::default();
    let (mut scene, mut animation) =
        Animation::open("builtin:carousel:4000", None, &options).unwrap();
    let build = BuildOptions::default();
    let (mut cpu, mut gpu) = (open(BackendKind::Cpu), open(BackendKind::Wgpu));
    for tracer in [&mut cpu, &mut gpu] {
        tracer.build(&scene, &build).unwrap();
    }
    let size = Size::new(32, 20).unwrap();
    let placement = Placement::of(&scene, cpu.accelerator().unwrap(), size.aspect()).unwrap();
    scene.lights = placement.lights;
    for tracer in [&mut cpu, &mut gpu] {
        tracer.describe_looks(&scene).unwrap();
    }
    let settings = RenderSettings { depth: 2, ..RenderSettings::default() };
    let request = FrameRequest { settings, ..FrameRequest::new(&placement.camera, size) };
    let mut digests = Vec::new();
    for frame in [0, 17, 40, 63, 99] {
        animation.set(frame, &mut scene).unwrap();
        for tracer in [&mut cpu, &mut gpu] {
            tracer.update_normals(&scene).unwrap();
            tracer.rebuild(&scene, &build).unwrap();
            tracer.frame(&scene, &request).unwrap();
        }
        let digest = gpu.digest().unwrap();
        assert_eq!(digest, cpu.digest().unwrap(), "frame {frame}");
        assert_eq!(gpu.pixels().unwrap(), cpu.pixels().unwrap(), "frame {frame}");
        assert_eq!(gpu.summary().unwrap().triangles, cpu.summary().unwrap().triangles);
        digests.push(digest.to_string());
    }
    digests.sort();
    digests.dedup();
    assert_eq!(digests.len(), 5);
    // Exact answers would have to come back from the device; the CPU gives them.
    let query = QueryOptions { accuracy: Accuracy::Exact, ..QueryOptions::default() };
    let exact = FrameRequest { query, ..request };
    let refused = Err(TracerError::Render(RenderError::ExactOnDevice));
    assert_eq!(gpu.frame(&scene, &exact), refused);
    assert!(cpu.frame(&scene, &exact).is_ok() && gpu.frame(&scene, &request).is_ok());
    // A tree for frames alone answers no host.
    assert_eq!(gpu.accelerator().err(), Some(TracerError::NothingBuilt));
}

#[test]
fn what_was_not_made_is_not_there() {
    let mut tracer = open(BackendKind::Cpu);
    let (scene, _) =
        Animation::open("builtin:carousel:4000", None, &SceneOptions::default()).unwrap();
    let camera = scene.camera.unwrap();
    let request = FrameRequest::new(&camera, Size::new(4, 4).unwrap());
    assert_eq!(tracer.accelerator().err(), Some(TracerError::NothingBuilt));
    assert_eq!(tracer.frame(&scene, &request), Err(TracerError::NothingDescribed));
    tracer.describe_looks(&scene).unwrap();
    assert_eq!(tracer.frame(&scene, &request), Err(TracerError::NothingBuilt));
    tracer.build(&scene, &BuildOptions::default()).unwrap();
    assert!(tracer.frame(&scene, &request).is_ok());
}
