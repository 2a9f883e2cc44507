//! What a device holds of a scene while an update of it runs, by the device's own allocator, against the limit of memory.

use std::sync::{Arc, Mutex};

use crate::common::own_gpu;
use splitplane_core::backend::scene::{BuiltScene, SceneAccelerator};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{GeometryId, Instance, InstanceId, OpacityMask, Scene, translation};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;
use splitplane_wgpu::WgpuBackend;
use splitplane_wgpu::query::WgpuScene;

/// The buffers of scenes, as the allocator names them.
const BUFFERS: [&str; 6] = [
    "the tree over instances",
    "the instances",
    "the nodes of all geometries",
    "the references of all geometries",
    "the triangles of all geometries",
    "the shapes of all geometries",
];

/// What an allocator may add to the buffers of two scenes, which it rounds up.
const ROUNDED: u64 = 12 * 256;

/// A device, and what it held of scenes whenever a buffer was made.
struct Device {
    backend: WgpuBackend,
    seen: Arc<Mutex<Vec<u64>>>,
}

impl Device {
    fn new() -> Device {
        let gpu = own_gpu();
        let seen = Arc::<Mutex<Vec<u64>>>::default();
        let (device, list) = (gpu.device().clone(), Arc::clone(&seen));
        gpu.observe_buffers(move || list.lock().expect("a list").push(of_scenes(&device)));
        Device { backend: WgpuBackend::without_selftest(gpu), seen }
    }

    /// Waits until the device is done, and with that has freed what was dropped.
    fn settle(&self) {
        self.backend.gpu().submit([]).expect("a device");
        self.backend.gpu().wait().expect("a device");
    }

    fn held(&self) -> u64 {
        of_scenes(self.backend.gpu().device())
    }
}

/// Bytes of the buffers of all scenes that are there.
fn of_scenes(device: &wgpu::Device) -> u64 {
    let report = device.generate_allocator_report().expect("an allocator that reports");
    let own = report.allocations.iter().filter(|own| BUFFERS.contains(&own.name.as_str()));
    own.map(|own| own.size).sum()
}

/// A scene that is going to be edited.
struct Old {
    scene: Scene,
    meshes: Vec<GeometryId>,
    instances: Vec<InstanceId>,
}

fn old() -> Old {
    let mut scene = Scene::new();
    // So large a mesh that the device decides: what the host needs for a while is less.
    let meshes: Vec<_> = [400, 400, 400, 6000]
        .map(|count| scene.add_mesh(&scenes::soup(count, 0.1, 3).mesh()).expect("a geometry"))
        .to_vec();
    let place = |number: u16| translation([f32::from(number % 20), f32::from(number / 20), 0.0]);
    let instances = (0..300)
        .map(|number: u16| Instance::new(meshes[usize::from(number % 4)], place(number)))
        .map(|own| scene.add_instance(own).expect("an instance"))
        .collect();
    Old { scene, meshes, instances }
}

type Edit = fn(&mut Old);

/// A mesh grows.
const MESH: Edit = |old| {
    old.scene.replace_mesh(old.meshes[1], &scenes::soup(900, 0.1, 9).mesh()).expect("an edit");
};
/// Placements are planned, and a mask comes.
const PLACEMENTS: Edit = |old| {
    for (number, name) in (0u16..).zip(&old.instances) {
        let place = translation([f32::from(number % 20), f32::from(number / 20), 0.5]);
        old.scene.move_instance(*name, place).expect("an edit");
    }
    let mask = OpacityMask::new(400, 4, |triangle, _| triangle % 2 == 0).expect("a mask");
    old.scene.set_opacity(old.meshes[2], Some(mask)).expect("an edit");
};
/// The tree over instances grows.
const INSTANCES: Edit = |old| {
    for number in 0..200u16 {
        let own = Instance::new(old.meshes[0], translation([f32::from(number), 30.0, 0.0]));
        old.scene.add_instance(own).expect("an edit");
    }
};
const ALL: Edit = |old| [MESH, PLACEMENTS, INSTANCES].iter().for_each(|edit| edit(old));

