//! What can go wrong on a device, made to go wrong: each ends in the error meant for it.
//!
//! Where a device need not compute anything, it is wgpu's `noop` one.

use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_wgpu::{Adapters, Gpu, GpuError, OpenError, OpenOptions, Parity, panic_is_caught};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;
use wgpu::BufferUsages as Usage;

/// An instance with the `noop` adapter, which offers these limits or any at all.
fn noop_instance(limits: Option<wgpu::Limits>) -> wgpu::Instance {
    let noop = wgpu::NoopBackendOptions { limits, ..wgpu::NoopBackendOptions::enabled() };
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::NOOP,
        backend_options: wgpu::BackendOptions { noop, ..Default::default() },
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

fn noop() -> Gpu {
    Gpu::open_in(&noop_instance(Some(wgpu::Limits::default())), &named("noop")).unwrap()
}

/// Options that do not depend on the environment.
fn named(adapter: &str) -> OpenOptions {
    OpenOptions { adapter: Some(adapter.into()), ..OpenOptions::default() }
}

fn borrowed() -> (wgpu::Device, wgpu::Queue, Gpu) {
    let (device, queue) = wgpu::Device::noop(&wgpu::DeviceDescriptor::default());
    let gpu = Gpu::borrow(device.clone(), queue.clone());
    (device, queue, gpu)
}

#[track_caller]
fn assert_lost<T: std::fmt::Debug>(result: Result<T, GpuError>) {
    assert!(matches!(result, Err(GpuError::Lost { .. })), "{result:?}");
}

#[test]
fn no_adapter() {
    let empty = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    for options in [OpenOptions::default(), named("llvmpipe"), named("0")] {
        let error = Gpu::open_in(&empty, &options).unwrap_err();
        assert_eq!(error, OpenError::NoAdapter);
        assert_eq!(error.to_string(), "no GPU adapter was found");
    }
}

#[test]
fn a_wrong_adapter_name_lists_those_there_are() {
    let instance = noop_instance(None);
    for wrong in ["abacus", "1", ""] {
        let error = Gpu::open_in(&instance, &named(wrong)).unwrap_err();
        let seen = vec!["noop wgpu backend".to_owned()];
        assert_eq!(error, OpenError::WrongAdapter { asked: wrong.into(), seen });
        assert!(error.to_string().contains("0 `noop wgpu backend`"), "{error}");
    }
    for right in ["NOOP", "wgpu back", "0"] {
        assert_eq!(
            Gpu::open_in(&instance, &named(right)).unwrap().info().name,
            "noop wgpu backend"
        );
    }
}

#[test]
fn limits_below_the_defaults_of_webgpu() {
    let limits = wgpu::Limits { max_compute_workgroup_storage_size: 8192, ..Default::default() };
    let instance = noop_instance(Some(limits.clone()));
    let error = Gpu::open_in(&instance, &named("0")).unwrap_err();
    assert!(matches!(error, OpenError::Unusable { .. }), "{error:?}");
    assert!(error.to_string().contains("max_compute_workgroup_storage_size is 8192"), "{error}");
    let adapters = Adapters::find_in(&instance);
    let report = adapters.list()[0].report(|_| Ok(Parity::Bitwise));
    assert_eq!(report.parity, None);
    assert!(report.unusable.is_some_and(|reason| reason.contains("16384")));
    // The same limits on a device of the host.
    let (device, queue) = wgpu::Device::noop(&wgpu::DeviceDescriptor {
        required_limits: limits,
        ..Default::default()
    });
    let checked = Gpu::borrow(device, queue).check_limits();
    assert!(matches!(checked, Err(GpuError::Limit { needed: 16384, allowed: 8192, .. })));
}

#[test]
fn a_self_test_that_fails_makes_an_adapter_unusable() {
    let adapters = Adapters::find_in(&noop_instance(None));
    let report = adapters.list()[0].report(|_| Err(GpuError::TimedOut { seconds: 60 }));
    assert_eq!(report.parity, None);
    assert!(report.unusable.is_some_and(|reason| reason.contains("within 60 seconds")));
}

#[test]
fn default_limits_are_requested_whatever_there_is() {
    let instance = noop_instance(None);
    let all = Gpu::open_in(&instance, &named("0")).unwrap();
    assert!(all.limits().max_storage_buffer_binding_size > 1 << 30);
    let options = OpenOptions { default_limits: true, ..named("0") };
    let few = Gpu::open_in(&instance, &options).unwrap();
    assert_eq!(few.limits().max_storage_buffer_binding_size, 128 << 20);
    few.check_limits().unwrap();
}

#[test]
fn buffers_over_a_limit_are_refused_before_wgpu_sees_them() {
    let gpu = noop();
    let limit = |bytes, usage| match gpu.buffer("nodes", bytes, usage).unwrap_err() {
        GpuError::Limit { what, limit, needed, allowed } => {
            assert_eq!((what.as_str(), needed), ("nodes", bytes));
            (limit, allowed)
        }
        other => panic!("{other:?}"),
    };
    let binding = ("max_storage_buffer_binding_size", 128 << 20);
    assert_eq!(limit((128 << 20) + 1, Usage::STORAGE | Usage::COPY_SRC), binding);
    assert_eq!(limit((256 << 20) + 1, Usage::COPY_DST), ("max_buffer_size", 256 << 20));
    assert_eq!(limit(u64::MAX, Usage::STORAGE), ("max_buffer_size", 256 << 20));
    assert_eq!(gpu.buffer("nodes", 128 << 20, Usage::STORAGE).unwrap().size(), 128 << 20);
    gpu.check().unwrap();
}

/// Runs itself in a process that may not have as much memory as the buffer is large.
#[cfg(unix)]
#[test]
fn no_memory_is_an_error_and_the_device_lives_on() {
    const CHILD: &str = "SPLITPLANE_TEST_LITTLE_MEMORY";
    if std::env::var_os(CHILD).is_none() {
        let status = std::process::Command::new("sh")
            .args(["-c", "ulimit -v 2000000 && exec \"$0\" \"$@\""])
            .arg(std::env::current_exe().unwrap())
            .args(["--exact", "faults::no_memory_is_an_error_and_the_device_lives_on"])
            .env(CHILD, "1")
            .status();
        assert!(status.unwrap().success());
        return;
    }
    let limits = wgpu::Limits { max_buffer_size: 1 << 32, ..Default::default() };
    let own = Gpu::open_in(&noop_instance(Some(limits)), &named("0")).unwrap();
    let borrowed = Gpu::borrow(own.device().clone(), own.queue().clone());
    for gpu in [own, borrowed] {
        let needed = 3 << 30;
        let error = gpu.buffer("references", needed, Usage::COPY_DST).unwrap_err();
        assert_eq!(error, GpuError::OutOfMemory { what: "references".into(), needed });
        assert!(matches!(
            BuildError::from(error.clone()),
            BuildError::Device(DeviceError::OutOfMemory { .. })
        ));
        assert!(matches!(
            QueryError::from(error),
            QueryError::Device(DeviceError::OutOfMemory { .. })
        ));
        gpu.check().unwrap();
        gpu.buffer("references", 64, Usage::COPY_DST).unwrap();
    }
}

/// Everything that a device does, on one that was lost before.
fn assert_all_lost(gpu: &Gpu, readable: &wgpu::Buffer) {
    assert_lost(gpu.check());
    assert_lost(gpu.poll());
    assert_lost(gpu.wait());
    assert_lost(gpu.read_mapped(readable, 16));
    assert_lost(gpu.read_mapped(readable, 0));
    assert_lost(gpu.buffer("late", 64, Usage::COPY_DST));
    assert_lost(gpu.pipeline("late", "@compute @workgroup_size(1) fn main() {}"));
    assert_lost(gpu.submit([]));
    let lost = gpu.check().unwrap_err();
    assert!(matches!(BuildError::from(lost.clone()), BuildError::Device(DeviceError::Lost { .. })));
    assert!(matches!(QueryError::from(lost), QueryError::Device(DeviceError::Lost { .. })));
}

#[test]
fn a_lost_device_is_an_error_everywhere() {
    let gpu = noop();
    let readable = gpu.buffer("readable", 64, Usage::MAP_READ | Usage::COPY_DST).unwrap();
    assert_eq!(gpu.read_mapped(&readable, 16).unwrap().len(), 16);
    gpu.device().destroy();
    assert_all_lost(&gpu, &readable);
}

#[test]
fn a_lost_device_of_the_host_is_noticed_and_the_host_is_told_too() {
    let (device, _, gpu) = borrowed();
    let told = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&told);
    device.set_device_lost_callback(move |_, _| {
        count.fetch_add(1, Ordering::Relaxed);
    });
    let readable = gpu.buffer("readable", 64, Usage::MAP_READ | Usage::COPY_DST).unwrap();
    device.destroy();
    assert_all_lost(&gpu, &readable);
    device.poll(wgpu::PollType::Poll).unwrap();
    assert_eq!(told.load(Ordering::Relaxed), 1);
}

