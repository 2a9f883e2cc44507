//! The viewer's own source of pictures, on a device without a window: an animation whose vertices, trees and pictures stay
//! there, two frames under way, and nothing but statistics coming back.

use splitplane::gpu::{Gpu, OpenOptions as DeviceOptions};
use splitplane::render::RenderSettings;
use splitplane::scene::{Animation, InstancedScene, SceneOptions};
use splitplane::{Accuracy, BackendKind, BuildOptions, OpenOptions, Preset};
use splitplane_viewer::{
    DebugView, FirstFrame, FrameDevice, FrameError, FrameRequest, FrameSource, FrameTarget,
    ObjectsSource, Opening, TracedSource,
};
use std::sync::atomic::AtomicBool;

/// More than the counters of a build and of a frame, and less than any tree or picture here.
const STATISTICS: u64 = 1024;
const SIZE: [u32; 2] = [40, 30];

struct Device {
    gpu: Gpu,
    shared: FrameDevice,
}

impl Device {
    fn open() -> Device {
        let gpu = Gpu::open(&DeviceOptions { default_limits: true, ..Default::default() });
        let gpu = gpu.expect("the tests on a GPU need one, or a software Vulkan");
        let shared = FrameDevice { device: gpu.device().clone(), queue: gpu.queue().clone() };
        Device { gpu, shared }
    }

    /// A buffer for a picture.
    fn target(&self) -> wgpu::Buffer {
        use wgpu::BufferUsages as Usage;
        let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        self.gpu.buffer("picture", u64::from(4 * SIZE[0] * SIZE[1]), usage).expect("a buffer")
    }

    fn pixels(&self, target: &wgpu::Buffer) -> Vec<u8> {
        splitplane::gpu::device::readback::read(&self.gpu, target, 0, target.size()).expect("bytes")
    }

    fn source(&self, backend: BackendKind) -> (TracedSource, Opening) {
        let (scene, animation) =
            Animation::open("builtin:carousel:4000", None, &SceneOptions::default()).expect("one");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        let mut source = TracedSource::new(
            scene,
            Some(animation),
            OpenOptions::default(),
            BuildOptions::default(),
            1,
            RenderSettings::default(),
            pool,
        );
        let first = FirstFrame { backend, preset: Preset::Fast, aspect: 4.0 / 3.0 };
        let opening = source.open(&self.shared, &first).expect("a source");
        (source, opening)
    }
}