/// What came of an update within a limit.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
enum Outcome {
    Refused,
    OnCpu,
    /// All was sent, once the old scene had gone.
    Anew,
    /// The old scene was there until the new one was.
    Beside,
}

struct Update {
    outcome: Outcome,
    /// The most that host and device held at the same time, as far as buffers were made.
    peak: u64,
}

/// Updates a scene by these edits in turn, the last of them within a limit. `settled`: what was dropped until then is freed.
fn update(device: &Device, edits: &[Edit], max_memory: Option<u64>, settled: bool) -> Update {
    let (cpu, free) = (CpuBackend::new(), BuildOptions::default());
    // Without a limit: what a build needs for a while is not what this is about.
    let mut build = |mesh: &Mesh<'_>, _: &BuildOptions<'_>| Backend::build(&cpu, mesh, &free);
    let mut old = old();
    let mut built = device.backend.build_wgpu_scene(&Scene::new(), &free).expect("a scene");
    let mut twin = BuiltScene::default();
    let (last, before) = edits.split_last().expect("an edit");
    let nothing: Edit = |_| {};
    device.settle();
    for edit in [nothing].iter().chain(before) {
        edit(&mut old);
        built.update_by(&old.scene, &free, &mut build).expect("an update");
        twin.update(&old.scene, &free, &mut build).expect("an update");
    }
    if settled {
        device.settle();
    }
    let on_device = built.bytes_on_device();
    // Of what others and updates before left behind, something is there where nobody waited.
    assert_eq!(device.held() < on_device + ROUNDED, settled);
    last(&mut old);
    // What the host holds, which a test of updates holds to the allocator.
    let mut host = 0;
    let told = twin.update_after(&old.scene, &free, &mut build, &mut |becoming| {
        host = becoming.held;
        Ok(())
    });
    told.expect("an update");
    limited(device, &mut built, &old.scene, max_memory, host)
}

/// An update within a limit. `host`: bytes that the host holds while the device has the old scene.
fn limited(
    device: &Device,
    built: &mut WgpuScene,
    scene: &Scene,
    max_memory: Option<u64>,
    host: u64,
) -> Update {
    let (cpu, free) = (CpuBackend::new(), BuildOptions::default());
    let mut build = |mesh: &Mesh<'_>, _: &BuildOptions<'_>| Backend::build(&cpu, mesh, &free);
    let on_device = built.bytes_on_device();
    device.seen.lock().expect("a list").clear();
    let told = built.update_by(scene, &BuildOptions { max_memory, ..free }, &mut build);
    let seen = device.seen.lock().expect("a list").clone();
    let outcome = match (&told, built.placed_by_cpu()) {
        (Err(_), _) => Outcome::Refused,
        (_, Some(_)) => Outcome::OnCpu,
        _ if seen.first().is_some_and(|first| *first < on_device) => Outcome::Anew,
        _ => Outcome::Beside,
    };
    let host = if outcome == Outcome::Beside { host } else { built.scene().bytes() };
    let peak = seen.into_iter().max().unwrap_or(on_device) + host;
    if let Some(limit) = max_memory.filter(|_| outcome >= Outcome::Anew) {
        assert!(peak <= limit + ROUNDED, "{outcome:?}: {peak} > {limit}");
    }
    // Nothing is left behind but what counts.
    device.settle();
    let (held, counts) = (device.held(), built.bytes_on_device());
    assert!(counts <= held && held <= counts + ROUNDED, "{held} {counts}");
    Update { outcome, peak }
}

/// The least limit from which on an update comes to this, and the update. It is the same again, however far the device is with what was sent before.
fn least(wanted: Outcome, update: impl Fn(u64) -> Update) -> (u64, Update) {
    let find = || {
        let (mut little, mut enough) = (0, 1 << 23);
        let mut at = update(enough);
        assert!(at.outcome >= wanted, "{:?}", at.outcome);
        while enough - little > 1 {
            let middle = little.midpoint(enough);
            let own = update(middle);
            if own.outcome >= wanted {
                (enough, at) = (middle, own);
            } else {
                little = middle;
            }
        }
        (enough, at)
    };
    let found = find();
    assert_eq!(found.0, find().0, "{wanted:?}");
    found
}