#[test]
fn a_loss_between_mapping_and_reading_is_a_loss() {
    let gpu = noop();
    let readable = gpu.buffer("readable", 64, Usage::MAP_READ | Usage::COPY_DST).unwrap();
    let device = gpu.device().clone();
    // Runs while the buffer is being mapped.
    gpu.queue().on_submitted_work_done(move || device.destroy());
    assert_lost(gpu.read_mapped(&readable, 64));
    assert_lost(gpu.wait());
}

/// What wgpu does when the driver reports the loss while wgpu waits.
#[test]
fn a_panic_of_wgpu_about_a_lost_device_is_a_loss() {
    let gpu = noop();
    let device = gpu.device().clone();
    gpu.queue().on_submitted_work_done(move || {
        device.destroy();
        assert!(panic_is_caught());
        panic!("Error in Device::poll: Parent device is lost");
    });
    assert_lost(gpu.wait());
    assert!(!panic_is_caught());
}

#[test]
fn a_panic_for_another_reason_stays_a_panic() {
    let gpu = noop();
    gpu.queue().on_submitted_work_done(|| panic!("of the host's own"));
    let raised = catch_unwind(AssertUnwindSafe(|| gpu.wait())).unwrap_err();
    assert_eq!(raised.downcast_ref::<String>().unwrap(), "of the host's own");
    assert!(!panic_is_caught());
    gpu.wait().unwrap();
}

