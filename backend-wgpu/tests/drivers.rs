//! Builds on drivers that do what WGSL lets them do: each kernel, rewritten as such a driver has it, leaves the CPU's bytes.
//! Queries on them are in `hits.rs`. No kernel asks for subgroups, so that their size cannot show.

use crate::common::{self, hostile};
use splitplane_core::build::lockstep::{Lockstep, LockstepError};
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::kernel::Kernel;
use splitplane_core::kernel::KernelSet;
use splitplane_core::kernel::TreeBuilder;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuExecutor, InstructionSet};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Gpu, WgpuBackend, WgpuExecutor};

/// What differs first, if anything does.
fn difference(backend: &WgpuBackend, scene: &Scene, config: &BuildConfig) -> Option<String> {
    let mesh = scene.mesh();
    let set = InstructionSet::detect();
    let cpu: CpuExecutor<'_> =
        CpuExecutor::new(mesh, *config, set, Buffers::default(), None).expect("memory");
    let run = |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        schedule::build(&mut lockstep, config.preset().planes().expect("a schedule"))
    };
    match backend.with_executor(&mesh, config, run).expect("a device that holds the scene") {
        Ok(()) => None,
        Err(LockstepError::Differs(difference)) => Some(difference.to_string()),
        Err(other) => panic!("{other}"),
    }
}

/// The kernels that a preset runs, with their texts.
fn kernels() -> impl Iterator<Item = (Kernel, String)> {
    TreeBuilder::KERNELS.iter().map(|row| {
        let shader = splitplane_shaders::find(row.name).expect("a kernel");
        (row.kernel, shader.source())
    })
}

/// A backend in which one kernel has another text.
fn backend(kernel: Kernel, source: String) -> WgpuBackend {
    WgpuBackend::with_replaced_kernel(Gpu::clone(&common::gpu()), kernel, source)
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn no_order_of_workgroups_shows() {
    let scene = scenes::soup(1500, 0.3, 8);
    let mut seen = 0;
    for (kernel, source) in kernels() {
        let Some(turned) = hostile::reordered(&source) else { continue };
        let backend = backend(kernel, turned);
        for config in [BuildConfig::default(), Preset::Balanced.config()] {
            assert_eq!(difference(&backend, &scene, &config), None, "{kernel:?}");
        }
        seen += 1;
    }
    assert!(seen >= 8, "{seen}");
    // What finishes their work: sums over the top tree are made by whoever comes second to a node.
    let mut seen = Vec::new();
    for shader in splitplane_shaders::KERNEL_RETRIES {
        let Some(turned) = hostile::reordered(&shader.source()) else { continue };
        let own = shader.name.strip_suffix("_retry").expect("a retry");
        let row = TreeBuilder::KERNELS.iter().find(|row| row.name == own).expect("its kernel");
        let gpu = Gpu::clone(&common::gpu());
        let backend = WgpuBackend::with_replaced_retry(gpu, row.kernel, turned);
        for config in [BuildConfig::default(), Preset::Balanced.config()] {
            assert_eq!(difference(&backend, &scene, &config), None, "{}", shader.name);
        }
        seen.push(own);
    }
    assert_eq!(seen, ["subtree_sizes", "preorder_addresses", "emit_small"]);
}

/// A driver that ends a small root's loops before their end: the build says so, and there is no tree.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_a_driver_does_not_finish_is_told() {
    let source = splitplane_shaders::find("build_small").expect("a kernel").source();
    let measured = "size = build_subtree(root, lane);";
    let cut = source.replace(
        measured,
        &format!("{measured} if index % 3u == 1u {{ size = vec2<u32>(NOTHING); }}"),
    );
    assert!(cut != source, "the text to change is gone");
    let backend = backend(Kernel::BuildSmall, cut);
    let scene = scenes::soup(3000, 0.05, 8);
    for config in [BuildConfig::default(), Preset::Balanced.config()] {
        let built = backend.build_on_device(&scene.mesh(), &config.into());
        let error = built.expect_err("a build that was cut off");
        assert!(error.to_string().contains("ended a loop before its end"), "{error}");
    }
}

/// Drivers that do several of these things at once, where they do not contradict one another.
const AT_ONCE: [&[&str]; 3] = [
    &[
        "reciprocals are too large",
        "free operations round away from zero",
        "subnormal results are flushed",
        "subnormal products are flushed before they are rounded",
    ],
    &["reciprocals are too small", "free operations round towards zero", "zeros become negative"],
    &["products and sums fuse", "zeros lose their sign"],
];

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn builds_on_drivers_that_round_badly() {
    let scene = scenes::soup(700, 0.3, 8);
    let config = Preset::Balanced.config();
    let rounding: Vec<(Kernel, String)> =
        kernels().filter(|(_, source)| source.contains("fn guard(")).collect();
    assert!(rounding.len() >= 8, "{}", rounding.len());
    for (kernel, source) in &rounding {
        for names in AT_ONCE {
            let drivers = hostile::ALLOWED.iter().filter(|driver| names.contains(&driver.name));
            assert_eq!(drivers.clone().count(), names.len());
            let compiled = drivers.fold(source.clone(), |source, driver| driver.compiled(&source));
            let found = difference(&backend(*kernel, compiled), &scene, &config);
            assert_eq!(found, None, "{kernel:?}, {names:?}");
        }
    }
    // What WGSL does not allow is seen where quotients are formed.
    let forbidden = rounding.iter().any(|(kernel, source)| {
        let wrong = hostile::FORBIDDEN.compiled(source);
        difference(&backend(*kernel, wrong), &scene, &config).is_some()
    });
    assert!(forbidden, "{}: not seen", hostile::FORBIDDEN.name);
}

/// Where order does matter, changing places shows it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn an_order_that_shows_is_seen() {
    const GROUPS: u32 = 4096;
    let text = |statement: &str| {
        format!(
            "@group(0) @binding(0) var<storage, read_write> words: array<atomic<u32>>;
@compute @workgroup_size(1)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
) {{
    let turn = atomicAdd(&words[0], 1u);
    {statement}
}}
"
        )
    };
    let gpu = common::gpu();
    let run = |source: &str| {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let words = gpu.buffer("words", u64::from(4 * (GROUPS + 1)), usage).expect("a buffer");
        let pipeline = gpu.pipeline("order", source).expect("a pipeline");
        let entry = wgpu::BindGroupEntry { binding: 0, resource: words.as_entire_binding() };
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[entry],
        });
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(GROUPS, 1, 1);
        drop(pass);
        gpu.submit([encoder.finish()]).expect("commands");
        common::read(&words)
    };
    let both = |statement: &str| {
        let given = text(statement);
        let turned = hostile::reordered(&given).expect("workgroups");
        (run(&given), run(&turned))
    };
    let (given, turned) = both("atomicStore(&words[1u + group.x], group.x);");
    assert_eq!(given, turned);
    let (given, turned) = both("atomicStore(&words[1u + turn], group.x);");
    assert_ne!(given, turned);
}