/// The least limit is what host and device hold at the most, whether the new scene is beside the old one or after it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_least_limit_is_what_is_held() {
    let device = Device::new();
    for (number, edit) in [MESH, PLACEMENTS, INSTANCES, ALL].into_iter().enumerate() {
        let mut limits = Vec::new();
        for wanted in [Outcome::Anew, Outcome::Beside] {
            let (limit, Update { outcome, peak }) =
                least(wanted, |limit| update(&device, &[edit], Some(limit), true));
            println!("{number}: {outcome:?} from {limit}, held {peak}");
            assert_eq!(outcome, wanted, "{number}");
            assert!(limit.abs_diff(peak) <= ROUNDED, "{number}, {outcome:?}: {limit} {peak}");
            limits.push(limit);
        }
        assert!(limits[0] < limits[1], "{number}");
    }
}

/// Most goes, and what is left gets smaller buffers. Nothing has been submitted until then, so the old ones are there still.
const MOST_GOES: Edit = |old| {
    let goes = |name: &&InstanceId| {
        old.scene.instance(**name).is_ok_and(|own| own.geometry == old.meshes[3])
    };
    for name in old.instances.iter().filter(goes).copied().collect::<Vec<_>>() {
        old.scene.remove_instance(name).expect("an edit");
    }
    old.scene.remove_geometry(old.meshes[3]).expect("an edit");
};

/// Buffers that the update before has replaced are there until the device has done what was sent to them.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_the_update_before_left_behind_counts() {
    let device = Device::new();
    let edits = [MOST_GOES, MESH];
    let free = update(&device, &edits, None, false).peak;
    let mut seen = [0; 4];
    for step in 0..64 {
        seen[update(&device, &edits, Some(step * free / 48), false).outcome as usize] += 1;
    }
    println!("{free}: {seen:?}");
    assert!(seen[2..].iter().all(|&times| times > 0), "{seen:?}");
}

/// A tree over instances that is worn is built anew once the update is in place on the host, and may have more nodes than were reserved. What it gets then
/// is beside the old one.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_worn_tree_that_grows_counts() {
    let device = Device::new();
    let (cpu, free) = (CpuBackend::new(), BuildOptions::default());
    let update = |limit| {
        let mut build = |mesh: &Mesh<'_>, _: &BuildOptions<'_>| Backend::build(&cpu, mesh, &free);
        let mut scene = Scene::new();
        let mesh = scene.add_mesh(&scenes::soup(6000, 0.1, 3).mesh()).expect("a geometry");
        let names: Vec<_> = (0..300)
            .map(|_| scene.add_instance(Instance::in_place(mesh)).expect("an instance"))
            .collect();
        let mut built = device.backend.build_wgpu_scene(&Scene::new(), &free).expect("a scene");
        built.update_by(&scene, &free, &mut build).expect("an update");
        device.settle();
        // So few that their placements take less than a node on the device.
        for (number, name) in (0u8..8).zip(&names) {
            let place = translation([f32::from(number) * 7.0, 500.0, f32::from(number) * 37.0]);
            scene.move_instance(*name, place).expect("an edit");
        }
        let was = built.scene().packed_sizes().top_nodes;
        let mut twin = BuiltScene::default();
        twin.update(&scene, &free, &mut build).expect("an update");
        let own = limited(&device, &mut built, &scene, Some(limit), twin.bytes());
        if own.outcome >= Outcome::Anew {
            assert!(built.scene().packed_sizes().top_nodes > was);
        }
        own
    };
    for wanted in [Outcome::Anew, Outcome::Beside] {
        let (limit, Update { outcome, peak }) = least(wanted, update);
        println!("{outcome:?} from {limit}, held {peak}");
        assert_eq!(outcome, wanted);
        assert!(limit.abs_diff(peak) <= ROUNDED, "{outcome:?}: {limit} {peak}");
    }
}