#[test]
fn errors_outside_any_scope_are_found_at_the_next_check() {
    let gpu = noop();
    for _ in 0..2 {
        let bad = wgpu::ShaderSource::Wgsl("fn main( {".into());
        let label = Some("bad");
        let _ =
            gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor { label, source: bad });
        let found = gpu.wait();
        assert!(matches!(&found, Err(GpuError::Refused(why)) if why.contains("bad")), "{found:?}");
        gpu.check().unwrap();
    }
}

#[test]
fn on_a_device_of_the_host_nothing_of_ours_reaches_its_callback() {
    let (device, queue, gpu) = borrowed();
    let told = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&told);
    device.on_uncaptured_error(Arc::new(move |_| {
        count.fetch_add(1, Ordering::Relaxed);
    }));
    let error = gpu.pipeline("twin", "@compute @workgroup_size(1) fn other() {}").unwrap_err();
    assert!(matches!(&error, GpuError::Shader { shader, .. } if shader == "twin"), "{error:?}");
    let plain = gpu.buffer("plain", 64, Usage::COPY_DST).unwrap();
    assert!(matches!(gpu.read_mapped(&plain, 64), Err(GpuError::Refused(_))));
    assert!(matches!(gpu.read_mapped(&plain, 65), Err(GpuError::Refused(_))));
    assert_eq!(told.load(Ordering::Relaxed), 0);
    gpu.check().unwrap();
    // The host's own errors are the host's.
    queue.write_buffer(&plain, 60, &[0; 8]);
    assert_eq!(told.load(Ordering::Relaxed), 1);
    gpu.check().unwrap();
}

#[test]
fn text_that_is_no_wgsl_is_refused_with_the_name_of_the_shader() {
    let gpu = noop();
    for text in ["fn main( {", "@compute @workgroup_size(1) fn main() { let x: u32 = 1.0; }", ""] {
        let error = gpu.pipeline("split_median", text).unwrap_err();
        assert!(error.to_string().starts_with("the shader `split_median` does not compile: "));
        assert!(matches!(BuildError::from(error), BuildError::Device(DeviceError::Failed(_))));
    }
    gpu.pipeline("split_median", "@compute @workgroup_size(1) fn main() {}").unwrap();
    gpu.check().unwrap();
}

