//! Scenes that move, on the GPU: trees, pictures and memory against the CPU's.

use splitplane::render::{Outputs, RenderError, RenderSettings, Size};
use splitplane::scene::{Animation, Placement, SceneOptions};
use splitplane::tracer::{FrameRequest, Output, Tracer, TracerError};
use splitplane::{Accuracy, BackendKind, BuildOptions, OpenOptions, QueryOptions};

fn open(kind: BackendKind) -> splitplane::backend::Engine {
    let options = OpenOptions { default_limits: true, ..OpenOptions::default() };
    kind.open_engine(&options).expect("the tests on a GPU need one, or a software Vulkan").engine
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_that_are_rebuilt_on_the_gpu_are_those_of_the_cpu() {
    let options = SceneOptions::default();
    let (mut scene, mut animation) =
        Animation::open("builtin:carousel:4000", None, &options).unwrap();
    let build = BuildOptions::default();
    let load = |kind| {
        let mesh = scene.mesh().unwrap();
        Tracer::load(open(kind), &mesh, &scene.appearance(), &build).unwrap()
    };
    let (mut cpu, mut gpu) = (load(BackendKind::Cpu), load(BackendKind::Wgpu));
    let size = Size::new(32, 20).unwrap();
    let placement = Placement::of(&scene, cpu.accelerator().unwrap(), size.aspect()).unwrap();
    scene.lights = placement.lights;
    for tracer in [&mut cpu, &mut gpu] {
        tracer.update_appearance(&scene.mesh().unwrap(), &scene.appearance()).unwrap();
    }
    let settings = RenderSettings { depth: 2, ..RenderSettings::default() };
    let camera = placement.camera.pinhole(size);
    let request = FrameRequest { settings, ..FrameRequest::new(camera, size) };
    let mut digests = Vec::new();
    for frame in [0, 17, 40, 63, 99] {
        animation.set(frame, &mut scene).unwrap();
        let mesh = scene.mesh().unwrap();
        for tracer in [&mut cpu, &mut gpu] {
            tracer.update_normals(&mesh, &scene.appearance());
            tracer.rebuild(&mesh, &build).unwrap();
        }
        let digest = gpu.digest().unwrap();
        assert_eq!(digest, cpu.digest().unwrap(), "frame {frame}");
        let [on_cpu, on_gpu] =
            [&mut cpu, &mut gpu].map(|tracer| tracer.frame(&mesh, &request).unwrap());
        assert_eq!(on_gpu.pixels().unwrap(), on_cpu.pixels().unwrap(), "frame {frame}");
        assert_eq!(gpu.summary().triangles, cpu.summary().triangles);
        digests.push(digest.to_string());
    }
    digests.sort();
    digests.dedup();
    assert_eq!(digests.len(), 5);
    // Exact answers.
    let mesh = scene.mesh().unwrap();
    let query = QueryOptions { accuracy: Accuracy::Exact, ..QueryOptions::default() };
    let exact = FrameRequest { query, ..request };
    let [on_cpu, on_gpu] = [&mut cpu, &mut gpu].map(|tracer| tracer.frame(&mesh, &exact).unwrap());
    assert_eq!(on_gpu.pixels().unwrap(), on_cpu.pixels().unwrap());
    assert!(gpu.frame(&mesh, &request).is_ok());
    // A tree for frames alone answers no host, until it is brought there.
    assert!(gpu.accelerator().is_none() && cpu.accelerator().is_some());
    let digest = gpu.digest().unwrap();
    gpu.rebuild_for_queries(&mesh, &build).unwrap();
    assert_eq!(gpu.accelerator().unwrap().tree().digest(), digest);
    // Another scene takes the place of this one.
    let other = splitplane::scene::Scene::open("builtin:cornell").unwrap();
    let mesh = other.mesh().unwrap();
    let camera = other.camera.unwrap().pinhole(size);
    let request = FrameRequest { settings, ..FrameRequest::new(camera, size) };
    for tracer in [&mut cpu, &mut gpu] {
        tracer.replace(&mesh, &other.appearance(), &build).unwrap();
        assert_eq!(tracer.summary().triangles as usize, mesh.len());
    }
    assert_eq!(
        gpu.accelerator().unwrap().tree().digest(),
        cpu.accelerator().unwrap().tree().digest()
    );
    let [on_cpu, on_gpu] =
        [&mut cpu, &mut gpu].map(|tracer| tracer.frame(&mesh, &request).unwrap());
    assert_eq!(on_gpu.pixels().unwrap(), on_cpu.pixels().unwrap());
}

/// Each output alone: it is there, and the others are refused by name.
fn refuses_what_was_not_requested(kind: BackendKind) {
    let scene = splitplane::scene::Scene::open("builtin:cornell").unwrap();
    let (mesh, build) = (scene.mesh().unwrap(), BuildOptions::default());
    let mut tracer = Tracer::load(open(kind), &mesh, &scene.appearance(), &build).unwrap();
    let size = Size::new(4, 4).unwrap();
    let camera = scene.camera.unwrap().pinhole(size);
    let all = [Output::Pixels, Output::Radiance, Output::FirstHits, Output::FirstCosts];
    for requested in all {
        let outputs = Outputs {
            pixels: requested == Output::Pixels,
            radiance: requested == Output::Radiance,
            first_hits: requested == Output::FirstHits,
            first_costs: requested == Output::FirstCosts,
        };
        let request = FrameRequest { outputs, ..FrameRequest::new(camera, size) };
        let frame = tracer.frame(&mesh, &request).unwrap();
        for output in all {
            let length = match output {
                Output::Pixels => frame.pixels().map(|pixels| pixels.len()),
                Output::Radiance => frame.radiance().map(|radiance| radiance.len()),
                Output::FirstHits => frame.first_hits().map(|hits| hits.len()),
                _ => frame.first_costs().map(|costs| costs.len()),
            };
            let expected = match output == requested {
                true => Ok(16),
                false => Err(TracerError::NotRequested { output }),
            };
            assert_eq!(length, expected, "{output} of a frame with {requested}");
        }
    }
    let error = TracerError::NotRequested { output: Output::FirstHits };
    assert_eq!(error.to_string(), "the frame was not asked for first hits");
}

#[test]
fn what_was_not_requested_is_refused_on_the_cpu() {
    refuses_what_was_not_requested(BackendKind::Cpu);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_was_not_requested_is_refused_on_the_gpu() {
    refuses_what_was_not_requested(BackendKind::Wgpu);
}

/// A scene that cannot be built leaves the one that is there.
#[test]
fn a_scene_that_does_not_fit_leaves_the_old_one() {
    let scene = splitplane::scene::Scene::open("builtin:cornell").unwrap();
    let (mesh, build) = (scene.mesh().unwrap(), BuildOptions::default());
    let mut tracer =
        Tracer::load(open(BackendKind::Cpu), &mesh, &scene.appearance(), &build).unwrap();
    let size = Size::new(8, 6).unwrap();
    let request = FrameRequest::new(scene.camera.unwrap().pinhole(size), size);
    let digest = tracer.digest().unwrap();
    let before = tracer.frame(&mesh, &request).unwrap().pixels().unwrap().into_owned();
    let other = splitplane::scene::Scene::open("builtin:city:10000").unwrap();
    let tight = BuildOptions { max_memory: Some(1), ..BuildOptions::default() };
    let refused = tracer.replace(&other.mesh().unwrap(), &other.appearance(), &tight).unwrap_err();
    assert!(matches!(refused, TracerError::Build(_)), "{refused}");
    assert_eq!(tracer.digest().unwrap(), digest);
    let after = tracer.frame(&mesh, &request).unwrap().pixels().unwrap().into_owned();
    assert_eq!(after, before);
    assert!(before.iter().any(|pixel| *pixel != before[0]), "a picture of nothing");
    // A mesh with other triangles than the tree's is no mesh of this scene.
    let error = tracer.frame(&other.mesh().unwrap(), &request).unwrap_err();
    assert!(matches!(error, TracerError::Render(RenderError::WrongMesh { .. })));
}

/// Light by photons: the CPU shades, the GPU traces, and the files have the same bytes.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_by_photons_are_the_cpus_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    let run = |backend: &str, more: &[&str]| {
        let output = format!("{backend}.png");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_splitplane"));
        let light = ["--transport", "photons", "--photons", "2000", "--passes", "2"];
        let size = ["--size", "16x12", "--samples", "1", "--backend", backend, "-o", &output];
        command.current_dir(folder.path()).args(["render", "builtin:cornell"]);
        let ended = command.args(light).args(size).args(more).output().unwrap();
        let error = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(0), "{error}");
        (String::from_utf8(ended.stdout).unwrap(), folder.path().join(output))
    };
    let (_, by_cpu) = run("cpu", &[]);
    let (report, by_gpu) = run("wgpu", &["--json"]);
    assert!(report.contains("\"shading\":\"cpu, rays on gpu\""), "{report}");
    let [cpu, gpu] = [by_cpu, by_gpu].map(|path| std::fs::read(path).unwrap());
    assert!(cpu == gpu, "other bytes");
}