fn request(opening: &Opening, frame: usize, tree: bool) -> FrameRequest {
    FrameRequest {
        width: SIZE[0],
        height: SIZE[1],
        camera: opening.camera,
        backend: opening.backend,
        preset: Preset::Fast,
        accuracy: Accuracy::Watertight,
        depth: 2,
        samples: 1,
        view: DebugView::Shaded,
        time: frame as f64 / 24.0,
        tree,
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn an_animation_stays_on_the_device() {
    let device = Device::open();
    let never = AtomicBool::new(false);
    let (mut on_cpu, opening) = device.source(BackendKind::Cpu);
    let expected: Vec<Vec<u8>> = (0..6)
        .map(|frame| {
            let target = device.target();
            let place = FrameTarget::new(&device.shared, &target, &never);
            on_cpu.submit(&request(&opening, frame, true), &place).expect("a frame");
            assert!(on_cpu.is_done());
            assert_eq!(on_cpu.finish().expect("a frame").bytes_down, 0);
            device.pixels(&target)
        })
        .collect();
    assert!(expected.windows(2).all(|pair| pair[0] != pair[1]), "nothing moves");

    let (mut source, opening) = device.source(BackendKind::Wgpu);
    assert_eq!(source.finish(), Err(FrameError::NothingSubmitted));
    let targets = [device.target(), device.target()];
    // Another round: vertices that are there are not sent again.
    let frames: Vec<usize> = (0..6).chain(0..6).collect();
    let mut reports = Vec::new();
    for (turn, &frame) in frames.iter().enumerate() {
        let place = FrameTarget::new(&device.shared, &targets[turn % 2], &never);
        source.submit(&request(&opening, frame, false), &place).expect("a frame");
        // The one before is asked for while this one is under way.
        if turn > 0 {
            assert!(source.is_done());
            reports.push(source.finish().expect("a frame"));
            assert_eq!(device.pixels(&targets[(turn - 1) % 2]), expected[frames[turn - 1]]);
        }
    }
    reports.push(source.finish().expect("a frame"));
    assert_eq!(device.pixels(&targets[1]), expected[5]);
    assert!(source.tree().is_none());
    // With the first report comes what opening took.
    for report in &reports[1..] {
        assert!((1..STATISTICS).contains(&report.bytes_down), "{report:?}");
        assert!(report.tree.nodes > 100 && report.tree.shape.is_none(), "{report:?}");
        assert!(report.rays >= u64::from(SIZE[0] * SIZE[1]), "{report:?}");
    }
    // Where the tree is asked for it does come, and that is seen in the bytes.
    let place = FrameTarget::new(&device.shared, &targets[0], &never);
    source.submit(&request(&opening, 3, true), &place).expect("a frame");
    let report = source.finish().expect("a frame");
    let tree = source.tree().expect("the tree");
    assert!(report.bytes_down > 8 * tree.nodes.len() as u64, "{report:?}");
    assert!(report.bytes_down > STATISTICS);
    assert_eq!(tree.nodes.len(), report.tree.nodes);
    let shape = report.tree.shape.expect("of a tree that is here");
    assert!(shape.leaves > shape.empty_leaves && shape.max_depth > 0);
    assert_eq!(device.pixels(&targets[0]), expected[3]);
    // A frame that nobody wants is given up before its rays; the one before is not.
    source.submit(&request(&opening, 4, false), &place).expect("a frame");
    let nobody = AtomicBool::new(true);
    let unwanted = FrameTarget::new(&device.shared, &targets[1], &nobody);
    let given_up = source.submit(&request(&opening, 5, false), &unwanted);
    assert_eq!(given_up, Err(FrameError::Superseded));
    source.finish().expect("the frame before");
    assert_eq!(device.pixels(&targets[0]), expected[4]);
    assert_eq!(source.finish(), Err(FrameError::NothingSubmitted));
}

/// Thousands of instances, most of which move in every frame: the same pictures by rays on the CPU and on the device, and only
/// what moved is made anew.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn many_objects_move_from_frame_to_frame() {
    let device = Device::open();
    let never = AtomicBool::new(false);
    let pictures = |backend: BackendKind| {
        let scene = InstancedScene::open("builtin:flock:2000").expect("a scene");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        let (open, build) = (OpenOptions::default(), BuildOptions::default());
        let settings = RenderSettings::default();
        let mut source = ObjectsSource::new(scene, open, build, 1, settings, pool);
        assert_eq!(source.finish(), Err(FrameError::NothingSubmitted));
        let first = FirstFrame { backend, preset: Preset::Fast, aspect: 4.0 / 3.0 };
        let opening = source.open(&device.shared, &first).expect("a source");
        assert!((9.0..11.0).contains(&opening.abilities.seconds.expect("it moves")));
        assert!(opening.bounds.lo[1] < opening.bounds.hi[1]);
        let mut all = Vec::new();
        for (turn, frame) in [0, 0, 1, 5].into_iter().enumerate() {
            let target = device.target();
            let place = FrameTarget::new(&device.shared, &target, &never);
            source.submit(&request(&opening, frame, false), &place).expect("a frame");
            assert!(source.is_done());
            let report = source.finish().expect("a frame");
            // Nothing is built again; a frame that is there is not even moved.
            assert_eq!(report.build_ms, None, "{turn}");
            assert_eq!(report.update_ms == 0.0, turn < 2, "{turn}");
            assert!(report.tree.nodes > 100 && report.triangles > 1000, "{report:?}");
            all.push(device.pixels(&target));
        }
        for view in DebugView::ALL {
            let target = device.target();
            let place = FrameTarget::new(&device.shared, &target, &never);
            let shown = FrameRequest { view, ..request(&opening, 5, false) };
            source.submit(&shown, &place).expect("a frame");
            source.finish().expect("a frame");
            all.push(device.pixels(&target));
        }
        let nobody = AtomicBool::new(true);
        let target = device.target();
        let unwanted = FrameTarget::new(&device.shared, &target, &nobody);
        let given_up = source.submit(&request(&opening, 6, false), &unwanted);
        assert_eq!(given_up, Err(FrameError::Superseded));
        all
    };
    let by_cpu = pictures(BackendKind::Cpu);
    assert!(by_cpu[0] == by_cpu[1] && by_cpu[1] != by_cpu[2] && by_cpu[2] != by_cpu[3]);
    for (view, picture) in by_cpu[4..].iter().enumerate() {
        assert!(by_cpu[4..].iter().filter(|other| *other == picture).count() == 1, "{view}");
    }
    assert!(pictures(BackendKind::Wgpu) == by_cpu);
}