#[test]
fn a_buffer_can_be_read_again_after_reading_it_failed() {
    let gpu = noop();
    let buffer = gpu.buffer("readable", 64, Usage::MAP_READ | Usage::COPY_DST).unwrap();
    gpu.queue().write_buffer(&buffer, 0, &[7; 64]);
    let impatient = gpu.clone().with_timeout(Duration::ZERO);
    // On this device all is done at once, so that even no time suffices or fails cleanly.
    let _ = impatient.read_mapped(&buffer, 5);
    assert_eq!(gpu.read_mapped(&buffer, 5).unwrap(), [7; 5]);
    assert_eq!(gpu.read_mapped(&buffer, 64).unwrap(), [7; 64]);
}

/// Some seconds of work on a processor, less on a GPU: too long to be over when asked next.
const LONG: &str = "
@group(0) @binding(0) var<storage, read_write> out: array<u32>;
@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    var x = out[id.x] + id.x;
    for (var i = 0u; i < 1000000u; i++) { x = x * 1664525u + 1013904223u; }
    out[id.x] = x;
}";

const INVOCATIONS: u32 = 64 * 64;

/// A device of this machine, with a buffer that can be read and work under way that fills it.
fn busy(timeout: Duration) -> (Gpu, wgpu::Buffer) {
    let gpu = Gpu::open(&OpenOptions { timeout: Some(timeout), ..OpenOptions::default() })
        .expect("a GPU adapter is needed; scripts/test.sh sets up a software one");
    let bytes = u64::from(INVOCATIONS) * 4;
    let out = gpu.buffer("out", bytes, Usage::STORAGE | Usage::COPY_SRC).unwrap();
    let readable = gpu.buffer("readable", bytes, Usage::MAP_READ | Usage::COPY_DST).unwrap();
    let pipeline = gpu.pipeline("long", LONG).unwrap();
    let commands = gpu.guard(|| {
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: out.as_entire_binding() }],
        });
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(INVOCATIONS / 64, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&out, 0, &readable, 0, Some(bytes));
        encoder.finish()
    });
    gpu.submit([commands.unwrap()]).unwrap();
    (gpu, readable)
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_that_takes_too_long_is_timed_out_and_can_be_waited_for_again() {
    let (gpu, readable) = busy(Duration::ZERO);
    assert!(!gpu.poll().unwrap());
    assert_eq!(gpu.wait(), Err(GpuError::TimedOut { seconds: 0 }));
    assert_eq!(gpu.read_mapped(&readable, 16), Err(GpuError::TimedOut { seconds: 0 }));
    let patient = gpu.clone().with_timeout(Duration::from_secs(600));
    patient.wait().unwrap();
    assert!(patient.poll().unwrap());
    let bytes = patient.read_mapped(&readable, 16).unwrap();
    assert_ne!(bytes, [0; 16]);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_lost_in_the_middle_of_work_is_a_loss_at_once() {
    let (gpu, readable) = busy(Duration::from_secs(600));
    gpu.device().destroy();
    assert_lost(gpu.wait());
    assert_lost(gpu.read_mapped(&readable, 16));
    // Nothing was waited for: the work is still under way, or was done before it could be seen.
    assert_lost(gpu.submit([]));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_lost_while_another_thread_waits_ends_the_wait() {
    let (gpu, readable) = busy(Duration::from_secs(600));
    let device = gpu.device().clone();
    let destroyer = thread::spawn(move || {
        thread::sleep(Duration::from_millis(20));
        device.destroy();
    });
    // The work may be faster than the loss, but then the next call finds it.
    let read = gpu.read_mapped(&readable, 16);
    destroyer.join().unwrap();
    if read.is_ok() {
        assert_lost(gpu.wait());
    } else {
        assert_lost(read);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_lost_device_of_this_machine_is_an_error_everywhere() {
    let gpu = Gpu::open(&OpenOptions::default()).expect("scripts/test.sh sets up an adapter");
    let readable = gpu.buffer("readable", 64, Usage::MAP_READ | Usage::COPY_DST).unwrap();
    gpu.device().destroy();
    assert_all_lost(&gpu, &readable);
}
